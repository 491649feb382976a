"""Static friction that differs from stick to stick: its standard deviation, estimated, and each stick's own strength.

A random effect: mu_s of every stick is an unknown about the shared one, with a prior as wide as the strengths scatter,
and is eliminated with the motion. The scatter is that of largest marginal likelihood (restricted maximum likelihood,
Patterson and Thompson 1971), of which one solve gives the whole function: the data's own information on the strengths
is the inverse of their posterior covariance less that of the prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from identify.base.budget import time_is_up
from identify.estimation.attempt import Attempt, solve_again, solve_from
from identify.estimation.goodness_of_fit import stick_deviations
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.passes import Solved

STEADY = 0.05  # relative change of the scatter from solve to solve that is none
RANGE = (float(np.log(1e-4)), float(np.log(1e2)))  # times the scatter before, within which it is looked for


def with_strengths(prepared: Sequence[Prepared], sd: float) -> list[Prepared]:
    """The logs with a static friction that scatters so from stick to stick (0: it does not)."""
    return [replace(log, data=replace(log.data, strength_sd=sd)) for log in prepared]


def with_own_strengths(attempt: Attempt, prepared: list[Prepared], unknowns: Unknowns) -> Attempt | None:
    """The answer with a strength of each stick, and their scatter; None where that is no scatter, or leads nowhere.

    Args:
        attempt: of sticks that are alike; where it does not fit, the start (unknowns.start) is placed again on the logs
            it took: its parameters are bent, and a sample behind the end of its slip pulls that nowhere; prepared: all
            logs.
    """
    if not unknowns.free[unknowns.names.index("mu_s")]:
        return None
    best: Attempt | None = attempt if attempt.fits else None
    sd = 0.05 * unknowns.strength(unknowns.start if best is None else best.solved.theta)
    for _ in range(6):
        if time_is_up() or not sd > 0.0:
            return None
        if best is None:
            best = solve_from(with_strengths(prepared, sd), list(attempt.log_numbers), unknowns)
        else:
            scattering = replace(best, fitted_logs=tuple(with_strengths(best.fitted_logs, sd)))
            best = solve_again(scattering, replace(unknowns, start=best.solved.theta))
        if best is None or not best.solved.solution.success:
            return None
        # The weak priors of a solve pull all sticks towards where it began: only what a solve with the largest scatter
        # still asks for is too much.
        # Strong sticks are long ones, which biases t_cr: at a scatter of 0.15 by one standard error.
        (likely, _), most = likeliest(best.solved, sd), 0.2 * unknowns.strength(best.solved.theta)
        if likely > most and sd > (1.0 - STEADY) * most:
            return None
        before, sd = sd, min(likely, most)
        if abs(sd - before) < STEADY * before:
            return best
    return best


def likeliest(solved: Solved, sd: float) -> tuple[float, float]:
    """The scatter of largest marginal likelihood, from a solve with another one, and by how much 2 ln(likelihood) rises
    with it; 0 where none is likely."""
    deviations, covariance = stick_deviations(solved)
    size, directions = np.linalg.eigh(0.5 * (covariance + covariance.T))
    information = np.maximum(1.0 / np.clip(size, 1e-12 * sd**2, sd**2) - 1.0 / sd**2, 0.0)  # of the data alone
    pull = (directions.T @ deviations) * (information + 1.0 / sd**2)

    def deviance(logarithm: float) -> float:
        prior = np.exp(-2.0 * logarithm) / sd**2
        return float(np.sum(np.log1p(information / prior) - pull**2 / (information + prior)))

    best = scipy.optimize.minimize_scalar(deviance, bounds=RANGE, method="bounded")
    return sd * float(np.exp(best.x)) if best.fun < -4.0 else 0.0, -float(best.fun)
