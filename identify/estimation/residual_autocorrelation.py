"""Autocorrelated noise: an autoregression of the residuals of each log, and what follows for intervals and tests.

A least-squares fit stays right when its noise is autocorrelated; its standard errors do not: neighbours that err alike
tell less than their number says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz

from identify.shooting.passes import Solved
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

MOST = 24  # order of the autoregression
FEWEST = 50  # samples per order
PENALTY = 1.5  # times that of Schwarz: white noise is called autocorrelated once in many thousand logs
MORE = 1.0  # share of the variance measured in the sticks by which that of the residuals may be larger
CLOSE = 0.02  # the same of a log that is as good as white
OF_EACH, FEWEST_CYCLES = 4, 12  # cycles of each log behind its first one, and of all, that the test needs
BINS = (16, 8)  # of a stick, and of a slip
FLIPS = 5000
CHANCE = 1e-3  # that the cycles of noise have so much in common: below, it is a misfit


@dataclass(frozen=True)
class ArModel:
    """The noise of one log: autoregression (p,) of its residuals, empty for white noise; share of its variance that is
    new in each sample."""

    regression: Array
    innovation: float

    @property
    def white(self) -> bool:
        """Whether samples are independent of each other."""
        return self.regression.size == 0

    @property
    def inflation(self) -> float:
        """Of the variance of whatever changes slowly: samples that count as one; 1 for white noise."""
        return float(self.innovation / (1.0 - self.regression.sum()) ** 2)

    def spectrum(self, n: int) -> Array:
        """Variance per frequency of a real transform of n samples (n // 2 + 1,), of mean 1 over all frequencies."""
        polynomial = np.concatenate([[1.0], -self.regression])
        return np.asarray(self.innovation / np.abs(np.fft.rfft(polynomial, n)) ** 2)


WHITE = ArModel(np.empty(0), 1.0)


def autoregression(residual: Array) -> ArModel:
    """The autoregression of the residuals of one log (n,), NaN where there is none, of the order that pays."""
    known = np.isfinite(residual)
    filled, count = np.where(known, residual, 0.0), int(np.count_nonzero(known))
    most = min(MOST, count // FEWEST)
    if most < 1:
        return WHITE
    products = np.array([filled[lag:] @ filled[: filled.size - lag] for lag in range(most + 1)])
    correlation = products / max(products[0], 1e-300)  # over the full count, so that it belongs to a process
    best, lowest = WHITE, 0.0
    for order in range(1, most + 1 if correlation[0] > 0.0 else 1):
        regression = solve_toeplitz(correlation[:order], correlation[1 : order + 1])
        innovation = float(1.0 - regression @ correlation[1 : order + 1])
        if not innovation > 0.0:
            break
        criterion = float(np.log(innovation)) + order * PENALTY * np.log(count) / count
        if criterion < lowest:
            best, lowest = ArModel(regression, innovation), criterion
    return best


def autocorrelated_covariance(moves: Sequence[Array], variances: Array, noise: Sequence[ArModel]) -> Array:
    """Covariance (f, f) of parameters that samples move by `moves` per newton.

    Args:
        moves: per log (n, f); variances (l,): of the force of each log [N^2]; noise: of each log.
    """
    total = np.zeros((moves[0].shape[1],) * 2)
    for move, variance, model in zip(moves, variances.tolist(), noise, strict=True):
        if model.white:
            total += variance * (move.T @ move)
            continue
        n = 2 * move.shape[0]  # padded: a move at the end is not next to one at the beginning
        transform = np.fft.rfft(move, n, axis=0)
        weight = model.spectrum(n) * np.where(np.isin(np.arange(n // 2 + 1), [0, n // 2]), 1.0, 2.0)
        total += variance / n * np.real(transform.conj().T @ (transform * weight[:, None]))
    return total


# ----------------------------------------------------------------------------------------------------------------------
# Autocorrelated noise that is larger than the sticks show, told apart from a misfit. Lines through the sticks take out
# what is slow; autocorrelated noise then leaves more than was measured, and a misfit does too. What a model gets wrong
# comes back in every cycle at the same place, noise does not: flipping the signs of whole cycles leaves noise what it
# is, and destroys what they have in common (a randomisation test).
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class AutocorrelationTest:
    """Autocorrelated noise: levels (logs,), the variance of the residuals over that measured in the sticks;
    spread_inflation (logs,), by how much autocorrelation widens the spread of a sum of squares."""

    levels: Array
    spread_inflation: Array


def autocorrelation_test(solved: Solved, noise_estimated: Sequence[bool], level: Array) -> AutocorrelationTest | None:
    """What the residuals are, if they are autocorrelated noise; None where they are not, or the cycles are too few.

    Where no log leaves more than the noise of its sticks, they are noise on the whole, and autocorrelation only widens
    the spread of each cycle.

    Args:
        noise_estimated: per log, whether its noise is from its sticks; level (logs,): variance of the residuals over
            that noise.
    """
    logs, stacks = solved.problem.logs, list[Array]()
    levels, spread_inflation = np.ones(len(logs)), np.ones(len(logs))
    if np.any(level > 1.0 + MORE):
        return None
    for number, (data, trajectory, curve) in enumerate(zip(logs, solved.trajectories, solved.fitted, strict=True)):
        residual = np.where(data.weight > 0, data.force - curve, np.nan) / data.noise
        model = autoregression(residual)
        if noise_estimated[number] and not model.white:
            correlation = np.fft.irfft(model.spectrum(64 * MOST), 64 * MOST)
            levels[number] = max(float(level[number]), 1.0)
            spread_inflation[number] = float(np.sqrt(np.sum((correlation / correlation[0]) ** 2)))
        if level[number] > 1.0 + CLOSE:
            stacks.append(_by_phase(data.time, residual, trajectory))
    rows = [len(stack) for stack in stacks]
    if stacks and (min(rows) < OF_EACH or sum(rows) < FEWEST_CYCLES):
        return None
    is_noise = in_common(stacks, np.random.default_rng(0)) > CHANCE if stacks else np.max(spread_inflation) > 1.0
    return AutocorrelationTest(levels, spread_inflation) if is_noise else None


def in_common(stacks: Sequence[Array], random: np.random.Generator) -> float:
    """Chance that the cycles of noise have as much in common as these of logs have.

    Args:
        stacks: per log (c, bins), the sums of its residuals by cycle and place in it.
    """
    observed, flipped = 0.0, np.zeros(FLIPS)
    for stack in stacks:
        power = np.maximum(np.sum(stack**2, axis=0), 1e-300)
        signs = random.choice([-1.0, 1.0], size=(FLIPS, len(stack)))
        flipped += np.sum((signs @ stack) ** 2 / power, axis=1)
        observed += float(np.sum(np.sum(stack, axis=0) ** 2 / power))
    return (1.0 + float(np.count_nonzero(flipped >= observed))) / (1.0 + FLIPS)


def _by_phase(time: Array, residual: Array, trajectory: ShootingTrajectory) -> Array:
    """Sums of the residuals (n,) in places along stick and slip, over the root of their number (cycles - 1, bins)."""
    rows, known = [], np.isfinite(residual)
    for first, onset, last in zip(trajectory.arrest[:-1], trajectory.onset[1:], trajectory.arrest[1:], strict=True):
        edges = np.concatenate([np.linspace(first, onset, BINS[0] + 1)[:-1], np.linspace(onset, last, BINS[1] + 1)])
        total, _ = np.histogram(time[known], edges, weights=residual[known])
        rows.append(total / np.sqrt(np.maximum(np.histogram(time[known], edges)[0], 1)))
    return np.array(rows).reshape(-1, sum(BINS))
