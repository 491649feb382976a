"""Tables of the page as plain data, built from whatever entries the document holds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from identify.report.quantity_text import DASH, finite, number, quantity, scale_for, split_key
from identify.report.table_csv import classical_rows, column_names
from identify.report.words import plain_symbol

LOGS_PER_TABLE = 6
MOST_CLASSICAL_COLUMNS = 60


@dataclass(frozen=True)
class Cell:
    """One cell: its text, a smaller second line, and a kind that the style sheet knows."""

    text: str
    note: str = ""
    kind: str = ""


@dataclass(frozen=True)
class Row:
    """One row: its head, a smaller word beside it (a unit, say), its cells; `heading` rows only part the table."""

    head: str
    cells: tuple[Cell, ...] = ()
    note: str = ""
    heading: bool = False


@dataclass(frozen=True)
class Table:
    """A table with a corner text, column heads and rows."""

    corner: str
    heads: tuple[Cell, ...]
    rows: tuple[Row, ...]


def classical_tables(logs: Sequence[Mapping[str, Any]]) -> tuple[Table, ...]:
    """The classical table turned on its side: one column per log, step and stroke, one row per quantity.

    Several tables where there are many columns, so that they fit a sheet; at most 60 columns in all
    (classical.csv holds every one).
    """
    rows = classical_rows(logs)[:MOST_CLASSICAL_COLUMNS]
    keys = [key for key in ("step", "stroke", "direction") if any(key in row for _, row in rows)]
    names = [name for name in column_names(rows) if name not in keys and any(_told(row.get(name)) for _, row in rows)]
    tables = []
    for first in range(0, len(rows), LOGS_PER_TABLE):
        part = rows[first : first + LOGS_PER_TABLE]
        heads = tuple(
            Cell(f"log {position}", ", ".join(f"{key} {row[key]}" for key in keys if _told(row.get(key))))
            for position, row in part
        )
        tables.append(
            Table("", heads, tuple(_classical_row(name, [row.get(name) for _, row in part]) for name in names))
        )
    return tuple(tables)


def entry_table(columns: Sequence[tuple[Cell, Mapping[str, Any]]], corner: str) -> Table | None:
    """Entries {"value", "unit", "interval", "validity"} of several columns side by side, groups kept together.

    Nested mappings become parts of the table; plain numbers and texts are taken too. None without any entry.
    """
    flat = [dict(_leaves(entries)) for _, entries in columns]
    paths = sorted(dict.fromkeys(path for entries in flat for path in entries), key=lambda path: len(path) > 1)
    rows: list[Row] = []
    group: tuple[str, ...] = ()
    for path in paths:
        if path[:-1] != group:
            group = path[:-1]
            rows.append(Row(" · ".join(part.replace("_", " ") for part in group), heading=True))
        rows.append(_entry_row(path[-1], [entries.get(path) for entries in flat]))
    return Table(corner, tuple(head for head, _ in columns), tuple(rows)) if rows else None


def sensitivity_table(sensitivity: Mapping[str, Mapping[str, Any]]) -> Table:
    """What an error of 1 % in a rig quantity (rows) would do to each parameter (columns)."""
    names = list(dict.fromkeys(name for shifts in sensitivity.values() for name in shifts))
    rows = tuple(
        Row(f"{quantity_name.replace('_', ' ')} + 1 %", tuple(_shift_cell(shifts.get(name)) for name in names))
        for quantity_name, shifts in sensitivity.items()
    )
    return Table("", tuple(Cell(plain_symbol(name)) for name in names), rows)


def _told(value: Any) -> bool:
    return value is not None and value != "" and value == value


def _classical_row(key: str, values: Sequence[Any]) -> Row:
    name, unit = split_key(key)
    numbers = [abs(shown) for value in values if (shown := finite(value)) is not None]
    scale = scale_for(sorted(numbers)[len(numbers) // 2] if numbers else None, unit)
    cells = tuple(
        Cell(number(shown / scale.factor)) if (shown := finite(value)) is not None else Cell(_text(value))
        for value in values
    )
    return Row(name, cells, note=scale.unit)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value) if _told(value) else DASH


def _leaves(
    entries: Mapping[str, Any], above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    for key, entry in entries.items():
        if isinstance(entry, Mapping) and "value" not in entry:
            yield from _leaves(entry, (*above, str(key)))
        elif isinstance(entry, Mapping):
            yield (*above, str(key)), entry
        elif not isinstance(entry, list):
            yield (*above, str(key)), {"value": entry, "unit": split_key(str(key))[1]}


def _entry_row(key: str, entries: Sequence[Mapping[str, Any] | None]) -> Row:
    """A row; what all its entries say of their validity stands once, beside the head."""
    known = [entry for entry in entries if entry is not None]
    label = next((str(entry["label"]) for entry in known if entry.get("label")), split_key(key)[0])
    notes = [next((str(entry["meaning"]) for entry in known if entry.get("meaning")), "")]
    said = {str(entry.get("validity") or "") for entry in known}
    shared = said.pop() if len(said) == 1 and len(known) > 1 else ""
    cells = tuple(_entry_cell(entry, shared) for entry in entries)
    return Row(label, cells, note=" · ".join(note for note in (*notes, shared) if note))


def _entry_cell(entry: Mapping[str, Any] | None, shared: str) -> Cell:
    """One entry as a cell: value with unit, below it the interval and how far it may be trusted."""
    if entry is None:
        return Cell(DASH)
    value, unit = entry.get("value"), str(entry.get("unit") or "")
    shown, validity = finite(value), str(entry.get("validity") or "")
    notes = [interval_text(entry.get("interval"), shown, unit) if shown is not None else ""]
    notes += ["" if validity == shared else validity, str(entry.get("reason") or "")]
    kind = "doubt" if "not valid" in validity.lower() else ""
    text = quantity(shown, unit) if shown is not None else _text(value)
    return Cell(text, " · ".join(note for note in notes if note), kind)


def interval_text(interval: Any, value: float | None, unit: str) -> str:
    """ "0.618 to 0.622" in the unit in which the value is shown; open ends as "above" and "below"; "" for none."""
    if not isinstance(interval, Sequence) or isinstance(interval, str) or len(interval) != 2:
        return ""
    low, high = finite(interval[0]), finite(interval[1])
    scale = scale_for(value if value is not None else low if low is not None else high, unit)
    if low is not None and high is not None:
        width = (high - low) / scale.factor / 4
        digits = _digits(max(abs(low), abs(high)) / scale.factor, width)
        return f"{number(low / scale.factor, digits)} to {number(high / scale.factor, digits)}"
    if low is not None:
        return f"above {number(low / scale.factor, 3)}"
    return f"below {number(high / scale.factor, 3)}" if high is not None else ""


def _digits(size: float, error: float) -> int:
    """Significant digits at which two digits of the error are still seen: 3 to 7."""
    if size <= 0 or error <= 0:
        return 4
    return min(max(math.floor(math.log10(size)) - math.floor(math.log10(error)) + 2, 3), 7)


def _shift_cell(entry: Mapping[str, Any] | None) -> Cell:
    if entry is None or (shift := finite(entry.get("shift"))) is None:
        return Cell(DASH)
    text = quantity(shift, str(entry.get("unit") or ""), 2)
    errors = finite(entry.get("in_standard_errors"))
    if errors is None:
        return Cell(text if shift < 0 else f"+{text}")
    return Cell(text if shift < 0 else f"+{text}", f"{number(abs(errors), 2)} SE", "strong" if abs(errors) >= 1 else "")
