"""Every kind of record a lab makes, simulated: sliding, a peak and sliding, holds, speed steps, strokes, gaps.

The truth is known, and each kind has a wrong twin: the same records under a scene that says something false of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from experiments.study_problem import DEMO, NORMAL_FORCE, RIG, USUAL, recorded
from identify import Scene
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run

Array = NDArray[np.float64]
Programme = float | tuple[tuple[float, float], ...]

STIFF = {"mass": 0.05, "stiffness": 20000.0, "damping": 4000.0}  # slides at 1 mm/s where RIG sticks and slips
MILD = DEMO | {"delta_mu_k": -0.05, "a": 100.0}


@dataclass(frozen=True)
class Log:
    """One record: drive speed [m/s] or programme, duration [s], rate [Hz], where it begins [s], gamma at the start; and
    what the scene says of it: drive (None: as it is), further entries."""

    drive: Programme
    duration: float
    rate: float
    begins: float = 0.0
    gamma: float = 0.0
    said: Programme | None = None
    more: Mapping[str, Any] = field(default_factory=dict)

    def record(self, truth: Mapping[str, float], random: np.random.Generator) -> Record:
        """The record with its noise."""
        motion = run(assemble(MAIN), dict(truth), self.drive, NORMAL_FORCE, self.duration, start={"gamma": self.gamma})
        whole = recorded(motion, self.rate, random)
        kept = whole.time >= self.begins
        return Record(whole.time[kept] - self.begins, whole.normal_force[kept], whole.friction_force[kept])

    def entry(self, number: int) -> dict[str, Any]:
        """What the scene says of it."""
        drive = self.drive if self.said is None else self.said
        said = [list(pair) for pair in drive] if isinstance(drive, tuple) else drive
        return {"path": f"log_{number}.csv", "drive_speed": said, **self.more}


@dataclass(frozen=True)
class Kind:
    """A kind of record: its name in the table, its logs, the pair and rig, and the logs as the wrong twin has them."""

    name: str
    logs: tuple[Log, ...]
    wrong: tuple[Log, ...]
    pair: Mapping[str, float] = field(default_factory=lambda: DEMO)
    rig: Mapping[str, float] = field(default_factory=lambda: RIG)

    def made(self, seed: int, *, wrong: bool = False) -> tuple[Scene, list[Record]]:
        """The scene and its records."""
        random = np.random.default_rng(seed)
        logs = self.wrong if wrong else self.logs
        records = [log.record({**self.pair, **self.rig}, random) for log in logs]
        document = {
            "effects": [*MAIN, "varying_normal_force"],
            "rig": dict(self.rig),
            "logs": [log.entry(i) for i, log in enumerate(logs, 1)],
        }
        return Scene.from_document(document, Path()), records


def _faster(log: Log) -> Log:
    """The log as a scene has it that states a tenth more speed."""
    assert isinstance(log.drive, tuple)
    return replace(log, said=tuple((t, 1.1 * v) for t, v in log.drive))


SLOW, FAST = Log(1e-3, 4.0, 1000.0), Log(5e-3, 1.5, 2000.0)
SLIDING = Log(5e-2, 4.0, 2000.0, begins=2.5)
PEAK = Log(5e-2, 3.0, 2000.0)
FEW = Log(3e-2, 3.0, 2000.0, gamma=1.0)
STEPS = Log(((0.0, 1e-3), (2.0, 5e-3), (3.0, 2e-3)), 5.0, 1000.0)
UP = Log(((0.0, 5e-3), (1.0, 5e-2), (4.0, 5e-3)), 5.0, 2000.0)
HOLDS = Log(((0.0, 1e-3), (2.03, 0.0), (3.0, 1e-3), (4.01, 0.0), (4.3, 1e-3)), 6.0, 1000.0)
HOLDS_WRONG = ((0.0, 1e-3), (2.03, 0.0), (2.7, 1e-3), (4.01, 0.0), (4.3, 1e-3))
SLIDE_HOLD_SLIDE = Log(
    (
        *((0.0, 1e-3), (1.0, 0.0), (1.1, 1e-3), (2.0, 0.0), (2.3, 1e-3), (3.0, 0.0), (4.0, 1e-3), (5.0, 0.0)),
        *((8.0, 1e-3), (9.0, 1e-2), (9.5, 1e-3)),
    ),
    10.0,
    1000.0,
)
STROKES = Log(((0.0, 1e-3), (2.0, 0.0), (2.5, -5e-3), (3.5, 0.0), (4.0, 1e-3), (6.0, -5e-3)), 7.0, 1000.0)
MISSED = replace(SLOW, more={"exclude": [[1.56, 1.66]]})

KINDS = (
    Kind("two speeds, and sliding", (SLOW, FAST, SLIDING), (SLOW, FAST, replace(SLIDING, said=5e-3))),
    Kind("two speeds, and a peak before sliding", (SLOW, FAST, PEAK), (SLOW, FAST, replace(PEAK, said=4e-2))),
    Kind("two speeds, and few slips before sliding", (SLOW, FAST, FEW), (SLOW, FAST, replace(FEW, said=2.4e-2))),
    Kind("speed steps", (STEPS,), (replace(STEPS, said=((0.0, 1e-3), (2.0, 5e-3), (3.0, 2.2e-3))),)),
    Kind("steps up to sliding and down", (UP,), (replace(UP, said=((0.0, 5e-3), (1.0, 4e-2), (4.0, 5e-3))),)),
    Kind("holds between sticks and slips", (HOLDS,), (replace(HOLDS, said=HOLDS_WRONG),)),
    Kind("slide, hold, slide", (SLIDE_HOLD_SLIDE,), (_faster(SLIDE_HOLD_SLIDE),), MILD, STIFF),
    Kind("strokes with rests", (STROKES,), (_faster(STROKES),)),
    Kind("a slip excluded", (MISSED, FAST), (replace(MISSED, said=1.1e-3), FAST)),
)

HELD = (1.0, 10.0, 100.0, 1000.0)  # [s] that the drive stands


def slide_hold_slide(number: int) -> tuple[Scene, Record, dict[str, float]]:
    """A random pair that slides (even numbers) or sticks and slips, held for a second to a quarter of an hour in random
    order; its drive speed stands in a column only."""
    random, slips = np.random.default_rng([68, number]), bool(number % 2)
    ranges = {"a": USUAL.a if slips else (40.0, 100.0), "D": USUAL.D, "t_cr": (0.3, 5.0) if slips else (2.0, 300.0)}
    truth = {"mu_s": 1.0, "mu_k0": 0.0, "delta_mu_k": 0.0}
    while truth["mu_s"] > 3.0 * truth["mu_k0"] or truth["mu_k0"] + truth["delta_mu_k"] <= 0.05:
        mu_s, step = random.uniform(*USUAL.mu_s), random.uniform(*USUAL.step)
        truth = {"mu_s": mu_s, "mu_k0": mu_s - step}
        truth["delta_mu_k"] = random.uniform(*(USUAL.delta_mu_k if slips else (-0.05, -0.02)))
        truth |= {name: float(np.exp(random.uniform(*np.log(ends)))) for name, ends in ranges.items()}
    rig, slide, rate = (RIG, 2.0, 200.0) if slips else (STIFF, 1.0, 400.0)
    start, programme = 0.0, []
    for hold in random.permutation(HELD).tolist():
        programme += [(start, 1e-3), (start + slide, 0.0)]
        start += slide + hold
    programme.append((start, 1e-3))
    motion = run(assemble(MAIN), truth | rig, tuple(programme), NORMAL_FORCE, start + slide)
    record, (starts, speeds) = recorded(motion, rate, random), np.transpose(programme)
    drive = speeds[np.searchsorted(starts, record.time, side="right") - 1]
    document = {"effects": [*MAIN, "varying_normal_force"], "rig": dict(rig), "logs": [{"path": "holds.csv"}]}
    held = Record(record.time, record.normal_force, record.friction_force, drive_speed=drive)
    return Scene.from_document(document, Path()), held, truth
