"""Whether a log lies where a path says (a file, a folder, a pattern, a file in an archive), and its SHA-256."""

from pathlib import Path

from data_io.digest import file_sha256, sha256_of_several
from data_io.errors import LogError
from data_io.packing import members, split_member
from data_io.series import is_series, logs_at


def log_is_at(path: Path) -> bool:
    """Tell whether there is something to read at a path; what it holds is another matter."""
    try:
        archive, member = split_member(path)
        if member is not None:
            return member in members(archive)
        return bool(logs_at(path)) if is_series(path) else path.is_file()
    except (LogError, OSError, ValueError):
        return False


def digest_of(path: Path) -> str:
    """SHA-256 of a log, as `Record.metadata` has it: of its file or archive, of several files that of their digests.

    Raises `LogError` or `OSError` where they cannot be read.
    """
    if is_series(path):
        return sha256_of_several(file_sha256(split_member(each)[0]) for each in logs_at(path))
    return file_sha256(split_member(path)[0])
