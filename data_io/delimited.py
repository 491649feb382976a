"""Delimited text of any origin, of Rtec, CETR and Bruker, of a terminal that stamps its lines, and of our own."""

import re
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from data_io.clock import with_even_clock
from data_io.columns import Header, Name, coefficient_column, find_column, role_indices, shown, with_unit
from data_io.contents import Contents, Part
from data_io.layout import Head, is_row, line_at
from data_io.source import Request, Source
from data_io.table import read_below, read_tables
from data_io.text import BLANKS, DELIMITERS, as_utf8, is_clock_time, looks_like_text, read_date, split
from data_io.values import Finding, FloatArray, Step, free_name
from data_io.write import CSV_MARK, FORMAT_VERSION, read_account

_INTERVAL = re.compile(
    r"[ \t]*+\"?(?:sample |sampling )?interval(?: ?[(\[]s(?:ec)?[)\]])?\"?(?=[ \t,;:=])[ \t]*+[,;:=]?[ \t]*+"
    r"((?:[0-9]++(?:[.,][0-9]++)?|[.,][0-9]++)(?:[eE][+-]?[0-9]++)?)[ \t,;]*+$",
    re.IGNORECASE,
)


def read_delimited(source: Source, request: Request) -> Contents:
    """Read text of any origin: comma, semicolon, tab or blanks between columns. Raises `LogError`.

    Layout: lines of words, a header row that names a time and a force, units in brackets, as suffix or in a row below,
    rows; each further header row begins a step. Encodings: byte-order mark, UTF-8, UTF-16, single bytes of cp1252;
    line ends CR LF, LF, CR, also mixed; decimal comma where it does not delimit.
    Also seen: Anton Paar (formerly CSM) TRB3 and Nano, tabs, the TRB3 without a measured load, only the `Nominal Load
    [N]` that was set; T11 (ITeR), semicolons, the load in the file name only; PCS MTM, many empty columns, names twice,
    a header per step; National Instruments, a line `Interval,0.0005` [s] above the names and no time column.
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
    parts = []
    for number, table in enumerate(filled, start=1):
        about = {"above": "; ".join(table.preamble)} if number > 1 and table.preamble else {}
        part = Part(1, number, table.header, table.columns, about)
        stated = [match for line in (*filled[0].preamble, *table.preamble) if (match := _INTERVAL.match(line))]
        interval = float(stated[-1][1].replace(",", ".")) if stated else 0.0
        if "time" not in table.header.roles and interval > 0:
            part = with_even_clock(part, 0.0, interval, "Interval")
            text = f"the clock was made from the interval of {interval:g} s that the file states"
            findings.append(Finding("clock_from_interval", "info", text))
        parts.append(part)
    return Contents(parts, metadata, list(dict.fromkeys(findings)))


def _has_force(header: Header) -> bool:
    return bool({"normal_force", "friction_force"} & set(header.roles)) or coefficient_column(header) is not None


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
    parts = []
    for table in tables:
        header = table.header
        time = header.roles.get("time")
        if time is not None and not header.names[time].unit:
            header = with_unit(header, time, "s")  # Timestamp counts seconds; the export does not say so
        index = find_column(header.names, _STEP)
        label = table.columns.get(-1 if index is None else index)
        if label is None or not table.rows:
            parts.append(Part(1, 1, header, table.columns))
            continue
        edges = [0, *(np.flatnonzero(label[1:] != label[:-1]) + 1).tolist(), table.rows]
        for a, b in pairwise(edges):
            columns = {i: column[a:b] for i, column in table.columns.items()}
            parts.append(Part(1, 1, header, columns, {_STEP: f"{label[a]:g}"}))
    above = [line for line in tables[0].preamble if line]
    metadata = {"recipe": " | ".join(above)} if above else {}
    if footer:
        metadata["footer"] = " ".join(footer)
    findings = [remark for table in tables for remark in table.remarks]
    if any(part.rows < _FEWEST for part in parts):
        text = f"the column Step holds steps of fewer than {_FEWEST} rows; are rows out of order?"
        findings.append(Finding("short_steps", "warning", text))
    return Contents([replace(part, number=i) for i, part in enumerate(parts, start=1)], metadata, findings)


# Lines that a terminal has stamped with the time of their arrival: `14:03:22.117 -> 0.532,1.98`.

_LINE: Final = re.compile(r"(\[)?([\d:., T/-]{8,32}?)(?(1)\]| ?-?>) ?(?:-?> ?)?(.*)")
_STAMPED_LINE: Final = re.compile(rb"(?:^|[\r\n])\[?[\d:., T/-]{8,32}?(?:\]| ?-?>) ")


def is_stamped(head: bytes) -> bool:
    """Tell by lines that begin with a time of the day in square brackets or before an arrow."""
    marked = b"] " in head or b"> " in head
    if not marked or _STAMPED_LINE.search(head) is None or not looks_like_text(head):
        return False
    lines = [line for line in as_utf8(head).decode().split("\n")[:100] if line.strip()]
    stamped = sum(_parted(line) is not None for line in lines)
    return stamped >= max(5, 0.8 * len(lines))


def read_stamped(source: Source, request: Request) -> Contents:
    """Read what came over a serial line, as the monitors of Arduino, PlatformIO, minicom and tio save it. Raises
    `LogError`.

    Layout: `stamp -> words or numbers` or `[stamp] words or numbers` in every line; the stamp becomes the first column,
    called Time, and the rest is read as `read_delimited` reads it.
    Quirks: a greeting of the board above the names, or no names; a clock of the board beside the stamps is preferred to
    them, as it does not wait for the line.
    """
    lines = [(line, _parted(line)) for line in as_utf8(source.read()).decode().split("\n")]
    rests = (parted[1] for _, parted in lines if parted is not None)
    delimiter = next((d for rest in rests for d in DELIMITERS if len(f := split(rest, d)) > 1 and is_row(f)), ",")
    mark = " " if delimiter == BLANKS else delimiter
    text = []
    for line, parted in lines:  # the stamp is the first field, which below words is called Time
        stamp, rest = parted or ("", "")
        stamp = stamp.replace(",", ".").replace(" ", "T") if mark in ", " else stamp
        numbers = any(is_row(split(rest, other)) for other in DELIMITERS)
        text.append(line if parted is None else f"{stamp if numbers else 'Time'}{mark}{rest}" if rest else "")
    return read_delimited(source.of_text("\n".join(text)), request)


def _parted(line: str) -> tuple[str, str] | None:
    """Split a line into its stamp and the rest; None where it has no stamp."""
    match = _LINE.match(line)
    return (match[2], match[3].strip()) if match is not None and is_clock_time(match[2]) else None


# Texts of CETR UMT and Bruker TriboLab: runs and steps, each step with parameters, header and clock.

_STEP_LINE = re.compile(r"[ \t]*Step\s*+(?:No\.?|#)\s*+(?:[:=-]\s*+)?(\d{1,9})[ \t,;]*$", re.IGNORECASE)
_RUN_LINE = re.compile(r"[ \t]*Run\s*+(?:No\.?|#)\s*+(?:[:=-]\s*+)?(\d{1,9})[ \t,;]*$", re.IGNORECASE)
_BREAK = re.compile(f"(?:{_STEP_LINE.pattern})|(?:{_RUN_LINE.pattern})", re.IGNORECASE | re.MULTILINE)
# in the bytes a line may end in CR LF, LF or CR
_SIGN = re.compile(rb"(?:^|[\r\n])[ \t]*Step\s*+No\.?\s*+(?:[:=-]\s*+)?\d{1,9}[ \t,;]*(?:[\r\n]|$)", re.IGNORECASE)
_CETR = re.compile(rb"\W{0,4}Created by CETR", re.IGNORECASE)
_BRUKER = re.compile(rb"bruker|tribolab", re.IGNORECASE)
_ITEM = re.compile(r"(.+?)\s*(?:=|:(?=\s|$)|\s-(?=\s))\s*(.*)")
_FOLDER = re.compile(r"[A-Za-z]:\\")
_ODD: Final = bytes(code for code in range(32) if code not in b"\t\n\r")
_PHRASE = re.compile(r"(Script file|Run date|Created by)\s+(.*)", re.IGNORECASE)


def _has_steps(head: bytes) -> bool:
    """Tell whether a text holds a `Step No.` line; odd bytes may stand in its preamble."""
    plain = head.replace(b"\x00", b"")
    return b"step" in plain.lower() and _SIGN.search(plain) is not None and looks_like_text(plain.translate(None, _ODD))


def is_cetr(head: bytes) -> bool:
    """Tell a CETR text by its `Step No.` line or its first line."""
    return _has_steps(head) or _CETR.match(head.replace(b"\0", b"").lstrip(b"\xef\xbb\xbf \t\r\n")) is not None


def is_bruker(head: bytes) -> bool:
    """Tell a Bruker export by its `Step No.` line and the maker's or the machine's name above it."""
    return _has_steps(head) and _BRUKER.search(head[: head.find(b"Step")]) is not None


def read_steps(source: Source, request: Request) -> Contents:
    """Read a text of a CETR UMT-2 or UMT-3, or a CSV of a Bruker UMT or TriboLab. Raises `LogError`.

    Seen: UMT 1.136.257, CETR Data Viewer 2.19.106; of Bruker no file was seen.
    Layout: preamble; per run `Run # 1`, script, date; per step `Step No. 1`, `key = value` lines, `Started at`, names,
    units, rows. Commas, CR LF, mostly 50 Hz. Bruker: time first, forces in newtons, about 100 Hz.
    Quirks: three separators in the preamble (-, =, :) and two orders of dates (05/12/22 is month first); odd bytes;
    forces in gram-force, negative in compression; the unit of COF is empty or missing; T restarts with each step and
    its first interval is odd; columns differ in number and order between machines and steps; COF and Ff have lost the
    sign; with the linear drive every stroke may be a file of its own (give the folder or a pattern). `Velocity` has no
    unit and is kept as text only. A step whose rows are not as many as its Data Count is reported.
    """
    tables, footer = read_tables(source, request, breaks=_BREAK)
    parts: list[Part] = []
    findings: list[Finding] = []
    items: dict[str, str] = {}  # of the file; those of a run and of a step stand below their headers
    runs: dict[int, dict[str, str]] = {}
    run = 1
    for table in tables:
        number, named = len(parts) + 1, False
        parameters: dict[str, str] = {}
        target = runs.get(run, items)
        steps: list[tuple[int, int, dict[str, str], Mapping[int, FloatArray]]] = []
        for line in table.preamble:
            new_run, new_step = _RUN_LINE.match(line), _STEP_LINE.match(line)
            if named and (new_run or new_step):  # the step named before has no rows
                steps.append((run, number, parameters, {}))
                named = False
            if new_run:
                run = int(new_run[1])
                target = runs.setdefault(run, {})
            elif new_step:
                number, parameters, named = int(new_step[1]), {}, True
                target = parameters
            elif len(target) < 300:
                line = " ".join("".join(c for c in line[:1000] if c.isprintable()).split())
                match = _PHRASE.fullmatch(line) or (None if _FOLDER.match(line) else _ITEM.fullmatch(line))
                key, value = (match[1].strip(), match[2].strip()) if match else ("note", line)
                target[free_name(key, target)] = value
        steps.append((run, number, parameters, table.columns))
        findings += [replace(remark, message=f"step {number}: {remark.message}") for remark in table.remarks]
        for own_run, number, about, columns in steps:
            started = read_date(about.get("Started at", ""))
            part = Part(own_run, number, table.header, columns, about, started, runs.get(own_run, {}))
            parts.append(part)
            count = about.get("Data Count", "")
            if count.isdecimal() and int(count) != part.rows:
                text = f"step {number} says it has {count} rows (Data Count) and holds {part.rows}; was the file cut?"
                findings.append(Finding("data_count", "warning", text))
            if part.rows == 0:
                findings.append(Finding("empty_step", "info", f"step {number} holds no rows; it was left out"))
    if empty := [line for line in footer if _STEP_LINE.match(line)]:
        text = f"the log ends with {len(empty)} step header(s) without rows of numbers ({empty[0]})"
        findings.append(Finding("empty_step", "warning", text))
    labels = [(part.run, part.number) for part in parts]
    if len(set(labels)) < len(labels):  # a looping script repeats its step numbers within a run
        text = "the log repeats step numbers; the steps were numbered one after the other within each run"
        findings.append(Finding("steps_renumbered", "warning", text))
        counts: dict[int, int] = {}
        for i, part in enumerate(parts):
            counts[part.run] = counts.get(part.run, 0) + 1
            about = {**part.parameters, "Step No.": str(part.number)}
            parts[i] = replace(part, number=counts[part.run], parameters=about)
    return Contents(parts, items, findings)


# The own CSV of the project, as `write.write_csv` makes it: everything a record holds, bit for bit.


def read_ours(source: Source, request: Request) -> Contents:
    """Read the chosen step, or all of them. Raises `LogError`."""
    data = as_utf8(source.read())
    first, position = line_at(data, 0)
    version = first[len(CSV_MARK) :].strip()
    if version != str(FORMAT_VERSION):
        raise source.error(f"version {version!r} of our CSV was found; {FORMAT_VERSION} was expected; convert it again")
    line, position = line_at(data, position)
    try:
        account = read_account(line.removeprefix("#"))
    except ValueError as error:
        raise source.error(
            "line 2 does not hold the JSON account that a CSV of ours has there; "
            "restore it, or remove the first two lines to have it read as plain CSV"
        ) from error
    line, position = line_at(data, position)
    names = split(line, ",")
    line, position = line_at(data, position)
    units = split(line, ",")
    if len(units) != len(names) or len(names) < 2:
        raise source.error(
            f"line 4 holds {len(units)} units for {len(names)} columns; one for each was expected; "
            "repair it, or remove the first two lines to have it read as plain CSV"
        )
    columns = tuple(Name(name, name, unit) for name, unit in zip(names, units, strict=True))
    header = Header(columns, role_indices(columns, request.columns))
    table = read_below(source, request, data, Head(header, position, ",", len(names)))
    noted = account.steps and account.steps[-1].stop == table.rows  # else rows were added or taken away since
    steps = account.steps if noted else [Step(1, 1, 0, table.rows)]
    parts = [
        Part(s.run, s.number, header, {i: v[s.start : s.stop] for i, v in table.columns.items()}, s.parameters)
        for s in steps
    ]
    return Contents(parts, account.metadata, [*table.remarks, *account.findings], True, account.drive_speed)
