"""The folder of a batch: groups appear in it whole, by one rename, and only the holder of the lock puts them there.

What is being written stands under a hidden name, and counts for nothing until it is put.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import platform
import secrets
import shutil
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any

from data_io.atomic import atomic_write
from identify.studies.job import TRY_AGAIN, BatchError, End, Job

JOB, RESULT, BATCH, INDEX, LOCK = "job.json", "result.json", "batch.json", "index.csv", ".lock"
PART = ".part"
OURS = frozenset({JOB, RESULT, "report.html", "result.h5", "classical.csv", "parameters.tex", "figures", ".DS_Store"})
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)

Document = dict[str, Any]


def new_part(folder: Path) -> Path:
    """A hidden name, not yet in use, for a folder to be written."""
    return folder / f".{secrets.token_hex(8)}{PART}"


def complete(folder: Path) -> Document | None:
    """The document of a folder of a group, None where anything of it is missing or was cut off."""
    try:
        document = json.loads((folder / JOB).read_text(encoding="utf-8"))
        if not isinstance(document, dict) or not {"group", "key", "status", "files"} <= set(document):
            return None
        sizes = {name: (folder / name).stat().st_size for name in document["files"]}
        whole = sizes == document["files"] and document.get("result_sha256") == _result_sha256(folder)
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    return document if whole else None


def ended(folder: Path, job: Job) -> Document | None:
    """The document of this very job if it has ended, whole and for good; None where it is still to be done."""
    document = complete(folder / job.folder)
    if document is None or document["key"] != job.key or document["group"] != job.group:
        return None
    return None if document["status"] in TRY_AGAIN else document


def write_job(folder: Path, job: Job, end: End) -> Document:
    """Write job.json, the last file of a folder: with it the folder is complete."""
    files = {p.relative_to(folder).as_posix(): p.stat().st_size for p in sorted(folder.rglob("*")) if p.is_file()}
    document = {
        "schema": 1,
        "kind": "job",
        **{name: getattr(job, name) for name in ("group", "folder", "key", "numerics")},
        "status": end.status,
        "message": end.message,
        "labels": dict(job.labels),
        "logs": [asdict(log) for log in job.logs],
        "scene": dict(job.scene),
        "files": files,
        "result_sha256": _result_sha256(folder),
        "detail": end.detail,
        "timing_s": dict(end.timing_s),
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
    before = new_part(place.parent)
    for inside in (part, *(item for item in part.rglob("*") if item.is_dir())):
        _flush(inside)
    existed = place.exists()
    if existed:
        place.rename(before)
    try:
        part.rename(place)
    except OSError:
        if existed:
            before.rename(place)
        raise
    _flush(place.parent)
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


def recover(folder: Path, jobs: Sequence[Job]) -> None:
    """Take over what an interrupted batch had written whole but not yet put; remove everything else unfinished."""
    by_key = {(job.group, job.key): job for job in jobs}
    for part in sorted(folder.glob(f".*{PART}*")):
        document = complete(part) if part.is_dir() else None
        job = None if document is None else by_key.get((document["group"], document["key"]))
        if job is not None and document is not None and document["status"] not in TRY_AGAIN and not ended(folder, job):
            put(part, folder / job.folder)
        else:
            discard(part)


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


def _flush(folder: Path) -> None:
    """Bring the names in a folder to the disk, where the system can (its files are flushed as they are written)."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if is_full(error):
            raise
    finally:
        os.close(descriptor)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder for this process, by a lock that ends with it, however that ends.

    Raises:
        BatchError: another batch holds it. OSError: the file system knows no locks.
    """
    with (folder / LOCK).open("a+", encoding="utf-8") as handle:
        handle.seek(0)
        if not _lock(handle):
            raise BatchError(
                f"{folder}: another batch is running there ({handle.read(200) or 'unknown'}); wait for it, or stop it"
            )
        handle.truncate()
        since = time.strftime("%Y-%m-%d %H:%M:%S")
        handle.write(f"process {os.getpid()} on {platform.node()} since {since}")
        handle.flush()
        yield


def _lock(handle: IO[str]) -> bool:
    """Whether the lock could be had. The system releases it when the process ends, also by kill -9."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(handle.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(handle.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    return True
