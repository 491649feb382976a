"""A small batch with a stand-in for the fit, shared by the tests of the batch."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
STUB = "experiments.stub_fits"
SCENE = """
effects = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]
[rig]
mass = "0.2 kg"
stiffness = "1470 N/m"
damping = "147 N/m"
"""
COMMAND = (
    f"import sys; from identify.batch import grip; grip.MODULE = {STUB!r}; "
    "from identify.cli.main import main; raise SystemExit(main(sys.argv[1:]))"
)


class Silent:
    """Hears how far a batch is and keeps it."""

    def __init__(self):
        self.heard = []

    def begins(self, total, kept):
        self.heard.append(("begins", total, kept))

    def ended(self, group, end, done, total, remaining):
        self.heard.append((group, end.status, done, total, remaining))

    def tick(self):
        pass


def write_case(folder: Path, groups: list[str], logs_each: int = 2) -> tuple[Path, Path]:
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
    return {**os.environ, "PYTHONPATH": str(ROOT), "STUB_SECONDS": str(seconds), "OMP_NUM_THREADS": "1"}


def started(arguments: list[object], seconds: float = 0.02) -> subprocess.Popen[bytes]:
    """`stickslip batch` in a process of its own, with the stand-in for the fit."""
    command = [sys.executable, "-c", COMMAND, "batch", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment(seconds), cwd=ROOT)


def children(pid: int) -> list[int]:
    """The processes below this one."""
    found = []
    for item in Path("/proc").iterdir():
        try:
            told = (item / "stat").read_text() if item.name.isdigit() else ""
        except OSError:
            continue
        if told and int(told.rpartition(")")[2].split()[1]) == pid:
            found.append(int(item.name))
    return found


def wait_for(condition, seconds=20.0):
    """Until it holds."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it did not happen"
        time.sleep(0.01)


def kill(pid: int) -> None:
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return
