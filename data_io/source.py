"""A log file: opened read-only, hashed once, unpacked as a stream where it is packed."""

import contextlib
import gzip
import hashlib
import io
import mmap
import os
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Final, Self, cast

from data_io.values import LogError, listed

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
HEAD: Final = 65536
"""Bytes that a reader sees when it is asked whether it can read a file."""
OF_DAMAGE: Final[tuple[type[Exception], ...]] = (
    OSError, EOFError, zipfile.BadZipFile, zlib.error, struct.error, ValueError, TypeError, LookupError, AttributeError,
    SyntaxError, RuntimeError, ArithmeticError, AssertionError,
)  # fmt: skip
"""What libraries raise over damaged files."""
_LARGEST: Final = 1 << 31  # bytes of a packed file that may be taken into memory


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


def _unpacked(path: Path, head: bytes, member: str | None) -> bytes | None:
    """Return the bytes of a packed log, None where it is not packed. Raises `LogError` for a damaged file or a trap."""
    if head.startswith(_ZIP) and zipfile.is_zipfile(path):
        names = members(path)
        held = listed(names)
        if any(name in _EXCEL for name in names):  # a workbook is a zip, too
            return None
        if member is None and len(names) != 1:
            content = f"the archive holds {len(names)} files ({held})" if names else "the archive holds no file"
            raise LogError(f"{path}: {content}; one log was expected; name one, as in {path.name}/<file>, or unpack it")
        member = names[0] if member is None else member
        if member not in names:
            raise LogError(f"{path}: no {member!r} was found in the archive; it holds {held}; name one of them")
    elif head.startswith(_GZIP):
        member = None
    else:
        return None
    try:
        with contextlib.ExitStack() as stack:
            if member is None:
                size, stream = path.stat().st_size, cast(IO[bytes], stack.enter_context(gzip.open(path, "rb")))
            else:
                archive = stack.enter_context(zipfile.ZipFile(path))
                size, stream = archive.getinfo(member).compress_size, stack.enter_context(archive.open(member))
            most = min(_LARGEST, max(LEAST_SUSPECT, MOST_TIMES * size))
            data = stream.read(most + 1)
    except (OSError, EOFError, zlib.error, zipfile.BadZipFile, RuntimeError, NotImplementedError, ValueError) as error:
        raise LogError(
            f"{path}: the packed file is damaged or locked ({error!s:.80}); copy or export it again"
        ) from error
    if len(data) > most:
        raise LogError(
            f"{path}: the file unpacks to more than {MOST_TIMES} times its size or {_LARGEST >> 30} GiB; a log packs "
            "to about a tenth; unpack it by other means and look what it holds"
        )
    return data


@dataclass(frozen=True)
class Source:
    """One log: its path, size [bytes] on disk, its first bytes, unpacked; held: all bytes where they do not stand in
    the file as such (packed, or a sheet of a workbook as text), else None."""

    path: Path
    size: int
    head: bytes = field(repr=False)
    held: bytes | None = field(default=None, repr=False)

    def read(self) -> bytes:
        """Return all bytes, unpacked."""
        return self.path.read_bytes() if self.held is None else self.held

    def text(self) -> bytes | mmap.mmap:
        """Return the same, of a large file in large pages of memory, which are filled in half the time."""
        if self.held is not None or self.size < (1 << 22) or not hasattr(mmap, "MADV_HUGEPAGE"):
            return self.read()
        data = mmap.mmap(-1, self.size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        data.madvise(mmap.MADV_HUGEPAGE)
        with self.path.open("rb") as handle:
            return data if handle.readinto(data) == self.size and not handle.read(1) else self.read()

    def file(self) -> str | io.BytesIO:
        """Return what a library may open: the path, or the unpacked bytes as a file."""
        return str(self.path) if self.held is None else io.BytesIO(self.held)

    def of_text(self, text: str) -> Self:
        """Return the same log with a text in place of its bytes."""
        held = text.encode()
        return replace(self, held=held, head=held[:HEAD])

    def error(self, sentence: str) -> LogError:
        """Return the error of this log with its path in front."""
        return LogError(f"{self.path}: {' '.join(sentence.split())}")

    @contextlib.contextmanager
    def read_by_library(self, file: str, remedy: str, *more: type[Exception]) -> Iterator[None]:
        """Say in a sentence that a file, as it is called here, is damaged; more: what its library alone raises then."""
        damage: tuple[type[Exception], ...] = (*OF_DAMAGE, *more)
        try:
            yield
        except damage as error:
            reason = " ".join(str(error).split())
            raise self.error(f"the {file} is damaged ({reason:.100}); {remedy}") from error


def no_progress(_share: float) -> None:
    """Progress that nobody watches."""


@dataclass(frozen=True)
class Request:
    """What the user said about a log: run and step, column names, units, a constant normal force [N], which channels.

    arm [m]: at which a torque acts; area [m^2]: on which a stress does. rate: sampling rate [Hz] that makes the clock,
    whatever the file has for one. channels: names of the columns to
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
    arm: float | None = None
    area: float | None = None


def load(path: Path) -> Source:
    """Look at a file. Raises `LogError` for what is missing, empty, a folder, not readable or not unpackable."""
    archive, member = split_member(path)
    try:
        if archive.exists() and not (archive.is_file() or archive.is_dir()):
            raise LogError(f"{path}: this is a pipe or a device; a log file was expected; save the log as a file first")
        with archive.open("rb") as handle:
            head, size = handle.read(HEAD), os.fstat(handle.fileno()).st_size
    except FileNotFoundError as error:
        remedy = "leave out the quotes, which belong to the name here" if str(path)[:1] in ("'", '"') else "check it"
        raise LogError(f"{path}: there is no such file; the path of a log was expected; {remedy}") from error
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
    held = _unpacked(archive, head, member)
    if held == b"":
        raise LogError(f"{path}: the compressed file is empty; a log was expected; export it again")
    return Source(path, size, head if held is None else held[:HEAD], held)
