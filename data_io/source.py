"""A log file: opened read-only, hashed once, unpacked as a stream where it is packed."""

import io
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from threading import Thread
from typing import IO, Final

from data_io.digest import file_sha256
from data_io.errors import LogError
from data_io.frozen import Later
from data_io.packing import Packing, packing_of, split_member, unpacked

HEAD: Final = 65536
"""Bytes that a reader sees when it is asked whether it can read a file."""

LARGEST_WHOLE: Final = 1 << 31
"""Bytes of a packed file that may be taken into memory as a whole."""


@dataclass(frozen=True)
class Source:
    """One log: its path, how it is packed (None: not), and its first bytes, unpacked."""

    path: Path
    packing: Packing | None
    head: bytes = field(repr=False)
    held: bytes | None = field(default=None, repr=False)
    """Bytes to read instead of the file's: a sheet of a workbook as text."""

    @cached_property
    def hashing(self) -> "Future[str]":
        """The SHA-256 being computed in a thread of its own; first asked for where reading begins."""
        future: Future[str] = Future()
        Thread(target=_hash, args=(split_member(self.path)[0], future), daemon=True).start()
        return future

    @property
    def later_sha256(self) -> Later:
        """The SHA-256 for the account of a record: waited for, or computed, when somebody asks for it."""
        path, before = split_member(self.path)[0], self.size
        if "hashing" in self.__dict__:
            future = self.hashing
            return Later(lambda: _waited_for(path, future))
        return Later(lambda: _hash_unchanged(path, before))

    @property
    def sha256(self) -> str:
        """SHA-256 of the file as it lies on disk."""
        return _waited_for(self.path, self.hashing)

    @cached_property
    def data(self) -> bytes:
        """All bytes, unpacked; for formats that cannot be streamed. Raises `LogError` where a packed file is huge."""
        with self.open() as handle:
            if self.packing is None:
                return handle.read()
            data = handle.read(LARGEST_WHOLE + 1)
        if len(data) > LARGEST_WHOLE:
            raise self.error(f"more than {LARGEST_WHOLE >> 30} GiB are packed in the file; less fits here; unpack it")
        return data

    @property
    def size(self) -> int:
        """Bytes of the file on disk."""
        return split_member(self.path)[0].stat().st_size

    def open(self) -> IO[bytes]:
        """Open the unpacked bytes for reading, from the start. A file that is not packed can be sought."""
        if self.held is not None:
            return io.BytesIO(self.held)
        return unpacked(split_member(self.path)[0], self.packing)

    def error(self, sentence: str) -> LogError:
        """Return the error of this log with its path in front."""
        return LogError(f"{self.path}: {' '.join(sentence.split())}")


def _hash(path: Path, future: "Future[str]") -> None:
    try:
        future.set_result(file_sha256(path))
    except OSError as error:
        future.set_exception(error)


def _waited_for(path: Path, future: "Future[str]") -> str:
    try:
        return future.result()
    except OSError as error:
        raise LogError(f"{path}: the file cannot be read to its end ({error.strerror}); copy it again") from error


def _hash_unchanged(path: Path, size: int) -> str:
    """The SHA-256 of a file that has the size it had when it was read."""
    try:
        if path.stat().st_size != size:
            raise LogError(f"{path}: the file has changed since it was read; read it again")
        return file_sha256(path)
    except OSError as error:
        raise LogError(f"{path}: the file cannot be read again ({error.strerror}); put it back") from error


def no_progress(_share: float) -> None:
    """Progress that nobody watches."""


@dataclass(frozen=True)
class Request:
    """What the user said about a log: run and step, column names, units, a constant normal force [N], which channels.

    rate: sampling rate [Hz] that makes the clock, whatever the file has for one. channels: names of the columns to
    keep beside those with a role; None keeps all. window: (start, stop) [s] from the first row on; None reads all of
    it. exclude: stretches that nobody uses, counted likewise. progress: called with the share of the file read so far,
    0 to 1.
    """

    step: int | None = None
    run: int | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    columns: Mapping[str, str] = field(default_factory=dict)
    normal_force: float | None = None
    channels: tuple[str, ...] | None = None
    progress: Callable[[float], None] = no_progress
    window: tuple[float, float] | None = None
    exclude: tuple[tuple[float, float], ...] = ()
    rate: float | None = None


def load(path: Path) -> Source:
    """Look at a file. Raises `LogError` for what is missing, empty, a folder, not readable or not unpackable."""
    archive, member = split_member(path)
    try:
        with archive.open("rb") as handle:
            head = handle.read(HEAD)
    except FileNotFoundError as error:
        raise LogError(f"{path}: there is no such file; the path of a log was expected; check it") from error
    except IsADirectoryError as error:
        raise LogError(f"{path}: this is a folder; a log file was expected; name a file in it") from error
    except PermissionError as error:
        raise LogError(
            f"{path}: the file may not be read; a readable log is needed; close it in the program that holds it, or "
            "check its permissions"
        ) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise LogError(f"{path}: the file cannot be opened ({reason}); a readable log is needed; check it") from error
    if not head:
        raise LogError(f"{path}: the file is empty; a log with rows of numbers was expected; export it again")
    packing = packing_of(archive, head, member)
    if packing is not None:
        with unpacked(archive, packing) as stream:
            head = stream.read(HEAD)
        if not head:
            raise LogError(f"{path}: the compressed file is empty; a log was expected; export it again")
    return Source(path, packing, head)
