"""Advice as a table: what each quantity of the rig is, its limit, and what it should be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from identify.report.answers import interval_text
from identify.report.quantity_text import DASH, finite, quantity
from identify.report.report_tables import Cell, Row, Table

HEADS = (Cell("now"), Cell("limit"), Cell("should be"))


def advice_table(head: Cell, derived: Mapping[str, Any]) -> Table | None:
    """The table of the advice of a log; None where it has none."""
    advice = derived.get("advice")
    if not isinstance(advice, Mapping) or not advice.get("changes"):
        return None
    task = "to stay steady" if advice["steady"] else "to make sliding steady"
    corner = f"{head.text}: {task}, margin {100 * advice['margin']:.3g} %, one of these"
    return Table(corner, HEADS, tuple(_row(change) for change in advice["changes"]))


def _row(change: Mapping[str, Any]) -> Row:
    now, limit, advised = (change[key] for key in ("now", "limit", "advised"))
    word = {"least": "at least ", "most": "at most "}.get(str(change["at"]), "")
    notes = [change["reason"], "extrapolated: outside the tested range" if change["extrapolated"] else ""]
    if change.get("zeta"):
        notes.insert(0, f"ζ = {change['zeta']:.3g}")
    if advised["value"] is None:
        told = "any" if limit["value"] is None and "it is steady" in change["reason"] else "cannot be reached"
    else:
        told = "as it is" if advised["value"] == now["value"] else word + _said(advised)
    return Row(
        change["label"],
        (
            Cell(_said(now)),
            Cell(_said(limit), " · ".join(filter(None, (_interval(limit), str(change["kind"] or ""))))),
            Cell(told, " · ".join(filter(None, notes)), "doubt" if change["extrapolated"] else ""),
        ),
    )


def _said(entry: Mapping[str, Any]) -> str:
    value = finite(entry.get("value"))
    return DASH if value is None else quantity(value, str(entry["unit"]), 3)


def _interval(entry: Mapping[str, Any]) -> str:
    if entry.get("reason"):
        return str(entry["reason"])
    value = finite(entry.get("value"))
    return interval_text(entry.get("interval"), value, str(entry["unit"])) if value is not None else ""
