"""Noise with a memory that is larger than the sticks show, told apart from a misfit.

The noise of a log is measured about lines through its sticks, which take out what is slow. Noise with a memory then
leaves more than was measured, and a misfit does too. They differ in what the cycles have in common: what a model gets
wrong comes back in every cycle, at the same place; noise comes as it likes. Flipping the signs of whole cycles leaves
noise what it is, and destroys what they have in common.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.estimation.coloured import MOST, Colour, colour
from identify.logs.log_data import Guess, LogData

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MORE = 1.0  # share of the variance measured in the sticks by which that of the residuals may be larger
CLOSE = 0.02  # the same of a log that is as good as white
OF_EACH, FEWEST = 4, 12  # cycles of each log, behind its first one, and of all that tell what they have in common
BINS = (16, 8)  # of a stick, and of a slip
FLIPS = 5000
CHANCE = 1e-3  # that the cycles of noise have so much in common: below, it is a misfit


@dataclass(frozen=True)
class Remembered:
    """Noise with a memory: levels (logs,), the variance of the residuals over that measured in the sticks; slowness
    (logs,), by how much its memory widens the spread of a sum of squares."""

    levels: Array
    slowness: Array


def remembered(
    logs: Sequence[LogData],
    guesses: Sequence[Guess],
    fitted: Sequence[Array],
    noise_estimated: Sequence[bool],
    squares: Array,
    counts: Array,
    log: Indices,
) -> Remembered | None:
    """What the residuals are, if they are noise with a memory; None where they are not, or too few cycles tell.

    Where no log leaves more than the noise of its sticks, they are noise on the whole, and the memory only widens the
    spread of each cycle.

    Args:
        fitted: (n,) force [N] at the samples of each log, NaN where none is fitted; noise_estimated: per log, whether
            its noise is from its sticks; squares, counts, log (c,): weighted squares and number of the samples of each
            cycle, and its log.
    """
    levels, slowness, stacks = np.ones(len(logs)), np.ones(len(logs)), []
    for number, (data, guess, curve) in enumerate(zip(logs, guesses, fitted, strict=True)):
        mine = log == number
        level = float(squares[mine].sum() / max(counts[mine].sum(), 1.0))
        if level > 1.0 + MORE:
            return None
        residual = np.where(data.weight > 0, data.force - curve, np.nan) / data.noise
        noise = colour(residual)
        if noise_estimated[number] and not noise.white:
            levels[number], slowness[number] = max(level, 1.0), float(np.sqrt(_summed_squares(noise)))
        if level > 1.0 + CLOSE:
            stacks.append(by_phase(data.time, residual, guess))
    if not stacks:
        return Remembered(levels, slowness) if np.max(slowness) > 1.0 else None
    rows = [len(stack) for stack in stacks]
    if min(rows) < OF_EACH or sum(rows) < FEWEST:
        return None
    return Remembered(levels, slowness) if in_common(stacks, np.random.default_rng(0)) > CHANCE else None


def _summed_squares(noise: Colour) -> float:
    """The sum of the squared correlations of a noise over all lags, both ways."""
    n = 64 * MOST
    correlation = np.fft.irfft(noise.spectrum(n), n)
    return float(np.sum((correlation / correlation[0]) ** 2))


def in_common(stacks: Sequence[Array], random: np.random.Generator) -> float:
    """Chance that the cycles of noise have as much in common as these of logs have.

    Args:
        stacks: per log (c, bins), see `by_phase`.
    """
    here, flipped = 0.0, np.zeros(FLIPS)
    for stack in stacks:
        power = np.maximum(np.sum(stack**2, axis=0), 1e-300)
        signs = random.choice([-1.0, 1.0], size=(FLIPS, len(stack)))
        flipped += np.sum((signs @ stack) ** 2 / power, axis=1)
        here += float(np.sum(np.sum(stack, axis=0) ** 2 / power))
    return (1.0 + float(np.count_nonzero(flipped >= here))) / (1.0 + FLIPS)


def by_phase(time: Array, residual: Array, guess: Guess) -> Array:
    """Sums of the residuals (n,) in places along stick and slip, over the root of their number (cycles - 1, bins).

    Args:
        residual: in standard deviations of the noise, NaN where none is fitted.
    """
    rows = []
    known = np.isfinite(residual)
    for first, onset, last in zip(guess.arrest[:-1], guess.onset[1:], guess.arrest[1:], strict=True):
        edges = np.concatenate([np.linspace(first, onset, BINS[0] + 1)[:-1], np.linspace(onset, last, BINS[1] + 1)])
        place = np.searchsorted(edges, time, side="right") - 1
        inside = known & (place >= 0) & (place < edges.size - 1)
        total = np.bincount(place[inside], weights=residual[inside], minlength=edges.size - 1)
        number = np.bincount(place[inside], minlength=edges.size - 1)
        rows.append(total / np.sqrt(np.maximum(number, 1)))
    return np.array(rows).reshape(-1, sum(BINS))
