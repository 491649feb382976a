"""Where a table of numbers begins and ends: its header and units, how its rows are delimited, its decimal mark."""

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from data_io.columns import KIND, Header, Name, match_header, shown
from data_io.source import Request, Source
from data_io.text import BLANKS, DELIMITERS, Text, is_clock_time, is_date, is_number, is_number_like, split, to_number
from data_io.units import kind_of, split_cell, unit_word
from data_io.values import Finding

WIDE: Final = r" {2,}|\t+"
"""Delimiter of a header whose names hold single blanks and stand apart by several."""
COMMENT: Final = re.compile(r"^\s*(?:#|%|//)+\s*")
DIGIT: Final = re.compile(r"\d")
_LOOK_AHEAD: Final = 6
_ROW_NAMES: Final = 20  # rows whose first fields are looked at for the names of rows
_LONGEST_HEADER: Final = 20000


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
    if len(line) > _LONGEST_HEADER:
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
    leads = clock is not None and all(is_number_like(field) or is_date(field) for field in filled[:clock])
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
        if len(between) > _LOOK_AHEAD:
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
    rows = [split(line, own) for _, line in itertools.islice(lines_from(data, start), _ROW_NAMES)]
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

_LOOKED_AT: Final = 200  # rows in which commas between thousands are looked for
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
    first = list(itertools.islice(rows, _LOOKED_AT))
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
    """Take the last row away if it may be cut off: too few fields, or a last number unlike those above.

    before: rows that stand above the block, whose own may be few.
    """
    start = block.rfind("\n") + 1
    last = block[start:]
    fields = split(last, head.delimiter)
    if not last.strip():
        return block, []
    if len(fields) < len(head.header.names):
        text = f"the last row ({last!r:.60}) is cut off and was left out"
        return block[:start], [Finding("last_row_cut", "warning", text)]
    lines = (before + block[:start])[-LOOKED_AT:].split("\n")[-6:-1]
    above = [split(line, head.delimiter) for line in lines]
    if len(fields) < head.width or any(_shape(row) != _shape(fields) for row in above if len(row) == len(fields)):
        text = f"the last row ({last!r:.60}) has no line end and may be cut off; it was left out"
        return block[:start], [Finding("last_row_cut", "warning", text)]
    text = "the last row has no line end, as if the file were cut there; it looks whole and was kept"
    return block, [Finding("last_row_open", "info", text)]


def _shape(fields: Sequence[str]) -> tuple[int, str]:
    """Return what a cut would change in a row: digits behind the last decimal mark, and the exponent's presence."""
    last = fields[-1].strip('"')
    mantissa, exponent, power = last.lower().partition("e")
    point = max(mantissa.rfind("."), mantissa.rfind(","))
    if last and point < 0 and not exponent:
        return -len(last), ""  # of an integer only the length tells
    return len(mantissa) - point if last else 0, exponent + "x" * len(power)
