"""Which falls of a force are slips, and which samples stick, slip or slide."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from identify.logs.local_fits import line_slope, slope
from identify.logs.zigzag import Turns, smooth

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Phase = NDArray[np.int8]

STICK, SLIP, SLIDING = 0, 1, 2
ARRESTING = 0.93  # of the stick slope: a rise less steep than that comes from sliding, not from rest
LEAST_RISE = 0.5  # of what a stick would rise: an interval with less contains sliding
SLOWEST_FALL = 0.4  # of the stick slope: a slip falls faster
STEEPEST_RISE = 3.0  # times the stick slope: nothing elastic rises faster; a spike in a slip does
LOADING_SD = 10.0
UNLIKE = (0.35, 0.6)  # of the median slope: neighbouring sticks differ less, and all sticks scatter less
CORNER_SD = 3.0
SHARP = 1.2  # a corner is nearer to the middle of the fall than this times its distance to the highest sample
FADED = (0.85, 0.94)  # drop and steepness of the last swing against the first, where swings settle
FEW_RISES = 3  # are no reference: take the loading slope
SPIKE_RISE = 5  # samples
LAST_RISE = (0.6, 0.3)  # of the last fall's duration must follow it, less where it already rises like a stick
FROM_REST = 0.3  # of the level that it leads to: a first rise by less is no loading, the level wanders
LOADING_RISE = 1.3  # times the typical drop: a first rise above that is loading from rest


@dataclass(frozen=True)
class Trace:
    """A force without spikes as it is looked at: time [s], force and smoothed force [N], each (n,); noise sd and
    the hysteresis of the search [N]."""

    time: Array
    force: Array
    coarse: Array
    noise: float
    hysteresis: float

    def rise(self, start: int, stop: int) -> float:
        """Highest smoothed force from start to stop above that at start [N]."""
        return float(np.max(self.coarse[start : stop + 1]) - self.coarse[start])

    def duration(self, start: int, stop: int) -> float:
        """Time between two samples [s]."""
        return float(self.time[stop] - self.time[start])

    @property
    def last(self) -> int:
        """Index of the last sample."""
        return int(self.time.size) - 1


@dataclass(frozen=True)
class Slips:
    """The falls of a record, judged: sample indices of peaks and valleys, each (f,), and `kept` (f,): is a slip.

    slopes: of the rises between them [N/s], shape (f - 1,); stick_slope: the slope others are compared with;
    loading_slope: of the first rise where the record starts unloaded, else None; ends_sliding: swings that
    settle, not slips, end the record; starts_falling: a fall that began before the record.
    """

    peaks: Indices
    valleys: Indices
    kept: NDArray[np.bool_]
    slopes: Array
    stick_slope: float
    loading_slope: float | None
    ends_sliding: bool
    starts_falling: bool

    @property
    def stick_slopes(self) -> Array:
        """Slopes of the rises between two slips [N/s]."""
        return self.slopes[self.kept[:-1] & self.kept[1:]] if self.slopes.size else self.slopes


def judge(trace: Trace, turns: Turns) -> Slips:
    """Sorts falls into slips and sliding: a slip falls fast, and a stick follows it."""
    peaks, valleys = _fine_turns(trace, turns)
    if peaks.size == 0:
        return Slips(peaks, valleys, np.ones(0, bool), np.empty(0), 0.0, None, False, turns.starts_falling)
    slopes, first = _slopes(trace, peaks, valleys), slope(trace.time, trace.force, 0, int(peaks[0]), trace.noise)
    typical = float(np.median(trace.coarse[peaks] - trace.coarse[valleys]))
    loading = not turns.starts_falling and trace.rise(0, int(peaks[0])) > LOADING_RISE * typical
    usual = _weighted_quantile(slopes, _heights(trace, peaks, valleys)) if slopes.size else first
    reference = first if loading and slopes.size < FEW_RISES else usual
    spiky = (slopes > STEEPEST_RISE * reference) & (peaks[1:] - valleys[:-1] <= SPIKE_RISE) & (reference > 0)
    if spiky.any():
        whole = np.append(True, ~spiky)
        peaks, valleys = peaks[whole], np.append(valleys[:-1][whole[1:]], valleys[-1])
        slopes = _slopes(trace, peaks, valleys)
    drops = trace.coarse[peaks] - trace.coarse[valleys]
    durations = trace.time[valleys] - trace.time[peaks]
    kept = drops > SLOWEST_FALL * reference * durations
    kept[-1] &= _is_over(trace, int(valleys[-1]), float(durations[-1]), reference)
    settling = (
        0
        if _wanders(trace, peaks, valleys, slopes)
        else _settling(trace, peaks, valleys, slopes, first if loading else usual)
    )
    kept[settling:] = False
    return Slips(
        peaks, valleys, kept, slopes, reference, first if loading else None, settling < peaks.size, turns.starts_falling
    )


def _slopes(trace: Trace, peaks: Indices, valleys: Indices) -> Array:
    rises = zip(valleys[:-1].tolist(), peaks[1:].tolist(), strict=True)
    return np.array([slope(trace.time, trace.force, start, stop, trace.noise) for start, stop in rises])


def _heights(trace: Trace, peaks: Indices, valleys: Indices) -> Array:
    return trace.coarse[peaks[1:]] - trace.coarse[valleys[:-1]]


def _weighted_quantile(values: Array, weights: Array, share: float = 0.6) -> float:
    order = np.argsort(values)
    total = np.cumsum(np.maximum(weights[order], 0.0))
    return float(values[order][int(np.searchsorted(total, share * total[-1]))])


def _fine_turns(trace: Trace, turns: Turns) -> tuple[Indices, Indices]:
    """Peaks and valleys again, with no more smoothing than the noise asks for."""
    if turns.count == 0:
        return turns.peaks, turns.valleys
    coarse = trace.coarse
    drop = float(np.median(coarse[turns.peaks] - coarse[turns.valleys]))
    width = min(int((trace.noise / (0.03 * drop)) ** 2) | 1, turns.width)
    fine, within = smooth(trace.force, width), CORNER_SD * trace.noise / sqrt(width)
    peaks, valleys = turns.peaks.copy(), turns.valleys.copy()
    last, reach = 0, turns.width // 2 + 1
    following = [*turns.peaks[1:].tolist(), trace.last]
    for i, (peak, valley) in enumerate(zip(turns.peaks.tolist(), turns.valleys.tolist(), strict=True)):
        fall = coarse[peak : valley + 1]
        middle = peak + int(np.argmin(fall > 0.5 * (fall[0] + fall[-1])))
        start, stop = max(peak - reach, last), min(valley + reach, following[i])
        peaks[i] = middle - _corner(fine[start : middle + 1][::-1], within)
        valleys[i] = last = middle + _corner(-fine[middle : stop + 1], within)
    return peaks, valleys


def _corner(climb: Array, within: float) -> int:
    """Index of the top of a climb that starts at the middle of a fall.

    On a slow stick the highest sample is any of the many that noise lifts: there the corner is the first one
    that is as high as it within the noise. A round crest is its highest sample.
    """
    top = int(np.argmax(climb))
    first = int(np.argmax(climb >= climb[top] - within))
    return first if first < SHARP * (top - first) else top


def _is_over(trace: Trace, valley: int, duration: float, reference: float) -> bool:
    """Whether the last slip must have come to rest within the record (in fast logs it does so after the valley)."""
    after = trace.duration(valley, trace.last)
    surely, perhaps = (share * duration for share in LAST_RISE)
    if after >= surely or after < perhaps:
        return after >= surely
    late = slice(valley + (trace.last - valley) // 2, None)
    steep = line_slope(trace.time[late], trace.force[late], trace.noise) >= ARRESTING * reference
    return steep and trace.last - valley >= 8


def _wanders(trace: Trace, peaks: Indices, valleys: Indices, slopes: Array) -> bool:
    """Whether neighbouring rises differ so much in slope that no elastic sticks make them: the level of sliding
    that wanders."""
    if slopes.size < 4:
        return False
    samples = 0.4 * (peaks[1:] - valleys[:-1]) + 1.0
    error = trace.noise * np.sqrt(12.0 / samples) / (samples * trace.duration(0, trace.last) / trace.last)
    middle = float(np.median(slopes))
    scatter = 1.4826 * float(np.median(np.abs(slopes - middle)))
    alike = float(np.median(np.abs(np.diff(slopes)))) < UNLIKE[0] * abs(middle)
    return not alike and scatter > max(UNLIKE[1] * middle, 3.0 * float(np.median(error)))


def _settling(trace: Trace, peaks: Indices, valleys: Indices, slopes: Array, reference: float) -> int:
    """First of the last falls after which the force never again rises like a stick; their number if there is none.

    One or two are no slips where steady sliding follows; several where they also fade (a rig may load more
    steeply at first than between slips).
    """
    count, last = peaks.size, int(valleys[-1])
    if reference <= 0:
        return count
    steepness, drops = slopes / reference, trace.coarse[peaks] - trace.coarse[valleys]
    usual = float(np.median(np.diff(trace.time[peaks]))) if count > 1 else 0.0
    tail, rise = trace.duration(last, trace.last), trace.rise(last, trace.last)
    settled = tail > 1.5 * usual and rise < LEAST_RISE * reference * tail
    if settled:
        top = last + int(np.argmax(trace.coarse[last:] - trace.coarse[last] >= 0.9 * rise))
        steepness = np.append(steepness, slope(trace.time, trace.force, last, top, trace.noise) / reference)
    sticking = np.flatnonzero(steepness >= ARRESTING)
    start = int(sticking[-1]) + 1 if sticking.size else 0
    swings, falls = steepness[start:], drops[max(start, 1) :]  # the first drop, after loading, is larger anyway
    if swings.size < 3 or falls.size < 2:
        return start if swings.size and settled else count
    fades = falls[-1] < FADED[0] * falls[0] and swings[-1] < FADED[1] * swings[0]
    return start if fades else count


def label(trace: Trace, slips: Slips) -> tuple[Phase, bool]:
    """Phase of every sample, int8 (n,), and whether sliding ends the record."""
    phase = np.full(trace.time.size, SLIDING, dtype=np.int8)
    if not slips.kept.any():
        _label_without_slips(trace, phase)
        return phase, bool(phase[-1] == SLIDING)
    start, resting = 0, True
    if slips.starts_falling:
        start = int(np.argmin(trace.coarse[: slips.peaks[0] + 1]))
        phase[:start] = SLIP
    for peak, valley, kept in zip(slips.peaks.tolist(), slips.valleys.tolist(), slips.kept.tolist(), strict=True):
        if kept or resting:
            _label_rise(trace, phase, start, peak, slips.stick_slope)
        if kept:
            phase[peak : valley + 1] = SLIP
        start, resting = valley, kept
    if not slips.kept[-1]:
        return phase, slips.ends_sliding
    sticks = _label_rise(trace, phase, int(slips.valleys[-1]), trace.last, slips.stick_slope)
    return phase, slips.ends_sliding or not sticks


def _label_rise(trace: Trace, phase: Phase, start: int, stop: int, reference: float) -> bool:
    """Stick, or stick up to a knee and sliding from there; whether it is all stick."""
    expected = LEAST_RISE * reference * trace.duration(start, stop)
    rise = trace.coarse[start : stop + 1] - trace.coarse[start]
    if rise.max() >= expected or expected < 3.0 * trace.hysteresis:
        phase[start : stop + 1] = STICK
        return True
    phase[start : start + int(np.argmax(rise >= 0.9 * rise.max())) + 1] = STICK
    return False


def loading_knee(trace: Trace) -> int:
    """Sample at which the loading of a record without slips ends; 0 where nothing was loaded."""
    width = max(3, trace.time.size // 200) | 1
    wide = smooth(trace.force, width)
    rise = wide - wide[0]
    if rise.max() < max(trace.hysteresis, LOADING_SD * trace.noise / sqrt(width)):
        return 0
    knee = int(np.argmax(rise >= 0.9 * rise.max()))
    per_time = rise[knee] / max(trace.duration(0, knee), 1e-300)
    only_rising = rise[-1] - rise[knee] > LEAST_RISE * per_time * trace.duration(knee, trace.last)
    if rise[knee] <= FROM_REST * abs(wide[knee]):
        return 0
    return trace.last if only_rising else knee


def _label_without_slips(trace: Trace, phase: Phase) -> None:
    """Loading from rest up to the knee, then sliding; all stick where the force only rises."""
    knee = loading_knee(trace)
    if knee:
        phase[: knee + 1] = STICK


def not_slipping(phase: Phase) -> list[tuple[int, int]]:
    """First sample and end of every stretch of stick and of sliding."""
    edges = [0, *(np.flatnonzero(phase[1:] != phase[:-1]) + 1).tolist(), int(phase.size)]
    return [(first, end) for first, end in pairwise(edges) if phase[first] != SLIP]
