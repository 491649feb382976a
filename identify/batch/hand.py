"""The process that fits: takes jobs as lines of JSON on standard input, answers with one line each.

    python -m identify.batch.hand

It lives as long as its batch, so that what one fit compiled serves the next fit of the same shape, and ends by itself
as soon as its standard input closes: no fit outlives the batch it belongs to.
"""

from __future__ import annotations

import faulthandler
import json
import os
import queue
import signal
import sys
import threading
import warnings
from dataclasses import asdict
from pathlib import Path

from identify.batch.job import Job
from identify.batch.making import Make, make

READY = {"ready": True}


def serve(work: Make) -> None:
    """Answer job after job until standard input closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the batch, which then closes the input
    warnings.simplefilter("ignore")
    faulthandler.enable()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # whatever a library prints is no answer
    asked: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(asked,), daemon=True).start()

    def answer(document: object) -> None:
        try:
            answers.write(json.dumps(document) + "\n")
            answers.flush()
        except OSError:
            os._exit(0)  # nobody listens any more

    answer(READY)
    while True:
        request = json.loads(asked.get())
        answer(asdict(work(Job.from_document(request["job"]), Path(request["part"]))))


def _listen(asked: queue.SimpleQueue[str]) -> None:
    for line in sys.stdin:
        asked.put(line)
    os._exit(0)


def main() -> None:
    """Serve fits; what they need is loaded before the first one, so that no fit pays for it."""
    import identify.identification
    import identify.report
    import identify.report.figures
    import identify.report.hdf5
    import identify.report.page  # noqa: F401

    serve(make)


if __name__ == "__main__":
    main()
