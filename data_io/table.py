"""Tables of numbers inside a text: header rows, the blocks below them, and the text that stands between."""

import re
from collections.abc import Sequence

from data_io.by_path import read_rest
from data_io.layout import Head
from data_io.opened_table import OpenTable, Table, wanted_columns
from data_io.rows import read_run
from data_io.segments import BLOCK, FIRST, Lines, Segment
from data_io.source import Request, Source
from data_io.text import BLANKS
from data_io.walk import Walk


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
    while not lines.at_end:
        if not _read_fast(walk, lines):
            lines.hand_back(walk.take(lines.segment()))
    return walk.finish()


def _read_fast(walk: Walk, lines: Lines) -> bool:
    """Read the rows that follow as one run of numbers; False where words come first, or nothing tells their columns."""
    table = walk.table
    if table is None or walk.carry or not lines.may_run:
        return False
    if table.wanted is None and (rest := read_rest(walk.source, lines, table.head, table.decimal)) is not None:
        table.add(rest)
        return True
    run = lines.run(table.head.delimiter, table.wanted is not None and table.head.delimiter != BLANKS)
    if run.empty:
        run.finish(0)
        lines.size = BLOCK  # words in every row: fewer calls of pandas
        return False
    numbers = read_run(run, table.head, table.decimal, table.wanted)
    if numbers is None:
        lines.go_back(run)
        lines.size = BLOCK
        return False
    run.finish(numbers.rows)
    table.add(numbers)
    lines.size = FIRST
    return True
