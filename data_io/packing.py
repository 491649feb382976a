"""Packed logs (gz, zip): unpacked as a stream that refuses what no log is, before memory or time goes."""

import gzip
import io
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final, cast

from data_io.errors import LogError

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
        if packing.kind == "gz":
            return io.BufferedReader(_Watched(path, cast(IO[bytes], gzip.open(path, "rb")), path.stat().st_size))
        archive = zipfile.ZipFile(path)
        info = archive.getinfo(packing.member)
        return io.BufferedReader(_Watched(path, archive.open(info), info.compress_size))
    except (OSError, zipfile.BadZipFile, RuntimeError, NotImplementedError, ValueError) as error:
        raise _damaged(path, packing, error) from error


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
