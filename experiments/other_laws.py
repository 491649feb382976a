"""Stick-slip by laws of friction that the package does not hold, with scipy's Radau: what a fit may say of them is that
its own law does not describe them.

LuGre: Canudas de Wit et al. 1995. Rate and state with the ageing law, regularised by the inverse hyperbolic sine: Rice
et al. 2001. The load is 1 N.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from data_io import Record
from experiments.study_problem import RIG
from identify import Scene
from identify.effects import MAIN

Array = NDArray[np.float64]
Law = Callable[[float, float], tuple[float, float]]
LAW_SEED = 64
SPEEDS = ((1e-4, 20.0, 500.0), (1e-3, 4.0, 1000.0), (5e-3, 1.5, 2000.0))  # m/s, s, Hz
NOISE = 5e-3
REFERENCE = 1e-6  # m/s


def lugre(random: np.random.Generator) -> Law:
    """Bristles of stiffness sigma with a Stribeck curve: friction and the rate of their deflection, by speed."""
    coulomb, more = random.uniform(0.3, 0.5), random.uniform(0.1, 0.25)
    stribeck, sigma = np.exp(random.uniform(*np.log((1e-3, 1e-2)))), np.exp(random.uniform(*np.log((2e4, 2e5))))
    damping, viscous = 0.3 * np.sqrt(sigma), random.uniform(0.0, 0.5)

    def law(v: float, z: float) -> tuple[float, float]:
        fast = np.exp(-((v / stribeck) ** 2))
        rate = v - sigma * abs(v) / (coulomb + more * fast) * z
        return sigma * z + damping * fast * rate + viscous * v, rate

    return law


def rate_and_state(random: np.random.Generator) -> Law:
    """Direct effect a, evolution effect b > a over a distance d, by the logarithm of the state."""
    base, a = random.uniform(0.4, 0.6), random.uniform(0.004, 0.01)
    b, d = a + random.uniform(0.015, 0.03), np.exp(random.uniform(*np.log((2e-6, 1e-5))))

    def law(v: float, z: float) -> tuple[float, float]:
        grown = (base + b * (z + np.log(REFERENCE / d))) / a
        return a * np.arcsinh(0.5 * v / REFERENCE * np.exp(grown)), np.exp(-z) - v / d

    return law


LAWS: Mapping[str, tuple[Callable[[np.random.Generator], Law], bool]] = {
    "LuGre": (lugre, False), "rate and state": (rate_and_state, True),
}  # fmt: skip
"""The law, and whether its speed, which then never is zero and spans twenty decades, is followed by its logarithm."""


def slid(law: Law, rig: Mapping[str, float], speed: float, times: Array, *, logarithmic: bool) -> Array:
    """Force of the load cell [N] at times [s] of a body that a spring pulls; NaN where Radau finds no next step."""
    k, m = rig["stiffness"], rig["mass"]
    c, begin = rig["damping"] * np.sqrt(m / k), 1e-2 * speed

    def rates(_t: float, y: Array) -> Sequence[float]:
        v = np.exp(y[1]) if logarithmic else y[1]
        friction, rate = law(v, y[2])
        return speed - v, (k * y[0] + c * (speed - v) - friction) / (m * v if logarithmic else m), rate

    start = (law(begin, 0.0)[0] / k, np.log(begin), 0.0) if logarithmic else (0.0, 0.0, 0.0)
    tight = (1e-11, 1e-6, 1e-8) if logarithmic else (1e-11, 1e-10, 1e-11)
    run = solve_ivp(rates, (0.0, times[-1]), start, "Radau", times, rtol=1e-6, atol=tight)
    if not run.success:
        return np.full(times.size, np.nan)
    v = np.exp(run.y[1]) if logarithmic else run.y[1]
    return np.asarray(k * run.y[0] + c * (speed - v))


def of_law(name: str, number: int) -> tuple[Scene, list[Record]]:
    """Scene and logs of a law; drawn anew until at least two logs swing by eight times the noise."""
    random = np.random.default_rng([LAW_SEED, number])
    make, logarithmic = LAWS[name]
    while True:
        rig = {key: value * 1.5 ** random.uniform(-1.0, 1.0) for key, value in RIG.items()}
        law, records, logs = make(random), list[Record](), list[dict[str, object]]()
        for speed, duration, rate in SPEEDS:
            times = np.arange(round(duration * rate) + 1) / rate
            force = slid(law, rig, speed, times, logarithmic=logarithmic)
            if not np.ptp(force[times.size // 2 :]) > 8.0 * NOISE:
                continue
            records.append(Record(times, np.ones(times.size), force + NOISE * random.standard_normal(times.size)))
            logs.append({"path": f"log_{len(records)}.csv", "drive_speed": speed})
        if len(records) >= 2:
            return Scene.from_document({"effects": list(MAIN), "rig": rig, "logs": logs}, Path()), records
