"""Records made with random subsets of the effects: two logs each, white noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.base.errors import SimulationError
from identify.effects import ALL, NAMES
from identify.model.model import assemble
from identify.simulation.plan import Stepping
from identify.simulation.simulate import run

SEED = 20261121
RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}
NOISE = 5e-3
LOGS = ((1e-4, 12.0, 500.0, 1.0), (1e-3, 2.5, 1000.0, 1.4))  # drive speed [m/s], duration [s], rate [Hz], load [N]
USUAL = {"hysteresis_damping": 0.85, "contact_ageing": 0.85, "velocity_weakening": 0.8}  # chance of being there
EXTRA = 0.3  # chance of each of the others
OTHERS = (
    "direct_effect",
    "load_dependence",
    "varying_normal_force",
    "occlusion",
    "excitation",
    "finger_motion",
    "skin_compliance",
    "sensor_lag",
)


def draw(number: int) -> tuple[tuple[str, ...], dict[str, float], list[Record], int]:
    """Effects, parameters and logs of one record, and how many draws were passed over (fewer than three slips)."""
    random = np.random.default_rng([SEED, number])
    passed = 0
    while True:
        chance = USUAL | dict.fromkeys(OTHERS, EXTRA)
        there = {name for name, p in chance.items() if random.uniform() < p}
        effects = tuple(name for name in NAMES if name == "inertia" or name in there)
        truth = RIG | _parameters(random)
        noise_seed = int(random.integers(2**31))
        try:
            logs = _simulated(effects, truth, noise_seed)
        except SimulationError:
            logs = None
        if logs is not None:
            return effects, truth, logs, passed
        passed += 1


def _parameters(random: np.random.Generator) -> dict[str, float]:
    def log(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    mu_s, step = random.uniform(0.4, 0.8), random.uniform(0.1, 0.25)
    defaults = {q.name: q.default for effect in ALL for q in effect.parameters}
    return defaults | {
        "mu_s": mu_s,
        "mu_k0": mu_s - step,
        "delta_mu_k": random.uniform(-0.15, -0.03),
        "a": log(100.0, 1000.0),
        "D": log(15e-6, 60e-6),
        "t_cr": log(0.1, 1.5),
        "direct_strength": log(0.002, 0.012),
        "load_exponent": random.uniform(0.1, 0.4),
        "occlusion_level": random.choice([-1, 1]) * random.uniform(0.03, 0.15),
        "occlusion_time": log(3.0, 30.0),
        "excitation_amplitude": log(0.5e-6, 3e-6),
        "excitation_frequency": random.uniform(25.0, 60.0),
        "excitation_phase": random.uniform(-3.0, 3.0),
        "breathing_amplitude": 0.0,
        "pulse_amplitude": log(2e-6, 10e-6),
        "pulse_frequency": random.uniform(0.9, 1.5),
        "pulse_phase": random.uniform(-3.0, 3.0),
        "tremor_amplitude": log(1e-6, 3e-6),
        "tremor_frequency": random.uniform(8.0, 12.0),
        "tremor_phase": random.uniform(-3.0, 3.0),
        "skin_stiffness": log(2000.0, 20000.0),
        "lag_time": log(1e-3, 5e-3),
        "load_fall": random.uniform(0.05, 0.2),
        "noise": NOISE,
    }


def _simulated(effects: Sequence[str], truth: dict[str, float], seed: int) -> list[Record] | None:
    """The logs of one record; None where one of them shows fewer than three slips or slides in the end."""
    model, random = assemble(tuple(effects)), np.random.default_rng(seed)
    values = {q.name: truth[q.name] for q in model.parameters}
    out = []
    for speed, duration, rate, load in LOGS:
        times = np.arange(round(duration * rate)) / rate
        course: NDArray[np.float64] = np.full(times.size, load)
        given: float | tuple[NDArray[np.float64], NDArray[np.float64]] = load
        if "varying_normal_force" in effects:
            # the load relaxes as that of a finger does
            nodes = np.linspace(0.0, duration, 25)
            relaxed = load * (1.0 - truth["load_fall"] * -np.expm1(-3.0 * nodes / duration))
            given, course = (nodes, relaxed), np.interp(times, nodes, relaxed)
        motion = run(model, values, speed, given, duration, accuracy=Stepping(1e-9))
        arrests = motion.arrests
        if arrests.size < 4 or arrests[-1] < duration - 2.0 * float(np.median(np.diff(arrests))):
            return None
        force = motion.sample(times)["force"] + truth["noise"] * random.standard_normal(times.size)
        out.append(Record(times, course, force))
    return out
