"""Bytes to text to fields: encodings, line ends, delimiters, number tokens. Knows nothing of columns or formats."""

import codecs
import csv
import functools
import mmap
import re
from collections.abc import Sequence
from datetime import date, datetime, timedelta
from itertools import pairwise
from typing import Final

import numpy as np

from data_io.values import FloatArray

Text = bytes | mmap.mmap
"""A whole log in UTF-8, in which lines are looked for and cut out as bytes."""

BLANKS: Final = r"\s+"
"""The delimiter of columns that stand apart by blanks, as pandas writes it."""

DELIMITERS: Final = ("\t", ";", ",", BLANKS)

MISSING: Final = frozenset((
    "", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "<na>", "-nan", "+nan",
    "1.#ind", "-1.#ind", "1.#qnan", "-1.#qnan", "1.#inf", "-1.#inf", "inf", "-inf", "+inf", "infinity", "-infinity",
))  # fmt: skip
"""What programs write where they have no number, in lower case."""

# a line is text unless its first field that is not empty begins like a number or a missing number
TEXT_LINE: Final = re.compile(
    rb'\n(?![ \t",;]*+(?:[+-]?(?:\.?\d|\.\#)|[+-]?(?:nan|inf|infinity)\b|\n|\Z))', re.IGNORECASE
)


def is_words(line: str) -> bool:
    """Tell a line that is no plain row of numbers."""
    return TEXT_LINE.match(b"\n" + line.encode()) is not None


# possessive: of 10,000 digits that are no number each is looked at once
_NUMBER = re.compile(r"[+-]?(?:\d++\.?\d*+|\.\d++)(?:[eEdD][+-]?\d++)?")
_IN_GROUPS: Final = {
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?"),
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+,\d*"),
}
"""Numbers with marks between thousands, by their decimal mark; without a decimal part only a comma is believed."""
_EASTERN: Final = (
    "时间", "摩擦", "法向", "压力", "载荷", "位移", "速度", "時間", "荷重", "垂直", "変位", "摺動", "滑り",
)  # fmt: skip
"""Words by which a text in an encoding of China or Japan is told."""
_BOMS: Final = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))
_GROUP_MARKS: Final = "\u202f\u00a0\u2009\u2019"
"""Narrow blanks and the typographic apostrophe between thousands; the plain one stands in text of one byte, too."""
_THOUSAND: Final = re.compile(r"\d{3}(?!\d)")
_BLOCK: Final = 1 << 20
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")


def _as_cp1252(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeDecodeError)
    wrong = error.object[error.start : error.end]
    return wrong.decode("cp1252", errors="replace"), error.end


# byte by byte, because exports mix: a UTF-8 header below a preamble in the code page of the machine
codecs.register_error("data_io.cp1252", _as_cp1252)


@functools.lru_cache(maxsize=4)  # every reader of text asks
def looks_like_text(head: bytes) -> bool:
    """Tell text from binary by the first bytes: a Unicode mark, or hardly any control characters and some print."""
    if any(head.startswith(mark) for mark, _ in _BOMS) or _without_mark(head):
        return True
    head = head.rstrip(b"\0")  # space reserved and never written
    return len(head) > 0 and len(_CONTROL.findall(head)) <= len(head) // 200 and b"\0\0" not in head


def _encoding(head: bytes) -> str | None:
    """Name the encoding of a text by its first bytes and words that logs hold, None for UTF-8 or near."""
    marked = next((name for mark, name in _BOMS if head.startswith(mark)), None)
    if marked is not None:
        return None if marked == "utf-8" else marked
    if (unmarked := _without_mark(head)) is not None:
        return unmarked
    if head.isascii():
        return None
    try:
        head[: max(len(head) - 3, 0)].decode("utf-8")
    except UnicodeDecodeError as error:
        if len(head) - error.start < 8:  # a letter that the end cuts
            return None
    else:
        return None
    top = head[: head.find(b"\n", len(head) // 2) + 1 or len(head)]
    for encoding in ("gb18030", "cp932"):
        text = top.decode(encoding, errors="replace")
        if any(word in text for word in _EASTERN) and "\ufffd" not in text:
            return encoding
    return None


def _without_mark(head: bytes) -> str | None:
    """Name the UTF-16 of a text without its mark, None where it is none: every other byte is zero, the rest text."""
    for zeros, others, name in ((head[1::2], head[::2], "utf-16-le"), (head[::2], head[1::2], "utf-16-be")):
        plain = len(head) >= 32 and zeros.count(0) > 0.9 * len(zeros) and b"\n" in others
        if plain and not _CONTROL.search(others):
            return name
    return None


def is_plain(data: Text) -> bool:
    """Tell text of single bytes in which `as_utf8` changes nothing."""
    blocks = (data[i : i + _BLOCK] for i in range(0, len(data), _BLOCK))
    return all(block.isascii() and not any(mark in block for mark in (b"\r", b"\0", b"'")) for block in blocks)


def as_utf8(data: bytes) -> bytes:
    """Return a whole log in UTF-8: told by byte-order mark, else UTF-8 with single bytes of cp1252. Lines end in a
    newline; marks between thousands and zero bytes at the end are gone. Plain bytes are not copied."""
    encoding = _encoding(data[: (1 << 16)])
    if encoding is not None or not data.isascii():
        if encoding is not None:
            text = data.decode(encoding, "replace").removeprefix("\ufeff")
        else:
            text = data.removeprefix(codecs.BOM_UTF8).rstrip(b"\0").decode("utf-8", errors="data_io.cp1252")
        text = text.replace("\u2212", "-")
        for mark in _GROUP_MARKS:
            text = _without_group_marks(text, mark)
        data = text.encode("utf-8", "replace")
    elif data.endswith(b"\0"):
        data = data.rstrip(b"\0")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return _without_group_marks(data.decode(), "'").encode() if b"'" in data else data


def _without_group_marks(text: str, mark: str) -> str:
    parts = text.split(mark)
    gone = (a[-1:].isdecimal() and _THOUSAND.match(b) for a, b in pairwise(parts))
    return parts[0] + "".join(("" if one else mark) + part for one, part in zip(gone, parts[1:], strict=True))


def split(line: str, delimiter: str) -> list[str]:
    """Split one line into stripped fields; quotes protect delimiters."""
    line = line.strip("\n")
    if delimiter == BLANKS:
        return line.split()
    if '"' not in line:
        return [field.strip() for field in line.split(delimiter)]
    try:
        return [field.strip() for field in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return [field.strip().strip('"') for field in line.split(delimiter)]


def is_number(token: str, decimal: str = ".") -> bool:
    """Tell whether a field is one number written with this decimal mark, perhaps with the other between thousands."""
    if "," in token and "." in token:
        return _IN_GROUPS[decimal].fullmatch(token) is not None
    if decimal == ",":
        if "." in token:
            return False
        token = token.replace(",", ".")
    return _NUMBER.fullmatch(token) is not None


def is_number_like(token: str) -> bool:
    """Tell whether a field is a number with either decimal mark, or a missing number."""
    return is_number(token) or is_number(token, ",") or token.lower() in MISSING


def to_number(token: str, decimal: str) -> float | None:
    """Return the number in a field, NaN where it says missing, None where it is something else."""
    token = token.strip().strip('"').strip()
    if token.lower() in MISSING:
        return float("nan")
    if ("," in token and "." in token) or (decimal == "." and "," in token):
        grouped = _IN_GROUPS[decimal].fullmatch(token) is not None
        token = token.replace("." if decimal == "," else ",", "") if grouped else ""
    if not is_number(token, decimal):
        return None
    return float(token.replace(",", ".").replace("d", "e").replace("D", "e"))


# Times of the day and dates, in a time column as seconds and in a head: 09:59:58.010, 2024-03-05T09:59:58,
# 05.03.2024 9:59:58 PM, 12 May 2022.

_TIME: Final = (
    r"(?:(?P<h>\d{1,3}):(?P<m>[0-5]?\d):(?P<s>[0-5]?\d(?:[.,:]\d{1,9})?)(?: ?(?P<half>[ap])\.?m\.?)?"
    r"|(?P<mm>\d{1,3}):(?P<ss>[0-5]\d(?:[.,]\d{1,9})?))"
)
_DATE: Final = r"(?P<a>\d{1,4})(?P<mark>[-/.])(?P<b>\d{1,2})(?P=mark)(?P<c>\d{1,4})"
_ZONE: Final = r"(?: ?(?:Z|UTC|GMT|(?P<zone>[+-])(?P<zh>\d{2}):?(?P<zm>\d{2})))?"
_STAMP: Final = re.compile(rf"(?:{_DATE}[T ,]{{1,2}})?{_TIME}{_ZONE}", re.IGNORECASE)
DATE_ALONE: Final = re.compile(_DATE)
_CLOCK: Final = re.compile(_TIME, re.IGNORECASE)
_MONTHS: Final = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_NAME: Final = rf"({'|'.join(_MONTHS)})[a-z]{{0,6}}"
_MONTH: Final = re.compile(rf"(\d{{1,2}})([-. /]){_NAME}\2(\d{{4}})(?=[T ,]|$)", re.IGNORECASE)
_MONTH_FIRST: Final = re.compile(rf"{_NAME}\.? (\d{{1,2}}),? (\d{{4}})(?=[T ,]|$)", re.IGNORECASE)
_COMPACT: Final = re.compile(r"(\d{4})(\d\d)(\d\d)T(\d\d)(\d\d)(\d\d)(?!\d)")
_HOUR: Final = 3600.0
_DAY: Final = 86400.0


def is_clock_time(token: str) -> bool:
    """Tell a time of the day, with or without a date; a cheap look comes first."""
    return (":" in token or "T" in token) and _stamp(token) is not None


def _stamp(token: str) -> re.Match[str] | None:
    """Match a time, its date also with a month's name (05-Mar-2024 9:59:58) or without marks (20240305T095958)."""
    if match := _STAMP.fullmatch(token):
        return match
    return _STAMP.fullmatch(_with_marks(token))


def _with_marks(text: str) -> str:
    """Return a text whose date has numbers and marks: no name of a month, no run of digits."""
    plain = _COMPACT.sub(r"\1-\2-\3T\4:\5:\6", text, count=1)
    plain = _MONTH_FIRST.sub(r"\2 \1 \3", plain, count=1)
    return _MONTH.sub(lambda m: f"{m[4]}-{_MONTHS.index(m[3].lower()) + 1}-{m[1]}", plain, count=1)


def _seconds_of_day(match: re.Match[str]) -> float:
    hour = float(match["h"] or 0.0)
    if match["half"]:
        hour = hour % 12.0 + (12.0 if match["half"].lower() == "p" else 0.0)
    fraction = (match["s"] or match["ss"]).replace(",", ".").replace(":", ".")
    return 3600.0 * hour + 60.0 * float(match["m"] or match["mm"]) + float(fraction)


def read_date(text: str) -> datetime | None:
    """Read `12:21:58.029 12 May 2022`, `2022-05-12 12:21:58`, `05/12/22 14:43:46` (month first) wherever it stands in a
    text, the first day of 2000 where it tells no date; None without a time of the day."""
    plain = _with_marks(text)
    clock, day = _CLOCK.search(plain), DATE_ALONE.search(plain)
    if clock is None or clock["h"] is None:
        return None
    fields, order = (2000, 1, 1), "ymd"
    if day is not None:
        fields = (int(day["a"]), int(day["b"]), int(day["c"]))
        order = "ymd" if len(day["a"]) == 4 else "mdy" if day["mark"] == "/" else "dmy"
    days = _days([fields], order)
    return None if days is None else datetime.fromordinal(int(days[0])) + timedelta(seconds=_seconds_of_day(clock))


def clock_times(tokens: Sequence[str]) -> tuple[FloatArray, FloatArray | None] | None:
    """Return times of the day in seconds (n,), NaN for missing ones, and the days of their dates (n,), None without.

    None where a token is something else. A clock of the day without dates falls at midnight, see `over_midnight`.
    Dates with slashes may have day or month first: the order in which the log lasts less is taken.
    """
    seconds = np.full(len(tokens), np.nan)
    days: list[tuple[int, int, int] | None] = [None] * len(tokens)
    for i, token in enumerate(tokens):
        text = token.strip().strip('"').strip()
        match = _stamp(text)
        if match is None:
            if text.lower() in MISSING:
                continue
            return None
        seconds[i] = _seconds_of_day(match)
        if match["a"] is not None:
            days[i] = (int(match["a"]), int(match["b"]), int(match["c"]))
            if match["zone"]:  # summer time may begin or end within a log
                offset = 3600.0 * float(match["zh"]) + 60.0 * float(match["zm"])
                seconds[i] -= offset if match["zone"] == "+" else -offset
    if not any(days):
        return seconds, None
    known = np.array([day is not None for day in days])
    ways = [times for times in (_days(days, order) for order in ("ymd", "dmy", "mdy")) if times is not None]
    if not ways or not known[np.isfinite(seconds)].all():
        return None
    return seconds, min(ways, key=lambda times: float(np.nanmax(times) - np.nanmin(times)))


def _days(dates: Sequence[tuple[int, int, int] | None], order: str) -> FloatArray | None:
    """Return the numbers of the days (n,), read in an order of year, month and day; None where it fits none."""
    days: dict[tuple[int, int, int], int] = {}
    for fields in dates:
        if fields is None or fields in days:
            continue
        parts = dict(zip(order, fields, strict=True))
        year = parts["y"] + (2000 if parts["y"] < 100 else 0)
        try:
            days[fields] = date(year, parts["m"], parts["d"]).toordinal()
        except ValueError:
            return None
    return np.array([np.nan if fields is None else float(days[fields]) for fields in dates])


def over_midnight(seconds: FloatArray, days: FloatArray) -> FloatArray:
    """Return a clock (n,) [s] that goes on over midnight, or over the hour where it has none: by the days (n,), else
    (NaN) where it falls."""
    if np.isfinite(days).any():
        first = float(days[np.isfinite(days)][0])
        return seconds + _DAY * (days - first)
    known = np.flatnonzero(np.isfinite(seconds))
    turn = _HOUR if known.size and float(np.max(seconds[known])) < _HOUR else _DAY  # minutes and seconds alone
    falls = np.diff(seconds[known]) < -0.5 * turn
    if not falls.any():
        return seconds
    later = seconds.copy()
    later[known[1:]] += turn * np.cumsum(falls)
    return later
