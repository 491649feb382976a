"""The force of one simulated cycle, and drift-free features of a log: what one settled cycle of it looks like.

Per log the period, and the mean waveform folded around the fall, every cycle shifted onto the mean by its
own samples. A level that drifts and a normal force that relaxes leave them alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import LogData
from identify.model.model import Model
from identify.shooting.batch import Slips, load_cell

# ----------------------------------------------------------------------------------------------------------------------
# The force of one simulated cycle as a function of time: stick line, slip, stick line.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


def middle_of_fall(force: Array, h: Array, duration: Array) -> Array:
    """Time of the mid-fall crossing of each row's simulated force (n, steps) [s]."""
    steps, rows = np.arange(force.shape[1])[None, :], np.arange(force.shape[0])
    inside = steps * h[:, None] <= duration[:, None] + h[:, None]
    highest, lowest = (np.where(inside & np.isfinite(force), force, end) for end in (-np.inf, np.inf))
    with np.errstate(all="ignore"):
        level = 0.5 * (np.max(highest, axis=1) + np.min(lowest, axis=1))
    below = (force <= level[:, None]) & (steps > np.argmax(highest, axis=1)[:, None]) & inside
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
        around = np.pad(force, ((0, 0), (1, 1)), mode="edge")
        tilt = 0.5 * (around[:, 2:] - around[:, :-2])
        rise, first, last = np.diff(force, axis=1), tilt[:, :-1], tilt[:, 1:]
        cubics = [force[:, :-1], first, 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise]
        return Waves(h, duration, force[:, 0], end, slope, np.stack(cubics).reshape(4, -1))

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
        return self._at(t)[0]

    def with_rates(self, t: Array) -> tuple[Array, Array]:
        """Force (n, b) at times t (n, b) from the onset of each cycle, and its rates [N/s]."""
        value, c, w = self._at(t)
        rate = ((3.0 * c[3] * w + 2.0 * c[2]) * w + c[1]) / self.h[:, None]
        return value, np.where((t < 0.0) | (t > self.duration[:, None]), self.slope[:, None], rate)

    def _at(self, t: Array) -> tuple[Array, Array, Array]:
        """The force (n, b), the coefficients (4, n, b) of the step each time is in, and the share of it that passed."""
        rows, s = self.h.size, self.slope[:, None]
        steps = self.cubics.shape[1] // rows
        u = np.clip(t / self.h[:, None], 0.0, steps - 1e-6)
        i = u.astype(np.int64)
        c, w = np.take(self.cubics, i + steps * np.arange(rows)[:, None], axis=1), u - i
        late = t - self.duration[:, None]
        value = np.where(late > 0.0, self.end[:, None] + s * late, ((c[3] * w + c[2]) * w + c[1]) * w + c[0])
        return np.where(t < 0.0, self.start[:, None] + s * t, value), c, w


# ----------------------------------------------------------------------------------------------------------------------
# What a log shows.
# ----------------------------------------------------------------------------------------------------------------------

BINS = 40  # per half natural period
BEFORE, AFTER = 2.5, 2.0  # half periods around the middle of the fall
SHARE = 0.42  # of the period: the window never reaches the next fall
TIMING = 0.3  # of the time between samples: how well they tell a time


@dataclass(frozen=True)
class Features:
    """One settled cycle of one log. times (b,) [s] from the middle of the fall, waveform (b,) [N] at the mean
    normal force, sd (b,); period [s] and its sd (period_sd infinite where a log shows one fall only); arrest:
    valley force [N]; drop [N]; time of its middle cycle [s]."""

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


def extract(log: LogData, falls: Array, half_period: float) -> Features | None:
    """The features of a log, or None without a fall that can be folded.

    Args:
        falls: mid-fall times of its cycles (c,) [s].
        half_period: half the natural period [s].
    """
    if falls.size == 0:
        return None
    settled, periods = falls[1:] if falls.size >= 3 else falls, np.diff(falls)
    period = float(np.median(periods)) if periods.size else np.inf
    width = half_period / BINS
    lower, upper = -min(BEFORE * half_period, SHARE * period), min(AFTER * half_period, SHARE * period)
    edges = np.arange(np.floor(lower / width), np.ceil(upper / width) + 1) * width
    centres, bins = 0.5 * (edges[:-1] + edges[1:]), edges.size - 1
    local, force, weight, cycle = _fold(log, settled, edges)
    if local.size < 4:
        return None

    def per_cycle(values: Array) -> Array:
        return np.asarray(np.bincount(cycle, weights=values, minlength=settled.size), float)

    shift = np.zeros(settled.size)
    for sweep in range(4):
        index = np.floor((local - shift[cycle] - edges[0]) / width).astype(int)
        inside = (index >= 0) & (index < bins)
        count = np.bincount(index[inside], weights=weight[inside], minlength=bins)
        used = count > 0
        if np.count_nonzero(used) < 4:
            return None
        summed = np.bincount(index[inside], weights=(weight * force)[inside], minlength=bins)
        mean, times = summed[used] / count[used], centres[used]
        if sweep == 3:
            break
        # The level of every cycle onto the mean, then a Gauss-Newton step of its shift; their averages stay.
        value = np.interp(local - shift[cycle], times, mean)
        slope = np.interp(local - shift[cycle], times, np.gradient(mean, times))
        level = per_cycle(weight * (force - value)) / np.maximum(per_cycle(weight), 1e-300)
        force = force - (level - np.mean(level))[cycle]
        move = per_cycle(weight * slope * (value - force)) / np.maximum(per_cycle(weight * slope**2), 1e-300)
        move = np.clip(move, -5 * width, 5 * width)
        shift = shift + move - np.mean(move)
    drop, interval = float(np.ptp(mean)), log.interval
    # Where a fall holds few samples they do not tell when it was, and the mean of many is smeared.
    smeared = TIMING * interval * min(interval / half_period, 1.0) ** 2 * np.gradient(mean, edges[:-1][used])
    period_sd = 0.003 * period + TIMING * interval / np.sqrt(max(periods.size, 1)) if periods.size else np.inf
    if periods.size > 2:
        period_sd = max(period_sd, 1.25 * float(np.std(periods[1:])) / np.sqrt(periods.size - 1))
    return Features(
        log.drive_speed,
        float(np.mean(log.normal_force.at(settled))),
        times,
        mean,
        np.hypot(np.hypot(count[used] ** -0.5, 0.01 * drop), smeared),
        period,
        float(period_sd),
        float(np.min(mean)),
        drop,
        float(np.mean(settled)),
    )


def _fold(log: LogData, falls: Array, edges: Array) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Samples around each fall: local time, force at the mean normal force, weight, cycle."""
    first = np.searchsorted(log.time, falls + edges[0])
    lengths = np.maximum(np.searchsorted(log.time, falls + edges[-1]) - first, 0)
    ends = np.cumsum(lengths)
    number = np.arange(0, int(ends[-1]), max(int(ends[-1]) // (1 << 14), 1))
    cycle = np.searchsorted(ends, number, side="right")
    index = number + (first - (ends - lengths))[cycle]
    cycle, index = cycle[log.weight[index] > 0], index[log.weight[index] > 0]
    load = log.normal_force.at(falls)
    force = log.force[index] * (np.mean(load) / load)[cycle]
    return log.time[index] - falls[cycle], force, log.weight[index], cycle
