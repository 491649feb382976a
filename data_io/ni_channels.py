"""National Instruments text with a head of pairs for each channel: `Channel name,"Force",Channel name,"Input 1"`."""

import re
from collections.abc import Sequence
from typing import Final

from data_io.clock import seconds_apart
from data_io.columns import Name, match_names
from data_io.even_clock import with_clocks_of_channels
from data_io.layout import Head, is_row, line_at
from data_io.part import Contents, Part
from data_io.segments import Lines, Segment
from data_io.source import Request, Source
from data_io.table import read_below
from data_io.text import looks_like_text, split, to_number

NAME: Final = "ni-channels"
_SIGN: Final = re.compile(rb"(?:^|[\r\n])\"?Channel name\"?([,;\t])", re.IGNORECASE)
_KEYS: Final = ("channel name", "unit", "interval", "timestamp")
_LONGEST_HEAD: Final = 50


def can_read(head: bytes) -> bool:
    """Tell by a line of channel names in pairs with their key."""
    return looks_like_text(head) and _SIGN.search(head) is not None


def read(source: Source, request: Request) -> Contents:
    """Read the channels that NI programmes write beside each other. Raises `LogError`.

    Layout: lines `Timestamp`, `Interval`, `Channel name`, `Unit`, each key once for every channel; rows with a time
    [s] before each value, or values alone at the interval. Signals are mostly in volts, which need a scale:
    `--columns friction_force=Force --units "friction_force=2.5 N/V"`.
    """
    found = _SIGN.search(source.head)
    assert found is not None
    delimiter = found[1].decode()
    with source.open() as handle:
        lines = Lines(source, request, handle)
        top = lines.segment()
        told, place, width = _head(source, top.text, delimiter)
        channels = told.get("channel name", [])
        if width not in (len(channels), 2 * len(channels)):
            raise source.error(
                f"rows of {width} fields were found below {len(channels)} channel names; one field for each, or a time "
                "and a value for each, were expected; export again"
            )
        names = _names(channels, told.get("unit", []), pairs=width == 2 * len(channels))
        head = Head(match_names(names, request.columns), place, delimiter, width)
        rest = Segment(top.text[place:].encode(), top.text.count("\n", 0, place) + 1, top.at_end)
        table = read_below(source, request, lines, rest, head)
    header, columns = head.header, dict(table.columns)
    starts = seconds_apart(told.get("timestamp", []))
    clocks: dict[int, int] = {}
    if width == 2 * len(channels):
        for channel, start in enumerate(starts):
            if start and 2 * channel in columns:
                columns[2 * channel] = columns[2 * channel] + start
    else:
        intervals = [to_number(field, ".") or 0.0 for field in told.get("interval", [])]
        header, columns, clocks = with_clocks_of_channels(header, columns, starts, intervals)
    about = {key: ", ".join(values) for key, values in told.items()}
    return Contents(NAME, [Part(1, 1, header, columns, clocks=clocks)], about, table.remarks)


def _head(source: Source, text: str, delimiter: str) -> tuple[dict[str, list[str]], int, int]:
    """Return what stands for each channel by key, where the rows begin, and their number of fields."""
    told: dict[str, list[str]] = {}
    position = 0
    for _ in range(_LONGEST_HEAD):
        line, after = line_at(text, position)
        fields = split(line, delimiter)
        if "channel name" in told and is_row(fields) and fields[0].lower() not in _KEYS:
            return told, position, len(fields)
        if fields and fields[0].strip('\ufeff"').lower() in _KEYS:
            told[fields[0].strip('\ufeff"').lower()] = fields[1::2]
        position = after
    raise source.error(
        f"no rows of numbers were found within {_LONGEST_HEAD} lines of channel names; they were expected; export again"
    )


def _names(channels: Sequence[str], units: Sequence[str], *, pairs: bool) -> tuple[Name, ...]:
    names = []
    for place, channel in enumerate(channels):
        if pairs:
            names.append(Name("Time", "Time", "s"))
        names.append(Name(channel, channel, units[place] or None if place < len(units) else None))
    return tuple(names)
