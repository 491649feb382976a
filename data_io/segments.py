"""A text log as a stream of whole lines: in segments to be walked, or in blocks of pure numbers handed to pandas."""

import codecs
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import IO, Final

import numpy as np

from data_io.layout import LOOKED_AT, is_row
from data_io.source import Request, Source
from data_io.text import DELIMITERS, TEXT_LINE, decode, other_encoding, split

TOP: Final = 1 << 15
"""Bytes of the first segment: enough for most preambles and some rows, which are walked line by line."""
FIRST: Final = 1 << 18
"""Bytes of another segment."""
AT_ONCE: Final = 1 << 21
"""Bytes of numbers handed to pandas at once."""
BLOCK: Final = 1 << 23
"""Bytes of a segment where words stand in every row, so that pandas is not called too often."""
LONGEST_LINE: Final = 1 << 20
MOST_WORDS: Final = 1 << 20
"""Characters without a row of numbers after which no table is waited for any more."""
LARGEST: Final = 1 << 26
"""Bytes after which a segment ends even where words stand near its end."""
MOST_ZEROS: Final = 1 << 26
_ROWS_AT_END: Final = 32
_TAIL: Final = 1 << 16
_MOST_BREAKS: Final = 12
"""Lines that a quoted header may take."""
_OPEN_CELL: Final = re.compile(r'(?:^|[,;\t])\s*"[^"]*$')
"""A quoted cell that begins behind a delimiter and does not end in its line."""
_HIGHEST_DIGIT: Final = ord("9")
_UNSEEN: Final = (b"\0", b'"', b"#")
"""What pandas would take for the end of a number, a quotation, or part of a column that nobody reads."""
_NUMBERS: Final = b"0123456789+-.eE,;\t \r\n"


@dataclass(frozen=True)
class Segment:
    """Whole lines of a log, the number of the first one, whether the log ends with them, and what stands above them."""

    raw: bytes
    first_line: int
    at_end: bool
    before: bytes = b""

    @cached_property
    def text(self) -> str:
        """The lines decoded, each ended by a newline; the last may be open at the end of the log."""
        text = decode(self.raw, start=self.first_line == 1)
        return _without_breaks(text) if self.first_line == 1 and '"' in text else text


class Lines:
    """A log being read from front to back. `segment` and `numbers` each go on where the other stopped."""

    def __init__(self, source: Source, request: Request, handle: IO[bytes], longest: int = LONGEST_LINE) -> None:
        self._longest = longest
        self._source, self._request, self._handle = source, request, handle
        self._encoding = other_encoding(source.head)
        self._decoder = codecs.getincrementaldecoder(self._encoding)("replace") if self._encoding else None
        self._expected = source.size * (1 if source.packing is None else 10)
        self._pending, self._zeros, self._done = b"", 0, 0
        self._before = b""
        self._ended = False
        self._reached = 0.0
        self._careful_until = 0
        self.line = 1
        self.size = TOP

    @property
    def may_run(self) -> bool:
        """Whether the next lines may be read as numbers: not where that failed, nor where UTF-8 is made."""
        return self._decoder is None and not self._zeros and self.here >= self._careful_until

    @property
    def here(self) -> int:
        """Bytes handed out so far, of the file where it is not packed."""
        return self._done - len(self._pending)

    @property
    def at_end(self) -> bool:
        """Whether everything has been handed out."""
        return self._ended and not self._pending

    def segment(self) -> Segment:
        """Return the next lines: a segment that ends among rows of numbers, so that no header is torn apart.

        Raises the source's `LogError` where a line does not end within a MiB.
        """
        want = max(self.size - len(self._pending), min(FIRST // 2, self.size))
        while not self._ended:
            cut = self._more(want)
            rows = _rows_at_end(self._pending[:cut])
            if len(self._pending) >= self.size and (len(self._pending) > LARGEST or (rows and all(rows))):
                break
            if len(self._pending) > MOST_WORDS and not any(rows):
                break  # words only: they would be looked through line by line, for nothing
            want = BLOCK if len(self._pending) >= self.size and any(rows) else FIRST
        cut = len(self._pending) if self._ended else cut
        segment = Segment(self._pending[:cut], self.line, self._ended, self._before)
        self._pending = self._pending[cut:]
        self.passed(segment.raw)
        return segment

    def passed(self, raw: bytes) -> None:
        """Count lines that were read, and remember their end."""
        self.line += _count_lines(raw)
        self._before = raw[-LOOKED_AT:] if len(raw) >= LOOKED_AT else (self._before + raw)[-LOOKED_AT:]

    def numbers(self) -> bytes:
        """Return the next whole lines if they hold numbers and delimiters only, else those up to others.

        Nothing where the next line holds something else, or is the open last one. Raises as `segment` does.
        """
        cut = self._more(0 if self._ended or len(self._pending) > AT_ONCE else AT_ONCE)
        raw = self._pending
        if not is_clean(raw) and (dirt := raw[:cut].translate(None, _NUMBERS)):
            cut = _line_end(raw, raw.find(dirt[:1]))
        self._pending = raw[cut:]
        return raw[:cut]

    def give_back(self, blocks: Sequence[bytes]) -> None:
        """Take back lines handed out by `numbers`; those of the first block are to be walked."""
        self._pending = b"".join(blocks) + self._pending
        self._careful_until = self.here + len(blocks[0])

    def _more(self, size: int) -> int:
        """Read so many bytes on; return where the last whole line of those that wait ends."""
        if size:
            self._pending += self._fresh(size)
        cut = _line_end(self._pending)
        if len(self._pending) - cut > self._longest:
            raise self._source.error(
                f"no line ends within a MiB below line {self.line}; lines of numbers were expected; check the file"
            )
        return cut

    def _fresh(self, size: int) -> bytes:
        """Return about `size` bytes more, as UTF-8 or what is near it; zero bytes at the end of the log stay away."""
        raw = self._handle.read(size)
        self._done += len(raw)
        self._tell()
        self._ended = len(raw) < size
        if self._decoder is not None:
            return self._decoder.decode(raw, self._ended).encode("utf-8", "replace")
        body = raw.rstrip(b"\0")
        if not body:
            self._zeros += len(raw)
        else:
            body, self._zeros = bytes(self._zeros) + body, len(raw) - len(body)
        if self._zeros > MOST_ZEROS or (body and len(body) - len(raw) > FIRST):
            raise self._source.error(
                "the file holds long stretches of zero bytes; lines of text were expected; copy or export it again"
            )
        return body

    def _tell(self) -> None:
        self._reached = max(self._reached, min(self._done / max(self._expected, 1), 1.0))
        self._request.progress(self._reached)


def _without_breaks(text: str) -> str:
    """Return the top of a log in which the cells of a header hold no line breaks; empty lines stand for these."""
    lines = text.split("\n")
    for i, line in enumerate(lines):
        if line.strip() and _is_numbers(line):
            break
        if line.startswith("#"):  # a comment has no cells
            continue
        below = lines[i + 1 : i + 1 + _MOST_BREAKS]
        for beyond, more in enumerate(below, 1):
            if not _OPEN_CELL.search(line):
                lines[i : i + beyond] = [line, *[""] * (beyond - 1)]
                break
            line = f"{line} {more}"
    return "\n".join(lines)


def is_clean(raw: bytes) -> bool:
    """Tell lines without words, faster than by looking at every character: letters stand above the digits.

    What else is no number (brackets, percent signs) pandas will refuse.
    """
    if any(mark in raw for mark in _UNSEEN):
        return False
    codes = np.frombuffer(raw, dtype=np.uint8)
    if codes.size == 0 or codes.max() <= _HIGHEST_DIGIT:
        return True
    high = np.count_nonzero(codes > _HIGHEST_DIGIT)
    return bool(high == sum(np.count_nonzero(codes == code) for code in b";eE"))


def _count_lines(raw: bytes) -> int:
    ends = raw.count(b"\n")
    return ends if b"\r" not in raw else ends + raw.count(b"\r") - raw.count(b"\r\n")


def _line_end(raw: bytes, stop: int | None = None) -> int:
    """Return the position behind the last line end before `stop`; a CR at the very end may belong to an LF to come."""
    stop = len(raw) if stop is None else stop
    newline = raw.rfind(b"\n", 0, stop)
    if newline == stop - 1 >= 0:
        return stop
    return max(newline, raw.rfind(b"\r", max(newline, 0), min(stop, len(raw) - 1))) + 1


def _rows_at_end(raw: bytes) -> list[bool]:
    """Tell of the last lines which are rows of numbers, blank ones aside: many, but few where words keep standing
    between rows."""
    tail = [line for line in decode(raw[-_TAIL:], start=False).split("\n")[-_ROWS_AT_END - 1 : -1] if line.strip()]
    return [_is_numbers(line) for line in (tail[-3:] if len(raw) > LARGEST // 2 else tail)]


def _is_numbers(line: str) -> bool:
    return TEXT_LINE.match("\n" + line) is None or any(is_row(split(line, delimiter)) for delimiter in DELIMITERS)
