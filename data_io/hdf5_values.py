"""Numbers of HDF5 datasets: whether they fit into memory, columns within a dataset, and how they are read."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from data_io.source import LEAST_SUSPECT, Source
from data_io.values import FloatArray, LogTooLargeError

if TYPE_CHECKING:
    import h5py

# How much memory a log may take, asked before it is read.

_SHARE: Final = 0.5
"""Of the free memory, that the columns of one log may take: whoever looks at them needs as much again."""
FEWEST_COLUMNS: Final = 3
"""A clock and two forces."""
_MOST_PACKED: Final = 1100
"""Times that deflation can pack bytes that are all alike."""
_MOST_UNWRITTEN: Final = 10
"""Times the bytes that were written: a logger asks for room, and may stop before it is used."""
_SMALL: Final = 1 << 26
"""Bytes that are never refused."""


def check_memory(source: Source, rows: int, columns: int, until: Callable[[int], float] | None) -> None:
    """Refuse so many float64 numbers where they do not fit into memory. Raises `LogTooLargeError`.

    until: tells the time [s] of a row; None where no part of the rows can be read.
    """
    wanted, free = 8 * rows * columns, free_memory()
    if wanted <= _SMALL or free is None or wanted <= _SHARE * free:
        return
    fewer = ", or fewer columns with --channels none" if columns > FEWEST_COLUMNS else ""
    part = f"write a part of its rows to a file of its own{fewer.replace(', or ', ', or read ')}"
    if until is not None:
        stop = f"{until(int(rows * _SHARE * free / wanted) - 1):.4g} s"
        part = (
            f'read a part of the log with --window "0 s,{stop}" (in a scene: window = ["0 s", "{stop}"] in its '
            f"[[logs]]), one step with --step{fewer}"
        )
    refused = source.error(
        f"the columns asked for take {wanted / 1e9:.3g} GB where {free / 1e9:.3g} GB of memory are free; {part}"
    )
    raise LogTooLargeError(str(refused))


def check_promise(source: Source, name: str, promised: int, stored: int, packed: bool) -> None:
    """Refuse a column that promises so many bytes and holds next to none: no memory is taken for them.

    packed: whether its bytes are compressed. Raises the source's `LogError`.
    """
    if promised > max(LEAST_SUSPECT, (_MOST_PACKED if packed else _MOST_UNWRITTEN) * stored):
        raise source.error(
            f"the dataset {name!r} promises {promised / 1e6:.4g} MB and holds {stored / 1e6:.3g} MB; was it never "
            "written to its end? Copy or export it again"
        )


def free_memory() -> int | None:
    """Return the bytes that this process may still take, None where the system does not tell."""
    told = [_of_system(), _of_process()]
    return min((size for size in told if size is not None), default=None)


def _of_system() -> int | None:
    with contextlib.suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    return None


def _of_process() -> int | None:
    """Where a limit is set for the process (ulimit -v)."""
    if sys.platform == "win32":
        return None
    import resource

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return None
    with contextlib.suppress(OSError, ValueError, IndexError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        return max(limit - pages * resource.getpagesize(), 0)
    return limit


# Columns that lie within one HDF5 dataset: of a matrix by number (`/data:1`), of a compound by name (`/table:Fx`).

_NAMES: Final = ("columns", "column_names", "names", "labels", "channels", "channel_names", "fields", "header")
"""Attributes in which programmes keep the names of the columns of a matrix."""
_UNITS: Final = ("units", "unit", "Units", "Unit", "column_units")
_WIDEST: Final = 256
"""Columns of the widest matrix: wider ones are pictures and spectra."""


@dataclass(frozen=True)
class ColumnWithin:
    """A column (n,) of a dataset, read as a dataset is; of a matrix the longer side runs along the rows."""

    dataset: h5py.Dataset
    key: int | str
    label: str
    attrs: dict[str, Any]

    @property
    def name(self) -> str:
        """Path of the column."""
        return f"{self.dataset.name}:{self.key + 1 if isinstance(self.key, int) else self.key}"

    @property
    def size(self) -> int:
        """Number of rows."""
        return int(max(self.dataset.shape))

    @property
    def shape(self) -> tuple[int]:
        """One column."""
        return (self.size,)

    @property
    def ndim(self) -> int:
        """That of the dataset, which is read otherwise than one that is a column; never 1."""
        return 2

    @property
    def dtype(self) -> Any:
        """Type of the numbers."""
        return self.dataset.dtype[self.key] if isinstance(self.key, str) else self.dataset.dtype

    def __getattr__(self, name: str) -> Any:
        return getattr(self.dataset, name)

    def __getitem__(self, key: Any) -> Any:
        rows = key[0] if isinstance(key, tuple) and key else slice(None)
        if isinstance(self.key, str):
            return np.ravel(self.dataset[self.key])[rows]
        upright = self.dataset.shape[0] >= self.dataset.shape[1]
        return self.dataset[rows, self.key] if upright else self.dataset[self.key, rows]


def columns_within(dataset: h5py.Dataset) -> list[ColumnWithin]:
    """Return the columns of a compound or of a matrix of numbers; none of anything else."""
    shape: tuple[int, ...] = tuple(dataset.shape or ())
    if dataset.dtype.names:
        if len([size for size in shape if size != 1]) > 1:
            return []
        fields = [
            name for name in dataset.dtype.names if dataset.dtype[name].kind in "fiu" and not dataset.dtype[name].shape
        ]
        return [ColumnWithin(dataset, name, name, _unit(dataset, i, len(fields))) for i, name in enumerate(fields)]
    if len(shape) != 2 or dataset.dtype.kind not in "fiu" or not 1 < min(shape) <= _WIDEST or shape[0] == shape[1]:
        return []
    count = min(shape)
    names = next((told for key in _NAMES if len(told := texts(dataset.attrs.get(key))) == count), None)
    base = dataset.name.rpartition("/")[2]
    labels: Sequence[str] = names or [f"{base}:{i + 1}" for i in range(count)]
    return [ColumnWithin(dataset, i, label, _unit(dataset, i, count)) for i, label in enumerate(labels)]


def named_within(dataset: h5py.Dataset) -> bool:
    """Tell a dataset that names the columns within it itself."""
    return bool(dataset.dtype.names) or any(key in dataset.attrs for key in _NAMES)


def texts(value: Any) -> Sequence[str]:
    """Return an attribute as texts; of one text the words between its commas, of none nothing."""
    found = [] if value is None else np.ravel(np.asarray(value, dtype=object)).tolist()
    words = [part.decode("utf-8", errors="replace") if isinstance(part, bytes) else str(part) for part in found]
    return words if len(words) != 1 else [part.strip() for part in words[0].split(",")]


def _unit(dataset: h5py.Dataset, place: int, count: int) -> dict[str, Any]:
    told = next((found for key in _UNITS if len(found := texts(dataset.attrs.get(key))) == count), None)
    return {} if told is None else {"units": told[place]}


# Numbers of an HDF5 dataset, all of them or some rows.

_BLOCK: Final = 1 << 24
"""Rows read at a time; progress is told after each."""


def read_values(dataset: h5py.Dataset, rows: slice, tell: Callable[[float], None]) -> FloatArray:
    """Return the rows of a dataset, which is a column, as float64 (n,). tell: called with the share read."""
    count = rows.stop - rows.start
    if dataset.ndim != 1:
        tell(1.0)
        return np.asarray(dataset[()], dtype=np.float64).reshape(-1)[rows].copy()
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
