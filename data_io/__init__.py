"""Tribometer logs as records in SI: readers, writers, units, quality. Knows files, never physics."""

from data_io.contents import StepSummary
from data_io.open import list_steps, read_log
from data_io.record import Record
from data_io.values import Finding, LogError, LogTooLargeError, Step
from data_io.write import write_archive, write_csv, write_hdf5

__all__ = [
    "Finding",
    "LogError",
    "LogTooLargeError",
    "Record",
    "Step",
    "StepSummary",
    "list_steps",
    "read_log",
    "write_archive",
    "write_csv",
    "write_hdf5",
]
