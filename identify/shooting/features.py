"""The force of one simulated cycle, and drift-free features of a log: what one settled cycle of it looks like.

Per log the period, and the mean waveform folded around the fall, every cycle shifted onto the mean by its
own samples. A level that drifts and a normal force that relaxes leave them alone. Of a drive programme no two cycles
are alike: there every slip has features of its own, and the rest before it, with the steps of the drive in it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import LogData
from identify.logs.segment import DetectedCycles
from identify.model.model import Model
from identify.shooting.batch import Slips, load_cell

# ----------------------------------------------------------------------------------------------------------------------
# The force of one simulated cycle as a function of time: stick line, slip, stick line.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


def middle_of_fall(force: Array, h: Array, duration: Array) -> Array:
    """Time of the mid-fall crossing of each lane's simulated force (n, steps) [s]."""
    steps = np.arange(force.shape[1])[None, :]
    inside = steps * h[:, None] <= duration[:, None] + h[:, None]
    shown = np.where(inside, force, np.nan)
    rows = np.arange(force.shape[0])
    with np.errstate(all="ignore"):
        top = np.nanargmax(np.where(np.isnan(shown), -np.inf, shown), axis=1)
        level = 0.5 * (np.nanmax(shown, axis=1) + np.nanmin(shown, axis=1))
    below = (force <= level[:, None]) & (steps > top[:, None]) & inside
    after = np.maximum(np.argmax(below, axis=1), 1)
    f0, f1 = force[rows, after - 1], force[rows, after]
    w = np.clip(np.where(f0 > f1, (f0 - level) / np.where(f0 > f1, f0 - f1, 1.0), 0.5), 0.0, 1.0)
    return np.asarray((after - 1 + w) * h)


@dataclass(frozen=True)
class Waves:
    """The force of simulated cycles as a function of time from their onset: stick line, slip, stick line.

    h (n,) step lengths [s]; duration (n,) of the slips [s]; start, end (n,) force at their ends [N]; slope (n,) of the
    sticks [N/s]; cubics (4, n * s): coefficients of the powers of the share of every step that has passed.
    """

    h: Array
    duration: Array
    start: Array
    end: Array
    slope: Array
    cubics: Array

    @staticmethod
    def of(force: Array, h: Array, duration: Array, end: Array, slope: Array) -> Waves:
        """From the force at the steps (n, s + 1); cubic through the neighbours' slopes: the steps are coarse."""
        around = np.concatenate([force[:, :1], force, force[:, -1:]], axis=1)
        tilt = 0.5 * (around[:, 2:] - around[:, :-2])
        rise, first, last = np.diff(force, axis=1), tilt[:, :-1], tilt[:, 1:]
        bends = [force[:, :-1], first, 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise]
        return Waves(h, duration, force[:, 0], end, slope, np.stack(bends).reshape(4, -1))

    @staticmethod
    def of_slips(model: Model, slips: Slips, p: Array, u: Array, rested: NDArray[np.bool_]) -> tuple[Waves, Array]:
        """Of slips with parameters p (n, n_p) and inputs u (n, 4), those that have not rested a step long; and the time
        of the middle of their falls (n,) [s]."""
        n, steps = slips.h.size, slips.states.shape[0]
        flat = slips.states.transpose(1, 0, 2).reshape(n * steps, -1)
        force = load_cell(model, flat, np.repeat(p, steps, axis=0), np.repeat(u, steps, axis=0)).reshape(n, steps)
        duration = np.where(rested, slips.arrest, slips.h)
        end = load_cell(model, np.nan_to_num(slips.at_arrest), p, u)
        slope = p[:, model.parameter_names.index("stiffness")] * u[:, 0]
        return Waves.of(force, slips.h, duration, end, slope), middle_of_fall(force, slips.h, duration)

    def values(self, t: Array) -> Array:
        """Force (n, b) at times t (n, b) from the onset of each cycle."""
        return self._shown(t, *self._within(t))

    def with_rates(self, t: Array) -> tuple[Array, Array]:
        """Force (n, b) at times t (n, b) from the onset of each cycle, and its rates [N/s]."""
        c, w = self._within(t)
        rate = ((3.0 * c[3] * w + 2.0 * c[2]) * w + c[1]) / self.h[:, None]
        return self._shown(t, c, w), np.where((t < 0.0) | (t > self.duration[:, None]), self.slope[:, None], rate)

    def _within(self, t: Array) -> tuple[Array, Array]:
        """The coefficients (4, n, b) of the step in which each time is, and the share of it that has passed."""
        lanes = self.h.size
        steps = self.cubics.shape[1] // lanes
        u = np.clip(t / self.h[:, None], 0.0, steps - 1e-6)
        i = u.astype(np.int64)
        w = u - i
        i += steps * np.arange(lanes)[:, None]
        return np.take(self.cubics, i, axis=1), w

    def _shown(self, t: Array, c: Array, w: Array) -> Array:
        """The force (n, b) in the slip, by what `_within` gives, and on the lines before and after it."""
        slip = ((c[3] * w + c[2]) * w + c[1]) * w + c[0]
        s = self.slope[:, None]
        late = t - self.duration[:, None]
        value = np.where(late > 0.0, self.end[:, None] + s * late, slip)
        return np.where(t < 0.0, self.start[:, None] + s * t, value)


BINS = 40  # per half natural period
BEFORE, AFTER = 2.5, 2.0  # half periods around the middle of the fall
SHARE = 0.42  # of the period: the window never reaches the next fall
MODEL_ERROR = 0.01  # of the drop: what the features of an ideal log still miss
TIMING = 0.3  # of the time between samples: how well they tell a time
MOST_SAMPLES = 1 << 14  # of one log in the fold: enough for any mean


@dataclass(frozen=True)
class Features:
    """One settled cycle of one log. times (b,) [s] from the middle of the fall, waveform (b,) [N] at the mean
    normal force, sd (b,); period [s] and its sd (period_sd infinite where a log shows one fall only); arrest:
    valley force [N]; drop [N]; time of its middle cycle [s].

    Of a slip that is like no other (`after` is a number) arrest is the force at which the rest before it begins, after
    that at which it ends [N] (infinite: not known); legs: drive speed [m/s] and duration [s] of each part of the rest
    but the last; period the time from the begin of the rest to the middle of the fall.
    """

    drive_speed: float
    normal_force: float
    times: Array
    waveform: Array
    sd: Array
    period: float
    period_sd: float
    arrest: float
    drop: float
    time: float
    after: float = np.nan
    legs: tuple[tuple[float, float], ...] = ()

    @property
    def settled(self) -> bool:
        """Whether the cycle repeats itself."""
        return bool(np.isnan(self.after))


def extract(log: LogData, falls: Array, half_period: float) -> Features | None:
    """The features of a log, or None without a fall that can be folded.

    Args:
        falls: mid-fall times of its cycles (c,) [s].
        half_period: half the natural period [s].
    """
    if falls.size == 0:
        return None
    settled = falls[1:] if falls.size >= 3 else falls
    periods = np.diff(falls)
    period = float(np.median(periods)) if periods.size else np.inf
    bin_width = half_period / BINS
    lower = -min(BEFORE * half_period, SHARE * period)
    upper = min(AFTER * half_period, SHARE * period)
    edges = np.arange(np.floor(lower / bin_width), np.ceil(upper / bin_width) + 1) * bin_width
    local, force, weight, cycle = _fold(log, settled, edges)
    if local.size < 4:
        return None
    shift = np.zeros(settled.size)
    for _ in range(3):
        mean, count = _binned(local - shift[cycle], force, weight, edges)
        if np.count_nonzero(count) < 4:
            return None
        value, slope = _against_mean(local - shift[cycle], edges, mean, count)
        force = force - _cycle_levels(value - force, weight, cycle, settled.size)[cycle]
        limit = 5 * (edges[1] - edges[0])
        shift = shift + _cycle_shifts(value - force, slope, weight, cycle, settled.size, limit)
    mean, count = _binned(local - shift[cycle], force, weight, edges)
    used = count > 0
    drop = float(np.max(mean[used]) - np.min(mean[used]))
    noise = 1.0 / np.sqrt(np.maximum(count[used], 1e-300))
    interval = log.interval
    # Where a fall holds few samples they do not tell when it was, and the mean of many is smeared.
    blur = TIMING * interval * min(interval / half_period, 1.0) ** 2 * np.gradient(mean[used], edges[:-1][used])
    period_sd = 0.003 * period + TIMING * interval / np.sqrt(max(periods.size, 1)) if periods.size else np.inf
    if periods.size > 2:
        period_sd = max(period_sd, 1.25 * float(np.std(periods[1:])) / np.sqrt(periods.size - 1))
    return Features(
        log.drive_speed,
        float(np.mean(log.normal_force.at(settled))),
        (0.5 * (edges[:-1] + edges[1:]))[used],
        mean[used],
        np.hypot(np.hypot(noise, MODEL_ERROR * drop), blur),
        period,
        float(period_sd),
        float(np.min(mean[used])),
        drop,
        float(np.mean(settled)),
    )


def extract_one_by_one(log: LogData, cycles: DetectedCycles, half_period: float) -> list[Features]:
    """The features of every slip of a drive programme that follows another one while the drive moves on."""
    assert log.programme is not None
    drive, out = log.programme, list[Features]()
    for i in range(1, cycles.count):
        begin, fall = float(cycles.arrest[i - 1]), float(cycles.fall[i])
        edges = [begin, *drive.changes(begin, fall), fall]
        speeds = [drive.at(0.5 * (since + until)) for since, until in itertools.pairwise(edges)]
        later = cycles.onset[i + 1] if i + 1 < cycles.count else log.end
        until = min([later, *drive.changes(fall, later)])
        mine = (log.time > edges[-2]) & (log.time < until)
        shown = replace(log, drive_speed=speeds[-1], weight=np.where(mine, log.weight, 0.0))
        found = extract(shown, cycles.fall[i : i + 1], half_period) if speeds[-1] > 0.0 else None
        if found is not None:
            rests = until > cycles.arrest[i]
            out.append(
                replace(
                    found,
                    period=fall - begin,
                    period_sd=0.003 * (fall - edges[-2]) + log.interval + TIMING * half_period / BINS,
                    arrest=float(cycles.arrest_force[i - 1]),
                    after=float(cycles.arrest_force[i]) if rests else np.inf,
                    legs=tuple(zip(speeds[:-1], np.diff(edges[:-1]).tolist(), strict=True)),
                )
            )
    return out


def _fold(log: LogData, falls: Array, edges: Array) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Samples around each fall: local time, force at the mean normal force, weight, cycle."""
    first = np.searchsorted(log.time, falls + edges[0])
    last = np.searchsorted(log.time, falls + edges[-1])
    lengths = np.maximum(last - first, 0)
    ends = np.cumsum(lengths)
    number = np.arange(0, int(ends[-1]), max(int(ends[-1]) // MOST_SAMPLES, 1))
    cycle = np.searchsorted(ends, number, side="right")
    index = number + (first - (ends - lengths))[cycle]
    good = log.weight[index] > 0
    cycle, index = cycle[good], index[good]
    load = log.normal_force.at(falls)
    force = log.force[index] * (np.mean(load) / load)[cycle]
    return log.time[index] - falls[cycle], force, log.weight[index], cycle


def _binned(local: Array, force: Array, weight: Array, edges: Array) -> tuple[Array, Array]:
    """Weighted mean per bin (NaN where empty) and summed weight (b,)."""
    bins = edges.size - 1
    index = np.floor((local - edges[0]) / (edges[1] - edges[0])).astype(int)
    inside = (index >= 0) & (index < bins)
    total = np.bincount(index[inside], weights=weight[inside], minlength=bins)
    summed = np.bincount(index[inside], weights=(weight * force)[inside], minlength=bins)
    with np.errstate(all="ignore"):
        return np.asarray(summed / total), np.asarray(total, dtype=float)


def _against_mean(local: Array, edges: Array, mean: Array, count: Array) -> tuple[Array, Array]:
    """Mean waveform and its slope at local times, interpolated over filled bins."""
    centres = (0.5 * (edges[:-1] + edges[1:]))[count > 0]
    filled = mean[count > 0]
    slope = np.gradient(filled, centres)
    return np.interp(local, centres, filled), np.interp(local, centres, slope)


def _cycle_levels(below: Array, weight: Array, cycle: NDArray[np.int64], n: int) -> Array:
    """How far each cycle lies above the mean waveform (n,) [N], their average taken out; samples lie `below` it."""
    total = np.bincount(cycle, weights=weight, minlength=n)
    level = np.bincount(cycle, weights=-weight * below, minlength=n) / np.maximum(total, 1e-300)
    return np.asarray(level - np.mean(level))


def _cycle_shifts(below: Array, slope: Array, weight: Array, cycle: NDArray[np.int64], n: int, limit: float) -> Array:
    """One Gauss-Newton step of each cycle's time shift onto the mean waveform (n,) [s], their average taken out."""
    pull = np.bincount(cycle, weights=weight * slope * below, minlength=n)
    bend = np.bincount(cycle, weights=weight * slope**2, minlength=n)
    shift = np.clip(pull / np.maximum(bend, 1e-300), -limit, limit)
    return np.asarray(shift - np.mean(shift))
