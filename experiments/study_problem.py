"""The test problem of the studies: one simulated pair at four drive speeds, and random pairs like it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data_io import Record
from identify.effects import MAIN as NAMES
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory

RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
DEMO = {"mu_s": 0.62, "mu_k0": 0.43, "delta_mu_k": -0.13, "a": 300.0, "D": 37.4e-6, "t_cr": 0.5}
NORMAL_FORCE = 1.0
NOISE = 5e-3
SEED = 4  # of the random pairs
# Drive speed [m/s], duration [s], sampling rate [Hz].
SPEEDS = ((1e-4 / 60, 800.0, 20.0), (1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0), (5e-3, 1.5, 2000.0))
KNOWN = ("a", "D", "t_cr")  # where only the coefficients are searched
FIFTH = (2e-2, 1.0, 4000.0)  # a faster log: where the others leave `a` open, this is about the one a fit asks for


@dataclass(frozen=True)
class Case:
    """One simulated pair: true parameters, rig, the records, how many cycles each shows in truth, and whether the mass
    ever slips backwards."""

    truth: dict[str, float]
    rig: dict[str, float]
    records: tuple[Record, ...]
    cycles: tuple[int, ...]
    reverses: bool


def simulated_case(
    truth: dict[str, float], seed: int, *, rig: dict[str, float] = RIG, noise: float = NOISE, rate: float = 1.0
) -> Case:
    """Simulate the four logs from rest, unloaded, fresh contact; white force noise; the normal force is exact.

    Args:
        noise: standard deviation [N]; rate: factor on all sampling rates.
    """
    random = np.random.default_rng(seed)
    records, cycles, reverses = [], [], False
    for log in SPEEDS:
        record, motion = _simulated(truth | rig, log, random, noise, rate)
        records.append(record)
        cycles.append(int(motion.arrests.size))
        reverses |= any(phase.situated.direction < 0.0 for phase in motion.phases)
    return Case(dict(truth), dict(rig), tuple(records), tuple(cycles), reverses)


def _simulated(
    values: dict[str, float], log: tuple[float, float, float], random: np.random.Generator, noise: float, rate: float
) -> tuple[Record, Trajectory]:
    """One log of speed [m/s], duration [s] and sampling rate [Hz], and the motion behind it."""
    speed, duration, hertz = log
    motion = run(assemble(NAMES), values, speed, NORMAL_FORCE, duration)
    return recorded(motion, hertz * rate, random, noise), motion


def recorded(
    motion: Trajectory, rate: float, random: np.random.Generator, noise: float = NOISE, load: float = NORMAL_FORCE
) -> Record:
    """A motion under a constant load [N], sampled at a rate [Hz] with white noise [N] of its force."""
    times = np.arange(round(motion.duration * rate) + 1) / rate
    force = motion.sample(times)["force"] + noise * random.standard_normal(times.size)
    return Record(times, np.full(times.size, load), force)


@dataclass(frozen=True)
class Ranges:
    """Random pairs: uniform mu_s, mu_s - mu_k0 and delta_mu_k; log-uniform a [s/m], D [m] and t_cr [s],
    and factors on mass, stiffness and damping up to `rig` in either direction."""

    name: str
    mu_s: tuple[float, float]
    step: tuple[float, float]
    delta_mu_k: tuple[float, float]
    a: tuple[float, float]
    D: tuple[float, float]
    t_cr: tuple[float, float]
    rig: float


USUAL = Ranges("usual", (0.4, 0.8), (0.1, 0.25), (-0.15, -0.02), (100.0, 1000.0), (15e-6, 60e-6), (0.1, 2.0), 1.5)
WIDE = Ranges("wide", (0.2, 1.0), (0.05, 0.4), (-0.15, -0.02), (40.0, 2500.0), (6e-6, 120e-6), (0.03, 6.0), 2.0)


def random_case(
    random: np.random.Generator, ranges: Ranges, *, noise: float = NOISE, rate: float = 1.0
) -> tuple[Case, int]:
    """A random pair on a random rig; and how many draws were rejected on the way to it.

    Rejected: kinetic friction below 0.05 at speed, reverse slip (mu_s > 3 mu_k0, or seen in the simulation), or fewer
    than two logs with three cycles.
    """
    rejected = 0
    while True:
        mu_s, step = random.uniform(*ranges.mu_s), random.uniform(*ranges.step)
        truth = {"mu_s": mu_s, "mu_k0": mu_s - step, "delta_mu_k": random.uniform(*ranges.delta_mu_k)}
        for name, (low, high) in (("a", ranges.a), ("D", ranges.D), ("t_cr", ranges.t_cr)):
            truth[name] = float(np.exp(random.uniform(np.log(low), np.log(high))))
        rig = {name: value * ranges.rig ** random.uniform(-1.0, 1.0) for name, value in RIG.items()}
        seed = int(random.integers(2**31))
        if truth["mu_k0"] > 0.0 and truth["mu_k0"] + truth["delta_mu_k"] > 0.05 and mu_s <= 3 * truth["mu_k0"]:
            case = simulated_case(truth, seed, rig=rig, noise=noise, rate=rate)
            if not case.reverses and sum(n >= 3 for n in case.cycles) >= 2:
                return case, rejected
        rejected += 1


def with_fifth(case: Case, seed: int, *, noise: float = NOISE, rate: float = 1.0) -> Case:
    """The case with the log of FIFTH as well, whatever it shows."""
    record, motion = _simulated(case.truth | case.rig, FIFTH, np.random.default_rng([5, seed]), noise, rate)
    return replace(case, records=(*case.records, record), cycles=(*case.cycles, int(motion.arrests.size)))


def recovery_case(ranges: str, number: int, noise: float = 1.0, rate: float = 1.0) -> Case:
    """The pair of a number: of the "usual" or "wide" ranges, or "wide, five logs", with one faster log more; factors on
    noise and sampling rate."""
    drawn = USUAL if ranges == USUAL.name else WIDE
    case, _ = random_case(np.random.default_rng([SEED, number]), drawn, noise=noise * NOISE, rate=rate)
    return with_fifth(case, number, noise=noise * NOISE, rate=rate) if "five" in ranges else case


def scene_of(case: Case, start: dict[str, float] | None = None, further: Sequence[float] = ()) -> Scene:
    """The scene a user would write for the case; with the user's start where one is given, and with further logs, whose
    drive speeds [m/s] are given."""
    document = {
        "effects": [*NAMES, "varying_normal_force"],
        "rig": dict(case.rig),
        "logs": [
            {"path": f"log_{i}.csv", "drive_speed": speed}
            for i, speed in enumerate([*(speed for speed, _, _ in SPEEDS), *further], 1)
        ],
    }
    if start is not None:
        document["parameters"] = {name: {"start": value} for name, value in start.items()}
    return Scene.from_document(document, Path())


def coefficients_only(scene: Scene, truth: Mapping[str, float]) -> Scene:
    """The scene in which all is known of friction but its coefficients: what the fast form of a study fits."""
    as_told = {"start": None, "prior_mean": None, "prior_sd": None, "stated": True}
    known = {name: replace(scene.parameters[name], fixed=truth[name], **as_told) for name in KNOWN}
    return replace(scene, parameters={**scene.parameters, **known})
