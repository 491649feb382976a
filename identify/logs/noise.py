"""Samples of a measured force: averages, lines through them, their white noise, isolated spikes."""

from __future__ import annotations

from math import comb, sqrt

import numpy as np
import scipy
from numpy.typing import NDArray

from data_io.arrays import grid_step, thinned_steps

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]

FEWEST_ROWS = 20  # of a stretch that tells anything
SIGNIFICANT = 5.0  # standard deviations from which on a difference is no noise
BLOCK = 16  # overlapping differences whose mean square is one estimate of the noise
# Median over blocks of the mean square of 16 overlapping differences of unit white noise, by order.
MEDIAN_OF_BLOCK = {2: 0.913, 3: 0.898, 4: 0.886, 5: 0.878}
SIDE = 5  # samples on either side of a spike that it has to leave
SPIKE_SD = 6.0  # standard deviations by which it leaves its chord; three quarters as many the lines beside it
SWING = 0.3  # of its height: by so much what surrounds a crest of a swing leaves a straight line too
FLOOR = 0.25  # of its height: samples of a dip or bump that differ by less have a level of their own


def running_means(values: Array, width: int) -> Array:
    """Means of every `width` neighbours of values (n,), shape (n - width + 1,)."""
    averaged: Array = scipy.ndimage.uniform_filter1d(
        values, width, mode="nearest", origin=-(width // 2) if width > 1 else 0
    )
    return averaged[: values.size - width + 1]


def smooth(force: Array, width: int) -> Array:
    """Centred moving average over an odd number of samples; constant where the window would leave the record,
    so that the ends are no noisier than the rest."""
    width = min(width, force.size if force.size % 2 else force.size - 1)
    return force if width < 3 else np.pad(running_means(force, width), width // 2, mode="edge")


def largest_drop(force: Array) -> float:
    """By how much a force (n,) drops at most, rises on the way included [N], in means over 1, 2, 4, ... samples; 0
    where it does by less than ten standard deviations of them, which their second differences show."""
    largest, width, rounding = 0.0, 1, grid_step(force[: 1 << 15]) / sqrt(12.0)
    while force.size // width >= 30:
        means = force[: force.size // width * width].reshape(-1, width).mean(axis=1)
        noise = max(1.4826 * float(np.median(np.abs(np.diff(means, 2)))) / sqrt(6.0), rounding / sqrt(width))
        drop = float(np.max(np.maximum.accumulate(means) - means))
        largest, width = max(largest, drop if drop > 10.0 * noise else 0.0), 2 * width
    return largest


def line_slope(t: Array, f: Array, noise: float) -> float:
    """Slope of a line through points (n,) [N/s]; outliers are dropped once; 0 with fewer than two points."""
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


def slope_error(t: Array, noise: float) -> float:
    """Standard error of the slope of a line through points at times (n,) [s] with this noise [N/s]."""
    return noise / (sqrt(t.size) * float(np.std(t)))


def uneven(time: Array) -> bool:
    """Whether rows (n,) [s] follow each other so unevenly that their differences by number are none by time."""
    steps = thinned_steps(time)
    usual = float(np.median(steps))
    return bool(np.mean(np.abs(steps - usual) > 0.05 * usual) > 0.01)


def white_noise(force: Array, time: Array | None = None) -> float:
    """Standard deviation of the white part of a force (n,), robust to sticks, slips, steps and spikes [N].

    time: (n,) [s] of uneven rows: their differences are taken over true distances; None for even ones.

    Differences of order 2 to 5 remove ramps and slow waves; the median over blocks of their mean square
    ignores the few blocks with slips, and unlike a median of single samples does not vanish where a
    quantised signal mostly repeats itself. Quantisation itself counts as noise of step/sqrt(12).
    """
    force = np.asarray(force, dtype=np.float64)
    if force.size < BLOCK:
        return sqrt(float(np.median(np.diff(force, 2) ** 2)) / 0.455 / 6.0) if force.size >= 3 else 0.0
    estimates = []
    for order in MEDIAN_OF_BLOCK if time is None else (2,):
        squares = (np.diff(force, order) if time is None else _by_distance(force, time)) ** 2
        blocks = squares.size // BLOCK
        means = squares[: blocks * BLOCK].reshape(blocks, BLOCK).mean(axis=1) if blocks >= 4 else squares
        usual = MEDIAN_OF_BLOCK[order] if blocks >= 4 else 0.455
        estimates.append(sqrt(float(np.median(means)) / usual / comb(2 * order, order)))
    return max(min(estimates), grid_step(force[: 1 << 15]) / sqrt(12.0))


def _by_distance(force: Array, time: Array) -> Array:
    """How far each force is off the line between its neighbours, (n - 2,), with the variance of second differences."""
    before, after = time[1:-1] - time[:-2], time[2:] - time[1:-1]
    share = after / (before + after)
    off = force[1:-1] - share * force[:-2] - (1.0 - share) * force[2:]
    return off * np.sqrt(comb(4, 2) / (1.0 + share**2 + (1.0 - share) ** 2))


def spikes(force: Array, noise: float, *, floors: bool = False) -> Mask:
    """Marks isolated outliers of one to three samples of a finite force (n,) [N] with white noise of this sd [N].

    A spike leaves both the chord between its neighbours and the lines through five samples on either
    side, to the same side, and the signal is back on its level after it: a sharp corner of a saw-tooth
    or a crest sampled a few times is none, nor are the crests of a swing whose every period is a few samples.
    floors: a run whose samples have a level of their own is a dip or a bump of the force, and none either.
    """
    marked = np.zeros(force.size, dtype=bool)
    limit = SPIKE_SD * max(noise, 1e-12 * float(np.ptp(force)) if force.size else 0.0)
    if force.size < 2 * SIDE + 2 or limit == 0.0:
        return marked
    for _ in range(6):
        marked, clean = np.zeros(force.size, dtype=bool), force
        for number, length in enumerate((1, 2, 3, 1, 2, 3)):  # one removed may uncover its neighbour
            if number == 3 and clean is force:
                break
            first = _spikes_of(clean, length, limit, floors and length > 1)
            if first.size:
                marked[(first[:, None] + np.arange(length)).ravel()] = True
                clean = bridged(clean, marked)
        if np.count_nonzero(marked) <= 0.05 * force.size:  # more of them are noise
            break
        limit *= 2.0
    return marked


def _spikes_of(force: Array, length: int, limit: float, floors: bool) -> Indices:
    """First samples of the spikes of a length."""
    jump = np.abs(np.diff(force)) > 0.6 * limit
    first = np.flatnonzero(jump[:-length] & jump[length:]) + 1
    first = first[(first >= SIDE) & (first + length + SIDE <= force.size)]
    if not first.size:
        return first
    inside, reach = np.arange(1, length + 1), np.arange(SIDE)
    body, before, after = force[first[:, None] + inside - 1], force[first - 1], force[first + length]
    off = body - before[:, None] - (after - before)[:, None] * inside / (length + 1)
    left, off_left = _extrapolated(force[first[:, None] - 1 - reach], inside)
    right, off_right = _extrapolated(force[first[:, None] + length + reach], length + 1 - inside)
    side, height = np.sign(off), np.abs(off).min(axis=1)
    good = (height[:, None] > limit) & (side * (body - left) > 0.75 * limit) & (side * (body - right) > 0.75 * limit)
    crest = good.all(axis=1) & (np.abs(after - before) < 0.5 * height)
    swings = first[crest & (np.minimum(off_left, off_right) > np.maximum(SWING * height, 0.6 * limit))]
    crest &= np.searchsorted(swings, first + 3 * SIDE, side="right") == np.searchsorted(swings, first - 3 * SIDE)
    if floors:
        crest &= np.ptp(body, axis=1) > FLOOR * np.abs(body.mean(axis=1) - 0.5 * (before + after))
    return first[crest]


def _extrapolated(samples: Array, steps: Indices) -> tuple[Array, Array]:
    """A robust line through samples (c, SIDE), nearest first, continued by steps (l,): (c, l); what it misses (c,)."""

    def middle(rows: Array) -> Array:  # sorted in a third of the time that np.median takes
        k = rows.shape[1]
        return np.asarray(np.sort(rows, axis=1)[:, [(k - 1) // 2, k // 2]].mean(axis=1))[:, None]

    i, j = np.triu_indices(SIDE, 1)
    slope = middle((samples[:, j] - samples[:, i]) / (j - i))
    off = samples - slope * np.arange(SIDE)
    level = middle(off)
    return level - slope * steps, np.max(np.abs(off - level), axis=1)


def bridged(force: Array, holes: Mask) -> Array:
    """The force with the marked samples replaced by straight lines between their neighbours."""
    if not holes.any() or holes.all():
        return force
    out, wrong, good = force.copy(), np.flatnonzero(holes), np.flatnonzero(~holes)
    out[wrong] = np.interp(wrong, good, force[good])
    return out
