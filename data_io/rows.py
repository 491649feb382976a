"""A block of delimited rows to float64 columns: pandas' C parser on the fast path, field by field on the slow one."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from data_io.columns import role_of
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
    hold them. Columns
    without numbers are absent.
    """

    columns: dict[int, FloatArray]
    rows: int
    remarks: tuple[Finding, ...] = ()
    decimal: str | None = None
    fields: int | None = None
    days: Mapping[int, FloatArray | None] = field(default_factory=dict)
    units: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Above:
    """What the rows above tell: decimal mark, usual number of fields (None: not told), columns that held numbers, and
    of a log that ends with the rows to read those right above them as text (None: the log goes on)."""

    decimal: str | None = None
    fields: int | None = None
    numeric: Set[int] = frozenset()
    ending: str | None = None


@cache
def _exact() -> dict[str, Any]:
    """pandas rounds every number correctly by default since 3.1 and warns about the option since."""
    import pandas as pd

    rounds = tuple(int(part) for part in pd.__version__.split(".")[:2]) >= (3, 1)
    return {} if rounds else {"float_precision": "round_trip"}


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
            **_exact(),
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
    columns = {index: _own(frame, index) for index in map(int, frame.columns) if index < names}
    told = "." if head.delimiter != "," and b"." in raw else None
    return Numbers(columns, len(frame), decimal=decimal or told, fields=head.width if len(frame) else None)


def _own(frame: pd.DataFrame, index: int) -> FloatArray:
    """Return a column of a frame that nobody else has, to be written to; pandas hands out what is read-only."""
    values: FloatArray = frame[index].to_numpy()
    try:
        values.flags.writeable = True
    except ValueError:
        return values.copy()
    return values


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
    extra = frame.iloc[:, len(names) :].notna().to_numpy().any(axis=1)
    if extra.any():
        raise source.error(
            f"row {int(np.argmax(extra)) + 1} below line {first_line - 1} holds more fields than the header names "
            f"({len(names)}); as many were expected; repair the log"
        )
    columns: dict[int, FloatArray] = {}
    days: dict[int, FloatArray | None] = {}
    units: dict[int, str] = {}
    for index in range(min(len(names), frame.shape[1])):
        column = frame[index]
        if column.dtype.kind in "fiu":
            columns[index] = column.to_numpy(dtype=np.float64)
            continue
        if role_of(names[index].name) == "time" or head.header.roles.get("time") == index:
            stamps = clock_times(["" if isinstance(token, float) else token for token in column.tolist()])
            if stamps is not None:
                columns[index], days[index] = stamps
                continue
        if (with_unit := _with_units(column, mark)) is not None:
            columns[index], units[index] = with_unit
            continue
        words_only = index not in above.numeric
        values = _slow_column(source, column, index, head, mark, first_line, remarks, words_only)
        if values is not None:
            columns[index] = values
    return Numbers(columns, len(frame), tuple(remarks), decimal, usual, days, units)


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
                **_exact(),
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


def _with_units(column: pd.Series[Any], decimal: str) -> tuple[FloatArray, str] | None:
    """Return the numbers of cells that hold their unit (8.84 N), in the unit of the first one, and that unit.

    None where a cell holds something else.
    """
    tokens = ["" if isinstance(token, float) else str(token) for token in column.tolist()]
    first = next((cell for token in tokens if token and (cell := split_cell(token))), None)
    if first is None:
        return None
    unit, kind = first[1], kind_of(first[1])
    values = np.full(len(tokens), np.nan)
    for i, token in enumerate(tokens):
        cell = split_cell(token)
        number = None if cell is None else to_number(cell[0], decimal)
        if cell is None and token.strip().lower() in MISSING:
            continue
        if cell is None or number is None or kind is None or kind_of(cell[1]) != kind:
            return None
        si = SI_UNIT[kind]
        values[i] = number if cell[1] == unit else number * factor(cell[1], si) / factor(unit, si)
    return values, unit


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
    if needed and bad.sum() * 2 > bad.size:
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
