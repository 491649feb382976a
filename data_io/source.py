"""A log file in memory: read once, hashed once, unpacked if gz-compressed."""

import gzip
import hashlib
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from data_io.errors import LogError

HEAD = 65536
"""Bytes that a reader sees when it is asked whether it can read a file."""


@dataclass(frozen=True)
class Source:
    """The bytes of one log (unpacked), its path, and the SHA-256 of the file as it lies on disk."""

    path: Path
    data: bytes = field(repr=False)
    sha256: str

    @property
    def head(self) -> bytes:
        """The first bytes, by which readers tell formats apart."""
        return self.data[:HEAD]

    def error(self, sentence: str) -> LogError:
        """Return the error of this log with its path in front."""
        return LogError(f"{self.path}: {' '.join(sentence.split())}")


@dataclass(frozen=True)
class Request:
    """What the user said about a log: which run and step, column names, units, a constant normal force [N]."""

    step: int | None = None
    run: int | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    columns: Mapping[str, str] = field(default_factory=dict)
    normal_force: float | None = None


def load(path: Path) -> Source:
    """Read a file once. Raises `LogError` for what is missing, empty, a folder, not readable or not unpackable."""
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise LogError(f"{path}: there is no such file; the path of a log was expected; check it") from error
    except IsADirectoryError as error:
        raise LogError(f"{path}: this is a folder; a log file was expected; name a file in it") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise LogError(f"{path}: the file cannot be opened ({reason}); a readable log is needed; check it") from error
    if not data:
        raise LogError(f"{path}: the file is empty; a log with rows of numbers was expected; export it again")
    digest = hashlib.sha256(data).hexdigest()
    if data.startswith(b"\x1f\x8b"):
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError, zlib.error) as error:
            raise LogError(f"{path}: the gz-compressed file is damaged ({error}); copy or export it again") from error
        if not data:
            raise LogError(f"{path}: the compressed file is empty; a log was expected; export it again")
    return Source(path, data, digest)
