"""Plain delimited text: a header row, units in the names or in a row below, numbers; a repeated header is a step."""

from typing import Final

from data_io.part import Contents, Part
from data_io.source import Request, Source
from data_io.table import read_tables
from data_io.text import looks_like_text

NAME: Final = "delimited"


def can_read(head: bytes) -> bool:
    """Tell whether the bytes are text of any encoding that `decode` knows."""
    return looks_like_text(head)


def read(source: Source, request: Request) -> Contents:
    """Read delimited text: comma, semicolon, tab or blanks; each header row with its rows is one step.

    Raises `LogError`.
    """
    tables, footer = read_tables(source, request)
    filled = [table for table in tables if table.rows] or tables
    findings = [remark for table in filled for remark in table.remarks]
    metadata = {}
    if filled[0].preamble:
        metadata["preamble"] = "\n".join(filled[0].preamble)
    if footer:
        metadata["footer"] = "\n".join(footer)
    parts = [
        Part(
            1, i + 1, table.header, table.columns, {"above": "; ".join(table.preamble)} if i and table.preamble else {}
        )
        for i, table in enumerate(filled)
    ]
    return Contents(NAME, parts, metadata, findings)
