"""A text log as a stream of whole lines: in segments to be walked, or in runs of pure numbers handed to pandas."""

import codecs
import itertools
import re
import sys
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
AT_ONCE: Final = 1 << 17
"""Bytes handed to pandas at once: they stay in the cache."""
BLOCK: Final = 1 << 23
"""Bytes of a segment where words stand in every row, so that pandas is not called too often."""
RUN: Final = 1 << 26
"""Bytes of the longest run of numbers in a packed file, which must be unpacked again where a row is not sound."""
LONGEST_LINE: Final = 1 << 20
MOST_WORDS: Final = 1 << 20
"""Characters without a row of numbers after which no table is waited for any more."""
LARGEST: Final = 1 << 26
"""Bytes after which a segment ends even where words stand near its end."""
MOST_ZEROS: Final = 1 << 26
_ROWS_AT_END: Final = 32
_TAIL: Final = 1 << 16
_HIGHEST_DIGIT: Final = ord("9")
_UNSEEN: Final = (b"\0", b'"', b"#")
"""What pandas would take for the end of a number, a quotation, or part of a column that nobody reads."""
_LINE_END: Final = re.compile(rb"\r\n|\n|\r")
_NUMBERS: Final = b"0123456789+-.eE,;\t \r\n"


@dataclass(frozen=True)
class Segment:
    """Whole lines of a log, the number of the first one, whether the log ends with them, and what stands above them."""

    raw: bytes
    first_line: int
    at_end: bool
    before: bytes = b""

    def numbers_below(self, lines: int) -> bytes:
        """Return what follows so many lines if it holds numbers and delimiters only, else nothing."""
        ends = itertools.islice(_LINE_END.finditer(self.raw), lines)
        start = max((match.end() for match in ends), default=0)
        rest = self.raw[start:]
        return rest if is_clean(rest) else b""

    @cached_property
    def text(self) -> str:
        """The lines decoded, each ended by a newline; the last may be open at the end of the log."""
        return decode(self.raw, start=self.first_line == 1)


class Lines:
    """A log being read from front to back. `segment` and `run` each go on where the other stopped."""

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
        self.tried_by_path = False
        self.line = 1
        self.size = TOP

    @property
    def may_run(self) -> bool:
        """Whether the next lines may be read as a run of numbers: not where that failed, nor where UTF-8 is made."""
        return self._decoder is None and not self._zeros and self.here >= self._careful_until

    def go_back(self, run: "Run") -> None:
        """Return to where a run began, whose rows are not sound; its lines are to be walked."""
        self._careful_until = self.here
        if self._source.packing is None:
            self._handle.seek(run.start)
        else:
            self._handle.close()
            self._handle = self._source.open()
            for first in range(0, run.start, BLOCK):
                self._handle.read(min(BLOCK, run.start - first))
        self._pending, self._zeros, self._done, self._ended = b"", 0, run.start, False

    def skip_rest(self, rows: int) -> None:
        """Go to the end of a file that is not packed; so many rows were read by others."""
        size = self._source.size
        self._handle.seek(max(size - LOOKED_AT, 0))
        self._before = self._handle.read()
        self._pending, self._done, self._ended = b"", size, True
        self.line += rows
        self._tell()

    def close(self) -> None:
        """Close the file."""
        self._handle.close()

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
            self._pending += self._fresh(want)
            cut = _line_end(self._pending)
            if len(self._pending) - cut > self._longest:
                raise self._source.error(
                    f"no line ends within a MiB below line {self.line}; lines of numbers were expected; check the file"
                )
            rows = _rows_at_end(self._pending[:cut])
            if len(self._pending) >= self.size and (len(self._pending) > LARGEST or (rows and all(rows))):
                break
            if len(self._pending) > MOST_WORDS and not any(rows):
                break  # words only: they would be looked through line by line, for nothing
            want = BLOCK if len(self._pending) >= self.size and any(rows) else FIRST
        cut = len(self._pending) if self._ended else cut
        segment = Segment(self._pending[:cut], self.line, self._ended, self._before)
        self._pending = self._pending[cut:]
        self.line += _count_lines(segment.raw)
        self.pass_by(segment.raw)
        return segment

    def pass_by(self, raw: bytes) -> None:
        """Remember the end of what is handed out."""
        self._before = raw[-LOOKED_AT:] if len(raw) >= LOOKED_AT else (self._before + raw)[-LOOKED_AT:]

    def run(self, delimiter: str, count: bool) -> "Run":
        """Return the run of numbers that follows, perhaps an empty one; `count` its delimiters."""
        return Run(self, delimiter, count)

    def take_clean(self, size: int) -> tuple[bytes, bytes]:
        """Return the next whole lines, in two pieces, if they hold numbers and delimiters only, else up to others.

        Nothing where the next line holds something else, or is the open last one.
        """
        start, raw = self._pending, b""
        if len(start) < size and not self._ended:
            raw = self._fresh(size)
        if not raw or not is_clean(start):
            start, raw = b"", start + raw
        cut = _line_end(raw)
        if not is_clean(raw) and (dirt := raw[:cut].translate(None, _NUMBERS)):
            cut = _line_end(raw, raw.find(dirt[:1]))
        if cut == 0:
            self._pending = start + raw
            return b"", b""
        self._pending = raw[cut:]
        return start, raw[:cut]

    def give_back(self, raw: bytes) -> None:
        """Take lines back that were handed out last; their numbers were not yet counted."""
        self._pending = raw + self._pending

    def hand_back(self, raw: bytes) -> None:
        """Take lines back from the end of the segment that was handed out last, to be read as a run."""
        self._pending = raw + self._pending
        self.line -= _count_lines(raw)

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


class Run:
    """Consecutive lines of numbers as a file that pandas reads.

    It is no binary file by type: pandas would decode its bytes, and encode them again for the parser.
    """

    def __init__(self, lines: Lines, delimiter: str, count: bool) -> None:
        self._lines, self._delimiter = lines, delimiter.encode()[0] if count else None
        self.start = lines.here
        self._size = 0
        self._most = RUN if lines._source.packing is not None else sys.maxsize
        self._next = [piece for piece in lines.take_clean(AT_ONCE) if piece]
        self.empty = not self._next
        self.delimiters = 0
        self.commas = False

    def __iter__(self) -> "Run":
        return self

    def __next__(self) -> bytes:
        raise StopIteration

    def read(self, size: int = -1) -> bytes:
        """Return the next lines; `size` is not heeded, because lines stay whole."""
        if not self._next:
            return b""
        block = self._next.pop(0)
        self._lines.pass_by(block)
        self._size += len(block)
        if self._delimiter is not None:
            self.delimiters += int(np.count_nonzero(np.frombuffer(block, dtype=np.uint8) == self._delimiter))
        self.commas = self.commas or b"," in block
        if not self._next and self._size <= self._most:
            self._next = [piece for piece in self._lines.take_clean(AT_ONCE) if piece]
        return block

    def finish(self, rows: int) -> None:
        """Count the lines read, as many as `rows` (blank ones aside), and give back those that nobody read."""
        self._lines.give_back(b"".join(self._next))
        self._next = []
        self._lines.line += rows


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
