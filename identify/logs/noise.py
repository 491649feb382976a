"""White noise and isolated spikes of a measured force, from the samples alone."""

from __future__ import annotations

from math import comb, sqrt

import numpy as np
from numpy.typing import NDArray

from data_io.arrays import thinned_steps

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BLOCK = 16
UNEVEN, UNEVEN_SHARE = 0.05, 0.01  # of the usual interval, by which more than such a share of the others differ
STRETCH = 512
MOST_STRETCHES = 128
ORDERS = (2, 3, 4, 5)
# Median over blocks of the mean square of 16 overlapping differences of unit white noise, by order.
MEDIAN_OF_BLOCK = {2: 0.913, 3: 0.898, 4: 0.886, 5: 0.878}
SPIKE_LENGTHS = (1, 2, 3)
MET_AGAIN = 1 << 12  # samples among which a value comes twice where the step of the force counts beside its noise
SPIKE_PASSES = 2
SIDE = 5
SPIKE_SD = 6.0
SPIKE_SD_OVER_SIDES = 4.5
MOST_SPIKES = 0.05
FLOOR = 0.25  # of the height of a dip or bump: samples that differ by less have a level of their own
# What surrounds a crest of a swing leaves a straight line too: by this share of its height, and standard deviations;
# and so many samples further on it is a swing still.
SWING, SWING_SD, SWINGS_ON = 0.3, 3.5, 3 * SIDE


def uneven(time: Array) -> bool:
    """Whether rows (n,) [s] follow each other so unevenly that their differences by number are none by time."""
    steps = thinned_steps(time)
    usual = float(np.median(steps))
    return bool(np.mean(np.abs(steps - usual) > UNEVEN * usual) > UNEVEN_SHARE)


def white_noise(force: Array, time: Array | None = None) -> float:
    """Standard deviation of the white part of a force (n,), robust to sticks, slips, steps and spikes [N].

    time: (n,) [s] of uneven rows: their differences are taken over true distances; None for even ones.

    Differences of order 2 to 5 remove ramps and slow waves; the median over blocks of their mean square
    ignores the few blocks with slips, and unlike a median of single samples does not vanish where a
    quantised signal mostly repeats itself. Quantisation itself counts as noise of step/sqrt(12).
    """
    force = np.asarray(force, dtype=np.float64)
    if force.size < BLOCK:
        return _few(force)
    estimates = []
    differences, reached = _sampled(force), 0
    for order in ORDERS if time is None else ORDERS[:1]:  # each from the one before
        differences = np.diff(differences, order - reached) if time is None else _by_distance(force, time)
        squares, reached = differences**2, order
        blocks = squares.size // BLOCK
        if blocks < 4:
            estimates.append(sqrt(float(np.median(squares)) / 0.455 / comb(2 * order, order)))
            continue
        means = squares[: blocks * BLOCK].reshape(blocks, BLOCK).mean(axis=1)
        estimates.append(sqrt(float(np.median(means)) / MEDIAN_OF_BLOCK[order] / comb(2 * order, order)))
    return max(min(estimates), quantum(force) / sqrt(12.0))


def _by_distance(force: Array, time: Array) -> Array:
    """How far each force lies off the line between its neighbours, (n - 2,), scaled to the second difference of even
    rows: of white noise it has the same variance, a ramp is gone at any distances."""
    before, after = time[1:-1] - time[:-2], time[2:] - time[1:-1]
    share = after / (before + after)
    off = force[1:-1] - share * force[:-2] - (1.0 - share) * force[2:]
    return off * np.sqrt(comb(4, 2) / (1.0 + share**2 + (1.0 - share) ** 2))


def _sampled(force: Array) -> Array:
    """All of a short record; of a long one stretches from all over it, joined (a few bad joints do not count)."""
    stretches = force.size // STRETCH
    if stretches <= 2 * MOST_STRETCHES:
        return force
    chosen = np.linspace(0, stretches - 1, MOST_STRETCHES).astype(np.int64)
    return force[: stretches * STRETCH].reshape(stretches, STRETCH)[chosen].ravel()


def _few(force: Array) -> float:
    if force.size < 3:
        return 0.0
    return sqrt(float(np.median(np.diff(force, 2) ** 2)) / 0.455 / 6.0)


def quantum(force: Array) -> float:
    """The step of a quantised force [N]: all its values lie on a grid; 0 where the force is not quantised, or so finely
    that it hardly meets a value again."""
    if np.all(np.diff(np.sort(force[:MET_AGAIN])) > 0.0):
        return 0.0
    levels = np.unique(force[: 1 << 15])
    if levels.size < 3:
        return 0.0
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * (levels[-1] - levels[0])]
    step = float(steps.min())
    on_grid = np.abs(steps / step - np.round(steps / step)) < 0.05
    return step if np.mean(on_grid) > 0.9 else 0.0


def spikes(force: Array, noise: float, *, floors: bool = False) -> Mask:
    """Marks isolated outliers of one to three samples, shape (n,).

    A spike leaves both the chord between its neighbours and the lines through five samples on either
    side, to the same side, and the signal is back on its level after it: a sharp corner of a saw-tooth
    or a crest sampled a few times is none, nor are the crests of a swing whose every period is a few samples.

    Args:
        force: finite values (n,) [N].
        noise: standard deviation of the white noise [N].
        floors: whether a run whose samples have a level of their own is a dip or a bump of the force, and no spike.
    """
    marked = np.zeros(force.size, dtype=bool)
    limit = SPIKE_SD * max(noise, 1e-12 * float(np.ptp(force)) if force.size else 0.0)
    if force.size < 2 * SIDE + 2 or limit == 0.0:
        return marked
    for _ in range(6):
        marked = _spikes_above(force, limit, floors)
        if np.count_nonzero(marked) <= MOST_SPIKES * force.size:
            break
        limit *= 2.0
    return marked


def _spikes_above(force: Array, limit: float, floors: bool) -> Mask:
    """Spikes that leave their surroundings by more than the limit; one removed may uncover its neighbour."""
    marked, clean = np.zeros(force.size, dtype=bool), force
    jump = _jumps(clean, limit)
    for _ in range(SPIKE_PASSES):
        before = clean
        for length in SPIKE_LENGTHS:
            first = _candidates(jump, clean, length)
            found = first[_stands_out(clean, first, length, limit)] if first.size else first
            if floors and length > 1 and found.size:
                body = clean[found[:, None] + np.arange(length)]
                height = np.abs(body.mean(axis=1) - 0.5 * (clean[found - 1] + clean[found + length]))
                found = found[np.ptp(body, axis=1) > FLOOR * height]
            if found.size == 0:
                continue
            for k in range(length):
                marked[found + k] = True
            clean = bridged(clean, marked)
            jump = _jumps(clean, limit)
        if clean is before:  # nothing was found, and nothing would be
            break
    return marked


def _stands_out(force: Array, first: NDArray[np.int64], length: int, limit: float) -> Mask:
    """Which of the runs that begin at `first` are spikes."""
    inside = np.arange(1, length + 1)
    body = force[first[:, None] + inside - 1]
    before, after = force[first - 1], force[first + length]
    off = body - before[:, None] - (after - before)[:, None] * inside / (length + 1)
    reach = np.arange(SIDE)
    left, off_left = _extrapolated(force[first[:, None] - 1 - reach], inside)
    right, off_right = _extrapolated(force[first[:, None] + length + reach], length + 1 - inside)
    side, sides = np.sign(off), SPIKE_SD_OVER_SIDES / SPIKE_SD * limit
    good = (np.abs(off) > limit) & (side * (body - left) > sides) & (side * (body - right) > sides)
    height = np.abs(off).min(axis=1)
    crest = good.all(axis=1) & (np.abs(after - before) < 0.5 * height)
    swings = crest & (np.minimum(off_left, off_right) > np.maximum(SWING * height, SWING_SD / SPIKE_SD * limit))
    result: Mask = crest & ~_near(first, first[swings])
    return result


def _near(places: NDArray[np.int64], others: NDArray[np.int64]) -> Mask:
    """Which places are within SWINGS_ON samples of one of the others; both in rising order."""
    begin = np.searchsorted(others, places - SWINGS_ON)
    result: Mask = np.searchsorted(others, places + SWINGS_ON, side="right") > begin
    return result


def _extrapolated(samples: Array, steps: NDArray[np.int64]) -> tuple[Array, Array]:
    """A line through samples (c, SIDE), nearest first, continued beyond the nearest by steps (l,): shape (c, l); and by
    how much one of the samples leaves it at most (c,).

    Median slope and median level, so that another spike among the samples does not bend it.
    """
    i, j = np.triu_indices(SIDE, 1)
    slope = _middle((samples[:, j] - samples[:, i]) / (j - i))
    level = _middle(samples - slope[:, None] * np.arange(SIDE))
    left_over = samples - level[:, None] - slope[:, None] * np.arange(SIDE)
    return level[:, None] - slope[:, None] * steps, np.max(np.abs(left_over), axis=1)


def _middle(rows: Array) -> Array:
    """Medians of short rows (c, k), shape (c,): sorted in a third of the time that np.median takes."""
    k = rows.shape[1]
    ordered = np.sort(rows, axis=1)
    return np.asarray(0.5 * (ordered[:, (k - 1) // 2] + ordered[:, k // 2]))


def _jumps(force: Array, limit: float) -> NDArray[np.int64]:
    """Samples after which the force jumps."""
    steps = np.diff(force)
    return np.flatnonzero(np.abs(steps, out=steps) > 0.6 * limit)


def _candidates(jump: NDArray[np.int64], force: Array, length: int) -> NDArray[np.int64]:
    """First samples of runs of the given length that are entered and left by a jump."""
    if jump.size == 0:
        return jump
    left = jump[np.minimum(np.searchsorted(jump, jump + length), jump.size - 1)] == jump + length
    entered = jump[left] + 1
    return entered[(entered >= SIDE) & (entered + length + SIDE <= force.size)]


def bridged(force: Array, holes: Mask) -> Array:
    """The force with the marked samples replaced by straight lines between their neighbours."""
    bad = holes
    if not bad.any() or bad.all():
        return force
    out, good = force.copy(), np.flatnonzero(~bad)
    wrong = np.flatnonzero(bad)
    out[wrong] = np.interp(wrong, good, force[good])
    return out
