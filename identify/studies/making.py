"""The process that makes the fits of a batch: a job in, a complete folder out, or the reason why there is none.

    python -m identify.studies.making

takes jobs as lines of JSON on standard input and answers with one line each. It lives as long as its batch, so that
what one fit compiled serves the next fit of the same shape, and no longer: on Linux no fit outlives its batch.
"""

from __future__ import annotations

import ctypes
import faulthandler
import json
import os
import platform
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterable
from dataclasses import asdict, replace
from pathlib import Path

from data_io.source import file_sha256
from data_io.values import LogError, UnitError
from identify.base.errors import IdentifyError
from identify.base.result import Result
from identify.studies.batch_store import is_full, write_job
from identify.studies.job import CRASHED, DEFECT, FAILED, OUTDATED, UNWRITTEN, End, Job, numerics

Make = Callable[[Job, Path], End]
PR_SET_PDEATHSIG = 1  # linux/prctl.h


def make(job: Job, part: Path) -> End:
    """Fit a job and write its folder `part`; every error becomes an end with its reason.

    The folder is complete (job.json is there) only where the end carries the status of a fit.
    """
    if job.numerics != numerics():
        return End(
            OUTDATED,
            f"this process has other numerics ({numerics()}) than the batch was planned with ({job.numerics}); "
            "install the same versions everywhere",
        )
    return guarded(_fitted, job, part)


def guarded(work: Make, job: Job, part: Path) -> End:
    """Do the work; an exception becomes an end: what the user can mend in one sentence, the rest with its traceback."""
    try:
        return work(job, part)
    except (IdentifyError, LogError, UnitError) as error:
        changed = _changed(job, (_digest(log.path) for log in job.logs))
        return changed or End(FAILED, " ".join(str(error).split()))
    except OSError as error:
        words = f"{error.filename or part}: {error.strerror or error}"
        return End(UNWRITTEN if is_full(error) else CRASHED, words)
    except MemoryError:
        return End(DEFECT, "the fit ran out of memory; give the batch fewer jobs at a time", traceback.format_exc())
    except Exception as error:  # noqa: BLE001 - a defect in one fit must not stop the others
        return End(DEFECT, f"a defect of ours ({type(error).__name__}: {error})", traceback.format_exc())


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
    fitted = time.perf_counter()
    part.mkdir()
    try:
        write_report(replace(outcome, result=with_provenance(result, job).to_dict()), part)
        now = time.perf_counter()
        timing = {"fit": fitted - began, "report": now - fitted, "total": now - began}
        end = End(result.status, result.message, None, timing | {"processor": time.process_time() - used})
        write_job(part, job, end)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise
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
            return End(OUTDATED, f"{planned.path}: {words}")
    return None


def _digest(path: str) -> str | None:
    try:
        return file_sha256(Path(path))
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
        document = asdict(work(Job.from_document(request["job"]), Path(request["part"])))


if __name__ == "__main__":
    serve(make)
