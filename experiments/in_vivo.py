"""Twins of in-vivo tests: what a finger on a specimen does to a record, simulated from a known truth.

Every twin is one person's visit: two records of less than a minute with 2 to 15 cycles each. The normal force relaxes,
carries pulse and tremor, and is measured with noise; the skin gives in series with the rig; friction drifts as the skin
moistens; the noise of the friction force has a memory; mass, stiffness and damping are not what the user believes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from data_io import Record
from identify.base.errors import SimulationError
from identify.effects import MAIN
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import run
from identify.simulation.trajectory import Trajectory

Array = NDArray[np.float64]

FRICTION = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
EFFECTS = (*MAIN, "varying_normal_force", "skin_compliance", "occlusion")
STATED = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0}  # what the user believes
TOLERANCE = 0.10  # one standard deviation of the truth about it
BELIEVED = {"skin_stiffness": (4400.0, 0.3), "occlusion_time": (30.0, 0.4)}  # mean, relative standard deviation
RATES = (50.0, 100.0, 500.0, 1000.0)  # [Hz]
FORCE_NOISE, LOAD_NOISE = 5e-3, 5e-3  # [N], standard deviation of either force, and at least so much of the load:
RELATIVE_NOISE = 2.5e-3
MEMORY = 4e-3  # [s]: correlation time of the noise of the friction force
COURSE = 100.0  # [Hz]: knots of the true normal force; the fastest tremor has 12 Hz
# Longest duration [s] and cycles asked for of each record.
RECORDS = ((10.0, (7, 14)), (45.0, (3, 8)))
FEWEST, MOST = 2, 15  # cycles of a record
SEED = 31
ACCURACY = 1e-5


@dataclass(frozen=True)
class Twin:
    """A visit: true parameters by name (rig and skin too), and of each record drive speed [m/s], duration [s], motion
    and the course of the true normal force."""

    number: int
    truth: dict[str, float]
    speeds: tuple[float, ...]
    durations: tuple[float, ...]
    motions: tuple[Trajectory, ...]
    courses: tuple[tuple[Array, Array], ...]

    def records(self, rate: float) -> tuple[Record, ...]:
        """The records at a sampling rate [Hz], with noise."""
        random = np.random.default_rng([SEED, self.number, round(rate)])
        out = []
        for duration, motion, course in zip(self.durations, self.motions, self.courses, strict=True):
            times = np.arange(int(duration * rate) + 1) / rate
            load = np.interp(times, *course)
            noise = _noise(random, times.size, rate) * noise_of(FORCE_NOISE, course)
            force = np.asarray(motion.sample(times)["force"]) + noise
            seen = load + noise_of(LOAD_NOISE, course) * random.standard_normal(times.size)
            out.append(Record(times, seen, force))
        return tuple(out)

    def scene(self) -> Scene:
        """What a careful user would write: measured load, skin and drift among the effects, the rig to 10 %, the skin
        to 30 % and the time in which it moistens to 40 %."""
        rig = {name: {"value": value, "tolerance": TOLERANCE} for name, value in STATED.items()}
        logs = [{"path": f"log_{i}.csv", "drive_speed": speed} for i, speed in enumerate(self.speeds, 1)]
        parameters = {name: {"prior": {"mean": mean, "sd": sd * mean}} for name, (mean, sd) in BELIEVED.items()}
        document = {"effects": list(EFFECTS), "rig": rig, "parameters": parameters, "logs": logs}
        return Scene.from_document(document, Path())


def noise_of(least: float, course: tuple[Array, Array]) -> float:
    """Standard deviation of the noise [N] at a load."""
    return max(least, RELATIVE_NOISE * float(course[1][0]))


def _noise(random: np.random.Generator, count: int, rate: float) -> Array:
    """Noise with a memory of unit variance (n,): the same process at every sampling rate."""
    kept = float(np.exp(-1.0 / (rate * MEMORY)))
    new = random.standard_normal(count + 200) * np.sqrt(1.0 - kept**2)
    return np.asarray(lfilter([1.0], [1.0, -kept], new)[200:])


def _pair(random: np.random.Generator) -> dict[str, float]:
    mu_s, step = random.uniform(0.4, 0.8), random.uniform(0.1, 0.25)
    truth = {"mu_s": mu_s, "mu_k0": mu_s - step, "delta_mu_k": random.uniform(-0.15, -0.02)}
    for name, (low, high) in (("a", (100.0, 1000.0)), ("D", (15e-6, 60e-6)), ("t_cr", (0.5, 20.0))):
        truth[name] = float(np.exp(random.uniform(np.log(low), np.log(high))))
    truth |= {name: value * float(np.exp(TOLERANCE * random.standard_normal())) for name, value in STATED.items()}
    for name, (mean, sd) in BELIEVED.items():
        truth[name] = mean * float(np.exp(sd * random.standard_normal()))
    truth["skin_retardation"] = 2e-3
    truth["occlusion_level"] = float(random.choice([-1.0, 1.0]) * random.uniform(0.02, 0.08))
    truth["occlusion_hastening"] = 0.0
    return truth


def _course(random: np.random.Generator, load: float, duration: float) -> tuple[Array, Array]:
    """A normal force that relaxes within a minute, with pulse and tremor."""
    times = np.arange(round(duration * COURSE) + 2) / COURSE
    fall, pace = random.uniform(0.10, 0.30), random.uniform(5.0, 30.0)
    relaxed = 1.0 - fall * (1.0 - np.exp(-times / pace)) / (1.0 - np.exp(-60.0 / pace))
    pulse, beat = random.uniform(0.01, 0.02), random.uniform(0.9, 1.4)
    phase = random.uniform(0.0, 2 * np.pi, 2)
    wave = np.sin(2 * np.pi * beat * times + phase[0]) + 0.4 * np.sin(4 * np.pi * beat * times + phase[1])
    lines = random.uniform(8.0, 12.0, 4)
    tremor = sum(np.sin(2 * np.pi * f * times + random.uniform(0.0, 2 * np.pi)) for f in lines) / np.sqrt(lines.size)
    return times, load * relaxed * (1.0 + pulse / 1.16 * wave + 0.005 * tremor)


@lru_cache(maxsize=4)
def twin(number: int) -> Twin:
    """The twin of a number; pairs whose records do not show 2 to 15 cycles each, or slip backwards, are drawn again."""
    random, model = np.random.default_rng([SEED, number]), assemble(EFFECTS)
    while True:
        truth, load = _pair(random), random.uniform(0.7, 3.0)
        speeds, durations, motions, courses = [], [], [], []
        for duration, (few, many) in RECORDS:
            softness = 1.0 / truth["stiffness"] + 1.0 / truth["skin_stiffness"]
            drop = 1.6 * (truth["mu_s"] - truth["mu_k0"])
            reach = (truth["mu_s"] + float(random.uniform(few, many)) * drop) * load * softness
            speed = reach / duration
            course = _course(random, load, duration)
            speeds.append(speed)
            durations.append(duration)
            courses.append(course)
        sound = truth["mu_k0"] + truth["delta_mu_k"] > 0.05 and truth["mu_s"] <= 3.0 * truth["mu_k0"]
        for speed, duration, course in zip(speeds, durations, courses, strict=True) if sound else ():
            try:
                motion = run(model, truth, speed, course, duration, accuracy=ACCURACY)
            except SimulationError:
                break
            if not FEWEST <= motion.arrests.size <= MOST or any(p.situated.direction < 0.0 for p in motion.phases):
                break
            motions.append(motion)
        if len(motions) == len(RECORDS):
            return Twin(number, truth, tuple(speeds), tuple(durations), tuple(motions), tuple(courses))
