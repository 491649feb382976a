"""Excel workbooks (.xlsx)."""

import io
import math
import zipfile
from datetime import timedelta
from typing import Any, Final

import numpy as np

from data_io.contents import Contents, Part
from data_io.source import LEAST_SUSPECT, MOST_TIMES, Request, Source
from data_io.table import read_tables
from data_io.values import LogError

_ZIP: Final = b"PK\x03\x04"
_CELLS: Final = 1 << 22  # cells that are looked at in any workbook


def can_read(head: bytes) -> bool:
    """Tell a workbook by the zip archive it is and the names of its parts."""
    return head.startswith(_ZIP) and (b"[Content_Types].xml" in head or b"xl/" in head)


def read(source: Source, request: Request) -> Contents:
    """Read the sheets of a workbook, each with a table as a run of its own; sheets without a table are passed over.

    A sheet is read like delimited text: words, names, units in the names or in a row below, rows. Cells hold numbers
    as Excel stores them, whatever decimal mark it shows; numbers stored as text are read as text. Old .xls files are
    refused. Raises `LogError`.
    """
    parts: list[Part] = []
    findings = []
    failed: list[LogError] = []
    for number, (title, text) in enumerate(_sheets(source).items(), start=1):
        try:
            tables, _ = read_tables(source.of_text(text), request)
        except LogError as error:
            failed.append(error)
            continue
        findings += [remark for table in tables for remark in table.remarks]
        for table in tables:
            empty = [i for i in table.header.roles.values() if not np.isfinite(table.columns.get(i, np.empty(0))).any()]
            if empty and table.rows:
                _refuse_formulas(source, title, table.header.names[empty[0]].raw)
        parts += [
            Part(number, i, table.header, table.columns, {"sheet": title}) for i, table in enumerate(tables, start=1)
        ]
    if not parts:
        raise failed[0] if failed else source.error("the workbook holds no sheet with cells; a log was expected")
    return Contents(parts, {}, findings)


def _refuse_formulas(source: Source, title: str, name: str) -> None:
    """Say where a column is empty because its formulas were never computed. Raises the source's `LogError`."""
    import openpyxl

    book = openpyxl.load_workbook(io.BytesIO(source.read()), read_only=True, keep_links=False)
    rows = book[title].iter_rows(values_only=True, max_row=1000)
    if any(isinstance(cell, str) and cell.startswith("=") for row in rows for cell in row):
        raise source.error(
            f"column {name!r} of sheet {title!r} holds formulas whose results the workbook does not keep; numbers were "
            "expected; open it in a spreadsheet programme and save it, or export it as text"
        )


def _sheets(source: Source) -> dict[str, str]:
    """Return every sheet that holds anything as tab-separated text."""
    import openpyxl

    with source.read_by_library("workbook", "save it again, without a password"):
        data = source.read()
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            unpacked = sum(info.file_size for info in archive.infolist())
        if unpacked > min((1 << 30), max(LEAST_SUSPECT, MOST_TIMES * len(data))):
            raise source.error(
                f"the workbook unpacks to {unpacked / 1e6:.4g} MB, more than {MOST_TIMES} times its size or more than "
                "1 GiB; a log was expected; save it as text"
            )
        book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True, keep_links=False)
        most = max(_CELLS, unpacked)
        texts = {sheet.title: _as_text(source, sheet, most) for sheet in book.worksheets}
        book.close()
    return {title: text for title, text in texts.items() if text}


def _as_text(source: Source, sheet: Any, most: int) -> str:
    """Return a sheet as lines of equal width; most: cells that may be looked at, those between others as well."""
    sheet.reset_dimensions()  # what a sheet says of its size need not be so
    rows: list[tuple[object, ...]] = []
    cells = 0
    for number, row in enumerate(sheet.iter_rows(values_only=True), start=1):
        cells += len(row)
        if cells > most:
            raise source.error(
                f"cells of sheet {sheet.title!r} stand so far apart that more than {most} lie between them (row "
                f"{number}, column {len(row)}); a table was expected; delete what stands apart, or export it as text"
            )
        if any(cell is not None for cell in row):
            rows.append(row)
    widths = np.sort([len(row) for row in rows])
    fitting = widths * widths.size <= max(_CELLS, 4 * int(widths.sum()))
    width = int(widths[fitting][-1]) if fitting.any() else 0
    named, shown_so = set[int](), set[int]()  # columns called % whose cells are shown in percent hold a hundredth
    for row in sheet.iter_rows(max_row=50):
        for column, cell in enumerate(row):
            if isinstance(cell.value, str) and "%" in cell.value:
                named.add(column)
            elif isinstance(cell.value, float | int) and "%" in str(cell.number_format):
                shown_so.add(column)
    hundredfold = named & shown_so
    cell_rows = ([_cell(value, 100.0 if i in hundredfold else 1.0) for i, value in enumerate(row)] for row in rows)
    lines = ("\t".join([*row, *[""] * (width - len(row))]) for row in cell_rows)
    return "".join(line + "\n" for line in lines)


def _cell(value: object, scale: float) -> str:
    if value is None:
        return ""
    if scale != 1.0 and isinstance(value, float | int):
        value = scale * value
    if isinstance(value, timedelta):
        return repr(value.total_seconds())
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else "nan"
    return " ".join(str(value).replace('"', "''").split())
