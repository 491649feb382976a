"""LabVIEW measurement files (.lvm)."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from data_io.clock import read_date, seconds_apart
from data_io.columns import with_unit
from data_io.even_clock import with_clocks_of_channels, with_even_clock
from data_io.opened_table import Table
from data_io.part import Contents, Part
from data_io.source import Request, Source
from data_io.table import read_tables
from data_io.text import looks_like_text, to_number

NAME: Final = "labview-lvm"
_MARK: Final = b"LabVIEW Measurement"
_BREAK = re.compile(r"\*\*\*End_of_Header\*\*\*|Channels\b")


_TAG = re.compile(
    r"(?:LabVIEW Measurement|[XY]_Dimension|[XY]_Unit_Label|X0|Delta_X|Samples|Channels|Date|Test_\w*|Time[\t,]+\d)"
)


def can_read(head: bytes) -> bool:
    """Tell an .lvm by its first words."""
    return looks_like_text(head) and head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(_MARK)


def read(source: Source, request: Request) -> Contents:
    """Read a LabVIEW measurement file, versions 1 and 2 of the writer. Raises `LogError`.

    Layout: `key TAB value` lines, `***End_of_Header***`, per segment `Channels`, `Date`, `Time`, `X0`, `Delta_X`,
    again `***End_of_Header***`, names that begin with X_Value, rows. Each segment is a step.
    Quirks: the clock is the column X_Value, or with `X_Columns No` an empty first field and X0 + Delta_X * row; each
    channel has an X0, a Delta_X and a time of its start, and where they differ a clock of its own; `Decimal_Separator`
    may be a comma; units stand as suffix of the name (fx_N); a last column Comment, mostly empty.
    """
    tables, _ = read_tables(source, request, breaks=_BREAK, never=_TAG)
    items = _items(tables[0].preamble)
    parts = [_part(table, {**items, **_items(table.preamble)}, i) for i, table in enumerate(tables, start=1)]
    metadata = {key: values[0] for key, values in items.items() if values and values[0]}
    return Contents(NAME, parts, metadata, [remark for table in tables for remark in table.remarks])


def _part(table: Table, items: dict[str, list[str]], number: int) -> Part:
    started = read_date(f"{(items.get('Time') or [''])[0]} {(items.get('Date') or [''])[0]}")
    starts, intervals = _starts(items), _numbers(items.get("Delta_X", ()))
    clocks: dict[int, int] = {}
    several = max(len(set(starts)), len(set(intervals)), len(set(_numbers(items.get("X0", ()))))) > 1
    if several and (items.get("X_Columns") or ["One"])[0] == "Multi":
        table = _started_apart(table, starts)
    elif several:
        table, clocks = _clocks_of_channels(table, items, starts, intervals)
    index = table.header.roles.get("time")
    column = None if index is None else table.columns.get(index)
    if (column is None or not np.isfinite(column).any()) and intervals and intervals[0] > 0:
        table = with_even_clock(table, _first(items.get("X0", ()), 0.0), intervals[0], "X_Value")
    header = table.header
    dimension = (items.get("X_Dimension") or ["Time"])[0]
    for index in (header.roles.get("time"), *header.passed_over.get("time", ())):
        if index is not None and not header.names[index].unit and dimension == "Time":
            header = with_unit(header, index, "s")
    return Part(1, number, header, table.columns, started=started, clocks=clocks)


def _starts(items: dict[str, list[str]]) -> list[float]:
    """When each channel was started [s], from the first one on; nothing where X counts from a date of its own."""
    if (items.get("Time_Pref") or ["Relative"])[0] == "Absolute":
        return []
    told = zip((t for t in items.get("Time", ()) if t), (d for d in items.get("Date", ()) if d), strict=False)
    return seconds_apart([f"{time} {date}" for time, date in told])


def _started_apart(table: Table, starts: Sequence[float]) -> Table:
    """Return a table whose X_Value columns count from the start of the first channel, not each from its own."""
    clocks = [i for i, name in enumerate(table.header.names) if name.key == "xvalue"]
    moved = {i: table.columns[i] + start for i, start in zip(clocks, starts, strict=False) if i in table.columns}
    return replace(table, columns={**table.columns, **moved})


def _clocks_of_channels(
    table: Table, items: dict[str, list[str]], starts: Sequence[float], intervals: Sequence[float]
) -> tuple[Table, dict[int, int]]:
    """Return the table with a clock for every channel, made of what its head says, and which clock is whose."""
    names = table.header.names
    channels = {i: v for i, v in table.columns.items() if names[i].key not in ("xvalue", "comment")}
    begins = _numbers(items.get("X0", ())) or [0.0]
    begins = [begins[min(i, len(begins) - 1)] + (starts[min(i, len(starts) - 1)] if starts else 0.0)
              for i in range(len(channels))]  # fmt: skip
    header, columns, clocks = with_clocks_of_channels(table.header, channels, begins, intervals)
    return replace(table, header=header, columns=columns), clocks


def _items(lines: Sequence[str]) -> dict[str, list[str]]:
    """Return what `key TAB value TAB value` lines say; a comma may stand for the tab."""
    split = (re.split(r"[\t,]", line) if "\t" not in line else line.split("\t") for line in lines)
    return {fields[0].strip(): [field.strip() for field in fields[1:]] for fields in split if fields[0].strip()}


def _numbers(fields: Sequence[str]) -> list[float]:
    found = (to_number(field, "," if "," in field else ".") for field in fields if field)
    return [number for number in found if number is not None and math.isfinite(number)]


def _first(fields: Sequence[str], otherwise: float) -> float:
    return next(iter(_numbers(fields)), otherwise)
