"""Running a checked batch: send what is to be done, put what comes back, keep the tables up to date."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data_io.atomic import atomic_write
from identify.base.progress import Progress, to_nobody
from identify.base.table import visible
from identify.studies.batch_store import (
    BATCH,
    INDEX,
    Ended,
    Store,
    batch_document,
    complete,
    discard,
    index_csv,
    is_full,
    locked,
    utc,
    write_document,
)
from identify.studies.job import CONVERGED, UNWRITTEN, BatchError, Job
from identify.studies.planning import BatchPlan
from identify.studies.workers import Answer, Workers, WorkersLostError, answers


def in_words(seconds: float) -> str:
    """ "40 s", "5 min", "3 h 20 min"."""
    minutes = round(seconds / 60)
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"


EVERY = 5.0  # s between two versions of index.csv


@dataclass(frozen=True)
class Summary:
    """How a batch ended: status and sentence as in batch.json, ends by group, groups kept from before, seconds."""

    status: str
    message: str
    ended: dict[str, Ended]
    kept: int
    seconds: float


class _StopError(Exception):
    """Going on makes no sense; the text says why and what to do."""


def run_batch(
    plan: BatchPlan,
    out: Path,
    workers: Workers,
    *,
    resume: bool,
    limit: float,
    progress: Progress = to_nobody,
    scheduler: str | None = None,
) -> Summary:
    """Fit every group of a plan that has not ended yet in `out`.

    Args:
        resume: go on in a folder that holds a batch already. limit: seconds for one fit. progress: called with what
            has ended and the share of the groups, and in between with the same again.

    Raises:
        BatchError: the folder holds something else, or another batch runs there. OSError: it cannot be made.
    """
    check_place(out, resume)
    out = out.absolute()  # a cluster stands elsewhere
    out.mkdir(parents=True, exist_ok=True)
    with locked(out):
        check_place(out, resume)
        store = Store(out)
        _check_foreign(store, plan.jobs)
        return _Run(plan, store, workers, progress, {"jobs": workers.count, "scheduler": scheduler}).go(limit)


def check_place(out: Path, resume: bool) -> None:
    """Refuse a folder that this batch must not write to.

    Raises:
        BatchError: a file, a batch without `resume`, or something that is no batch.
    """
    if out.exists() and not out.is_dir():
        raise BatchError([f"--out {out} is a file; expected a folder: choose another name"])
    items = {item.name for item in out.iterdir() if not item.name.startswith(".")} if out.is_dir() else set()
    if not items:
        return
    if BATCH not in items:
        raise BatchError([f"--out {out} exists and holds no batch of ours; choose another folder or empty it"])
    if not resume:
        raise BatchError(
            [f"--out {out} holds a batch already; add --resume to go on with it, or choose another folder"]
        )


def _full(words: str) -> _StopError:
    return _StopError(f"{words}; make room, then go on with --resume")


def _check_foreign(store: Store, jobs: Sequence[Job]) -> None:
    complaints = [
        f"{store.folder / job.folder} holds {name!r}, which is not part of a result; move it away"
        for job in jobs
        if store.ended(job) is None and (name := store.foreign(job)) is not None
    ]
    if complaints:
        raise BatchError(complaints)


class _Run:
    """One run of a batch, while its folder is locked."""

    def __init__(
        self, plan: BatchPlan, store: Store, workers: Workers, progress: Progress, about: dict[str, Any]
    ) -> None:
        self._plan, self._store, self._workers, self._progress = plan, store, workers, progress
        self._about = about | {"started": utc()}
        self._began = time.monotonic()
        self._ended: dict[str, Ended] = {}
        self._written = -EVERY
        self._stage = ""

    def go(self, limit: float) -> Summary:
        """Recover, fit, and leave the tables behind, whatever happens."""
        self._gather()
        kept = len(self._ended)
        todo = [job for job in self._plan.jobs if job.group not in self._ended]
        self._tables("running", "the batch is running")
        done = f", {kept} of them done before" if kept else ""
        self._tell(f"{len(self._plan.jobs)} groups{done}")
        try:
            with self._stopping():
                self._fit(todo, limit)
        except _StopError as error:
            return self._end("stopped", f"stopped, and what has ended is kept: {error}", kept)
        failures = [end for end in self._ended.values() if end.status != CONVERGED]
        message = f"{len(self._ended)} groups: {len(self._ended) - len(failures)} converged, {len(failures)} did not"
        return self._end("failures" if failures else "done", message, kept)

    def _tell(self, stage: str) -> None:
        self._stage = stage
        self._progress(stage, len(self._ended) / max(len(self._plan.jobs), 1))

    def _gather(self) -> None:
        """What has ended for good, also what was written whole and not yet put; the rest of the unfinished goes."""
        self._store.recover(self._plan.jobs)
        for job in self._plan.jobs:
            document = self._store.ended(job)
            if document is not None:
                self._ended[job.group] = Ended.of(document)

    def _fit(self, todo: Sequence[Job], limit: float) -> None:
        if not todo:
            return
        began, size, total = time.monotonic(), 0, sum(job.size for job in todo)
        with self._workers as workers:
            for arrived in answers(workers, todo, self._store.folder, limit):
                if arrived is None:
                    self._tell(self._stage)
                    continue
                job, answer = arrived
                end = self._ended[job.group] = self._put(job, answer)
                size += job.size
                # what is left goes as fast as what is done, both in bytes of logs
                left = (time.monotonic() - began) * max(total - size, 0) / size if size else 0.0
                took = "" if end.seconds is None else f" in {in_words(end.seconds)}"
                words = f"{visible(job.group, 60)}: {end.status.replace('_', ' ')}{took}"
                remaining = f"; about {in_words(left)} left" if left >= 1.0 else ""
                self._tell(f"{len(self._ended)}/{len(self._plan.jobs)} {words}{remaining}")
                if time.monotonic() - self._written > EVERY:
                    self._index()

    def _put(self, job: Job, answer: Answer) -> Ended:
        """Put what a job left, whole, or the record of why it left nothing."""
        end, part = answer
        document = complete(part)  # even of a process that died just after it had written the last file
        if document is not None and document["key"] == job.key:
            self._store.put(part, job.folder)
            return Ended.of(document)
        discard(part)
        if end.status == UNWRITTEN:
            raise _full(end.message)
        return Ended.of(self._store.put_without_result(job, end))

    @contextmanager
    def _stopping(self) -> Iterator[None]:
        """Turn a full disk into the end of the batch; say in the tables that an interrupted batch has stopped."""
        try:
            yield
        except OSError as error:
            if not is_full(error):
                raise
            raise _full(f"{error.filename or self._store.folder}: {error.strerror}") from None
        except WorkersLostError as error:
            raise _StopError(str(error)) from None
        except KeyboardInterrupt:
            self._end("stopped", "the batch was interrupted; go on with --resume", 0)
            raise

    def _end(self, status: str, message: str, kept: int) -> Summary:
        """Write the tables a last time and remove what is unfinished."""
        try:
            self._gather()
            self._tables(status, message, utc())
        except OSError as error:
            if not is_full(error):
                raise
        return Summary(status, message, dict(self._ended), kept, time.monotonic() - self._began)

    def _tables(self, status: str, message: str, finished: str | None = None) -> None:
        seconds = time.monotonic() - self._began
        run = {"status": status, "message": message, **self._about, "finished": finished, "seconds": seconds}
        write_document(self._store.folder / BATCH, batch_document(self._plan, self._ended, run))
        self._index()

    def _index(self) -> None:
        with atomic_write(self._store.folder / INDEX) as handle:
            handle.write(index_csv(self._plan, self._ended))
        self._written = time.monotonic()
