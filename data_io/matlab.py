"""MATLAB files up to version 7 (.mat); later ones are HDF5."""

import io
import struct
import warnings
import zlib
from typing import Any, Final

import numpy as np

from data_io.columns import match_header, shown
from data_io.frozen import FloatArray
from data_io.part import Contents, Part
from data_io.source import Request, Source

NAME: Final = "matlab"
_MARK: Final = b"MATLAB 5.0 MAT-file"
_DEEPEST: Final = 4
_OF_DAMAGE: Final = (
    ValueError, TypeError, OSError, LookupError, NotImplementedError, MemoryError, ArithmeticError, AttributeError,
    EOFError, struct.error, zlib.error, RuntimeError,
)  # fmt: skip
"""What scipy raises over damaged files."""


def can_read(head: bytes) -> bool:
    """Tell a .mat by its first words."""
    return head.startswith(_MARK)


def read(source: Source, request: Request) -> Contents:
    """Read the columns of a .mat of versions 5 to 7: vectors, fields of structs, or columns of matrices.

    Vectors called as a time and forces are found by name (`t`, `Fx_N`, `log.Fz`), others by --columns; the columns of
    a matrix `data` are `data:1`, `data:2`, ... MATLAB stores no units: a suffix of the name, or --units, says them.
    Raises `LogError`.
    """
    columns = _columns(source)
    sizes = [values.size for values in columns.values()]
    wanted = {name for name in request.columns.values() if name in columns}
    size = columns[next(iter(wanted))].size if wanted else max(sizes, key=sizes.count, default=0)
    kept = {name: values for name, values in columns.items() if values.size == size}
    if size < 2 or (lost := wanted - set(kept)):
        found = shown((f"{name} ({columns[name].size})" for name in columns), most=12) or "none"
        what = "differ in length" if size >= 2 and lost else "are no columns of a log"
        raise source.error(f"the variables {found} {what}; vectors of one length were expected; name them")
    last = [name.rpartition(".")[2] for name in kept]
    header = match_header(last if len(set(last)) == len(last) and not wanted else list(kept), request.columns)
    return Contents(NAME, [Part(1, 1, header, dict(enumerate(kept.values())))])


def _columns(source: Source) -> dict[str, FloatArray]:
    import scipy.io
    from scipy.io.matlab import MatReadError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            items = scipy.io.loadmat(io.BytesIO(source.data), struct_as_record=False, squeeze_me=False)
    except (MatReadError, *_OF_DAMAGE) as error:
        reason = " ".join(str(error).split())
        raise source.error(f"the .mat file is damaged ({reason:.100}); copy or save it again") from error
    found: dict[str, FloatArray] = {}
    for name, value in items.items():
        if not name.startswith("__"):
            _collect(name, value, found, 0)
    return found


def _collect(name: str, value: Any, found: dict[str, FloatArray], depth: int) -> None:
    """Put every column of a variable into `found`: a vector, the columns of a matrix, the fields of a struct."""
    if not isinstance(value, np.ndarray):
        if hasattr(value, "_fieldnames") and depth < _DEEPEST:
            for field in value._fieldnames:
                _collect(f"{name}.{field}", getattr(value, field), found, depth + 1)
        return
    if value.dtype == object:
        if value.size == 1:
            _collect(name, value.reshape(-1)[0], found, depth)
        return
    if value.dtype.kind not in "fiu" or value.ndim > 2:
        return
    if min(value.shape, default=0) == 1:
        found[name] = np.asarray(value, dtype=np.float64).reshape(-1)
    elif value.ndim == 2 and value.shape[0] > value.shape[1] > 0:
        for i in range(value.shape[1]):
            found[f"{name}:{i + 1}"] = np.asarray(value[:, i], dtype=np.float64)
