"""Stick and slip phases of a measured force, from the data alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from identify.noise import bridged, spikes, white_noise
from identify.zigzag import Turns, find_falls, smooth

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

STICK, SLIP, SLIDING = 0, 1, 2
STRAIGHT = (0.3, 0.7)  # share of a rise, in time, whose slope is the stick slope
ARRESTING = 0.93  # of the stick slope: a rise less steep than that comes from sliding, not from rest
LEAST_RISE = 0.5  # of what a stick would rise: an interval with less contains sliding
SLOWEST_FALL = 0.4  # of the stick slope: a slip falls faster
LAST_RISE = 0.6  # of the last fall's duration must follow it, else the slip may not be over
LINE_BLOCK = 24
MOST_POINTS = 400


@dataclass(frozen=True)
class Cycles:
    """One stick and the slip that ends it per entry, both complete; arrays of shape (c,), from the data only.

    onset: time of the force peak before the fall [s], with its force [N] from a local fit; fall: time
    at which the force crosses the middle of the fall [s], interpolated; arrest: time of the valley after
    it [s], with its force [N]. In fast logs the true onset lies before the peak (there the mass already
    moves as fast as the drive) and the true arrest after the valley.
    """

    onset: Array
    onset_force: Array
    fall: Array
    arrest: Array
    arrest_force: Array

    @property
    def count(self) -> int:
        """Number of cycles."""
        return int(self.onset.size)

    @property
    def drop(self) -> Array:
        """Peak minus valley [N], shape (c,)."""
        return self.onset_force - self.arrest_force

    @property
    def period(self) -> Array:
        """Time from fall to fall [s], shape (c - 1,)."""
        return np.diff(self.fall)


@dataclass(frozen=True)
class Segmentation:
    """Phases of a force record of n samples and figures of their quality.

    noise: sd of the white noise [N]; spikes: samples to mask, shape (n,), true also where the force is
    not finite; phase: int8 (n,), 0 stick, 1 slip (peak to valley), 2 sliding without stick-slip;
    begins_in_slip: the record starts within a slip (not counted); stick_slopes: slope of every stick
    that was seen completely [N/s], in order, the first ramp of a record that starts at rest apart in
    `loading_slope` (None without one); ends_sliding: steady or decaying sliding follows the last cycle.
    """

    cycles: Cycles
    noise: float
    spikes: NDArray[np.bool_]
    phase: NDArray[np.int8]
    begins_in_slip: bool
    ends_sliding: bool
    stick_slopes: Array
    loading_slope: float | None
    sample_interval: float

    @property
    def count(self) -> int:
        """Number of complete cycles."""
        return self.cycles.count

    @property
    def samples_per_slip(self) -> float:
        """Median number of samples from peak to valley; 0 without cycles."""
        return self._median(self.cycles.arrest - self.cycles.onset) / self.sample_interval

    @property
    def samples_per_cycle(self) -> float:
        """Median number of samples from fall to fall; 0 with fewer than two cycles."""
        return self._median(self.cycles.period) / self.sample_interval

    @property
    def drop(self) -> tuple[float, float] | None:
        """Mean and standard deviation of the drops [N]; None without cycles."""
        return _mean_and_sd(self.cycles.drop)

    @property
    def period(self) -> tuple[float, float] | None:
        """Mean and standard deviation of the periods [s]; None with fewer than two cycles."""
        return _mean_and_sd(self.cycles.period)

    @property
    def stick_slope(self) -> tuple[float, float] | None:
        """Median stick slope [N/s] and its relative scatter (1.48 MAD); None where no stick was seen."""
        slopes = self.stick_slopes
        if slopes.size == 0:
            return None if self.loading_slope is None else (self.loading_slope, 0.0)
        middle = float(np.median(slopes))
        return middle, float(1.4826 * np.median(np.abs(slopes - middle)) / abs(middle)) if middle else 0.0

    @property
    def spike_count(self) -> int:
        """Number of masked samples."""
        return int(np.count_nonzero(self.spikes))

    def share(self, phase: int) -> float:
        """Share of the samples in a phase (STICK, SLIP or SLIDING), 0 to 1."""
        return float(np.mean(self.phase == phase)) if self.phase.size else 0.0

    @staticmethod
    def _median(values: Array) -> float:
        return float(np.median(values)) if values.size else 0.0


def _mean_and_sd(values: Array) -> tuple[float, float] | None:
    if values.size == 0:
        return None
    return float(np.mean(values)), float(np.std(values, ddof=1)) if values.size > 1 else 0.0


def segment(time: Array, force: Array, *, half_period: float | None = None, noise: float | None = None) -> Segmentation:
    """Finds the sticks and slips of a force record.

    A slip is a fall of the smoothed force by more than the noise spans, with a rise before and after it.
    What then only rises less steeply than a stick, and decays, is sliding and no cycle.

    Args:
        time: rising [s], shape (n,), about evenly spaced.
        force: friction force, positive in the direction of sliding [N], shape (n,); NaN where not measured.
        half_period: pi sqrt(m/k) [s] where the rig is known: it bounds the smoothing.
        noise: standard deviation of the force [N] where it is known, else estimated.

    Raises:
        ValueError: time and force of different shapes.
    """
    time, force = np.asarray(time, dtype=np.float64), np.asarray(force, dtype=np.float64)
    if time.shape != force.shape or time.ndim != 1:
        raise ValueError(f"time {time.shape} and force {force.shape} are not two columns of one length")
    holes = ~np.isfinite(force)
    if time.size < 8 or holes.all():
        return _nothing(time, holes, noise or 0.0)
    clean = bridged(force, holes)
    white = white_noise(clean)
    masked = spikes(clean, max(white, noise or 0.0))
    clean = bridged(clean, masked)
    interval = float(np.median(np.diff(time)))
    sd = white if noise is None else noise
    turns = find_falls(clean, sd, None if half_period is None else half_period / interval)
    phases = _Phases(time, clean, sd, turns)
    measured = _noise_on_lines(clean, phases.phase, white) if noise is None else noise
    return Segmentation(
        cycles=phases.cycles(),
        noise=measured,
        spikes=masked | holes,
        phase=phases.phase,
        begins_in_slip=phases.begins_in_slip,
        ends_sliding=phases.ends_sliding,
        stick_slopes=phases.stick_slopes,
        loading_slope=phases.loading_slope,
        sample_interval=interval,
    )


def _nothing(time: Array, holes: NDArray[np.bool_], noise: float) -> Segmentation:
    none = np.empty(0)
    phase = np.full(time.size, SLIDING, dtype=np.int8)
    interval = float(np.median(np.diff(time))) if time.size > 1 else 1.0
    return Segmentation(Cycles(none, none, none, none, none), noise, holes, phase, False, False, none, None, interval)


def _slope(time: Array, force: Array, start: int, stop: int, noise: float) -> float:
    """Slope of the straight middle of a rise from sample start to stop [N/s]; outliers dropped once."""
    first = start + int(STRAIGHT[0] * (stop - start))
    last = max(start + int(np.ceil(STRAIGHT[1] * (stop - start))), first + 1)
    t, f = time[first : last + 1], force[first : last + 1]
    per = t.size // MOST_POINTS
    if per > 1:
        t, f = (column[: per * MOST_POINTS].reshape(-1, per).mean(axis=1) for column in (t, f))
        noise = noise / sqrt(per)
    if t.size < 2:
        return 0.0
    t, f = t - t.mean(), f - f.mean()
    slope = float(t @ f / (t @ t))
    residual = np.abs(f - slope * t)
    keep = residual < max(5.0 * noise, 4.0 * float(np.median(residual)))
    if keep.all() or np.count_nonzero(keep) < 4:
        return slope
    t, f = t[keep] - t[keep].mean(), f[keep] - f[keep].mean()
    return float(t @ f / (t @ t))


class _Phases:
    """Sorts the falls of a record into slips and sliding; indices of peaks and valleys are refined first."""

    def __init__(self, time: Array, force: Array, noise: float, turns: Turns) -> None:
        self.time, self.force, self.noise, self.turns = time, force, noise, turns
        self.coarse = smooth(force, turns.width)
        self.begins_in_slip = self.ends_sliding = False
        self.reference = 0.0
        self.stick_slopes: Array = np.empty(0)
        self.loading_slope: float | None = None
        self.kept = np.ones(turns.count, dtype=bool)
        self.peaks, self.valleys = self._fine_turns()
        self._judge()
        self.phase = self._label()

    def _fine_turns(self) -> tuple[Indices, Indices]:
        """Peaks and valleys again, with no more smoothing than the noise asks for."""
        turns = self.turns
        if turns.count == 0:
            return turns.peaks, turns.valleys
        drop = float(np.median(self.coarse[turns.peaks] - self.coarse[turns.valleys]))
        enough = int((self.noise / (0.03 * drop)) ** 2) | 1
        fine = smooth(self.force, min(enough, turns.width))
        peaks, valleys = np.empty(turns.count, dtype=np.int64), np.empty(turns.count, dtype=np.int64)
        last, reach = 0, turns.width // 2 + 1
        for i, (peak, valley) in enumerate(zip(turns.peaks.tolist(), turns.valleys.tolist(), strict=True)):
            following = int(turns.peaks[i + 1]) if i + 1 < turns.count else self.force.size - 1
            middle = peak + int(np.argmin(self.coarse[peak : valley + 1] > self._middle(peak, valley)))
            start, stop = max(peak - reach, last), min(valley + reach, following)
            peaks[i] = start + int(np.argmax(fine[start : middle + 1]))
            valleys[i] = last = middle + int(np.argmin(fine[middle : stop + 1]))
        return peaks, valleys

    def _middle(self, peak: int, valley: int) -> float:
        return 0.5 * float(self.coarse[peak] + self.coarse[valley])

    def _judge(self) -> None:
        """Which falls are slips: those that fall fast and that a stick follows."""
        time, force, peaks, valleys = self.time, self.force, self.peaks, self.valleys
        if peaks.size == 0:
            return
        slopes = np.array([_slope(time, force, v, p, self.noise) for v, p in zip(valleys[:-1], peaks[1:], strict=True)])
        drops = self.coarse[peaks] - self.coarse[valleys]
        first_rise = float(self.coarse[peaks[0]] - self.coarse[0])
        loading = not self.turns.starts_falling and first_rise > 1.3 * float(np.median(drops))
        first_slope = _slope(time, force, 0, int(peaks[0]), self.noise)
        reference = first_slope if loading or slopes.size == 0 else float(np.quantile(slopes, 0.75))
        self.loading_slope = first_slope if loading else None
        durations = time[valleys] - time[peaks]
        self.kept &= drops > SLOWEST_FALL * reference * durations
        self._reject_last(durations)
        self._reject_decaying(slopes / reference if reference > 0 else np.ones_like(slopes), drops, reference)
        self.begins_in_slip = self.turns.starts_falling and bool(self.kept.any())
        both = self.kept[:-1] & self.kept[1:]
        self.stick_slopes = slopes[both]
        self.reference = reference

    def _reject_last(self, durations: Array) -> None:
        """The last fall counts once its slip must be over."""
        after = self.time[-1] - self.time[self.valleys[-1]]
        if after < LAST_RISE * durations[-1]:
            self.kept[-1] = False

    def _reject_decaying(self, steepness: Array, drops: Array, reference: float) -> None:
        """A tail of ever smaller swings that never rise like a stick is sliding that settles."""
        tail = self.time[-1] - self.time[self.valleys[-1]]
        last_rise = float(np.max(self.coarse[self.valleys[-1] :]) - self.coarse[self.valleys[-1]])
        usual = float(np.median(np.diff(self.time[self.peaks]))) if self.peaks.size > 1 else 0.0
        settled = tail > 1.5 * usual and last_rise < LEAST_RISE * reference * tail
        if settled:
            end = int(self.valleys[-1] + np.argmax(self.coarse[self.valleys[-1] :]))
            last = _slope(self.time, self.force, int(self.valleys[-1]), end, self.noise) / max(reference, 1e-300)
            steepness = np.append(steepness, last)
        lazy = np.flatnonzero(steepness >= ARRESTING)
        start = int(lazy[-1]) + 1 if lazy.size else 0
        swings = steepness[start:]
        if swings.size == 0:
            return
        fading = swings.size >= 3 and drops[-1] < 0.85 * drops[start] and float(swings.min()) < 0.88
        if settled or fading:
            self.kept[start:] = False
            self.ends_sliding = True

    def _label(self) -> NDArray[np.int8]:
        phase = np.full(self.time.size, SLIDING, dtype=np.int8)
        peaks, valleys = self.peaks, self.valleys
        if not self.kept.any():
            self._label_without_cycles(phase)
            return phase
        start = 0
        if self.begins_in_slip:
            start = int(np.argmin(self.coarse[: peaks[0] + 1]))
            phase[:start] = SLIP
        for peak, valley, kept in zip(peaks.tolist(), valleys.tolist(), self.kept.tolist(), strict=True):
            if kept or start == 0:
                self._label_rise(phase, start, peak)
            if kept:
                phase[peak : valley + 1] = SLIP
            start = valley
        if self.kept[-1]:
            self._label_rise(phase, int(valleys[-1]), self.time.size - 1, tail=True)
        return phase

    def _label_rise(self, phase: NDArray[np.int8], start: int, stop: int, tail: bool = False) -> None:
        """Stick, or stick up to a knee and sliding from there."""
        rise = self.coarse[start : stop + 1] - self.coarse[start]
        if rise.size == 0:
            return
        expected = LEAST_RISE * self.reference * (self.time[stop] - self.time[start])
        if rise.max() >= expected or expected < 3.0 * self.turns.hysteresis:
            phase[start : stop + 1] = STICK
            return
        knee = int(np.argmax(rise >= 0.9 * rise.max()))
        phase[start : start + knee + 1] = STICK
        self.ends_sliding |= tail

    def _label_without_cycles(self, phase: NDArray[np.int8]) -> None:
        """Loading from rest up to the knee, then sliding; all stick where the force only rises."""
        wide = smooth(self.force, max(self.turns.width, self.time.size // 200) | 1)
        rise = wide - wide[0]
        if rise.max() < self.turns.hysteresis:
            return
        knee = int(np.argmax(rise >= 0.9 * rise.max()))
        slope = rise[knee] / max(self.time[knee] - self.time[0], 1e-300)
        self.loading_slope = _slope(self.time, self.force, 0, knee, self.noise)
        rest = self.time[-1] - self.time[knee]
        only_rising = rise[-1] - rise[knee] > LEAST_RISE * slope * rest
        phase[: None if only_rising else knee + 1] = STICK

    def cycles(self) -> Cycles:
        """The cycles that remain, with forces from local fits and interpolated falls."""
        rows = []
        for i in np.flatnonzero(self.kept):
            peak, valley = int(self.peaks[i]), int(self.valleys[i])
            before = int(self.valleys[i - 1]) if i else 0
            after = int(self.peaks[i + 1]) if i + 1 < self.peaks.size else self.time.size - 1
            inward = int(0.08 * (valley - peak))
            high = self._level(peak - _span(peak - before), peak + inward, peak)
            low = self._level(valley - inward, valley + _span(after - valley), valley)
            rows.append((self.time[peak], high, self._fall(peak, valley, high, low), self.time[valley], low))
        columns = np.array(rows, dtype=np.float64).reshape(-1, 5).T
        return Cycles(*columns)

    def _level(self, start: int, stop: int, at: int) -> float:
        """Force at a sample from a parabola (a line through few samples) fitted to start..stop."""
        f = self.force[start : stop + 1]
        if f.size < 4:
            return float(self.force[at])
        return float(_level_weights(at - start, stop - at) @ f)

    def _fall(self, peak: int, valley: int, high: float, low: float) -> float:
        """Time at which the fall crosses its middle [s]."""
        middle, drop = 0.5 * (high + low), high - low
        coarse = self.coarse[peak : valley + 1]
        steep = np.flatnonzero(np.abs(coarse - middle) < 0.25 * drop)
        if steep.size >= 4:
            t, f = self.time[peak + steep], self.force[peak + steep]
            centre = float(t.mean())
            t = t - centre
            slope = float(t @ (f - f.mean()) / (t @ t))
            if slope < 0:
                return float(np.clip(centre + (middle - f.mean()) / slope, self.time[peak], self.time[valley]))
        f = self.force[peak : valley + 1]
        below = int(np.argmax(f < middle)) if (f < middle).any() else f.size - 1
        i = peak + max(below, 1)
        step = self.force[i - 1] - self.force[i]
        share = (self.force[i - 1] - middle) / step if step > 0 else 0.5
        return float(self.time[i - 1] + min(max(share, 0.0), 1.0) * (self.time[i] - self.time[i - 1]))


@lru_cache(maxsize=4096)
def _level_weights(left: int, right: int) -> Array:
    """Weights that give the value of a fitted parabola (a line where one side is short) at sample `left`."""
    x = np.arange(-left, right + 1) / (left + right + 1)
    degree = 2 if min(left, right) >= 3 else 1
    weights: Array = np.linalg.pinv(np.vander(x, degree + 1, increasing=True))[0]
    return weights


def _span(rise: int) -> int:
    """How many samples of a rise of so many samples count for the level at its end."""
    return min(max(int(0.15 * rise), 4), 40, rise)


def _noise_on_lines(force: Array, phase: NDArray[np.int8], white: float) -> float:
    """Sd of the force about straight lines through blocks of the sticks [N]; `white` where sticks are too short."""
    stick = (phase == STICK).astype(np.int8)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], stick, [0]))))
    starts = [
        np.arange(first + (last - first) // 8, last - (last - first) // 8 - LINE_BLOCK + 1, LINE_BLOCK)
        for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    ]
    index = np.concatenate(starts) if starts else np.empty(0, dtype=np.int64)
    if index.size < 5:
        return white
    index = index[:: max(1, index.size // 4000)]
    blocks = force[index[:, None] + np.arange(LINE_BLOCK)]
    x = np.linspace(-1.0, 1.0, LINE_BLOCK)
    basis = np.linalg.qr(np.stack([np.ones(LINE_BLOCK), x, x**2], axis=1))[0]
    residual = blocks - (blocks @ basis) @ basis.T
    free = LINE_BLOCK - basis.shape[1]
    squares = np.median((residual**2).sum(axis=1)) / (free * (1.0 - 2.0 / (9.0 * free)) ** 3)
    return sqrt(float(squares))
