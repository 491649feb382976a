"""The folder of a batch and its jobs: groups appear in it whole, by one rename, put there by the holder of the lock.

What is being written stands under a hidden name, and counts for nothing until it is put.
"""

from __future__ import annotations

import errno
import hashlib
import importlib.metadata
import json
import os
import platform
import re
import secrets
import shutil
import sys
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from data_io.atomic import atomic_write
from identify.base.document import RESULT_FILES, read_json
from identify.base.errors import IdentifyError

Document = dict[str, Any]

CONVERGED = "converged"
FAILED, TIMED_OUT, CRASHED, DEFECT = "failed", "timed_out", "crashed", "defect"
OUTDATED = "outdated"  # a log or the program changed while the batch ran
UNWRITTEN = "unwritten"  # the disk is full or may not be written to: no end of a fit, but of the batch
WAITING = "waiting"
TRY_AGAIN = (TIMED_OUT, CRASHED, DEFECT, OUTDATED)  # ends that the content does not decide: a resumed batch tries again
PACKAGES = ("casadi", "numpy", "scipy", "pandas", "h5py")  # whose numbers a fit uses
OUTSIDE = ("app", "cli", "examples", "report", "studies")  # rooms that make no number of a fit
LONGEST = 80  # characters of a folder name
# What a batch itself writes, and what Windows keeps for itself: no folder may be called so.
_PORTS = [f"{port}{i}" for port in ("com", "lpt") for i in range(1, 10)]
RESERVED = frozenset(["batch.json", "index.csv", "report.html", "con", "prn", "aux", "nul", *_PORTS])


class BatchError(IdentifyError):
    """A batch cannot begin. `complaints` holds one sentence per thing to mend; the text counts them."""

    def __init__(self, *complaints: str) -> None:
        self.complaints = complaints
        first, number = complaints[0], len(complaints)
        super().__init__(first if number == 1 else f"{number} things to correct, first {first}")


@dataclass(frozen=True)
class LogFile:
    """One log of a job: absolute path, SHA-256 of the file, labels."""

    path: str
    sha256: str
    labels: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Job:
    """One group: its name and folder, the document of its scene (SI, absolute paths), its logs in the scene's order.

    key: of the content, see `content_key`; numerics: version it was planned with; labels: of the group;
    size: bytes of all its logs.
    """

    group: str
    folder: str
    key: str
    numerics: str
    scene: Document
    logs: tuple[LogFile, ...]
    labels: Mapping[str, str]
    size: int

    def as_document(self) -> Document:
        """As JSON knows it; `from_document` takes it back."""
        return asdict(self)

    @staticmethod
    def from_document(document: Document) -> Job:
        """The job again."""
        return Job(**{**document, "logs": tuple(LogFile(**log) for log in document["logs"])})


@dataclass(frozen=True)
class End:
    """How a job ended: a status of the room's docstring, one sentence, traceback or None, seconds by stage, whether the
    time limit of the batch ended its fit."""

    status: str
    message: str
    detail: str | None = None
    timing_s: Mapping[str, float] = field(default_factory=dict)
    limited: bool = False

    @staticmethod
    def of(document: Document) -> End:
        """The end that a job.json states."""
        timing, limited = document.get("timing_s") or {}, document.get("limited", False)
        return End(document["status"], document["message"], document.get("detail"), timing, limited)

    @property
    def has_result(self) -> bool:
        """Whether a result.json was written."""
        return self.status not in (FAILED, *TRY_AGAIN)


def folder_names(groups: Sequence[str]) -> dict[str, str]:
    """A folder name for each group: its own where that is harmless and unlike all others, else with a hash behind.

    Harmless are word characters and a few signs, without a leading or trailing dot, not reserved, not too long.
    """
    plain = {}
    for group in groups:
        name = re.sub(r"[^\w.+=@()\[\] -]+", "_", group).strip("._- ")
        name = name.encode()[:LONGEST].decode("utf-8", "ignore").rstrip("._- ")
        taken = not name or {name.split(".")[0].casefold(), name.casefold()} & RESERVED
        plain[group] = f"group_{name}".rstrip("_") if taken else name
    times = Counter(name.casefold() for name in plain.values())
    for group, name in plain.items():
        if name != group or times[name.casefold()] > 1:
            plain[group] = f"{name}-{hashlib.sha256(group.encode('utf-8', 'surrogatepass')).hexdigest()[:8]}"
    return plain


@lru_cache(maxsize=1)
def numerics() -> str:
    """The version of the numerics: this package's version, a hash of the source that makes the numbers, libraries."""
    import data_io
    import identify

    digest = hashlib.sha256()
    for package in (data_io, identify):
        folder = Path(str(package.__file__)).parent
        for path in sorted(folder.rglob("*.py")):
            inside = path.relative_to(folder)
            if inside.parts[0] not in OUTSIDE:
                digest.update(f"{folder.name}/{inside.as_posix()}\n".encode())
                digest.update(path.read_bytes())
    versions = " ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES)
    return f"{importlib.metadata.version('stick-slip-workbench')}+{digest.hexdigest()[:12]} {versions}"


def content_key(scene: Document, sha256: Sequence[str], version: str) -> str:
    """SHA-256 over the scene, the contents of its logs and the version of the numerics.

    Args:
        scene: the document of the scene, SI. Its name and where the logs lie do not count.
        sha256: of each log's file, in the scene's order. version: as `numerics` gives it.
    """
    logs = [
        {key: value for key, value in log.items() if key != "path"} | {"sha256": digest}
        for log, digest in zip(scene["logs"], sha256, strict=True)
    ]
    content = {key: value for key, value in scene.items() if key != "name"} | {"logs": logs}
    text = json.dumps([content, version], sort_keys=True, ensure_ascii=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("ascii")).hexdigest()


JOB, RESULT, BATCH, INDEX, LOCK = "job.json", "result.json", "batch.json", "index.csv", ".lock"
PART = ".part"
OURS = frozenset({JOB, *RESULT_FILES, ".DS_Store"})
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)


def new_part(folder: Path) -> Path:
    """A hidden name, not yet in use, for a folder to be written."""
    return folder / f".{secrets.token_hex(8)}{PART}"


def complete(folder: Path) -> Document | None:
    """The document of a folder of a group, None where anything of it is missing or was cut off."""
    document = read_json(folder / JOB)
    if document is None or not {"group", "key", "status", "files"} <= set(document):
        return None
    try:
        sizes = {name: (folder / name).stat().st_size for name in document["files"]}
        whole = sizes == document["files"] and document.get("result_sha256") == _result_sha256(folder)
    except (OSError, TypeError, ValueError):
        return None
    return document if whole else None


def ended(folder: Path, job: Job) -> Document | None:
    """The document of this very job if it has ended, whole and for good; None where it is still to be done."""
    document = complete(folder / job.folder)
    same = document is not None and (document["key"], document["group"]) == (job.key, job.group)
    undecided = document is not None and (document["status"] in TRY_AGAIN or document.get("limited", False))
    return document if same and not undecided else None


def write_job(folder: Path, job: Job, end: End) -> Document:
    """Write job.json, the last file of a folder: with it the folder is complete."""
    planned = job.as_document()
    document = {
        "schema": 1,
        "kind": "job",
        **{name: planned[name] for name in ("group", "folder", "key", "numerics")},
        "status": end.status,
        "message": end.message,
        **{name: planned[name] for name in ("labels", "logs", "scene")},
        "files": {p.relative_to(folder).as_posix(): p.stat().st_size for p in sorted(folder.rglob("*")) if p.is_file()},
        "result_sha256": _result_sha256(folder),
        "detail": end.detail,
        "timing_s": dict(end.timing_s),
        "limited": end.limited,
        "finished": utc(),
        "host": platform.node(),
    }
    write_document(folder / JOB, document)
    return document


def write_document(path: Path, document: Mapping[str, object]) -> None:
    """One JSON file, whole or not at all."""
    with atomic_write(path) as handle:
        handle.write(json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1) + "\n")


def put(part: Path, place: Path) -> None:
    """Make a written folder the folder of a group; what stood there before goes.

    Raises:
        OSError: it cannot be moved there; `part` is left as it is.
    """
    before, existed = new_part(place.parent), place.exists()
    if existed:
        place.rename(before)
    try:
        part.rename(place)
    except OSError:
        if existed:
            before.rename(place)
        raise
    if existed:
        shutil.rmtree(before, ignore_errors=True)


def put_without_result(folder: Path, job: Job, end: End) -> None:
    """Put a folder that holds only job.json: the record of a fit that gave no result."""
    part = new_part(folder)
    try:
        part.mkdir()
        write_job(part, job, end)
        put(part, folder / job.folder)
    except BaseException:
        discard(part)
        raise


def foreign(place: Path) -> str | None:
    """The name of something in the folder of a group that is not ours to replace."""
    if not place.is_dir():
        return place.name if place.exists() else None
    items = sorted(item.name for item in place.iterdir())
    strange = [name for name in items if name not in OURS]
    return next(iter(strange if strange or JOB in items else items), None)


def utc() -> str:
    """Now, as the files say it."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


def is_full(error: OSError) -> bool:
    """Whether nothing more can be written, so that going on would only burn fits."""
    return error.errno in FULL


def discard(path: Path) -> None:
    """Remove an unfinished file or folder."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _result_sha256(folder: Path) -> str | None:
    try:
        return hashlib.sha256((folder / RESULT).read_bytes()).hexdigest()
    except FileNotFoundError:
        return None


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder for this process, by a lock that the system releases when it ends, also by kill -9.

    Raises:
        BatchError: another batch holds it. OSError: the file system knows no locks.
    """
    with (folder / LOCK).open("a+", encoding="utf-8") as handle:
        handle.seek(0)
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(handle.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(handle.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):
            holder = handle.read(200) or "unknown"
            raise BatchError(f"{folder}: another batch is running there ({holder}); wait for it, or stop it") from None
        handle.truncate()
        handle.write(f"process {os.getpid()} on {platform.node()} since {time.strftime('%Y-%m-%d %H:%M:%S')}")
        handle.flush()
        yield
