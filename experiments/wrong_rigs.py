"""Random pairs under a scene that states one quantity of the rig wrongly: mass, stiffness, or a lag of the sensor.

A mass 1.5 times, or a stiffness 1.2 times the true one, or a force sensor that lags by 5 ms without a word of it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from data_io import Record
from experiments.study_problem import NOISE, NORMAL_FORCE, SPEEDS, USUAL, Case, random_case, scene_of
from identify import Scene
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run

SEED = 7
KINDS = {"mass": 1.5, "stiffness": 1.2, "lag": 5e-3}
FINE = 20  # samples of the lagging force per sample of the log


def wrong(kind: str, number: int, first: int = 0) -> tuple[Case, Scene, float]:
    """Case, scene as the user states it, and the true value of what it states wrongly; of the logs from this one on."""
    random = np.random.default_rng([SEED, number])
    case, _ = random_case(random, USUAL)
    case = replace(case, records=case.records[first:])
    if kind == "lag":
        case = replace(case, records=_lagging(case, KINDS[kind], random))
        return case, _of_last(scene_of(case, None), case), KINDS[kind]
    stated = replace(case, rig=case.rig | {kind: case.rig[kind] * KINDS[kind]})
    return case, _of_last(scene_of(stated, None), case), case.rig[kind]


def _of_last(scene: Scene, case: Case) -> Scene:
    """The scene with the logs that the case still holds."""
    return replace(scene, logs=scene.logs[-len(case.records) :])


def _lagging(case: Case, lag: float, random: np.random.Generator) -> tuple[Record, ...]:
    """The records as a first-order sensor shows them: exact for a force that is linear between fine samples."""
    from scipy.signal import lfilter

    out = []
    for (speed, duration, rate), record in zip(SPEEDS[-len(case.records) :], case.records, strict=True):
        fine = FINE * rate * max(1.0, round(1.0 / (rate * lag)))
        step = 1.0 / fine
        motion = run(assemble(MAIN), case.truth | case.rig, speed, NORMAL_FORCE, duration)
        force = motion.sample(np.arange(round(duration * fine) + 1) * step)["force"]
        decay = np.exp(-step / lag)
        ramp = lag * (1.0 - decay) / step
        shown = lfilter([1.0 - ramp, ramp - decay], [1.0, -decay], force)[:: round(fine / rate)]
        noisy = shown[: record.time.size] + NOISE * random.standard_normal(record.time.size)
        out.append(Record(record.time, record.normal_force, noisy))
    return tuple(out)
