"""What is in the logs of the folder: `stickslip inspect` of each in the background, kept until the file changes; and
one log as a fit with the cuts of a scene takes it."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from data_io.atomic import atomic_write
from data_io.record import within
from identify.app.folder import Document, Folder
from identify.app.jobs import same_code
from identify.app.results import as_shown
from identify.base.document import Json, read_json, to_dict
from identify.base.wording import quantity, speed_text
from identify.logs.classical import table_of
from identify.logs.prepare import Segmented
from identify.logs.recorded_drive import SPEED_TEXT
from identify.logs.regime import Known, look
from identify.report.report_tables import stroke_table

LONGEST = 1800.0  # seconds that the inspection of one log may take
MOST_STROKES = 3  # beside each other in the classical table
NICE = 10  # of its process: what a person waits for goes first
ENDINGS = re.compile(r"(\.[a-z]\w{0,6})+$", re.IGNORECASE)


class Looks:
    """The inspections of a folder, one after the other, each by a process of its own."""

    def __init__(self, folder: Folder) -> None:
        self._folder, self._changed = folder, threading.Condition()
        self._queued: dict[str, bool] = {}  # in the order of the lists, and whether somebody waits for it
        self._seen: dict[str, tuple[list[int], Document]] = {}
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False
        threading.Thread(target=self._work, daemon=True).start()

    def of(self, name: str, waited_for: bool = False) -> Document | None:
        """The inspection of a log as `stickslip inspect --json` has it, {"error": sentence} of one that cannot be read;
        None: not yet, and the log is queued, where somebody waits for it (has it open) in front."""
        stamp = self._stamp(name)
        if name not in self._seen or self._seen[name][0] != stamp:
            kept = read_json(self._place(name))
            if kept is None or kept.get("stamp") != stamp:
                with self._changed:
                    self._queued[name] = waited_for or self._queued.get(name, False)
                    self._changed.notify()
                return None
            self._seen[name] = stamp, kept["log"]
        return self._seen[name][1]

    def keep(self, name: str, log: Document) -> None:
        """Keep the inspection of a log until its file changes."""
        stamp = self._stamp(name)
        with atomic_write(self._place(name)) as handle:
            json.dump({"stamp": stamp, "log": log}, handle)
        self._seen[name] = stamp, log

    def close(self) -> None:
        """Stop; the log that was being inspected is inspected again another time."""
        self._closed = True
        if self._process is not None:
            self._process.kill()

    def _stamp(self, name: str) -> list[int]:
        stat = self._folder.path(name).stat()
        return [stat.st_mtime_ns, stat.st_size]

    def _place(self, name: str) -> Path:
        return self._folder.own("looks", f"{hashlib.sha256(name.encode('utf-8', 'surrogateescape')).hexdigest()}.json")

    def _work(self) -> None:
        while not self._closed:
            with self._changed:
                self._changed.wait_for(lambda: self._queued)
                name = max(self._queued, key=self._queued.__getitem__)  # the first that is waited for, or of all
            with suppress(OSError, ValueError):  # gone meanwhile, or no place to write to: queued with the next list
                self._stamp(name)
                log = self._inspected(name)
                if not self._closed:
                    self.keep(name, log)
            with self._changed:
                self._queued.pop(name)

    def _inspected(self, name: str) -> Document:
        """By a process behind everything else that runs, so that no log can harm or hold up the server."""
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "identify", "inspect", f"./{name}", "--json", "--quiet"],
            cwd=self._folder.root,
            env=same_code(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the server, which then closes this
        )
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, NICE)
        try:
            document = json.loads(self._process.communicate(timeout=LONGEST)[0])
        except subprocess.TimeoutExpired:
            self._process.kill()
            return {"error": f"its inspection took longer than {LONGEST:g} s; use stickslip inspect"}
        except ValueError:
            return {"error": "stickslip inspect ended without an answer; run it on the command line to see why"}
        if document.get("logs"):
            return dict(document["logs"][0])
        return {"error": str(document.get("message", "it cannot be read")).replace("./", "", 1)}


def row_of(name: str, log: Document | None) -> Document:
    """One line of the table of logs, in words; `ready` is False until the log was inspected."""
    pair = SPEED_TEXT.sub("", ENDINGS.sub("", Path(name).name)).strip(" _-")  # logs of one pair differ by their speeds
    row: Document = {"path": name, "ready": log is not None, "pair": pair or "pair"}
    if log is None:
        return row
    if "error" in log:
        return row | {"verdict": "reject", "reason": log["error"].removeprefix(f"{name}: ")}
    quality, rate = log["quality"], log["sampling"]["rate"]
    findings = sorted(quality["findings"], key=lambda f: f["severity"] != "reject")
    worst = [f["message"] for f in findings if f["severity"] in ("reject", "warning")]
    moving = sorted({abs(speed) for _, speed in log["drive_speed_programme"] or () if speed})
    hint, place = log.get("speed_mentioned") or ("", "")
    row |= {"hint": hint, "hinted_by": place} if hint and not moving else {}
    return row | {
        "format": log["format"],
        "speed": ", ".join(speed_text(s) for s in moving[:3]) + (" …" if len(moving) > 3 else ""),
        "load": quantity(quality["load_N"], "N", 3) if quality.get("load_N") is not None else "",
        "rate": quantity(rate, "Hz", 3) if rate else "",
        "curve": log.get("force_overview_N"),
        "slips": sum(step["cycles"] for step in log["steps"]),
        "regime": (log["regime"] or "unknown").replace("_", " "),
        "verdict": quality["verdict"],
        "reason": worst[0] if worst else "",
        "more": max(len(worst) - 1, 0),
        "slope": next((row["stick_slope_N_per_s"] for row in log["classical"]["rows"]), None),
    }


def classical_shown(rows: Sequence[Mapping[str, Json]]) -> Document:
    """The classical table of the first strokes of a log."""
    heads = [f"step {row['step']} stroke {row['stroke']}" if len(rows) > 1 else "value" for row in rows[:MOST_STROKES]]
    return as_shown(stroke_table(list(zip(heads, rows, strict=False))))


def seen_by_a_fit(log: Segmented) -> Document:
    """Cycles, classical table and account of a log with the cuts of its entry, as a fit will take it."""
    entry, cycles, slope = log.entry, log.phases.cycles, log.phases.stick_slope
    columns = {name: getattr(cycles, name) for name in ("onset", "arrest", "onset_force", "arrest_force", "drop")}
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    shown = within(log.record, entry.window)  # on a clock of its own, so that its phases are looked for again
    seen = look(shown, log.speed, Known(plate=log.rig.plate))
    document: Document = {
        "cycles": [dict(zip(columns, row, strict=True)) for row in rows],
        "sign": log.sign,
        "noise": log.noise,
        "regime": "" if log.verdict.regime is None else log.verdict.regime.value.replace("_", " "),
        "evidence": list(log.verdict.evidence),
        "table": classical_shown(table_of(shown, seen, log.rig.stiffness).rows),
        "stick_slope": None if slope is None else slope[0],
        "stiffness_of_sticks": None if slope is None else slope[0] / log.speed,
        "changes": [change.text for change in log.corrected.changes],
    }
    return to_dict(document)
