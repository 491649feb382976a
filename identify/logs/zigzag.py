"""Peaks and valleys of a noisy force: which falls of it are slips."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from data_io.arrays import thinned_steps

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SMALLEST_SHARE = 0.2  # of the typical drop: a smaller fall is no cycle of its own
SECOND_LOOK_SD = 4.0
CONFIRMED_SD = 5.0
LONG_INTERVAL = 1.6  # times the median: look again there
BLOCKS, REDUCED = 1 << 12, (32, 128)  # blocks of a force that are looked at as a whole; samples of one
AGAIN = 8  # samples of a block of the second look
WIDTH_SHARE = 0.2  # of the half period: impulses too weak to be masked vanish
QUIET, QUIET_OF_WHITE = 0.1, 0.01579  # share of second differences that are quiet, and their limit for unit variance
COLOURED = 1.5  # times what white noise leaves after smoothing: from there on noise is taken to have a memory
MOST_COLOURED = 3.0  # times the white part
PORTION = 1 << 14  # samples smoothed at once, as a rule: few enough to stay in cache
WIDEST_SHARE = 0.45  # of the time from peak to valley: smoothing wider than this bends the slip


@dataclass(frozen=True)
class Turns:
    """Falls of the smoothed force: sample indices of peak and valley, each shape (c,), and how they were found.

    Every peak has a rise before it and every valley a rise after it, both higher than `hysteresis` [N],
    except that the first peak may be the first sample. `width` is the smoothing [samples], `smoothed` the force (n,);
    `corners` are the samples among which all its turning points are.
    """

    peaks: Indices
    valleys: Indices
    width: int
    hysteresis: float
    starts_falling: bool
    smoothed: Array
    corners: Indices

    @property
    def drops(self) -> Array:
        """By how much the smoothed force falls (c,) [N]."""
        return np.asarray(self.smoothed[self.peaks] - self.smoothed[self.valleys])

    @property
    def count(self) -> int:
        """Number of falls."""
        return int(self.peaks.size)

    def without_falls(self) -> Turns:
        """The same force, of which no fall counts."""
        none = np.empty(0, dtype=np.int64)
        return replace(self, peaks=none, valleys=none, starts_falling=False)


def smooth(force: Array, width: int) -> Array:
    """Centred moving average over an odd number of samples; constant where the window would leave the record,
    so that the ends are no noisier than the rest."""
    width = min(width, force.size if force.size % 2 else force.size - 1)
    if width < 3:
        return force
    out, half = np.empty(force.size), width // 2
    inner = running_means(force, width, out[half : force.size - half])
    out[:half], out[force.size - half :] = inner[0], inner[-1]
    return out


def running_means(values: Array, width: int, means: Array | None = None) -> Array:
    """Means of every `width` neighbours of values (n,), shape (n - width + 1,); written to `means` where it is given.

    Put together of sums of 1, 2, 4, ... neighbours: faster than differences of a running total, which a processor can
    only add up one by one, and not rounded by what came long before.
    """
    means, portion = np.empty(values.size - width + 1) if means is None else means, max(PORTION, 4 * width)
    for first in range(0, means.size, portion):
        part = means[first : first + portion]
        _sum_neighbours(values[first : first + part.size + width - 1], width, part)
        part /= width
    return means


def _sum_neighbours(values: Array, width: int, total: Array) -> None:
    """Sums of every `width` neighbours of values (n,), into total (n - width + 1,)."""
    total[:] = 0.0
    begin, sums = 0, values
    for many in (1 << power for power in range(width.bit_length())):
        if width & many:
            total += sums[begin : begin + total.size]
            begin += many
        sums = sums[:-many] + sums[many:] if 2 * many <= width else sums


def _corners(values: Array, hysteresis: float) -> Indices:
    """The samples that can be turning points of a zigzag: of a block that spans less than the hysteresis only
    its lowest and highest one, which changes nothing but the time it takes. What is left of long blocks is looked at
    again in short ones."""
    left = np.flatnonzero(_within_blocks(values, hysteresis, int(np.clip(values.size // BLOCKS, *REDUCED))))
    return _fewer(values, left, hysteresis)


def _fewer(values: Array, corners: Indices, hysteresis: float) -> Indices:
    """Those of the corners that a second look leaves, or one with a larger hysteresis: where the force turns."""
    left = corners[_within_blocks(values[corners], hysteresis, AGAIN)]
    steps = np.diff(values[left])
    turns = np.ones(left.size, dtype=bool)
    turns[1:-1] = steps[1:] * steps[:-1] <= 0.0
    return left[turns]


def _within_blocks(values: Array, hysteresis: float, length: int) -> NDArray[np.bool_]:
    """Which values (n,) a look at blocks of one length leaves."""
    blocks = values.size // length
    table = values[: blocks * length].reshape(blocks, length)
    ends = np.sort(np.stack([table.argmin(axis=1), table.argmax(axis=1)]), axis=0)
    rows = np.arange(blocks)
    quiet = np.abs(table[rows, ends[1]] - table[rows, ends[0]]) < hysteresis
    candidate = np.ones(values.size, dtype=bool)
    candidate[: blocks * length] = np.repeat(~quiet, length)
    candidate[(rows * length + ends).ravel()] = True
    candidate[:1] = candidate[-1:] = True
    return candidate


def zigzag(
    values: Array, hysteresis: float, confirmation: float, corners: Indices | None = None
) -> tuple[list[int], list[int], int]:
    """Alternating turning points of values (n,), each confirmed by a move of more than `hysteresis` after it;
    for a last valley the smaller `confirmation` is enough. `corners` are all that can be turning points, if known.

    Returns: indices of the peaks, of the valleys, and the direction of the first confirmed move (0: none).
    """
    turning = _corners(values, hysteresis) if corners is None else corners
    peaks: list[int] = []
    valleys: list[int] = []
    way = first = 0
    low = high = float(values[0]) if values.size else 0.0
    at_low = at_high = 0
    for i, value in zip(turning.tolist(), values[turning].tolist(), strict=True):
        if value > high:
            high, at_high = value, i
        if value < low:
            low, at_low = value, i
        if way <= 0 and value - low > hysteresis:
            first = first or 1
            if way:
                valleys.append(at_low)
            way, high, at_high = 1, value, i
        elif way >= 0 and high - value > hysteresis:
            first = first or -1
            if way:
                peaks.append(at_high)
            way, low, at_low = -1, value, i
    if way < 0 and float(values[at_low:].max()) - low > confirmation:
        valleys.append(at_low)
    return peaks, valleys, first


def _falls(values: Array, hysteresis: float, confirmation: float, corners: Indices) -> tuple[Indices, Indices, int]:
    """Complete falls: peaks paired with the valleys after them."""
    peaks, valleys, first = zigzag(values, hysteresis, confirmation, corners)
    if first < 0:
        valleys = valleys[1:]  # the fall before it began outside the record
    n = min(len(peaks), len(valleys))
    return np.array(peaks[:n], dtype=np.int64), np.array(valleys[:n], dtype=np.int64), first


def _strict(samples: int, width: int) -> float:
    """How many standard deviations white noise alone hardly ever spans in so many samples."""
    return 2.0 * sqrt(2.0 * log(max(samples / width, 8.0))) + 1.0


def left_by_smoothing(smoothed: Array, noise: float, width: int) -> float:
    """Standard deviation that noise leaves in a force `smoothed` over so many samples (n,) [N].

    Of white noise noise/sqrt(width); noise with a memory leaves more, which second differences of the means of
    neighbouring stretches show. Most of them may hold a slip: the quietest tenth is asked.
    """
    white = noise / sqrt(width)
    count = smoothed.size // width
    if width < 3 or count < 30:
        return white
    means = smoothed[width // 2 :: width][:count]
    bends = thinned_steps(means[1:]) - thinned_steps(means[:-1])
    seen = sqrt(float(np.quantile(bends**2, QUIET)) / QUIET_OF_WHITE / 6.0)
    return white if seen < COLOURED * white else min(seen, MOST_COLOURED * noise)


def typical(drops: Array) -> float:
    """The drop that small ones are compared with [N]: the median of the larger half."""
    return float(np.median(drops[drops >= np.median(drops)])) if drops.size else 0.0


def _look(force: Array, noise: float, width: int) -> Turns:
    values = smooth(force, width)
    left = left_by_smoothing(values, noise, width)
    hysteresis = max(_strict(force.size, width) * left, 1e-9 * float(np.ptp(force)))
    corners = _corners(values, hysteresis)
    peaks, valleys, first = _falls(values, hysteresis, CONFIRMED_SD * left, corners)
    return Turns(peaks, valleys, width, hysteresis, first < 0, values, corners)


def find_falls(force: Array, noise: float, half_period: float | None) -> Turns:
    """Slips of a force (n,) whose noise has a white part of the given sd [N]; half_period in samples where it is known.

    The smoothing grows until the hysteresis is a fifth of the typical drop, or a slip would be bent.
    """
    widest = force.size / 20 if half_period is None else WIDEST_SHARE * half_period
    width = 1 if half_period is None else max(1, int(WIDTH_SHARE * half_period)) | 1
    best = _look(force, noise, width)
    turns = best
    while True:
        if turns.count:
            if turns.hysteresis <= SMALLEST_SHARE * typical(turns.drops):
                best = turns
                break
            widest = min(widest, 0.55 * float(np.median(turns.valleys - turns.peaks)))
        width = 2 * width + 1
        if width > widest:
            break
        turns = _look(force, noise, width)
        best = turns if turns.count >= best.count else best
    if half_period is None and best.count:
        usual = int(0.5 * WIDTH_SHARE * float(np.median(best.valleys - best.peaks))) | 1
        best = _look(force, noise, usual) if usual > best.width else best
    return _second_look(noise, _without_small(noise, best))


def _without_small(noise: float, turns: Turns) -> Turns:
    """Without falls below a fifth of the typical one."""
    hysteresis = SMALLEST_SHARE * typical(turns.drops)
    if hysteresis <= turns.hysteresis:
        return turns
    left = left_by_smoothing(turns.smoothed, noise, turns.width)
    corners = _fewer(turns.smoothed, turns.corners, hysteresis)
    peaks, valleys, first = _falls(turns.smoothed, hysteresis, min(hysteresis, CONFIRMED_SD * left), corners)
    return replace(turns, peaks=peaks, valleys=valleys, hysteresis=hysteresis, starts_falling=first < 0)


def _second_look(noise: float, turns: Turns) -> Turns:
    """Searches again, less strictly, where the interval between falls is suspiciously long."""
    if turns.count < 3:
        return turns
    values = turns.smoothed
    usual = float(np.median(np.diff(turns.peaks)))
    sds = max(SECOND_LOOK_SD, _strict(int(LONG_INTERVAL * usual), turns.width) - 1.0)
    lenient = max(sds * left_by_smoothing(values, noise, turns.width), 2 * SMALLEST_SHARE * typical(turns.drops))
    if lenient >= turns.hysteresis:
        return turns
    starts = np.concatenate(([0], turns.peaks))
    stops = np.append(turns.peaks, values.size - 1)
    peaks: list[int] = []
    valleys: list[int] = []
    known = [None, *turns.valleys.tolist()]
    for start, stop, valley in zip(starts.tolist(), stops.tolist(), known, strict=True):
        tops, bottoms, first = [start], [valley], -1
        if stop - start > LONG_INTERVAL * usual:
            inner_tops, inner_bottoms, first = zigzag(values[start : stop + 1], lenient, lenient)
            tops = [start, *(start + i for i in inner_tops)] if first < 0 else [start + i for i in inner_tops]
            bottoms = [start + i for i in inner_bottoms]
        for top, bottom in zip(tops, bottoms, strict=False):
            if bottom is not None and (top > 0 or first > 0):
                peaks.append(top)
                valleys.append(bottom)
    return replace(turns, peaks=np.array(peaks), valleys=np.array(valleys), hysteresis=lenient)
