"""Random pairs of another kind: a rig stated wrongly, two materials on one rig, strength that scatters by the stick."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import repeat
from pathlib import Path

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from data_io import Record
from experiments.study_problem import (
    NOISE,
    NORMAL_FORCE,
    SPEEDS,
    USUAL,
    Case,
    random_case,
    scene_of,
    simulated_case,
)
from identify import Scene
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run
from tests.support import oracle

WRONG_SEED = 7
WRONG = {"mass": 1.5, "stiffness": 1.2, "lag": 5e-3}  # times the true one; of the sensor, without a word of it [s]
CAUSES: Mapping[str, tuple[str, float]] = {
    "damping": ("damping|zeta", 3.0),
    "speed": ("speed|stiffness", 1.2),
    "sign": ("sign|negative", -1.0),
    "gain": ("reads|gain", 1.15),
    "filter": ("filter|lag|average|smooth", 5.0),
}
"""What is wrong, by words that name it, and by how much: damping, drive speed and force of one log as stated over the
true ones; the corner of a low-pass filter of second order over the natural frequency."""
FINE = 20  # samples of the lagging force per sample of the log
SEED = 20261129
OWN = (("mu_s", "mu_k0"), ("D", "t_cr"), ("mu_s", "mu_k0", "D"), ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr"))
APART = 0.35  # standard deviation of the logarithm of what a material has for itself, of coefficients half as much


def wrong(kind: str, number: int, first: int = 0) -> tuple[Case, Scene, float]:
    """Case, scene as the user states it, and the true value of what it states wrongly; of the logs from this one on."""
    random = np.random.default_rng([WRONG_SEED, number])
    case, _ = random_case(random, USUAL)
    case = replace(case, records=case.records[first:])
    if kind == "lag":
        case = replace(case, records=_lagging(case, WRONG[kind], random))
        return case, _of_last(scene_of(case, None), case), WRONG[kind]
    stated = replace(case, rig=case.rig | {kind: case.rig[kind] * WRONG[kind]})
    return case, _of_last(scene_of(stated, None), case), case.rig[kind]


def misstated(kind: str, number: int) -> tuple[Scene, list[Record], dict[str, float]]:
    """Scene, logs and truth of a pair, the three fastest, with one of CAUSES."""
    random, factor = np.random.default_rng([WRONG_SEED, 1, number]), CAUSES[kind][1]
    case, _ = random_case(random, USUAL)
    records, speeds, rig = list(case.records[1:]), [speed for speed, *_ in SPEEDS[1:]], dict(case.rig)
    if kind == "damping":
        rig["damping"] *= factor
    elif kind == "speed":
        speeds = [factor * speed for speed in speeds]
    elif kind == "filter":
        corner = factor * np.sqrt(rig["stiffness"] / rig["mass"]) / (2.0 * np.pi)
        for i, (_, _, rate) in enumerate(SPEEDS[1:]):
            seen = sosfilt(butter(2, corner, fs=rate, output="sos"), records[i].friction_force)
            records[i] = replace(records[i], friction_force=seen + NOISE * random.standard_normal(seen.size))
    else:
        for i in range(len(records)) if kind == "sign" else (int(random.integers(len(records))),):
            records[i] = replace(records[i], friction_force=factor * records[i].friction_force)
    logs = [{"path": f"log_{i}.csv", "drive_speed": speed} for i, speed in enumerate(speeds, 1)]
    return Scene.from_document({"effects": list(MAIN), "rig": rig, "logs": logs}, Path()), records, case.truth


def _of_last(scene: Scene, case: Case) -> Scene:
    """The scene with the logs that the case still holds."""
    return replace(scene, logs=scene.logs[-len(case.records) :])


def _lagging(case: Case, lag: float, random: np.random.Generator) -> tuple[Record, ...]:
    """The records as a first-order sensor shows them: exact for a force that is linear between fine samples."""
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


def two_materials(number: int) -> tuple[Case, Case, tuple[str, ...]]:
    """Two pairs on one rig that share all but the parameters named; drawn anew until both stick and slip."""
    random = np.random.default_rng([SEED, number])
    first, _ = random_case(random, USUAL)
    own = OWN[number % len(OWN)]
    while True:
        factor = {n: float(np.exp(APART * random.standard_normal() * (1 if n in "aDt_cr" else 0.5))) for n in own}
        truth = {n: value * factor.get(n, 1.0) for n, value in first.truth.items()}
        slides = truth["mu_k0"] + truth["delta_mu_k"]
        if not (slides > 0.05 and truth["mu_k0"] + 0.05 < truth["mu_s"] <= 3 * truth["mu_k0"]):
            continue
        second = simulated_case(truth, int(random.integers(2**31)), rig=first.rig)
        if not second.reverses and sum(n >= 3 for n in second.cycles) >= 2:
            return first, second, own


def scene_of_both(first: Case, second: Case, own: tuple[str, ...]) -> Scene:
    """The scene of the logs of both, the parameters named per material (A, B)."""
    plain = scene_of(first, further=[speed for speed, _, _ in SPEEDS])
    logs = tuple(replace(log, labels={"material": "A" if i < len(SPEEDS) else "B"}) for i, log in enumerate(plain.logs))
    specs = {n: replace(plain.parameters[n], per="material") for n in own}
    return replace(plain, logs=logs, parameters={**plain.parameters, **specs})


def with_scatter(case: Case, speeds: Sequence[tuple[float, float, float]], scatter: float, seed: int) -> list[Record]:
    """The logs of a case, each of speed [m/s], duration [s] and sampling rate [Hz], by the integrator of the tests:
    every stick, and the slip after it, has its own mu_s' = mu_k0 + e^s (mu_s - mu_k0), s normal of so much `scatter`.
    """
    random, records = np.random.default_rng(seed), []
    for speed, duration, rate in speeds:
        times = np.arange(round(duration * rate) + 1) / rate
        strengths = (float(np.exp(scatter * random.standard_normal())) for _ in repeat(None))
        motion = oracle.simulate(case.truth | case.rig, speed, 1.0, times[-1], rtol=1e-9, strengths=strengths)
        force = motion.force(times) + NOISE * random.standard_normal(times.size)
        records.append(Record(times, np.ones(times.size), force))
    return records
