"""Tables of numbers inside a text: header rows, the blocks below them, and the text that stands between."""

import itertools
import re
from collections.abc import Mapping, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
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
    words,
)
from data_io.layout import COMMENT, DIGIT, Head, head_at, is_row, line_at, lines_from, numbered_head
from data_io.rows import Above, Numbers, read_block, read_numbers
from data_io.segments import BLOCK, FIRST, MOST_WORDS, Lines, Segment
from data_io.source import Request, Source
from data_io.text import DELIMITERS, TEXT_LINE, decode, is_number_like, over_midnight, split
from data_io.values import Finding, FloatArray

# A table of numbers while it is read piece by piece, and when it is whole.

_MOST_REMARKS: Final = 20


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


@dataclass
class OpenTable:
    """A table whose rows are still being read; wanted: the columns that are kept (None: all); decimal: the mark, as far
    as its rows tell; units: those that stand in cells, by column."""

    head: Head
    preamble: tuple[str, ...]
    first_line: int
    wanted: frozenset[int] | None
    decimal: str | None = None
    remarks: list[Finding] = field(default_factory=list)
    _pieces: list[dict[int, FloatArray]] = field(default_factory=list)
    _rows: list[int] = field(default_factory=list)
    _fields: int | None = None
    _days: list[Mapping[int, FloatArray | None]] = field(default_factory=list)
    units: dict[int, tuple[str, ...]] = field(default_factory=dict)

    @property
    def rows(self) -> int:
        """Number of rows so far."""
        return sum(self._rows)

    def add(self, numbers: Numbers) -> None:
        """Put rows below those that are there."""
        self.remarks += numbers.remarks
        self.decimal = self.decimal or numbers.decimal
        self._fields = self._fields or numbers.fields
        self.units |= numbers.units
        if numbers.rows:
            kept = numbers.columns.items()
            self._pieces.append({i: v for i, v in kept if self.wanted is None or i in self.wanted})
            self._days.append(numbers.days)
            self._rows.append(numbers.rows)

    def above(self, ending: str | None) -> Above:
        """Return what the rows so far tell of those below; `ending`: their text where the log ends soon."""
        return Above(self.decimal, self._fields, frozenset().union(*self._pieces), ending, dict(self.units))

    def close(self) -> Table:
        """Return the whole table; rows at its end that hold nothing, as spreadsheets leave them, are taken away."""
        header = self.head.header
        columns: dict[int, FloatArray] = {}
        for index in sorted(set().union(*self._pieces)):
            pieces = [piece.pop(index, None) for piece in self._pieces]
            filled = [np.full(n, np.nan) if p is None else p for p, n in zip(pieces, self._rows, strict=True)]
            columns[index] = filled[0] if len(filled) == 1 else np.concatenate(filled)
        if not self._pieces:
            columns = {index: np.empty(0) for index in range(len(header.names))}
        end = sum(self._rows)
        if end and all(np.isnan(column[-1]) for column in columns.values()):
            full = np.flatnonzero(np.any([~np.isnan(column) for column in columns.values()], axis=0))
            end = int(full[-1]) + 1 if full.size else 0
            columns = {index: column[:end] for index, column in columns.items()}
        clocks = set().union(*self._days) & set(columns)
        for index in clocks:
            days = [piece.get(index) for piece in self._days]
            dated = [np.full(n, np.nan) if d is None else d for d, n in zip(days, self._rows, strict=True)]
            columns[index] = over_midnight(columns[index], np.concatenate(dated)[:end])
        for index, units in self.units.items():
            if header.names[index].unit is None:
                header = with_unit(header, index, units[0])
        header = _since_1970(_with_clock(header, columns, clocks), columns)
        remarks = list(dict.fromkeys(self.remarks + _milliseconds_added(header, columns, clocks)))
        if len(remarks) > _MOST_REMARKS:
            text = f"and {len(remarks) - _MOST_REMARKS} remarks more of this kind"
            remarks = [*remarks[:_MOST_REMARKS], Finding("text_in_rows", "warning", text)]
        return Table(header, columns, self.preamble, self.first_line, tuple(remarks))


def _with_clock(header: Header, columns: Mapping[int, FloatArray], clocks: Set[int]) -> Header:
    """Return a header in which times of the day are seconds, and an elapsed time beside them is the clock."""
    for index in clocks:
        header = with_unit(header, index, "s")
    taken, others = header.roles.get("time"), header.passed_over.get("time", ())
    elapsed = [i for i in others if i not in clocks and i in columns and np.isfinite(columns[i]).any()]
    if taken not in clocks or not elapsed:
        return header
    roles = {**header.roles, "time": elapsed[0]}
    passed = {**header.passed_over, "time": tuple(i for i in (taken, *others) if i is not None and i != elapsed[0])}
    return replace(header, roles=roles, passed_over=passed)


_YEARS_2000_TO_2100: Final = (9.5e8, 4.1e9)  # seconds since 1970
_PARTS: Final = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}  # of a second


def _since_1970(header: Header, columns: Mapping[int, FloatArray]) -> Header:
    """Return a header in which a clock without a unit that counts from 1970, as computers and robots write it, has the
    one in which it tells a time of our days. A counter of something else may stand there for a while; its rows would
    then be seconds apart and more, and its unit is asked for."""
    index = header.roles.get("time")
    if index is None or header.names[index].unit is not None or index not in columns:
        return header
    stamps = columns[index][np.isfinite(columns[index])]
    if stamps.size < 2:
        return header
    low, high = (float(end) for end in (np.min(stamps), np.max(stamps)))
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


def wanted_columns(header: Header, request: Request, keep: Sequence[str] = ()) -> frozenset[int] | None:
    """Return which columns of a header are to be read: None for all, else those with a role and those asked for."""
    if request.channels is None:
        return None
    named = (find_column(header.names, name) for name in (*request.channels, *request.columns.values(), *keep))
    clocks = header.passed_over.get("time", ())
    own = {header.names[index] for index in (*header.roles.values(), *clocks)}
    if "friction_force" not in header.roles and (coefficient := coefficient_column(header)) is not None:
        own.add(header.names[coefficient])
    if (part := milliseconds_column(header)) is not None:
        own.add(header.names[part])
    if "time" not in header.roles and (way := distance_columns(header)) is not None:
        own |= {header.names[index] for index in way}
    twins = {index for index, name in enumerate(header.names) if name in own}
    return frozenset(twins | {index for index in named if index is not None})


# Walking the words of a text log: where a table begins, where words stand between its rows, where it ends.

_THREADS: Final = 2
"""Blocks of numbers that pandas reads at the same time."""
MOST_TABLES: Final = 5000
"""Steps of the longest test; a text with more headers is no log, and would take minutes to refuse otherwise."""
MOST_LOOKED_AT: Final = 20_000
"""Lines of words in a row in which a header is looked for; more are no log, and would take seconds."""


class Walk:
    """The tables found so far, the one whose rows are being read, and text that waits for what follows it."""

    def __init__(
        self,
        source: Source,
        request: Request,
        breaks: re.Pattern[str] | None = None,
        keep: Sequence[str] = (),
        never: re.Pattern[str] | None = None,
    ) -> None:
        self.source, self._request, self._breaks, self._keep, self._never = source, request, breaks, keep, never
        self._tables: list[Table] = []
        self._text, self._first_line, self._at_end = "", 1, False
        self._marks: list[int] = []
        self._above, self._looked_at = 0, 0
        self._segment = Segment(b"", 1, False)
        self.table: OpenTable | None = None
        self._numbered, self._settings = False, 0
        self.carry = ""

    def take(self, segment: Segment) -> None:
        """Walk the next segment. Raises the source's `LogError`."""
        self._segment = segment
        self._first_line = segment.first_line - self.carry.count("\n")
        self._text, self._at_end = self.carry + segment.text, segment.at_end
        self._marks = [match.start() for match in TEXT_LINE.finditer("\n" + self._text)]
        self._above, self.carry = 0, ""
        self._without_settings()
        i = self._rows(0, 0) if self.table is not None else 0
        while i < len(self._marks) and self.table is None and not self.carry:
            head = self._head(i)
            if head is not None:
                i = self._begin(head, i)
                continue
            i += 1
            self._looked_at += 1
            if self._looked_at > MOST_LOOKED_AT:
                raise self.source.error(
                    f"more than {MOST_LOOKED_AT} lines of words in a row were found where a header or rows of numbers "
                    "were expected; a log was expected; check the file"
                )
        if self.table is None and not self._tables:
            goes_on = not self._at_end and len(self._text) <= MOST_WORDS
            if found := numbered_head(self._text, self._request, goes_on=goes_on):
                self._begin(found[0], -1)
                self._numbered = True
        if self.table is None:
            self._carry_on()

    def _without_settings(self) -> None:
        """Drop a table without a header that was begun above another, longer one of other rows: settings."""
        if self.table is None or not self._numbered or self._tables:
            return
        layout = self.table.head.delimiter, self.table.head.width
        last = self._text[self._text.rfind("\n", 0, self._text.rfind("\n")) + 1 :].split("\n")[0]
        if len(split(last, layout[0])) == layout[1]:
            return
        found = numbered_head(self._text, self._request)
        if found and found[1] > self.table.rows and (found[0].delimiter, found[0].width) != layout:
            self._settings, self.table = self.table.rows, None

    def finish(self) -> tuple[list[Table], tuple[str, ...]]:
        """Return the tables and the lines below the last one. Raises the source's `LogError` where there is none."""
        self._close()
        if not self._tables:
            raise self.source.error(_why_no_table(self.carry, self._request))
        footer = _lines(self.carry)
        if rows := [line for line in footer if _is_lost_row(line)]:
            text = f"{len(rows)} line(s) of numbers below the last table were left out: {rows[0]!r:.60}"
            remarks = (*self._tables[-1].remarks, Finding("rows_left_out", "warning", text))
            self._tables[-1] = replace(self._tables[-1], remarks=remarks)
        return self._tables, footer

    def _begin(self, head: Head, i: int) -> int:
        """Begin the table whose header is mark `i` and read what follows; return the mark at which to go on."""
        self._looked_at = 0
        above = _lines(self._text[self._above : self._marks[i] if i >= 0 else head.start])
        first_line = self._line(head.start)
        wanted = wanted_columns(head.header, self._request, self._keep)
        self.table = OpenTable(head, above, first_line, wanted)
        if self._settings:
            text = f"{self._settings} rows of another layout above the table were taken for settings"
            self.table.remarks.append(Finding("settings_above", "info", text))
        if self._tables and (rows := [line for line in above if _is_lost_row(line)]):
            text = f"{len(rows)} line(s) of numbers above line {first_line} fit no header and were left out"
            self.table.remarks.append(Finding("rows_left_out", "warning", text))
        if len(self._tables) >= MOST_TABLES:
            raise self.source.error(
                f"more than {MOST_TABLES} header rows were found; one per step was expected; drop repeated ones"
            )
        i += 1
        if head.width == 0:
            self._above = head.start
            self._close()
            return i
        while i < len(self._marks) and self._marks[i] < head.start:
            i += 1
        return self._rows(head.start, i)

    def _rows(self, begin: int, i: int) -> int:
        """Read rows of the open table from `begin` on; close it where it ends; return the mark at which to go on."""
        table, text = self.table, self._text
        assert table is not None
        first_line, pieces = self._line(begin), []
        while True:
            stop, i = self._next_interruption(table.head, i)
            pieces.append(text[begin:stop])
            resume = self._resume(table.head, i)
            if resume is None or resume[0] >= len(text):
                break
            begin, i = resume
            if skipped := _lines(COMMENT.sub("", text[stop:begin])):
                text_left = f"text between the rows was left out: {skipped[0]!r:.60}"
                table.remarks.append(Finding("text_in_rows", "warning", text_left))
        ending = decode(self._segment.before, start=False) if stop >= len(text) and self._at_end else None
        table.add(read_numbers(self.source, "".join(pieces), first_line, table.head, table.above(ending)))
        self._check_units(table)
        if stop >= len(text):
            self._above = len(text)
        elif resume is not None and not self._at_end and len(text) - stop <= MOST_WORDS:
            self.carry = text[stop:]  # rows may follow these words
        else:
            self._above = stop
            self._close()
        return i

    def _check_units(self, table: OpenTable) -> None:
        """Refuse one unit given for a column whose rows hold several."""
        names, roles = table.head.header.names, table.head.header.roles
        for index, units in table.units.items():
            keys = {names[index].raw, names[index].name, *(role for role, place in roles.items() if place == index)}
            given = next((unit for key, unit in self._request.units.items() if key in keys), None)
            if given and len(units) > 1:
                raise self.source.error(
                    f"column {names[index].raw!r} holds {' and '.join(units)} by turns, and {given!r} was given for "
                    "all of it; each row is read in its own unit; leave the unit out that was given"
                )

    def _close(self) -> None:
        if self.table is not None:
            self._tables.append(self.table.close())
            self.table = None

    def _carry_on(self) -> None:
        """Keep the text that belongs to no table yet, unless it is too long for words above a table."""
        self.carry = self._text[self._above :]
        if len(self.carry) <= MOST_WORDS or self._at_end:
            return
        if not self._tables:
            raise self.source.error(_why_no_table(self.carry, self._request))
        self.carry = self.carry[self.carry.rfind("\n", 0, len(self.carry) - MOST_WORDS // 4) + 1 :]

    def _next_interruption(self, head: Head, i: int) -> tuple[int, int]:
        """Return position and mark of the next text line that is no row with a word in it."""
        while i < len(self._marks):
            fields = split(line_at(self._text, self._marks[i])[0], head.delimiter)
            if len(fields) != head.width or not is_row(fields):
                return self._marks[i], i
            i += 1
        return len(self._text), i

    def _resume(self, head: Head, i: int) -> tuple[int, int] | None:
        """Return where the rows of the same table go on behind text, and the next mark; None if the table ended.

        Where nothing but words follows, they may go on in the next segment: the end of the text and of the marks.
        """
        last = min(i + MOST_LOOKED_AT, len(self._marks))
        while i < last:
            line, after = line_at(self._text, self._marks[i])
            if self._breaks is not None and self._breaks.match(line):
                return None
            if self._head(i) is not None:
                return None
            i += 1
            limit = self._marks[i] if i < len(self._marks) else len(self._text)
            position, row = next(lines_from(self._text, after), (limit, ""))
            if position < limit:
                fields = split(row, head.delimiter)
                return (position, i) if len(fields) == head.width and is_row(fields) else None
        return (len(self._text), i) if i == len(self._marks) else None

    def _head(self, i: int) -> Head | None:
        position = self._marks[i]
        if self._never is not None and self._never.match(line_at(self._text, position)[0]):
            return None
        return head_at(self.source, self._text, position, self._request)

    def _line(self, position: int) -> int:
        return self._first_line + self._text.count("\n", 0, position)


def _is_lost_row(line: str) -> bool:
    """Tell a line of two numbers or more and nothing else."""
    if not DIGIT.search(line):
        return False
    return any(len(f := split(line, d)) > 1 and is_row(f) and all(map(is_number_like, f)) for d in DELIMITERS)


def _lines(text: str) -> tuple[str, ...]:
    return tuple(line.strip() for line in text.split("\n") if line.strip())


def _why_no_table(text: str, request: Request) -> str:
    """Say what is missing: rows of numbers, a header row, or the columns the user named."""
    above: list[str] = []
    for _, line in itertools.islice(lines_from(text, 0), MOST_LOOKED_AT):
        rows = (split(line, d) for d in DELIMITERS) if DIGIT.search(line) else ()
        width = max((len(row) for row in rows if is_row(row)), default=0)
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
                    "--columns time=<name>,friction_force=<name>,normal_force=<name>, and give the units that no name "
                    "says, as in --units time=s,friction_force=N,normal_force=N; a constant load is given with "
                    '--normal-force "3 N"'
                )
    load, load_unit = (",normal_force=3", ",normal_force=N") if width > 2 else ("", "")
    return (
        f"rows of {width} numbers were found, but no header row that names them; a {words('time')} and a force column "
        f"were expected; number them, as in --columns time=1,friction_force=2{load} --units "
        f'time=s,friction_force=N{load_unit}; a constant load is given with --normal-force "3 N"'
    )


def read_tables(
    source: Source,
    request: Request,
    breaks: re.Pattern[str] | None = None,
    keep: Sequence[str] = (),
    never: re.Pattern[str] | None = None,
) -> tuple[list[Table], tuple[str, ...]]:
    """Return every table of a text, and the lines that follow the last one.

    A table is a header row with a role, perhaps a units row, then rows of numbers. Text between rows ends a table where
    it matches `breaks` or a header follows; other text between rows is left out with a remark. Where the request
    chooses channels, only these, the columns with a role and those called as in `keep` are read. A line that matches
    `never` is no header, whatever it names. Raises `LogError` where there is no table.
    """
    with source.open() as handle:
        walk = Walk(source, request, breaks, keep, never)
        return _read_all(walk, Lines(source, request, handle))


def read_below(source: Source, request: Request, lines: Lines, rest: Segment, head: Head) -> Table:
    """Return the table whose head is known; `rest` holds its first rows, `lines` the others. Raises `LogError`."""
    walk = Walk(source, request)
    walk.table = OpenTable(head, (), rest.first_line, wanted_columns(head.header, request))
    walk.take(rest)
    return _read_all(walk, lines)[0][0]


def _read_all(walk: Walk, lines: Lines) -> tuple[list[Table], tuple[str, ...]]:
    with ThreadPoolExecutor(_THREADS) as pool:  # new threads would ask for their memory anew
        while not lines.at_end:
            if not _read_fast(walk, lines, pool):
                walk.take(lines.segment())
                if walk.table is None:
                    # what waits for a table is walked again with what follows: in few, larger pieces
                    lines.size = min(4 * lines.size, BLOCK)
    return walk.finish()


def _read_fast(walk: Walk, lines: Lines, pool: ThreadPoolExecutor) -> bool:
    """Read the rows that follow as blocks of numbers, in threads; False where words come first, or nothing tells their
    columns."""
    table = walk.table
    if table is None or walk.carry or not lines.may_run:
        return False
    blocks = list(itertools.takewhile(len, (lines.numbers() for _ in range(_THREADS))))
    lines.size = FIRST if blocks else BLOCK  # words in every row: fewer calls of pandas
    read = pool.map(lambda block: read_block(block, table.head, table.decimal, table.wanted), blocks)
    for place, numbers in enumerate(read):
        if numbers is None:
            lines.give_back(blocks[place:])
            lines.size = BLOCK
            return False
        lines.passed(blocks[place])
        table.add(numbers)
    return bool(blocks)
