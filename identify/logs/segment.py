"""Stick and slip phases of a measured force: falls found by their prominence, and which of them are slips."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import log, sqrt

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from data_io.arrays import grid_step, kept, thinned_steps
from identify.base.quantiles import chi_square
from identify.logs.noise import SIGNIFICANT, bridged, line_slope, smooth, spikes, uneven, white_noise
from identify.model.composition import ForceSensorPlace

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]
Phase = NDArray[np.int8]
Resonance = tuple[float, float]  # of a rig: natural frequency [rad/s], damping ratio

STICK, SLIP, SLIDING = 0, 1, 2
FEWEST = 8  # samples of a log that can be looked at at all
SMALLEST_SHARE = 0.2  # of the typical drop: a smaller fall is no cycle of its own, and noise is to be below
NARROW, WIDE = 0.2, 0.45  # of the half period: the first average, and the widest, which does not bend a slip yet
LONG_INTERVAL = 1.6  # times the median: look again there
COLOURED, MOST_COLOURED = 1.5, 3.0  # times the white part that is left, and times the white part: noise with a memory
CLEAR = 6.0  # standard deviations of the average: of smaller slips many are lost in the noise
FEW_SLIPS, MOSTLY = 3, 0.5  # with fewer slips, which nothing compares, or more sliding, it is followed, not folded
STRAIGHT = (0.3, 0.7)  # share of a rise, in time, whose slope is the stick slope
ARRESTING = 0.93  # of the stick slope: a mass that slides on loads its spring less steeply
SLOWEST_FALL = 0.4  # of the stick slope: a slip falls faster
LEAST_RISE = 0.5  # of what a stick would rise: an interval with less contains sliding
FADED = (0.85, 0.94)  # drop and steepness of the last swing against the first, where swings settle
LOADING_RISE = 1.3  # times the typical drop: a first rise above that is loading from rest
LINE_BLOCKS = ((24, 3), (12, 2), (8, 2))  # samples, and degree of its line: a rise between fast slips is bent
WIDTHS, FEWEST_OF_SLIP = 16, 12  # windows of a slip, and samples of one, in which a jump is seen
JUMPS = 0.25  # of the drops, that jump under the counterface at least: as a rule half of them
SHARP = 0.75  # of a fall over the wide window, that a jump makes in the narrow one
SAME_FORCE = 3.0  # standard deviations by which two forces differ by chance
RESOLVED = 0.5  # of a natural period over 2 pi, that samples may lie apart to show what a resonance does
LONGER, MOST_LONGER = 1.015, 4.0  # times the noise in blocks twice as long: noise with a memory, and no noise any more


@dataclass(frozen=True)
class DetectedCycles:
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
    def middle(self) -> Array:
        """Middle between peak and valley [N], shape (c,): where an undamped slip is symmetric."""
        return 0.5 * (self.onset_force + self.arrest_force)

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
    `loading_slope` (None without one); ends_sliding: steady or decaying sliding follows the last cycle; low_snr: slips
    fall by so little that many of them are lost in the noise; other_falls: number of falls that stand out of the noise
    and are no slips; at_drive: of a plate the cycles in the force at the drive, in which slips are found.
    """

    cycles: DetectedCycles
    noise: float
    spikes: Bools
    phase: Phase
    begins_in_slip: bool
    ends_sliding: bool
    stick_slopes: Array
    loading_slope: float | None
    sample_interval: float
    low_snr: bool = False
    other_falls: int = 0
    at_drive: DetectedCycles | None = None

    @property
    def count(self) -> int:
        """Number of complete cycles."""
        return self.cycles.count

    @property
    def samples_per_slip(self) -> float:
        """Median number of samples from peak to valley; 0 without cycles."""
        return _median(self.cycles.arrest - self.cycles.onset) / self.sample_interval

    @property
    def samples_per_cycle(self) -> float:
        """Median number of samples from fall to fall; 0 with fewer than two cycles."""
        return _median(self.cycles.period) / self.sample_interval

    @property
    def drop_mean_and_sd(self) -> tuple[float, float] | None:
        """Mean and standard deviation of the drops [N], the first breakaway apart where slips follow it: its rest is of
        any length; None without cycles."""
        apart = self.count > 1 and self.loading_slope is not None
        return _mean_and_sd(self.cycles.drop[1:] if apart else self.cycles.drop)

    @property
    def period_mean_and_sd(self) -> tuple[float, float] | None:
        """Mean and standard deviation of the periods [s]; None with fewer than two cycles."""
        return _mean_and_sd(self.cycles.period)

    @property
    def stick_slope(self) -> tuple[float, float] | None:
        """Median stick slope [N/s] and its relative scatter (1.48 MAD); None where no stick was seen."""
        slopes = self.stick_slopes
        if slopes.size == 0:
            return None if self.loading_slope is None else (self.loading_slope, 0.0)
        middle = float(np.median(slopes))
        return middle, 1.4826 * _median(np.abs(slopes - middle)) / abs(middle) if middle else 0.0

    @property
    def spike_count(self) -> int:
        """Number of masked samples."""
        return int(np.count_nonzero(self.spikes))

    def share(self, phase: int) -> float:
        """Share of the samples in a phase (STICK, SLIP or SLIDING), 0 to 1."""
        return float(np.mean(self.phase == phase)) if self.phase.size else 0.0

    def slides_on(self, slips: int) -> bool:
        """Whether the record slides after so many slips, which are few or a small part of it."""
        return self.ends_sliding and (slips < FEW_SLIPS or self.share(SLIDING) > MOSTLY)


def _median(values: Array) -> float:
    return float(np.median(values)) if values.size else 0.0


def _mean_and_sd(values: Array) -> tuple[float, float] | None:
    if values.size == 0:
        return None
    return float(np.mean(values)), float(np.std(values, ddof=1)) if values.size > 1 else 0.0


def segment(
    time: Array,
    force: Array,
    *,
    half_period: float | None = None,
    noise: float | None = None,
    slips: bool = True,
    plate: Resonance | None = None,
) -> Segmentation:
    """Finds the sticks and slips of a force record.

    A slip is a fall of the averaged force by more than the noise spans, faster than the rises beside it, with a rise
    before and after it. What then only rises less steeply than a stick, and decays, is sliding and no cycle. Whether
    the falls of a whole record are slips is judged in `regime.classify`.

    Args:
        time: rising [s], shape (n,), about evenly spaced.
        force: friction force, positive in the direction of sliding [N], shape (n,); NaN where not measured.
        half_period: pi sqrt(m/k) [s] where the rig is known: it bounds the average.
        noise: standard deviation of the force [N] where it is known, else estimated.
        slips: False where it is known that no fall of it is one: loading, then sliding.
        plate: the resonance of the rig where the force is measured under the counterface: slips are found in the force
            at the drive, and have the times and forces of the measured one.

    Raises:
        ValueError: time and force of different shapes.
    """
    time, force = np.asarray(time, dtype=np.float64), np.asarray(force, dtype=np.float64)
    if time.shape != force.shape or time.ndim != 1:
        raise ValueError(f"time {time.shape} and force {force.shape} are not two columns of one length")
    holes = ~np.isfinite(force)
    none = np.empty(0)
    if time.size < FEWEST or holes.all():
        interval = float(np.median(thinned_steps(time))) if time.size > 1 else 1.0
        phase = np.full(time.size, SLIDING, dtype=np.int8)
        cycles = DetectedCycles(none, none, none, none, none)
        return Segmentation(cycles, noise or 0.0, holes, phase, False, True, none, None, interval)
    clean = bridged(force, holes)
    stamps = time if uneven(time) else None
    white = white_noise(clean, stamps)
    # What slides moves as its track and its noise do: a spike stands out of these, and a dip with a floor is none.
    steps = 0.0 if slips else 1.4826 * float(np.median(np.abs(np.diff(clean)))) / sqrt(2.0)
    masked = spikes(clean, max(white, noise or 0.0, steps), floors=not slips)
    clean = bridged(clean, masked)
    interval = float(np.median(thinned_steps(time)))
    sd = white if noise is None else noise
    seen = clean if plate is None else drive_force(time, clean, *plate)
    trace = _traced(time, seen, sd, None if half_period is None else half_period / interval, slips)
    judged = _judge(trace)
    phase, ends_sliding = _label(judged)
    cycles, at_drive = _cycles(judged), None
    if seen is not clean:
        cycles, at_drive = _at_jumps(cycles, time, clean), cycles
    lasting = half_period or _median(cycles.arrest - cycles.onset)
    low_snr = cycles.count > 0 and _median(cycles.drop) * sqrt(max(NARROW * lasting / interval, 1.0)) < CLEAR * sd
    loading = judged.loading_slope
    if not judged.slips.any():
        knee = _loading_knee(trace)
        loading = trace.slope(0, knee) if knee else None
    if noise is None:  # what lies between slips lost in it holds others; never less than the rounding of the file
        edges = [0, *(np.flatnonzero(np.diff(phase)) + 1).tolist(), int(phase.size)]
        rests = [(first, end) for first, end in pairwise(edges) if phase[first] != SLIP]
        if at_drive is not None and at_drive.count > 1:  # where it rises at the drive the mass slides in part
            ends = np.searchsorted(time, [cycles.arrest[:-1], cycles.onset[1:]])
            rests = [(first, end) for first, end in ends.T.tolist() if first < end]
        about_lines = None if low_snr else noise_on_lines(clean, rests, stamps)
        noise = max(about_lines or white, grid_step(kept(force, ~holes)[: 1 << 15]) / sqrt(12.0))
    return Segmentation(
        cycles=cycles,
        noise=noise,
        spikes=masked | holes,
        phase=phase,
        begins_in_slip=trace.starts_falling and bool(judged.slips.any()),
        ends_sliding=ends_sliding,
        stick_slopes=judged.slopes[judged.slips[:-1] & judged.slips[1:]],
        loading_slope=loading,
        sample_interval=interval,
        low_snr=low_snr,
        other_falls=int(np.count_nonzero(~judged.slips)),
        at_drive=at_drive,
    )


# Falls of an average that doubles until the noise is a fifth of the drop.


@dataclass(frozen=True)
class _Trace:
    """A force without spikes and its falls: time [s], force and its average over `width` samples [N], each (n,); sd of
    the noise; sample indices of peaks and valleys (c,), the threshold of their prominence [N]; starts_falling: a fall
    began before the record; slips (c,): which falls are; slopes (c - 1,) of the rises between them, the stick slope
    that they are compared with, loading_slope of a first rise from rest, else None [N/s]; ends_sliding: swings that
    settle, not slips, end the record."""

    time: Array
    force: Array
    noise: float
    coarse: Array
    width: int
    threshold: float
    peaks: Indices
    valleys: Indices
    starts_falling: bool
    slips: Bools = field(default_factory=lambda: np.ones(0, bool))
    slopes: Array = field(default_factory=lambda: np.empty(0))
    stick_slope: float = 0.0
    loading_slope: float | None = None
    ends_sliding: bool = False

    @property
    def drops(self) -> Array:
        """By how much the average falls (c,) [N]."""
        return np.asarray(self.coarse[self.peaks] - self.coarse[self.valleys])

    @property
    def last(self) -> int:
        """Index of the last sample."""
        return int(self.time.size) - 1

    def rise(self, start: int, stop: int) -> float:
        """Highest average from start to stop above that at start [N]."""
        return float(np.max(self.coarse[start : stop + 1]) - self.coarse[start])

    def duration(self, start: int, stop: int) -> float:
        """Time between two samples [s]."""
        return float(self.time[stop] - self.time[start])

    def slope(self, start: int, stop: int) -> float:
        """Slope of the straight middle of a rise from sample start to stop [N/s]; outliers are dropped once."""
        first = start + int(STRAIGHT[0] * (stop - start))
        last = max(start + int(np.ceil(STRAIGHT[1] * (stop - start))), first + 1)
        return line_slope(self.time[first : last + 1], self.force[first : last + 1], self.noise)


def _traced(time: Array, force: Array, noise: float, half_period: float | None, slips: bool) -> _Trace:
    """A force (n,) whose noise has a white part of this sd [N], and its falls; half_period in samples where it is
    known; slips: False where no fall counts."""
    none = np.empty(0, dtype=np.int64)
    widest = force.size / 20 if half_period is None else WIDE * half_period
    width = 1 if half_period is None else max(1, int(NARROW * half_period)) | 1
    best, quiet = None, 0.0
    while best is None or width <= widest:
        values, left = smooth(force, width), noise / sqrt(width)
        means = values[width // 2 :: width][: force.size // width]
        if width >= 3 and means.size >= 30:
            # Noise with a memory leaves more: the quietest tenth of second differences (most may hold a slip) is below
            # 0.01579 sd^2.
            seen = sqrt(float(np.quantile(np.diff(means, 2) ** 2, 0.1)) / 0.01579 / 6.0)
            left = left if seen < COLOURED * left else min(seen, MOST_COLOURED * noise)
        threshold = max((_span_of_noise(force.size / width) + 1.0) * left, 1e-9 * float(np.ptp(force)))
        empty = _Trace(time, force, noise, values, width, threshold, none, none, False)
        trace = _with_falls(empty, threshold, SIGNIFICANT * left)
        if best is None or trace.peaks.size >= best.peaks.size:
            best, quiet = trace, left
        if trace.peaks.size:
            lasting = float(np.median(trace.valleys - trace.peaks))
            smallest = SMALLEST_SHARE * float(np.median(trace.drops[trace.drops >= np.median(trace.drops)]))
            if threshold <= smallest and half_period is None and (int(0.1 * lasting) | 1) > width:
                width = int(0.1 * lasting) | 1  # of a slip: its shape stays, and its noise goes
                continue
            if threshold <= smallest:
                best = _with_falls(empty, smallest, min(smallest, SIGNIFICANT * left))
                break
            if half_period is None:
                widest = min(widest, 0.55 * lasting)
        width = 2 * width + 1
    if not slips:
        return replace(best, peaks=none, valleys=none, starts_falling=False)
    if best.peaks.size < FEW_SLIPS:
        return best
    # Searched again, less strictly, where the interval between falls is suspiciously long.
    longest, values = LONG_INTERVAL * float(np.median(np.diff(best.peaks))), best.coarse
    lenient = max(_span_of_noise(longest / best.width) * quiet, 2.0 * SMALLEST_SHARE * float(np.median(best.drops)))
    if lenient >= best.threshold:
        return best
    more, edges = _with_falls(best, lenient, lenient).peaks, np.concatenate([[0], best.peaks, [values.size]])
    peaks = np.union1d(best.peaks, more[np.diff(edges)[np.searchsorted(edges, more, side="right") - 1] > longest])
    valleys = [a + int(np.argmin(values[a:b])) for a, b in pairwise([*peaks.tolist(), values.size])]
    return replace(best, peaks=peaks, valleys=np.array(valleys), threshold=lenient)


def _span_of_noise(averages: float) -> float:
    """How many standard deviations white noise alone hardly ever spans in so many averages."""
    return 2.0 * sqrt(2.0 * log(max(averages, 8.0)))


def _turning_points(values: Array, height: float) -> tuple[Indices, Indices]:
    """Indices of the peaks that stand out by more than a height, and of the valley after each (n,).

    The extremes of a hysteresis: `scipy.signal.find_peaks(prominence=height)` says the same, takes a tenth of the
    processor time of a fit to load, and leaves peaks of one height without a fall between them.
    """
    turns, sign, extreme, at = list[int](), -1.0, -float(values[0]), 0  # first a valley is looked for
    for i, value in enumerate(values.tolist()):
        if sign * value >= extreme:
            extreme, at = sign * value, i
        elif extreme - sign * value > height:
            turns.append(at)
            sign, extreme, at = -sign, -sign * value, i
    turns += [at] if sign < 0 else []
    return np.array(turns[1::2], dtype=np.int64), np.array(turns[2::2], dtype=np.int64)


def _with_falls(trace: _Trace, threshold: float, last_rise: float) -> _Trace:
    """The falls whose peaks are as prominent, with a rise of more than `last_rise` after the last of them [N]."""
    values = trace.coarse
    block = max(values.size >> 14, trace.width // 4)  # of whose extremes the prominences of a longer record are
    corners = np.arange(values.size)
    if block > 2:
        table = values[: values.size // block * block].reshape(-1, block)
        within = np.stack([table.argmin(axis=1), table.argmax(axis=1)], axis=1)
        within += block * np.arange(table.shape[0])[:, None]
        corners = np.unique(np.append(within.ravel(), values.size - 1))
    reduced = values[corners]
    peaks, valleys = _turning_points(reduced, threshold)
    if peaks.size and float(np.max(reduced[valleys[-1] :]) - reduced[valleys[-1]]) <= last_rise:
        peaks, valleys = peaks[:-1], valleys[:-1]
    before = reduced[: peaks[0] + 1] if peaks.size else reduced
    low = int(np.argmin(before))
    falling = float(np.max(before[: low + 1])) - float(before[low]) > threshold
    return replace(trace, peaks=corners[peaks], valleys=corners[valleys], threshold=threshold, starts_falling=falling)


# Which falls are slips.


def _judge(trace: _Trace) -> _Trace:
    """Sorts falls into slips and sliding: a slip falls faster than the sticks rise, and a stick follows it."""
    peaks, valleys = _corners(trace)
    if peaks.size == 0:
        return trace
    rises = zip(valleys[:-1].tolist(), peaks[1:].tolist(), strict=True)
    slopes, first = np.array([trace.slope(a, b) for a, b in rises]), trace.slope(0, int(peaks[0]))
    drops, durations = trace.coarse[peaks] - trace.coarse[valleys], trace.time[valleys] - trace.time[peaks]
    loading = not trace.starts_falling and trace.rise(0, int(peaks[0])) > LOADING_RISE * float(np.median(drops))
    usual = first
    if slopes.size:
        order = np.argsort(slopes)
        total = np.cumsum(np.maximum(trace.coarse[peaks[1:]] - trace.coarse[valleys[:-1]], 0.0)[order])
        usual = float(slopes[order][int(np.searchsorted(total, 0.6 * total[-1]))])  # large rises count more
    reference = first if loading and slopes.size < FEW_SLIPS else usual
    slips = drops > SLOWEST_FALL * reference * durations
    # The last slip must have come to rest within the record; in fast logs it does so after the valley.
    last, after = int(valleys[-1]), trace.duration(int(valleys[-1]), trace.last)
    if 0.3 * durations[-1] <= after < 0.6 * durations[-1]:
        late = slice(last + (trace.last - last) // 2, None)
        steep = line_slope(trace.time[late], trace.force[late], trace.noise) >= ARRESTING * reference
        slips[-1] &= steep and trace.last - last >= 8
    else:
        slips[-1] &= after >= 0.6 * durations[-1]
    trace = replace(trace, peaks=peaks, valleys=valleys, slips=slips, slopes=slopes, stick_slope=reference)
    # Where the force never again rises like a stick, and swings fade, it slides.
    compared, settling, rise = first if loading else usual, peaks.size, trace.rise(last, trace.last)
    if compared > 0.0:
        steepness = slopes / compared
        settled = after > 1.5 * _median(np.diff(trace.time[peaks])) and rise < LEAST_RISE * compared * after
        if settled:
            top = last + int(np.argmax(trace.coarse[last:] - trace.coarse[last] >= 0.9 * rise))
            steepness = np.append(steepness, trace.slope(last, top) / compared)
        sticking = np.flatnonzero(steepness >= ARRESTING)
        start = int(sticking[-1]) + 1 if sticking.size else 0
        swings, falls = steepness[start:], drops[max(start, 1) :]  # the first drop, after loading, is larger anyway
        # One or two are no slips where steady sliding follows; several where they also fade.
        few = swings.size < 3 or falls.size < 2
        fade = not few and falls[-1] < FADED[0] * falls[0] and swings[-1] < FADED[1] * swings[0]
        settling = start if fade or (few and swings.size and settled) else settling
    slips[settling:] = False
    return replace(trace, loading_slope=first if loading else None, ends_sliding=settling < peaks.size)


def _corners(trace: _Trace) -> tuple[Indices, Indices]:
    """Peaks and valleys again, averaged no more than the noise asks for."""
    peaks, valleys, coarse = trace.peaks.copy(), trace.valleys.copy(), trace.coarse
    if peaks.size == 0:
        return peaks, valleys
    width = min(int((trace.noise / (0.03 * float(np.median(trace.drops)))) ** 2) | 1, trace.width)
    fine, within = smooth(trace.force, width), 3.0 * trace.noise / sqrt(width)

    def corner(climb: Array) -> int:  # the first sample as high as the highest within the noise; of a round crest that
        top = int(np.argmax(climb))
        first = int(np.argmax(climb >= climb[top] - within))
        return first if first < 1.2 * (top - first) else top

    last, reach = 0, trace.width // 2 + 1
    following = [*trace.peaks[1:].tolist(), trace.last]
    for i, (peak, valley) in enumerate(zip(trace.peaks.tolist(), trace.valleys.tolist(), strict=True)):
        fall = coarse[peak : valley + 1]
        middle = peak + int(np.argmin(fall > 0.5 * (fall[0] + fall[-1])))
        start, stop = max(peak - reach, last), min(valley + reach, following[i])
        peaks[i] = middle - corner(fine[start : middle + 1][::-1])
        valleys[i] = last = middle + corner(-fine[middle : stop + 1])
    return peaks, valleys


def _label(trace: _Trace) -> tuple[Phase, bool]:
    """Phase of every sample, int8 (n,), and whether sliding ends the record."""
    phase = np.full(trace.time.size, SLIDING, dtype=np.int8)
    if not trace.slips.any():
        if knee := _loading_knee(trace):  # loading from rest, then sliding; all stick where the force only rises
            phase[: knee + 1] = STICK
        return phase, bool(phase[-1] == SLIDING)

    def rises(start: int, stop: int) -> bool:
        """Stick, or stick up to a knee and sliding from there; whether it is all stick."""
        expected = LEAST_RISE * trace.stick_slope * trace.duration(start, stop)
        rise = trace.coarse[start : stop + 1] - trace.coarse[start]
        whole = bool(rise.max() >= expected or expected < 3.0 * trace.threshold)
        end = stop if whole else start + int(np.argmax(rise >= 0.9 * rise.max()))
        phase[start : end + 1] = STICK
        return whole

    start, resting = 0, True
    if trace.starts_falling:
        start = int(np.argmin(trace.coarse[: trace.peaks[0] + 1]))
        phase[:start] = SLIP
    for peak, valley, slips in zip(trace.peaks.tolist(), trace.valleys.tolist(), trace.slips.tolist(), strict=True):
        if slips or resting:
            rises(start, peak)
        if slips:
            phase[peak : valley + 1] = SLIP
        start, resting = valley, slips
    sticks = not trace.slips[-1] or rises(int(trace.valleys[-1]), trace.last)
    return phase, trace.ends_sliding or not sticks


def _loading_knee(trace: _Trace) -> int:
    """Sample at which the loading of a record without slips ends; 0 where nothing was loaded."""
    width = max(3, trace.time.size // 200) | 1
    wide = smooth(trace.force, width)
    rise = wide - wide[0]
    if rise.max() < max(trace.threshold, 10.0 * trace.noise / sqrt(width)):
        return 0
    knee = int(np.argmax(rise >= 0.9 * rise.max()))
    if rise[knee] <= 0.5 * abs(wide[knee]):  # a first rise by less is no loading, the level wanders
        return 0
    per_time = rise[knee] / max(trace.duration(0, knee), 1e-300)
    only_rising = rise[-1] - rise[knee] > LEAST_RISE * per_time * trace.duration(knee, trace.last)
    return trace.last if only_rising else knee


# Forces at the ends of slips, times of falls, noise about the sticks.


def _cycles(trace: _Trace) -> DetectedCycles:
    """The slips with forces from local fits and interpolated falls."""
    rows = []

    def span(rise: int) -> int:  # how many samples of a rise count for the level at its end
        return min(max(int(0.15 * rise), 4), 40, rise)

    for i in np.flatnonzero(trace.slips):
        peak, valley = int(trace.peaks[i]), int(trace.valleys[i])
        before = int(trace.valleys[i - 1]) if i else 0
        after = int(trace.peaks[i + 1]) if i + 1 < trace.peaks.size else trace.last
        inward = int(0.08 * (valley - peak))
        high = _level(trace.force, peak - span(peak - before), peak + inward, peak)
        low = _level(trace.force, valley - inward, valley + span(after - valley), valley)
        fall, middle = slice(peak, valley + 1), 0.5 * (high + low)
        time, force = trace.time[fall], trace.force[fall]
        below = max(int(np.argmax(force < middle)) if np.any(force < middle) else force.size - 1, 1)
        share = (middle - force[below]) / max(force[below - 1] - force[below], 1e-300)
        crossed = float(time[below] - (time[below] - time[below - 1]) * min(max(share, 0.0), 1.0))
        steep = np.flatnonzero(np.abs(trace.coarse[fall] - middle) < 0.25 * (high - low))
        if steep.size >= 4:  # by a line, to a fraction of a sample
            t, f = time[steep], force[steep]
            steepness = float((t - t.mean()) @ (f - f.mean()) / np.sum((t - t.mean()) ** 2))
            if steepness < 0:
                crossed = float(np.clip(t.mean() + (middle - f.mean()) / steepness, time[0], time[-1]))
        rows.append((trace.time[peak], high, crossed, trace.time[valley], low))
    return DetectedCycles(*np.array(rows, dtype=np.float64).reshape(-1, 5).T)


def _at_jumps(cycles: DetectedCycles, time: Array, force: Array) -> DetectedCycles:
    """Cycles seen in the force at the drive with onset and arrest of the force under the counterface (n,): its highest
    before the fall, and the jump after it."""
    rows, before = [], 0
    for i, fall in enumerate(cycles.fall.tolist()):
        following = float(cycles.onset[i + 1]) if i + 1 < cycles.count else float(time[-1])
        end = min(fall + 2.0 * float(cycles.arrest[i] - cycles.onset[i]), following)
        middle, last = np.searchsorted(time, [fall, max(end, float(cycles.arrest[i]))]).tolist()
        jump = middle + int(np.argmax(force[middle:last] - force[middle + 1 : last + 1]))
        width = max((jump - middle) // 8, 1) | 1
        peak = before + int(np.argmax(smooth(force[before : middle + 1], width)))
        high = _level(force, max(peak - 2 * width, before), peak + width // 2, peak)
        low = _level(force, jump + 1, min(jump + 1 + 4 * width, force.size - 1), jump + 1)
        rows.append((time[peak], high, fall, time[jump + 1], low))
        before = jump + 1
    return DetectedCycles(*np.array(rows, dtype=np.float64).reshape(-1, 5).T)


def _level(force: Array, start: int, stop: int, at: int) -> float:
    """Force at sample `at` from a parabola (a line where one side is short) through samples start to stop [N]."""
    f, x = force[start : stop + 1], np.arange(start, stop + 1) - at
    return float(np.polyfit(x, f, 2 if min(-x[0], x[-1]) >= 3 else 1)[-1]) if f.size >= 4 else float(force[at])


def drive_force(time: Array, force: Array, frequency: float, zeta: float) -> Array:
    """The force [N] (n,) that a load cell at the drive would show where a plate under the counterface shows this one.

    The rig is a mass on a spring and damper with this friction on it, m x'' = pull - friction, so that the pull is the
    friction through its resonance: (c s + k)/(m s^2 + c s + k), exact for a force that is linear between samples. Where
    both agree within the noise nothing accelerates the mass, and the force stands as it is, or that resonance would
    ring with the noise through every stick. The force itself where its samples do not resolve that resonance.

    Args:
        time: (n,) [s]; force: finite. frequency: natural frequency of the rig [rad/s]; zeta: its damping ratio.
    """
    from scipy.signal import cont2discrete, lfilter  # which take a third of a second to load

    interval = float(np.median(thinned_steps(time)))
    if not frequency * interval < RESOLVED:
        return force
    noise = white_noise(force)
    even = np.arange(time[0], time[-1] + 0.5 * interval, interval)
    clean = np.interp(even, time, force)
    numerator, denominator = [2.0 * zeta * frequency, frequency**2], [1.0, 2.0 * zeta * frequency, frequency**2]
    above, below, _ = cont2discrete((numerator, denominator), interval, "foh")
    first = slice(max(int(np.pi / (frequency * interval)), 2))  # half a period: it begins at rest, along that line
    line = clean[0] + line_slope(even[first], clean[first], noise) * (even - even[0])
    out = np.interp(time, even, lfilter(above.ravel(), below, clean - line) + line)
    width = max(int(np.pi / (8.0 * frequency * interval)), 1) | 1  # an eighth of half a period
    rings = noise * sqrt(1.0 / width + frequency * interval / (4.0 * max(zeta, 1e-3)))  # white noise, what it rings by
    return np.where(np.abs(smooth(out - force, width)) < SAME_FORCE * rings, force, out)


def jumps(
    force: Array, phases: Segmentation, slip: float, signs: Array | NDArray[np.int64] | None = None
) -> tuple[int, int]:
    """How many drops of a force (n,) [N] are jumps from one sample to the next, and how many drops there are.

    A smooth fall is four times as high over a window of four times the width, a jump as high. Under the counterface
    the force jumps at every arrest, and falls once more at the onset; at the drive it swings.

    Args:
        phases: of the force; slip: how many samples a slip takes, 0: as in these; too few show nothing: (0, 0); signs:
            (n,) of strokes, which are looked at one by one: where the drive turns nothing drops.
    """
    if signs is not None:
        edges = [0, *(1 + np.flatnonzero(np.diff(signs))).tolist(), force.size]
        each = [
            jumps(signs[a] * force[a:b], replace(phases, spikes=phases.spikes[a:b]), slip) for a, b in pairwise(edges)
        ]
        return sum(count for count, _ in each), sum(drops for _, drops in each)
    slip, noise, holes = slip or phases.samples_per_slip, phases.noise, ~np.isfinite(force) | phases.spikes
    width = max(int(slip / WIDTHS), 1)
    if not slip > FEWEST_OF_SLIP or force.size <= 16 * width or holes.all():
        return 0, 0
    sums, at = np.concatenate([[0.0], np.cumsum(bridged(force, holes))]), np.arange(4 * width, force.size - 4 * width)
    narrow, wide = ((2.0 * sums[at] - sums[at - w] - sums[at + w]) / w for w in (width, 4 * width))
    least = max(0.15 * float(np.max(wide)), 8.0 * noise / sqrt(width))
    ends = np.flatnonzero(np.diff(wide > least, prepend=False, append=False))  # of one fall after the other
    highest, sharpest = (np.maximum.reduceat(np.append(fall, 0.0), ends)[::2] for fall in (wide, narrow))
    return int(np.count_nonzero(sharpest > SHARP * highest)), int(highest.size)


def sensor_place(count: int, drops: int) -> ForceSensorPlace | None:
    """Where a force was measured of which so many drops are jumps; None where there are too few to say."""
    if drops < FEW_SLIPS:
        return None
    return "counterface" if count > JUMPS * drops else "drive"


def noise_on_lines(force: Array, sticks: Iterable[tuple[int, int]], time: Array | None = None) -> float | None:
    """Sd of the force about gently curved lines through blocks of the sticks [N].

    Blocks with much more than the median (an unseen spike or slip) are left out; the mean of the others is
    nearly as precise as all the samples allow, which a test of chi^2 needs. Noise with a memory shows all of itself
    only in long blocks: the longest are doubled as long as that makes it larger, up to what is no noise any more.

    Args:
        force: shape (n,) [N].
        sticks: first sample and end of each stick; an eighth is left out at either end.
        time: shape (n,) [s] of uneven rows; None for even ones.

    Returns: None where there are fewer than five blocks of eight samples.
    """
    inner = [(first + (last - first) // 8, last - (last - first) // 8) for first, last in sticks]

    def about(length: int, degree: int, fewest: int) -> float | None:
        index = np.concatenate([np.empty(0, np.int64), *(np.arange(a, b - length + 1, length) for a, b in inner)])
        if index.size < fewest:
            return None
        index = index[:: max(1, index.size // 4000)]
        blocks = sliding_window_view(force, length)[index]
        if time is None:
            basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, length), degree + 1))[0]
            blocks -= (blocks @ basis) @ basis.T
        else:
            stamps = sliding_window_view(time, length)[index]
            middle, half = stamps.mean(axis=1, keepdims=True), 0.5 * np.ptp(stamps, axis=1, keepdims=True)
            basis = np.linalg.qr(((stamps - middle) / half)[..., None] ** np.arange(degree + 1))[0]
            blocks -= np.einsum("bij,bkj,bk->bi", basis, basis, blocks, optimize=True)
        squares, free = np.einsum("ij,ij->i", blocks, blocks), length - degree - 1
        usual = float(np.median(squares)) / (1.0 - 2.0 / (9.0 * free)) ** 3
        # White noise exceeds the limit once in 5000 blocks, whatever their length.
        sound = squares <= usual * chi_square(1.0 - 1.0 / 5000.0, free) / free
        return sqrt(float(np.mean(squares[sound])) / free) if sound.any() else None

    sizes = ((length, degree, about(length, degree, 5)) for length, degree in LINE_BLOCKS)
    length, degree, sd = next((size for size in sizes if size[2] is not None), (0, 0, None))
    if sd is None or length < LINE_BLOCKS[0][0]:
        return sd
    first, rest = sd, 0.0
    for doubling in (2, 4, 8, 16):
        longer = about(doubling * length, degree, 10)
        if longer is None or longer < LONGER * sd:
            break
        if longer > MOST_LONGER * first:
            return first
        rest, sd = longer - sd, longer  # what a block does not show of a memory halves as its length doubles
    return sd + rest
