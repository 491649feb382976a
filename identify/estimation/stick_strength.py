"""Static friction that differs from stick to stick: its standard deviation, estimated, and each stick's own strength.

A random effect: mu_s of every stick is an unknown about the shared one, with a prior as wide as the strengths scatter,
and is eliminated with the motion. The scatter is that of largest marginal likelihood (restricted maximum likelihood,
Patterson and Thompson 1971), of which one solve tells the whole course: the data's own information on the strengths is
the inverse of their posterior covariance less that of the prior.
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
from identify.estimation.attempt import Attempt, Clock, solve_again, solve_from
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.passes import Solved

Array = NDArray[np.float64]

FIRST = 0.05  # of mu_s - mu_k0: scatter of the first solve
CARRIED = 0.2  # of the same: strong sticks are long ones, which biases t_cr: at 0.15 by one standard error
ROUNDS = 6
STEADY = 0.05  # relative change of the scatter from solve to solve that is none
WORTH = 4.0  # gain in 2 ln(likelihood) from which sticks are said to differ
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
            found = solve_from(with_strengths(prepared, sd), list(attempt.logs), unknowns, Clock())
        else:
            scattering = replace(found, prepared=tuple(with_strengths(found.prepared, sd)))
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
    layout, point = solved.problem.layout, solved.problem.evaluate(solved.solution.z, derivatives=True)
    assert point.hessian is not None and point.jacobian is not None
    own, about = layout.varied, layout.prior_about[layout.varied]
    right = np.zeros((layout.size + layout.rows, own.size))
    columns = np.arange(own.size)
    right[own, columns], right[about, columns] = layout.scale[own], -layout.scale[about]
    answer = Factors(optimality_matrix(point.hessian, point.jacobian)).solve(right)[: layout.size]
    return layout.beside(solved.solution.x)[own], layout.beside(layout.scale[:, None] * answer)[own]


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
