"""Drift-free features of a stick-slip log: what one settled cycle of it looks like.

Per log the period, and the mean waveform folded around the fall, every cycle shifted onto the mean by its
own samples. A level that drifts and a normal force that relaxes leave them alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import LogData

Array = NDArray[np.float64]

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
    valley force [N]; drop [N]; cycles folded; time of its middle cycle [s]."""

    log: int
    drive_speed: float
    normal_force: float
    times: Array
    waveform: Array
    sd: Array
    period: float
    period_sd: float
    arrest: float
    drop: float
    cycles: int
    time: float


def extract(number: int, log: LogData, falls: Array, half_period: float) -> Features | None:
    """The features of a log, or None without a fall that can be folded.

    Args:
        number: of the log among all.
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
        level = _cycle_levels(local - shift[cycle], force, weight, cycle, edges, mean, count, settled.size)
        force = force - level[cycle]
        shift = shift + _cycle_shifts(local - shift[cycle], force, weight, cycle, edges, mean, count, settled.size)
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
        number,
        log.drive_speed,
        float(np.mean(log.normal_force.at(settled))),
        (0.5 * (edges[:-1] + edges[1:]))[used],
        mean[used],
        np.hypot(np.hypot(noise, MODEL_ERROR * drop), blur),
        period,
        float(period_sd),
        float(np.min(mean[used])),
        drop,
        int(settled.size),
        float(np.mean(settled)),
    )


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


def _cycle_levels(
    local: Array, force: Array, weight: Array, cycle: NDArray[np.int64], edges: Array, mean: Array, count: Array, n: int
) -> Array:
    """How far each cycle lies above the mean waveform (n,) [N], their average taken out."""
    value, _ = _against_mean(local, edges, mean, count)
    total = np.bincount(cycle, weights=weight, minlength=n)
    level = np.bincount(cycle, weights=weight * (force - value), minlength=n) / np.maximum(total, 1e-300)
    return np.asarray(level - np.mean(level))


def _cycle_shifts(
    local: Array, force: Array, weight: Array, cycle: NDArray[np.int64], edges: Array, mean: Array, count: Array, n: int
) -> Array:
    """One Gauss-Newton step of each cycle's time shift onto the mean waveform (n,) [s], their average taken out."""
    value, slope = _against_mean(local, edges, mean, count)
    pull = np.bincount(cycle, weights=weight * slope * (value - force), minlength=n)
    bend = np.bincount(cycle, weights=weight * slope**2, minlength=n)
    limit = 5 * (edges[1] - edges[0])
    shift = np.clip(pull / np.maximum(bend, 1e-300), -limit, limit)
    return np.asarray(shift - np.mean(shift))
