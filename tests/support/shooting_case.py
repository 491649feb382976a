"""Small noise-free or noisy logs of one pair with known motion, in the form the estimator's rooms take."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from experiments.study_problem import DEMO as PAIR
from experiments.study_problem import NOISE, RIG
from identify.effects import MAIN
from identify.logs.log_data import LogData
from identify.logs.unknowns import Unknowns
from identify.model.model import RIG_PARAMETERS, Model, assemble
from identify.shooting.layout import Grid
from identify.shooting.placing import place
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.simulation.drive import NormalForce
from tests.support import oracle

Array = NDArray[np.float64]

LOAD = 1.0
MODEL = assemble(MAIN)
# drive speed [m/s], duration [s], rate [Hz]
SLOW, MIDDLE, FAST = (1e-4, 11.0, 500.0), (1e-3, 2.0, 1000.0), (5e-3, 0.6, 2000.0)


@dataclass(frozen=True)
class Log:
    """One simulated log: the true motion, times [s] and force [N] of its samples, and its drive speed [m/s]."""

    truth: oracle.Oracle
    time: Array
    force: Array
    drive_speed: float

    @property
    def cycles(self) -> int:
        return self.truth.arrests.size

    @property
    def slip_times(self) -> Array:
        """When the force is half way down, per slip [s]."""
        out = []
        for onset, arrest in zip(self.truth.onsets, self.truth.arrests, strict=False):
            t = np.linspace(onset, arrest, 2001)
            f = self.truth.force(t)
            top = int(np.argmax(f))
            out.append(t[top + int(np.argmax(f[top:] <= 0.5 * (f.max() + f.min())))])
        return np.array(out)

    @property
    def end(self) -> float:
        """In the last stick, half of a typical one after the last arrest [s]."""
        sticks = self.truth.onsets[1 : self.cycles] - self.truth.arrests[: self.cycles - 1]
        return float(min(self.time[-1], self.truth.arrests[-1] + 0.5 * np.median(sticks)))


def simulated(pair: dict[str, float], speed: float, duration: float, rate: float) -> Log:
    """A noise-free log from rest, by the independent integrator."""
    return _simulated(tuple(sorted(pair.items())), speed, duration, rate)


@lru_cache(maxsize=16)
def _simulated(pair: tuple[tuple[str, float], ...], speed: float, duration: float, rate: float) -> Log:
    truth = oracle.simulate(RIG | dict(pair), speed, LOAD, duration)
    time = np.arange(round(duration * rate) + 1) / rate
    return Log(truth, time, truth.force(time), speed)


def log_data(
    log: Log, unknowns: Unknowns, *, noise_seed: int | None = None, load_sd: float = 0.0, jitter_sd: float = 0.0
) -> LogData:
    """The log as the estimator sees it, with white noise drawn from `noise_seed`."""
    noise = 0.0 if noise_seed is None else NOISE * np.random.default_rng(noise_seed).standard_normal(log.time.size)
    weight = np.full(log.time.size, NOISE**-2)
    base, load = unknowns.base(RIG), NormalForce.of(LOAD)
    return LogData(
        log.time,
        log.force + noise,
        weight,
        base,
        log.drive_speed,
        load,
        load_sd,
        0.0,
        log.end,
        jitter_sd=jitter_sd,
    )


def search_space(
    pair: dict[str, float], free: tuple[str, ...], *, model: Model = MODEL, rig: dict[str, float] = RIG
) -> Unknowns:
    """Unknowns started at the pair, without priors; the bounds of the effects for what is `free`."""
    n = len(model.parameters)
    empty = Unknowns(
        model,
        np.array([name in free for name in model.parameter_names]),
        np.zeros(n),
        np.full(n, -np.inf),
        np.full(n, np.inf),
        np.zeros(n),
        np.full(n, np.inf),
        np.ones(n, bool),
        np.zeros((2, n), bool),
        np.full(n, -1),
    )
    base = empty.base(RIG)
    neutral = np.isin(model.parameter_names, RIG_PARAMETERS)
    lower = empty.theta(np.array([q.lower for q in model.parameters]), base)
    upper = empty.theta(np.array([q.upper for q in model.parameters]), base)
    start = empty.theta(np.array([(pair | rig)[name] for name in model.parameter_names]), base)
    return replace(empty, start=start, lower=np.where(neutral, -1.1, lower), upper=np.where(neutral, 1.1, upper))


FRICTION = tuple(PAIR)


def placed(
    unknowns: Unknowns, logs: list[Log], data: list[LogData], grid: Grid, *, slip_times: list[Array] | None = None
) -> list[ShootingTrajectory]:
    """The motion at the start values of the search, placed on the slip_times of the logs (default the true ones)."""
    p = [unknowns.values(unknowns.start, d.base) for d in data]
    trajectories = place(unknowns.model, data, p, slip_times or [log.slip_times for log in logs], grid)
    assert all(trajectory is not None for trajectory in trajectories), (
        "the start does not stick-slip in one of the logs"
    )
    return [trajectory for trajectory in trajectories if trajectory is not None]
