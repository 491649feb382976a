"""Where a table of numbers begins and ends: its header and units, how its rows are delimited, its decimal mark."""

from __future__ import annotations

import csv
import io
import itertools
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
import numpy.typing as npt

from data_io.columns import KIND, Header, Name, match_header, role_of, shown
from data_io.source import Request, Source
from data_io.text import (
    BLANKS,
    DATE_ALONE,
    DELIMITERS,
    MISSING,
    Text,
    clock_times,
    is_clock_time,
    is_number,
    is_number_like,
    split,
    to_number,
)
from data_io.units import SI_UNIT, factor, kind_of, split_cell, unit_word
from data_io.values import LONGEST_GAP, Finding, FloatArray

if TYPE_CHECKING:
    import pandas as pd

WIDE: Final = r" {2,}|\t+"
"""Delimiter of a header whose names hold single blanks and stand apart by several."""
COMMENT: Final = re.compile(r"^\s*(?:#|%|//)+\s*")
DIGIT: Final = re.compile(r"\d")


@dataclass(frozen=True)
class Head:
    """The top of a table: columns with units, position of the first row, delimiter and fields of a row (0: no row)."""

    header: Header
    start: int
    delimiter: str
    width: int


def head_at(source: Source, data: Text, position: int, request: Request) -> Head | None:
    """Return the head of a table whose header row is the line at `position`, None if that line is none.

    A header row names at least one role, holds no number, and rows with as many fields follow it before any other
    header row. Raises the source's `LogError` where a clear header (time and force) is followed by rows that misfit.
    """
    line, after = line_at(data, position)
    if len(line) > 20000:
        return None
    line = COMMENT.sub("", line, count=1)
    readings = [(d, *_with_names_above(data, position, d, fields, request)) for d, fields in _readings(line)]
    readings = [reading for reading in readings if reading[2].roles]
    if not readings:
        return None
    between, below, row = _rows_below(data, after)
    numbers = [int(name) for name in request.columns.values() if name.isdecimal() and len(name) < 10]
    complaint: str | None = None
    for delimiter, fields, header in readings:
        named = _named(fields, request)
        if not named and len(fields) < max(numbers, default=0):
            continue  # words of two or three fields above the table whose columns were numbered
        clear = delimiter in ("\t", ";", ",") and "time" in named and len(named) > 1
        units = next(
            ((u, offset) for offset, other in between if (u := _units_row(other, delimiter, len(fields)))), None
        )
        if row is None:
            if clear:
                start = after if units is None else line_at(data, units[1])[1]
                return Head(_with_units(source, request, header, units[0] if units else ()), start, delimiter, 0)
            continue
        layout = _row_layout(row, delimiter, len(_trimmed(fields)))
        if layout is None and _has_row_names(data, below, delimiter, header):
            fields, units = ["row", *fields], None
            header = match_header(fields, request.columns)
            layout = _row_layout(row, delimiter, len(fields))
        if layout is not None and layout[0] == ";" != delimiter and ";" in line:
            continue  # words that were torn apart where the rows below are not
        words = between[:-1] if between and _are_units(between[-1][1], delimiter, len(fields), header) else between
        if (layout or clear) and any(
            lower and (not named or _named([name.raw for name in lower.header.names], request))
            for lower in (head_at(source, data, offset, request) for offset, _ in words)
        ):
            return None  # words above the header row proper
        if layout is not None:
            first = split(row, layout[0])
            numbered = [i for role, i in header.roles.items() if request.columns.get(role, "").isdecimal()]
            if any(i < len(first) and first[i] and not is_number_like(first[i]) for i in numbered):
                return None  # another table: words stand in the columns that were numbered
            return Head(_with_units(source, request, header, units[0] if units else ()), below, *layout)
        if clear and complaint is None:
            held, names = len(split(row, delimiter)), len(_trimmed(fields))
            complaint = f"line {data[:below].count(10) + 1} holds {held} fields where the header names {names} "
            complaint += (
                "columns; decimal commas look like separating commas; export with ; or tabs between columns"
                if delimiter == "," and held == 2 * names
                else "columns; as many were expected; repair the header or export again"
            )
    if complaint:
        raise source.error(complaint)
    return None


def line_at(data: Text, position: int) -> tuple[str, int]:
    """Return the line that starts at `position`, and where the next one starts."""
    end = data.find(b"\n", position)
    end, after = (len(data), len(data)) if end < 0 else (end, end + 1)
    return data[position:end].decode("utf-8", "replace"), after


def lines_from(data: Text, position: int) -> Iterator[tuple[int, str]]:
    """Yield the lines that are not blank, with their positions."""
    while position < len(data):
        line, after = line_at(data, position)
        if line.strip():
            yield position, line
        position = after


def is_row(fields: Sequence[str]) -> bool:
    """Tell whether fields are a row of numbers and clock times: at least one number, and not mostly words.

    A clock time counts where no words stand before it. Or cells that each hold a number with its unit. A field that
    ends in a colon names a setting.
    """
    filled = [field for field in fields if field]
    if any(field.endswith(":") for field in filled):
        return False
    if not any(is_number(field) or is_number(field, ",") for field in filled):
        return len(filled) > 1 and all(split_cell(field) for field in filled)
    clock = next((i for i, field in enumerate(filled) if is_clock_time(field)), None)
    leads = clock is not None and all(is_number_like(field) or DATE_ALONE.fullmatch(field) for field in filled[:clock])
    known = sum(is_number_like(field) or (leads and is_clock_time(field)) for field in filled)
    return known * 2 >= len(filled)


def _readings(line: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the ways in which a line can be a row of names: two fields at least, no number among them."""
    for delimiter in ("\t", ";", ",", WIDE, BLANKS):
        if delimiter == WIDE:
            fields = [field for field in re.split(WIDE, line.strip()) if field]
        elif delimiter == BLANKS:
            fields = re.sub(r"(?<!\s)\s++(?=[(\[][^()\[\]]*[)\]](?:\s|$))", "", line).split()
        else:
            fields = split(line, delimiter)
        marks = "." if delimiter == "," else ".,"
        if len(fields) > 1 and not any(is_number(field, mark) for field in fields for mark in marks):
            yield delimiter, fields


def _named(fields: Sequence[str], request: Request) -> set[str]:
    """Return the roles that names tell, of columns that the user numbered as well."""
    by_name = {role: column for role, column in request.columns.items() if not column.isdecimal()}
    return set(match_header(fields, by_name).roles)


def _with_names_above(
    data: Text, position: int, delimiter: str, fields: list[str], request: Request
) -> tuple[list[str], Header]:
    """Return a row of names and what it tells; names that it leaves empty may stand in the row above (merged cells)."""
    header = match_header(fields, request.columns)
    if all(fields) or not header.roles or delimiter not in ("\t", ";", ",") or position == 0:
        return fields, header
    above = split(line_at(data, data.rfind(b"\n", 0, position - 1) + 1)[0], delimiter)
    if len(above) != len(fields) or any(map(is_number, above)):
        return fields, header
    filled = [own or over for own, over in zip(fields, above, strict=True)]
    other = match_header(filled, request.columns)
    return (filled, other) if len(other.roles) > len(header.roles) else (fields, header)


def _rows_below(data: Text, position: int) -> tuple[list[tuple[int, str]], int, str | None]:
    """Return the lines before the first row of numbers, where that is, and the row (None: none is near)."""
    between: list[tuple[int, str]] = []
    for offset, line in lines_from(data, position):
        if DIGIT.search(line) and any(is_row(split(line, candidate)) for candidate in DELIMITERS):
            return between, offset, line
        between.append((offset, line))
        if len(between) > 6:
            break
    return between, position, None


def _row_layout(row: str, delimiter: str, names: int) -> tuple[str, int] | None:
    """Return the delimiter and number of fields of a row that fits `names` columns; empty fields may follow."""
    own = BLANKS if delimiter == WIDE else delimiter
    for candidate in (own, *(other for other in DELIMITERS if other != own)):
        fields = split(row, candidate)
        if len(fields) >= max(names, 2) and not any(fields[names:]) and is_row(fields):
            return candidate, len(fields)
    return None


def _has_row_names(data: Text, start: int, delimiter: str, header: Header) -> bool:
    """Tell whether rows hold the numbers 1, 2, 3, … in front of the named columns, as R's write.table writes them."""
    place = header.roles.get("time", -1) + 1
    own = BLANKS if delimiter == WIDE else delimiter
    rows = [split(line, own) for _, line in itertools.islice(lines_from(data, start), 20)]
    if place == 0 or len(rows) < 2 or any(len(r) != len(header.names) + 1 or not is_number(r[place]) for r in rows):
        return False
    times = [to_number(row[place], ".") or 0.0 for row in rows]  # thousands may be grouped
    return [row[0].strip('"') for row in rows] == [str(i + 1) for i in range(len(rows))] and sorted(set(times)) == times


def _units_row(line: str, delimiter: str, names: int) -> list[str]:
    """Return the units that a line below the names holds; nothing where it is none of units."""
    line = COMMENT.sub("", line, count=1)
    fields = re.split(WIDE, line.strip()) if delimiter == WIDE else split(line, delimiter)
    fields = [field[1:-1].strip() if field[:1] in "([" and field[-1:] in ")]" else field for field in fields]
    known = any(field and field not in ("-", "1") and kind_of(field) is not None for field in fields)
    return fields if known and not any(fields[names:]) else []


def _are_units(line: str, delimiter: str, names: int, header: Header) -> bool:
    """Tell whether a line is a units row that says Time below the column of times."""
    units = _units_row(line, delimiter, names)
    roles = match_header(units, {}).roles if len(units) == names else {}
    return list(roles.items()) == [("time", header.roles.get("time"))] and any(kind_of(u) == "force" for u in units)


def _with_units(source: Source, request: Request, header: Header, units: Sequence[str]) -> Header:
    """Return the header with the entries of a units row where the names say no unit; both, differing, is an error."""
    names: list[Name] = []
    roles = {index: role for role, index in header.roles.items()}
    for index, name in enumerate(header.names):
        given = units[index] if index < len(units) else ""
        requested = {roles.get(index, ""), name.name, name.raw} & set(request.units)
        if given and name.unit and given != name.unit and not requested:
            raise source.error(
                f"column {shown([name.raw])} names one unit and the units row below it {given!r}; "
                f"one unit was expected; correct the header or give the unit with --units"
            )
        names.append(replace(name, unit=given) if units and name.unit is None else name)
    return replace(header, names=tuple(names))


def _trimmed(fields: Sequence[str]) -> list[str]:
    """Return the fields without empty ones at the end; LabVIEW names a Comment there that its rows do not hold."""
    last = max((i for i, field in enumerate(fields) if field and field != "Comment"), default=-1)
    return list(fields[: last + 1])


def numbered_head(data: Text, request: Request, *, goes_on: bool) -> Head | None:
    """Return the head of a file of bare numbers, its columns called "1", "2", ..., if the user named them so.

    The table is the longest block of rows of equal width, whichever delimiter tells it; other lines stand above it.
    goes_on: more text follows, and rows that lack a column that was named may be settings.
    """
    wanted = request.columns
    if not wanted or not all(name.isdecimal() and len(name) < 10 for name in wanted.values()):
        return None
    places = [int(name) - 1 for name in wanted.values()]
    least = max(places) + 1 if goes_on else 1 if request.rate is not None else 2
    lines = list(lines_from(data, 0))
    best = (0, 0, "", 0)  # rows, where, delimiter, width
    for delimiter in DELIMITERS:
        rows, start, before = 0, 0, 0
        for position, line in lines:
            fields = split(line, delimiter)
            named = [fields[i] for i in places if i < len(fields)]
            # words may stand in columns that nobody asks for, and units behind the numbers
            fits = len(fields) >= least and is_row(fields)
            fits = fits and all(is_number_like(f) or is_clock_time(f) or unit_word(f) for f in named)
            width = len(fields) if fits else 0
            if width != before or not width:
                rows, start, before = 0, position, width
            rows += 1
            if width and rows > best[0]:
                best = (rows, start, delimiter, width)
    rows, start, delimiter, width = best
    if not rows:
        return None
    fields = _trimmed(split(line_at(data, start)[0], delimiter))
    units = [unit_word(beside) if is_number(own) else None for own, beside in itertools.pairwise([*fields, ""])]
    names = tuple(Name(str(i), str(i), unit) for i, unit in enumerate(units, start=1))
    roles = {role: int(name) - 1 for role, name in wanted.items() if 0 < int(name) <= len(names) and role in KIND}
    return Head(Header(names, roles), start, delimiter, width)


# The decimal mark of a block of rows: point or comma, told from the other mark that may stand between thousands.

_COMMA_GROUPS: Final = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_POINT_GROUPS: Final = re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+")


def decimal_mark(source: Source, block: str, head: Head) -> str | None:
    """Return the decimal mark, None where nothing tells: a comma only where it does not delimit, by columns of a role.

    Quotes protect a comma from delimiting. Of two marks in one number the last is the decimal one; of two kinds of
    numbers those that can be thousands are. Raises the source's `LogError` where commas may as well stand between
    thousands.
    """
    if "," not in block or (head.delimiter == "," and '"' not in block):
        return None
    roles = head.header.roles.values()
    split_rows = (split(line, head.delimiter) for line in block.split("\n"))
    rows = ([f[i] if ":" not in f[i] else "" for i in roles if i < len(f)] for f in split_rows)  # no clock times
    first = list(itertools.islice(rows, 200))
    telling = next((row for row in itertools.chain(first, rows) if any("," in f or "." in f for f in row)), None)
    if telling is None:
        return None
    marked = [field for row in (*first, telling) for field in row if "," in field or "." in field]
    commas, points = [f for f in marked if "," in f], [f for f in marked if "." in f]
    both = next((field for field in commas if "." in field), None)
    if both is not None:
        return "." if both.rfind(".") > both.rfind(",") else ","
    if not commas or (points and all(_COMMA_GROUPS.fullmatch(field) for field in commas)):
        return "."
    if points and not all(_POINT_GROUPS.fullmatch(field) for field in points):
        return "," if any("," in field for field in telling) else "."
    sure = head.delimiter != "," or not all(_COMMA_GROUPS.fullmatch(field) for field in commas)
    for place, index in enumerate(roles):
        column = [row[place] for row in first if place < len(row) and row[place]]
        grouped = [field for field in column if _COMMA_GROUPS.fullmatch(field)]
        plain = [field for field in column if re.fullmatch(r"[+-]?\d{1,3}", field)]
        if grouped and (plain or not sure) and len(grouped) + len(plain) == len(column):
            raise source.error(
                f"column {head.header.names[index].raw!r} holds {grouped[0]!r} and {(plain or grouped)[-1]!r}; the "
                "comma may be a decimal mark or stand between thousands; export without thousands separators"
            )
    return ","


# The last row of a log that does not end its last line: whole, or cut off in the middle of a number?

LOOKED_AT: Final = 5000
"""Characters above the last row in which others to compare it with are looked for."""


def without_cut_row(block: str, before: str, head: Head) -> tuple[str, list[Finding]]:
    """Take the last row away if it may be cut off: fields as no row above has them, or a last one shorter than theirs.

    before: rows that stand above the block, whose own may be few.
    """
    start = block.rfind("\n") + 1
    last = block[start:]
    fields = split(last, head.delimiter)
    if not last.strip():
        return block, []
    lines = (before + block[:start])[-LOOKED_AT:].split("\n")[-6:-1]
    rows = [split(line, head.delimiter) for line in lines if line.strip()]
    above = [len(row[-1]) for row in rows if len(row) == len(fields)]
    unlike = bool(rows) and len(fields[-1]) < min(above, default=LOOKED_AT)
    if len(fields) < max(len(head.header.names), head.width) or unlike:
        text = f"the last row ({last!r:.60}) has no line end and may be cut off; it was left out"
        return block[:start], [Finding("last_row_cut", "warning", text)]
    text = "the last row has no line end, as if the file were cut there; it looks whole and was kept"
    return block, [Finding("last_row_open", "info", text)]


# A block of rows to float64 columns: by the parser of pandas, and field by field where that does not read them.

_BLANK: Final = "".join(map(chr, range(33)))
_MISSING: Final = ["-", "--", "---", "1.#INF", "-1.#INF"]


@dataclass(frozen=True)
class Numbers:
    """Columns by index, each (rows,), remarks on what was not a number, decimal mark and usual number of fields (None:
    these rows do not tell).

    days: of columns that hold times of the day, in seconds, the days of their dates. units: of columns whose cells
    hold them, or a column of units beside them; the numbers are in the first one. Columns without numbers are absent.
    """

    columns: dict[int, FloatArray]
    rows: int
    remarks: tuple[Finding, ...] = ()
    decimal: str | None = None
    fields: int | None = None
    days: Mapping[int, FloatArray | None] = field(default_factory=dict)
    units: Mapping[int, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class Above:
    """What the rows above tell: decimal mark, usual number of fields (None: not told), columns that held numbers, units
    that their cells held, and of a log that ends with the rows to read those right above them as text (None: the log
    goes on)."""

    decimal: str | None = None
    fields: int | None = None
    numeric: Set[int] = frozenset()
    ending: str | None = None
    units: Mapping[int, tuple[str, ...]] = field(default_factory=dict)


_NUMBERS: Final = b"0123456789+-.eE,;\t \n"


class _Pieces:
    """The lines of a text that hold nothing but numbers as a file that pandas reads: `end` is behind the last of them.

    Pandas takes a piece at a time, which is looked at while it is in the cache. It is no binary file by type: pandas
    would decode its bytes, and encode them again for the parser, which takes longer than parsing.
    """

    def __init__(self, data: Text, begin: int, stop: int, counted: str) -> None:
        self._data, self.end, self._stop, self._counted = data, begin, stop, counted
        self.delimiters, self.marks = 0, {b".": False, b",": False}

    def __iter__(self) -> Iterator[bytes]:
        return iter(())

    def read(self, size: int) -> bytes:
        """Return the next whole lines, nothing where words begin."""
        stop = self._data.rfind(b"\n", self.end, min(self.end + size, self._stop)) + 1
        piece = self._data[self.end : max(stop, self.end)]
        codes = np.frombuffer(piece, np.uint8)
        # letters stand above the digits: faster than to look at every character; what else is no number (brackets,
        # percent signs) pandas refuses, not a zero byte, a quote, a comment or another end of a line
        clean = not any(mark in piece for mark in (b"\0", b'"', b"#", b"\r"))
        if clean and codes.max(initial=0) > ord("9"):
            clean = np.count_nonzero(codes > ord("9")) == sum(map(piece.count, (b";", b"e", b"E")))
        if not clean:
            piece = piece[: piece.rfind(b"\n", 0, piece.find(piece.translate(None, _NUMBERS)[:1])) + 1]
            self._stop = self.end + len(piece)
        self.end += len(piece)
        self.marks = {mark: known or mark in piece for mark, known in self.marks.items()}
        if self._counted:
            self.delimiters += int(np.count_nonzero(codes[: len(piece)] == ord(self._counted)))
        return piece


def read_block(
    data: Text, begin: int, stop: int, head: Head, decimal: str | None, wanted: Set[int] | None
) -> tuple[Numbers | None, int]:
    """Read the lines of pure numbers between two bytes at the speed of pandas; and return where they end. None where a
    row is short, long or holds something else.

    decimal: the mark as far as the rows above tell; wanted: columns to read (None: all). Blanks in front of numbers
    need no option of pandas, which would cost a quarter of the time.
    """
    import pandas as pd

    names = len(head.header.names)
    use = None
    if wanted is not None and head.delimiter != BLANKS:
        # pandas would not notice a long row among chosen columns; the last one and the count of delimiters tell
        use = sorted({*(index for index in wanted if index < names), names - 1})
    pieces = _Pieces(data, begin, stop, "" if use is None else head.delimiter)
    try:
        frame: pd.DataFrame = pd.read_csv(
            cast(Any, pieces),
            sep=head.delimiter,
            header=None,
            usecols=use,
            index_col=False,
            decimal=decimal or ".",
            dtype=np.float64,
            na_filter=False,
            quoting=csv.QUOTE_NONE,
            engine="c",
        )
    except (ValueError, OverflowError):
        return None, begin
    # by its own first row pandas tells how many fields there are
    whole = frame.shape[1] == head.width if use is None else pieces.delimiters == (head.width - 1) * len(frame)
    if not whole or (decimal is None and head.delimiter != "," and pieces.marks[b","]):
        return None, begin
    columns = {index: frame[index].to_numpy() for index in map(int, frame.columns) if index < names}
    point = "." if head.delimiter != "," and pieces.marks[b"."] else None
    fields = head.width if len(frame) else None
    return Numbers(columns, len(frame), decimal=decimal or point, fields=fields), pieces.end


def read_numbers(source: Source, block: str, first_line: int, head: Head, above: Above) -> Numbers:
    """Read the rows of a block. Where the log ends with it, its last row may be cut off.

    Raises the source's `LogError` where rows do not fit the header or a column with a role holds words.
    """
    remarks: list[Finding] = []
    if above.ending is not None and not block.endswith("\n"):
        block, remarks = without_cut_row(block, above.ending, head)
    decimal = above.decimal or decimal_mark(source, block, head)
    mark = decimal or ("," if head.delimiter != "," and "," in block else ".")
    lines = [(first_line + i, line) for i, line in enumerate(block.split("\n")) if line.strip(_BLANK)]
    if not lines:
        return Numbers({}, 0, tuple(remarks), decimal)
    # an open quote would swallow the rows up to the next one
    quoted = '"' in block and all(line.count('"') % 2 == 0 for _, line in lines)
    fields = _fields(source, lines, head, quoted)
    names, roles = head.header.names, head.header.roles
    width = max(int(fields.max()), head.width, len(names))
    frame = _parsed(source, block, first_line, head.delimiter, mark, width, quoted)
    usual = above.fields
    if len(frame) == len(lines):
        usual = usual or int(np.bincount(fields).argmax())
        lacking = fields < min(usual, head.width)
        if usual > head.width:  # rows end with a delimiter: one that does so a field early lacks one, too
            lacking |= (fields < usual) & [line.rstrip("\r\n ").endswith(head.delimiter) for _, line in lines]
        if (short := np.flatnonzero(lacking)).size:  # every number in them may stand in a wrong column
            frame = frame.copy()
            frame.iloc[short, :] = np.nan
            number, line = lines[short[0]]
            text = f"line {number} holds {fields[short[0]]} fields where the others hold {usual} ({line!r:.60}); "
            remarks.append(Finding("short_rows", "warning", text + f"{short.size} such row(s) were left empty"))
    frame = _without_statistics(frame, head, above, remarks)
    columns: dict[int, FloatArray] = {}
    days: dict[int, FloatArray | None] = {}
    units: dict[int, tuple[str, ...]] = {}
    beside = _columns_of_units(source, frame, head)
    for index in range(min(len(names), frame.shape[1])):
        column = frame[index]
        if index in beside or frame.empty:
            continue
        if column.dtype.kind in "fiu":
            columns[index] = column.to_numpy(dtype=np.float64)
            continue
        tokens = ["" if isinstance(token, float) else str(token) for token in column.tolist()]
        clock = role_of(names[index].name) == "time" or roles.get("time") == index
        if clock and (stamps := clock_times(tokens)) is not None:
            columns[index], days[index] = stamps
            columns[index] *= _minute(names[index], tokens, remarks)
        elif (with_unit := _of_cells(tokens, mark, above.units.get(index, ()))) is not None:
            columns[index], units[index] = with_unit
        else:
            values, notes = _slow_column(source, tokens, index, head, mark, first_line, index in above.numeric)
            columns |= {} if values is None else {index: values}
            remarks += notes
    for place, index in beside.items():
        if index in columns:
            words = ("" if isinstance(word, float) else word for word in frame[place].tolist())
            row_units = [unit_word(word.strip("[]() ")) or "" for word in words]
            columns[index], units[index] = _in_first_unit(columns[index], row_units, above.units.get(index, ()))
    return Numbers(columns, len(frame), tuple(remarks), decimal, usual, days, units)


def _minute(name: Name, tokens: Sequence[str], remarks: list[Finding]) -> float:
    """Return what stamps of minutes and seconds are to be multiplied by: 60 where they are hours and minutes."""
    pairs = [token for token in tokens if re.fullmatch(r"\W*\d{1,3}:\d\d\W*", token)]
    form = re.sub(r"(.)\1", r"\1", (name.unit or "").casefold())
    if pairs and form == "h:m":
        return 60.0
    if pairs and form != "m:s" and max(int(pair.strip('" ').partition(":")[0]) for pair in pairs) < 24:
        text = f"stamps such as {pairs[0]!r} in column {name.raw!r} were taken as minutes and seconds; call the column "
        remarks.append(Finding("unit_by_context", "warning", f"{text}'{name.name} [h:mm]' where they are not"))
    return 1.0


def _fields(source: Source, lines: Sequence[tuple[int, str]], head: Head, quoted: bool) -> npt.NDArray[np.intp]:
    """Return how many fields each line holds; one that holds more than the header names is an error."""
    names, delimiter = len(head.header.names), head.delimiter
    counts = np.empty(len(lines), dtype=np.intp)
    for i, (number, line) in enumerate(lines):
        if quoted and '"' in line:
            fields = split(line, delimiter)
        elif delimiter != BLANKS and (count := line.count(delimiter) + 1) <= names:
            counts[i] = count
            continue
        else:
            fields = line.split() if delimiter == BLANKS else [field.strip() for field in line.split(delimiter)]
        counts[i] = len(fields)
        if any(fields[names:]):
            raise source.error(
                f"line {number} holds {len(fields)} fields where the header names {names} columns; as many were "
                "expected; repair the line"
            )
    return counts


def _parsed(
    source: Source, block: str, first_line: int, delimiter: str, decimal: str, width: int, quoted: bool
) -> pd.DataFrame:
    import pandas as pd

    with warnings.catch_warnings():
        # of a long first row pandas drops the end, and only warns of it
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            frame: pd.DataFrame = pd.read_csv(
                io.StringIO(block),
                sep=delimiter,
                header=None,
                names=list(range(width)),
                index_col=False,
                decimal=decimal,
                na_values=_MISSING,
                skipinitialspace=True,
                low_memory=False,
                quoting=csv.QUOTE_MINIMAL if quoted else csv.QUOTE_NONE,
                engine="c",
            )
        except pd.errors.EmptyDataError:
            return pd.DataFrame({index: pd.Series(dtype=np.float64) for index in range(width)})
        except (ValueError, OverflowError, pd.errors.ParserWarning) as error:
            reason = " ".join(str(error).split())
            raise source.error(
                f"below line {first_line - 1} rows cannot be separated ({reason:.80}); rows as the header has them "
                "were expected; repair the log or export again"
            ) from error
    return frame


def _without_statistics(frame: pd.DataFrame, head: Head, above: Above, remarks: list[Finding]) -> pd.DataFrame:
    """Leave out the rows at the end whose time, or first field, is a word below numbers: mean, deviation, maximum."""
    for index in sorted({0, head.header.roles.get("time", 0)}):
        if frame[index].dtype.kind in "fiu":
            continue
        tokens = ["" if isinstance(token, float) else str(token).strip('" ') for token in frame[index].tolist()]
        rows = len(tokens)
        while rows and tokens[rows - 1][:1].isalpha() and tokens[rows - 1].lower() not in MISSING:
            rows -= 1
        named = tokens[rows:]
        numbers_above = index in above.numeric or any(token[:1].isdigit() for token in tokens[:rows])
        if named and len(set(named)) == len(named) and numbers_above:
            text = f"{len(named)} row(s) named {shown(named, most=4)} below the numbers were left out"
            remarks.append(Finding("statistics_below", "info", text))
            return frame.iloc[:rows]
    return frame


def _columns_of_units(source: Source, frame: pd.DataFrame, head: Head) -> dict[int, int]:
    """Return the columns that hold a unit in each row, and the column of numbers before each that it is the unit of."""
    pairs: dict[int, int] = {}
    names, roles = head.header.names, {index: role for role, index in head.header.roles.items()}
    before: list[int] = []
    for index in range(min(len(names), frame.shape[1])):
        column = frame[index]
        cells = set() if column.dtype.kind in "fiu" else {w for w in column.tolist() if isinstance(w, str)}
        units = {unit_word(word.strip("[]() ")) or "" for word in cells}
        kinds = {kind_of(unit) if unit else None for unit in units}
        if len(kinds) != 1 or None in kinds or index in roles:
            before.append(index)
            continue
        left = before[-1:] if before and before[-1] == index - 1 else []
        bare = [i for i in before if names[i].unit is None and KIND.get(roles.get(i, ""), *kinds) in kinds]
        bare = [i for i in bare if i in roles] or bare[-1:]
        of = [i for i in left if names[i].raw == str(i + 1)] or bare
        if len(of) == 1:
            pairs[index] = of[0]
        elif len(units) > 1 or any(names[i].unit and units != {names[i].unit} for i in left if i in roles):
            which = shown((names[i].raw for i in (bare or left)), most=4)
            raise source.error(
                f"column {names[index].raw!r} holds units ({', '.join(sorted(units))}) where the unit of {which} is "
                "not clear; one column without a unit was expected before it; export with the unit in the header"
            )
        before = []
    return pairs


def _in_first_unit(
    values: FloatArray, units: Sequence[str], above: Sequence[str]
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return numbers (n,), each in a unit of its own, in the first of these, NaN where none stands; and all units."""
    every = tuple(dict.fromkeys((*above, *(unit for unit in units if unit))))
    si = SI_UNIT[kind_of(every[0]) or ""]
    scales = {unit: factor(unit, si) / factor(every[0], si) if unit != every[0] else 1.0 for unit in every}
    return values * np.array([scales.get(unit, np.nan) for unit in units]), every


def _of_cells(tokens: Sequence[str], decimal: str, above: Sequence[str]) -> tuple[FloatArray, tuple[str, ...]] | None:
    """Return the numbers of cells that hold their unit (8.84 N), in the first unit, and all units; None else."""
    filled = [token.strip().lower() not in MISSING for token in tokens]
    if not any(filled) or split_cell(tokens[filled.index(True)]) is None:
        return None
    cells = [split_cell(token) if present else ("nan", "") for token, present in zip(tokens, filled, strict=True)]
    numbers = [None if cell is None else to_number(cell[0], decimal) for cell in cells]
    units = ["" if cell is None else cell[1] for cell in cells]
    if None in numbers or len({kind_of(unit) for unit in (*above, *units) if unit} - {None}) != 1:
        return None
    return _in_first_unit(np.array(numbers, dtype=np.float64), units, above)


def _slow_column(
    source: Source,
    tokens: Sequence[str],
    index: int,
    head: Head,
    decimal: str,
    first_line: int,
    numeric: bool,
) -> tuple[FloatArray | None, list[Finding]]:
    """Read a column that is not all numbers: words become NaN; None where it is one of words, an error where many."""
    parsed = [to_number(token, decimal) for token in tokens]
    bad = np.array([value is None for value in parsed])
    name, row = head.header.names[index].raw, int(np.argmax(bad))
    needed, mostly = index in head.header.roles.values(), bool(bad.sum() * 2 > bad.size)
    if mostly and not needed and not numeric:
        text = f"column {name!r} holds no numbers (such as {tokens[row]!r:.40}); left out"
        return None, [Finding("column_of_words", "info", text)]
    if mostly and needed and (not numeric or bad.sum() > LONGEST_GAP):
        unit = unit_word(tokens[row])
        if unit and all(unit_word(token) for token in tokens[row : row + LONGEST_GAP]):
            raise source.error(
                f"column {name!r} holds the word {tokens[row]!r:.40} behind the numbers of the column before it; a "
                f"column of numbers was expected; name that one, which is read in {unit} unless --units "
                'says otherwise, and where no column is the time give --rate, such as "4 Hz"'
            )
        mark = " with a decimal comma" if decimal == "," else ""
        raise source.error(
            f"column {name!r} holds {tokens[row]!r:.40} near line {first_line + row} and more like it; numbers{mark} "
            "were expected; repair the log, or name another column with --columns"
        )
    text = f"column {name!r} holds {tokens[row]!r:.40} near line {first_line + row} instead of a number "
    notes = [Finding("text_in_rows", "warning", text + f"({int(bad.sum())} such there)")] if bad.any() else []
    return np.array([np.nan if value is None else value for value in parsed], dtype=np.float64), notes
