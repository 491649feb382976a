"""The folder of a batch: groups appear in it whole, by one rename, and only the holder of the lock puts them there."""

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
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

from data_io.atomic import atomic_write
from identify.base.table import OutputTable
from identify.studies.job import TRY_AGAIN, WAITING, BatchError, End, Job
from identify.studies.planning import BatchPlan

JOB, RESULT, BATCH, INDEX = "job.json", "result.json", "batch.json", "index.csv"
PART = ".part"
OURS = frozenset({JOB, RESULT, "report.html", "result.h5", "classical.csv", "parameters.tex", "figures", ".DS_Store"})
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)

Document = dict[str, Any]


class Store:
    """One batch folder. What is being written stands under a hidden name, and counts for nothing until it is put."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def ended(self, job: Job) -> Document | None:
        """The document of this very job if it has ended, whole and for good; None where it is still to be done."""
        document = complete(self.folder / job.folder)
        if document is None or document["key"] != job.key or document["group"] != job.group:
            return None
        return None if document["status"] in TRY_AGAIN else document

    def put(self, part: Path, name: str) -> None:
        """Make a written folder the folder of a group; what stood there before goes.

        Raises:
            OSError: it cannot be moved there; `part` is left as it is.
        """
        place, before = self.folder / name, new_part(self.folder)
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
        _flush(self.folder)
        if existed:
            shutil.rmtree(before, ignore_errors=True)

    def put_without_result(self, job: Job, end: End) -> Document:
        """Put a folder that holds only job.json: the record of a fit that gave no result."""
        part = new_part(self.folder)
        try:
            part.mkdir()
            document = write_job(part, job, end)
            self.put(part, job.folder)
        except BaseException:
            discard(part)
            raise
        return document

    def foreign(self, job: Job) -> str | None:
        """The name of something in the job's folder that is not ours to replace."""
        place = self.folder / job.folder
        if not place.is_dir():
            return job.folder if place.exists() else None
        items = sorted(item.name for item in place.iterdir())
        strange = [name for name in items if name not in OURS]
        if items and JOB not in items:
            return strange[0] if strange else items[0]
        return strange[0] if strange else None

    def recover(self, jobs: Sequence[Job]) -> None:
        """Take over what an interrupted batch had written whole but not yet put; remove everything else unfinished."""
        by_key = {(job.group, job.key): job for job in jobs}
        for part in sorted(self.folder.glob(f".*{PART}*")):
            document = complete(part) if part.is_dir() else None
            job = None if document is None else by_key.get((document["group"], document["key"]))
            if job is not None and document is not None and document["status"] not in TRY_AGAIN and not self.ended(job):
                self.put(part, job.folder)
            else:
                discard(part)


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
        digest = document.get("result_sha256")
        whole = sizes == document["files"] and digest == _result_sha256(folder)
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    return document if whole else None


def write_job(folder: Path, job: Job, end: End) -> Document:
    """Write job.json, the last file of a folder: with it the folder is complete."""
    files = {p.relative_to(folder).as_posix(): p.stat().st_size for p in sorted(folder.rglob("*")) if p.is_file()}
    document = {
        "schema": 1,
        "kind": "job",
        "group": job.group,
        "folder": job.folder,
        "key": job.key,
        "numerics": job.numerics,
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


# ----------------------------------------------------------------------------------------------------------------------
# One batch at a time in a folder: a lock that ends with its process, however that ends.
# ----------------------------------------------------------------------------------------------------------------------

LOCK = ".lock"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder for this process.

    Raises:
        BatchError: another batch holds it. OSError: the file system knows no locks.
    """
    with (folder / LOCK).open("a+", encoding="utf-8") as handle:
        if not _take(handle):
            try:
                handle.seek(0)
                told = json.loads(handle.read())
                holder = f"process {told['pid']} on {told['host']} since {told['since']}"
            except (OSError, ValueError, KeyError, TypeError, RecursionError):
                holder = "it has not told who it is"
            raise BatchError([f"{folder}: another batch is running there ({holder}); wait for it, or stop it"])
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


# ----------------------------------------------------------------------------------------------------------------------
# batch.json and index.csv: the batch as a whole, from the plan and what has ended.
# ----------------------------------------------------------------------------------------------------------------------

OWN = ("group", "status", "message", "result", "folder", "logs", "seconds")


@dataclass(frozen=True)
class Ended:
    """What the tables say of a group that has ended."""

    status: str
    message: str
    has_result: bool
    seconds: float | None

    @staticmethod
    def of(document: Mapping[str, Any]) -> Ended:
        """From the group's job.json."""
        seconds = (document.get("timing_s") or {}).get("total")
        return Ended(document["status"], document["message"], document.get("result_sha256") is not None, seconds)


def batch_document(plan: BatchPlan, ended: Mapping[str, Ended], run: Mapping[str, object]) -> dict[str, Any]:
    """The document of batch.json.

    Args:
        ended: by group. run: status, message, started, finished, seconds, jobs, scheduler.
    """
    statuses = [ended[job.group].status if job.group in ended else WAITING for job in plan.jobs]
    return {
        "schema": 1,
        "kind": "batch",
        "source": str(plan.source),
        "scene": str(plan.scene),
        "set": list(plan.overrides),
        "numerics": plan.numerics,
        **run,
        "columns": list(plan.labels),
        "counts": dict(Counter(statuses)),
        "groups": [
            {
                "group": job.group,
                "folder": job.folder,
                "key": job.key,
                "status": status,
                "labels": dict(job.labels),
                "logs": [asdict(log) for log in job.logs],
            }
            for job, status in zip(plan.jobs, statuses, strict=True)
        ],
    }


def index_csv(plan: BatchPlan, ended: Mapping[str, Ended]) -> str:
    """The text of index.csv; one row per group in the order of the source."""
    # Those of the manifest in its order, then those that only the scene gives.
    names = list(dict.fromkeys([*plan.labels, *(name for job in plan.jobs for name in job.labels)]))
    headings = [f"label: {name}" if name in OWN else name for name in names]
    rows = []
    for job in plan.jobs:
        end = ended.get(job.group)
        result = f"{job.folder}/result.json" if end is not None and end.has_result else ""
        words = (end.status, end.message) if end is not None else (WAITING, "")
        seconds = None if end is None or end.seconds is None else round(end.seconds, 3)
        labels = [job.labels.get(name, "") for name in names]
        rows.append((job.group, *words, result, job.folder, len(job.logs), *labels, seconds))
    return OutputTable("Groups", (*OWN[:-1], *headings, OWN[-1]), tuple(rows)).to_csv()
