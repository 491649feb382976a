"""A log file: opened read-only, hashed once, unpacked as a stream where it is packed."""

import gzip
import hashlib
import io
import os
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import IO, Final, cast

from data_io.values import LogError

# SHA-256 of files, by which a log is told from another.


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, read in blocks. Raises `OSError` where it cannot be read."""
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def sha256_unchanged(path: Path, size: int) -> str:
    """SHA-256 of a log's file if it still has the size it had when it was looked at. Raises `LogError`."""
    file = split_member(path)[0]
    try:
        if file.stat().st_size != size:
            raise LogError(f"{file}: the file has changed since it was read; read it again")
        return file_sha256(file)
    except OSError as error:
        raise LogError(f"{file}: the file cannot be read again ({error.strerror}); put it back") from error


def sha256_of_several(digests: Iterable[str]) -> str:
    """SHA-256 of files that are one log: of their digests, one after the other."""
    return hashlib.sha256("".join(digests).encode()).hexdigest()


# Packed logs (gz, zip): unpacked as a stream that refuses what no log is, before memory or time goes.

_GZIP: Final = b"\x1f\x8b"
_ZIP: Final = b"PK\x03\x04"
_EXCEL: Final = ("[Content_Types].xml", "mimetype")
_HIDDEN: Final = ("__MACOSX/", ".")

LEAST_SUSPECT: Final = 1 << 25
"""Bytes that may be unpacked whatever they were packed into."""
MOST_TIMES: Final = 100
"""A log packs to a tenth of its size; what packs to less than one in this many is a trap or holds nothing."""


@dataclass(frozen=True)
class Packing:
    """How a file is packed: kind ("gz", "zip") and the member of the archive, "" where there is only one stream."""

    kind: str
    member: str = ""


def packing_of(path: Path, head: bytes, member: str | None) -> Packing | None:
    """Tell by its first bytes how a file is packed, None where it is not. A workbook is a zip, but no packing.

    Raises `LogError` where an archive holds no file, several without a choice, or not the member asked for.
    """
    if head.startswith(_GZIP):
        return Packing("gz")
    if not head.startswith(_ZIP) or not zipfile.is_zipfile(path):
        return None
    names = members(path)
    if any(name in _EXCEL for name in names):
        return None
    if member is None and len(names) == 1:
        return Packing("zip", names[0])
    listed = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    if member is None:
        found = f"the archive holds {len(names)} files ({listed})" if names else "the archive holds no file"
        raise LogError(f"{path}: {found}; one log was expected; name one, as in {path.name}/<file>, or unpack it")
    if member not in names:
        raise LogError(f"{path}: no {member!r} was found in the archive; it holds {listed}; name one of them")
    return Packing("zip", member)


def members(path: Path) -> list[str]:
    """Return the files in a zip archive, folders and hidden files aside. Raises `LogError` where it is damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [info.filename for info in archive.infolist() if not info.is_dir()]
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise LogError(f"{path}: the zip archive is damaged ({error!s:.80}); copy or pack it again") from error
    return [name for name in names if not any(part.startswith(_HIDDEN) for part in (name, name.rsplit("/", 1)[-1]))]


def split_member(path: Path) -> tuple[Path, str | None]:
    """Split `folder/logs.zip/slow.txt` into the archive and its member; any other path stays whole."""
    for parent in path.parents:
        if parent.suffix.lower() == ".zip" and parent.is_file():
            return parent, path.relative_to(parent).as_posix()
    return path, None


def unpacked(path: Path, packing: Packing | None) -> IO[bytes]:
    """Open the bytes of a log for reading, unpacked. Reading raises `LogError` for a damaged file or a trap."""
    try:
        if packing is None:
            return path.open("rb")
        stream = _watched(path, packing)
        if _is_trap(path, packing):
            while stream.read(1 << 20):  # it is met before its lines are taken apart
                pass
            stream = _watched(path, packing)
        return stream
    except (OSError, zipfile.BadZipFile, RuntimeError, NotImplementedError, ValueError) as error:
        raise _damaged(path, packing, error) from error


def _watched(path: Path, packing: Packing) -> IO[bytes]:
    if packing.kind == "gz":
        return io.BufferedReader(_Watched(path, cast(IO[bytes], gzip.open(path, "rb")), path.stat().st_size))
    archive = zipfile.ZipFile(path)
    info = archive.getinfo(packing.member)
    return io.BufferedReader(_Watched(path, archive.open(info), info.compress_size))


def _is_trap(path: Path, packing: Packing) -> bool:
    """Whether a packed file states a size that no log has; of a gz file that is cut off, its end states any."""
    if packing.kind == "zip":
        info = zipfile.ZipFile(path).getinfo(packing.member)
        return info.file_size > max(LEAST_SUSPECT, MOST_TIMES * info.compress_size)
    size = path.stat().st_size
    with path.open("rb") as stream:
        stream.seek(max(size - 4, 0))
        return int.from_bytes(stream.read(4), "little") > max(LEAST_SUSPECT, MOST_TIMES * size)


class _Watched(io.RawIOBase):
    """A stream that counts what it unpacks and turns every failure into a sentence."""

    def __init__(self, path: Path, inner: IO[bytes], packed_size: int) -> None:
        self._path, self._inner, self._most = path, inner, max(LEAST_SUSPECT, MOST_TIMES * packed_size)
        self._done = 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: object) -> int:
        view = memoryview(buffer)  # type: ignore[arg-type]
        try:
            data = self._inner.read(len(view))
        except (OSError, EOFError, zlib.error, zipfile.BadZipFile, RuntimeError, ValueError) as error:
            raise _damaged(self._path, None, error) from error
        self._done += len(data)
        if self._done > self._most:
            raise LogError(
                f"{self._path}: the file unpacks to more than {MOST_TIMES} times its size; a log packs to about a "
                "tenth; unpack it by other means and look what it holds"
            )
        view[: len(data)] = data
        return len(data)

    def close(self) -> None:
        self._inner.close()
        super().close()


def _damaged(path: Path, packing: Packing | None, error: Exception) -> LogError:
    kind = "packed file" if packing is None else f"{packing.kind} file"
    return LogError(f"{path}: the {kind} is damaged or locked ({error!s:.80}); copy or export it again")


HEAD: Final = 65536
"""Bytes that a reader sees when it is asked whether it can read a file."""

LARGEST_WHOLE: Final = 1 << 31
"""Bytes of a packed file that may be taken into memory as a whole."""


@dataclass(frozen=True)
class Source:
    """One log: its path, size [bytes] on disk, how it is packed (None: not), and its first bytes, unpacked."""

    path: Path
    size: int
    packing: Packing | None
    head: bytes = field(repr=False)
    held: bytes | None = field(default=None, repr=False)
    """Bytes to read instead of the file's: a sheet of a workbook as text."""

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

    def open(self) -> IO[bytes]:
        """Open the unpacked bytes for reading, from the start. A file that is not packed can be sought."""
        if self.held is not None:
            return io.BytesIO(self.held)
        return unpacked(split_member(self.path)[0], self.packing)

    def error(self, sentence: str) -> LogError:
        """Return the error of this log with its path in front."""
        return LogError(f"{self.path}: {' '.join(sentence.split())}")


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
        if archive.exists() and not (archive.is_file() or archive.is_dir()):
            raise LogError(f"{path}: this is a pipe or a device; a log file was expected; save the log as a file first")
        with archive.open("rb") as handle:
            head, size = handle.read(HEAD), os.fstat(handle.fileno()).st_size
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
    return Source(path, size, packing, head)
