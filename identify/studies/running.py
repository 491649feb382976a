"""Running a checked batch: send what is to be done, put what comes back, keep the tables up to date."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from data_io.atomic import atomic_write
from identify.base.progress import Progress, to_nobody
from identify.base.table import OutputTable, visible
from identify.studies import batch_store as store
from identify.studies.batch_store import BatchError, Document, End, Job
from identify.studies.planning import BatchPlan
from identify.studies.workers import Answer, Workers, WorkersLostError, answers

EVERY = 5.0  # s between two versions of index.csv
OWN = ("group", "status", "message", "result", "folder", "logs", "seconds")  # columns of index.csv that are no labels


def in_words(seconds: float) -> str:
    """ "40 s", "5 min", "3 h 20 min"."""
    minutes = round(seconds / 60)
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"


@dataclass(frozen=True)
class Summary:
    """How a batch ended: status and sentence as in batch.json, ends by group, groups kept from before, seconds."""

    status: str
    message: str
    ended: dict[str, End]
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
    out = out.absolute()  # a cluster has another working directory
    out.mkdir(parents=True, exist_ok=True)
    with store.locked(out):
        check_place(out, resume)
        complaints = [
            f"{out / job.folder} holds {name!r}, which is not part of a result; move it away"
            for job in plan.jobs
            if store.ended(out, job) is None and (name := store.foreign(out / job.folder)) is not None
        ]
        if complaints:
            raise BatchError(*complaints)
        about = {"jobs": workers.count, "scheduler": scheduler, "started": store.utc()}
        return _Run(plan, out, progress, about).go(workers, limit)


def check_place(out: Path, resume: bool) -> None:
    """Refuse a folder that this batch must not write to.

    Raises:
        BatchError: a file, a batch without `resume`, or something that is no batch.
    """
    if out.exists() and not out.is_dir():
        raise BatchError(f"--out {out} is a file; expected a folder: choose another name")
    items = {item.name for item in out.iterdir() if not item.name.startswith(".")} if out.is_dir() else set()
    if items and store.BATCH not in items:
        raise BatchError(f"--out {out} exists and holds no batch of ours; choose another folder or empty it")
    if items and not resume:
        raise BatchError(f"--out {out} holds a batch already; add --resume to go on with it, or choose another folder")


class _Run:
    """One run of a batch, while its folder is locked."""

    def __init__(self, plan: BatchPlan, out: Path, progress: Progress, about: Mapping[str, object]) -> None:
        self._plan, self._out, self._progress, self._about = plan, out, progress, about
        self._began = self._written = time.monotonic()
        self._ended: dict[str, End] = {}

    def go(self, workers: Workers, limit: float) -> Summary:
        """Recover, fit, and leave the tables behind, whatever happens."""
        self._gather()
        kept, count = len(self._ended), len(self._plan.jobs)
        jobs = [job for job in self._plan.jobs if job.group not in self._ended]
        self._tables("running", "the batch is running")
        stage = f"{count} groups{f', {kept} of them done before' if kept else ''}"
        self._progress(stage, kept / max(count, 1))
        status, message = "stopped", "the batch was interrupted; go on with --resume"
        try:
            if jobs:
                with workers:
                    self._fit(workers, jobs, limit, stage)
            failures = sum(end.status != store.CONVERGED for end in self._ended.values())
            status = "failures" if failures else "done"
            message = f"{len(self._ended)} groups: {len(self._ended) - failures} converged, {failures} did not"
        except (_StopError, WorkersLostError) as error:
            message = f"stopped, and what has ended is kept: {error}"
        except OSError as error:
            if not store.is_full(error):
                raise
            full = f"{error.filename or 'the disk'}: {error.strerror}; make room, then go on with --resume"
            message = f"stopped, and what has ended is kept: {full}"
        finally:
            try:  # the tables a last time; what is unfinished goes
                self._gather()
                self._tables(status, message, store.utc())
            except OSError as error:
                if not store.is_full(error):
                    raise
        return Summary(status, message, dict(self._ended), kept, time.monotonic() - self._began)

    def _gather(self) -> None:
        """What has ended for good; what is unfinished goes."""
        for part in self._out.glob(f".*{store.PART}*"):
            store.discard(part)
        for job in self._plan.jobs:
            if (document := store.ended(self._out, job)) is not None:
                self._ended[job.group] = End.of(document)

    def _fit(self, workers: Workers, jobs: Sequence[Job], limit: float, stage: str) -> None:
        began, size, total = time.monotonic(), 0, sum(job.size for job in jobs)
        count = len(self._plan.jobs)
        for arrived in answers(workers, jobs, self._out, limit):
            if arrived is not None:
                job, answer = arrived
                end = self._ended[job.group] = self._put(job, answer)
                size += job.size
                # What is left goes as fast as what is done, both in bytes of logs.
                left = (time.monotonic() - began) * max(total - size, 0) / size if size else 0.0
                took = f" in {in_words(end.timing_s['total'])}" if "total" in end.timing_s else ""
                words = f"{visible(job.group, 60)}: {end.status.replace('_', ' ')}{took}"
                stage = f"{len(self._ended)}/{count} {words}"
                stage += f"; about {in_words(left)} left" if left >= 1.0 else ""
            self._progress(stage, len(self._ended) / count)
            if arrived is not None and time.monotonic() - self._written > EVERY:
                self._index()

    def _put(self, job: Job, answer: Answer) -> End:
        """Put what a job left, whole, or the record of why it left nothing."""
        end, part = answer
        document = store.complete(part)  # even of a process that died just after it had written the last file
        if document is not None and document["key"] == job.key:
            store.put(part, self._out / job.folder)
            return End.of(document)
        store.discard(part)
        if end.status == store.UNWRITTEN:
            raise _StopError(f"{end.message}; make room, then go on with --resume")
        store.put_without_result(self._out, job, end)
        return end

    def _tables(self, status: str, message: str, finished: str | None = None) -> None:
        seconds = time.monotonic() - self._began
        run = {"status": status, "message": message, **self._about, "finished": finished, "seconds": seconds}
        store.write_document(self._out / store.BATCH, batch_document(self._plan, self._ended, run))
        self._index()

    def _index(self) -> None:
        with atomic_write(self._out / store.INDEX) as handle:
            handle.write(index_csv(self._plan, self._ended))
        self._written = time.monotonic()


def batch_document(plan: BatchPlan, ended: Mapping[str, End], run: Mapping[str, object]) -> Document:
    """The document of batch.json.

    Args:
        ended: by group. run: status, message, started, finished, seconds, jobs, scheduler.
    """
    groups = []
    for job in plan.jobs:
        status, planned = ended[job.group].status if job.group in ended else store.WAITING, job.as_document()
        entry = {"group": job.group, "folder": job.folder, "key": job.key, "status": status}
        groups.append({**entry, "labels": planned["labels"], "logs": planned["logs"]})
    return {
        "schema": 1,
        "kind": "batch",
        "source": str(plan.source),
        "scene": str(plan.scene),
        "set": list(plan.overrides),
        "numerics": plan.numerics,
        **run,
        "columns": list(plan.labels),
        "counts": dict(Counter(group["status"] for group in groups)),
        "groups": groups,
    }


def index_csv(plan: BatchPlan, ended: Mapping[str, End]) -> str:
    """The text of index.csv; one row per group in the order of the source."""
    # Labels of the manifest in its order, then those that only the scene gives.
    names = list(dict.fromkeys([*plan.labels, *(name for job in plan.jobs for name in job.labels)]))
    headings = [f"label: {name}" if name in OWN else name for name in names]
    rows = []
    for job in plan.jobs:
        end = ended.get(job.group, End(store.WAITING, ""))
        result = f"{job.folder}/result.json" if job.group in ended and end.has_result else ""
        seconds = round(end.timing_s["total"], 3) if "total" in end.timing_s else None
        labels = [job.labels.get(name, "") for name in names]
        rows.append((job.group, end.status, end.message, result, job.folder, len(job.logs), *labels, seconds))
    return OutputTable("Groups", (*OWN[:-1], *headings, OWN[-1]), tuple(rows)).to_csv()
