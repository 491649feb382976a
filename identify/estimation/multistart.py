"""Other optima of the same problem: starts about an answer, ranked by a fit to one cycle, the best of them solved.

A misfit has several optima where few samples show a slip. All optima that are found stand in the result, with how many
starts led to each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.quantiles import LEVEL, chi_square
from identify.estimation.attempt import Attempt, place_on, solve_again, solve_from
from identify.estimation.estimator import no_time_for, tried
from identify.estimation.profile import converged
from identify.estimation.starts import apart, features_of
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.logs.vibration import quieted, rhythmic
from identify.shooting.passes import Solution, first_grid, solve
from identify.shooting.shooting import shooting_problem
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.shooting.starts import GOOD, candidates, fit_features

Array = NDArray[np.float64]

OTHER_OPTIMA = "other optima"
DRAWN = 16  # starts of two Latin hypercubes
REACH = 2.0  # of the spread of a logarithm (a factor of seven); of a coefficient, half as far
DISTINCT = 0.35  # of that reach, in one parameter at least, between two starts that are both solved
WORSE = 2.0  # times the best fit to a cycle: what is no better is not solved
SOLVED, AGAIN = 5, 3  # starts that are solved at most; once so many led to the lowest optimum, no more are
ONE_OPTIMUM = 3.0  # standard errors between two solutions of one optimum
COST_CUTOFF = 200.0  # cost above that of the answer with which a start is not followed further


@dataclass(frozen=True)
class Optimum:
    """A local optimum, and how many starts led to it."""

    attempt: Attempt
    starts: int

    @property
    def cost(self) -> float:
        """Half the sum of squares in noise variances."""
        return self.attempt.solved.solution.cost


def multistart(attempt: Attempt, unknowns: Unknowns, seed: int, covariance: Array) -> list[Optimum]:
    """The optima that starts about an answer lead to, the lowest first; the answer is one of them.

    All are of the very samples of the answer. A start is solved coarsely first, and left where that leads to a known
    optimum, within some standard errors at about its cost, or far above it.

    Args:
        covariance: (f, f) of the free theta at the answer.
    """
    logs, known, free = list(attempt.fitted_logs), [Optimum(attempt, 1)], np.flatnonzero(unknowns.free)
    precision, every = np.linalg.pinv(covariance), list(range(len(attempt.fitted_logs)))
    # Where each known optimum has its coarse one.
    coarse = [_coarse(logs, attempt.solved.trajectories, replace(unknowns, start=attempt.solved.theta))]

    def nearest(thetas: list[Array], theta: Array) -> int | None:
        squared = [float((theta - each) @ precision @ (theta - each)) for each in thetas]
        best = int(np.argmin(squared))
        return best if squared[best] < ONE_OPTIMUM**2 else None

    for theta in _starts(logs, unknowns, attempt.solved.theta, np.sqrt(np.diag(covariance)), seed)[:SOLVED]:
        if time_is_up():
            no_time_for(OTHER_OPTIMA)
            break
        start = replace(unknowns, start=theta)
        placed = place_on(logs, every, start)
        if len(placed) < len(logs):
            continue
        first = _coarse([log for _, log, _ in placed], [motion for _, _, motion in placed], start)
        number = None
        if first.success:  # else its iterate is no motion of the model
            if not first.cost < coarse[0].cost + COST_CUTOFF:
                continue
            theta = theta.copy()
            theta[free] = first.x[: free.size]
            number = nearest([each.x[: free.size] for each in coarse], theta[free])
        if number is None or not 2.0 * abs(first.cost - coarse[number].cost) < chi_square(LEVEL, free.size):
            solutions = _solved(attempt, replace(unknowns, start=theta), np.sqrt(np.diag(covariance)))
            if solutions is None:
                continue
            number = nearest([optimum.attempt.solved.theta[free] for optimum in known], solutions.solved.theta[free])
            if number is None:
                known, coarse = [*known, Optimum(solutions, 1)], [*coarse, first]
                continue
        known[number] = replace(known[number], starts=known[number].starts + 1)
        if min(known, key=lambda optimum: optimum.cost).starts > AGAIN:
            break
    return sorted(known, key=lambda optimum: optimum.cost)


def _coarse(logs: Sequence[Prepared], motion: Sequence[ShootingTrajectory], unknowns: Unknowns) -> Solution:
    """One coarse solve from a motion of theta unknowns.start."""
    first, *others = motion  # what every log has for itself, the first log has in the shared theta
    weak = replace(unknowns, start=first.theta(unknowns.start)).with_weak_priors()
    motion = [replace(first, own=np.empty(0)), *others]
    data = [log.data for log in logs]
    problem = shooting_problem(data, motion, weak, first_grid(data, motion, weak))
    return solve(problem, tolerance=1e-3, mu_init=1e-4, iterations=20)


def _solved(attempt: Attempt, unknowns: Unknowns, sizes: Array) -> Attempt | None:
    """The optimum of all logs of an answer, of its very samples, from unknowns.start; None where there is none."""
    logs, cutoff = list(attempt.fitted_logs), attempt.solved.solution.cost + COST_CUTOFF
    every = list(range(len(logs)))
    found = tried(OTHER_OPTIMA, lambda: solve_from(logs, every, unknowns, cutoff), attempt, attempt.log_numbers)
    if found is None or len(found.log_numbers) < len(logs):
        return None
    found = replace(found, log_numbers=attempt.log_numbers, fitted_logs=attempt.fitted_logs)
    samples = attempt.solved.problem.samples
    if found.fits and found.solved.problem.samples != samples:  # a log was cut elsewhere
        found = solve_again(found, replace(unknowns, start=found.solved.theta))
    if not found.fits or found.solved.problem.samples != samples:
        return None
    return replace(found, solved=converged(found.solved, found.solved.problem, sizes) or found.solved)


def _starts(logs: Sequence[Prepared], unknowns: Unknowns, centre: Array, errors: Array, seed: int) -> list[Array]:
    """Starts (n_p,) clearly apart, the best first: Latin hypercubes about a centre (n_p,), and what the levels of the
    data say, each fitted to a cycle; as they are drawn where no log has settled cycles.

    Half of them go in every parameter no farther than where its error (f,) lets the cost pass COST_CUTOFF: what the
    data know well leaves the others no chance where it is drawn from afar.
    """
    reach = REACH * unknowns.spread * np.where(unknowns.logarithmic, 1.0, 0.5)
    reach = np.where(unknowns.free & ~rhythmic(unknowns), np.minimum(reach, unknowns.prior_deviation), 0.0)
    near, drawn, random = reach.copy(), reach > 0.0, np.random.default_rng(seed)
    near[unknowns.free] = np.minimum(reach[unknowns.free], (2.0 * COST_CUTOFF) ** 0.5 * errors)
    sample = np.tile(centre, (DRAWN, 1))
    for rows, each in ((slice(DRAWN // 2), near), (slice(DRAWN // 2, DRAWN), reach)):
        count = len(sample[rows])
        places = random.permuted(np.tile(np.arange(count), (int(drawn.sum()), 1)), axis=1).T
        sample[rows, drawn] += each[drawn] * (2.0 * (places + random.random(places.shape)) / count - 1.0)
    sample = np.clip(sample, unknowns.lower, unknowns.upper)
    features, bases = features_of(logs)
    if features:
        settled = quieted(unknowns)
        sample = np.concatenate([sample, candidates(unknowns, features, bases)])
        fitted = fit_features(settled, features, bases, sample, keep=len(sample))
        worst = max(GOOD, WORSE * fitted[0].cost)
        found = [np.where(settled.free, start.theta, centre) for start in fitted if start.cost < worst]
        sample = np.array(found).reshape(-1, centre.size)
    return list(apart(np.where(unknowns.free, sample, centre), np.where(drawn, DISTINCT * reach, np.inf)))
