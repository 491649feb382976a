"""A fit in plain text of 79 columns: what the terminal prints, and what a fit shows of itself in Python."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from identify.base.plain_text import columns, wrapped
from identify.report.report_views import parameter_views


def summary(result: Mapping[str, Any]) -> str:
    """Status, parameters with intervals and verdicts, and the reasons of what is not identified.

    Args:
        result: the document of result.json.
    """
    return "\n".join(_lines(result))


def _lines(result: Mapping[str, Any]) -> Iterator[str]:
    yield wrapped(f"{str(result['status']).replace('_', ' ')}: {result['message']}")
    if result["status"] != "converged":
        return
    for number, log in enumerate(result.get("logs", ()), 1):
        if log.get("reason_left_out"):
            yield wrapped(f"log {number} took no part: {log['reason_left_out']}", "  ")
    yield ""
    yield parameter_table(result["parameters"])
    yield ""
    effects = result.get("effects") or {}
    if effects.get("chosen") == "auto":
        yield wrapped(f"effects chosen: {', '.join(effects['names'])}", "  ")
        gone = [str(reason["effect"]) for reason in effects["reasons"] if not reason["kept"]]
        yield wrapped(f"left out: {', '.join(gone) or 'none'}; why: see the report", "  ")
        yield ""
    tables = {"accuracy_table": "what accuracy costs", "effects_table": "what each effect is worth"}
    if asked := [words for name, words in tables.items() if result.get(name)]:
        yield wrapped(f"{' and '.join(asked)}: see the report", "  ")
    for view in parameter_views(result["parameters"]):
        if view.verdict not in ("identified", "fixed") and view.reason:
            yield wrapped(f"{view.name}: {view.reason}", "  ")


def parameter_table(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """Value, standard error, 95 % interval and verdict of each parameter, in lab units."""
    rows = [["", "value", "95 % interval", "unit", "verdict"]]
    for view in parameter_views(parameters):
        value = f"{view.value} ± {view.error}" if view.error else view.value
        rows.append([view.name, value, view.interval, view.unit, view.verdict])
    return columns(rows)
