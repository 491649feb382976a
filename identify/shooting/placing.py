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
from identify.shooting.batch import Slips, Waves
from identify.shooting.layout import Grid
from identify.shooting.shooting_trajectory import ShootingTrajectory, Stretch

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

    model: Model
    log: NDArray[np.int64]
    first: NDArray[np.bool_]
    fall: Array
    p: Array
    u: Array
    noise: Array

    @staticmethod
    def of(model: Model, logs: list[LogData], p: list[Array], falls: list[Array]) -> _Cycles:
        log, fall = np.repeat(np.arange(len(logs)), [f.size for f in falls]), np.concatenate(falls)
        first = np.diff(log, prepend=-1) > 0
        force = np.concatenate([one.normal_force.at(f) for one, f in zip(logs, falls, strict=True)])
        speed, begin, noise = (np.array([getattr(d, n) for d in logs])[log] for n in ("drive_speed", "begin", "noise"))
        # Each cycle begins about where the fall before it is.
        u = np.stack([speed, force, np.ones_like(force), np.where(first, begin, np.roll(fall, 1))], axis=1)
        return _Cycles(model, log, first, fall, np.stack(p)[log], u, noise)

    def slips(self, x: Array, per_half_period: int = PER_HALF_PERIOD) -> Slips:
        """The slip of every cycle from its arrest x (n, n_x)."""
        at_onset = batch.stick(self.model, x, self.p, self.u)[1]
        return batch.slip(self.model, at_onset, self.p, self.u, per_half_period)


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
    p = [q.copy() for q in p]
    for name, value in model.quiet:
        if np.isfinite(value):  # what vibrates is left to the shooting
            for q in p:
                q[model.parameter_names.index(name)] = value
    cycles = _Cycles.of(model, logs, p, falls)
    starts = [_begin_state(model, log, q, f) for log, q, f in zip(logs, p, falls, strict=True)]
    slips, onset = _placed(logs, cycles, _arrests(cycles, starts))
    trajectories: list[ShootingTrajectory | None] = []
    for number, log in enumerate(logs):
        mine = np.flatnonzero(cycles.log == number)
        rests = mine.size and np.all(slips.rested[mine])
        trajectories.append(_trajectory(log, starts[number], slips, mine, onset[mine], grid) if rests else None)
    return trajectories


def _arrests(cycles: _Cycles, starts: list[Array]) -> Array:
    """States (n, n_x) from which cycles start, each the arrest of the one before: handed on until it stays."""
    names = cycles.model.parameter_names
    mu_s, mu_k0, stiffness = (cycles.p[:, names.index(n)] for n in ("mu_s", "mu_k0", "stiffness"))
    level = np.maximum(2 * mu_k0 - mu_s, 0.05 * mu_k0) * cycles.u[:, 1]
    x = batch.at_force(cycles.model, level, cycles.p, cycles.u)
    x[cycles.first] = np.stack([starts[i] for i in cycles.log[cycles.first]])
    for sweep in range(1, SWEEPS[1] + 1):
        slips = cycles.slips(x, PER_HALF_PERIOD // 2)
        handed = np.where(np.isfinite(slips.at_arrest), slips.at_arrest, x)
        handed = np.where(cycles.first[:, None], x, np.roll(handed, 1, axis=0))
        moved = stiffness * np.abs(handed - x)[:, ELONGATION]
        drop = stiffness * np.abs(slips.states[0] - slips.at_arrest)[:, ELONGATION]
        x = handed
        if sweep >= SWEEPS[0] and np.all(moved <= np.maximum(OF_NOISE * cycles.noise, OF_DROP * np.nan_to_num(drop))):
            break
    return x


def _placed(logs: list[LogData], cycles: _Cycles, x: Array) -> tuple[Slips, Array]:
    """Simulate every cycle from its arrest x (n, n_x): the slips, and their onsets (n,) [s] with which they lie on
    their samples best: the best of many shifts, for a slip of two samples has several places that look right and no
    gradient leads from one to the next; then two Gauss-Newton steps."""
    slips = cycles.slips(x)
    waves, middle = Waves.of_slips(cycles.model, slips, cycles.p, cycles.u, slips.rested)
    onset = cycles.fall - middle
    time, force, weight = np.zeros((3, onset.size, WINDOW))
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
    best, cost = onset, np.full(onset.size, np.inf)
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
    return slips, best


def _begin_state(model: Model, log: LogData, p: Array, falls: Array) -> Array:
    """State at the begin of the window: elongation from its first samples, age of the contact from the first onset."""
    clamped, bounds = model.clamped, [(s.start, s.lower, s.upper) for s in model.states]
    x = np.array([start if low is None or high is None else 0.5 * (low + high) for start, low, high in bounds])
    if not falls.size:
        return x
    end = log.begin + 0.8 * max(falls[0] - log.begin, 0.0)
    rows = slice(*np.searchsorted(log.time, [log.begin, np.nextafter(max(end, log.time[0]), np.inf)]))
    counted = log.weight[rows] > 0
    k, m = (p[model.parameter_names.index(name)] for name in ("stiffness", "mass"))
    if np.any(counted):
        moved = k * log.drive_speed * (log.time[rows] - log.begin)
        level = np.median(thinned((log.force[rows] - moved)[counted]))
        u = np.array([[log.drive_speed, float(log.normal_force.at(log.begin)), 1.0, log.begin]])
        settled = batch.at_force(model, np.array([level]), p[None, :], u)[0]
        x = np.where(np.arange(x.size) == (-1 if clamped is None else clamped), x, settled)
    if clamped is None:
        return x
    onset = falls[0] - 0.5 * np.pi * np.sqrt(m / k)  # a fall is half way down after a quarter of a period
    aged, first = np.tile(x, (41, 1)), onset - log.begin
    aged[:, clamped] = np.linspace(0.0, 1.0, len(aged))
    u = np.tile([log.drive_speed, float(log.normal_force.at(onset)), 1.0, log.begin], (len(aged), 1))
    times = batch.stick(model, aged, np.tile(p, (len(aged), 1)), u)[0]
    # Where the first stick is so long that its start is forgotten, half way is as good as any.
    return aged[int(np.argmin(np.abs(times - first)))] if np.ptp(times) > 1e-3 * first else x


def _trajectory(
    log: LogData, start: Array, slips: Slips, mine: NDArray[np.int64], onset: Array, grid: Grid
) -> ShootingTrajectory:
    """The trajectory of a log from a state at the begin (n_x,) and its slips `mine` (c,) with onsets (c,) [s]."""
    ends = {name: getattr(slips, name)[mine] for name in ("h", "wear", "arrest", "at_wear", "at_arrest")}
    own = replace(slips, states=slips.states[:, mine], rates=slips.rates[:, mine], **ends)
    worn = np.isfinite(own.wear)
    middle = np.where(worn, own.wear, own.arrest)[:, None]
    slip = own.at(np.linspace(0.0, 1.0, grid.slip + 1) * middle)
    wear = own.at(middle + np.linspace(0.0, 1.0, grid.worn + 1) * (own.arrest[:, None] - middle))
    slip[:, -1], wear[:, -1] = np.where(worn[:, None], own.at_wear, own.at_arrest), own.at_arrest
    stretches = list[Stretch]()
    for i, begun in enumerate(onset.tolist()):
        arrest = begun + float(own.arrest[i])
        stretches.append(Stretch("rest", begun, "onset", slip[i, :1]))
        if worn[i]:
            stretches.append(Stretch("slip", begun + float(own.wear[i]), "wear", slip[i, 1:]))
            stretches.append(Stretch("worn", arrest, "arrest", wear[i, 1:]))
        else:
            stretches.append(Stretch("slip", arrest, "arrest", slip[i, 1:]))
    return ShootingTrajectory.of(start, stretches, log.own)
