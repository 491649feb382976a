"""Times of the day and dates in a time column, as seconds: 09:59:58.010, 2024-03-05T09:59:58, 05.03.2024 9:59:58 PM."""

import re
from collections.abc import Sequence
from datetime import date
from typing import Final

import numpy as np

from data_io.frozen import FloatArray
from data_io.text import MISSING

_TIME: Final = r"(?P<h>\d{1,3}):(?P<m>[0-5]?\d):(?P<s>[0-5]?\d(?:[.,:]\d{1,9})?)(?: ?(?P<half>[ap])\.?m\.?)?"
_DATE: Final = r"(?P<a>\d{1,4})(?P<mark>[-/.])(?P<b>\d{1,2})(?P=mark)(?P<c>\d{1,4})"
_ZONE: Final = r"(?: ?(?:Z|UTC|GMT|[+-]\d{2}:?\d{2}))?"
_STAMP: Final = re.compile(rf"(?:{_DATE}[T ,]{{1,2}})?{_TIME}{_ZONE}", re.IGNORECASE)
_DAY_ALONE: Final = re.compile(_DATE)
_DAY: Final = 86400.0
_TURN: Final = 0.5 * _DAY
"""By how much a clock of the day falls at midnight, at least."""


def is_clock_time(token: str) -> bool:
    """Tell a time of the day, with or without a date; a cheap look comes first."""
    return ":" in token and _STAMP.fullmatch(token) is not None


def is_date(token: str) -> bool:
    """Tell a date without a time."""
    return _DAY_ALONE.fullmatch(token) is not None


def clock_times(tokens: Sequence[str]) -> tuple[FloatArray, FloatArray | None] | None:
    """Return times of the day in seconds (n,), NaN for missing ones, and the days of their dates (n,), None without.

    None where a token is something else. A clock of the day without dates falls at midnight, see `over_midnight`.
    Dates with slashes may have day or month first: the order in which the log lasts less is taken.
    """
    seconds = np.full(len(tokens), np.nan)
    days: list[tuple[int, int, int] | None] = [None] * len(tokens)
    read: dict[str, tuple[int, int, int] | None] = {}
    for i, token in enumerate(tokens):
        text = token.strip().strip('"').strip()
        match = _STAMP.fullmatch(text)
        if match is None:
            if text.lower() in MISSING:
                continue
            return None
        hour = float(match["h"])
        if match["half"]:
            hour = hour % 12.0 + (12.0 if match["half"].lower() == "p" else 0.0)
        fraction = match["s"].replace(",", ".").replace(":", ".")
        seconds[i] = 3600.0 * hour + 60.0 * float(match["m"]) + float(fraction)
        if match["a"] is not None:
            stamp = match["a"] + match["mark"] + match["b"] + match["mark"] + match["c"]
            if stamp not in read:
                read[stamp] = (int(match["a"]), int(match["b"]), int(match["c"]))
            days[i] = read[stamp]
    if not read:
        return seconds, None
    known = np.array([day is not None for day in days])
    ways = [way for way in (_days(days, order) for order in ("ymd", "dmy", "mdy")) if way is not None]
    if not ways or not known[np.isfinite(seconds)].all():
        return None
    return seconds, min(ways, key=lambda way: float(np.nanmax(way) - np.nanmin(way)))


def _days(dates: Sequence[tuple[int, int, int] | None], order: str) -> FloatArray | None:
    """Return the numbers of the days (n,), read in an order of year, month and day; None where it fits none."""
    told: dict[tuple[int, int, int], int] = {}
    for found in dates:
        if found is None or found in told:
            continue
        parts = dict(zip(order, found, strict=True))
        year = parts["y"] + (2000 if parts["y"] < 100 else 0)
        try:
            told[found] = date(year, parts["m"], parts["d"]).toordinal()
        except ValueError:
            return None
    return np.array([np.nan if found is None else float(told[found]) for found in dates])


def over_midnight(seconds: FloatArray, days: FloatArray) -> FloatArray:
    """Return a clock of the day (n,) [s] that goes on over midnight: by the days (n,), else (NaN) where it falls."""
    if np.isfinite(days).any():
        first = float(days[np.isfinite(days)][0])
        return seconds + _DAY * (days - first)
    known = np.flatnonzero(np.isfinite(seconds))
    falls = np.diff(seconds[known]) < -_TURN
    if not falls.any():
        return seconds
    later = seconds.copy()
    later[known[1:]] += _DAY * np.cumsum(falls)
    return later
