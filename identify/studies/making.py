"""One fit of a batch, within its process: from a job to a complete folder, or to the reason why there is none."""

from __future__ import annotations

import platform
import shutil
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from data_io.source import file_sha256
from data_io.values import LogError, UnitError
from identify.base.errors import IdentifyError
from identify.base.outcome import places_of
from identify.studies.batch_store import is_full, write_job
from identify.studies.job import CRASHED, DEFECT, FAILED, OUTDATED, UNWRITTEN, End, Job, numerics

Make = Callable[[Job, Path], End]


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
        changed = _changed(job, [_digest(log.path) for log in job.logs])
        return End(FAILED, " ".join(str(error).split())) if changed is None else End(OUTDATED, changed)
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
    logs = outcome.result["logs"]
    changed = _changed(job, [str(logs[places_of(logs, number)[0]]["sha256"]) for number in range(len(job.logs))])
    if changed is not None:
        return End(OUTDATED, changed)
    fitted = time.perf_counter()
    outcome = replace(outcome, result=with_provenance(outcome.result, job))
    part.mkdir()
    try:
        write_report(outcome, part)
        now = time.perf_counter()
        timing = {"fit": fitted - began, "report": now - fitted, "total": now - began}
        timing["processor"] = time.process_time() - used
        end = End(str(outcome.result["status"]), str(outcome.result["message"]), None, timing)
        write_job(part, job, end)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise
    return end


def with_provenance(result: Mapping[str, Any], job: Job) -> dict[str, Any]:
    """The document with what ties it to its batch."""
    batch = {"group": job.group, "key": job.key, "numerics": job.numerics}
    where = {"host": platform.node(), "python": platform.python_version(), "system": platform.platform()}
    return {**result, "provenance": {**result["provenance"], "batch": batch, "machine": where}}


def _changed(job: Job, found: Sequence[str | None]) -> str | None:
    """A sentence where a log is not the one that was hashed when the batch began; `found`: SHA-256 of each log."""
    for planned, digest in zip(job.logs, found, strict=True):
        if planned.sha256 != digest:
            return f"{planned.path}: the log was changed or taken away while the batch ran; run again with --resume"
    return None


def _digest(path: str) -> str | None:
    try:
        return file_sha256(Path(path))
    except OSError:
        return None
