"""The last row of a log that does not end its last line: whole, or cut off in the middle of a number?"""

from collections.abc import Sequence
from typing import Final

from data_io.frozen import Finding
from data_io.layout import Head
from data_io.text import split

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
