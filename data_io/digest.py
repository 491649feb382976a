"""SHA-256 of files, by which a log is told from another."""

import hashlib
from collections.abc import Iterable
from pathlib import Path


def file_sha256(path: Path) -> str:
    """SHA-256 of a file, read in blocks. Raises `OSError` where it cannot be read."""
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def sha256_of_several(digests: Iterable[str]) -> str:
    """SHA-256 of files that are one log: of their digests, one after the other."""
    return hashlib.sha256("".join(digests).encode()).hexdigest()
