"""Autocorrelated noise: an autoregression of the residuals of each log, and what follows for intervals and tests.

A least-squares fit stays right when its noise is autocorrelated; its standard errors do not: neighbours that err alike
tell less than their number says.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz

from identify.base.quantiles import chi_square_exceeded
from identify.logs.log_data import LogData
from identify.logs.noise import uneven
from identify.logs.segment import noise_on_lines
from identify.shooting.passes import Solved
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

MOST = 24  # order of the autoregression
FEWEST = 50  # samples per order
PENALTY = 1.5  # times that of Schwarz: white noise is called autocorrelated once in many thousand logs
FEWEST_CYCLES = 12  # behind the first one of each log: the mean of fewer does not tell noise from a misfit
BINS = (8, 4)  # of a stick, and of a slip
CHANCE = 1e-3  # that the mean cycle of noise is so large


@dataclass(frozen=True)
class ArModel:
    """The noise of one log: autoregression (p,) of its residuals, empty for white noise; share of its variance that is
    new in each sample; how many numbers were estimated for it, where these are not its coefficients."""

    regression: Array
    innovation: float
    estimated: int | None = None

    @property
    def white(self) -> bool:
        """Whether samples are independent of each other."""
        return self.regression.size == 0

    @property
    def inflation(self) -> float:
        """Of the variance of whatever changes slowly: samples that count as one; 1 for white noise."""
        return float(self.innovation / (1.0 - self.regression.sum()) ** 2)

    def criterion(self, count: int) -> float:
        """Of count samples by how much it describes them better than white noise does, as Schwarz counts: the lower,
        the better."""
        numbers = self.regression.size if self.estimated is None else self.estimated
        return float(np.log(self.innovation)) + numbers * PENALTY * float(np.log(count)) / count

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
    best = WHITE
    for order in range(1, most + 1 if correlation[0] > 0.0 else 1):
        regression = solve_toeplitz(correlation[:order], correlation[1 : order + 1])
        innovation = float(1.0 - regression @ correlation[1 : order + 1])
        if not innovation > 0.0:
            break
        best = min(best, ArModel(regression, innovation), key=lambda model: model.criterion(count))
    return best


_describe: list[Callable[[Array], ArModel]] = [autoregression]


def register(describe: Callable[[Array], ArModel]) -> None:
    """Add a model of noise that is defined outside the package, for this process.

    Args:
        describe: the model of residuals (n,) [N], NaN where there is none. Whatever is stationary is an autoregression,
            if a long one: what makes it a model of its own is that it has fewer numbers to estimate. WHITE: not this.
    """
    _describe.append(describe)


def noise_model(residual: Array) -> ArModel:
    """The noise of one log by its residuals (n,), NaN where there is none: of all models the one that pays."""
    count = max(int(np.count_nonzero(np.isfinite(residual))), 1)
    return min((describe(residual) for describe in _describe), key=lambda model: model.criterion(count))


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


# Autocorrelated noise told apart from a misfit. Lines through sticks take out what is slow, and the shorter the sticks,
# the more of the noise: its variance about them is no measure of it. What the autoregression leaves of a sample, its
# innovation, is white, and lines through the innovations of the sticks, which know no curve, show its whole variance.
# What a model gets wrong in slips makes innovations larger there. What it gets wrong slowly comes back in every cycle
# at the same place: the mean cycle of noise falls with the number of cycles, that of a misfit does not.


def innovations(data: LogData, trajectory: ShootingTrajectory, residual: Array) -> Array | None:
    """The innovations (n,) of the residuals of a log (NaN: none), in standard deviations of those in its sticks; None
    where the residuals are white, or the sticks too short."""
    model = noise_model(residual)
    in_sticks = _whitened(np.where(np.isfinite(residual) & ~slides(data, trajectory), data.force, np.nan), model)
    edges = np.flatnonzero(np.diff(np.isfinite(in_sticks).astype(np.int8), prepend=0, append=0)).tolist()
    stamps = data.time if uneven(data.time) else None
    sd = (
        None
        if model.white
        else noise_on_lines(np.nan_to_num(in_sticks), zip(edges[::2], edges[1::2], strict=True), stamps)
    )
    return _whitened(residual, model) / sd if sd else None


def slides(data: LogData, trajectory: ShootingTrajectory) -> NDArray[np.bool_]:
    """Which samples (n,) are in the slips of a train of cycles."""
    return np.searchsorted(trajectory.onset, data.time) != np.searchsorted(trajectory.arrest, data.time)


def _whitened(values: Array, model: ArModel) -> Array:
    """What an autoregression leaves of values (n,); NaN where it lacks a sample."""
    polynomial = np.concatenate([[1.0], -model.regression])
    return np.concatenate([np.full(polynomial.size - 1, np.nan), np.convolve(values, polynomial, mode="valid")])


def repeats(solved: Solved, white: Sequence[Array]) -> bool:
    """Whether residuals of logs have a mean cycle that noise has not, or the cycles are too few to know.

    Args:
        white: per log (n,), of variance 1, NaN where none is known.
    """
    cycles, squares, places = 0, 0.0, 0
    for data, trajectory, residual in zip(solved.problem.logs, solved.trajectories, white, strict=True):
        arrest, onset = trajectory.arrest, trajectory.onset
        stick = np.linspace(arrest[:-1], onset[1:], BINS[0], endpoint=False, axis=1)
        slip = np.linspace(onset[1:], arrest[1:], BINS[1], endpoint=False, axis=1)
        index = np.searchsorted(np.concatenate([stick, slip], axis=1).ravel(), data.time) - 1
        known = np.isfinite(residual) & (index >= 0) & (data.time < np.max(arrest, initial=-np.inf))
        total = np.bincount(index[known] % sum(BINS), residual[known], sum(BINS))
        count = np.bincount(index[known] % sum(BINS), minlength=sum(BINS))
        cycles += max(arrest.size - 1, 0)
        squares += float(np.sum(total[count > 0] ** 2 / count[count > 0]))
        places += int(np.count_nonzero(count))
    return cycles < FEWEST_CYCLES or squares > chi_square_exceeded(CHANCE, places)
