"""The process that fits: takes jobs as lines of JSON on standard input, answers with one line each.

    python -m identify.studies.hand

It lives as long as its batch, so that what one fit compiled serves the next fit of the same shape, and no longer: no
fit outlives the batch it belongs to by more than the fit itself, and on Linux by nothing.
"""

from __future__ import annotations

import ctypes
import faulthandler
import json
import os
import signal
import sys
import warnings
from dataclasses import asdict
from pathlib import Path

from identify.studies.job import Job
from identify.studies.making import Make, make

READY = {"ready": True}
PR_SET_PDEATHSIG = 1  # linux/prctl.h


def serve(work: Make) -> None:
    """Answer job after job until standard input closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the batch, which then ends this process
    warnings.simplefilter("ignore")
    faulthandler.enable()
    _end_with_parent()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # whatever a library prints is no answer

    def answer(document: object) -> None:
        try:
            answers.write(json.dumps(document) + "\n")
            answers.flush()
        except OSError:
            os._exit(0)  # nobody listens any more

    answer(READY)
    for line in iter(sys.stdin.readline, ""):
        request = json.loads(line)
        answer(asdict(work(Job.from_document(request["job"]), Path(request["part"]))))


def _end_with_parent() -> None:
    """Have the system end this process with the one that started it, where it can.

    Not a thread that watches: readers of logs guard themselves by forks, which a process with threads must not do.
    """
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def main() -> None:
    """Serve fits; what they need is loaded before the first one, so that no fit pays for it."""
    import identify.identification
    import identify.report
    import identify.report.hdf5
    import identify.report.report_figures
    import identify.report.report_page  # noqa: F401

    serve(make)


if __name__ == "__main__":
    main()
