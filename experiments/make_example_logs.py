"""Writes the example logs that ship inside the package: one simulated pair, in the layout of a CETR text export.

Run `python experiments/make_example_logs.py` to write them anew; the same versions give the same bytes.
Truth, noise and seed are written down beside them, in truth.json.
"""

from __future__ import annotations

import gzip
import json
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from data_io.atomic import atomic_write
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run

Array = NDArray[np.float64]

FOLDER = Path(__file__).resolve().parent.parent / "identify" / "examples"
FRICTION = {"mu_s": 0.62, "mu_k0": 0.43, "delta_mu_k": -0.13, "a": 300.0, "D": 37.4e-6, "t_cr": 0.5}
RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
NORMAL_FORCE = 1.0  # [N] at the start
RELAXATION = 0.1  # share of the normal force lost in the long run: a finger pressed to a fixed displacement
RIPPLE = 0.003  # [N], slow and real: the contact feels it
FORCE_NOISE, NORMAL_NOISE = 5e-3, 1e-3  # [N], standard deviation, white
SEED = 20260115
LEVEL_SHARE = 0.1  # of an uneven track: standard deviation of its level, of the scatter of the strength
TRACK = {"field_length": 1e-3, "loading_sd": 0.0, "field_seed": 1.0}  # [m], and which track
GRAM_FORCE = 9.80665e-3  # [N]
FIRST_INTERVAL = 0.635  # the first sampling interval of such a log is short
STARTED = datetime(2026, 1, 15, 10, 0, 0)
TOP = """\
Created by CETR UMT layout imitated by experiments/make_example_logs.py: simulated, not measured
Total number of runs - 1
Total number of steps = {count}
Indenter tip ID = 0

Run # 1
Script file make_example_logs.py
Run date {date}
"""
STEP = """\
Step No. {number}

Step Type Code: 0
Velocity     = {speed:.6g}
Set Force    = {load:.4g}
Duration     = {duration:.6g}
Data Count   = {count}
Started at: {started}

Fx,Fz,Y,V2,T,Ff,COF
g,g,mm,mm/sec,sec,g,

"""
ROW = "{:.4f},{:.4f},{:.6f},{:.6f},{:.6f},{:.4f},{:.6f}\n"


@dataclass(frozen=True)
class Test:
    """One log: drive speed [m/s], duration [s], rate [Hz], a hold at rest before it [s], direction of Fx; scatter of
    the strength from stick to stick (of its logarithm), on a track whose level wanders."""

    name: str
    speed: float
    duration: float
    rate: float
    hold: float = 0.0
    sign: int = 1
    scatter: float = 0.0


TESTS = (
    Test("0.1_mm_per_min.txt.gz", 1e-4 / 60, 800.0, 20.0),
    Test("0.1_mm_per_s.txt.gz", 1e-4, 20.0, 500.0),
    Test("1_mm_per_s.txt.gz", 1e-3, 4.0, 1000.0, hold=2.0),
    Test("5_mm_per_s.txt.gz", 5e-3, 1.5, 2000.0, sign=-1),
    Test("0.1_mm_per_s_at_50_Hz.txt.gz", 1e-4, 20.0, 50.0),
    Test("0.5_mm_per_s_uneven.txt.gz", 5e-4, 24.0, 500.0, scatter=0.2),
)


def clock(duration: float, rate: float) -> Array:
    """Sample times [s] of one step, from 0, the first interval short."""
    times = np.arange(round(duration * rate) + 1) / rate
    times[1:] -= (1.0 - FIRST_INTERVAL) / rate
    return np.round(times, 6)


def steps(test: Test) -> list[Array]:
    """Simulate one test and record it; one table per step of the machine (the hold, then the sliding), with the columns
    of STEP."""
    random = np.random.default_rng([SEED, TESTS.index(test)])
    end = test.hold + test.duration
    grid = np.linspace(0.0, end, 241)
    normal = NORMAL_FORCE * (1.0 - RELAXATION * -np.expm1(-2.0 * grid / end))
    normal += RIPPLE * np.sin(2.0 * np.pi * 7.3 * grid / end)
    drive = ((0.0, 0.0), (test.hold, test.speed)) if test.hold else test.speed
    effects = (*MAIN, "friction_heterogeneity") if test.scatter else MAIN
    track = TRACK | {"strength_sd": test.scatter, "field_sd": LEVEL_SHARE * test.scatter} if test.scatter else {}
    motion = run(assemble(effects), FRICTION | RIG | track, drive, (grid, normal), end)
    made = []
    for start, duration, speed in ((0.0, test.hold, 0.0), (test.hold, test.duration, test.speed)):
        if duration:
            time = clock(duration, test.rate)
            force = motion.sample(start + time)["force"] + random.normal(0.0, FORCE_NOISE, time.size)
            pressed = np.interp(start + time, grid, normal) + random.normal(0.0, NORMAL_NOISE, time.size)
            fx, fz = test.sign * force / GRAM_FORCE, -pressed / GRAM_FORCE
            y, v = test.sign * speed * time, np.full(time.size, test.sign * speed)
            made.append(np.column_stack([fx, fz, 1e3 * y, 1e3 * v, time, fx, abs(fx / fz)]))
    return made


def write(test: Test, tables: list[Array], folder: Path) -> Path:
    """Write one log, gz-compressed, with CRLF line ends."""
    text, started = TOP.format(count=len(tables), date=f"{STARTED:%d %b %Y %H:%M:%S}"), STARTED
    for number, table in enumerate(tables, 1):
        clock_time = f"{started:%H:%M:%S}.{started.microsecond // 1000:03d} {started:%d %b %Y}"
        text += STEP.format(
            number=number, speed=table[0, 3], load=-NORMAL_FORCE / GRAM_FORCE, duration=table[-1, 4],
            count=len(table), started=clock_time,
        )  # fmt: skip
        text += "".join(ROW.format(*row) for row in table.tolist()) + "\n\n"
        started += timedelta(seconds=float(table[-1, 4]) + 1.0 / test.rate)
    content = gzip.compress(text.replace("\n", "\r\n").encode("ascii"), compresslevel=9, mtime=0)
    with atomic_write(folder / test.name, "wb") as handle:
        handle.write(content)
    return folder / test.name


def truth(tests: tuple[Test, ...]) -> dict[str, object]:
    """All that went into the logs."""
    load = {"start_N": NORMAL_FORCE, "relaxation": RELAXATION, "ripple_N": RIPPLE, "noise_N": NORMAL_NOISE}
    logs = {
        test.name: {"drive_speed": test.speed, "duration_s": test.duration, "rate_Hz": test.rate, "hold_s": test.hold,
                    "strength_scatter": test.scatter}
        for test in tests
    }  # fmt: skip
    made_by = "experiments/make_example_logs.py"
    return {"made_by": made_by, "parameters": FRICTION, "rig": RIG, "normal_force": load,
            "force_noise_N": FORCE_NOISE, "seed": SEED, "logs": logs}  # fmt: skip


def main(fast: bool = False, folder: Path | None = None) -> None:
    """Write the logs and truth.json into the package, or into another folder.

    fast: only the shortest log, into a folder that is thrown away; for the tests.
    """
    if fast and folder is None:
        with TemporaryDirectory() as scratch:
            main(fast, Path(scratch))
        return
    folder = folder or FOLDER
    tests = tuple(test for test in TESTS if not fast or test.duration < 2.0)
    for test in tests:
        path = write(test, steps(test), folder)
        print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB")
    with atomic_write(folder / "truth.json") as handle:
        handle.write(json.dumps(truth(tests), indent=2) + "\n")


if __name__ == "__main__":
    main()
