"""The summary of a fit on a terminal of 80 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from identify.cli.common import Terminal

if TYPE_CHECKING:
    from identify.base.outcome import Fit

WIDTH = 79


def columns(rows: Sequence[Sequence[str]], indent: str = "  ") -> str:
    """Rows of cells as aligned text; the first row is the heading."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    lines = (indent + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)
    return "\n".join(line.rstrip() for line in lines)


def wrapped(text: str, indent: str = "", hang: str = "  ") -> str:
    """Text broken at 79 columns; lines after the first hang further in."""
    return textwrap.fill(text, WIDTH, initial_indent=indent, subsequent_indent=indent + hang)


def say_fit(fit: Fit, terminal: Terminal) -> None:
    """Status, parameters with intervals and verdicts, and the reasons of what is not identified."""
    result = fit.result
    terminal.say(wrapped(f"{str(result['status']).replace('_', ' ')}: {result['message']}"))
    for number, log in enumerate(result.get("logs", ()), 1):
        if fit.converged and log.get("reason_left_out"):
            terminal.say(wrapped(f"log {number} took no part: {log['reason_left_out']}", "  "))
    if not fit.converged:
        return
    terminal.say()
    terminal.say(parameter_table(result["parameters"]))
    terminal.say()
    say_choice(result.get("effects") or {}, terminal)
    tables = {"accuracy_table": "what accuracy costs", "effects_table": "what each effect is worth"}
    if asked := [words for name, words in tables.items() if result.get(name)]:
        terminal.say(wrapped(f"{' and '.join(asked)}: see the report", "  "))
    say_reasons(result["parameters"], terminal)


def say_choice(effects: Mapping[str, Any], terminal: Terminal) -> None:
    """Which effects were chosen and which were not; nothing where the scene lists them."""
    if effects.get("chosen") != "auto":
        return
    terminal.say(wrapped(f"effects chosen: {', '.join(effects['names'])}", "  "))
    gone = [str(reason["effect"]) for reason in effects["reasons"] if not reason["kept"]]
    terminal.say(wrapped(f"left out: {', '.join(gone) or 'none'}; why: see the report", "  "))
    terminal.say()


def parameter_table(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """Value, standard error, 95 % interval and verdict of each parameter, in lab units."""
    from identify.report.report_views import parameter_views

    rows = [["", "value", "95 % interval", "unit", "verdict"]]
    for view in parameter_views(parameters):
        value = f"{view.value} ± {view.error}" if view.error else view.value
        rows.append([view.name, value, view.interval, view.unit, view.verdict])
    return columns(rows)


def say_reasons(parameters: Mapping[str, Mapping[str, Any]], terminal: Terminal) -> None:
    """One sentence per parameter that is not identified."""
    from identify.report.report_views import parameter_views

    for view in parameter_views(parameters):
        if view.verdict not in ("identified", "fixed") and view.reason:
            terminal.say(wrapped(f"{view.name}: {view.reason}", "  "))


def say_files(out: Path, terminal: Terminal) -> None:
    """Where the report is."""
    terminal.say(f"report: {out / 'report.html'}")
