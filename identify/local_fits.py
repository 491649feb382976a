"""Local fits to a piece of a force record: slopes of rises, levels of peaks, crossings of falls, noise of sticks."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from math import sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STRAIGHT = (0.3, 0.7)  # share of a rise, in time, whose slope is the stick slope
LINE_BLOCK = 24
LINE_DEGREE = 3  # a rise between fast slips is bent
UNUSUAL = 2.4  # times the median square sum: white noise exceeds it once in 5000 blocks
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


def noise_on_lines(force: Array, sticks: Iterable[tuple[int, int]]) -> float | None:
    """Sd of the force about gently curved lines through blocks of the sticks [N].

    Blocks with much more than the median (an unseen spike or slip) are left out; the mean of the others is
    nearly as precise as all the samples allow, which a test of chi^2 needs.

    Args:
        force: shape (n,) [N].
        sticks: first sample and end of each stick; an eighth is left out at either end.

    Returns: None where there are fewer than five blocks of 24 samples.
    """
    starts = [
        np.arange(first + (last - first) // 8, last - (last - first) // 8 - LINE_BLOCK + 1, LINE_BLOCK)
        for first, last in sticks
    ]
    index = np.concatenate(starts) if starts else np.empty(0, dtype=np.int64)
    if index.size < 5:
        return None
    index = index[:: max(1, index.size // MOST_BLOCKS)]
    blocks = force[index[:, None] + np.arange(LINE_BLOCK)]
    basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, LINE_BLOCK), LINE_DEGREE + 1))[0]
    squares = ((blocks - (blocks @ basis) @ basis.T) ** 2).sum(axis=1)
    free = LINE_BLOCK - LINE_DEGREE - 1
    usual = float(np.median(squares)) / (1.0 - 2.0 / (9.0 * free)) ** 3
    sound = squares <= UNUSUAL * usual
    return sqrt(float(np.mean(squares[sound])) / free) if sound.any() else None
