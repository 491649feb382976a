"""Plain delimited text: a header row, units in the names or in a row below, numbers; a repeated header is a step."""

import re
from dataclasses import replace
from typing import Final

import numpy as np

from data_io.columns import Name
from data_io.frozen import Finding
from data_io.opened_table import Table
from data_io.part import Contents, Part
from data_io.source import Request, Source
from data_io.table import read_tables
from data_io.text import looks_like_text
from data_io.units import to_si

NAME: Final = "delimited"
_T11 = re.compile(r"(?:^|[^A-Za-z0-9])T-?11(?:[^0-9]|$)", re.IGNORECASE)


def can_read(head: bytes) -> bool:
    """Tell whether the bytes are text of any encoding that `decode` knows."""
    return looks_like_text(head)


def read(source: Source, request: Request) -> Contents:
    """Read text of any origin: comma, semicolon, tab or blanks between columns. Raises `LogError`.

    Layout: lines of words, a header row that names a time and a force, units in brackets, as suffix or in a row below,
    rows; each further header row begins a step. Encodings: byte-order mark, UTF-8, UTF-16, single bytes of cp1252;
    line ends CR LF, LF, CR, also mixed; decimal comma where it does not delimit.
    Also seen: T11 (ITeR), semicolons, load and speed only in the file name (there a name with `T11` and `10N` gives the
    load, and says so); PCS MTM, many empty columns, names twice, a header per step.
    """
    return read_plain(source, request, NAME)


def read_plain(source: Source, request: Request, form: str) -> Contents:
    """Read delimited text as the format called `form`. Raises `LogError`."""
    tables, footer = read_tables(source, request)
    filled = [table for table in tables if table.rows] or tables
    findings = [remark for table in filled for remark in table.remarks]
    metadata = {}
    if filled[0].preamble:
        metadata["preamble"] = "\n".join(filled[0].preamble)
    if footer:
        metadata["footer"] = "\n".join(footer)
    if request.normal_force is None and _T11.search(source.path.name):
        filled = [_loaded_by_name(source, table, findings) for table in filled]
    parts = [
        Part(
            1, i + 1, table.header, table.columns, {"above": "; ".join(table.preamble)} if i and table.preamble else {}
        )
        for i, table in enumerate(filled)
    ]
    return Contents(form, parts, metadata, list(dict.fromkeys(findings)))


def _loaded_by_name(source: Source, table: Table, findings: list[Finding]) -> Table:
    """Give a table of a T11 without a load the one in its file name, as `T11_10N_0.1m-s.csv`."""
    told = load_in_name(source.path.name)
    if "normal_force" in table.header.roles or told is None:
        return table
    index = len(table.header.names)
    name = Name("file name", "file name", "N")
    header = replace(
        table.header, names=(*table.header.names, name), roles={**table.header.roles, "normal_force": index}
    )
    text = f"the normal force of {told:g} N was taken from the file name, as T11 exports have it: check it"
    findings.append(Finding("normal_force_from_name", "warning", text))
    return replace(table, header=header, columns={**table.columns, index: np.full(table.rows, told)})


def load_in_name(name: str) -> float | None:
    """Return the force [N] that a file name states once, as `10N` or `2,5 mN`; None where it states none or several."""
    found = re.findall(r"(?<![\w.,])(\d+(?:[.,]\d+)?) ?([mk]?N)(?![A-Za-z])", name.replace("_", " "))
    if len(found) != 1:
        return None
    return to_si(float(found[0][0].replace(",", ".")), found[0][1], "force")
