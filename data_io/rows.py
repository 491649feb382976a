"""A block of delimited rows to float64 columns: pandas' C parser on the fast path, field by field on the slow one."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from data_io.columns import KIND, role_of, shown
from data_io.layout import Head, decimal_mark, without_cut_row
from data_io.source import Source
from data_io.text import BLANKS, MISSING, clock_times, split, to_number
from data_io.units import SI_UNIT, factor, kind_of, split_cell, unit_word
from data_io.values import LONGEST_GAP, Finding, FloatArray

if TYPE_CHECKING:
    import pandas as pd

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


class _Bytes:
    """Bytes as a file that pandas reads. It is no binary file by type: pandas would decode its bytes, and encode them
    again for the parser, which takes longer than parsing."""

    def __init__(self, raw: bytes) -> None:
        self._raw = raw

    def __iter__(self) -> _Bytes:
        return self

    def __next__(self) -> bytes:
        raise StopIteration

    def read(self, _size: int = -1) -> bytes:
        """Return all of them at once."""
        raw, self._raw = self._raw, b""
        return raw


def read_block(raw: bytes, head: Head, decimal: str | None, wanted: Set[int] | None) -> Numbers | None:
    """Read whole lines of pure numbers at the speed of pandas; None where a row is short, long or holds something else.

    decimal: the mark as far as the rows above tell; wanted: columns to read (None: all). Blanks in front of numbers
    need no option of pandas, which would cost a quarter of the time.
    """
    import pandas as pd

    if decimal is None and head.delimiter != "," and b"," in raw:
        return None
    names = len(head.header.names)
    use = None
    if wanted is not None and head.delimiter != BLANKS:
        # pandas would not notice a long row among chosen columns; the last one and the count of delimiters tell
        use = sorted({*(index for index in wanted if index < names), names - 1})
    try:
        frame: pd.DataFrame = pd.read_csv(
            cast(Any, _Bytes(raw)),
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
        return None
    # by its own first row pandas tells how many fields there are
    whole = (
        frame.shape[1] == head.width
        if use is None
        else raw.count(head.delimiter.encode()) == (head.width - 1) * len(frame)
    )
    if not whole:
        return None
    columns = {index: frame[index].to_numpy() for index in map(int, frame.columns) if index < names}
    told = "." if head.delimiter != "," and b"." in raw else None
    return Numbers(columns, len(frame), decimal=decimal or told, fields=head.width if len(frame) else None)


def read_numbers(source: Source, block: str, first_line: int, head: Head, above: Above) -> Numbers:
    """Read the rows of a block. Where the log ends with it, its last row may be cut off.

    Raises the source's `LogError` where rows do not fit the header or a column with a role holds words.
    """
    remarks: list[Finding] = []
    if above.ending is not None and not block.endswith("\n"):
        block, remarks = without_cut_row(block, above.ending, head)
    decimal = above.decimal or decimal_mark(source, block, head)
    mark = decimal or ("," if head.delimiter != "," and "," in block else ".")
    frame = _parse(source, block, first_line, head, mark)
    names = head.header.names
    if frame.empty:
        return Numbers({}, 0, tuple(remarks), decimal)
    frame, usual = _without_short_rows(block, first_line, head, frame, remarks, above.fields)
    frame = _without_statistics(frame, head, above, remarks)
    if frame.empty:
        return Numbers({}, 0, tuple(remarks), decimal, usual)
    extra = frame.iloc[:, len(names) :].notna().to_numpy().any(axis=1)
    if extra.any():
        raise source.error(
            f"row {int(np.argmax(extra)) + 1} below line {first_line - 1} holds more fields than the header names "
            f"({len(names)}); as many were expected; repair the log"
        )
    columns: dict[int, FloatArray] = {}
    days: dict[int, FloatArray | None] = {}
    units: dict[int, tuple[str, ...]] = {}
    beside = _columns_of_units(source, frame, head)
    for index in range(min(len(names), frame.shape[1])):
        column = frame[index]
        if index in beside:
            continue
        if column.dtype.kind in "fiu":
            columns[index] = column.to_numpy(dtype=np.float64)
            continue
        if role_of(names[index].name) == "time" or head.header.roles.get("time") == index:
            stamps = clock_times(["" if isinstance(token, float) else token for token in column.tolist()])
            if stamps is not None:
                columns[index], days[index] = stamps
                continue
        if (with_unit := _with_units(column, mark, above.units.get(index, ()))) is not None:
            columns[index], units[index] = with_unit
            continue
        words_only = index not in above.numeric
        values = _slow_column(source, column, index, head, mark, first_line, remarks, words_only)
        if values is not None:
            columns[index] = values
    for place, index in beside.items():
        if index in columns:
            words = ("" if isinstance(word, float) else word for word in frame[place].tolist())
            told = [unit_word(word.strip("[]() ")) or "" for word in words]
            columns[index], units[index] = _in_first_unit(columns[index], told, above.units.get(index, ()))
    return Numbers(columns, len(frame), tuple(remarks), decimal, usual, days, units)


def _without_statistics(frame: pd.DataFrame, head: Head, above: Above, remarks: list[Finding]) -> pd.DataFrame:
    """Leave out the rows at the end whose time, or first field, is a word below numbers: mean, deviation, maximum."""
    for index in sorted({0, head.header.roles.get("time", 0)}):
        if frame[index].dtype.kind in "fiu":
            continue
        tokens = ["" if isinstance(token, float) else str(token).strip('" ') for token in frame[index].tolist()]
        named = [token[:1].isalpha() and token.lower() not in MISSING for token in tokens]
        rows = len(named) - (named[::-1].index(False) if False in named else len(named))
        distinct = len(set(tokens[rows:])) == len(named) - rows
        if (
            distinct
            and rows < len(named)
            and (index in above.numeric or any(token[:1].isdigit() for token in tokens[:rows]))
        ):
            text = f"{len(named) - rows} row(s) named {shown(tokens[rows:], most=4)} below the numbers were left out"
            remarks.append(Finding("statistics_below", "info", text))
            return frame.iloc[:rows]
    return frame


def _columns_of_units(source: Source, frame: pd.DataFrame, head: Head) -> dict[int, int]:
    """Return the columns that hold a unit in each row, and the column of numbers that each of them is the unit of.

    That is the only one without a unit of its own between it and the column of units before it. Raises the source's
    `LogError` where units change and it is not clear of which column.
    """
    found: dict[int, int] = {}
    names, roles = head.header.names, {index: role for role, index in head.header.roles.items()}
    before: list[int] = []
    for index in range(min(len(names), frame.shape[1])):
        kinds, told = _units_in(frame[index])
        if len(kinds) != 1 or index in roles:
            before.append(index)
            continue
        (kind,) = kinds
        left = before[-1:] if before and before[-1] == index - 1 else []
        bare = [i for i in before if names[i].unit is None and KIND.get(roles.get(i, ""), kind) == kind]
        bare = [i for i in bare if i in roles] or bare[-1:]
        numbered = [i for i in left if names[i].raw == str(i + 1)]
        of = numbered or bare
        if len(of) == 1:
            found[index] = of[0]
        elif len(told) > 1 or any(names[i].unit and told != {names[i].unit} for i in left if i in roles):
            which = shown((names[i].raw for i in (bare or left)), most=4)
            raise source.error(
                f"column {names[index].raw!r} holds units ({', '.join(sorted(told))}) where the unit of {which} is "
                "not clear; one column without a unit was expected before it; export with the unit in the header"
            )
        before = []
    return found


def _units_in(column: pd.Series[Any]) -> tuple[set[str | None], set[str]]:
    """Return the kinds of the units that a column holds, and these; nothing where it holds anything else."""
    if column.dtype.kind in "fiu":
        return set(), set()
    units = {unit_word(word.strip("[]() ")) for word in set(column.tolist()) if isinstance(word, str)}
    if not units or None in units:
        return set(), set()
    return {kind_of(unit or "") for unit in units}, {unit or "" for unit in units}


def _in_first_unit(values: FloatArray, told: Sequence[str], above: Sequence[str]) -> tuple[FloatArray, tuple[str, ...]]:
    """Return numbers (n,), each in a unit of its own, in the first of these units, NaN where none is told; and all
    units. above: those of the rows above."""
    units = tuple(dict.fromkeys((*above, *(unit for unit in told if unit))))
    si = SI_UNIT[kind_of(units[0]) or ""]
    scales = {unit: factor(unit, si) / factor(units[0], si) if unit != units[0] else 1.0 for unit in units}
    return values * np.array([scales.get(unit, np.nan) for unit in told]), units


def _without_short_rows(
    block: str, first_line: int, head: Head, frame: pd.DataFrame, remarks: list[Finding], usual: int | None
) -> tuple[pd.DataFrame, int | None]:
    """Empty the rows that lack fields: nobody knows which ones, so every number in them may stand in a wrong column.

    Returns the usual number of fields as well: that of the rows above, else that of most rows here.
    """
    rows = [(i, line) for i, line in enumerate(block.split("\n")) if line.strip(_BLANK)]
    if len(rows) != len(frame):
        return frame, usual
    fields = np.array([_fields(line, head.delimiter) for _, line in rows], dtype=np.intp)
    if usual is None:
        usual = int(np.bincount(fields).argmax()) if fields.size else 0
    lacking = fields < min(usual, head.width)
    if usual > head.width:  # rows end with a delimiter: one that does so a field early lacks one, too
        lacking |= (fields < usual) & [line.rstrip("\r\n ").endswith(head.delimiter) for _, line in rows]
    short = np.flatnonzero(lacking)
    if not short.size:
        return frame, usual
    frame = frame.copy()
    frame.iloc[short, :] = np.nan
    offset, line = rows[short[0]]
    text = f"line {first_line + offset} holds {fields[short[0]]} fields where the others hold {usual} ({line!r:.60}); "
    remarks.append(Finding("short_rows", "warning", text + f"{short.size} such row(s) were left empty"))
    return frame, usual


def _fields(line: str, delimiter: str) -> int:
    if '"' in line:
        return len(split(line, delimiter))
    return len(line.split()) if delimiter == BLANKS else line.count(delimiter) + 1


def _parse(source: Source, block: str, first_line: int, head: Head, decimal: str) -> pd.DataFrame:
    width = max(head.width, len(head.header.names))
    quoted = _quotes_close(block)
    try:
        return _pandas(block, head, decimal, width, quoted)
    except (ValueError, OverflowError):
        widest = _widest(source, block, first_line, head)
    try:
        return _pandas(block, head, decimal, max(widest, width), quoted=False)
    except (ValueError, OverflowError) as error:
        seen = re.search(r"line (\d+), saw (\d+)", str(error))
        where = f"line {first_line + int(seen[1]) - 1} holds {seen[2]} fields" if seen else "rows cannot be told apart"
        raise source.error(
            f"below line {first_line - 1} {where}; rows of {len(head.header.names)} columns, as the header has them, "
            "were expected; repair the log or export again"
        ) from error


def _pandas(block: str, head: Head, decimal: str, width: int, quoted: bool) -> pd.DataFrame:
    import pandas as pd

    with warnings.catch_warnings():
        # of a long first row pandas drops the end, and only warns of it
        warnings.simplefilter("error", pd.errors.ParserWarning)
        try:
            frame: pd.DataFrame = pd.read_csv(
                io.StringIO(block),
                sep=head.delimiter,
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
        except pd.errors.ParserWarning as warning:
            raise ValueError(str(warning)) from warning
    return frame


def _quotes_close(block: str) -> bool:
    """Tell whether fields are quoted, each on its own line; an open quote would swallow the rows up to the next one."""
    return '"' in block and all(line.count('"') % 2 == 0 for line in block.split("\n"))


def _widest(source: Source, block: str, first_line: int, head: Head) -> int:
    """Return the largest number of fields of a row; names the row that holds more than the header names."""
    widest = 0
    for offset, line in enumerate(block.split("\n")):
        # as the parser does without quoting: every delimiter separates
        fields = line.split() if head.delimiter == BLANKS else [part.strip() for part in line.split(head.delimiter)]
        if any(fields[len(head.header.names) :]):
            raise source.error(
                f"line {first_line + offset} holds {len(fields)} fields where the header names "
                f"{len(head.header.names)} columns; as many were expected; repair the line"
            )
        widest = max(widest, len(fields))
    return widest


def _with_units(
    column: pd.Series[Any], decimal: str, above: Sequence[str]
) -> tuple[FloatArray, tuple[str, ...]] | None:
    """Return the numbers of cells that hold their unit (8.84 N), in the first unit, and all units.

    above: those of the rows above. None where a cell holds something else.
    """
    tokens = ["" if isinstance(token, float) else str(token) for token in column.tolist()]
    first = next((token for token in tokens if token.strip().lower() not in MISSING), "")
    if split_cell(first) is None:
        return None
    cells = [split_cell(token) for token in tokens]
    numbers = [None if cell is None else to_number(cell[0], decimal) for cell in cells]
    missing = [cell is None and token.strip().lower() in MISSING for cell, token in zip(cells, tokens, strict=True)]
    if not all(gap or number is not None for gap, number in zip(missing, numbers, strict=True)):
        return None
    told = ["" if cell is None else cell[1] for cell in cells]
    if len({kind_of(unit) for unit in (*above, *told) if unit} - {None}) != 1:
        return None
    return _in_first_unit(np.array([np.nan if n is None else n for n in numbers]), told, above)


def _slow_column(
    source: Source,
    column: pd.Series[Any],
    index: int,
    head: Head,
    decimal: str,
    first_line: int,
    remarks: list[Finding],
    words_only: bool,
) -> FloatArray | None:
    """Read a column that is not all numbers: words become NaN with a remark; words in long blocks are an error.

    words_only: whether it may be a column of words, which is left out.
    """
    tokens: list[Any] = column.tolist()
    parsed = [token if isinstance(token, float) else to_number(str(token), decimal) for token in tokens]
    bad = np.array([value is None for value in parsed])
    name = head.header.names[index].raw
    needed = index in head.header.roles.values()
    if words_only and not needed and bad.sum() * 2 > bad.size:
        text = f"column {name!r} holds no numbers (such as {tokens[int(np.argmax(bad))]!r:.40}); left out"
        remarks.append(Finding("column_of_words", "info", text))
        return None
    row = int(np.argmax(bad))
    if needed and bad.sum() * 2 > bad.size and (words_only or bad.sum() > LONGEST_GAP):
        unit = unit_word(str(tokens[row]))
        if unit and all(unit_word(str(token)) for token in tokens[row : row + LONGEST_GAP]):
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
    if bad.any():
        text = f"column {name!r} holds {tokens[row]!r:.40} near line {first_line + row} instead of a number "
        remarks.append(Finding("text_in_rows", "warning", text + f"({int(bad.sum())} such there)"))
    return np.array([np.nan if value is None else value for value in parsed], dtype=np.float64)
