"""CSV files: the classical table of all logs, and the data behind a figure."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from numpy.typing import NDArray

from identify.report.document import plain

Columns = Mapping[str, NDArray[Any]]  # columns of equal length by name
Row = Mapping[str, Any]


def classical_rows(logs: Sequence[Mapping[str, Any]]) -> list[tuple[int, Row]]:
    """The rows of every log's classical table, each with the number of its log (from 1)."""
    return [
        (position, row)
        for position, log in enumerate(logs, start=1)
        for row in (log.get("classical") or {}).get("rows", ())
    ]


def column_names(rows: Sequence[tuple[int, Row]]) -> list[str]:
    """All columns that occur, in the order in which they first occur."""
    return list(dict.fromkeys(str(name) for _, row in rows for name in row))


def classical_csv(logs: Sequence[Mapping[str, Any]]) -> str:
    """The classical table of all logs (SI, units in the column names); an empty cell where a value is missing."""
    rows = classical_rows(logs)
    columns = column_names(rows)
    body = ([number, logs[number - 1].get("path", ""), *(row.get(name) for name in columns)] for number, row in rows)
    return _text(["log", "path", *columns], body)


def figure_csv(columns: Columns) -> str:
    """Columns of equal length as CSV, numbers so that they read back exactly; NaN is an empty cell."""
    return _text(list(columns), zip(*(values.tolist() for values in columns.values()), strict=True))


def _text(header: Sequence[str], body: Iterator[Sequence[Any]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([["" if cell is None else cell for cell in plain(list(row))] for row in body])
    return out.getvalue()
