"""LabVIEW measurement files (.lvm)."""

import math
import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from data_io.clock import read_date
from data_io.columns import with_unit
from data_io.even_clock import with_even_clock
from data_io.opened_table import Table
from data_io.part import Contents, Part
from data_io.source import Request, Source
from data_io.table import read_tables
from data_io.text import looks_like_text, to_number

NAME: Final = "labview-lvm"
_MARK: Final = b"LabVIEW Measurement"
_BREAK = re.compile(r"\*\*\*End_of_Header\*\*\*|Channels\b")


_TAG = re.compile(r"(?:[XY]_Dimension|[XY]_Unit_Label|X0|Delta_X|Samples|Channels|Date|Test_\w*|Time[\t,]+\d)")


def can_read(head: bytes) -> bool:
    """Tell an .lvm by its first words."""
    return looks_like_text(head) and head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(_MARK)


def read(source: Source, request: Request) -> Contents:
    """Read a LabVIEW measurement file, versions 1 and 2 of the writer. Raises `LogError`.

    Layout: `key TAB value` lines, `***End_of_Header***`, per segment `Channels`, `Date`, `Time`, `X0`, `Delta_X`,
    again `***End_of_Header***`, names that begin with X_Value, rows. Each segment is a step.
    Quirks: the clock is the column X_Value, or with `X_Columns No` an empty first field and X0 + Delta_X * row;
    `Decimal_Separator` may be a comma; units stand as suffix of the name (fx_N); a last column Comment, mostly empty.
    """
    tables, _ = read_tables(source, request, breaks=_BREAK, never=_TAG)
    items = _items(tables[0].preamble)
    parts = [_part(table, {**items, **_items(table.preamble)}, i) for i, table in enumerate(tables, start=1)]
    metadata = {key: values[0] for key, values in items.items() if values and values[0]}
    return Contents(NAME, parts, metadata, [remark for table in tables for remark in table.remarks])


def _part(table: Table, items: dict[str, list[str]], number: int) -> Part:
    index = table.header.roles.get("time")
    column = None if index is None else table.columns.get(index)
    if column is None or not np.isfinite(column).any():
        interval = _first(items.get("Delta_X", ()))
        if math.isfinite(interval) and interval > 0:
            start = _first(items.get("X0", ()))
            table = with_even_clock(table, start if math.isfinite(start) else 0.0, interval, "X_Value")
    header = table.header
    index = header.roles.get("time")
    dimension = (items.get("X_Dimension") or ["Time"])[0]
    if index is not None and not header.names[index].unit and dimension == "Time":
        header = with_unit(header, index, "s")
    started = read_date(f"{(items.get('Time') or [''])[0]} {(items.get('Date') or [''])[0]}")
    return Part(1, number, header, table.columns, started=started)


def _items(lines: Sequence[str]) -> dict[str, list[str]]:
    """Return what `key TAB value TAB value` lines say; a comma may stand for the tab."""
    split = (re.split(r"[\t,]", line) if "\t" not in line else line.split("\t") for line in lines)
    return {fields[0].strip(): [field.strip() for field in fields[1:]] for fields in split if fields[0].strip()}


def _first(fields: Sequence[str]) -> float:
    numbers = (to_number(field, "," if "," in field else ".") for field in fields if field)
    return next((number for number in numbers if number is not None), math.nan)
