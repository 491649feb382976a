"""The test problem of the studies: one simulated pair at four drive speeds, and random pairs like it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data_io import Record
from identify.effects import MAIN as NAMES
from identify.model import assemble
from identify.scene import Scene
from identify.simulate import run

RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
DEMO = {"mu_s": 0.62, "mu_k0": 0.43, "delta_mu_k": -0.13, "a": 300.0, "D": 37.4e-6, "t_cr": 0.5}
NORMAL_FORCE = 1.0
NOISE = 5e-3
# Drive speed [m/s], duration [s], sampling rate [Hz].
SPEEDS = ((1e-4 / 60, 800.0, 20.0), (1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0), (5e-3, 1.5, 2000.0))


@dataclass(frozen=True)
class Case:
    """One simulated pair: true parameters, rig, the records, and how many cycles each shows in truth."""

    truth: dict[str, float]
    rig: dict[str, float]
    records: tuple[Record, ...]
    cycles: tuple[int, ...]


def simulated_case(
    truth: dict[str, float], seed: int, *, rig: dict[str, float] = RIG, noise: float = NOISE, rate: float = 1.0
) -> Case:
    """Simulate the four logs from rest, unloaded, fresh contact; white force noise; the normal force is exact.

    Args:
        noise: standard deviation [N]; rate: factor on all sampling rates.
    """
    model, random = assemble(NAMES), np.random.default_rng(seed)
    records, cycles = [], []
    for speed, duration, hertz in SPEEDS:
        motion = run(model, truth | rig, speed, NORMAL_FORCE, duration)
        times = np.arange(round(duration * hertz * rate) + 1) / (hertz * rate)
        force = motion.sample(times)["force"] + noise * random.standard_normal(times.size)
        records.append(Record(times, np.full(times.size, NORMAL_FORCE), force))
        cycles.append(int(motion.arrests.size))
    return Case(dict(truth), dict(rig), tuple(records), tuple(cycles))


def random_case(random: np.random.Generator, *, noise: float = NOISE, rate: float = 1.0) -> tuple[Case, int]:
    """A random pair of the first-row ranges; and how many draws were rejected on the way to it.

    Rejected: kinetic friction below 0.05 at speed, reverse slip (mu_s > 3 mu_k0), or fewer than two logs with
    three cycles.
    """
    rejected = 0
    while True:
        mu_s, step = random.uniform(0.4, 0.8), random.uniform(0.1, 0.25)
        truth = {"mu_s": mu_s, "mu_k0": mu_s - step, "delta_mu_k": random.uniform(-0.15, -0.02)}
        for name, low, high in (("a", 100.0, 1000.0), ("D", 15e-6, 60e-6), ("t_cr", 0.1, 2.0)):
            truth[name] = float(np.exp(random.uniform(np.log(low), np.log(high))))
        seed = int(random.integers(2**31))
        if truth["mu_k0"] + truth["delta_mu_k"] > 0.05 and mu_s <= 3 * truth["mu_k0"]:
            case = simulated_case(truth, seed, noise=noise, rate=rate)
            if sum(n >= 3 for n in case.cycles) >= 2:
                return case, rejected
        rejected += 1


def wrong_start(random: np.random.Generator, truth: dict[str, float]) -> dict[str, float]:
    """A user's start: a, D, t_cr wrong by up to a factor 3, coefficients by up to 50 %, 0 < mu_k0 < mu_s kept."""
    while True:
        start = {n: truth[n] * float(np.exp(random.uniform(-np.log(3), np.log(3)))) for n in ("a", "D", "t_cr")}
        start |= {n: truth[n] * random.uniform(0.5, 1.5) for n in ("mu_s", "mu_k0", "delta_mu_k")}
        if start["mu_k0"] < start["mu_s"] and start["mu_k0"] + start["delta_mu_k"] > 0.0:
            return start


def scene_of(case: Case, start: dict[str, float] | None = None) -> Scene:
    """The scene a user would write for the case; with the user's start where one is given."""
    document = {
        "effects": [*NAMES, "varying_normal_force"],
        "rig": dict(case.rig),
        "logs": [{"path": f"log_{i}.csv", "drive_speed": speed} for i, (speed, _, _) in enumerate(SPEEDS, 1)],
    }
    if start is not None:
        document["parameters"] = {name: {"start": value} for name, value in start.items()}
    return Scene.from_document(document, Path())


__all__ = ["DEMO", "RIG", "Case", "random_case", "scene_of", "simulated_case", "wrong_start"]
