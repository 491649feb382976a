"""Noise with a memory: how residuals hang together from sample to sample, and a covariance that allows for it.

A least-squares fit stays right when its noise is coloured; its standard errors do not: neighbours that err alike tell
less than their number says. The colour is an autoregression of the residuals of each log, of the order that pays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
