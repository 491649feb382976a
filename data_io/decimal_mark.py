"""The decimal mark of a block of rows: point or comma, and commas that may as well stand between thousands."""

import itertools
import re
from collections.abc import Iterator, Sequence
from typing import Final

from data_io.layout import Head
from data_io.source import Source
from data_io.text import split

_LOOKED_AT: Final = 200
"""Rows in which commas between thousands are looked for."""


def decimal_mark(source: Source, block: str, head: Head) -> str | None:
    """Return the decimal mark, None where nothing tells: a comma only where it does not delimit, by columns of a role.

    Raises the source's `LogError` where commas may as well stand between thousands.
    """
    if head.delimiter == "," or "," not in block:
        return None
    rows = _role_fields(block, head)
    first = list(itertools.islice(rows, _LOOKED_AT))
    telling = next((row for row in itertools.chain(first, rows) if any("," in f or "." in f for f in row)), None)
    if telling is None:
        return None
    if not any("," in field for field in telling):
        return "."
    for place, index in enumerate(head.header.roles.values()):
        _check_thousands(source, head.header.names[index].raw, [row[place] for row in first if place < len(row)])
    return ","


def _role_fields(block: str, head: Head) -> Iterator[list[str]]:
    roles = head.header.roles.values()
    for line in block.split("\n"):
        fields = split(line, head.delimiter)
        yield [fields[i] for i in roles if i < len(fields)]


def _check_thousands(source: Source, name: str, column: Sequence[str]) -> None:
    grouped = [field for field in column if re.fullmatch(r"[+-]?[1-9]\d{0,2}(,\d{3})+", field)]
    plain = [field for field in column if re.fullmatch(r"[+-]?\d{1,3}", field)]
    if grouped and plain and len(grouped) + len(plain) == len(column):
        raise source.error(
            f"column {name!r} holds {grouped[0]!r} and {plain[0]!r}; the comma may be a decimal mark or stand "
            "between thousands; export without thousands separators"
        )
