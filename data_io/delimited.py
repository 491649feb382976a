"""Delimited text of any origin, and of Anton Paar and Rtec: a header row, units, rows of numbers."""

import re
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from data_io.columns import Header, Name, coefficient_column, find_column, shown, with_unit
from data_io.contents import Contents, Part, with_column
from data_io.source import Request, Source
from data_io.table import Table, read_tables
from data_io.text import looks_like_text
from data_io.units import to_si
from data_io.values import Finding

_T11 = re.compile(r"(?:^|[^A-Za-z0-9])T-?11(?:[^0-9]|$)", re.IGNORECASE)


def read_delimited(source: Source, request: Request) -> Contents:
    """Read text of any origin: comma, semicolon, tab or blanks between columns. Raises `LogError`.

    Layout: lines of words, a header row that names a time and a force, units in brackets, as suffix or in a row below,
    rows; each further header row begins a step. Encodings: byte-order mark, UTF-8, UTF-16, single bytes of cp1252;
    line ends CR LF, LF, CR, also mixed; decimal comma where it does not delimit.
    Also seen: T11 (ITeR), semicolons, load and speed only in the file name (there a name with `T11` and `10N` gives the
    load, and says so); PCS MTM, many empty columns, names twice, a header per step.
    """
    tables, footer = read_tables(source, request)
    filled = [table for table in tables if table.rows] or tables
    with_force = [table for table in filled if _has_force(table.header)]
    findings = [remark for table in with_force or filled for remark in table.remarks]
    if others := [table for table in filled if with_force and not _has_force(table.header)]:
        names = shown((name.name for name in others[0].header.names), most=6)
        text = f"{len(others)} table(s) without a force, the first of {names}, were left out"
        findings.append(Finding("tables_without_force", "info", text))
        filled = with_force
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
    if request.normal_force is None and _T11.search(source.path.name):
        parts = [_loaded_by_name(source, part, findings) for part in parts]
    return Contents(parts, metadata, list(dict.fromkeys(findings)))


def _has_force(header: Header) -> bool:
    return bool({"normal_force", "friction_force"} & set(header.roles)) or coefficient_column(header) is not None


def _loaded_by_name(source: Source, part: Part, findings: list[Finding]) -> Part:
    """Give a step of a T11 without a load the one in its file name, as `T11_10N_0.1m-s.csv`."""
    load = load_in_name(source.path.name)
    if "normal_force" in part.header.roles or load is None:
        return part
    text = f"the normal force of {load:g} N was taken from the file name, as T11 exports have it: check it"
    findings.append(Finding("normal_force_from_name", "warning", text))
    return with_column(part, "normal_force", Name("file name", "file name", "N"), np.full(part.rows, load))


def load_in_name(name: str) -> float | None:
    """Return the force [N] that a file name states once, as `10N` or `2,5 mN`; None where it states none or several."""
    found = re.findall(r"(?<![\w.,])(\d+(?:[.,]\d+)?) ?([mk]?N)(?![A-Za-z])", name.replace("_", " "))
    if len(found) != 1:
        return None
    return to_si(float(found[0][0].replace(",", ".")), found[0][1], "force")


# Text export of Anton Paar (formerly CSM) tribometers: TRB3, Nano.

# µ is one byte in cp1252, two in UTF-8
_TIME = re.compile(rb"Time ?\[[a-z]+\][^\t\r\n]*+\t([^\r\n]*+)", re.IGNORECASE)
_OTHERS = re.compile(rb"Laps|Nominal Load|Penetration Depth|(?:\xb5|\xc2\xb5|\xce\xbc) ?(?:\t|\[)", re.IGNORECASE)


def is_anton_paar(head: bytes) -> bool:
    """Tell a TRB3 or Nano (software version not known: no file was seen) by a tab-separated header.

    It holds Time [s] and one of Laps, Nominal Load, µ, Penetration Depth, perhaps below lines of words.
    Quirks: UTF-8 with or without mark, or cp1252; decimal comma possible; tabs at the ends of rows; the TRB3 has no
    measured load, only the `Nominal Load [N]` that was set; the Nano writes forces in mN.
    """
    return looks_like_text(head) and any(_OTHERS.search(rest) for rest in _TIME.findall(head))


# CSV export of Rtec MFT.

_NAMES: Final = {b"step", b"timestamp"}
_STEP: Final = "Step"
_FEWEST: Final = 3


def is_rtec(head: bytes) -> bool:
    """Tell an Rtec export by its columns Step and Timestamp."""
    if b"imestamp" not in head or not looks_like_text(head):
        return False
    lines = (line for line in re.split(rb"[\r\n]+", head) if b"imestamp" in line)
    return any({name.strip().lower() for name in line.split(b",")} >= _NAMES for line in lines)


def read_rtec(source: Source, request: Request) -> Contents:
    """Read a CSV of an Rtec MFT-2000 or MFT-5000 (software version not known). Raises `LogError`.

    Layout: two lines with recipe and specimens, one header row, rows, a footer `TotalTime`; 10 Hz as seen. Each value
    of the column Step is a step of its own.
    Quirks: a lone CR inside the first line, CR LF and LF mixed; blanks in front of names; units in parentheses, `()`
    for none; a trailing comma; Timestamp [s] without a unit, restarting with each step; the order of columns changes
    between files of the same machine. The speed of the rotary drive is in rpm; Y is the radius of the track (see
    `derived_columns`).
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
    return Contents([replace(part, number=i) for i, part in enumerate(parts, start=1)], metadata, findings)


def _steps(table: Table) -> list[Part]:
    header = table.header
    time = header.roles.get("time")
    if time is not None and not header.names[time].unit:
        header = with_unit(header, time, "s")  # Timestamp counts seconds; the export does not say so
    index = find_column(header.names, _STEP)
    label = table.columns.get(-1 if index is None else index)
    if label is None or not table.rows:
        return [Part(1, 1, header, table.columns)]
    edges = [0, *(np.flatnonzero(label[1:] != label[:-1]) + 1).tolist(), table.rows]
    return [
        Part(1, 1, header, {i: column[a:b] for i, column in table.columns.items()}, {_STEP: f"{label[a]:g}"})
        for a, b in pairwise(edges)
    ]
