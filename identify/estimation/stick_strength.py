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
from identify.estimation.attempt import Attempt, resolve
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.passes import Solved

Array = NDArray[np.float64]

FIRST = 0.02  # of mu_s - mu_k0: scatter of the first solve
CARRIED = 0.08  # of the same: of sticks that differ more, the strong ones are longer, and the mode is off
ROUNDS = 6
STEADY = 0.05  # relative change of the scatter from solve to solve that is none
WORTH = 4.0  # gain in 2 ln(likelihood) from which sticks are said to differ
REACH = np.log([1e-4, 1e2])  # times the scatter before, within which it is looked for


def with_strengths(prepared: Sequence[Prepared], sd: float) -> list[Prepared]:
    """The logs with a static friction that scatters so from stick to stick (0: it does not)."""
    if not sd > 0.0:
        return list(prepared)
    return [replace(log, data=replace(log.data, strength_sd=sd)) for log in prepared]


def with_own_strengths(attempt: Attempt, unknowns: Unknowns) -> Attempt | None:
    """The answer with a strength of each stick, and their scatter; None where that is no scatter, or leads nowhere."""
    if not unknowns.free[unknowns.source[unknowns.names.index("mu_s")]]:
        return None
    sd = FIRST * unknowns.strength(attempt.solved.theta)
    for _ in range(ROUNDS):
        if time_is_up() or not sd > 0.0:
            return None
        scattering = replace(attempt, prepared=tuple(with_strengths(attempt.prepared, sd)))
        attempt = resolve(scattering, replace(unknowns, start=attempt.solved.theta))
        if not attempt.solved.solution.success:
            return None
        found = _likeliest(*_spread(attempt.solved), sd)
        if found > CARRIED * unknowns.strength(attempt.solved.theta):
            return None
        if abs(found - sd) < STEADY * sd:
            return attempt
        sd = found
    return attempt


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
