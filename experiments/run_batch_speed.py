"""What a batch costs beside its fits: 200 logs in 50 groups of 4, with one worker and with two.

Speed-up is wall time of one worker over wall time of two; overhead is what the workers' wall time holds beside the
fits and their reports; the memory is that of the process that leads the batch, watched while it runs. On a machine
with other work wall times say little, so the processor seconds of the leader and of the fits stand beside them.

    python experiments/run_batch_speed.py [--fast]
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import json

import numpy as np

from data_io import Record, write_csv
from experiments.batch_trials import children, result_of, started, write_case
from experiments.machine import describe
from experiments.study_problem import DEMO, NOISE, RIG
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run as simulate

SPEED_UP, OVERHEAD = 1.8, 0.05  # what is asked for
# Drive speed [m/s], duration [s], rate [Hz] of the four logs of a group.
LOGS = ((1e-3, 2.0, 500.0), (5e-4, 3.0, 500.0), (2e-3, 1.5, 1000.0), (1e-3, 2.5, 500.0))
TICKS = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


@dataclass(frozen=True)
class Figures:
    """One batch: seconds of wall time, of its fits and of fits with reports by their own clocks; processor seconds of
    the leader and of the workers; resident memory [MB] of the leader when a tenth and when all of the groups had
    ended; largest of a worker; seconds that the first fit spent on building, and the median of the others."""

    workers: int
    wall: float
    fits: float
    jobs: float
    leader: float
    work: float
    memory: tuple[float, float]
    worker_memory: float
    build: tuple[float, float]

    @property
    def overhead(self) -> float:
        """What the workers' time holds beside fits and reports, as a share of these."""
        return (self.workers * self.wall - self.jobs) / self.jobs


def write_logs(folder: Path, groups: int) -> tuple[Path, Path]:
    """Manifest and scene: groups of four logs of one pair each, whose static friction differs from group to group."""
    case = write_case(folder, [])
    lines = ["path,group,drive_speed,material"]
    for group in range(groups):
        truth = DEMO | RIG | {"mu_s": 0.60 + 0.01 * (group % 5)}
        for number, (speed, duration, rate) in enumerate(LOGS):
            times = np.arange(round(duration * rate) + 1) / rate
            force = simulate(assemble(MAIN), truth, speed, 1.0, duration).sample(times)["force"]
            noise = NOISE * np.random.default_rng(4 * group + number).standard_normal(times.size)
            name = f"group_{group:02d}_{number}.csv"
            write_csv(Record(times, np.ones(times.size), force + noise), folder / name)
            lines.append(f"{name},G{group:02d},{1e3 * speed:g} mm/s,{'ABC'[group % 3]}")
    case[0].write_text("\n".join(lines) + "\n")
    return case


def measured(case: tuple[Path, Path], out: Path, workers: int, stub: bool) -> Figures:
    """Run a batch, watch it, read what it wrote."""
    since = time.perf_counter()
    process = started([case[0], "--scene", case[1], "--out", out, "--jobs", workers], stub=stub, page=False)
    seen: list[tuple[int, float]] = []  # groups that had ended, memory of the leader
    leader, work, peak = 0.0, {}, 0.0
    while process.poll() is None:
        ended = len(list(out.glob("[!.]*/job.json"))) if out.is_dir() else 0
        seen.append((ended, memory(process.pid)))
        leader = max(leader, processor(process.pid))
        for pid in children(process.pid):
            work[pid] = max(work.get(pid, 0.0), processor(pid))
            peak = max(peak, memory(pid))
        time.sleep(0.2)
    wall = time.perf_counter() - since
    _, words = process.communicate()
    if process.returncode not in (0, 3):
        raise RuntimeError(f"the batch ended with exit code {process.returncode}: {words.decode()}")
    told = [json.loads(path.read_text())["timing_s"] for path in out.glob("[!.]*/job.json")]
    groups = len(told)
    early = [m for n, m in seen if n >= groups / 10 and m] or [0.0]
    return Figures(
        workers=workers,
        wall=wall,
        fits=sum(t.get("fit", 0.0) for t in told),
        jobs=sum(t.get("total", 0.0) for t in told),
        leader=leader,
        work=sum(work.values()),
        memory=(early[0], max(early)),
        worker_memory=peak,
        build=builds(out),
    )


def builds(out: Path) -> tuple[float, float]:
    """Seconds spent on building the problem: by the first fit, and the median of all others."""
    ended = sorted(out.glob("*/result.json"), key=lambda path: path.stat().st_mtime_ns)
    told = [json.loads(path.read_text()).get("timing_s", {}).get("build", 0.0) for path in ended]
    return told[0], float(np.median(told[1:]))


def memory(pid: int) -> float:
    """Resident memory [MB]; 0 where the system does not tell."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0.0
    return sum(float(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS")) / 1024


def processor(pid: int) -> float:
    """Processor time so far [s]; 0 where the system does not tell."""
    try:
        told = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(told[11]) + int(told[12])) / TICKS


def main(fast: bool = False) -> list[Figures]:
    """Measure and print. fast: six groups and a stand-in for the fit."""
    print(describe())
    groups = 6 if fast else 50
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        case = write_case(home / "in", [f"G{i}" for i in range(groups)], 4) if fast else write_logs(home / "in", groups)
        figures = [measured(case, home / f"out_{n}", n, stub=fast) for n in (1, 2)]
        names = sorted(path.parent.name for path in (home / "out_1").glob("*/result.json"))
        same = sum(result_of(home / "out_1", name) == result_of(home / "out_2", name) for name in names)
    table(figures, groups)
    print(f"results that are the same, but for times, with one and two workers: {same} of {len(names)}")
    return figures


def table(figures: list[Figures], groups: int) -> None:
    """Print the figures beside what is asked for."""
    print(f"\n{4 * groups} logs in {groups} groups")
    rows = (
        ("wall time [s]", lambda f: f"{f.wall:.1f}"),
        ("fits, by their clocks [s]", lambda f: f"{f.fits:.1f}"),
        ("fits and reports [s]", lambda f: f"{f.jobs:.1f}"),
        (f"overhead (asked: {100 * OVERHEAD:g} %)", lambda f: f"{100 * f.overhead:.1f} %"),
        ("processor, fits and reports [s]", lambda f: f"{f.work:.1f}"),
        ("processor, leader [s]", lambda f: f"{f.leader:.1f} ({100 * f.leader / max(f.work, 1e-9):.1f} %)"),
        ("cores in use", lambda f: f"{(f.work + f.leader) / f.wall:.2f}"),
        ("building: first fit, others [ms]", lambda f: f"{1e3 * f.build[0]:.0f}, {1e3 * f.build[1]:.0f}"),
        ("memory of the leader [MB]", lambda f: f"{f.memory[0]:.0f} to {f.memory[1]:.0f}"),
        ("memory of a worker, most [MB]", lambda f: f"{f.worker_memory:.0f}"),
    )
    print(f"{'workers':<34}" + "".join(f"{f.workers:>16}" for f in figures))
    for name, said in rows:
        print(f"{name:<34}" + "".join(f"{said(f):>16}" for f in figures))
    print(f"speed-up {figures[0].wall / figures[1].wall:.2f}   asked: at least {SPEED_UP}")


if __name__ == "__main__":
    main("--fast" in sys.argv[1:])
