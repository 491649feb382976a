"""Lines that a terminal has stamped with the time of their arrival: `14:03:22.117 -> 0.532,1.98`."""

import re
from typing import Final

from data_io.contents import Contents
from data_io.delimited import read_delimited
from data_io.layout import is_row
from data_io.source import Request, Source
from data_io.text import BLANKS, DELIMITERS, as_utf8, is_clock_time, looks_like_text, split

_LINE: Final = re.compile(r"(\[)?([\d:., T/-]{8,32}?)(?(1)\]| ?-?>) ?(?:-?> ?)?(.*)")
_STAMP: Final = re.compile(rb"(?:^|[\r\n])\[?[\d:., T/-]{8,32}?(?:\]| ?-?>) ")
_FEWEST: Final = 5
_SHARE: Final = 0.8


def is_stamped(head: bytes) -> bool:
    """Tell by lines that begin with a time of the day in square brackets or before an arrow."""
    if _STAMP.search(head) is None or not looks_like_text(head):
        return False
    lines = [line for line in as_utf8(head).decode().split("\n")[:100] if line.strip()]
    stamped = sum(_parted(line) is not None for line in lines)
    return stamped >= max(_FEWEST, _SHARE * len(lines))


def read_stamped(source: Source, request: Request) -> Contents:
    """Read what came over a serial line, as the monitors of Arduino, PlatformIO, minicom and tio save it. Raises
    `LogError`.

    Layout: `stamp -> words or numbers` or `[stamp] words or numbers` in every line; the stamp becomes the first column,
    called Time, and the rest is read as `read_delimited` reads it.
    Quirks: a greeting of the board above the names, or no names; a clock of the board beside the stamps is preferred to
    them, as it does not wait for the line.
    """
    lines = [(line, _parted(line)) for line in as_utf8(source.read()).decode().split("\n")]
    rests = (parted[1] for _, parted in lines if parted is not None)
    delimiter = next((d for rest in rests for d in DELIMITERS if len(f := split(rest, d)) > 1 and is_row(f)), ",")
    mark = " " if delimiter == BLANKS else delimiter
    text = "\n".join(line if parted is None else _joined(*parted, mark) for line, parted in lines)
    return read_delimited(source.of_text(text), request)


def _parted(line: str) -> tuple[str, str] | None:
    """Split a line into its stamp and the rest; None where it has no stamp."""
    match = _LINE.match(line)
    return (match[2], match[3].strip()) if match is not None and is_clock_time(match[2]) else None


def _joined(stamp: str, rest: str, mark: str) -> str:
    """Return a line with the stamp as its first field, which below words is called Time; "" where nothing follows."""
    if not rest:
        return ""
    stamp = stamp.replace(",", ".").replace(" ", "T") if mark in ", " else stamp
    numbers = any(is_row(split(rest, delimiter)) for delimiter in DELIMITERS)
    return f"{stamp if numbers else 'Time'}{mark}{rest}"
