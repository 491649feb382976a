"""What is in the logs of the folder: `stickslip inspect` of each in the background, kept until the file changes; and
one log as a fit with the cuts of a scene sees it, alive."""

from __future__ import annotations

import hashlib
import json
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Mapping
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from data_io.atomic import atomic_write
from data_io.record import within
from identify.app.folder import Folder, read_json
from identify.app.jobs import same_code
from identify.base.document import to_document
from identify.base.wording import quantity, speed_text
from identify.logs.classical import table_of
from identify.logs.log_regime import look
from identify.logs.segment import DetectedCycles
from identify.logs.segmented import Segmented
from identify.report.stored_result import plain

LONGEST = 1800.0  # seconds that looking at one log may take
NICE = 10  # of the process that looks: what a person waits for goes first
SEVERITIES = ("reject", "warning")


class Looks:
    """The inspections of a folder, made one after the other by a process each."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder
        self._asked: queue.PriorityQueue[tuple[bool, int, str]] = queue.PriorityQueue()
        self._number = count()
        self._waiting: set[tuple[str, bool]] = set()
        self._seen: dict[str, tuple[list[int], dict[str, Any]]] = {}
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False
        threading.Thread(target=self._work, daemon=True).start()

    def of(self, name: str, waited_for: bool = False) -> dict[str, Any] | None:
        """The inspection of a log as `stickslip inspect --json` has it; None: not yet, it is asked for.

        A log that cannot be read has {"error": sentence}.

        Args:
            waited_for: somebody has this log open, so it is the next one.
        """
        stamp = self._stamp(name)
        if (known := self._seen.get(name)) is not None and known[0] == stamp:
            return known[1]
        kept = read_json(self._place(name))
        if kept is not None and kept.get("stamp") == stamp:
            self._seen[name] = stamp, kept["log"]
            return self._seen[name][1]
        if (name, waited_for) not in self._waiting:
            self._waiting.add((name, waited_for))
            self._asked.put((not waited_for, next(self._number), name))
        return None

    def close(self) -> None:
        """Stop looking; what was being looked at is looked at again another time."""
        self._closed = True
        if self._process is not None:
            self._process.kill()

    def _stamp(self, name: str) -> list[int]:
        stat = self._folder.path(name).stat()
        return [stat.st_mtime_ns, stat.st_size]

    def _place(self, name: str) -> Any:
        return self._folder.own("looks", f"{hashlib.sha256(name.encode('utf-8', 'surrogateescape')).hexdigest()}.json")

    def _work(self) -> None:
        while True:
            later, _, name = self._asked.get()
            try:
                stamp = self._stamp(name)
                known = self._seen.get(name)
                if known is not None and known[0] == stamp:
                    continue  # it was looked at meanwhile, as somebody waited for it
                log = self._inspected(name)
                if self._closed:
                    return
                with atomic_write(self._place(name)) as handle:
                    json.dump({"stamp": stamp, "log": log}, handle)
                self._seen[name] = stamp, log
            except (OSError, ValueError):
                continue  # gone meanwhile, or no place to write to: asked for again with the next list
            finally:
                self._waiting.discard((name, not later))

    def _inspected(self, name: str) -> dict[str, Any]:
        """Of a process of its own, behind everything else that runs, so that no log can harm or hold up the server."""
        words = [sys.executable, "-P", "-m", "identify", "inspect", f"./{name}", "--json", "--quiet"]
        self._process = subprocess.Popen(
            words,
            cwd=self._folder.root,
            env=same_code(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the server, which then closes this
        )
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, NICE)
            # Linux weighs whole sessions against each other, where it groups by them
            Path(f"/proc/{self._process.pid}/autogroup").write_text(str(NICE))
        try:
            document = json.loads(self._process.communicate(timeout=LONGEST)[0])
        except subprocess.TimeoutExpired:
            self._process.kill()
            return {"error": f"looking at it took longer than {LONGEST:g} s; use stickslip inspect"}
        except ValueError:
            return {"error": "stickslip inspect ended without an answer; run it on the command line to see why"}
        if document.get("logs"):
            return dict(document["logs"][0])
        return {"error": str(document.get("message", "it cannot be read")).replace("./", "", 1)}


def row_of(name: str, size: int, log: Mapping[str, Any] | None) -> dict[str, Any]:
    """One line of the table of logs, in words; `ready` is False until the log was looked at."""
    row: dict[str, Any] = {"path": name, "bytes": size, "ready": log is not None}
    if log is None:
        return row
    if "error" in log:
        return row | {"verdict": "reject", "reason": log["error"].removeprefix(f"{name}: ")}
    quality, findings = log["quality"], log["quality"]["findings"]
    worst = [f["message"] for severity in SEVERITIES for f in findings if f["severity"] == severity]
    speeds = {s for _, s in log["drive_speed_programme"] or ()}
    moving = sorted(abs(s) for s in speeds if s)
    return row | {
        "format": log["format"],
        "speed": ", ".join(speed_text(s) for s in moving[:3]) + (" …" if len(moving) > 3 else ""),
        "load": quantity(quality["load_N"], "N", 3) if quality.get("load_N") is not None else "",
        "rate": quantity(log["sampling"]["rate"], "Hz", 3) if log["sampling"]["rate"] else "",
        "slips": sum(step["cycles"] for step in log["steps"]),
        "regime": (log["regime"] or "not told").replace("_", " "),
        "verdict": quality["verdict"],
        "reason": worst[0] if worst else "",
        "more": max(len(worst) - 1, 0),
        "slope": next((row["stick_slope_N_per_s"] for row in log["classical"]["rows"]), None),
    }


def cycles_of(cycles: DetectedCycles) -> list[dict[str, float]]:
    """Sticks and slips as numbers, SI: onset and arrest [s], the forces there [N], slope of the stick [N/s]."""
    columns = {
        "onset": cycles.onset,
        "arrest": cycles.arrest,
        "onset_force": cycles.onset_force,
        "arrest_force": cycles.arrest_force,
        "drop": cycles.drop,
    }
    rows = zip(*(np.asarray(values).tolist() for values in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in rows]


def seen_by_a_fit(log: Segmented) -> dict[str, Any]:
    """Cycles, classical table and account of a log with the cuts of its entry, as a fit will see it."""
    entry = log.entry
    shown = within(log.record, entry.window)  # on a clock of its own, so that its phases are looked for again
    table = table_of(shown, look(shown, log.speed), stiffness=log.rig.stiffness)
    slope = log.found.stick_slope
    document: dict[str, Any] = {
        "cycles": cycles_of(log.found.cycles),
        "skip_cycles": entry.skip_cycles,
        "sign": log.sign,
        "noise": log.noise,
        "regime": "" if log.verdict.regime is None else log.verdict.regime.value.replace("_", " "),
        "evidence": list(log.verdict.evidence),
        "table": to_document(table),
        "stick_slope": None if slope is None else slope[0],
        "stiffness_of_sticks": None if slope is None else slope[0] / log.speed,
        "changes": [change.text for change in log.corrected.changes],
    }
    return dict(plain(document))
