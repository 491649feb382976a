"""From parameters and detected falls to a trajectory of the whole motion: simulate every cycle, place it on the data.

Each cycle starts from the arrest of the one before and is shifted rigidly in time onto its fall; shapes are
never bent. What does not join up is left to the shooting.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_io.arrays import thinned
from identify.logs.log_data import LogData
from identify.model.model import ELONGATION, Model
from identify.shooting import batch as lanes
from identify.shooting.batch import Slips
from identify.shooting.features import Waves, middle_of_fall
from identify.shooting.grid import Grid
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

SWEEPS = (4, 30)  # how often arrests are handed on, at least and at most: the return map contracts
OF_NOISE, OF_DROP = 0.3, 0.01  # force by which an arrest moves in a sweep that is the last: of the noise, of a slip
PER_HALF_PERIOD = 60  # RK4 steps of a placed slip per half natural period
WINDOW = 48  # samples of a slip that vote on its shift
SHIFTS = 61  # places that are tried for each slip


@dataclass(frozen=True)
class _Lanes:
    """All cycles of all logs side by side: which log, whether first of its log, fall times, inputs."""

    log: NDArray[np.int64]
    first: NDArray[np.bool_]
    fall: Array
    p: Array
    u: Array


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
    still = {name: value for name, value in model.quiet if np.isfinite(value)}  # what vibrates is left to the shooting
    p = [np.array([still.get(n, v) for n, v in zip(model.parameter_names, q.tolist(), strict=True)]) for q in p]
    side = _side_by_side(logs, p, falls)
    starts = [_at_begin(model, log, q, f) for log, q, f in zip(logs, p, falls, strict=True)]
    x = _arrests(model, side, _first_arrests(model, side, starts), np.array([log.noise for log in logs])[side.log])
    slips, onset = _placed(model, logs, side, x)
    # Now that the first onset is known, so is the bounded state at the begin; the first cycles are made again.
    for number, lane in zip(np.unique(side.log), np.flatnonzero(side.first), strict=True):
        starts[number] = _begin_state(model, logs[number], side.p[lane], starts[number], float(onset[lane]))
        x[lane] = starts[number]
    slips, onset = _placed(model, logs, side, x)
    trajectories: list[ShootingTrajectory | None] = []
    for number, (log, falling) in enumerate(zip(logs, falls, strict=True)):
        mine = np.flatnonzero(side.log == number)
        if not falling.size or not np.all(slips.rested[mine]):
            trajectories.append(None)
            continue
        trajectories.append(trajectory_of(log, starts[number], slips, mine, onset[mine], grid))
    return trajectories


def _arrests(model: Model, side: _Lanes, x: Array, noise: Array) -> Array:
    """States x (n, n_x) from which the cycles start, each the arrest of the one before: handed on until it stays.

    Near the end of stick-slip the return map hardly contracts, and a slip depends much on the one before.

    Args:
        noise: of the log of each cycle (n,) [N].
    """
    stiffness = side.p[:, model.parameter_names.index("stiffness")]
    least, most = SWEEPS
    for sweep in range(1, most + 1):
        slips = lanes.slip(model, lanes.stick(model, x, side.p, side.u)[1], side.p, side.u, PER_HALF_PERIOD // 2)
        handed = np.where(np.isfinite(slips.at_arrest), slips.at_arrest, x)
        handed = np.where(side.first[:, None], x, np.roll(handed, 1, axis=0))
        moved = stiffness * np.abs(handed - x)[:, ELONGATION]
        drop = stiffness * np.abs(slips.states[0] - slips.at_arrest)[:, ELONGATION]
        x = handed
        if sweep >= least and np.all(moved <= np.maximum(OF_NOISE * noise, OF_DROP * np.nan_to_num(drop))):
            break
    return x


def _placed(model: Model, logs: list[LogData], side: _Lanes, x: Array) -> tuple[Slips, Array]:
    """Simulate every cycle from its arrest x (n, n_x) and place it on the data: the slips, their onsets (n,) [s]."""
    slips = lanes.slip(model, lanes.stick(model, x, side.p, side.u)[1], side.p, side.u, PER_HALF_PERIOD)
    waves, middle = _waves(model, slips, side)
    onset = side.fall - middle
    samples = _around(logs, side, onset, waves.duration)
    onset = onset + _scan(waves, samples, onset)
    for _ in range(2):
        onset = onset + _shift(waves, samples, onset)
    return slips, onset


def _side_by_side(logs: list[LogData], p: list[Array], falls: list[Array]) -> _Lanes:
    counts = [f.size for f in falls]
    log = np.repeat(np.arange(len(logs)), counts)
    first = np.concatenate([np.arange(c) == 0 for c in counts])
    fall = np.concatenate(falls)
    force = np.concatenate([log_.normal_force.at(f) for log_, f in zip(logs, falls, strict=True)])
    speed = np.array([log_.drive_speed for log_ in logs])[log]
    # Each cycle begins about where the fall before it is.
    since = np.where(first, np.array([log_.begin for log_ in logs])[log], np.roll(fall, 1))
    u = np.stack([speed, force, np.ones_like(force), since], axis=1)
    return _Lanes(log, first, fall, np.stack(p)[log], u)


def _at_begin(model: Model, log: LogData, p: Array, falls: Array) -> Array:
    """State at the begin of the window: elongation from the first stick's samples, bounded states half way."""
    x = np.array([s.start for s in model.states])
    for i, s in enumerate(model.states):
        if s.lower is not None and s.upper is not None:
            x[i] = 0.5 * (s.lower + s.upper)
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
            settled = lanes.at_force(model, np.array([level]), p[None, :], u)[0]
            x = np.where(np.arange(x.size) == (-1 if model.clamped is None else model.clamped), x, settled)
    return x


def _first_arrests(model: Model, side: _Lanes, starts: list[Array]) -> Array:
    """Where the first sweep starts every cycle: the begin of the record, else the kinetic level less half a drop."""
    names = model.parameter_names
    mu_s, mu_k0 = side.p[:, names.index("mu_s")], side.p[:, names.index("mu_k0")]
    level = np.maximum(2 * mu_k0 - mu_s, 0.05 * mu_k0) * side.u[:, 1]
    x = lanes.at_force(model, level, side.p, side.u)
    x[side.first] = np.stack([s for i, s in enumerate(starts) if np.any(side.log == i)])
    return x


def _waves(model: Model, slips: Slips, side: _Lanes) -> tuple[Waves, Array]:
    """The simulated cycles as functions of time, and the time of the middle of their falls (n,) [s]."""
    n, steps = side.fall.size, slips.states.shape[0]
    flat = slips.states.transpose(1, 0, 2).reshape(n * steps, -1)
    force = lanes.load_cell(model, flat, np.repeat(side.p, steps, axis=0), np.repeat(side.u, steps, axis=0))
    end = lanes.load_cell(model, np.nan_to_num(slips.at_arrest), side.p, side.u)
    k = side.p[:, model.parameter_names.index("stiffness")]
    duration = np.where(slips.rested, slips.arrest, slips.h)
    force = force.reshape(n, steps)
    return Waves.of(force, slips.h, duration, end, k * side.u[:, 0]), middle_of_fall(force, slips.h, duration)


@dataclass(frozen=True)
class _Samples:
    """Samples around each slip, shape (n, WINDOW): times [s], forces [N], weights; interval (n,) between samples."""

    time: Array
    force: Array
    weight: Array
    interval: Array


def _around(logs: list[LogData], side: _Lanes, onset: Array, duration: Array) -> _Samples:
    """The samples from one interval before each onset to one after the arrest, thinned where there are many."""
    n = onset.size
    time, force, weight = np.zeros((n, WINDOW)), np.zeros((n, WINDOW)), np.zeros((n, WINDOW))
    interval = np.ones(n)
    for number, log in enumerate(logs):
        mine = np.flatnonzero(side.log == number)
        if mine.size == 0:
            continue
        interval[mine] = log.interval
        first = np.searchsorted(log.time, onset[mine] - 1.5 * interval[mine])
        last = np.searchsorted(log.time, onset[mine] + duration[mine] + 1.5 * interval[mine])
        stride = np.maximum((last - first - 1) // WINDOW + 1, 1)
        index = first[:, None] + stride[:, None] * np.arange(WINDOW)[None, :]
        valid = (index < last[:, None]) & (index < log.time.size)
        index = np.minimum(index, log.time.size - 1)
        time[mine], force[mine] = log.time[index], log.force[index]
        weight[mine] = np.where(valid, log.weight[index], 0.0)
    return _Samples(time, np.where(weight > 0, force, 0.0), weight, interval)


def _scan(waves: Waves, samples: _Samples, onset: Array) -> Array:
    """The best of many shifts of each cycle (n,) [s]: a slip of two samples has several places that look right,
    and no gradient leads from one to the next."""
    reach = np.maximum(samples.interval, 0.1 * waves.duration)
    best, cost = np.zeros(onset.size), np.full(onset.size, np.inf)
    for fraction in np.linspace(-1.0, 1.0, SHIFTS):
        shift = fraction * reach
        value = waves.values(samples.time - (onset + shift)[:, None])
        square = np.sum(samples.weight * (samples.force - value) ** 2, axis=1)
        best = np.where(square < cost, shift, best)
        cost = np.minimum(square, cost)
    return best


def _shift(waves: Waves, samples: _Samples, onset: Array) -> Array:
    """One Gauss-Newton step of each cycle's time shift on its own samples (n,) [s]."""
    value, slope = waves.with_rates(samples.time - onset[:, None])
    with np.errstate(all="ignore"):
        pull = np.sum(samples.weight * (samples.force - value) * slope, axis=1)
        move = -pull / np.sum(samples.weight * slope**2, axis=1)
    limit = 0.5 * np.maximum(samples.interval, 0.1 * waves.duration) / SHIFTS
    return np.asarray(np.clip(np.where(np.isfinite(move), move, 0.0), -limit, limit))


def trajectory_of(
    log: LogData, start: Array, slips: Slips, mine: NDArray[np.int64], onset: Array, grid: Grid
) -> ShootingTrajectory:
    """The trajectory of a log from its slips.

    Args:
        start: state at the begin (n_x,); slips: of many logs, of which `mine` (c,) are this log's; onset: (c,) [s].
    """
    wear, arrest = slips.wear[mine], slips.arrest[mine]
    picked = Slips(
        slips.h[mine],
        slips.states[:, mine],
        slips.rates[:, mine],
        wear,
        arrest,
        slips.at_wear[mine],
        slips.at_arrest[mine],
    )
    middle = np.where(np.isfinite(wear), wear, arrest)
    first = picked.at(np.linspace(0.0, 1.0, grid.slip + 1)[None, :] * middle[:, None])
    second = picked.at(middle[:, None] + np.linspace(0.0, 1.0, grid.worn + 1)[None, :] * (arrest - middle)[:, None])
    ends = np.isfinite(wear)
    first[:, -1] = np.where(ends[:, None], picked.at_wear, picked.at_arrest)
    second[:, -1] = picked.at_arrest
    return ShootingTrajectory.train(start, onset, onset + wear, onset + arrest, first, second, log.own)


def _begin_state(model: Model, log: LogData, p: Array, start: Array, onset: float) -> Array:
    """The state at the begin with its bounded state chosen so that the first onset comes when it was seen [s]."""
    if model.clamped is None:
        return start
    g = model.clamped
    candidates = np.linspace(0.0, 1.0, 41)
    x = np.repeat(start[None, :], candidates.size, axis=0)
    x[:, g] = candidates
    u = np.tile([log.drive_speed, float(log.normal_force.at(onset)), 1.0, log.begin], (candidates.size, 1))
    times, _ = lanes.stick(model, x, np.repeat(p[None, :], candidates.size, axis=0), u)
    best = int(np.argmin(np.abs(times - (onset - log.begin))))
    out = start.copy()
    # Where the first stick is so long that its start is forgotten, half way is as good as any.
    out[g] = candidates[best] if float(np.ptp(times)) > 1e-3 * (onset - log.begin) else 0.5
    return out
