"""A block of delimited rows to float64 columns: pandas' C parser on the fast path, field by field on the slow one."""

import csv
import io
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from data_io.frozen import LONGEST_GAP, FloatArray
from data_io.layout import Head
from data_io.source import Source
from data_io.text import BLANKS, split, to_number

# pandas rounds every number correctly by default since 3.1 and warns about the option since
_EXACT: Final[dict[str, Any]] = (
    {} if tuple(int(part) for part in pd.__version__.split(".")[:2]) >= (3, 1) else {"float_precision": "round_trip"}
)
_MISSING: Final = ["-", "--", "---", "1.#INF", "-1.#INF"]


@dataclass(frozen=True)
class Numbers:
    """Columns by index, each (n,), and remarks on what was not a number. Columns without numbers are absent."""

    columns: dict[int, FloatArray]
    remarks: tuple[str, ...]


def read_numbers(source: Source, block: str, first_line: int, head: Head, at_end: bool) -> Numbers:
    """Read the rows of a block; `at_end` says that the file ends with it, so that its last row may be cut off.

    Raises the source's `LogError` where rows do not fit the header or a column with a role holds words.
    """
    remarks: list[str] = []
    if at_end and not block.endswith("\n"):
        block, cut = _without_cut_row(block, head)
        if cut:
            remarks.append(f"the last row ({cut!r:.60}) is cut off and was left out")
    decimal = _decimal(block, head)
    frame = _parse(source, block, first_line, head, decimal)
    names = head.header.names
    if frame.iloc[-1:].isna().to_numpy().all():  # rows of delimiters only, as spreadsheets leave them at the end
        filled = np.flatnonzero(frame.notna().to_numpy().any(axis=1))
        frame = frame.iloc[: filled[-1] + 1] if filled.size else frame.iloc[:0]
    extra = frame.iloc[:, len(names) :].notna().to_numpy().any(axis=1)
    if extra.any():
        raise source.error(
            f"row {int(np.argmax(extra)) + 1} below line {first_line - 1} holds more fields than the header names "
            f"({len(names)}); as many were expected; repair the log"
        )
    if frame.empty:
        return Numbers({index: np.empty(0) for index in range(len(names))}, tuple(remarks))
    columns: dict[int, FloatArray] = {}
    for index in range(min(len(names), frame.shape[1])):
        column = frame[index]
        if column.dtype.kind in "fiu":
            columns[index] = column.to_numpy(dtype=np.float64)
            continue
        values = _slow_column(source, column, index, head, decimal, first_line, remarks)
        if values is not None:
            columns[index] = values
    return Numbers(columns, tuple(remarks))


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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pd.errors.ParserWarning)
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
                **_EXACT,
            )
        except pd.errors.EmptyDataError:
            return pd.DataFrame({index: pd.Series(dtype=np.float64) for index in range(width)})
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


def _without_cut_row(block: str, head: Head) -> tuple[str, str]:
    start = block.rfind("\n") + 1
    last = block[start:]
    short = last.strip() and len(split(last, head.delimiter)) < len(head.header.names)
    return (block[:start], last) if short else (block, "")


def _decimal(block: str, head: Head) -> str:
    """Return the decimal mark: a comma only where it does not delimit, decided by the columns that have a role."""
    if head.delimiter == "," or "," not in block:
        return "."
    for line in block[:5000].split("\n")[:-1]:
        fields = split(line, head.delimiter)
        text = "".join(fields[i] for i in head.header.roles.values() if i < len(fields))
        if "," in text or "." in text:
            return "," if "," in text else "."
    return ","


def _slow_column(
    source: Source, column: "pd.Series[Any]", index: int, head: Head, decimal: str, first_line: int, remarks: list[str]
) -> FloatArray | None:
    """Read a column that is not all numbers: words become NaN with a remark; words in long blocks are an error."""
    tokens: list[Any] = column.tolist()
    parsed = [token if isinstance(token, float) else to_number(str(token), decimal) for token in tokens]
    bad = np.array([value is None for value in parsed])
    name = head.header.names[index].raw
    needed = index in head.header.roles.values()
    if not needed and bad.sum() * 2 > bad.size:
        remarks.append(f"column {name!r} holds no numbers (such as {tokens[int(np.argmax(bad))]!r:.40}); left out")
        return None
    row = int(np.argmax(bad))
    if needed and longest_run(bad) > LONGEST_GAP:
        mark = " with a decimal comma" if decimal == "," else ""
        raise source.error(
            f"column {name!r} holds {tokens[row]!r:.40} near line {first_line + row} and more like it; numbers{mark} "
            "were expected; repair or cut the log, or name another column"
        )
    if bad.any():
        remarks.append(
            f"column {name!r} holds {tokens[row]!r:.40} near line {first_line + row} instead of a number "
            f"({int(bad.sum())} such in all)"
        )
    return np.array([np.nan if value is None else value for value in parsed], dtype=np.float64)


def longest_run(flags: Sequence[bool] | np.ndarray[Any, Any]) -> int:
    """Return the length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], np.asarray(flags, dtype=np.int8), [0]))))
    return int(np.max(edges[1::2] - edges[::2], initial=0))
