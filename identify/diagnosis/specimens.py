"""Logs of several specimens, days or loads: friction, and its static part by itself, differ from log to log.

Both are random effects: normal about what all logs share, and estimated with the parameters. Their standard deviation
is that of restricted maximum likelihood (Patterson and Thompson, Biometrika 58, 545, 1971), and no less than what is
usual or stated. The steps are those of penalised Gauss-Newton, from the columns of the score test.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from identify.base.quantiles import chi_square_exceeded
from identify.diagnosis.quantities import DIFFERENCE, load_gain, parameter
from identify.diagnosis.score_test import Column, ScoreTable, score_table
from identify.estimation.attempt import Attempt, solve_again
from identify.estimation.estimator import in_time
from identify.estimation.search import SearchProblem, search
from identify.logs.log_data import LogData
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns

Array = NDArray[np.float64]

ROUNDS = 6  # solves, each from the step of the one before
SETTLED = 0.1  # fall of chi^2 that is worth no further step
CHANCE = 1e-4  # by which noise alone makes logs differ
FARTHEST = 0.3  # of friction, that a log may be off


@dataclass(frozen=True)
class LogEffects:
    """How far single logs are off what all share, in the order of the scores of a table: step (s,) to where that is
    most likely, covariance (s, s) there, moves (s, f) of the free theta with each, the standard deviation of all, and
    by how much chi^2 falls with the step."""

    step: Array
    covariance: Array
    moves: Array
    sd: float
    fall: float

    @property
    def added(self) -> Array:
        """Covariance (f, f) that they add to that of the free parameters."""
        return np.asarray(self.moves.T @ self.covariance @ self.moves)


@dataclass(frozen=True)
class Scattered:
    """A fit in which logs differ: how far each is off (l, 2), in friction and in its static part over mu_s, and the
    standard deviation of both."""

    attempt: Attempt
    prepared: list[Prepared]
    off: Array
    sd: float


def columns_of(unknowns: Unknowns, mu_s: float) -> list[Column]:
    """Friction of single logs over that of all, and their static part beyond that over mu_s."""
    shift = parameter(unknowns.names.index("mu_s"), logarithmic=False)

    def strength(log: LogData, curve: Array, before: float, after: float) -> LogData:
        return shift(log, curve, mu_s * before, mu_s * after)

    return [Column("load_gain", load_gain, DIFFERENCE, "single"), Column("mu_s", strength, DIFFERENCE, "single")]


def log_effects(table: ScoreTable, at: Array, least: float, inflation: float, *, estimated: bool) -> LogEffects:
    """The most likely deviations of logs, by the quadratic at an iterate.

    Args:
        at: (s,) where they are there; least: their standard deviation, or where it is `estimated` the least it may be.
        inflation: by how much the autocorrelation of the noise widens a variance.
    """
    information, deviation = table.information / inflation, least
    pull = np.diag(information) * np.array([score.step for score in table.scores])
    if estimated and least < FARTHEST:
        known, directions = np.linalg.eigh(information)
        along = directions.T @ (pull + information @ at)

        def unlikely(logarithm: float) -> float:
            precision = np.maximum(known, 0.0) + np.exp(-2.0 * logarithm)
            return float(0.5 * np.sum(np.log(precision) - along**2 / precision) + at.size * logarithm)

        ends = np.log([least, FARTHEST])
        best = scipy.optimize.minimize_scalar(unlikely, bounds=ends, method="bounded").x
        deviation = float(np.exp(min((best, ends[0]), key=unlikely)))
    covariance = np.linalg.inv(information + np.eye(at.size) / deviation**2)
    step = covariance @ (pull - at / deviation**2)
    moves = np.array([score.shift / score.step if score.step else 0.0 * score.shift for score in table.scores])
    fall = float(step @ (pull - at / deviation**2))
    return LogEffects(step, np.asarray(covariance, dtype=np.float64), moves, deviation, fall)


def with_scatter(attempt: Attempt, prepared: Sequence[Prepared], unknowns: Unknowns, least: float) -> Scattered | None:
    """The fit with what single logs are off, from one without; None where noise may be why they are, or where that
    does not describe the data.

    Args:
        least: the least standard deviation.
    """
    best, logs = attempt, list(prepared)
    columns = columns_of(unknowns, abs(float(attempt.solved.theta[unknowns.names.index("mu_s")])))
    names, off = [column.name for column in columns], np.zeros((len(attempt.log_numbers), len(columns)))
    for _ in range(ROUNDS):
        table = score_table(best.solved, columns, best.inflation)
        if not table.scores:
            return None
        of = tuple(np.array([(score.log, names.index(score.column.name)) for score in table.scores]).T)
        effects = log_effects(table, off[of], least, best.inflation, estimated=True)
        if best is attempt and effects.fall < chi_square_exceeded(CHANCE, len(table.scores)):
            return None
        if (best is not attempt and effects.fall < SETTLED) or not in_time("scatter between logs"):
            break
        off[of] = np.clip(off[of] + effects.step, -FARTHEST, FARTHEST)
        theta = best.solved.theta.copy()
        theta[np.flatnonzero(unknowns.free)] += effects.step @ effects.moves
        fitted = list(best.fitted_logs)
        for place, number in enumerate(attempt.log_numbers):
            data, cut = prepared[number].data, fitted[place].data
            for column, size in zip(columns, off[place].tolist(), strict=True):
                assert column.change is not None
                data = column.change(data, data.force, 0.0, size)
            logs[number] = replace(logs[number], data=data)
            fitted[place] = replace(fitted[place], data=replace(data, begin=cut.begin, end=cut.end))
        at = replace(unknowns, start=np.clip(theta, unknowns.lower, unknowns.upper))
        best = solve_again(replace(best, fitted_logs=tuple(fitted)), at)
        if not best.fits:
            other, _ = search(SearchProblem(logs, unknowns, thorough=False))
            if other is not None and other.log_numbers == attempt.log_numbers:
                best = min(best, other, key=lambda each: each.excess)
        if not np.isfinite(best.excess):
            return None
    return Scattered(best, logs, off, effects.sd) if best.fits else None
