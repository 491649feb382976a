"""Random pairs as a plate under the counterface sees them, and the same as a load cell does, each stated rightly or
wrongly. Motion and observation share no line with the package: scipy's DOP853 (`tests/support/oracle.py`), and the
friction force of the states that it gives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from experiments.study_problem import NORMAL_FORCE, SPEEDS, USUAL, Case, random_case, scene_of
from identify.scene import Scene
from tests.support import oracle

Array = NDArray[np.float64]

PLATE_SEED = 68
RTOL = 1e-10
NOISE = (1e-3, 1e-2)  # of the load
KINDS = {
    "plate": ("counterface", "counterface", None),
    "plate as cell": ("counterface", "drive", None),
    "cell as plate": ("drive", "counterface", None),
    "plate, 5 % noise": ("counterface", "counterface", 0.05),
}
"""Where the force is measured, where the scene says so, and the noise [N] where it is not drawn."""


def plate_force(motion: oracle.Oracle, times: Array, load: float) -> Array:
    """What a plate under the counterface carries [N] at times (n,): friction while the mass slides, at rest the pull of
    spring and damper."""
    law, (_, speed, gamma) = motion.law, motion.state(times)
    kinetic = law.mu_k0 + law.delta_mu_k * (1.0 - np.exp(-law.a * np.abs(speed)))
    friction = np.sign(speed) * load * (kinetic + (law.mu_s - kinetic) * gamma)
    return np.where(speed != 0.0, friction, motion.force(times))


@dataclass(frozen=True)
class Plated:
    """A pair with where its force was measured, where the scene says so, and the noise [N]."""

    case: Case
    scene: Scene
    measured: str
    stated: str
    noise: float


def plated(
    number: int, measured: str = "counterface", stated: str = "counterface", noise: float | None = None
) -> Plated:
    """The pair of a number; noise [N]: None for one drawn from NOISE."""
    random = np.random.default_rng([PLATE_SEED, number])
    case, _ = random_case(random, USUAL)
    sd = float(np.exp(random.uniform(*np.log(NOISE)))) * NORMAL_FORCE if noise is None else noise
    records = []
    for speed, duration, rate in SPEEDS:
        motion = oracle.simulate(case.truth | case.rig, speed, NORMAL_FORCE, duration, rtol=RTOL)
        times = np.arange(round(duration * rate) + 1) / rate
        force = plate_force(motion, times, NORMAL_FORCE) if measured == "counterface" else motion.force(times)
        noisy = force + sd * random.standard_normal(times.size)
        records.append(Record(times, np.full(times.size, NORMAL_FORCE), noisy))
    case = replace(case, records=tuple(records))
    document = scene_of(case).as_document()
    scene = Scene.from_document({**document, "rig": {**document["rig"], "force_sensor": stated}}, Path())
    return Plated(case, scene, measured, stated, sd)
