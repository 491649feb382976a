"""MATLAB files up to version 7 (.mat); later ones are HDF5.

They are read here and not by scipy, which takes memory for what a header promises, and crashes on damaged ones.
"""

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from data_io.columns import match_header, shown
from data_io.contents import Contents, Part
from data_io.source import LEAST_SUSPECT, MOST_TIMES, Request, Source

_NUMBERS: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""How the numbers of a data element are stored, by its type (miINT8 to miUINT64)."""
_MATRIX: Final = 14
_PACKED: Final = 15
_TEXTS: Final = (16, 17, 18)
_CELL: Final = 1
_STRUCT: Final = 2
_OBJECT: Final = 3
_NUMERIC: Final = range(6, 16)
_OPAQUE: Final = 17
_OTHERS: Final = (4, 5, 16, _OPAQUE, 18)
"""Classes of arrays that are no columns: texts, sparse matrices, functions, opaque ones."""
_NOTHING: Final = ((0, memoryview(b"")),) * 4
_LONGEST_NAME: Final = 64

Columns = dict[str, npt.NDArray[Any]]


def read(source: Source, request: Request) -> Contents:
    """Read the columns of a .mat of versions 5 to 7: vectors, fields of structs, or columns of matrices.

    Vectors called as a time and forces are found by name (`t`, `Fx_N`, `log.Fz`), others by --columns; the columns of
    a matrix `data` are `data:1`, `data:2`, ... MATLAB stores no units: a suffix of the name, or --units, says them.
    Raises `LogError`.
    """
    objects: list[str] = []
    columns = _columns(source, objects)
    sizes = [values.size for values in columns.values()]
    wanted = {name for name in request.columns.values() if name in columns}
    size = columns[next(iter(wanted))].size if wanted else max(sizes, key=sizes.count, default=0)
    kept = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items() if values.size == size}
    if size < 2 or (lost := wanted - set(kept)):
        listed = shown((f"{name} ({columns[name].size})" for name in columns), most=12) or "none"
        if size < 2 and objects:
            raise source.error(
                f"the variable {objects[0]} is a MATLAB object whose numbers only MATLAB unfolds; vectors were "
                "expected; save them, as in t = log.Time; Fx = log.Data; save('log.mat', 't', 'Fx')"
            )
        what = "differ in length" if size >= 2 and lost else "are no columns of a log"
        raise source.error(f"the variables {listed} {what}; vectors of one length were expected; name them")
    last = [name.rpartition(".")[2] for name in kept]
    header = match_header(last if len(set(last)) == len(last) and not wanted else list(kept), request.columns)
    return Contents([Part(1, 1, header, dict(enumerate(kept.values())))])


class _DamageError(Exception):
    """What is wrong with a variable, in words."""


def _columns(source: Source, objects: list[str] | None = None) -> Columns:
    """Return the columns of all variables as they are stored; names and classes of objects go into `objects`."""
    data = source.read()
    order = ">" if data[126:128] == b"MI" else "<"
    most = max(LEAST_SUSPECT, MOST_TIMES * source.size)
    out: Columns = {}
    objects = [] if objects is None else objects
    number = 0
    try:
        for kind, body in _elements(memoryview(data)[128:], order):
            number += 1
            if kind == _PACKED:
                unpacked = _unpacked(body, most)
                most -= len(unpacked)
                for inner, part in _elements(memoryview(unpacked), order):
                    _variable(inner, part, order, out, objects)
            else:
                _variable(kind, body, order, out, objects)
    except _DamageError as damage:
        where = f"in variable {number} " if number else ""
        raise source.error(f"the .mat file is damaged {where}({damage}); copy or save it again") from damage
    return out


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield type and bytes of the data elements that stand one after the other. Raises `_DamageError`."""
    at = 0
    while at < len(data):
        if len(data) - at < 8:
            raise _DamageError(f"{len(data) - at} bytes are left where a data element was expected")
        kind, size = struct.unpack_from(f"{order}II", data, at)
        begin, padded = at + 8, size if kind == _PACKED else -(-size // 8) * 8
        if kind >> 16:  # the small form: type, size and up to four bytes in eight
            kind, size, begin, padded = kind & 0xFFFF, kind >> 16, at + 4, 4
        if size > len(data) - begin or (padded == 4 and size > 4):
            raise _DamageError(f"a data element promises {size} bytes and {len(data) - begin} follow")
        yield kind, data[begin : begin + size]
        at = begin + padded


def _unpacked(body: memoryview, most: int) -> bytes:
    """Return the bytes of a packed element. Raises `_DamageError` for a damaged one, or one of more than `most`."""
    unpacker = zlib.decompressobj()
    try:
        data = unpacker.decompress(body, max(most, 1))
    except zlib.error as error:
        raise _DamageError(str(error)) from error
    if unpacker.unconsumed_tail:
        raise _DamageError(f"it unpacks to more than {MOST_TIMES} times the size of the file; a log packs to a tenth")
    if not unpacker.eof:
        raise _DamageError("its packed bytes are cut off")
    return data


@dataclass(frozen=True)
class _Array:
    """A MATLAB array: its class, dimensions, name, and the data elements that follow them."""

    kind: int
    complex: bool
    shape: tuple[int, ...]
    name: str
    parts: Iterator[tuple[int, memoryview]]

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def part(self, kinds: tuple[int, ...] | range, what: str) -> tuple[int, memoryview]:
        """Return the next data element, of one of these types. Raises `_DamageError`."""
        kind, body = next(self.parts, (0, memoryview(b"")))
        if kind not in kinds:
            raise _DamageError(f"{what} of {self.name!r} were expected where an element of type {kind} stands")
        return kind, body


def _array(body: memoryview, order: str) -> _Array:
    parts = _elements(body, order)
    head = [next(parts, (0, memoryview(b""))) for _ in range(3)]
    (kind, flags), (sizes_kind, sizes), (_, name) = head
    if kind != 6 or len(flags) != 8 or sizes_kind not in (5, 6) or len(sizes) % 4 or len(sizes) < 8:
        raise _DamageError("its flags and dimensions cannot be read")
    (flag,) = struct.unpack_from(f"{order}I", flags)
    shape = struct.unpack(f"{order}{len(sizes) // 4}i", sizes)
    if min(shape) < 0:
        raise _DamageError(f"a dimension is {min(shape)}")
    words = bytes(name).decode("latin-1")
    return _Array(flag & 0xFF, bool(flag & 0x800), shape, words[:_LONGEST_NAME], parts)


def _variable(kind: int, body: memoryview, order: str, out: Columns, objects: list[str]) -> None:
    """Put the columns of a top element into `found`; what is no array, or has no name, is not the user's."""
    if kind == _MATRIX and len(body):
        if len(body) >= 16 and struct.unpack_from(f"{order}I", body, 8)[0] & 0xFF == _OPAQUE:
            _, name, _, kind_of, *_ = [
                bytes(part[:_LONGEST_NAME]).decode("latin-1") for _, part in (*_elements(body, order), *_NOTHING)
            ]
            objects += [f"{name} ({kind_of})"] if name else []
            return
        array = _array(body, order)
        if array.name:
            _collect(array.name, array, order, out, 0)


def _collect(name: str, array: _Array, order: str, out: Columns, depth: int) -> None:
    """Put every column of an array into `found`: a vector, the columns of a matrix, the fields of a struct."""
    if array.kind in _NUMERIC:
        if array.complex or len(array.shape) != 2:
            return
        kind, body = array.part(tuple(_NUMBERS), "the numbers")
        numbers = np.dtype(order + _NUMBERS[kind])
        if len(body) != array.size * numbers.itemsize:
            raise _DamageError(f"{name!r} promises {array.size} numbers and holds {len(body) // numbers.itemsize}")
        values = np.frombuffer(body, numbers).reshape(array.shape, order="F")
        rows, columns = array.shape
        if min(rows, columns) == 1:
            out[name] = values.reshape(-1)
        elif rows > columns > 0:
            out.update({f"{name}:{i + 1}": values[:, i] for i in range(columns)})
    elif array.kind in (_CELL, _STRUCT, _OBJECT):
        if array.kind == _OBJECT:
            array.part((1, 2, *_TEXTS), "the name of its class")
        fields = [name] if array.kind == _CELL else [f"{name}.{field}" for field in _field_names(array, order)]
        if array.size != 1 or depth >= 4:
            return
        for field in fields:
            _, body = array.part((_MATRIX,), "the contents")
            if len(body):
                _collect(field, _array(body, order), order, out, depth + (array.kind != _CELL))
    elif array.kind not in _OTHERS:
        raise _DamageError(f"{name!r} is of class {array.kind}, which does not exist")


def _field_names(array: _Array, order: str) -> list[str]:
    _, length = array.part((5,), "the lengths of field names")
    _, names = array.part((1, 2, *_TEXTS), "the field names")
    width = struct.unpack(f"{order}i", length)[0] if len(length) == 4 else 0
    if not 0 < width <= _LONGEST_NAME or len(names) % width:
        raise _DamageError(f"the field names of {array.name!r} cannot be separated")
    raw = bytes(names)
    return [raw[i : i + width].split(b"\0")[0].decode("latin-1") for i in range(0, len(raw), width)]
