"""Solve in passes: coarse, then fine; after each the samples are assigned anew to the event times of its solution.

A pass assigns samples to integration steps from constant event times. When the last pass moved no event by more than
half a sample, the assignment and the answer agree. Where a pass fails, it is solved again from where it began within a
trust region: a prior on the parameters about the iterate, whose weight grows tenfold with a pass that fails and falls
with one that succeeds, until it is gone.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.linear import optimality_matrix, solve_equilibrated
from identify.logs.log_data import LogData
from identify.logs.unknowns import Unknowns
from identify.shooting.layout import COARSE_GRID, Grid
from identify.shooting.shooting import Problem, shooting_problem
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.shooting.solve import Solution, solve

Array = NDArray[np.float64]

ORDER = 4  # of the step formula
SETTLED = 0.5  # samples: the last event shift
RETURNED = 1e-4  # samples: events are where they were after an earlier pass
AT_BOUND = 0.9  # of the way to the next event: as far as an event can go in one pass
SAMPLE_OF_A_SLIP = 0.2  # of its length: what counts as a sample where samples lie farther apart
PASSES, MOST_PASSES = 6, 40  # for every start; for one whose curve all but fits: an event comes 2 samples a pass nearer
ALL_BUT = 1.2  # times the noise variance
GAUSS_NEWTON, EXACT = 12, 25  # iterations of a pass: more of the one is a ridge, of the other a wrong start
NEAR = 0.1  # largest row of a motion from which the exact Hessian leads on
LOST = 10.0  # times the misfit with which a pass began, or the noise: one that ends with more has lost its way
FIRST_WEIGHT, FACTOR = 100.0, 10.0  # of the trust region, in units of the weakest prior, and its change
REJECTED = 3  # passes in a trust region that fail before the start is given up
STEPS = (4, 6, 8, 12)  # RK4 steps per interval of the fine passes
FASTEST = 0.5  # largest step times the rate |delta_mu_k| a F_n / m
SLACK = 0.5  # a linear decay is followed well with twice the step


@dataclass(frozen=True)
class Solved:
    """The last pass: problem, grid, the trajectories it was formed from, solution, the trajectories moved to it, theta
    (n_p,), the largest event shift of the last pass in samples, iterations and passes in all, seconds spent
    forming problems."""

    problem: Problem
    grid: Grid
    formed_from: list[ShootingTrajectory]
    solution: Solution
    trajectories: list[ShootingTrajectory]
    theta: Array
    event_shift: float
    iterations: int
    passes: int
    transcription_seconds: float

    @cached_property
    def fitted(self) -> list[Array]:
        """What the load cell sees according to the solution, as `Problem.fitted`."""
        return self.problem.fitted(self.solution.z)

    @cached_property
    def discretisation_error(self) -> Array:
        """Error of theta (f,) of the free parameters that the integration steps leave, signed, in search units: from
        one Newton step on the same problem with twice as many steps, and the order of the step formula."""
        return -self.moved_by_steps(self.problem.with_steps(2 * self.grid.steps)) * 2**ORDER / (2**ORDER - 1)

    def moved_by_steps(self, problem: Problem) -> Array:
        """How far theta (f,) of the free parameters would go from the answer if its steps were those of another
        problem, which is the same unknown by unknown: one Newton step on that, in search units."""
        z = self.solution.z
        point = problem.evaluate(z, derivatives=True)
        kkt = optimality_matrix(point.hessian, point.jacobian)
        # What the solver left of its own conditions is not the steps' doing: it is taken out.
        own = self.problem.evaluate(z, derivatives=True)
        change = point.gradient - own.gradient + (point.jacobian - own.jacobian).T @ self.solution.multipliers
        left = np.concatenate([change, point.rows - own.rows])
        step = solve_equilibrated(kkt, -left[:, None])[:, 0]
        count = problem.layout.free.size
        return np.asarray(step[:count] * problem.layout.scale[:count])


def solve_in_passes(
    logs: list[LogData],
    trajectories: list[ShootingTrajectory],
    unknowns: Unknowns,
    *,
    cost_cutoff: float = np.inf,
    steps: int = 0,
) -> Solved:
    """Solve the shooting problem from trajectories until its event times stand still (or MOST_PASSES).

    Args:
        cost_cutoff: a pass that converges with a larger cost is the last one. steps: per interval of the fine passes,
            at least.
    """
    grid, exact, weight, failures = COARSE_GRID, False, 0.0, 0
    iterations, seconds = 0, 0.0
    accepted: Solved | None = None
    failed: Solved | None = None
    visited, finest = list[Array](), min(log.interval for log in logs)  # events after each fine pass
    for number in range(1, MOST_PASSES + 1):
        since = time.perf_counter()
        pattern = None if accepted is None else accepted.problem.pattern
        region = unknowns if weight == 0.0 else unknowns.within_region(weight)
        problem = shooting_problem(logs, trajectories, region, grid, pattern=pattern)
        seconds += time.perf_counter() - since
        solution, spent, exact = _solve(problem, coarse=grid is COARSE_GRID, exact=exact)
        iterations += spent
        theta = unknowns.start.copy()
        theta[problem.layout.free] = solution.x[: problem.layout.free.size]
        moved = [place.read(one, solution.x) for place, one in zip(problem.layout.places, trajectories, strict=True)]
        shift = _shift_in_samples(problem, solution, logs, trajectories)
        passed = Solved(problem, grid, trajectories, solution, moved, theta, shift, iterations, number, seconds)
        begun, misfit = (  # squares in noise variances per sample
            2.0 * cost / max(problem.samples, 1)
            for cost in (problem.evaluate(problem.start, derivatives=False).cost, solution.cost)
        )
        if not (solution.success and misfit < LOST * max(begun, 1.0)):
            failed, failures = failed or passed, failures + 1
            if failures > REJECTED or time_is_up():
                break
            weight, exact = FACTOR * weight if weight > 0.0 else FIRST_WEIGHT, False
            continue
        accepted, trajectories, unknowns = passed, moved, replace(unknowns, start=theta)
        if weight > 0.0:
            weight = weight / FACTOR if weight > 1.0 else 0.0
        elif grid is not COARSE_GRID:
            events = np.concatenate([one.until for one in moved])
            if shift < SETTLED or any(np.max(np.abs(events - at)) < RETURNED * finest for at in visited):
                return passed  # at rest, or samples change sides to and fro: the passes to come are those that were
            visited.append(events)
        in_order = all(np.all(np.isfinite(one.until)) and np.all(np.diff(one.until) > 0) for one in moved)
        if solution.cost > cost_cutoff or time_is_up() or not in_order:
            return passed
        if number >= PASSES and failed is None and misfit > ALL_BUT:
            return passed
        if weight == 0.0:
            fitting = fine_grid(logs, moved, unknowns)
            grid = replace(fitting, steps=max(fitting.steps, steps))
    return failed or accepted  # type: ignore[return-value]  # there is a pass at least


def fine_grid(logs: list[LogData], trajectories: list[ShootingTrajectory], unknowns: Unknowns) -> Grid:
    """The grid of the fine passes: as many steps as the fastest rate of the worn slips asks for."""
    names = unknowns.names
    needed = 0.0
    for log, trajectory in zip(logs, trajectories, strict=True):
        p = dict(zip(names, unknowns.values(trajectory.theta(unknowns.start), log.base).tolist(), strict=True))
        rate = abs(p.get("delta_mu_k", 0.0)) * p.get("a", 0.0) * log.mean_normal_force / p["mass"]
        decays = np.array(unknowns.model.decays(np.array(list(p.values())))).ravel()
        rate = max([rate, *(SLACK * decays).tolist()])
        longest = np.nanmax(
            np.concatenate([trajectory.arrest - trajectory.wear, (trajectory.arrest - trajectory.onset) / 2, [0.0]])
        )
        needed = max(needed, rate * float(longest) / COARSE_GRID.worn / FASTEST)
    steps = next((s for s in STEPS if s >= needed), STEPS[-1])
    return replace(COARSE_GRID, steps=steps)


def _solve(problem: Problem, *, coarse: bool, exact: bool) -> tuple[Solution, int, bool]:
    """Solution, iterations, whether the exact Hessian (exact: taken at once) led on where Gauss-Newton creeps."""
    tolerance, mu_init = (1e-3, 1e-4) if coarse else (1e-8, 1e-6)
    iterations = 0
    if exact:
        solution = solve(problem, tolerance=tolerance, mu_init=mu_init, iterations=EXACT, exact=True)
        if solution.success:
            return solution, solution.iterations, True
        iterations = solution.iterations
    solution = solve(problem, tolerance=tolerance, mu_init=mu_init, iterations=GAUSS_NEWTON)
    iterations += solution.iterations
    if solution.success or not solution.constraint_violation < NEAR or time_is_up():
        return solution, iterations, False
    solution = solve(problem, tolerance=tolerance, iterations=EXACT, exact=True, start=solution.z)
    return solution, iterations + solution.iterations, solution.success


def _shift_in_samples(
    problem: Problem, solution: Solution, logs: list[LogData], trajectories: list[ShootingTrajectory]
) -> float:
    """Largest event offset in sample intervals, or in shares of a short slip; one that ends at its bound moves on."""
    worst = 0.0
    for place, log, trajectory in zip(problem.layout.places, logs, trajectories, strict=True):
        if place.events.size:
            slip = float(np.median(trajectory.slips)) if trajectory.slips.size else 0.0
            interval = min(log.interval, SAMPLE_OF_A_SLIP * slip) if slip > 0.0 else log.interval
            worst = max(worst, float(np.max(np.abs(solution.x[place.events]))) / interval)
            if np.any(goes_as_far_as_it_can(problem, solution.x, place.events)):
                worst = max(worst, 2.0 * SETTLED)
    return worst


def goes_as_far_as_it_can(problem: Problem, x: Array, events: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which offsets of events (e,), by their places in the unknowns x (n,), end at their bounds."""
    lower, upper = problem.layout.lower[events], problem.layout.upper[events]
    room = 1.0 - AT_BOUND
    return np.asarray((upper - x[events] < room * np.abs(upper)) | (x[events] - lower < room * np.abs(lower)))
