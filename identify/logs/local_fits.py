"""Local fits to a piece of a force record: slopes of rises, levels of peaks, crossings of falls, noise of sticks."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from math import sqrt

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from identify.base.quantiles import chi_square

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
