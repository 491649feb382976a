"""Where fits run: the cores of this machine. What a cluster does differently stands in `cluster`."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Protocol, Self

from identify.studies.batch_store import new_part
from identify.studies.job import CRASHED, TIMED_OUT, End, Job

# ----------------------------------------------------------------------------------------------------------------------
# The grip on one fitting process: started when needed, killed at the time limit, replaced when it died.
# ----------------------------------------------------------------------------------------------------------------------

MODULE = "identify.studies.making"
START_LIMIT = 300.0  # s, to load the libraries from a slow disk
# One process per core, so one thread per process: whatever library brings its own threads.
ONE_THREAD = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)  # fmt: skip


class Grip:
    """Runs one job after the other in a process of its own; used by one thread at a time, `close` by any."""

    def __init__(self, module: str | None = None) -> None:
        self._module = module or MODULE
        self._process: subprocess.Popen[str] | None = None
        self._errors: IO[bytes] | None = None
        self.closed = False

    def run(self, job: Job, part: Path, limit: float) -> End:
        """Fit a job into the folder `part` within `limit` seconds; every end is an answer, a killed one too."""
        end = self._run(job, part, limit)
        if end.status in (CRASHED, TIMED_OUT):
            self.end()
        return end

    def _run(self, job: Job, part: Path, limit: float) -> End:
        try:
            process = self._started()
        except OSError as error:
            return End(CRASHED, f"no process could be started for the fit: {error.strerror or error}")
        if process is None:
            return self._died("the fitting process did not start")
        late = threading.Event()
        request = json.dumps({"job": job.as_document(), "part": str(part)})
        answer = self._asked(process, request, limit, late)
        if answer is not None:
            if late.is_set():  # it answered as it was being killed
                self.end()
            return End(**answer)
        if late.is_set():
            return End(TIMED_OUT, f"the fit took longer than the {limit:g} s it was given; see --time-limit")
        return self._died("the fitting process died")

    def close(self) -> None:
        """End the process at once, and start no other."""
        self.closed = True
        self.end()

    def end(self) -> None:
        """End the process at once; the next job starts another."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for stream in filter(None, (process.stdin, process.stdout)):
                with suppress(OSError):  # what was not yet written has nowhere to go
                    stream.close()
        errors, self._errors = self._errors, None
        if errors is not None:
            errors.close()

    def _started(self) -> subprocess.Popen[str] | None:
        """The process, ready; None where it did not get ready."""
        if self._process is not None and self._process.poll() is None:
            return self._process
        self.end()
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        apart: dict[str, Any] = {} if sys.platform == "win32" else {"process_group": 0}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", self._module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            encoding="utf-8",
            env=_environment(os.environ),
            **apart,
        )
        if self.closed:  # while it was being started
            self.end()
            return None
        return self._process if self._asked(self._process, None, START_LIMIT, threading.Event()) else None

    def _asked(
        self, process: subprocess.Popen[str], request: str | None, limit: float, late: threading.Event
    ) -> dict[str, Any] | None:
        """Send a line, wait for one; None where none came, and `late` is set where it was not waited for any longer."""
        assert process.stdin is not None and process.stdout is not None

        def too_late() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(limit, too_late)
        timer.daemon = True
        timer.start()
        try:
            if request is not None:
                process.stdin.write(request + "\n")
                process.stdin.flush()
            line = process.stdout.readline()
            return dict(json.loads(line)) if line.endswith("\n") else None
        except (OSError, ValueError):  # the process is gone, or was in the middle of its answer
            return None
        finally:
            timer.cancel()

    def _died(self, words: str) -> End:
        process, errors = self._process, self._errors
        code = None if process is None else process.wait()
        cause, detail = f"exit code {code}", ""
        if code is not None and code < 0:
            known = -code in set(signal.Signals)
            cause = signal.Signals(-code).name if known else f"signal {-code}"
            cause += ", perhaps for want of memory" * (cause == "SIGKILL")
        if errors is not None and not errors.closed:
            errors.seek(max(0, errors.seek(0, os.SEEK_END) - 4000))
            detail = errors.read().decode("utf-8", "replace").strip()
        return End(CRASHED, f"{words} ({cause}); the other fits went on", detail or None)


def _environment(inherited: Mapping[str, str]) -> dict[str, str]:
    """That of this process, with one thread per library and this very package found first."""
    root = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(filter(None, (root, inherited.get("PYTHONPATH", ""))))
    return {**inherited, **dict.fromkeys(ONE_THREAD, "1"), "PYTHONPATH": path, "MPLBACKEND": "agg"}


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
