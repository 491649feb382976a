"""What CETR UMT and Bruker TriboLab exports share: runs and steps, each step with parameters, header and clock."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from data_io.clock import read_date
from data_io.contents import Contents, Part
from data_io.source import Request, Source
from data_io.table import read_tables
from data_io.text import looks_like_text
from data_io.values import Finding, FloatArray, free_name

_STEP = re.compile(r"[ \t]*Step\s*+(?:No\.?|#)\s*+(?:[:=-]\s*+)?(\d{1,9})[ \t,;]*$", re.IGNORECASE)
_RUN = re.compile(r"[ \t]*Run\s*+(?:No\.?|#)\s*+(?:[:=-]\s*+)?(\d{1,9})[ \t,;]*$", re.IGNORECASE)
_BREAK = re.compile(f"(?:{_STEP.pattern})|(?:{_RUN.pattern})", re.IGNORECASE | re.MULTILINE)
# in the bytes a line may end in CR LF, LF or CR
_SIGN = re.compile(
    rb"(?:^|[\r\n])[ \t]*Step\s*+No\.?\s*+(?:[:=-]\s*+)?\d{1,9}[ \t,;]*(?:[\r\n]|$)|^\W{0,4}Created by CETR",
    re.IGNORECASE,
)
_CETR = re.compile(rb"Created by CETR", re.IGNORECASE)
_BRUKER = re.compile(rb"bruker|tribolab", re.IGNORECASE)
_ITEM = re.compile(r"(.+?)\s*(?:=|:(?=\s|$)|\s-(?=\s))\s*(.*)")
_FOLDER = re.compile(r"[A-Za-z]:\\")
_LONGEST_ITEM: Final = 1000
_MOST_ITEMS: Final = 300  # lines above a table that are kept; a step has some ten
_ODD: Final = bytes(code for code in range(32) if code not in b"\t\n\r")
_PHRASE = re.compile(r"(Script file|Run date|Created by)\s+(.*)", re.IGNORECASE)


def _has_steps(head: bytes) -> bool:
    """Tell whether a text holds a `Step No.` line; odd bytes may stand in its preamble."""
    plain = head.replace(b"\x00", b"")
    return looks_like_text(plain.translate(None, _ODD)) and _SIGN.search(plain) is not None


def is_cetr(head: bytes) -> bool:
    """Tell a CETR text by its `Step No.` line or its first line."""
    return _has_steps(head) or _CETR.match(head.lstrip(b"\xef\xbb\xbf \t\r\n")) is not None


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
            new_run, new_step = _RUN.match(line), _STEP.match(line)
            if named and (new_run or new_step):  # the step named before has no rows
                steps.append((run, number, parameters, {}))
                named = False
            if new_run:
                run = int(new_run[1])
                target = runs.setdefault(run, {})
            elif new_step:
                number, parameters, named = int(new_step[1]), {}, True
                target = parameters
            elif len(target) < _MOST_ITEMS:
                line = " ".join("".join(c for c in line[:_LONGEST_ITEM] if c.isprintable()).split())
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
    if empty := [line for line in footer if _STEP.match(line)]:
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
