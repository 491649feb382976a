"""Local fits to a force record; which falls are slips, and which samples stick, slip or slide."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import sqrt

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from identify.base.quantiles import chi_square
from identify.logs.zigzag import Turns, smooth

# Local fits to a piece of a force record: slopes of rises, levels of peaks, crossings of falls, noise of sticks.

Array = NDArray[np.float64]

STRAIGHT = (0.3, 0.7)  # share of a rise, in time, whose slope is the stick slope
# Samples of a block, and degree of its line: a rise between fast slips is bent. Shorter ones where sticks are short.
LINE_BLOCKS = ((24, 3), (12, 2), (8, 2))
FEWEST_BLOCKS = 5
DOUBLINGS = 4  # of the longest block, as long as
LONGER = 1.015  # times the noise is seen in it: noise with a memory shows all of itself only in long blocks
MOST_LONGER = 4.0  # what grows by more than that is no noise
MOST_POINTS = 400
MOST_BLOCKS = 4000
LONGEST_SPAN = 40


def slope(time: Array, force: Array, start: int, stop: int, noise: float) -> float:
    """Slope of the straight middle of a rise from sample start to stop [N/s]; outliers are dropped once."""
    first = start + int(STRAIGHT[0] * (stop - start))
    last = max(start + int(np.ceil(STRAIGHT[1] * (stop - start))), first + 1)
    return line_slope(time[first : last + 1], force[first : last + 1], noise)


def line_slope(t: Array, f: Array, noise: float) -> float:
    """Slope of a line through points (n,) [N/s]; outliers are dropped once; 0 with fewer than two points."""
    per = t.size // MOST_POINTS
    if per > 1:
        t, f = (column[: per * MOST_POINTS].reshape(-1, per).mean(axis=1) for column in (t, f))
        noise = noise / sqrt(per)
    if t.size < 2:
        return 0.0
    t, f = t - t.mean(), f - f.mean()
    found = float(t @ f / (t @ t))
    residual = np.abs(f - found * t)
    keep = residual < max(5.0 * noise, 4.0 * float(np.median(residual)))
    if keep.all() or np.count_nonzero(keep) < 4:
        return found
    t, f = t[keep] - t[keep].mean(), f[keep] - f[keep].mean()
    return float(t @ f / (t @ t))


def slope_error(t: Array, noise: float) -> float:
    """Standard error of the slope of a line through points at times (n,) [s] with this noise [N/s]."""
    return noise / (sqrt(t.size) * float(np.std(t)))


def level(force: Array, start: int, stop: int, at: int) -> float:
    """Force at sample `at` from a parabola (a line where one side is short) through samples start to stop [N]."""
    f = force[start : stop + 1]
    return float(_level_weights(at - start, stop - at) @ f) if f.size >= 4 else float(force[at])


@lru_cache(maxsize=4096)
def _level_weights(left: int, right: int) -> Array:
    x = np.arange(-left, right + 1) / (left + right + 1)
    degree = 2 if min(left, right) >= 3 else 1
    weights: Array = np.linalg.pinv(np.vander(x, degree + 1, increasing=True))[0]
    return weights


def span(rise: int) -> int:
    """How many samples of a rise of so many samples count for the level at its end."""
    return min(max(int(0.15 * rise), 4), LONGEST_SPAN, rise)


def crossing(time: Array, force: Array, coarse: Array, middle: float, drop: float) -> float:
    """Time at which a fall, given from its peak to its valley, crosses `middle` [s], to a fraction of a sample.

    A line through the steep half of the fall; where that has too few samples, between two samples.
    """
    steep = np.flatnonzero(np.abs(coarse - middle) < 0.25 * drop)
    if steep.size >= 4:
        t, f = time[steep], force[steep]
        centre = float(t.mean())
        t = t - centre
        steepness = float(t @ (f - f.mean()) / (t @ t))
        if steepness < 0:
            return float(np.clip(centre + (middle - f.mean()) / steepness, time[0], time[-1]))
    below = force < middle
    i = max(int(np.argmax(below)) if below.any() else force.size - 1, 1)
    step = force[i - 1] - force[i]
    share = (force[i - 1] - middle) / step if step > 0 else 0.5
    return float(time[i - 1] + min(max(share, 0.0), 1.0) * (time[i] - time[i - 1]))


def noise_on_lines(force: Array, sticks: Iterable[tuple[int, int]], time: Array | None = None) -> float | None:
    """Sd of the force about gently curved lines through blocks of the sticks [N].

    Blocks with much more than the median (an unseen spike or slip) are left out; the mean of the others is
    nearly as precise as all the samples allow, which a test of chi^2 needs.

    Args:
        force: shape (n,) [N].
        sticks: first sample and end of each stick; an eighth is left out at either end.
        time: shape (n,) [s] of uneven rows; None for even ones.

    Returns: None where there are fewer than five blocks of eight samples.
    """
    kept = [(first + (last - first) // 8, last - (last - first) // 8) for first, last in sticks]
    for length, degree in LINE_BLOCKS:
        starts = [np.arange(first, last - length + 1, length) for first, last in kept]
        index = np.concatenate(starts) if starts else np.empty(0, dtype=np.int64)
        if index.size >= FEWEST_BLOCKS:
            found = _about_lines(force, index, length, degree, time)
            return found if found is None or length < LINE_BLOCKS[0][0] else _remembered(force, kept, found, time)
    return None


def _remembered(force: Array, sticks: list[tuple[int, int]], found: float, time: Array | None) -> float:
    """The noise found in the longest blocks, seen in longer ones as far as that makes it larger."""
    length, degree = LINE_BLOCKS[0]
    first, rest = found, 0.0
    for _ in range(DOUBLINGS):
        length *= 2
        starts = [np.arange(a, b - length + 1, length) for a, b in sticks]
        index = np.concatenate(starts)
        if index.size < 2 * FEWEST_BLOCKS:
            return found + rest
        longer = _about_lines(force, index, length, degree, time)
        if longer is None or longer < LONGER * found:
            return found + rest
        if longer > MOST_LONGER * first:
            return first
        # What a block does not show of a memory halves as its length doubles.
        rest, found = longer - found, longer
    return found + rest


def _about_lines(force: Array, index: NDArray[np.int64], length: int, degree: int, time: Array | None) -> float | None:
    """Sd of the force about curves of a degree through blocks of a length that begin at `index` (b,) [N].

    time: (n,) [s], along which the curves run; None: along the rows.
    """
    index = index[:: max(1, index.size // MOST_BLOCKS)]
    blocks = sliding_window_view(force, length)[index]
    if time is None:
        basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, length), degree + 1))[0]
        blocks -= (blocks @ basis) @ basis.T
    else:
        stamps = sliding_window_view(time, length)[index]
        middle, half = stamps.mean(axis=1, keepdims=True), 0.5 * np.ptp(stamps, axis=1, keepdims=True)
        basis = np.linalg.qr(((stamps - middle) / half)[..., None] ** np.arange(degree + 1))[0]
        blocks -= np.einsum("bij,bkj,bk->bi", basis, basis, blocks, optimize=True)
    squares = np.einsum("ij,ij->i", blocks, blocks)
    free = length - degree - 1
    usual = float(np.median(squares)) / (1.0 - 2.0 / (9.0 * free)) ** 3
    # White noise exceeds the limit once in 5000 blocks, whatever their length.
    sound = squares <= usual * _unusual(free)
    return sqrt(float(np.mean(squares[sound])) / free) if sound.any() else None


@lru_cache(maxsize=8)
def _unusual(free: int) -> float:
    return chi_square(1.0 - 1.0 / 5000.0, free) / free


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
FROM_REST = 0.5  # of the level that it leads to: a first rise by less is no loading, the level wanders
LOADING_RISE = 1.3  # times the typical drop: a first rise above that is loading from rest


@dataclass(frozen=True)
class ForceTrace:
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
class JudgedFalls:
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


def judge(trace: ForceTrace, turns: Turns) -> JudgedFalls:
    """Sorts falls into slips and sliding: a slip falls fast, and a stick follows it."""
    peaks, valleys = _fine_turns(trace, turns)
    if peaks.size == 0:
        return JudgedFalls(peaks, valleys, np.ones(0, bool), np.empty(0), 0.0, None, False, turns.starts_falling)
    slopes, first = _slopes(trace, peaks, valleys), slope(trace.time, trace.force, 0, int(peaks[0]), trace.noise)
    typical = float(np.median(trace.coarse[peaks] - trace.coarse[valleys]))
    loading = not turns.starts_falling and trace.rise(0, int(peaks[0])) > LOADING_RISE * typical
    usual = _weighted_quantile(slopes, trace.coarse[peaks[1:]] - trace.coarse[valleys[:-1]]) if slopes.size else first
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
    return JudgedFalls(
        peaks, valleys, kept, slopes, reference, first if loading else None, settling < peaks.size, turns.starts_falling
    )


def _slopes(trace: ForceTrace, peaks: Indices, valleys: Indices) -> Array:
    rises = zip(valleys[:-1].tolist(), peaks[1:].tolist(), strict=True)
    return np.array([slope(trace.time, trace.force, start, stop, trace.noise) for start, stop in rises])


def _weighted_quantile(values: Array, weights: Array, share: float = 0.6) -> float:
    order = np.argsort(values)
    total = np.cumsum(np.maximum(weights[order], 0.0))
    return float(values[order][int(np.searchsorted(total, share * total[-1]))])


def _fine_turns(trace: ForceTrace, turns: Turns) -> tuple[Indices, Indices]:
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


def _is_over(trace: ForceTrace, valley: int, duration: float, reference: float) -> bool:
    """Whether the last slip must have come to rest within the record (in fast logs it does so after the valley)."""
    after = trace.duration(valley, trace.last)
    surely, perhaps = (share * duration for share in LAST_RISE)
    if after >= surely or after < perhaps:
        return after >= surely
    late = slice(valley + (trace.last - valley) // 2, None)
    steep = line_slope(trace.time[late], trace.force[late], trace.noise) >= ARRESTING * reference
    return steep and trace.last - valley >= 8


def _wanders(trace: ForceTrace, peaks: Indices, valleys: Indices, slopes: Array) -> bool:
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


def _settling(trace: ForceTrace, peaks: Indices, valleys: Indices, slopes: Array, reference: float) -> int:
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


def label(trace: ForceTrace, slips: JudgedFalls) -> tuple[Phase, bool]:
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


def _label_rise(trace: ForceTrace, phase: Phase, start: int, stop: int, reference: float) -> bool:
    """Stick, or stick up to a knee and sliding from there; whether it is all stick."""
    expected = LEAST_RISE * reference * trace.duration(start, stop)
    rise = trace.coarse[start : stop + 1] - trace.coarse[start]
    if rise.max() >= expected or expected < 3.0 * trace.hysteresis:
        phase[start : stop + 1] = STICK
        return True
    phase[start : start + int(np.argmax(rise >= 0.9 * rise.max())) + 1] = STICK
    return False


def loading_knee(trace: ForceTrace) -> int:
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


def _label_without_slips(trace: ForceTrace, phase: Phase) -> None:
    """Loading from rest up to the knee, then sliding; all stick where the force only rises."""
    knee = loading_knee(trace)
    if knee:
        phase[: knee + 1] = STICK


def not_slipping(phase: Phase) -> list[tuple[int, int]]:
    """First sample and end of every stretch of stick and of sliding."""
    edges = [0, *(np.flatnonzero(phase[1:] != phase[:-1]) + 1).tolist(), int(phase.size)]
    return [(first, end) for first, end in pairwise(edges) if phase[first] != SLIP]
