"""Ways in which real logs are broken, as functions of a file's bytes; each says what a reader may still make of it."""

from __future__ import annotations

import gzip
import io
import random
import re
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

Oracle = Literal["same", "part", "refuse", "any"]
Change = Callable[[bytes, random.Random], bytes]


@dataclass(frozen=True)
class Mutation:
    """A way to break a file.

    oracle: what may be read without a warning. "same": only what was written, all of it; "part": only rows that were
    written, perhaps not all; "refuse": nothing; "any": whatever, because what is written was changed.
    """

    change: Change
    oracle: Oracle


def _lines(data: bytes) -> list[bytes]:
    return re.split(rb"(?<=\n)|(?<=\r)(?!\n)", data)


def _row_numbers(lines: list[bytes]) -> list[int]:
    return [i for i, line in enumerate(lines) if re.match(rb"[ \t,;]*[-0-9][-0-9.,;\t eE]*[\r\n]", line) and i > 0]


def _delimiter(line: bytes) -> bytes:
    return next((mark for mark in (b"\t", b";", b",") if mark in line), b" ")


def line_ends(data: bytes, draw: random.Random) -> bytes:
    """Other line ends, one kind or mixed."""
    ends = [b"\n", b"\r\n", b"\r"]
    lines = re.split(rb"\r\n|\n|\r", data)
    kind = draw.randrange(4)
    return b"".join(line + (draw.choice(ends) if kind == 3 else ends[kind]) for line in lines[:-1]) + lines[-1]


def packed(data: bytes, draw: random.Random) -> bytes:
    """Packed by gzip or into a zip archive."""
    if draw.random() < 0.5:
        return gzip.compress(data, 1)
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("log.txt", data)
    return held.getvalue()


def _of_a_row(change: Callable[[list[bytes], int, random.Random], list[bytes]]) -> Change:
    """A change of the lines of a file about one of its rows, drawn."""

    def changed(data: bytes, draw: random.Random) -> bytes:
        lines = _lines(data)
        return b"".join(change(lines, draw.choice(_row_numbers(lines) or [len(lines) - 1]), draw))

    return changed


def _blank_lines(lines: list[bytes], row: int, draw: random.Random) -> list[bytes]:
    """Among the rows; none behind the last, whose line end would be theirs if it was cut off."""
    for at in (row, *(draw.choice(_row_numbers(lines) or [row]) for _ in range(2))):
        lines.insert(at, b"\n")
    return lines


def junk_behind(data: bytes, draw: random.Random) -> bytes:
    """Words, numbers or bytes behind the last row."""
    junk = [b"end of test\r\n", b"\x1a", b"mean 0.31\nsd 0.02\n", b"# exported 12.05.2022\n", b"Total;12;3\n",
            bytes(draw.randrange(128, 256) for _ in range(20))]  # fmt: skip
    return data + draw.choice(junk)


def _cut(data: bytes, draw: random.Random) -> bytes:
    """Cut off anywhere in the second half."""
    return data[: draw.randrange(len(data) // 2, len(data))]


def header_twice(data: bytes, draw: random.Random) -> bytes:
    """The line above the first rows, and the one above it, written twice."""
    lines = _lines(data)
    first = next(iter(_row_numbers(lines)), 1)
    start = max(first - draw.randrange(1, 4), 0)
    return b"".join(lines[:first] + lines[start:first] + lines[first:])


def _field_lost(lines: list[bytes], i: int, draw: random.Random) -> list[bytes]:
    """A row without one of its fields, or with one too many."""
    parts = re.split(b"([" + _delimiter(lines[i]) + b"])", lines[i])
    if draw.random() < 0.5 and len(parts) > 2:
        k = 2 * draw.randrange(len(parts) // 2)
        del parts[k : k + 2]
    else:
        parts[0:0] = [b"7.25", parts[1] if len(parts) > 1 else b","]
    return [*lines[:i], b"".join(parts), *lines[i + 1 :]]


def _field_empty(lines: list[bytes], i: int, draw: random.Random) -> list[bytes]:
    """A row with an empty field, or a word in it."""
    parts = re.split(b"([\r\n" + _delimiter(lines[i]) + b"])", lines[i])
    parts[2 * draw.randrange(max(len(parts) // 2, 1))] = draw.choice([b"", b"OVER", b"-", b"#DIV/0!", b"1.#QNAN"])
    return [*lines[:i], b"".join(parts), *lines[i + 1 :]]


def _decimal_sign(lines: list[bytes], i: int, _draw: random.Random) -> list[bytes]:
    """The wrong decimal sign in one row."""
    both = b"," in lines[i] and b"." in lines[i]
    swap = bytes.maketrans(b".", b",") if both else bytes.maketrans(b".,", b",.")
    return [*lines[:i], lines[i].translate(swap), *lines[i + 1 :]]


def no_units(data: bytes, _draw: random.Random) -> bytes:
    """Every unit gone: brackets, the row of units (whatever its line ends), suffixes."""
    data = re.sub(rb" ?[(\[][a-zA-Z\xb5\xc2]{1,4}[)\]]", b"", data)
    data = re.sub(rb"_N\b", b"", data)
    return re.sub(rb"(?<=[\r\n])(?:(?:g|mm|[Ss]ec|mm/sec|N|s|);?,?\t?)+(?=[\r\n])", b"", data)


def bytes_changed(data: bytes, draw: random.Random) -> bytes:
    """A few bytes changed, put in or taken out anywhere."""
    changed = bytearray(data)
    for _ in range(draw.randrange(1, 6)):
        where = draw.randrange(len(changed))
        kind = draw.randrange(4)
        if kind == 0:
            changed[where] = draw.randrange(256)
        elif kind == 1:
            changed[where:where] = bytes(draw.randrange(256) for _ in range(draw.randrange(1, 9)))
        elif kind == 2:
            del changed[where : where + draw.randrange(1, 120)]
        else:
            changed[where:where] = changed[where : where + draw.randrange(1, 120)]
        if not changed:
            changed = bytearray(b"0")
    return bytes(changed)


def column_order(data: bytes, draw: random.Random) -> bytes:
    """The columns in another order, names, units and rows alike; those that are empty at the end stay there.

    LabVIEW's clock stands in front; columns apart by blanks stay as they are.
    """
    lines = _lines(data)
    rows = _row_numbers(lines)
    mark = _delimiter(lines[rows[0]]) if rows else b" "
    if mark == b" ":
        return data
    split = [line.rstrip(b"\r\n").split(mark) for line in lines]
    width = len(split[rows[0]])
    top = next((i for i in range(rows[0] - 1, -1, -1) if len(split[i]) > 1), 0)
    while top > 0 and len(split[top - 1]) == len(split[top]) > 2 and split[top][0] != b"X_Value":  # names above units
        top -= 1
    names = split[top]
    free = list(range(names[:1] == [b"X_Value"], width - (split[rows[0]][-1] == b"")))
    order = list(free)
    while order == free:
        draw.shuffle(order)
    for i, fields in enumerate(split):
        if i >= top and (len(fields) == width or fields == names):
            moved = [*fields[: free[0]], *(fields[k] for k in order), *fields[free[-1] + 1 :]]
            lines[i] = mark.join(moved) + lines[i][len(lines[i].rstrip(b"\r\n")) :]
    return b"".join(lines)


WORDS = [b"load applied\r\n", b"# pause\n", b"*** operator stopped ***\n", b"Error 17: overload\n"]
TEXT: Mapping[str, Mutation] = {
    "nothing": Mutation(lambda data, _: data, "same"),
    "line ends": Mutation(line_ends, "same"),
    "byte-order mark": Mutation(lambda data, _: b"\xef\xbb\xbf" + data.removeprefix(b"\xef\xbb\xbf"), "same"),
    "packed": Mutation(packed, "same"),
    "blank lines": Mutation(_of_a_row(_blank_lines), "same"),
    "reserved space": Mutation(lambda data, draw: data + bytes(draw.randrange(1, 5000)), "same"),
    "junk behind": Mutation(junk_behind, "same"),
    "cut off": Mutation(_cut, "part"),
    "row twice": Mutation(_of_a_row(lambda lines, i, _: lines[: i + 1] + lines[i:]), "part"),
    "row lost": Mutation(_of_a_row(lambda lines, i, _: lines[:i] + lines[i + 1 :]), "part"),
    "rows swapped": Mutation(
        _of_a_row(lambda lines, i, _: lines[:i] + lines[i : i + 2][::-1] + lines[i + 2 :]), "part"
    ),
    "words between": Mutation(_of_a_row(lambda lines, i, draw: [*lines[:i], draw.choice(WORDS), *lines[i:]]), "part"),
    "header twice": Mutation(header_twice, "part"),
    "field lost": Mutation(_of_a_row(_field_lost), "part"),
    "field empty": Mutation(_of_a_row(_field_empty), "part"),
    "decimal sign": Mutation(_of_a_row(_decimal_sign), "part"),
    "no units": Mutation(no_units, "refuse"),
    "bytes changed": Mutation(bytes_changed, "any"),
}
ORDER = Mutation(column_order, "same")
"""Below any other: fields are lost, units gone and rows cut in whatever order the columns have."""
BINARY: Mapping[str, Mutation] = {
    name: TEXT[name] for name in ("nothing", "packed", "bytes changed")
} | {"cut off": Mutation(_cut, "part")}  # fmt: skip
