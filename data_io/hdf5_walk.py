"""A walk through an HDF5 file within limited seconds of computing; a script too, for what may hang or crash on it.

Imports nothing of the package: a new interpreter that runs this file loads h5py and nothing else.
"""

from __future__ import annotations

import contextlib
import io
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    import h5py

_MOST_ITEMS: Final = 100_000
_SMALL: Final = 1 << 20
LIBRARY_ERRORS: Final = (
    OSError,
    RuntimeError,
    KeyError,
    ValueError,
    TypeError,
    EOFError,
    AttributeError,
    OverflowError,
)
"""What h5py raises over a damaged file."""


def limited_walk(target: Any, patience: int) -> None:
    """Walk through a file; the system ends this process when that takes more seconds of computing than `patience`."""
    import resource

    import h5py  # noqa: F401  before the clock starts

    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(used.ru_utime + used.ru_stime) + patience + (1 if used.ru_utime + used.ru_stime > 0.2 else 0)
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (limit, hard))
    signal.signal(signal.SIGXCPU, signal.SIG_DFL)
    walk(target)


def walk(target: str | Path | io.BytesIO) -> None:
    """Touch every group, attribute and chunk index of a file once, without its numbers.

    An error ends the look at one item only: behind a damaged dataset may stand one that hangs.
    """
    import h5py

    with h5py.File(target, "r") as file:
        seen, stack = {h5py.h5o.get_info(file["/"].id).addr}, [file["/"]]
        while stack and len(seen) < _MOST_ITEMS:
            group = stack.pop()
            _touch(group)
            for _, item in _children_there(group):
                address = h5py.h5o.get_info(item.id).addr
                if address in seen:
                    continue
                seen.add(address)
                if isinstance(item, h5py.Group):
                    stack.append(item)
                elif isinstance(item, h5py.Dataset):
                    _touch(item)


def _children_there(group: h5py.Group) -> list[tuple[str, h5py.HLObject]]:
    import h5py

    names: list[str] = []
    found: list[tuple[str, h5py.HLObject]] = []
    with contextlib.suppress(*LIBRARY_ERRORS):
        names.extend(group)
    for name in names:
        with contextlib.suppress(*LIBRARY_ERRORS):
            if isinstance(group.get(name, getlink=True), h5py.HardLink):
                found.append((name, group[name]))
    return found


def _touch(item: h5py.HLObject) -> None:
    names = ["units", "unit", "Units", "Unit", "name"]  # which readers ask for, even where the list is damaged
    with contextlib.suppress(*LIBRARY_ERRORS):
        names.extend(item.attrs)
    for name in dict.fromkeys(names):
        with contextlib.suppress(*LIBRARY_ERRORS):
            item.attrs[name]
    with contextlib.suppress(*LIBRARY_ERRORS):
        _touch_numbers(item)


def _touch_numbers(item: h5py.HLObject) -> None:
    import h5py

    if not isinstance(item, h5py.Dataset) or item.is_virtual or item.external:
        return
    if item.chunks is not None:
        item.id.chunk_iter(lambda _: None)
    if item.size is not None and item.size * item.dtype.itemsize <= _SMALL:
        item[()]


if __name__ == "__main__":
    limited_walk(sys.argv[1], int(sys.argv[2]))
