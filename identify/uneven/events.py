"""Sticks and slips of a record one by one: stick lines, first and last sample of every slip, in units of the load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from identify.logs.prepare import Prepared
from identify.logs.segment import DetectedCycles

Array = NDArray[np.float64]

CLEAR = 4.0  # deviations of the smoothed noise by which a sample is clearly off a line
LEAST = 0.03  # of the drop: nearer to a line than that is no slip, whatever the noise
NEAR = 3.0  # durations of the slip: so far before an onset, or after an arrest, goes the line of a stick
ENOUGH = 25  # samples for the level of a line
SMOOTHED = 3  # samples about an end of a slip whose mean is compared with a line
FINEST = 0.2  # of sqrt(m/k) between two samples: denser ones are averaged, so that a slip costs the same
LEAST_SAMPLES = 6  # of a slip: with fewer its course is not resolved
STIFFNESS_ERROR = 0.02  # relative, beside what its sticks scatter and how far they are from the stated one


@dataclass(frozen=True)
class RigConstants:
    """What a record itself shows of its rig, over the load.

    Attributes:
        stiffness: rate of the sticks over the drive speed [1/m]; rate: of the sticks [1/s]; load [N].
        stated: the stiffness of the scene [1/m], or that of the sticks where something soft is in series with it.
        error: relative standard error of the stiffness: how sticks scatter, and how far they are from what is stated.
        pace: sqrt(m/k) from the duration of the slips [s].
    """

    stiffness: float
    rate: float
    load: float = 1.0
    stated: float = 0.0
    error: float = STIFFNESS_ERROR
    pace: float = 0.0

    @property
    def drive_speed(self) -> float:
        """Speed at which the spring is loaded [m/s]."""
        return self.rate / self.stiffness

    def over_load(self, noise: float) -> tuple[float, ...]:
        """As functions of a slip take it, as `slip_functions.RIG` has it; noise: sd of a sample [1]."""
        return self.stiffness, self.rate, noise, self.load


@dataclass(frozen=True)
class Sticks:
    """What is measured of every cycle (c,), forces over the load [1].

    number: of the cycle in the record, from 1; follows: the cycle before is the one in the row before; anchor: time
    of the first sample off the stick line [s]; line: the stick line there; fallen: below it; rest: time from the arrest
    before to the anchor [s], NaN where that arrest was not detected; above: by how much the last sample of the slip is
    above the line of the next stick; arrest: that line at the arrest; time, force (c, n): the samples of a slip, padded
    at the end, from the anchor [s]; samples (c,): how many; noise: sd of a sample [1]; usual_rest: the rest to which
    the strength refers [s], the same for all records of a fit.
    """

    number: NDArray[np.int64]
    follows: NDArray[np.bool_]
    anchor: Array
    line: Array
    fallen: Array
    rest: Array
    above: Array
    arrest: Array
    time: Array
    force: Array
    samples: NDArray[np.int64]
    noise: float
    rig: RigConstants
    usual_rest: float

    @property
    def count(self) -> int:
        """Number of cycles."""
        return int(self.number.size)

    @property
    def drop(self) -> Array:
        """From the stick line at the onset to that of the next stick at the arrest (c,)."""
        return self.line - self.arrest


def sticks_of(log: Prepared, in_series: bool = False) -> Sticks:
    """The cycles that `logs` detected in a prepared log, with stick lines and samples of each slip.

    Cycles of which either cannot be made out are left out: `follows` says where the chain is broken. in_series:
    something soft is in series with the rig, so that its stiffness is that of the sticks at the drive speed, not the
    stated one.
    """
    data, cycles, slope = log.data, log.segmentation.cycles, log.segmentation.stick_slope
    mean, speed, used = data.mean_normal_force, data.drive_speed, data.weight > 0.0
    rate = (slope[0] if slope is not None else log.rig.stiffness * speed) / mean
    scatter = slope[1] / np.sqrt(max(cycles.count, 1)) if slope is not None else 0.0
    stated = rate / speed if in_series else log.rig.stiffness / mean
    time, force = data.time[used], (data.force / data.normal_force.at(data.time))[used]
    error = float(np.linalg.norm([STIFFNESS_ERROR, scatter, np.log(rate / speed / stated)]))
    rig = RigConstants(rate / speed, rate, mean, stated, error, _pace(time, force, cycles))
    rows, noise = list[_Row](), data.noise / mean
    if log.segmentation.samples_per_slip >= LEAST_SAMPLES:
        trace = _Normalised(time, force, noise, rig)
        for j in range(log.entry.skip_cycles, cycles.count):
            before = cycles.arrest[j - 1] if j else None
            after = cycles.onset[j + 1] if j + 1 < cycles.count else data.time[-1]
            rows += trace.rows(j + 1, before, (cycles.onset[j], cycles.fall[j], cycles.arrest[j]), after)
    return _assembled(rows, noise, rig)


def of_one_body(records: Sequence[Sticks], tolerance: float | None = None) -> list[Sticks]:
    """Records of one pair and slider: with the strength after the same rest, the median of all (faster records rest for
    shorter, and are weaker for that), and with one stiffness where one is stated: the mean of what their sticks show,
    and where the scene states a tolerance (relative), of both by their errors."""
    rests = np.concatenate([sticks.rest[np.isfinite(sticks.rest)] for sticks in records])
    usual = float(np.median(rests)) if rests.size else records[0].usual_rest
    ratios = np.log([sticks.rig.stiffness / sticks.rig.stated for sticks in records])
    error = float(np.sqrt(np.mean([sticks.rig.error**2 for sticks in records]) + np.var(ratios)))
    mean = np.mean(ratios)
    if tolerance:
        weight = error**-2 / (error**-2 + tolerance**-2)
        mean, error = weight * mean, weight**0.5 * error
    rigs = [replace(sticks.rig, stiffness=float(np.exp(mean)) * sticks.rig.stated, error=error) for sticks in records]
    return [replace(sticks, usual_rest=usual, rig=rig) for sticks, rig in zip(records, rigs, strict=True)]


def _pace(time: Array, force: Array, cycles: DetectedCycles) -> float:
    """Median of sqrt(m/k) over the cycles, by the time in which the force falls from a quarter to three quarters."""
    paces = []
    for start, stop in zip(cycles.onset, cycles.arrest, strict=True):
        low, high = np.searchsorted(time, [start, stop])
        if high - low >= 2:
            fall = np.maximum.accumulate(-force[low : high + 1])
            quarters = np.interp(fall[0] + (fall[-1] - fall[0]) * np.array([0.25, 0.75]), fall, time[low : high + 1])
            paces.append(3.0 / np.pi * (quarters[1] - quarters[0]))  # of half a cosine
    if paces and np.median(paces) > 0.0:
        return float(np.median(paces))
    return float(np.median(cycles.arrest - cycles.onset)) / np.pi if cycles.count else 1.0


class _Row(NamedTuple):
    """One cycle as `Sticks` has them; stopped: the arrest [s]; averaged: samples per mean."""

    number: int
    anchor: float
    line: float
    fallen: float
    above: float
    arrest: float
    stopped: float
    time: Array
    force: Array
    averaged: int


@dataclass(frozen=True)
class _Normalised:
    """Force over load of a record, of the samples that count, and their noise."""

    time: Array
    force: Array
    noise: float
    rig: RigConstants

    def rows(self, number: int, before: float | None, slip: tuple[float, float, float], after: float) -> list[_Row]:
        """Lines and samples of one cycle, [] where they cannot be made out; before, slip, after: arrest before it, its
        onset, fall and arrest, and the onset after it, as segmented [s]."""
        onset, fall, arrest = slip
        duration = arrest - onset
        start = before if before is not None else max(onset - 4.0 * duration, float(self.time[0]))
        # Near the ends of the slip only: sticks bend as they creep, and a line through all of one misses its end.
        near = max(NEAR * duration, ENOUGH * float(self.time[-1] - self.time[0]) / max(self.time.size - 1, 1))
        lines = []
        for end, stick, side in ((onset, onset - start, -1.0), (arrest, after - arrest, 1.0)):
            inner = end + side * min(0.25 * duration, 0.2 * stick)
            lines.append(self._line(*sorted((inner, inner + side * min(near, 0.6 * stick)))))
        rows = slice(*np.searchsorted(self.time, [max(start, onset - 2.0 * duration), min(arrest + duration, after)]))
        time, force = self.time[rows], self.force[rows]
        middle = int(np.searchsorted(time, fall))
        if any(line.size == 0 for line in lines) or not SMOOTHED <= middle <= time.size - SMOOTHED:
            return []
        rising, settled = lines
        smooth = scipy.ndimage.uniform_filter1d(force, SMOOTHED, mode="nearest")
        drop = float(np.polyval(rising, fall) - np.polyval(settled, fall))
        clear = max(CLEAR * self.noise / np.sqrt(SMOOTHED), LEAST * drop)
        off, height = np.polyval(rising, time) - smooth, smooth - np.polyval(settled, time)
        on_line, down = np.flatnonzero(off[:middle] < clear), np.flatnonzero(height[middle:] < clear)
        if drop <= 2.0 * clear or on_line.size == 0 or down.size == 0:
            return []
        first, last = int(on_line[-1]) + 1, middle + int(down[0]) - 1
        if last <= first or height[last] <= 0.0:
            return []
        # The rest of the way to the arrest, decelerated as an undamped slip of that drop is.
        left = self.rig.pace * float(np.sqrt(4.0 * height[last] / drop))
        stopped, anchor = min(float(time[last]) + left, arrest + duration), float(time[first])
        line, level = float(np.polyval(rising, anchor)), float(np.polyval(settled, stopped))
        if off[first] <= 0.0 or line - level <= off[first]:
            return []
        seen = _averaged(time[first : last + 1] - anchor, force[first : last + 1], FINEST * self.rig.pace)
        return [_Row(number, anchor, line, float(off[first]), float(height[last]), level, stopped, *seen)]

    def _line(self, start: float, stop: float) -> Array:
        """Slope and intercept by Huber's weights, the slope near that of all sticks; empty without samples."""
        low, high = np.searchsorted(self.time, [start, stop])
        if high - low < 2:
            return np.empty(0)
        time, force, rate = self.time[low:high], self.force[low:high], self.rig.rate
        noise = max(self.noise, 1e-12)
        slope, level = rate, float(np.median(force - rate * time))
        prior = (noise / (2.0 * rate)) ** 2
        for _ in range(4):
            weight = 1.0 / np.maximum(np.abs(force - level - slope * time) / (2.0 * noise), 1.0)
            centre, middle = np.average(time, weights=weight), np.average(force, weights=weight)
            moved = time - centre
            slope = float((weight @ (moved * (force - middle)) + prior * rate) / (weight @ moved**2 + prior))
            level = float(middle - slope * centre)
        return np.array([slope, level])


def _assembled(rows: Sequence[_Row], noise: float, rig: RigConstants) -> Sticks:
    """Rows side by side, and the rest before each."""
    samples = np.array([row.time.size for row in rows], dtype=np.int64)
    time, force = np.zeros((2, len(rows), int(samples.max(initial=0))))
    for j, row in enumerate(rows):
        time[j], force[j, : samples[j]] = row.time[-1], row.force
        time[j, : samples[j]] = row.time
    numbers = np.array([row[:7] for row in rows]).reshape(-1, 7)
    column = dict(zip(_Row._fields[1:7], numbers[:, 1:].T.copy(), strict=True))
    stopped, number = column.pop("stopped"), numbers[:, 0].astype(np.int64)
    rest = np.append(np.nan, column["anchor"][1:] - stopped[:-1])[: len(rows)]
    rest[~((np.diff(number, prepend=-1) == 1) & (rest > 0.0))] = np.nan
    usual = float(np.nanmedian(rest)) if np.isfinite(rest).any() else 1.0
    rest[rest > 3.0 * usual] = np.nan  # times the typical stick: a longer one hides a cycle that was not detected
    return Sticks(
        number=number,
        follows=np.isfinite(rest),
        rest=rest,
        time=time,
        force=force,
        samples=samples,
        # More than in the sticks: samples of a slip are also jittered in time.
        noise=1.15 * noise / np.sqrt(float(np.median([row.averaged for row in rows])) if rows else 1.0),
        rig=rig,
        usual_rest=float(np.nanmedian(rest)) if np.isfinite(rest).any() else 1.0,
        **column,
    )


def _averaged(time: Array, force: Array, step: float) -> tuple[Array, Array, int]:
    """Means a step apart, the first and the last sample by themselves, and how many samples a mean is of."""
    interval = float(np.median(np.diff(time))) if time.size > 1 else step
    many = max(1, int(step / interval))
    inner = (time.size - 2) // many
    if many == 1 or inner < LEAST_SAMPLES:
        return time, force, 1
    middle = [values[1 : 1 + inner * many].reshape(inner, many).mean(axis=1) for values in (time, force)]
    means = [np.r_[values[0], mean, values[-1]] for values, mean in zip((time, force), middle, strict=True)]
    return means[0], means[1], many
