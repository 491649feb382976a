"""Small batches with a quick stand-in for the fit, as trials and tests of everything around the fit use them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from identify.studies.batch_store import JOB, complete

ROOT = Path(__file__).resolve().parent.parent
STUB = "experiments.stub_fits"
SCENE = """
effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]
[rig]
mass = "0.2 kg"
stiffness = "1470 N/m"
damping = "147 N/m"
"""
# The page of a batch takes longer to import than a batch of stand-ins takes to run; it is tested where it is made.
NO_PAGE = (
    "import sys, types; page = types.SimpleNamespace(write_batch_report=str); "
    "sys.modules['identify.studies.comparison_page'] = page; "
)
WITH_STUB = f"from identify.studies import workers; workers.MODULE = {STUB!r}; "
COMMAND = "import sys; from identify.cli.main import main; raise SystemExit(main(sys.argv[1:]))"
TIMES = ("timing_s", "finished", "started", "seconds", "machine", "host")  # what may differ between two runs


def write_case(folder: Path, groups: Sequence[str], logs_each: int = 2) -> tuple[Path, Path]:
    """Manifest and scene, with logs of a few lines that differ."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["path,group,drive_speed,material"]
    for i, group in enumerate(groups):
        for j in range(logs_each):
            name = f"log_{i}_{j}.csv"
            (folder / name).write_text(f"T,Fz,Fx\ns,N,N\n0,1,0.{i}{j}\n1,1,0.4\n2,1,0.5\n")
            lines.append(f"{name},{group},{j + 1} mm/s,{'AB'[i % 2]}")
    (folder / "manifest.csv").write_text("\n".join(lines) + "\n")
    (folder / "scene.toml").write_text(SCENE)
    return folder / "manifest.csv", folder / "scene.toml"


def environment(seconds: float = 0.02) -> dict[str, str]:
    """That of this process for a child: this package, one thread, no compiling, a stand-in that takes so long [s]."""
    return {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "STUB_SECONDS": str(seconds),
        "OMP_NUM_THREADS": "1",
        "STICKSLIP_COMPILE": "0",
    }


def started(
    arguments: Sequence[object], seconds: float = 0.02, before: str = NO_PAGE, largest: int | None = None
) -> subprocess.Popen[bytes]:
    """`stickslip batch` in a process of its own with a stand-in for the fit; before: what it does first, in Python;
    largest: bytes of a file, beyond which writing fails as on a full disk."""
    full = f"import resource as r; r.setrlimit(r.RLIMIT_FSIZE, ({largest}, {largest})); " if largest else ""
    command = [sys.executable, "-c", full + before + WITH_STUB + COMMAND, "batch", *map(str, arguments)]
    whole = {"PYTHONDONTWRITEBYTECODE": "1"} if largest else {}  # Python keeps what it could write of it
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, env=environment(seconds) | whole, cwd=ROOT)


def children(pid: int) -> list[int]:
    """The processes below this one; none where the system does not tell."""
    found = []
    for item in Path("/proc").glob("[0-9]*/stat"):
        try:
            told = item.read_text()
        except OSError:
            continue
        if int(told.rpartition(")")[2].split()[1]) == pid:
            found.append(int(item.parent.name))
    return found


def alive(pid: int) -> bool:
    """Whether a process runs (one that has ended and was not waited for does not)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_for(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    """Until it holds; AssertionError where it does not within so many seconds."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it did not happen"
        time.sleep(0.01)


def kill(pid: int, number: signal.Signals = signal.SIGKILL) -> None:
    """Send a signal to a process that may be gone."""
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return


def put(out: Path) -> dict[str, int]:
    """The groups that stand in a batch folder, and the inode of each folder: another one is another fit."""
    found = {}
    for item in out.glob("[!.]*") if out.is_dir() else ():
        try:
            found[item.name] = item.stat().st_ino if item.is_dir() else -1
        except FileNotFoundError:  # just now replaced by a running batch
            continue
    return {name: inode for name, inode in found.items() if inode >= 0}


def differences(folder: Path, reference: Path) -> Iterator[str]:
    """What differs between two folders of one group, but for times and host."""
    if complete(folder) is None:
        yield f"{folder.name} is not whole"
        return
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    expected = {path.relative_to(reference).as_posix() for path in reference.rglob("*") if path.is_file()}
    if names != expected:
        yield f"{folder.name} has other files: {sorted(names ^ expected)}"
        return
    for name in sorted(names):
        if content(folder / name) != content(reference / name):
            yield f"{folder.name}/{name} is another"


def content(path: Path) -> Any:
    """What a file says, without times and host."""
    if path.suffix == ".json":
        return timeless(json.loads(path.read_text()), path.name == JOB)
    if path.name == "index.csv":
        return [line.rpartition(",")[0] for line in path.read_text().splitlines()]
    return path.read_bytes()


def timeless(document: Any, job: bool = False) -> Any:
    """A JSON document without times and host; of job.json also without sizes, which count their digits."""
    gone = (*TIMES, "files", "result_sha256") if job else TIMES
    if isinstance(document, dict):
        return {key: timeless(value, job) for key, value in document.items() if key not in gone}
    return [timeless(item, job) for item in document] if isinstance(document, list) else document
