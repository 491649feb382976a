"""How sure an answer is and what to change, as tables of the page: intervals, combinations, accuracy, effects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from identify.report.answers import interval_text
from identify.report.quantity_text import DASH, finite, number, quantity
from identify.report.report_tables import Cell, Row, Table
from identify.report.report_wording import plain_symbol, with_group

# ----------------------------------------------------------------------------------------------------------------------
# Advice as a table: what each quantity of the rig is, its limit, and what it should be.
# ----------------------------------------------------------------------------------------------------------------------

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


Entries = Mapping[str, Any]


def interval_table(result: Entries) -> Table | None:
    """The 95 % intervals side by side: the result's own, by profile, by bootstrap; None where neither was run."""
    methods = [(key, result.get(key) or {}) for key in ("profile", "bootstrap")]
    run = [(key, document) for key, document in methods if document.get("parameters")]
    if not run:
        return None
    heads = [Cell("result")]
    for key, document in run:
        note = ""
        if key == "bootstrap":
            failed = int(document.get("failed") or 0)
            note = f"{document.get('replicates')} replicates" + (f", {failed} did not settle" if failed else "")
        heads.append(Cell(key, note))
    rows = []
    for name, entry in (result.get("parameters") or {}).items():
        mine = [document["parameters"].get(name) for _, document in run]
        if not any(mine):
            continue
        value, unit = finite(entry.get("value")), str(entry.get("unit") or "")
        cells = [Cell(interval_text(entry.get("interval"), value, unit) or "open")]
        cells += [_interval_cell(part, value, unit) for part in mine]
        rows.append(Row(plain_symbol(with_group(name, entry)), tuple(cells), note=quantity(value, unit, 5)))
    return Table("parameter", tuple(heads), tuple(rows)) if rows else None


def _interval_cell(part: Entries | None, value: float | None, unit: str) -> Cell:
    if not part:
        return Cell(DASH)
    notes = []
    if any(part.get("at_bound") or ()):
        notes.append("ends at a bound of the scene")
    if any(part.get("failed") or ()):
        notes.append("a point failed")
    spread = finite(part.get("spread_in_standard_errors"))
    if spread is not None:
        notes.append(f"spread {number(spread, 2)} SE")
    return Cell(interval_text(part.get("interval"), value, unit) or "open", " · ".join(notes))


def combination_table(result: Entries) -> Table | None:
    """Combinations that are known better than their parts; None without any."""
    natural = (result.get("combinations") or {}).get("natural") or ()
    rows = [
        Row(
            str(entry["name"]),
            (
                Cell(quantity(finite(entry["value"]), str(entry["unit"]))),
                Cell(interval_text(entry["interval"], finite(entry["value"]), str(entry["unit"]))),
                Cell(f"{number(finite(entry['sharper']), 2)} ×"),
            ),
            note=str(entry["meaning"]),
        )
        for entry in natural
    ]
    heads = (Cell("value"), Cell("95 % interval"), Cell("sharper than its loosest part"))
    return Table("combination", heads, tuple(rows)) if rows else None


def direction_lines(result: Entries) -> tuple[str, ...]:
    """The best and the worst known direction, in words."""
    told = (result.get("combinations") or {}).get("directions") or ()
    lines = [str(entry["text"]) for entry in told]
    return tuple(line[:1].upper() + line[1:] + "." for line in (lines[:1] + lines[-1:] if len(lines) > 1 else lines))


def accuracy_rows(result: Entries) -> Table | None:
    """What each level of accuracy costs, and by how many standard errors it moves each parameter."""
    table = result.get("accuracy_table") or ()
    if not table:
        return None
    shifts = [entry.get("shift_in_standard_errors") or {} for entry in table]
    names = list(dict.fromkeys(name for shift in shifts for name in shift))
    heads = (
        *(Cell(head) for head in ("seconds", "iterations", "steps", "error left")),
        *(Cell(plain_symbol(name)) for name in names),
    )
    rows = []
    for entry, shift in zip(table, shifts, strict=True):
        left = [abs(error) for error in (entry.get("left_in_standard_errors") or {}).values() if error is not None]
        cells = [
            Cell(number(finite(entry.get("seconds")), 3)),
            Cell(str(entry.get("iterations", DASH))),
            Cell(str(entry.get("steps", DASH))),
            Cell(f"{number(max(left), 2)} SE" if left else DASH),
            *(Cell(number(finite(shift.get(name)), 2)) for name in names),
        ]
        rows.append(Row(str(entry.get("accuracy")), tuple(cells), note="" if shift else "did not solve"))
    return Table("accuracy", heads, tuple(rows))


def comparison_table(result: Entries) -> Table | None:
    """The fit with and without each effect: information criteria and errors on what was left out."""
    rows = []
    for entry in result.get("effects_table") or ():
        rows.append(
            Row(
                str(entry["model"]).replace("_", " "),
                tuple(
                    Cell(*cell)
                    for cell in (
                        (_count(entry.get("parameters")),),
                        (number(finite(entry.get("chi2_per_sample")), 5),),
                        (_signed(entry.get("delta_aic")),),
                        (_signed(entry.get("delta_bic")),),
                        (number(finite(entry.get("left_out_cycles")), 4),),
                        (number(finite(entry.get("left_out_logs")), 4),),
                        (str(entry.get("verdict") or ""), "", "words"),
                    )
                ),
            )
        )
    heads = ("parameters", "χ² per sample", "ΔAIC", "ΔBIC", "error on cycles left out", "error on logs left out")
    verdict = Cell("verdict", kind="words")
    return Table("model", (*(Cell(head) for head in heads), verdict), tuple(rows)) if rows else None


def _count(value: Any) -> str:
    return DASH if value is None else str(value)


def _signed(value: Any) -> str:
    shown = finite(value)
    return DASH if shown is None else number(shown, 3) if shown <= 0 else f"+{number(shown, 3)}"
