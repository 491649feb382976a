"""HDF5 files opened so that they can do no harm: read-only, nothing outside the file followed, none that hangs."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from data_io import hdf5_walk
from data_io.source import Source
from data_io.values import LogError

if TYPE_CHECKING:
    import h5py

PATIENCE: Final = 1
"""Seconds of computing after which a file whose structure is not walked through is given up; a sound one takes
milliseconds. Of computing, so that a busy machine refuses nothing."""
_LONGEST: Final = 60.0
"""Seconds of waiting after which it is given up whatever the reason."""
_BYTES_PER_SECOND: Final = 2e9
_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"
_LONGEST_CHAIN: Final = 16
_HELD: Final = ("unable to lock file", "already open for write")
"""What the library says of a file that is sound, but not free."""
_walked: dict[tuple[str, int, int, int], str] = {}
"""Files that have been walked through, as they were then, and what was wrong with them, "" where nothing was."""


def signature_at(head: bytes) -> int | None:
    """Return where the HDF5 signature stands, at the start or behind a user block; None where it does not."""
    places = (0, 512, 1024, 2048, 4096, 8192, 16384, 32768)
    return next((place for place in places if head[place : place + 8] == _SIGNATURE), None)


@contextmanager
def opened(source: Source) -> Iterator[h5py.File]:
    """Open the file read-only; a packed one is unpacked in memory. Raises the source's `LogError` for a damaged one.

    A damaged file can send the HDF5 library round in circles, where nothing stops it: its heaps of texts carry no
    checksum in any version. Another process therefore walks through it first, and is stopped after `PATIENCE`.
    """
    import h5py

    target: Any = source.file()
    _look_first(source, target)
    try:
        with h5py.File(target, "r", **({"locking": "best-effort"} if source.held is None else {})) as file:
            yield file
    except LogError:
        raise
    except hdf5_walk.LIBRARY_ERRORS as error:
        reason = str(error).strip("'\"").split("\n")[0]
        if any(words in reason for words in _HELD):
            raise source.error(
                "another program has the HDF5 file open for writing, or ended without closing it; a closed file was "
                "expected; close it there, or after a crash run: h5clear -s FILE"
            ) from error
        raise _damaged(source, reason) from error


def _damaged(source: Source, reason: str) -> LogError:
    return source.error(f"the HDF5 file is damaged ({reason:.120}); an intact one is needed; copy it again")


def member(source: Source, file: h5py.File, path: str) -> h5py.Group | h5py.Dataset | None:
    """Return the group or dataset at a path, None where there is none.

    Raises the source's `LogError` for a link into another file: what is not in this file is not followed.
    """
    import h5py

    place, parts, links = file["/"], [part for part in path.split("/") if part], 0
    while parts:
        name = parts.pop(0)
        if not isinstance(place, h5py.Group):
            return None
        link = place.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise source.error(
                f"{path!r} is a link into another file ({link.filename!r}), which is not followed; copy the data into "
                "one file"
            )
        if isinstance(link, h5py.SoftLink):
            links += 1
            if links > _LONGEST_CHAIN:
                return None
            parts = [part for part in link.path.split("/") if part] + parts
            place = file["/"] if link.path.startswith("/") else place
        elif link is None:
            return None
        else:
            place = place[name]
    return place


def children(group: h5py.Group) -> Iterator[tuple[str, h5py.HLObject]]:
    """Yield name and object of everything that lies in a group itself; links to elsewhere are passed over."""
    import h5py

    for name in group:
        if isinstance(group.get(name, getlink=True), h5py.HardLink):
            yield name, group[name]


def check_own(source: Source, dataset: h5py.Dataset) -> None:
    """Refuse a dataset whose numbers lie in other files: external storage, virtual datasets."""
    if dataset.is_virtual or dataset.external:
        raise source.error(
            f"the numbers of {dataset.name!r} lie in other files, which are not followed; copy them into one file"
        )


def _look_first(source: Source, target: Any) -> None:
    """Have another process walk through the structure; a `LogError` where it hangs or dies of it."""
    if not hasattr(os, "fork") or not hasattr(signal, "SIGXCPU"):
        return  # Windows: no way to limit the computing of a process
    known = None
    if isinstance(target, str):  # what tells whether the file is still the one it was
        found = Path(target).stat()
        known = (os.path.realpath(target), found.st_ino, found.st_size, found.st_mtime_ns)
    wrong = None if known is None else _walked.get(known)
    if wrong is None:
        patience = PATIENCE + int(source.size / _BYTES_PER_SECOND)
        alone = sys.platform == "linux" and threading.active_count() == 1
        # a copy of this process would inherit the locks of its other threads
        walk = _forked if alone or not isinstance(target, str) else _spawned
        status = walk(target, patience)
        hangs, crashes = status is None or status == -signal.SIGXCPU, status is not None and status < 0
        wrong = "the library hangs on it" if hangs else "the library crashes on it" if crashes else ""
        if known is not None:
            _walked[known] = wrong
    if wrong:
        raise _damaged(source, wrong)


def _forked(target: Any, patience: int) -> int | None:
    """Walk in a copy of this process; return how it ended (negative: by that signal), None where it did not."""
    import h5py  # noqa: F401  in the parent, so that every child has it

    child = os.fork()
    if child == 0:
        with contextlib.suppress(BaseException):
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            hdf5_walk.limited_walk(target, patience)
        os._exit(0)
    until, pause = time.monotonic() + _LONGEST, 1e-4
    while time.monotonic() < until:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(pause)
        pause = min(2 * pause, 2e-3)  # a sound file takes some 20 ms
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def _spawned(path: str, patience: int) -> int | None:
    """The same in a new interpreter, which loads that one file and h5py: half the time of the whole package."""
    where = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        return subprocess.run(
            [sys.executable, "-P", hdf5_walk.__file__, str(Path(path).resolve()), str(patience)],
            env=where,
            timeout=_LONGEST,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        return None
    except OSError:  # no process can be started here: better an unguarded look than none
        return 0
