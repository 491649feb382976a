"""The report of a fit: result.json, report.html, result.h5, classical.csv and the figures. It computes nothing."""

from identify.report.stored_result import write_report

__all__ = ["write_report"]
