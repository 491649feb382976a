"""One batch at a time in a folder: a lock that ends with its process, however that ends."""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from identify.studies.refusal import BatchError

LOCK = ".lock"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder for this process.

    Raises:
        BatchError: another batch holds it. OSError: the file system knows no locks.
    """
    with (folder / LOCK).open("a+", encoding="utf-8") as handle:
        if not _take(handle):
            raise BatchError([f"{folder}: another batch is running there ({_holder(handle)}); wait for it, or stop it"])
        handle.seek(0)
        handle.truncate()
        json.dump({"pid": os.getpid(), "host": platform.node(), "since": time.strftime("%Y-%m-%d %H:%M:%S")}, handle)
        handle.flush()
        yield


def _take(handle: IO[str]) -> bool:
    """Whether the lock could be had. The system releases it when the process ends, also by kill -9."""
    if sys.platform == "win32":
        import msvcrt

        handle.seek(0)
        try:
            msvcrt.locking(handle.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True
    import fcntl

    try:
        fcntl.flock(handle.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _holder(handle: IO[str]) -> str:
    try:
        handle.seek(0)
        told = json.loads(handle.read())
        return f"process {told['pid']} on {told['host']} since {told['since']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "it has not told who it is"
