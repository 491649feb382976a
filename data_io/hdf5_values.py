"""Numbers of an HDF5 dataset, all of them or some rows; plain ones are looked at while they are in the cache."""

import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import IO, Any, Final, cast

import numpy as np

from data_io.checks import Seen, remember
from data_io.frozen import LARGEST_FORCE, FloatArray

_BLOCK: Final = 1 << 24
"""Rows read at a time; progress is told after each."""
_CACHED: Final = 1 << 17
"""Rows that stay in the cache."""
_COMPARED: Final = 1 << 10
"""Rows at both ends that the library reads as well, where they are read past it."""
_THREADS: Final = 2
"""Threads that read a column; more find the memory busy."""
_SIZE: Final = np.dtype(np.float64).itemsize

Tell = Callable[[float], None]


@contextmanager
def bytes_of(file: Any) -> Iterator[IO[bytes] | None]:
    """Open the bytes of an open HDF5 file; yield None where it lies elsewhere than in a file of its own, or the
    system knows no reading by several threads."""
    if file.driver != "sec2" or file.userblock_size or not hasattr(os, "preadv"):
        yield None
        return
    with Path(file.filename).open("rb", buffering=0) as handle:
        yield handle


def read_values(dataset: Any, rows: slice, role: str | None, tell: Tell, handle: IO[bytes] | None) -> FloatArray:
    """Return the rows of a dataset, which is a column, as float64 (n,).

    role: of a column in SI, so that what is seen of it while it is read need not be looked for again; None: no matter.
    tell: called with the share read. handle: the bytes of the file, see `bytes_of`.
    """
    count = rows.stop - rows.start
    if dataset.ndim != 1:
        tell(1.0)
        return np.asarray(dataset[()], dtype=np.float64).reshape(-1)[rows].copy()
    begin = None if handle is None else _begin(dataset)
    if handle is not None and begin is not None:
        values = _plain(handle, begin + rows.start * _SIZE, dataset, rows, role, tell)
        if values is not None:
            return values
    if rows == slice(0, dataset.size) and count <= _BLOCK:
        whole = np.asarray(dataset[()], dtype=np.float64)  # without a selection the library is a third faster
        tell(1.0)
        return whole
    values = np.empty(count)
    for first in range(0, count, _BLOCK):
        end = min(first + _BLOCK, count)
        dataset.read_direct(values, np.s_[rows.start + first : rows.start + end], np.s_[first:end])
        tell(end / count)
    return values


def _begin(dataset: Any) -> int | None:
    """Return where the numbers begin that lie in the file in one piece, as this machine has them; else None."""
    import h5py

    if dataset.size < _CACHED or dataset.dtype != np.float64 or not dataset.dtype.isnative or dataset.external:
        return None
    if dataset.id.get_create_plist().get_layout() != h5py.h5d.CONTIGUOUS:
        return None
    begin: int | None = dataset.id.get_offset()
    return begin


def _plain(handle: IO[bytes], begin: int, dataset: Any, rows: slice, role: str | None, tell: Tell) -> FloatArray | None:
    """Read rows past the library, which takes as long for a block as for checking it; None where it reads others.

    begin: where the first row lies in the file. Two threads read and look at the same time.
    """
    count = rows.stop - rows.start
    values = np.empty(count)
    sound = role in _LOOKS
    with ThreadPoolExecutor(_THREADS, "rows") as pool:
        for start in range(0, count, _BLOCK):
            stop = min(start + _BLOCK, count)
            edges = np.linspace(start, stop, _THREADS + 1).astype(int).tolist()
            parts = [pool.submit(_part, handle.fileno(), begin, values, span, role) for span in pairwise(edges)]
            told = [part.result() for part in parts]
            if None in told:
                return None
            sound = sound and all(told) and all(_LOOKS[role or ""](values, edge, edge + 1) for edge in edges[:-1])
            tell(stop / count)
    for ends in (slice(0, min(_COMPARED, count)), slice(max(count - _COMPARED, 0), count)):
        if dataset[rows.start + ends.start : rows.start + ends.stop].tobytes() != values[ends].tobytes():
            return None
    remember(values, Seen(sound and role == "time", sound and role != "time"))
    return values


def _part(file: int, begin: int, values: FloatArray, span: tuple[int, int], role: str | None) -> bool | None:
    """Read some of the rows of a column, and tell whether they look as its role asks; None where the file ends."""
    raw = memoryview(cast(Any, values.view(np.uint8)))
    look = _LOOKS.get(role or "")
    sound = True
    with np.errstate(all="ignore"):
        for first in range(*span, _CACHED):
            end = min(first + _CACHED, span[1])
            room = raw[first * _SIZE : end * _SIZE]
            if os.preadv(file, [room], begin + first * _SIZE) != len(room):
                return None
            sound = sound and (look is None or look(values[span[0] :], first - span[0], end - span[0]))
    return sound


def _rises(values: FloatArray, begin: int, end: int) -> bool:
    """Tell that numbers rise in these rows, and from the row before; infinite ends are for others to see."""
    before = max(begin - 1, 0)
    return bool((values[before + 1 : end] > values[before : end - 1]).all())


def _bounded(values: FloatArray, begin: int, end: int) -> bool:
    """Tell that numbers are forces; in doubt they are not: the sum of their squares says enough of usual ones."""
    block = values[begin:end]
    return float(block.dot(block)) <= LARGEST_FORCE**2


_LOOKS: Final[Mapping[str, Callable[[FloatArray, int, int], bool]]] = {
    "time": _rises,
    "normal_force": _bounded,
    "friction_force": _bounded,
}
"""What is looked for in columns with a role."""
