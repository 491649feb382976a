"""A walk through an HDF5 file within limited seconds of computing; a script too, for what may hang or crash on it.

Imports nothing of the package: a new interpreter that runs this file loads h5py and nothing else.
"""

from __future__ import annotations

import contextlib
import io
import signal
import sys
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import h5py

_MOST_ITEMS: Final = 100_000
_SMALL: Final = 1 << 20
LIBRARY_ERRORS: Final = (
    OSError, RuntimeError, KeyError, ValueError, TypeError, EOFError, AttributeError, OverflowError,
)  # fmt: skip
"""What h5py raises over a damaged file."""


def limited_walk(target: str | io.BytesIO, patience: int) -> None:
    """Touch every group, attribute and chunk index of a file once, without its numbers; the system ends this process
    when that takes more seconds of computing than `patience`.

    An error ends the look at one item only: behind a damaged dataset may stand one that hangs.
    """
    import resource

    import h5py

    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(used.ru_utime + used.ru_stime) + patience + (1 if used.ru_utime + used.ru_stime > 0.2 else 0)
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (limit, hard))
    signal.signal(signal.SIGXCPU, signal.SIG_DFL)
    with h5py.File(target, "r") as file:
        seen, stack = {h5py.h5o.get_info(file["/"].id).addr}, [file["/"]]
        while stack and len(seen) < _MOST_ITEMS:
            item, names = stack.pop(), list[str]()
            _touch(item)
            with contextlib.suppress(*LIBRARY_ERRORS):
                names.extend(item if isinstance(item, h5py.Group) else ())
            for name in names:
                with contextlib.suppress(*LIBRARY_ERRORS):
                    if not isinstance(item.get(name, getlink=True), h5py.HardLink):
                        continue
                    child = item[name]
                    address = h5py.h5o.get_info(child.id).addr
                    if address not in seen:
                        seen.add(address)
                        stack.append(child)


def _touch(item: h5py.HLObject) -> None:
    import h5py

    names = ["units", "unit", "Units", "Unit", "name"]  # which readers ask for, even where the list is damaged
    with contextlib.suppress(*LIBRARY_ERRORS):
        names.extend(item.attrs)
    for name in dict.fromkeys(names):
        with contextlib.suppress(*LIBRARY_ERRORS):
            item.attrs[name]
    if not isinstance(item, h5py.Dataset):
        return
    with contextlib.suppress(*LIBRARY_ERRORS):
        if item.is_virtual or item.external:
            return
        if item.chunks is not None:
            item.id.chunk_iter(lambda _: None)
        if item.size is not None and item.size * item.dtype.itemsize <= _SMALL:
            item[()]


if __name__ == "__main__":
    limited_walk(sys.argv[1], int(sys.argv[2]))
