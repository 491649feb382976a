"""Where fits run: processes on the cores of this machine, or on the workers of a Dask cluster.

    python -m identify.studies.workers

is such a process: it takes jobs as lines of JSON on standard input and answers with one line each. It lives as long as
its batch, so that what one fit compiled serves the next fit of the same shape, and no longer: on Linux no fit outlives
its batch.
"""

from __future__ import annotations

import ctypes
import faulthandler
import json
import os
import platform
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import IO, Self, TypeAlias, cast

from data_io.source import file_sha256
from data_io.values import LogError, UnitError
from identify.base.budget import no_time_limit, time_is_up, time_limit
from identify.base.errors import IdentifyError
from identify.base.result import Result
from identify.studies import batch_store as store
from identify.studies.batch_store import BatchError, Document, End, Job, LogFile, numerics

MODULE = "identify.studies.workers"
SOFT = 0.7  # of the limit: then a fit ends by itself, and has the rest for its report
START_LIMIT = 300.0  # s, to load the libraries from a slow disk
TICK = 0.5  # s between two looks at the clock
WAIT = 30.0  # s for a Dask scheduler, and for its first worker
PR_SET_PDEATHSIG = 1  # linux/prctl.h
EXTRA = "pip install 'stick-slip-workbench[cluster]'"
# One process per core, so one thread per process: whatever library brings its own threads.
ONE_THREAD = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)  # fmt: skip

Workers: TypeAlias = "LocalWorkers | ClusterWorkers"
Answer = tuple[End, Path]  # how a job ended, and the hidden folder it wrote into
Make = Callable[[Job, Path], End]


class WorkersLostError(Exception):
    """No worker is left to fit; the text says what was lost and what to do."""


def make(job: Job, part: Path) -> End:
    """Fit a job and write its folder `part`; every error becomes an end with its reason.

    The folder is complete (job.json is there) only where the end carries the status of a fit.
    """
    if job.numerics != numerics():
        mismatch = f"this process has other numerics ({numerics()}) than the batch was planned with ({job.numerics})"
        return End(store.OUTDATED, f"{mismatch}; install the same versions everywhere")
    return guarded(_fitted, job, part)


def guarded(work: Make, job: Job, part: Path) -> End:
    """Do the work; an exception becomes an end: what the user can mend in one sentence, the rest with its traceback."""
    try:
        return work(job, part)
    except (IdentifyError, LogError, UnitError) as error:
        return _changed(job, map(_digest, job.logs)) or End(store.FAILED, " ".join(str(error).split()))
    except OSError as error:
        words = f"{error.filename or part}: {error.strerror or error}"
        return End(store.UNWRITTEN if store.is_full(error) else store.CRASHED, words)
    except Exception as error:  # noqa: BLE001 - a defect in one fit must not stop the others
        return End(store.DEFECT, f"a defect of ours ({type(error).__name__}: {error})", traceback.format_exc())


def _fitted(job: Job, part: Path) -> End:
    from identify.identification import fit
    from identify.report import write_report
    from identify.scene import Scene

    began, used = time.perf_counter(), time.process_time()
    outcome = fit(Scene.from_document(job.scene))
    result = outcome.typed
    changed = _changed(job, (result.logs[result.places(number)[0]].sha256 for number in range(len(job.logs))))
    if changed is not None:
        return changed
    fitted, limited = time.perf_counter(), time_is_up() and result.status != store.CONVERGED
    part.mkdir()  # what an error leaves of it the batch discards
    with no_time_limit():
        write_report(replace(outcome, result=with_provenance(result, job).to_dict()), part)
    now = time.perf_counter()
    timing = {"fit": fitted - began, "report": now - fitted, "total": now - began}
    timing |= {"processor": time.process_time() - used}
    end = End(result.status, result.message, None, timing, limited)
    store.write_job(part, job, end)
    return end


def with_provenance(result: Result, job: Job) -> Result:
    """The result with what ties it to its batch."""
    batch = {"group": job.group, "key": job.key, "numerics": job.numerics}
    where = {"host": platform.node(), "python": platform.python_version(), "system": platform.platform()}
    return replace(result, provenance={**result.provenance, "batch": batch, "machine": where})


def _changed(job: Job, digests: Iterable[str | None]) -> End | None:
    """An end where a log is not the one that was hashed when the batch began; digests: SHA-256 of each log."""
    for planned, digest in zip(job.logs, digests, strict=True):
        if planned.sha256 != digest:
            words = "the log was changed or taken away while the batch ran; run again with --resume"
            return End(store.OUTDATED, f"{planned.path}: {words}")
    return None


def _digest(log: LogFile) -> str | None:
    try:
        return file_sha256(Path(log.path))
    except OSError:
        return None


def serve(work: Make) -> None:
    """Answer job after job until standard input closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the batch, which then ends this process
    warnings.simplefilter("ignore")
    faulthandler.enable()
    if sys.platform.startswith("linux"):  # the system ends this process with the one that started it
        # No thread that watches: readers of logs guard themselves by forks, which a process with threads must not do.
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # whatever a library prints is no answer
    document: object = {"ready": True}
    while True:
        try:
            answers.write(json.dumps(document) + "\n")
            answers.flush()
        except OSError:
            os._exit(0)  # the batch has ended
        line = sys.stdin.readline()
        if not line:
            return
        request = json.loads(line)
        with time_limit(SOFT * request["limit"]):
            document = asdict(work(Job.from_document(request["job"]), Path(request["part"])))


class FitProcess:
    """Runs one job after the other in a process of its own, started when needed, killed at the time limit, replaced
    when it died; used by one thread at a time, `close` by any."""

    def __init__(self, module: str | None = None) -> None:
        self._module = module or MODULE
        self._process: subprocess.Popen[str] | None = None
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as this
        self._closed = False

    def run(self, job: Job, folder: Path, limit: float) -> Answer:
        """Fit a job into a new hidden folder within `limit` seconds; every end is an answer, a killed one too."""
        part = store.new_part(folder)
        request = json.dumps({"job": job.as_document(), "part": str(part), "limit": limit})
        try:
            if (self._process is None or self._process.poll() is not None) and not self._start():
                end = self._died("the fitting process did not start")
            else:
                answer, late = self._ask(request, limit)
                if answer is not None:
                    end = End(**answer)
                elif late:
                    words = f"the fit took longer than the {limit:g} s of its limit; see --time-limit"
                    end = End(store.TIMED_OUT, words)
                else:
                    end = self._died("the fitting process died")
                if late:  # also where it answered as it was being killed
                    self._end()
        except OSError as error:
            end = End(store.CRASHED, f"no process could be started for the fit: {error.strerror or error}")
        if end.status in (store.CRASHED, store.TIMED_OUT):
            self._end()
        return end, part

    def close(self) -> None:
        """End the process at once, and start no other."""
        self._closed = True
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
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", self._module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            encoding="utf-8",
            env={**os.environ, **dict.fromkeys(ONE_THREAD, "1"), "PYTHONPATH": path, "MPLBACKEND": "agg"},
            process_group=None if sys.platform == "win32" else 0,
        )
        if self._closed:  # while it was being started
            self._end()
            return False
        return self._ask(None, START_LIMIT)[0] is not None

    def _ask(self, request: str | None, limit: float) -> tuple[Document | None, bool]:
        """Send a line and wait for one: the answer, None where none came, and whether the time was over."""
        process, answer, began = self._process, None, time.monotonic()
        if process is None or process.stdin is None or process.stdout is None:
            return None, False  # closed meanwhile
        timer = threading.Timer(limit, process.kill)
        timer.daemon = True
        timer.start()
        with suppress(OSError, ValueError):  # the process is gone, or was in the middle of its answer
            if request is not None:
                process.stdin.write(request + "\n")
                process.stdin.flush()
            line = process.stdout.readline()
            answer = json.loads(line) if line.endswith("\n") else None
        timer.cancel()
        return answer, time.monotonic() - began >= limit

    def _died(self, words: str) -> End:
        code = None if self._process is None else self._process.wait()
        cause = f"exit code {code}"
        if code is not None and code < 0:
            known = -code in set(signal.Signals)
            cause = signal.Signals(-code).name if known else f"signal {-code}"
            cause += ", perhaps because memory ran out" * (cause == "SIGKILL")
        self._errors.seek(max(0, self._errors.seek(0, os.SEEK_END) - 4000))
        detail = self._errors.read().decode("utf-8", "replace").strip()
        return End(store.CRASHED, f"{words} ({cause}); the other fits went on", detail or None)


def answers(workers: Workers, jobs: Sequence[Job], folder: Path, limit: float) -> Iterator[tuple[Job, Answer] | None]:
    """Send all jobs, the largest first; yield each with its answer as it comes, and None at every tick between.

    Largest first keeps all workers busy to the end; which is first changes no result.
    """
    arrived: queue.SimpleQueue[Future[Answer]] = queue.SimpleQueue()
    sent: dict[Future[Answer], Job] = {}
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
    """So many processes on this machine, each for one job after the other, and each with a thread that waits for it."""

    def __init__(self, count: int, module: str | None = None) -> None:
        self.count, self._module, self._closed = count, module, False
        self._idle, self._all = list[FitProcess](), list[FitProcess]()
        self._threads = ThreadPoolExecutor(max_workers=count, thread_name_prefix="fit")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)
        self._closed = True
        for process in self._all:
            process.close()
        self._threads.shutdown(wait=True)

    def run(self, job: Job, folder: Path, limit: float) -> Answer:
        """Fit a job in a process that is free, see `FitProcess.run`."""
        try:
            process = self._idle.pop()
        except IndexError:
            process = FitProcess(self._module)
            self._all.append(process)
        if self._closed:
            process.close()
            return End(store.CRASHED, "the batch was ended"), store.new_part(folder)
        answer = process.run(job, folder, limit)
        self._idle.append(process)
        return answer

    def send(self, job: Job, folder: Path, limit: float) -> Future[Answer]:
        """Have a job fitted by the next process that is free, within `limit` [s], into a new folder below `folder`."""
        return self._threads.submit(self.run, job, folder, limit)

    def answer(self, pending: Future[Answer], folder: Path) -> Answer:
        """What the process answered."""
        return pending.result()


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_on_this_worker: dict[str | None, LocalWorkers] = {}  # by module


def fit_on_worker(job: Job, folder: Path, limit: float, module: str | None) -> Answer:
    """Runs on a Dask worker: fit in a process of its own, which can be timed out."""
    return _on_this_worker.setdefault(module, LocalWorkers(cores(), module)).run(job, folder, limit)


def close_processes() -> None:
    """Runs on a Dask worker: end its fitting processes, whose memory is not needed any more."""
    while _on_this_worker:
        _on_this_worker.popitem()[1].__exit__()


def look_around(folder: Path) -> tuple[bool, str]:
    """Runs on a Dask worker: whether it finds the folder of the batch, and its numerics."""
    return folder.is_dir(), numerics()


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
        try:
            self._client.wait_for_workers(1, timeout=wait)
            self.count = sum(self._client.nthreads().values())
        except (OSError, TimeoutError) as error:
            self._client.close()
            raise BatchError(f"the Dask cluster has no worker that answers ({error}); start one") from None

    def check(self, folder: Path) -> None:
        """Ask every worker for the folder and for its numerics: one that fails at once would draw all jobs.

        Raises:
            BatchError: one complaint per worker that cannot take part.
        """
        complaints = []
        for at, (has_folder, other) in self._client.run(look_around, folder).items():
            if not has_folder:
                complaints.append(f"the Dask worker {at} cannot read {folder}; share that folder")
            elif other != numerics():
                wrong = f"the Dask worker {at} has other numerics ({other}); expected {numerics()}"
                complaints.append(f"{wrong}: install the same versions")
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

    def send(self, job: Job, folder: Path, limit: float) -> Future[Answer]:
        """Have a job fitted by whichever worker is free; Dask sends it again where its worker dies."""
        pending = self._client.submit(fit_on_worker, job, folder, limit, self._module, pure=False)
        return cast("Future[Answer]", pending)

    def answer(self, pending: Future[Answer], folder: Path) -> Answer:
        """The answer, also where it went wrong on the way; WorkersLostError where there will be no other either."""
        if pending.cancelled():  # Dask does so when it loses its scheduler
            raise WorkersLostError("the Dask scheduler was lost; start it again, then go on with --resume")
        error = pending.exception()
        if error is not None:
            words = f"the fit took down every Dask worker it was given to, or never came back ({error})"
            return End(store.CRASHED, " ".join(words.split())), store.new_part(folder)
        return pending.result()


if __name__ == "__main__":
    serve(make)
