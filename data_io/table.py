"""Tables of numbers inside a text: header rows, the blocks below them, and the text that stands between."""

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from data_io.columns import (
    EXAMPLES,
    Header,
    coefficient_column,
    distance_columns,
    find_column,
    milliseconds_column,
    parse_name,
    shown,
    with_unit,
)
from data_io.layout import (
    COMMENT,
    DIGIT,
    LOOKED_AT,
    Above,
    Head,
    Numbers,
    head_at,
    is_row,
    line_at,
    lines_from,
    numbered_head,
    read_block,
    read_numbers,
)
from data_io.source import Request, Source
from data_io.text import DELIMITERS, TEXT_LINE, Text, as_utf8, is_number_like, is_plain, is_words, over_midnight, split
from data_io.values import Finding, FloatArray

BLOCK: Final = 1 << 22
"""Bytes of rows with words among them that are taken at once, of numbers eight times as many."""
_FIRST: Final = 1 << 18
"""Characters of rows with words among them that are taken at once; four times as many each time these go on."""
LONGEST_LINE: Final = 1 << 20
_MOST_WORDS: Final = 1 << 20  # characters without a row of numbers after which no table is waited for any more
_MOST_TABLES: Final = 5000
"""Steps of the longest test; a text with more headers is no log, and would take minutes to refuse otherwise."""
_MOST_LOOKED_AT: Final = 20_000  # lines of words in a row in which a header is looked for; more would take seconds
_MOST_REMARKS: Final = 20
_OPEN_CELL: Final = re.compile(r'(?:^|[,;\t])\s*"[^"]*$')
"""A quoted cell that begins behind a delimiter and does not end in its line."""
_YEARS_2000_TO_2100: Final = (9.5e8, 4.1e9)  # seconds since 1970
_PARTS: Final = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}  # of a second


@dataclass(frozen=True)
class Table:
    """One block of numbers: header, columns by index (n,), the text above it, the line of its first row, remarks."""

    header: Header
    columns: Mapping[int, FloatArray]
    preamble: tuple[str, ...]
    first_line: int
    remarks: tuple[Finding, ...] = ()

    @property
    def rows(self) -> int:
        """Number of rows."""
        return min((column.size for column in self.columns.values()), default=0)


def read_tables(
    source: Source,
    request: Request,
    breaks: re.Pattern[str] | None = None,
    keep: Sequence[str] = (),
    never: re.Pattern[str] | None = None,
    block: int = BLOCK,
) -> tuple[list[Table], tuple[str, ...]]:
    """Return every table of a text, and the lines that follow the last one.

    A table is a header row with a role, perhaps a units row, then rows of numbers. Text between rows ends a table where
    it matches `breaks` or a header follows; other text between rows is left out with a remark. Where the request
    chooses channels, only these, the columns with a role and those called as in `keep` are read. A line that matches
    `never` is no header, whatever it names. block: bytes read at once. Raises `LogError` where there is no table.
    """
    data = source.text()
    plain = len(data) > _MOST_WORDS and is_plain(data[:_MOST_WORDS])
    walk = _Walk(source, request, _without_breaks(data if plain else _in_utf8(source, data)), block)
    walk.breaks, walk.never, walk.keep, walk.unseen = breaks, never, keep, plain
    return walk.tables()


def _in_utf8(source: Source, data: Text) -> Text:
    """Return a whole text in UTF-8. Raises `LogError` where long stretches of it were never written."""
    if is_plain(data):
        return data
    data = data[:]
    if b"\0" in data and bytes(1 << 18) in data.rstrip(b"\0"):
        raise source.error(
            "the file holds long stretches of zero bytes; lines of text were expected; copy or export it again"
        )
    return as_utf8(data)


def read_below(source: Source, request: Request, data: Text, head: Head) -> Table:
    """Return the table of a text whose head is known. Raises `LogError`."""
    return _Walk(source, request, data, BLOCK).tables(head)[0][0]


def wanted_columns(header: Header, request: Request, keep: Sequence[str] = ()) -> frozenset[int] | None:
    """Return which columns of a header are to be read: None for all, else those with a role and those asked for."""
    if request.channels is None:
        return None
    named = (find_column(header.names, name) for name in (*request.channels, *request.columns.values(), *keep))
    own = {*header.roles.values(), *header.passed_over.get("time", ()), milliseconds_column(header)}
    if "friction_force" not in header.roles:
        own.add(coefficient_column(header))
    if "time" not in header.roles:
        own |= {*(distance_columns(header) or ())}
    names = {header.names[index] for index in own if index is not None}
    twins = {index for index, name in enumerate(header.names) if name in names}
    return frozenset(twins | {index for index in named if index is not None})


@dataclass
class _OpenTable:
    """A table whose rows are still being read; wanted: the columns that are kept (None: all)."""

    head: Head
    preamble: tuple[str, ...]
    first_line: int
    wanted: frozenset[int] | None
    remarks: list[Finding] = field(default_factory=list)
    columns: dict[int, FloatArray] = field(default_factory=dict)
    rows: int = 0
    days: list[tuple[int, Mapping[int, FloatArray | None]]] = field(default_factory=list)
    above: Above = field(default_factory=Above)

    def add(self, numbers: Numbers, expected: int = 0) -> None:
        """Put rows below those that are there; expected: how many more may follow, for which there is room then.

        Columns in one piece of memory are filled faster than many pieces that are put together in the end.
        """
        self.remarks += numbers.remarks
        if numbers.rows:
            stop = self.rows + numbers.rows
            kept = {i: v for i, v in numbers.columns.items() if self.wanted is None or i in self.wanted}
            for index in {**self.columns, **kept}:
                column = self.columns.get(index)
                if column is None or column.size < stop:
                    room = np.empty(stop + max(expected, self.rows))
                    room[: self.rows] = np.nan if column is None else column[: self.rows]
                    self.columns[index] = column = room
                column[self.rows : stop] = kept.get(index, np.nan)
            self.days.append((numbers.rows, numbers.days))
            self.rows = stop
        self.above = Above(
            self.above.decimal or numbers.decimal,
            self.above.fields or numbers.fields,
            self.above.numeric | (set(numbers.columns) if numbers.rows else set()),
            units={**self.above.units, **numbers.units},
        )

    def close(self) -> Table:
        """Return the whole table; rows at its end that hold nothing, as spreadsheets leave them, are taken away."""
        header, end = self.head.header, self.rows
        columns = {index: self.columns[index][:end] for index in sorted(self.columns)}
        if not end:
            columns = {index: np.empty(0) for index in range(len(header.names))}
        if end and all(np.isnan(column[-1]) for column in columns.values()):
            full = np.flatnonzero(np.any([~np.isnan(column) for column in columns.values()], axis=0))
            end = int(full[-1]) + 1 if full.size else 0
            columns = {index: column[:end] for index, column in columns.items()}
        clocks = {index for _, days in self.days for index in days} & set(columns)
        for index in clocks:
            dated = [np.full(rows, np.nan) if (own := days.get(index)) is None else own for rows, days in self.days]
            columns[index] = over_midnight(columns[index], np.concatenate(dated)[:end])
        for index, units in self.above.units.items():
            if header.names[index].unit is None:
                header = with_unit(header, index, units[0])
        for index in clocks:  # times of the day are seconds; an elapsed time beside them is the clock
            header = with_unit(header, index, "s")
        taken, others = header.roles.get("time"), header.passed_over.get("time", ())
        elapsed = [i for i in others if i not in clocks and i in columns and np.isfinite(columns[i]).any()]
        if taken is not None and taken in clocks and elapsed:
            passed = {**header.passed_over, "time": tuple(i for i in (taken, *others) if i != elapsed[0])}
            header = replace(header, roles={**header.roles, "time": elapsed[0]}, passed_over=passed)
        header = _since_1970(header, columns)
        remarks = list(dict.fromkeys(self.remarks + _milliseconds_added(header, columns, clocks)))
        if len(remarks) > _MOST_REMARKS:
            text = f"and {len(remarks) - _MOST_REMARKS} remarks more of this kind"
            remarks = [*remarks[:_MOST_REMARKS], Finding("text_in_rows", "warning", text)]
        return Table(header, columns, self.preamble, self.first_line, tuple(remarks))


def _since_1970(header: Header, columns: Mapping[int, FloatArray]) -> Header:
    """Return a header in which a clock without a unit that counts from 1970 has the one that tells our days."""
    index = header.roles.get("time")
    if index is None or header.names[index].unit is not None or index not in columns:
        return header
    stamps = columns[index][np.isfinite(columns[index])]
    if stamps.size < 2:
        return header
    low, high = float(np.min(stamps)), float(np.max(stamps))
    apart = (high - low) / (stamps.size - 1)
    for unit, part in _PARTS.items():
        if _YEARS_2000_TO_2100[0] * part < low and high < _YEARS_2000_TO_2100[1] * part and apart < part:
            return with_unit(header, index, unit)
    return header


def _milliseconds_added(header: Header, columns: dict[int, FloatArray], clocks: Set[int]) -> list[Finding]:
    """Add a column of milliseconds to the clock of whole seconds that it goes on from, and say so."""
    time, part = header.roles.get("time"), milliseconds_column(header)
    if time is None or time not in clocks or part is None or part not in columns:
        return []
    seconds, beyond = columns[time], columns[part] / 1e3
    known = np.isfinite(seconds) & np.isfinite(beyond)
    whole = seconds + beyond
    if (seconds[known] % 1.0).any() or not np.all((beyond[known] >= 0.0) & (beyond[known] < 1.0)):
        return []
    if np.any(np.diff(whole[known]) < 0.0):
        return []
    columns[time] = whole
    text = f"the clock is column {header.names[time].name} and the milliseconds in column {header.names[part].name}"
    return [Finding("clock_with_milliseconds", "info", text)]


class _Walk:
    """A text in UTF-8 being read from front to back."""

    def __init__(self, source: Source, request: Request, data: Text, block: int) -> None:
        self.source, self.request, self.data, self.block = source, request, data, block
        self.breaks: re.Pattern[str] | None = None
        self.never: re.Pattern[str] | None = None
        self.keep: Sequence[str] = ()
        self.unseen = False  # whether something else than plain text may stand behind rows of numbers
        self._counted = (0, 1)

    def tables(self, known: Head | None = None) -> tuple[list[Table], tuple[str, ...]]:
        """Return the tables and the lines below the last one; known: the first head. Raises the source's `LogError`."""
        tables: list[Table] = []
        above = 0
        upcoming = (0, known) if known is not None else self._next_head(above, first=True)
        while upcoming is not None:
            place, head = upcoming
            if len(tables) >= _MOST_TABLES:
                raise self.source.error(
                    f"more than {_MOST_TABLES} header rows were found; one per step was expected; drop repeated ones"
                )
            preamble = self._lines(above, place)
            wanted = wanted_columns(head.header, self.request, self.keep)
            table = _OpenTable(head, preamble, self._line(head.start), wanted)
            if tables and (rows := [line for line in preamble if _is_lost_row(line)]):
                text = f"{len(rows)} line(s) of numbers above line {table.first_line} fit no header and were left out"
                table.remarks.append(Finding("rows_left_out", "warning", text))
            above = self._read(table, head.start) if head.width else head.start
            self._see(above)
            tables.append(table.close())
            upcoming = self._next_head(above, first=False)
        if not tables:
            raise self.source.error(_why_no_table(self.data, self.request))
        footer = self._lines(above, len(self.data))
        if rows := [line for line in footer if _is_lost_row(line)]:
            text = f"{len(rows)} line(s) of numbers below the last table were left out: {rows[0]!r:.60}"
            remarks = (*tables[-1].remarks, Finding("rows_left_out", "warning", text))
            tables[-1] = replace(tables[-1], remarks=remarks)
        return tables, footer

    def _see(self, reached: int) -> None:
        """Bring a text into UTF-8 where rows of numbers, and so plain text, end before it does."""
        if self.unseen and reached < len(self.data):
            self.data, self.unseen = _in_utf8(self.source, self.data), False

    def _next_head(self, position: int, *, first: bool) -> tuple[int, Head] | None:
        """Return where the words above the next table end, and its head; None where there is none."""
        data = self.data
        for count, place in enumerate(self._words(position, position + _MOST_WORDS if first else len(data))):
            if (head := self._head(place)) is not None:
                return place, head
            if count >= _MOST_LOOKED_AT:
                raise self.source.error(
                    f"more than {_MOST_LOOKED_AT} lines of words in a row were found where a header or rows of numbers "
                    "were expected; a log was expected; check the file"
                )
        for size in (1 << 17, _MOST_WORDS) if first else ():
            head = numbered_head(data[:size], self.request, goes_on=size < len(data))
            last = data[-(1 << 16) :].rstrip()[-LOOKED_AT:].rpartition(b"\n")[2].decode("utf-8", "replace")
            if head is not None and (size == _MOST_WORDS or len(split(last, head.delimiter)) == head.width):
                return head.start, head
        return None

    def _head(self, place: int) -> Head | None:
        if self.never is not None and self.never.match(line_at(self.data, place)[0]):
            return None
        return head_at(self.source, self.data, place, self.request)

    def _read(self, table: _OpenTable, begin: int) -> int:
        """Read the rows of a table from a position on; return where it ends."""
        size = _FIRST
        while begin < len(self.data):
            reached = self._read_numbers_only(table, begin)
            size = min(_FIRST, 4 * self.block) if reached > begin else min(4 * size, 4 * self.block)
            self._see(reached)
            if reached == len(self.data):
                return reached
            end = self.data.find(b"\n", reached + size) + 1 or len(self.data)
            if end - reached - size > LONGEST_LINE:
                raise self.source.error(
                    f"no line ends within a MiB below line {self._line(reached + size)}; lines of numbers were "
                    "expected; check the file"
                )
            stop, resume = self._read_among_words(table, reached, end)
            if resume is None:
                return stop
            begin = resume
        return begin

    def _read_numbers_only(self, table: _OpenTable, begin: int) -> int:
        """Read blocks of whole lines that hold nothing but numbers; return where others begin."""
        while begin < len(self.data):
            stop = begin + 8 * self.block
            numbers, end = read_block(self.data, begin, stop, table.head, table.above.decimal, table.wanted)
            if numbers is None:
                break
            expected = numbers.rows * (len(self.data) - end) // max(end - begin, 1) * 51 // 50 + 9
            begin = end
            table.add(numbers, expected)
            self.request.progress(begin / len(self.data))
        return begin

    def _read_among_words(self, table: _OpenTable, begin: int, end: int) -> tuple[int, int | None]:
        """Read rows up to about `end`; return where they end, and where those of this table go on (None: nowhere)."""
        head, pieces, position, data = table.head, list[bytes](), begin, self.data
        while True:
            stop = next((p for p in self._words(position, end) if not self._is_row_of(head, p)), end)
            pieces.append(data[position:stop])
            resume = end if stop == end else self._resume(head, stop)
            if stop == end or resume is None:
                break
            if skipped := self._lines(stop, resume, comments=False):
                text = f"text between the rows was left out: {skipped[0]!r:.60}"
                table.remarks.append(Finding("text_in_rows", "warning", text))
            position = resume
            if position >= end:
                break
        ending = data[max(begin - LOOKED_AT, 0) : begin].decode("utf-8", "replace") if stop >= len(data) else None
        above = replace(table.above, ending=ending)
        table.add(read_numbers(self.source, b"".join(pieces).decode(), self._line(begin), head, above))
        header = head.header
        for index, units in table.above.units.items():
            name = header.names[index]
            keys = {name.raw, name.name, *(role for role, place in header.roles.items() if place == index)}
            given = next((unit for key, unit in self.request.units.items() if key in keys), None)
            if given and len(units) > 1:
                raise self.source.error(
                    f"column {name.raw!r} holds {' and '.join(units)} by turns, and {given!r} was given for all of it; "
                    "each row is read in its own unit; leave the unit out that was given"
                )
        self.request.progress(stop / len(data))
        return stop, resume

    def _resume(self, head: Head, place: int) -> int | None:
        """Return where the rows of the same table go on behind words; None where it ended."""
        for line_start in itertools.islice(self._words(place, len(self.data)), _MOST_LOOKED_AT):
            line, after = line_at(self.data, line_start)
            if (self.breaks is not None and self.breaks.match(line)) or self._head(line_start) is not None:
                return None
            position, row = next(lines_from(self.data, after), (len(self.data), ""))
            if row and not is_words(row):
                return position if self._is_row_of(head, position) else None
        return None

    def _is_row_of(self, head: Head, position: int) -> bool:
        fields = split(line_at(self.data, position)[0], head.delimiter)
        return len(fields) == head.width and is_row(fields)

    def _words(self, position: int, end: int) -> Iterator[int]:
        """Yield where lines begin that are no plain rows of numbers."""
        if position == 0 and is_words(line_at(self.data, 0)[0]):
            yield 0
        yield from (match.end() for match in TEXT_LINE.finditer(self.data, max(position - 1, 0), end))

    def _line(self, position: int) -> int:
        known, line = self._counted
        line += self.data[known:position].count(b"\n") - self.data[position:known].count(b"\n")
        self._counted = (position, line)
        return line

    def _lines(self, start: int, stop: int, *, comments: bool = True) -> tuple[str, ...]:
        text = self.data[start:stop].decode("utf-8", "replace")
        lines = (text if comments else COMMENT.sub("", text)).split("\n")
        return tuple(line.strip() for line in lines if line.strip())


def _without_breaks(data: Text) -> Text:
    """Return a text in which the cells of the first header hold no line breaks; empty lines stand for these."""
    cut = data.rfind(b"\n", 0, 1 << 15)
    if b'"' not in data[: max(cut, 0)]:
        return data
    lines = data[:cut].decode("utf-8", "replace").split("\n")
    for i, line in enumerate(lines):
        rows = not is_words(line) or any(is_row(split(line, delimiter)) for delimiter in DELIMITERS)
        if line.strip() and rows:
            break
        if line.startswith("#"):  # a comment has no cells
            continue
        below = lines[i + 1 : i + 1 + 12]
        for beyond, more in enumerate(below, 1):
            if not _OPEN_CELL.search(line):
                lines[i : i + beyond] = [line, *[""] * (beyond - 1)]
                break
            line = f"{line} {more}"
    return "\n".join(lines).encode() + data[cut:]


def _is_lost_row(line: str) -> bool:
    """Tell a line of two numbers or more and nothing else."""
    if not DIGIT.search(line):
        return False
    return any(len(f := split(line, d)) > 1 and is_row(f) and all(map(is_number_like, f)) for d in DELIMITERS)


def _why_no_table(data: Text, request: Request) -> str:
    """Say what is missing: rows of numbers, a header row, or the columns the user named."""
    above: list[str] = []
    for _, line in itertools.islice(lines_from(data, 0), _MOST_LOOKED_AT):
        rows = (split(line, d) for d in DELIMITERS) if DIGIT.search(line) else ()
        width = max((len(row) for row in rows if is_row(row)), default=0)
        if width > 1:
            break
        above = [*above[-4:], line]
    else:
        return (
            "no rows of numbers were found; a header row with a time and a force, then numbers, were expected; check it"
        )
    readings = [split(COMMENT.sub("", line, count=1), delimiter) for line in above for delimiter in DELIMITERS]
    names = next((fields for fields in readings if len(fields) == width), None)
    load = '; a constant load is given with --normal-force "3 N"'
    if names is None:
        more, unit = (",normal_force=3", ",normal_force=N") if width > 2 else ("", "")
        return (
            f"rows of {width} numbers were found, but no header row that names them; a time and a force column were "
            f"expected; number them, as in --columns time=1,friction_force=2{more} --units time=s,friction_force=N"
            f"{unit}{load}"
        )
    available = shown((parse_name(name).name for name in names), most=12)
    if request.columns:
        requested = ", ".join(f"{name!r}" for name in request.columns.values())
        return f"the columns {available} were found, none of {requested}; give the names as the file has them"
    return (
        f"no time column and no force column were recognised among {available}; names such as {EXAMPLES['time']} and "
        f"{EXAMPLES['friction_force']} were expected; say which is which with --columns time=<name>,"
        "friction_force=<name>,normal_force=<name>, and give the units that no name says, as in --units time=s,"
        "friction_force=N,normal_force=N" + load
    )
