"""Tables of numbers inside a text: header rows, the blocks below them, and the text that stands between."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from data_io.columns import EXAMPLES, Header, parse_name, shown, words
from data_io.frozen import FloatArray
from data_io.layout import COMMENT, Head, head_at, is_row, line_at, lines_from, numbered_head
from data_io.rows import read_numbers
from data_io.source import Request, Source
from data_io.text import DELIMITERS, TEXT_LINE, line_number, split

MOST_TABLES: Final = 5000
"""Steps of the longest test; a text with more headers is no log, and would take minutes to refuse otherwise."""


@dataclass(frozen=True)
class Table:
    """One block of numbers: header, columns by index (n,), the text above it, the line of its first row, remarks."""

    header: Header
    columns: Mapping[int, FloatArray]
    preamble: tuple[str, ...]
    first_line: int
    remarks: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        """Number of rows."""
        return min((column.size for column in self.columns.values()), default=0)


@dataclass
class _Walk:
    """State while walking the text lines of a file; lives only inside `read_tables`."""

    source: Source
    text: str
    request: Request
    breaks: re.Pattern[str] | None
    marks: list[int]
    tables: list[Table] = field(default_factory=list)
    above: int = 0


def read_tables(
    source: Source, text: str, request: Request, breaks: re.Pattern[str] | None = None
) -> tuple[list[Table], tuple[str, ...]]:
    """Return every table of a text, and the lines that follow the last one.

    A table is a header row with a role, perhaps a units row, then rows of numbers. Text between rows ends a table where
    it matches `breaks` or a header follows; other text between rows is left out with a remark. Raises `LogError`
    where there is no table.
    """
    marks = [match.start() for match in TEXT_LINE.finditer("\n" + text)]
    walk = _Walk(source, text, request, breaks, marks)
    i = 0
    while i < len(marks):
        head = head_at(source, text, marks[i], request)
        i = i + 1 if head is None else _read_one(walk, head, i)
        if len(walk.tables) > MOST_TABLES:
            raise source.error(
                f"more than {MOST_TABLES} header rows were found; one per step was expected; drop repeated ones"
            )
    if not walk.tables:
        head = numbered_head(text, request.columns)
        if head is None:
            raise source.error(_why_no_table(text, request))
        _read_one(walk, head, -1)
    return walk.tables, _lines(text[walk.above :])


def _read_one(walk: _Walk, head: Head, i: int) -> int:
    """Read the table whose header is mark `i`; return the mark at which to go on."""
    text, marks = walk.text, walk.marks
    preamble = _lines(text[walk.above : marks[i] if i >= 0 else 0])
    if head.width == 0:
        walk.above = head.start
        walk.tables.append(Table(head.header, {}, preamble, line_number(text, head.start)))
        return i + 1
    pieces: list[str] = []
    remarks: list[str] = []
    begin, i, ended = head.start, i + 1, False
    while i < len(marks) and marks[i] < begin:
        i += 1
    while not ended:
        begin_text, i = _next_interruption(walk, head, i)
        pieces.append(text[begin:begin_text])
        resume = _resume(walk, head, i)
        ended = resume is None
        if resume is not None:
            begin, i = resume
            if skipped := _lines(COMMENT.sub("", text[begin_text:begin])):
                remarks.append(f"text between the rows was left out: {skipped[0]!r:.60}")
    walk.above = begin_text
    first_line = line_number(text, head.start)
    numbers = read_numbers(walk.source, "".join(pieces), first_line, head, at_end=begin_text >= len(text))
    walk.tables.append(Table(head.header, numbers.columns, preamble, first_line, (*remarks, *numbers.remarks)))
    return i


def _next_interruption(walk: _Walk, head: Head, i: int) -> tuple[int, int]:
    """Return position and mark of the next text line that is no row with a word in it."""
    while i < len(walk.marks):
        fields = split(line_at(walk.text, walk.marks[i])[0], head.delimiter)
        if len(fields) != head.width or not is_row(fields):
            return walk.marks[i], i
        i += 1
    return len(walk.text), i


def _resume(walk: _Walk, head: Head, i: int) -> tuple[int, int] | None:
    """Return where the rows of the same table go on behind text, and the next mark; None if the table ended."""
    while i < len(walk.marks):
        line, after = line_at(walk.text, walk.marks[i])
        if walk.breaks is not None and walk.breaks.match(line):
            return None
        if head_at(walk.source, walk.text, walk.marks[i], walk.request) is not None:
            return None
        i += 1
        limit = walk.marks[i] if i < len(walk.marks) else len(walk.text)
        position, row = next(lines_from(walk.text, after), (limit, ""))
        if position < limit:
            fields = split(row, head.delimiter)
            return (position, i) if len(fields) == head.width and is_row(fields) else None
    return None


def _lines(text: str) -> tuple[str, ...]:
    return tuple(line.strip() for line in text.split("\n") if line.strip())


def _why_no_table(text: str, request: Request) -> str:
    """Say what is missing: rows of numbers, a header row, or the columns the user named."""
    above: list[str] = []
    for _, line in lines_from(text, 0):
        width = max((len(split(line, d)) for d in DELIMITERS if is_row(split(line, d))), default=0)
        if width > 1:
            return _why_no_header(above, width, request)
        above = [*above[-4:], line]
    return "no rows of numbers were found; a header row with a time and a force, then numbers, were expected; check it"


def _why_no_header(above: list[str], width: int, request: Request) -> str:
    for line in above:
        for delimiter in DELIMITERS:
            fields = split(COMMENT.sub("", line, count=1), delimiter)
            if len(fields) == width:
                there = shown((parse_name(name).name for name in fields), most=12)
                if request.columns:
                    asked = ", ".join(f"{name!r}" for name in request.columns.values())
                    return f"the columns {there} were found, none of {asked}; give the names as the file has them"
                return (
                    f"no time column and no force column were recognised among {there}; names such as "
                    f"{EXAMPLES['time']} and {EXAMPLES['friction_force']} were expected; say which is which with "
                    "--columns time=...,friction_force=..."
                )
    return (
        f"rows of {width} numbers were found, but no header row that names them; a {words('time')} and a force column "
        "were expected; number them with --columns time=1,friction_force=2 and give --units"
    )
