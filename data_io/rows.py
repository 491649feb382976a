"""A block of delimited rows to float64 columns: pandas' C parser on the fast path, field by field on the slow one."""

from __future__ import annotations

import csv
import io
import warnings
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
import numpy.typing as npt

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

    def __iter__(self) -> Iterator[bytes]:
        return iter(())

    def read(self, _size: int = -1) -> bytes:
        """Return all of them at once, then nothing."""
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
            low_memory=False,  # a block is parsed in one piece, a fifth faster
            quoting=csv.QUOTE_NONE,
            engine="c",
        )
    except (ValueError, OverflowError):
        return None
    # by its own first row pandas tells how many fields there are
    whole = (
        frame.shape[1] == head.width
        if use is None
        else np.count_nonzero(np.frombuffer(raw, np.uint8) == ord(head.delimiter)) == (head.width - 1) * len(frame)
    )
    if not whole:
        return None
    columns = {index: frame[index].to_numpy() for index in map(int, frame.columns) if index < names}
    point = "." if head.delimiter != "," and b"." in raw else None
    return Numbers(columns, len(frame), decimal=decimal or point, fields=head.width if len(frame) else None)


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
        elif (with_unit := _with_units(tokens, mark, above.units.get(index, ()))) is not None:
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


def _with_units(tokens: Sequence[str], decimal: str, above: Sequence[str]) -> tuple[FloatArray, tuple[str, ...]] | None:
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
