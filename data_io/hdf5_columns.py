"""Columns that lie within one HDF5 dataset: of a matrix by number (`/data:1`), of a compound by name (`/table:Fx`)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

_NAMES: Final = ("columns", "column_names", "names", "labels", "channels", "channel_names", "fields", "header")
"""Attributes in which programmes keep the names of the columns of a matrix."""
_UNITS: Final = ("units", "unit", "Units", "Unit", "column_units")
_WIDEST: Final = 256
"""Columns of the widest matrix: wider ones are pictures and spectra."""


@dataclass(frozen=True)
class ColumnWithin:
    """A column (n,) of a dataset, read as a dataset is; of a matrix the longer side runs along the rows."""

    dataset: Any
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


def columns_within(dataset: Any) -> list[ColumnWithin]:
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


def named_within(dataset: Any) -> bool:
    """Tell a dataset that names the columns within it itself."""
    return bool(dataset.dtype.names) or any(key in dataset.attrs for key in _NAMES)


def texts(value: Any) -> Sequence[str]:
    """Return an attribute as texts; of one text the words between its commas, of none nothing."""
    if value is None:
        return []
    if isinstance(value, (str, bytes)):
        whole = value.decode("utf-8", errors="replace") if isinstance(value, bytes) else value
        return [part.strip() for part in whole.split(",")]
    found = list(_flat(value))
    return found if len(found) != 1 else [part.strip() for part in found[0].split(",")]


def _flat(value: Any) -> Iterator[str]:
    for part in np.ravel(np.asarray(value, dtype=object)):
        yield part.decode("utf-8", errors="replace") if isinstance(part, bytes) else str(part)


def _unit(dataset: Any, place: int, count: int) -> dict[str, Any]:
    told = next((found for key in _UNITS if len(found := texts(dataset.attrs.get(key))) == count), None)
    return {} if told is None else {"units": told[place]}
