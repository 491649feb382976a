"""The rest of a long file handed to pandas by its path: from version 3.1 on pandas reads it in several threads."""

import mmap
from typing import Final

from data_io.layout import Head
from data_io.rows import Numbers, read_path
from data_io.segments import Lines, is_clean
from data_io.source import Source
from data_io.text import BLANKS

LEAST: Final = 1 << 23
"""Bytes of the shortest rest that is worth it; pandas begins to use threads at 5 MiB."""
MOST: Final = 1 << 30
"""Bytes of the longest: pandas holds all columns twice, and nobody hears how far it is."""
_LOOK: Final = 1 << 18
"""Bytes looked at first: where words stand in every row, nothing is tried."""
_NEWLINE: Final = ord("\n")


def read_rest(source: Source, lines: Lines, head: Head, decimal: str | None) -> Numbers | None:
    """Read all rows that follow, with all columns; None, and nothing is taken from `lines`, where that cannot be done.

    It is tried once in a file: words would be found again by reading up to them, each time from the top.

    It is done in a file that is not packed and ends with a line end, if only rows of numbers follow, each with the
    fields of the header: pandas refuses anything else. decimal: the mark as far as the rows above tell.
    """
    start, size = lines.here, source.size
    by_itself = source.packing is None and source.held is None and lines.may_run
    if lines.tried_by_path or not by_itself or head.delimiter == BLANKS or not LEAST <= size - start <= MOST:
        return None
    lines.tried_by_path = True
    with source.open() as handle, mmap.mmap(handle.fileno(), 0, access=mmap.ACCESS_READ) as file:
        if len(file) != size or file[-1] != _NEWLINE or not _same_lines(file[:start], lines.line - 1):
            return None
        if not is_clean(file[start : start + _LOOK]):
            return None
    numbers = read_path(source.path, lines.line - 1, head, decimal)
    if numbers is None:
        return None
    lines.skip_rest(numbers.rows)
    return numbers


def _same_lines(top: bytes, lines: int) -> bool:
    """Tell whether pandas, which counts lines by their newlines, skips what lies above and nothing else."""
    return top.count(b"\n") == lines and top.count(b"\r") == top.count(b"\r\n")
