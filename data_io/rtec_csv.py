"""CSV export of Rtec MFT."""

import re
from itertools import pairwise
from typing import Final

import numpy as np

from data_io.columns import Header, find_column, with_unit
from data_io.frozen import Finding
from data_io.opened_table import Table
from data_io.part import Contents, Part
from data_io.source import Request, Source
from data_io.table import read_tables
from data_io.text import looks_like_text

NAME: Final = "rtec-csv"
_NAMES: Final = {b"step", b"timestamp"}
_STEP: Final = "Step"
_FEWEST: Final = 3


def can_read(head: bytes) -> bool:
    """Tell an Rtec export by its columns Step and Timestamp."""
    if b"imestamp" not in head or not looks_like_text(head):
        return False
    lines = (line for line in re.split(rb"[\r\n]+", head) if b"imestamp" in line)
    return any({name.strip().lower() for name in line.split(b",")} >= _NAMES for line in lines)


def read(source: Source, request: Request) -> Contents:
    """Read a CSV of an Rtec MFT-2000 or MFT-5000 (software version not known). Raises `LogError`.

    Layout: two lines with recipe and specimens, one header row, rows, a footer `TotalTime`; 10 Hz as seen. Each value
    of the column Step is a step of its own.
    Quirks: a lone CR inside the first line, CR LF and LF mixed; blanks in front of names; units in parentheses, `()`
    for none; a trailing comma; Timestamp [s] without a unit, restarting with each step; the order of columns changes
    between files of the same machine. The speed of the rotary drive is in rpm; Y is the radius of the track (see
    `rotation`).
    """
    tables, footer = read_tables(source, request, keep=(_STEP, "RecipeStep"))
    parts = [part for table in tables for part in _steps(table)]
    above = [line for line in tables[0].preamble if line]
    metadata = {"recipe": " | ".join(above)} if above else {}
    if footer:
        metadata["footer"] = " ".join(footer)
    findings = [remark for table in tables for remark in table.remarks]
    if any(part.rows < _FEWEST for part in parts):
        text = f"the column Step holds steps of fewer than {_FEWEST} rows; are rows out of order?"
        findings.append(Finding("short_steps", "warning", text))
    counted = [_numbered(part, number) for number, part in enumerate(parts, start=1)]
    return Contents(NAME, counted, metadata, findings)


def _steps(table: Table) -> list[Part]:
    header = _with_seconds(table)
    index = find_column(header.names, _STEP)
    label = table.columns.get(-1 if index is None else index)
    if label is None or not table.rows:
        return [Part(1, 1, header, table.columns)]
    edges = [0, *(np.flatnonzero(label[1:] != label[:-1]) + 1).tolist(), table.rows]
    return [
        Part(1, 1, header, {i: column[a:b] for i, column in table.columns.items()}, {_STEP: f"{label[a]:g}"})
        for a, b in pairwise(edges)
    ]


def _numbered(part: Part, number: int) -> Part:
    return Part(1, number, part.header, part.columns, part.parameters)


def _with_seconds(table: Table) -> Header:
    """Timestamp counts seconds; the export does not say so."""
    index = table.header.roles.get("time")
    if index is None or table.header.names[index].unit:
        return table.header
    return with_unit(table.header, index, "s")
