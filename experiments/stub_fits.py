"""A stand-in for the fitting process of a batch, for trials of everything around the fit: quick, and it can go wrong.

    python -m experiments.stub_fits

The numbers of its results are made from the contents of the logs, so that a result of the wrong job is found out.
What a group is called says how its fit goes: hang, crash, defect, refuse and full do as they are called.
STUB_SECONDS: how long a fit works before it writes (default 0.02), and as long again while it writes.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import os
import random
import time
from pathlib import Path

from data_io.values import LogError
from identify.base.result import Result
from identify.studies.batch_store import RESULT, End, Job, write_document, write_job
from identify.studies.workers import guarded, serve, with_provenance

SECONDS = float(os.environ.get("STUB_SECONDS", "0.02"))
SIZE = 20_000  # bytes of each of its files but result.json
FILES = ("report.html", "result.h5", "figures/log_1_force.png", "figures/log_1_force.svg")


def numbers(job: Job) -> dict[str, float]:
    """The parameters that the stub "finds": from the contents of the logs."""
    seed = hashlib.sha256("".join(log.sha256 for log in job.logs).encode()).digest()
    return {name: (1 + seed[i]) / 256 for i, name in enumerate(("mu_s", "mu_k0", "a"))}


def make(job: Job, part: Path) -> End:
    """Work, or go wrong as the name of the group says."""
    return guarded(_made, job, part)


def _made(job: Job, part: Path) -> End:
    began = time.perf_counter()
    time.sleep(SECONDS)
    if job.group.startswith("hang"):
        time.sleep(3600)
    if job.group.startswith("crash"):
        ctypes.string_at(0)
    if job.group.startswith("defect"):
        raise ZeroDivisionError("a stub that divides by zero")
    if job.group.startswith("refuse"):
        raise LogError(f"{job.logs[0].path}: a stub that reads no log")
    part.mkdir()
    (part / "figures").mkdir()
    for name in FILES:
        content = random.Random(f"{job.key} {name}").randbytes(SIZE)
        (part / name).write_bytes(content[: SIZE // 2])
        time.sleep(SECONDS / len(FILES))
        (part / name).write_bytes(content)
    if job.group.startswith("full"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(part / "result.h5"))
    write_document(part / RESULT, _result(job))
    end = End("converged", "a stub that converged", None, {"fit": SECONDS, "total": time.perf_counter() - began})
    write_job(part, job, end)
    return end


def _result(job: Job) -> dict[str, object]:
    """A document as `stickslip fit` writes it, as far as anybody reads it."""
    entry = {"unit": "", "standard_error": 0.01, "interval": [None, None], "level": 0.95, "verdict": "identified"}
    logs = [{"path": log.path, "sha256": log.sha256, "labels": dict(log.labels)} for log in job.logs]
    found = {name: {"value": value, **entry, "reason": ""} for name, value in numbers(job).items()}
    result = {"schema": 1, "status": "converged", "message": "a stub that converged", "parameters": found, "logs": logs}
    told = Result.from_dict({**result, "provenance": {"scene": dict(job.scene), "seed": 0}})
    return with_provenance(told, job).to_dict()


if __name__ == "__main__":
    serve(make)
