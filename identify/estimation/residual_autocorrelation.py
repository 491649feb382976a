"""Noise with a memory: how residuals hang together from sample to sample, and a covariance that allows for it.

A least-squares fit stays right when its noise is coloured; its standard errors do not: neighbours that err alike tell
less than their number says. The colour is an autoregression of the residuals of each log, of the order that pays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import LogData
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

MOST = 24  # order of the autoregression
FEWEST = 50  # samples per order
PORTION = 1 << 14  # samples worked on at once
MOST_PORTIONS = 8  # of one log: 131,072 samples tell a correlation to 0.3 %
PAYS = 1.5  # times Schwarz's price: white noise is called coloured once in many thousand logs


@dataclass(frozen=True)
class Colour:
    """The noise of one log: autoregression (p,) of its residuals, empty for white noise; share of its variance that is
    new in each sample; memory: the sum of its correlations over all lags, 1 for white noise."""

    regression: Array
    innovation: float

    @property
    def white(self) -> bool:
        """Whether neighbours know nothing of each other."""
        return self.regression.size == 0

    @property
    def memory(self) -> float:
        """Samples that count as one, for whatever changes slowly."""
        return float(self.innovation / (1.0 - self.regression.sum()) ** 2)

    def spectrum(self, n: int) -> Array:
        """Variance per frequency of a real transform of n samples (n // 2 + 1,), of mean 1 over all frequencies."""
        polynomial = np.concatenate([[1.0], -self.regression])
        return np.asarray(self.innovation / np.abs(np.fft.rfft(polynomial, n)) ** 2)


def colour(residual: Array) -> Colour:
    """The colour of the residuals of one log (n,), NaN where there is none."""
    known = np.isfinite(residual)
    asked = _asked(residual.size)
    count = sum(int(np.count_nonzero(known[part])) for part in asked)
    most = min(MOST, count // FEWEST)
    if most < 1:
        return Colour(np.empty(0), 1.0)
    correlation = _correlation(residual, known, asked, most)
    price = PAYS * np.log(count) / count
    best, cost = Colour(np.empty(0), 1.0), 0.0
    regression, innovation = np.empty(0), 1.0
    for order in range(1, most + 1):  # Levinson and Durbin
        reflection = (correlation[order] - regression @ correlation[order - 1 : 0 : -1]) / innovation
        regression = np.append(regression - reflection * regression[::-1], reflection)
        innovation *= 1.0 - reflection**2
        if not innovation > 0.0:
            break
        said = float(np.log(innovation)) + order * price
        if said < cost:
            best, cost = Colour(regression, innovation), said
    return best


def _asked(samples: int) -> list[slice]:
    """The portions of a log that are asked for its colour: of a long one a few from all over it."""
    portions = [slice(first, first + PORTION) for first in range(0, samples, PORTION)]
    chosen = np.linspace(0, len(portions) - 1, min(len(portions), MOST_PORTIONS)).astype(int).tolist()
    return [portions[i] for i in chosen]


def _correlation(residual: Array, known: NDArray[np.bool_], asked: Sequence[slice], most: int) -> Array:
    """Correlation at lags 0 to `most`, divided by the full count so that it belongs to a process."""
    lags = np.zeros(most + 1)
    for part in asked:  # few enough samples to stay in cache for every lag
        reached = slice(part.start, part.stop + most)
        later = np.where(known[reached], residual[reached], 0.0)
        for lag in range(most + 1):
            moved = later[lag : lag + PORTION]
            lags[lag] += later[: moved.size] @ moved
    return np.asarray(lags / max(lags[0], 1e-300))


def coloured_covariance(moves: Sequence[Array], variances: Sequence[float], colours: Sequence[Colour]) -> Array:
    """Covariance (f, f) of parameters that samples move by `moves` per newton.

    Args:
        moves: per log (n, f); variances: of the force of each log [N^2]; colours: of its noise.
    """
    total = np.zeros((moves[0].shape[1],) * 2)
    for move, variance, noise in zip(moves, variances, colours, strict=True):
        if noise.white:
            total += variance * (move.T @ move)
            continue
        n = 2 * move.shape[0]  # padded: a move at the end knows nothing of one at the beginning
        seen = np.fft.rfft(move, n, axis=0)
        weight = noise.spectrum(n) * np.where(np.isin(np.arange(n // 2 + 1), [0, n // 2]), 1.0, 2.0)
        total += variance / n * np.real(seen.conj().T @ (seen * weight[:, None]))
    return total


@dataclass(frozen=True)
class NoiseAutocorrelation:
    """The noise of all logs: per log the weights of its samples (n,) 1/variance [1/N^2], its colour, and its variance
    over that of the weights."""

    weights: tuple[Array, ...]
    colours: tuple[Colour, ...]
    levels: tuple[float, ...]

    @property
    def white(self) -> bool:
        """Whether no noise has a memory."""
        return all(colour.white for colour in self.colours)


# ----------------------------------------------------------------------------------------------------------------------
# Noise with a memory that is larger than the sticks show, told apart from a misfit.
#
# The noise of a log is measured about lines through its sticks, which take out what is slow. Noise with a memory then
# leaves more than was measured, and a misfit does too. They differ in what the cycles have in common: what a model gets
# wrong comes back in every cycle, at the same place; noise comes as it likes. Flipping the signs of whole cycles leaves
# noise what it is, and destroys what they have in common.
# ----------------------------------------------------------------------------------------------------------------------

Indices = NDArray[np.int64]

MORE = 1.0  # share of the variance measured in the sticks by which that of the residuals may be larger
CLOSE = 0.02  # the same of a log that is as good as white
OF_EACH = 4  # cycles of each log, behind its first one,
FEWEST_CYCLES = 12  # and of all, that tell what they have in common
BINS = (16, 8)  # of a stick, and of a slip
FLIPS = 5000
CHANCE = 1e-3  # that the cycles of noise have so much in common: below, it is a misfit


@dataclass(frozen=True)
class AutocorrelationTest:
    """Noise with a memory: levels (logs,), the variance of the residuals over that measured in the sticks;
    spread_inflation (logs,), by how much its memory widens the spread of a sum of squares."""

    levels: Array
    spread_inflation: Array


def autocorrelation_test(
    logs: Sequence[LogData],
    trajectories: Sequence[ShootingTrajectory],
    fitted: Sequence[Array],
    noise_estimated: Sequence[bool],
    squares: Array,
    counts: Array,
    log: Indices,
) -> AutocorrelationTest | None:
    """What the residuals are, if they are noise with a memory; None where they are not, or too few cycles tell.

    Where no log leaves more than the noise of its sticks, they are noise on the whole, and the memory only widens the
    spread of each cycle.

    Args:
        fitted: (n,) force [N] at the samples of each log, NaN where none is fitted; noise_estimated: per log, whether
            its noise is from its sticks; squares, counts, log (c,): weighted squares and number of the samples of each
            cycle, and its log.
    """
    levels, spread_inflation, stacks = np.ones(len(logs)), np.ones(len(logs)), []
    for number, (data, trajectory, curve) in enumerate(zip(logs, trajectories, fitted, strict=True)):
        mine = log == number
        level = float(squares[mine].sum() / max(counts[mine].sum(), 1.0))
        if level > 1.0 + MORE:
            return None
        residual = np.where(data.weight > 0, data.force - curve, np.nan) / data.noise
        noise = colour(residual)
        if noise_estimated[number] and not noise.white:
            levels[number], spread_inflation[number] = max(level, 1.0), float(np.sqrt(_summed_squares(noise)))
        if level > 1.0 + CLOSE:
            stacks.append(by_phase(data.time, residual, trajectory))
    if not stacks:
        return AutocorrelationTest(levels, spread_inflation) if np.max(spread_inflation) > 1.0 else None
    rows = [len(stack) for stack in stacks]
    if min(rows) < OF_EACH or sum(rows) < FEWEST_CYCLES:
        return None
    return (
        AutocorrelationTest(levels, spread_inflation) if in_common(stacks, np.random.default_rng(0)) > CHANCE else None
    )


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


def by_phase(time: Array, residual: Array, trajectory: ShootingTrajectory) -> Array:
    """Sums of the residuals (n,) in places along stick and slip, over the root of their number (cycles - 1, bins).

    Args:
        residual: in standard deviations of the noise, NaN where none is fitted.
    """
    rows = []
    known = np.isfinite(residual)
    for first, onset, last in zip(trajectory.arrest[:-1], trajectory.onset[1:], trajectory.arrest[1:], strict=True):
        edges = np.concatenate([np.linspace(first, onset, BINS[0] + 1)[:-1], np.linspace(onset, last, BINS[1] + 1)])
        place = np.searchsorted(edges, time, side="right") - 1
        inside = known & (place >= 0) & (place < edges.size - 1)
        total = np.bincount(place[inside], weights=residual[inside], minlength=edges.size - 1)
        number = np.bincount(place[inside], minlength=edges.size - 1)
        rows.append(total / np.sqrt(np.maximum(number, 1)))
    return np.array(rows).reshape(-1, sum(BINS))
