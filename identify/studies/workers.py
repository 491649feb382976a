"""Where fits run: processes on the cores of this machine, or on the workers of a Dask cluster."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any, Protocol, Self

from identify.studies.batch_store import new_part
from identify.studies.job import CRASHED, TIMED_OUT, BatchError, End, Job, numerics

MODULE = "identify.studies.making"
START_LIMIT = 300.0  # s, to load the libraries from a slow disk
TICK = 0.5  # s between two looks at the clock
WAIT = 30.0  # s for a Dask scheduler, and for its first worker
EXTRA = "pip install 'stick-slip-workbench[cluster]'"
# One process per core, so one thread per process: whatever library brings its own threads.
ONE_THREAD = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)  # fmt: skip

Answer = tuple[End, Path]  # how a job ended, and the hidden folder it wrote into


class FitProcess:
    """Runs one job after the other in a process of its own, started when needed, killed at the time limit, replaced
    when it died; used by one thread at a time, `close` by any."""

    def __init__(self, module: str | None = None) -> None:
        self._module = module or MODULE
        self._process: subprocess.Popen[str] | None = None
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as this
        self.closed = False

    def run(self, job: Job, folder: Path, limit: float) -> Answer:
        """Fit a job into a new hidden folder within `limit` seconds; every end is an answer, a killed one too."""
        part = new_part(folder)
        request = json.dumps({"job": job.as_document(), "part": str(part)})
        try:
            if (self._process is None or self._process.poll() is not None) and not self._start():
                end = self._died("the fitting process did not start")
            else:
                answer, late = self._ask(request, limit)
                if answer is not None:
                    end = End(**answer)
                elif late:
                    end = End(TIMED_OUT, f"the fit took longer than the {limit:g} s of its limit; see --time-limit")
                else:
                    end = self._died("the fitting process died")
                if late:  # also where it answered as it was being killed
                    self._end()
        except OSError as error:
            end = End(CRASHED, f"no process could be started for the fit: {error.strerror or error}")
        if end.status in (CRASHED, TIMED_OUT):
            self._end()
        return end, part

    def close(self) -> None:
        """End the process at once, and start no other."""
        self.closed = True
        self._end()

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for stream in filter(None, (process.stdin, process.stdout)):
                with suppress(OSError):  # what was not yet written has nowhere to go
                    stream.close()

    def _start(self) -> bool:
        self._end()
        self._errors.seek(0)
        self._errors.truncate()
        root = str(Path(__file__).resolve().parents[2])  # this very package is found first
        path = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH", ""))))
        apart: dict[str, Any] = {} if sys.platform == "win32" else {"process_group": 0}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", self._module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            encoding="utf-8",
            env={**os.environ, **dict.fromkeys(ONE_THREAD, "1"), "PYTHONPATH": path, "MPLBACKEND": "agg"},
            **apart,
        )
        if self.closed:  # while it was being started
            self._end()
            return False
        return self._ask(None, START_LIMIT)[0] is not None

    def _ask(self, request: str | None, limit: float) -> tuple[dict[str, Any] | None, bool]:
        """Send a line and wait for one: the answer, None where none came, and whether the time was over."""
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            return None, False  # closed meanwhile
        late = threading.Event()

        def kill() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(limit, kill)
        timer.daemon = True
        timer.start()
        try:
            if request is not None:
                process.stdin.write(request + "\n")
                process.stdin.flush()
            line = process.stdout.readline()
            return (json.loads(line) if line.endswith("\n") else None), late.is_set()
        except (OSError, ValueError):  # the process is gone, or was in the middle of its answer
            return None, late.is_set()
        finally:
            timer.cancel()

    def _died(self, words: str) -> End:
        code = None if self._process is None else self._process.wait()
        cause = f"exit code {code}"
        if code is not None and code < 0:
            known = -code in set(signal.Signals)
            cause = signal.Signals(-code).name if known else f"signal {-code}"
            cause += ", perhaps for want of memory" * (cause == "SIGKILL")
        self._errors.seek(max(0, self._errors.seek(0, os.SEEK_END) - 4000))
        detail = self._errors.read().decode("utf-8", "replace").strip()
        return End(CRASHED, f"{words} ({cause}); the other fits went on", detail or None)


class WorkersLostError(Exception):
    """No worker is left to fit; the text says what was lost and what to do."""


class Pending(Protocol):
    """A job on its way, as concurrent.futures and dask.distributed have it."""

    def add_done_callback(self, function: Callable[..., object], /) -> None:
        """Call `function` with this once there is an answer."""

    def result(self) -> Any:
        """The answer."""


class Workers(Protocol):
    """Somewhere that jobs can be sent to; a context, which ends them all."""

    count: int

    def __enter__(self) -> Self: ...
    def __exit__(self, *error: object) -> None: ...
    def send(self, job: Job, folder: Path, limit: float) -> Pending:
        """Have a job fitted into a new hidden folder below `folder`, within `limit` [s]."""

    def answer(self, pending: Any, folder: Path) -> Answer:
        """The answer of a job that has arrived; WorkersLostError where there will be no other either."""


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
        yield sent.pop(pending), workers.answer(pending, folder)


class LocalWorkers:
    """So many processes on this machine, each held by a thread of this one."""

    def __init__(self, count: int, module: str | None = None) -> None:
        self.count = count
        self._module = module
        self._mine = threading.local()
        self._processes: list[FitProcess] = []
        self._ending = threading.Event()
        self._threads = ThreadPoolExecutor(max_workers=count, thread_name_prefix="fit")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._ending.set()
        self._threads.shutdown(wait=False, cancel_futures=True)
        for process in self._processes:
            process.close()
        self._threads.shutdown(wait=True)

    def send(self, job: Job, folder: Path, limit: float) -> Pending:
        """Have a job fitted by the next process that is free."""
        return self._threads.submit(self._run, job, folder, limit)

    def answer(self, pending: Any, folder: Path) -> Answer:
        """What the process answered."""
        answer: Answer = pending.result()
        return answer

    def _run(self, job: Job, folder: Path, limit: float) -> Answer:
        if self._ending.is_set():
            return End(CRASHED, "the batch was ended"), new_part(folder)
        if not hasattr(self._mine, "process"):
            self._mine.process = FitProcess(self._module)
            self._processes.append(self._mine.process)
        answer: Answer = self._mine.process.run(job, folder, limit)
        return answer


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


# ----------------------------------------------------------------------------------------------------------------------
# A Dask cluster that somebody has started. The scheduling is all Dask's.
# ----------------------------------------------------------------------------------------------------------------------

_mine = threading.local()
_processes: list[FitProcess] = []


def fit_on_worker(document: dict[str, Any], folder: str, limit: float, module: str | None) -> tuple[Any, str]:
    """Runs on a Dask worker: fit in a process of its own, one per thread of the worker, which can be timed out."""
    process: FitProcess | None = getattr(_mine, "process", None)
    if process is None or process.closed:  # the batch before this one closed it
        process = _mine.process = FitProcess(module)
        _processes.append(process)
    end, part = process.run(Job.from_document(document), Path(folder), limit)
    return asdict(end), str(part)


def close_processes() -> None:
    """Runs on a Dask worker: end its fitting processes, whose memory is not needed any more."""
    while _processes:
        _processes.pop().close()


def look_around(folder: str) -> tuple[bool, str]:
    """Runs on a Dask worker: whether it finds the folder of the batch, and its numerics."""
    return Path(folder).is_dir(), numerics()


class ClusterWorkers:
    """The workers of a Dask cluster; they must have the logs and the batch folder under the same paths as we do.

    Raises:
        BatchError: Dask is not installed, or nothing answers at the address within `wait` [s].
    """

    def __init__(self, address: str, module: str | None = None, wait: float = WAIT) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise BatchError(f"--scheduler needs dask.distributed; install it: {EXTRA}") from None
        self._module = module
        try:
            self._client = Client(address, timeout=wait, set_as_default=False, name="stickslip-batch")
        except (OSError, TimeoutError, ValueError, MemoryError, RuntimeError) as error:
            raise BatchError(f"--scheduler {address}: no Dask scheduler answers there ({error}); start one") from None
        self.count = 0
        with self._closing_on_error():
            self._client.wait_for_workers(1, timeout=wait)
            self.count = sum(self._client.nthreads().values())

    def check(self, folder: Path) -> None:
        """Ask every worker for the folder and for its numerics.

        Raises:
            BatchError: one complaint per worker that cannot take part.
        """
        with self._closing_on_error():
            found = self._client.run(look_around, str(folder))
        complaints = [
            f"the Dask worker {at} does not see {folder}; share that folder" for at, a in found.items() if not a[0]
        ]
        complaints += [
            f"the Dask worker {at} has other numerics ({other}); expected {numerics()}: install the same versions"
            for at, (_, other) in found.items()
            if other != numerics()
        ]
        if complaints:
            self._client.close()
            raise BatchError(*complaints)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._client.status == "running":  # else the scheduler is gone, and asking would wait for it
            with suppress(OSError, RuntimeError, ValueError, TimeoutError):
                self._client.run(close_processes, on_error="ignore")
        self._client.close()

    def send(self, job: Job, folder: Path, limit: float) -> Pending:
        """Have a job fitted by whichever worker is free; Dask sends it again where its worker dies."""
        pending: Pending = self._client.submit(
            fit_on_worker, job.as_document(), str(folder), limit, self._module, pure=False
        )
        return pending

    def answer(self, pending: Any, folder: Path) -> Answer:
        """The answer; what went wrong on the way there and back is one, too."""
        if pending.cancelled():  # Dask does so when it loses its scheduler
            raise WorkersLostError("the Dask scheduler was lost; start it again, then go on with --resume")
        error = pending.exception()
        if error is not None:
            words = f"the fit took down every Dask worker it was given to, or never came back ({error})"
            return End(CRASHED, " ".join(words.split())), new_part(folder)
        end, part = pending.result()
        return End(**end), Path(part)

    @contextmanager
    def _closing_on_error(self) -> Iterator[None]:
        try:
            yield
        except (OSError, TimeoutError) as error:
            self._client.close()
            raise BatchError(f"the Dask cluster has no worker that answers ({error}); start one") from None
