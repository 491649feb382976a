"""Jobs: the command line as processes of their own whose state is files: a closed page or server loses nothing. What a
form of the page asks becomes the words of a command: only these commands, only paths of the folder.

A job is a folder with job.json (what was asked), progress.jsonl (its standard error), document.json (its standard
output: exactly one JSON document, also of an error) and `alive`, a file the process holds a lock on while it runs.
"""

from __future__ import annotations

import fcntl
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from glob import escape
from pathlib import Path

from data_io.atomic import atomic_write
from identify.app.folder import Document, Folder, PageError
from identify.base.document import read_json

PACKAGE = str(Path(__file__).resolve().parents[2])
GRACE = 1.6  # seconds in which a cancelled job may end by itself; the command line takes one
KEPT = 60  # finished jobs that are remembered
KILLED = "ended from outside (killed, out of memory, machine stopped); nothing half-written is left: start it again"
AT_ONCE = max(os.cpu_count() or 1, 2)  # jobs
SAID = ("document.json", "progress.jsonl")
LAST = 20_000  # bytes of the progress that are looked at
LONGEST = 500  # characters of a word that a form sends
MOST = 10_000  # words of a list
# Of each command the page may run, what every option is; "logs", "source" and "fits" stand without a name; the option
# of kind "writes" names what it writes.
COMMANDS: Mapping[str, Mapping[str, str]] = {
    "fit": {"logs": "paths", "scene": "path", "out": "writes", "accuracy": "text", "time-limit": "text",
            "starts": "text", "set": "texts", "profile": "switch", "accuracy-table": "switch"},
    "scene": {"logs": "paths", "out": "writes"},
    "rig": {"logs": "paths", "out": "writes", "drive-speed": "texts", "added-mass": "texts"},
    "plan": {"source": "paths", "out": "writes", "budget": "text", "set": "texts"},
    "batch": {"source": "paths", "scene": "path", "out": "writes", "jobs": "text", "time-limit": "text",
              "resume": "switch"},
    "compare": {"fits": "paths", "out": "writes", "by": "text"},
    "stability": {"scene": "path", "result": "path", "plot": "path", "data": "writes", "points": "text",
                  "map": "quantities", "at": "texts", "range": "texts", "advice": "switch"},
}  # fmt: skip


def words_of(folder: Folder, request: Document) -> tuple[list[str], str]:
    """The words after `stickslip`, and what the command writes (a path in the folder, "" for nothing)."""
    name = str(request.get("command"))
    if name not in COMMANDS:
        raise PageError(f"the page runs no such command; expected one of {', '.join(COMMANDS)}")
    options = COMMANDS[name]
    if foreign := sorted(set(request) - {"command", *options}):
        raise PageError(f"{name} has no option {foreign[0]!r} in the page; use the command line for it")
    words, out = [name], ""
    for key, kind in options.items():
        value = request.get(key)
        if not value:
            continue
        if kind == "paths":
            words += [_path(folder, text) for text in _list(value)]
        elif kind == "switch":
            words.append(f"--{key}")
        elif kind == "quantities":
            words += [f"--{key}", *(_text(item, of_a_map=True) for item in _list(value))]
        elif kind in ("path", "writes"):
            words += [f"--{key}", _path(folder, value)]
            out = str(value) if kind == "writes" else out
        else:
            words += [f"--{key}={_text(item)}" for item in _list(value)]
    return words, out


def _path(folder: Folder, text: object) -> str:
    """A path that no command takes for an option."""
    name = folder.name(folder.path(text))
    return f"./{name}" if name.startswith("-") else name


def _list(value: object) -> list[object]:
    items = value if isinstance(value, list) else [value]
    if len(items) > MOST:
        raise PageError(f"{len(items)} items were chosen; at most {MOST} were expected; choose fewer")
    return items


def _text(value: object, of_a_map: bool = False) -> str:
    text = str(value)
    if not isinstance(value, (str, int, float)) or len(text) > LONGEST or not text.isprintable():
        raise PageError("an option is no short text; write it again")
    if of_a_map and not text.isidentifier():
        raise PageError(f"{text!r} is no quantity of a map; choose one from the list")
    return text


def same_code() -> dict[str, str]:
    """The environment of a process that is to run this very package, wherever it stands."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [PACKAGE, os.environ.get("PYTHONPATH", "")]))}


class Jobs:
    """The jobs of one folder."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder
        self._place = folder.own("jobs", "x").parent
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._lock = threading.Lock()

    def start(self, words: Sequence[str], out: str) -> Document:
        """Start `stickslip` with these words."""
        with self._lock:
            running = [job for job in self.listed() if job["state"] == "running"]
            if len(running) >= AT_ONCE:
                raise PageError(f"{len(running)} jobs are running, one for each core; cancel one or wait")
            if out and any(job["out"] == out for job in running):
                raise PageError(f"{out} is being written by a job that runs; wait, cancel it, or choose another name")
            others = (int(job["id"], 16) + 1 for job in self.listed())
            name = f"{max([time.time_ns(), *others]):x}"  # the last of them also where the clock was set back
            place = self._place / name
            place.mkdir(parents=True)
            about = {"words": list(words), "out": out, "started": time.time()}
            with ExitStack() as opened:
                names = ("alive", *SAID)
                alive, document, progress = (opened.enter_context((place / each).open("wb")) for each in names)
                fcntl.flock(alive, fcntl.LOCK_EX)
                child = subprocess.Popen(
                    [sys.executable, "-P", "-m", "identify", *words, "--json", "--progress", "json"],
                    cwd=self._folder.root,
                    env=same_code(),
                    stdin=subprocess.DEVNULL,
                    stdout=document,
                    stderr=progress,
                    start_new_session=True,
                    pass_fds=[alive.fileno()],
                )
            with atomic_write(place / "job.json") as handle:
                json.dump(about | {"pid": child.pid}, handle)
            self._children[name] = child
            for old in sorted(self._place.iterdir())[:-KEPT]:  # of those that have ended
                if not _running(old):
                    shutil.rmtree(old, ignore_errors=True)
        return self.seen(name)

    def listed(self) -> list[Document]:
        """All jobs, the newest first."""
        for child in self._children.values():
            child.poll()
        names = sorted((p.name for p in self._place.iterdir() if (p / "job.json").is_file()), reverse=True)
        jobs = []
        for name in names:
            with suppress(PageError, OSError):  # forgotten meanwhile by another server of this folder
                jobs.append(self.seen(name))
        return jobs

    def seen(self, name: str) -> Document:
        """One job: what was asked, its state (running, done, failed, cancelled, killed), progress, and what it said."""
        place = self._of(name)
        about = read_json(place / "job.json")
        if about is None:
            raise PageError("there is no such job any more; load the page again")
        state, message = _state(place)
        if state == "killed":
            self._sweep(about)
        ends = time.time() if state == "running" else max((place / each).stat().st_mtime for each in SAID)
        command, seconds = shlex.join(["stickslip", *about["words"]]), max(ends - about["started"], 0.0)
        job = {"id": name, "command": command, "kind": about["words"][0], "out": about["out"], "seconds": seconds}
        return job | {"state": state, "message": message, **_progress(place / "progress.jsonl")}

    def document(self, name: str) -> Document:
        """What a finished job printed."""
        document = read_json(self._of(name) / "document.json")
        if document is None:
            raise PageError("this job has printed no result; look at its state")
        return document

    def cancel(self, name: str) -> Document:
        """End a job and everything it started; at once where it does not end by itself."""
        place = self._of(name)
        about = read_json(place / "job.json") or {}
        if _running(place) and "pid" in about:
            (place / "cancelled").touch()
            for number in (signal.SIGINT, signal.SIGKILL):
                deadline = time.monotonic() + GRACE
                with suppress(ProcessLookupError):
                    os.killpg(about["pid"], number)
                while _running(place) and time.monotonic() < deadline:
                    time.sleep(0.02)
            self._sweep(about)
        return self.seen(name)

    def _of(self, name: str) -> Path:
        if not name.isalnum():
            raise PageError("there is no such job; load the page again")
        return self._place / name

    def _sweep(self, about: Document) -> None:
        """Remove the temporary folders of a result that a killed job could not remove itself, and no other's."""
        if about.get("out"):
            out = self._folder.path(about["out"])
            for rest in out.parent.glob(f".{escape(out.name)}.{about.get('pid')}.*"):
                shutil.rmtree(rest, ignore_errors=True)


def _running(place: Path) -> bool:
    """Whether a process holds its lock: no number of a process is trusted, which another one may have by now."""
    try:
        with (place / "alive").open("rb") as alive:
            fcntl.flock(alive, fcntl.LOCK_SH | fcntl.LOCK_NB)  # two that look are not in each other's way
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _state(place: Path) -> tuple[str, str]:
    """The state of a job, and its message."""
    if _running(place):
        return "running", ""
    document = read_json(place / "document.json")
    if (place / "cancelled").exists() and (document is None or document.get("status") == "error"):
        return "cancelled", "cancelled; nothing half-written is left behind"
    if document is None:
        return "killed", KILLED
    message = str(document.get("message") or "")
    return ("failed" if document.get("status") == "error" else "done"), message


def _progress(path: Path) -> Document:
    """From the lines of standard error: stages so far with the seconds at which each began, share of the whole (None:
    unknown), and the words among them."""
    stages: list[tuple[str, float]] = []
    share, words, lines = None, [], list[str]()
    with suppress(OSError):
        lines = path.read_bytes()[-LAST:].decode("utf-8", "replace").splitlines()
    for line in lines:
        try:
            report = json.loads(line)
            stage, at = str(report["stage"]), float(report["seconds"])
        except (ValueError, TypeError, KeyError):
            words.append(line)
            continue
        share = report.get("share")
        if not stages or stages[-1][0] != stage:
            stages.append((stage, at))
    return {"stages": stages, "share": share, "words": "\n".join(words).strip()}
