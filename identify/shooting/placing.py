"""From parameters and detected falls to a trajectory of the whole motion: simulate every cycle, place it on the data.

Each cycle starts from the arrest of the one before and is shifted rigidly in time onto its fall; shapes are
never bent. What does not join up is left to the shooting.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data_io.arrays import thinned
from identify.logs.log_data import LogData
from identify.model.model import ELONGATION, Model
from identify.shooting import batch
from identify.shooting.batch import Slips
from identify.shooting.features import Waves
from identify.shooting.grid import Grid
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

SWEEPS = (4, 30)  # how often arrests are handed on, at least and at most: the return map contracts
OF_NOISE, OF_DROP = 0.3, 0.01  # force by which an arrest moves in a sweep that is the last: of the noise, of a slip
PER_HALF_PERIOD = 60  # RK4 steps of a placed slip per half natural period
WINDOW = 48  # samples of a slip that vote on its shift
SHIFTS = 61  # places that are tried for each slip


@dataclass(frozen=True)
class _Cycles:
    """All cycles of all logs side by side (n,): which log, whether first of its log, fall times [s]; parameters
    (n, n_p), inputs (n, 4), noise (n,) of the log [N]."""

    log: NDArray[np.int64]
    first: NDArray[np.bool_]
    fall: Array
    p: Array
    u: Array
    noise: Array

    @staticmethod
    def of(model: Model, logs: list[LogData], p: list[Array], falls: list[Array]) -> _Cycles:
        counts = [f.size for f in falls]
        log, fall = np.repeat(np.arange(len(logs)), counts), np.concatenate(falls)
        first = np.concatenate([np.arange(c) == 0 for c in counts])
        force = np.concatenate([one.normal_force.at(f) for one, f in zip(logs, falls, strict=True)])
        speed, begin, noise = (np.array([getattr(d, n) for d in logs])[log] for n in ("drive_speed", "begin", "noise"))
        # Each cycle begins about where the fall before it is.
        u = np.stack([speed, force, np.ones_like(force), np.where(first, begin, np.roll(fall, 1))], axis=1)
        values = np.stack(p)[log]
        for name, value in model.quiet:
            if np.isfinite(value):  # what vibrates is left to the shooting
                values[:, model.parameter_names.index(name)] = value
        return _Cycles(log, first, fall, values, u, noise)


def place(
    model: Model, logs: list[LogData], p: list[Array], falls: list[Array], grid: Grid
) -> list[ShootingTrajectory | None]:
    """Place a cycle of the model on every fall: a trajectory per log, None where the model does not come to rest in one
    of its cycles (it slides).

    Args:
        p: parameter values of each log (n_p,).
        falls: per log, the mid-fall times of its cycles (c,) [s].
    """
    if not logs or not sum(f.size for f in falls):
        return [None for _ in logs]
    cycles = _Cycles.of(model, logs, p, falls)
    starts = [_at_begin(model, log, q, f) for log, q, f in zip(logs, p, falls, strict=True)]
    x = _arrests(model, cycles, starts)
    onset = _placed(model, logs, cycles, x)[1]
    # Now that the first onset is known, so is the bounded state at the begin; the first cycles are made again.
    for number, row in zip(np.unique(cycles.log), np.flatnonzero(cycles.first), strict=True):
        starts[number] = _begin_state(model, logs[number], cycles.p[row], starts[number], float(onset[row]))
        x[row] = starts[number]
    slips, onset = _placed(model, logs, cycles, x)
    trajectories: list[ShootingTrajectory | None] = []
    for number, log in enumerate(logs):
        mine = np.flatnonzero(cycles.log == number)
        rests = mine.size and np.all(slips.rested[mine])
        trajectories.append(_trajectory(log, starts[number], slips, mine, onset[mine], grid) if rests else None)
    return trajectories


def _slips(model: Model, cycles: _Cycles, x: Array, per_half_period: int) -> Slips:
    return batch.slip(model, batch.stick(model, x, cycles.p, cycles.u)[1], cycles.p, cycles.u, per_half_period)


def _arrests(model: Model, cycles: _Cycles, starts: list[Array]) -> Array:
    """States (n, n_x) from which the cycles start, each the arrest of the one before: handed on until it stays, from
    the kinetic level less half a drop.

    Near the end of stick-slip the return map hardly contracts, and a slip depends much on the one before.
    """
    names = model.parameter_names
    mu_s, mu_k0, stiffness = (cycles.p[:, names.index(n)] for n in ("mu_s", "mu_k0", "stiffness"))
    level = np.maximum(2 * mu_k0 - mu_s, 0.05 * mu_k0) * cycles.u[:, 1]
    x = batch.at_force(model, level, cycles.p, cycles.u)
    x[cycles.first] = np.stack([starts[i] for i in np.unique(cycles.log)])
    for sweep in range(1, SWEEPS[1] + 1):
        slips = _slips(model, cycles, x, PER_HALF_PERIOD // 2)
        handed = np.where(np.isfinite(slips.at_arrest), slips.at_arrest, x)
        handed = np.where(cycles.first[:, None], x, np.roll(handed, 1, axis=0))
        moved = stiffness * np.abs(handed - x)[:, ELONGATION]
        drop = stiffness * np.abs(slips.states[0] - slips.at_arrest)[:, ELONGATION]
        x = handed
        if sweep >= SWEEPS[0] and np.all(moved <= np.maximum(OF_NOISE * cycles.noise, OF_DROP * np.nan_to_num(drop))):
            break
    return x


def _placed(model: Model, logs: list[LogData], cycles: _Cycles, x: Array) -> tuple[Slips, Array]:
    """Simulate every cycle from its arrest x (n, n_x) and place it on the data: the slips, their onsets (n,) [s]."""
    slips = _slips(model, cycles, x, PER_HALF_PERIOD)
    waves, middle = Waves.of_slips(model, slips, cycles.p, cycles.u, slips.rested)
    return slips, _shifted(logs, cycles, waves, cycles.fall - middle)


def _shifted(logs: list[LogData], cycles: _Cycles, waves: Waves, onset: Array) -> Array:
    """The onsets (n,) [s] with which the cycles lie on their samples best: the best of many shifts, for a slip of two
    samples has several places that look right and no gradient leads from one to the next; then two Gauss-Newton steps.
    """
    n = onset.size
    time, force, weight = np.zeros((n, WINDOW)), np.zeros((n, WINDOW)), np.zeros((n, WINDOW))
    interval = np.array([log.interval for log in logs])[cycles.log]
    for number, log in enumerate(logs):  # from one interval before each onset to one after the arrest, thinned
        mine = np.flatnonzero(cycles.log == number)
        margin = 1.5 * interval[mine]
        first = np.searchsorted(log.time, onset[mine] - margin)
        last = np.searchsorted(log.time, onset[mine] + waves.duration[mine] + margin)
        stride = np.maximum((last - first - 1) // WINDOW + 1, 1)
        index = first[:, None] + stride[:, None] * np.arange(WINDOW)[None, :]
        inside = (index < last[:, None]) & (index < log.time.size)
        index = np.minimum(index, log.time.size - 1)
        time[mine], force[mine] = log.time[index], log.force[index]
        weight[mine] = np.where(inside, log.weight[index], 0.0)
    force = np.where(weight > 0, force, 0.0)
    reach = np.maximum(interval, 0.1 * waves.duration)
    best, cost = onset, np.full(n, np.inf)
    for fraction in np.linspace(-1.0, 1.0, SHIFTS):
        at = onset + fraction * reach
        square = np.sum(weight * (force - waves.values(time - at[:, None])) ** 2, axis=1)
        best = np.where(square < cost, at, best)
        cost = np.minimum(square, cost)
    limit = 0.5 * reach / SHIFTS
    for _ in range(2):
        value, slope = waves.with_rates(time - best[:, None])
        with np.errstate(all="ignore"):
            move = -np.sum(weight * (force - value) * slope, axis=1) / np.sum(weight * slope**2, axis=1)
        best = best + np.clip(np.where(np.isfinite(move), move, 0.0), -limit, limit)
    return np.asarray(best)


def _at_begin(model: Model, log: LogData, p: Array, falls: Array) -> Array:
    """State at the begin of the window: elongation from the first stick's samples, bounded states half way."""
    bounds = [(s.start, s.lower, s.upper) for s in model.states]
    x = np.array([start if low is None or high is None else 0.5 * (low + high) for start, low, high in bounds])
    if falls.size:
        end = log.begin + 0.8 * max(falls[0] - log.begin, 0.0)
        last = int(np.searchsorted(log.time, max(end, log.time[0]), side="right"))
        rows = slice(int(np.searchsorted(log.time, log.begin)), last)
        mine = log.weight[rows] > 0
        if np.any(mine):
            k = p[model.parameter_names.index("stiffness")]
            moved = k * log.drive_speed * (log.time[rows] - log.begin)
            level = np.median(thinned((log.force[rows] - moved)[mine]))
            u = np.array([[log.drive_speed, float(log.normal_force.at(log.begin)), 1.0, log.begin]])
            settled = batch.at_force(model, np.array([level]), p[None, :], u)[0]
            x = np.where(np.arange(x.size) == (-1 if model.clamped is None else model.clamped), x, settled)
    return x


def _begin_state(model: Model, log: LogData, p: Array, start: Array, onset: float) -> Array:
    """The state at the begin with its bounded state chosen so that the first onset comes when it was seen [s]."""
    if model.clamped is None:
        return start
    ages = np.linspace(0.0, 1.0, 41)
    x = np.repeat(start[None, :], ages.size, axis=0)
    x[:, model.clamped] = ages
    u = np.tile([log.drive_speed, float(log.normal_force.at(onset)), 1.0, log.begin], (ages.size, 1))
    times, _ = batch.stick(model, x, np.repeat(p[None, :], ages.size, axis=0), u)
    # Where the first stick is so long that its start is forgotten, half way is as good as any.
    best = int(np.argmin(np.abs(times - (onset - log.begin)))) if np.ptp(times) > 1e-3 * (onset - log.begin) else 20
    return x[best]


def _trajectory(
    log: LogData, start: Array, slips: Slips, mine: NDArray[np.int64], onset: Array, grid: Grid
) -> ShootingTrajectory:
    """The trajectory of a log from a state at the begin (n_x,) and its slips `mine` (c,) with onsets (c,) [s]."""
    ends = ("h", "wear", "arrest", "at_wear", "at_arrest")
    picked = replace(slips, states=slips.states[:, mine], rates=slips.rates[:, mine])
    picked = replace(picked, **{name: getattr(slips, name)[mine] for name in ends})
    wear, arrest, wears = picked.wear, picked.arrest, np.isfinite(picked.wear)
    middle = np.where(wears, wear, arrest)
    first = picked.at(np.linspace(0.0, 1.0, grid.slip + 1)[None, :] * middle[:, None])
    second = picked.at(middle[:, None] + np.linspace(0.0, 1.0, grid.worn + 1)[None, :] * (arrest - middle)[:, None])
    first[:, -1] = np.where(wears[:, None], picked.at_wear, picked.at_arrest)
    second[:, -1] = picked.at_arrest
    return ShootingTrajectory.train(start, onset, onset + wear, onset + arrest, first, second, log.own)
