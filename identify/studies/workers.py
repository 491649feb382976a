"""Where fits run: the cores of this machine. What a cluster does differently stands in `cluster`."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from identify.studies.batch_store import new_part
from identify.studies.grip import Grip
from identify.studies.job import CRASHED, End, Job

TICK = 0.5  # s between two looks at the clock

Answer = tuple[End, Path]  # how a job ended, and the hidden folder it wrote into


class WorkersLostError(Exception):
    """Nobody is left to fit; the text says what was lost and what to do."""


class Pending(Protocol):
    """A job on its way, as concurrent.futures and dask.distributed have it."""

    def add_done_callback(self, function: Callable[..., object], /) -> None:
        """Call `function` with this once there is an answer."""

    def result(self) -> Answer:
        """The answer; WorkersLostError where there will be none, for this job or any other."""

    def cancel(self) -> object:
        """Forget it, if it has not begun."""


class Workers(Protocol):
    """Somewhere that jobs can be sent to; a context, which ends them all."""

    count: int

    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...
    def send(self, job: Job, folder: Path, limit: float) -> Pending:
        """Have a job fitted into a new hidden folder below `folder`, within `limit` [s]."""


class LocalWorkers:
    """So many processes on this machine, each held by a thread of this one."""

    def __init__(self, count: int, module: str | None = None) -> None:
        self.count = count
        self._module = module
        self._mine = threading.local()
        self._grips: list[Grip] = []
        self._ending = threading.Event()
        self._threads = ThreadPoolExecutor(max_workers=count, thread_name_prefix="fit")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ending.set()
        self._threads.shutdown(wait=False, cancel_futures=True)
        for grip in self._grips:
            grip.close()
        self._threads.shutdown(wait=True)

    def send(self, job: Job, folder: Path, limit: float) -> Pending:
        """Have a job fitted by the next process that is free."""
        return self._threads.submit(self._run, job, folder, limit)

    def _run(self, job: Job, folder: Path, limit: float) -> Answer:
        part = new_part(folder)
        if self._ending.is_set():
            return End(CRASHED, "the batch was ended"), part
        grip: Grip | None = getattr(self._mine, "grip", None)
        if grip is None:
            grip = self._mine.grip = Grip(self._module)
            self._grips.append(grip)
        return grip.run(job, part, limit), part


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def answers(workers: Workers, jobs: Sequence[Job], folder: Path, limit: float) -> Iterator[tuple[Job, Answer] | None]:
    """Send all jobs, the largest first; yield each with its answer as it comes, and None at every tick between.

    Largest first keeps all workers busy to the end; which is first changes no result.
    """
    arrived: queue.SimpleQueue[Pending] = queue.SimpleQueue()
    sent: dict[Pending, Job] = {}
    for job in sorted(jobs, key=lambda job: (-job.size, job.group)):
        pending = workers.send(job, folder, limit)
        sent[pending] = job
        pending.add_done_callback(arrived.put)
    while sent:
        try:
            pending = arrived.get(timeout=TICK)
        except queue.Empty:
            yield None
            continue
        yield sent.pop(pending), pending.result()
