"""Static friction that differs from stick to stick: its standard deviation, estimated, and each stick's own strength.

A random effect: mu_s of every stick is an unknown about the shared one, with a prior as wide as the strengths scatter,
and is eliminated with the motion. The scatter is that of largest marginal likelihood (restricted maximum likelihood,
Patterson and Thompson 1971), of which one solve tells the whole course: the data's own information on the strengths is
the inverse of their posterior covariance less that of the prior.

The answer is where parameters and strengths together are most likely. What is likeliest of the parameters alone, the
strengths integrated out (Laplace), lies beside it: a contact that ages faster needs smaller deviations for the same
forces. Where all logs tell the parameters it is a part of a standard error away, for a log that hardly does many.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from identify.base.budget import time_is_up
from identify.base.linear import Factors, optimality_matrix
from identify.base.outcome import Status
from identify.estimation.attempt import Attempt, solve_again, solve_from
from identify.estimation.influence import Influence
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.passes import Solved
from identify.shooting.shooting import Problem

Array = NDArray[np.float64]

FIRST = 0.05  # of mu_s - mu_k0: scatter of the first solve
CARRIED = 0.2  # of the same: strong sticks are long ones, which biases t_cr: at 0.15 by one standard error
ROUNDS = 6
STEADY = 0.05  # relative change of the scatter from solve to solve that is none
WORTH = 4.0  # gain in 2 ln(likelihood) from which sticks are said to differ
FAR = 0.3  # standard errors either way over which a slope is taken
REACH = np.log([1e-4, 1e2])  # times the scatter before, within which it is looked for


def with_strengths(prepared: Sequence[Prepared], sd: float) -> list[Prepared]:
    """The logs with a static friction that scatters so from stick to stick (0: it does not)."""
    if not sd > 0.0:
        return list(prepared)
    return [replace(log, data=replace(log.data, strength_sd=sd)) for log in prepared]


def with_own_strengths(attempt: Attempt, prepared: list[Prepared], unknowns: Unknowns) -> Attempt | None:
    """The answer with a strength of each stick, and their scatter; None where that is no scatter, or leads nowhere.

    Args:
        attempt: of sticks that are alike; where it does not fit, the start (unknowns.start) is placed anew on the logs
            it took; prepared: all logs.
    """
    if not unknowns.free[unknowns.source[unknowns.names.index("mu_s")]]:
        return None
    # Where alike sticks do not fit, their parameters are bent, and their slips lie beside those of the data by far more
    # than a slip takes: a sample that has come to lie behind the end of its slip pulls it nowhere.
    found: Attempt | None = attempt if attempt.gate.status is Status.CONVERGED else None
    theta = unknowns.start if found is None else attempt.solved.theta
    sd = FIRST * unknowns.strength(theta)
    for _ in range(ROUNDS):
        if time_is_up() or not sd > 0.0:
            return None
        if found is None:
            found = solve_from(with_strengths(prepared, sd), list(attempt.log_numbers), unknowns)
        else:
            scattering = replace(found, fitted_logs=tuple(with_strengths(found.fitted_logs, sd)))
            found = solve_again(scattering, replace(unknowns, start=found.solved.theta))
        if found is None or not found.solved.solution.success:
            return None
        # The weak priors of a solve pull all sticks towards where it began: only what a solve with the largest scatter
        # still asks for is too much.
        likeliest, most = _likeliest(*_spread(found.solved), sd), CARRIED * unknowns.strength(found.solved.theta)
        if likeliest > most and sd > (1.0 - STEADY) * most:
            return None
        likeliest = min(likeliest, most)
        if abs(likeliest - sd) < STEADY * sd:
            return found
        sd = likeliest
    return found


def _spread(solved: Solved) -> tuple[Array, Array]:
    """Of every stick the deviation of its mu_s from the shared one (c,), and the covariance of what is not told of it
    (c, c)."""
    problem, layout = solved.problem, solved.problem.layout
    covariance = _covariance(problem, solved.solution.z, np.empty(0, dtype=np.int64))
    return layout.beside(solved.solution.x)[layout.varied], covariance


def _covariance(problem: Problem, z: Array, kept: NDArray[np.int64]) -> Array:
    """The covariance (c + f, c + f) of what is not known of the strengths' deviations and of the parameters kept."""
    layout, point = problem.layout, problem.evaluate(z, derivatives=True)
    assert point.hessian is not None and point.jacobian is not None
    asked = np.concatenate([layout.varied, kept])
    about = layout.prior_about[layout.varied]
    right = np.zeros((layout.size + layout.rows, asked.size))
    columns = np.arange(asked.size)
    right[asked, columns] = layout.scale[asked]
    right[about, columns[: about.size]] -= layout.scale[about]
    answer = Factors(optimality_matrix(point.hessian, point.jacobian)).solve(right)[: layout.size]
    return layout.beside(layout.scale[:, None] * answer)[asked]


def integrated_moves(problem: Problem, z: Array, known: Influence, owner: NDArray[np.int64]) -> Array:
    """By how much the strengths of each log (l, f) move the parameters once they are integrated out: half the slope of
    the logarithm of what their posterior covariance spans.

    Args:
        owner: of which log each unknown (n,) is.

    Raises:
        LinAlgError: a covariance that is none.
    """
    layout, kept, logs = problem.layout, known.kept, len(problem.logs)

    def spans(at: Array) -> Array:
        covariance = _covariance(problem, at, kept)
        count = layout.varied.size
        cross, own = covariance[:count, count:], covariance[count:, count:]
        given = covariance[:count, :count] - cross @ np.linalg.solve(own, cross.T)  # the parameters given
        of_log = [np.ix_(mine, mine) for log in range(logs) for mine in [owner[layout.varied] == log]]
        return np.array([np.sum(np.log(np.diag(np.linalg.cholesky(given[rows])))) for rows in of_log])

    out = np.zeros((logs, kept.size))
    for j, (column, parameter) in enumerate(zip(known.columns.T, kept, strict=True)):
        error = np.sqrt(column[parameter])
        step = FAR * column / error / layout.scale  # the other unknowns follow
        out[:, j] = error * (spans(z + step) - spans(z - step)) / (2.0 * FAR)
    return out


def _likeliest(mode: Array, covariance: Array, sd: float) -> float:
    """The scatter of largest marginal likelihood, from what a solve with another one found; 0 where none is likely."""
    size, directions = np.linalg.eigh(0.5 * (covariance + covariance.T))
    told = np.maximum(1.0 / np.clip(size, 1e-12 * sd**2, sd**2) - 1.0 / sd**2, 0.0)  # information of the data alone
    pull = (directions.T @ mode) * (told + 1.0 / sd**2)

    def lost(logarithm: float) -> float:
        prior = np.exp(-2.0 * logarithm) / sd**2
        return float(np.sum(np.log1p(told / prior) - pull**2 / (told + prior)))

    best = minimize_scalar(lost, bounds=tuple(REACH), method="bounded")
    return sd * float(np.exp(best.x)) if best.fun < -WORTH else 0.0
