"""The decimal mark of a block of rows: point or comma, told from the other mark that may stand between thousands."""

import itertools
import re
from collections.abc import Iterator, Sequence
from typing import Final

from data_io.layout import Head
from data_io.source import Source
from data_io.text import split

_LOOKED_AT: Final = 200
"""Rows in which commas between thousands are looked for."""
_GROUPED: Final = r"[+-]?[1-9]\d{{0,2}}({}\d{{3}})+"
_COMMA_GROUPS: Final = re.compile(_GROUPED.format(","))
_POINT_GROUPS: Final = re.compile(_GROUPED.format(r"\."))


def decimal_mark(source: Source, block: str, head: Head) -> str | None:
    """Return the decimal mark, None where nothing tells: a comma only where it does not delimit, by columns of a role.

    Quotes protect a comma from delimiting. Of two marks in one number the last is the decimal one; of two kinds of
    numbers those that can be thousands are. Raises the source's `LogError` where commas may as well stand between
    thousands.
    """
    if "," not in block or (head.delimiter == "," and '"' not in block):
        return None
    rows = _role_fields(block, head)
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
    told = any(not _COMMA_GROUPS.fullmatch(field) for field in commas)
    for place, index in enumerate(head.header.roles.values()):
        column = [row[place] for row in first if place < len(row)]
        _check_thousands(source, head.header.names[index].raw, column, sure=told or head.delimiter != ",")
    return ","


def _role_fields(block: str, head: Head) -> Iterator[list[str]]:
    roles = head.header.roles.values()
    for line in block.split("\n"):
        fields = split(line, head.delimiter)
        yield [fields[i] if ":" not in fields[i] else "" for i in roles if i < len(fields)]  # no clock times


def _check_thousands(source: Source, name: str, column: Sequence[str], *, sure: bool) -> None:
    """Refuse a column of which every comma may stand between thousands; sure: others say it is the decimal mark."""
    grouped = [field for field in column if _COMMA_GROUPS.fullmatch(field)]
    plain = [field for field in column if re.fullmatch(r"[+-]?\d{1,3}", field)]
    if grouped and (plain or not sure) and len(grouped) + len(plain) == len([field for field in column if field]):
        raise source.error(
            f"column {name!r} holds {grouped[0]!r} and {(plain or grouped)[-1]!r}; the comma may be a decimal mark or "
            "stand between thousands; export without thousands separators"
        )
