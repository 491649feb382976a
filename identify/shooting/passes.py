"""Solve in passes: coarse, then fine; after each the samples are assigned anew to the event times found.

A pass assigns samples to integration steps from constant event times. When the last pass moved no event by
more than half a sample, the assignment and the answer agree.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.linear import optimality_matrix, solve_equilibrated
from identify.logs.loads import calmed
from identify.logs.log_data import LogData
from identify.logs.unknowns import Unknowns
from identify.shooting.grid import COARSE_GRID, Grid, fine_grid
from identify.shooting.onsets import turns_back, with_first_onsets, with_last_onsets
from identify.shooting.shooting import Problem, shooting_problem
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.shooting.solve import Solution, solve

Array = NDArray[np.float64]

ORDER = 4  # of the step formula
SETTLED = 0.5  # samples: the last event shift
RETURNED = 1e-4  # samples: events are where they were after an earlier pass
AT_BOUND = 0.9  # of the way to the next event: as far as an event can go in one pass
VANISHING = 0.05  # samples: an event that goes as far as it can, and no farther than this, stands still
SAMPLE_OF_A_SLIP = 0.2  # of its length: what counts as a sample where samples lie farther apart
PASSES, MOST_PASSES = 6, 16  # for every start; for one whose curve all but fits: an event comes 2 samples a pass nearer
LONGEST = 40  # passes where slips last no longer than samples lie apart: an event comes a share of a slip nearer
ALL_BUT = 1.2  # times the noise variance
PATIENCE = 20  # iterations of one solve: more is a ridge, or a wrong start
MANY, BRIEF = 200, 8  # slips among which one holds Gauss-Newton back for all, and iterations until then
ENOUGH, FOLLOWS = 3, 1e-2  # iterations until then from a good start, and the largest row of a motion that comes of it
LOST_MISFIT = 10.0  # misfit over noise with which a solve that did not succeed is not followed further
OVERTIME = 80  # iterations more where a motion hangs together and
ALMOST = 1.5  # times the noise variance is what is left
HANGS = 1e-5  # largest row of a motion that hangs together
AGAIN = 3  # how often slips that begin too late, or too early, are put where they begin
CLOSED = 0.5  # largest row of a coarse motion from which fine passes go on, and
NEAR = 0.1  # from which the exact Hessian is tried: of 70 solves from farther away none came to an end


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
        assert point.hessian is not None and point.jacobian is not None and point.gradient is not None
        kkt = optimality_matrix(point.hessian, point.jacobian)
        # What the solver left of its own conditions is not the steps' doing: it is taken out.
        own = self.problem.evaluate(z, derivatives=True)
        assert own.jacobian is not None and own.gradient is not None
        change = point.gradient - own.gradient + (point.jacobian - own.jacobian).T @ self.solution.multipliers
        left = np.concatenate([change, point.rows - own.rows])
        step = solve_equilibrated(kkt, -left[:, None])[:, 0]
        count = problem.layout.free.size
        return np.asarray(step[:count] * problem.layout.scale[:count])


@dataclass(frozen=True)
class _PassOptions:
    """How to solve, as `solve_in_passes` was asked."""

    cost_cutoff: float
    steps: int
    most: int


def solve_in_passes(
    logs: list[LogData],
    trajectories: list[ShootingTrajectory],
    unknowns: Unknowns,
    *,
    cost_cutoff: float = np.inf,
    steps: int = 0,
    most: int = 1000,
) -> Solved:
    """Solve the shooting problem from trajectories until its event times stand still (or MOST_PASSES).

    Args:
        cost_cutoff: a pass that ends with a larger cost is the last one. steps, most: per interval of the fine passes,
            at least and at most.
    """
    way = _PassOptions(cost_cutoff, steps, most)
    solved = _from_calm(logs, trajectories, unknowns, way)
    for _ in range(AGAIN):
        if time_is_up():
            break
        at_answer = replace(unknowns, start=solved.theta)
        placed = _begun_anew(logs, solved, at_answer)
        if placed is None:
            break
        other = _in_passes(logs, logs, placed, at_answer, way)
        if not _better(other, solved):
            break
        solved = other
    return solved


def _begun_anew(logs: list[LogData], solved: Solved, at_answer: Unknowns) -> list[ShootingTrajectory] | None:
    """The motion found, with the slips that begin too late or too early put where they begin; None where none does."""
    if not np.isfinite(solved.solution.cost):
        return None
    moved = [
        with_first_onsets(log, trajectory, at_answer, COARSE_GRID)
        or (with_last_onsets(trajectory) if _fits(solved) else None)
        for log, trajectory in zip(logs, solved.trajectories, strict=True)
    ]
    if all(trajectory is None for trajectory in moved):
        return None
    return [new or old for new, old in zip(moved, solved.trajectories, strict=True)]


def _better(other: Solved, than: Solved) -> bool:
    """Whether another motion is the one to go on with: of two that fit, the one in which no slip turns back."""
    if other.solution.success != than.solution.success:
        return other.solution.success
    turns, turned = (any(turns_back(trajectory) for trajectory in tried.trajectories) for tried in (other, than))
    if turns != turned and _fits(other) and _fits(than):
        return turned
    return other.solution.cost < than.solution.cost


def _fits(solved: Solved) -> bool:
    return 2.0 * solved.solution.cost < ALMOST * solved.problem.samples


def _from_calm(
    logs: list[LogData], trajectories: list[ShootingTrajectory], unknowns: Unknowns, way: _PassOptions
) -> Solved:
    """Solve; where a load trembles and that is lost, or the way is a long one, from the events of a calm load."""
    calm = [calmed(log) for log in logs]
    trembling = any(quiet is not log for quiet, log in zip(calm, logs, strict=True))
    at_once = _in_passes(logs, logs, trajectories, unknowns, way)
    cost = at_once.solution.cost
    near = at_once.grid is not COARSE_GRID and _fits(at_once)
    if at_once.solution.success or cost > way.cost_cutoff or near or not trembling or time_is_up():
        return at_once
    other = _in_passes(logs, calm, trajectories, unknowns, way)
    return other if _better(other, at_once) else at_once


def _in_passes(
    logs: list[LogData],
    calm: list[LogData],
    trajectories: list[ShootingTrajectory],
    unknowns: Unknowns,
    way: _PassOptions,
) -> Solved:
    """As `solve_in_passes`; the coarse passes with the loads of `calm`."""
    grid, tolerance, mu_init = COARSE_GRID, 1e-3, 1e-4
    iterations, transcription_seconds = 0, 0.0
    solved: Solved | None = None
    exact = False
    been, finest = list[Array](), min(log.interval for log in logs)  # events after each fine pass
    hidden = any(_interval(log, trajectory) < log.interval for log, trajectory in zip(logs, trajectories, strict=True))
    for number in range(1, (LONGEST if hidden else MOST_PASSES) + 1):
        since = time.perf_counter()
        coarse = grid is COARSE_GRID
        pattern = None if solved is None else solved.problem.pattern
        problem = shooting_problem(calm if coarse else logs, trajectories, unknowns, grid, pattern=pattern)
        transcription_seconds += time.perf_counter() - since
        slips = sum(trajectory.arrests for trajectory in trajectories)
        tried = _tried(problem, tolerance, mu_init, exact, slips)
        solution, exact = tried.solution, tried.exact
        iterations += tried.iterations
        theta = unknowns.start.copy()
        theta[problem.layout.free] = solution.x[: problem.layout.free.size]
        formed_from = trajectories
        trajectories = [
            place.read(trajectory, solution.x)
            for place, trajectory in zip(problem.layout.places, trajectories, strict=True)
        ]
        if coarse:  # what stood in for the tremor of the load is no error of its measurement
            trajectories = [
                g if quiet is log else replace(g, deviation=np.zeros_like(g.deviation), slip_deviation=np.empty(0))
                for g, quiet, log in zip(trajectories, calm, logs, strict=True)
            ]
        shift = _shift_in_samples(problem, solution, logs, formed_from)
        solved = Solved(
            problem, grid, formed_from, solution, trajectories, theta, shift, iterations, number, transcription_seconds
        )
        unknowns = replace(unknowns, start=theta)
        if _last(solved, way.cost_cutoff):
            return solved
        if not coarse:
            events = _events(trajectories)
            if any(np.max(np.abs(events - before)) < RETURNED * finest for before in been):
                return solved  # samples change sides to and fro: the passes to come are those that were
            been.append(events)
        fitting = fine_grid(logs, trajectories, unknowns)
        grid, tolerance, mu_init = replace(fitting, steps=min(max(fitting.steps, way.steps), way.most)), 1e-8, 1e-6
    assert solved is not None
    return solved


def _last(solved: Solved, cost_cutoff: float) -> bool:
    """Whether no pass follows: the events stand still, or the solve is lost.

    Args:
        cost_cutoff: largest cost to go on with.
    """
    solution, fine = solved.solution, solved.grid is not COARSE_GRID
    misfit = 2.0 * solution.cost / max(solved.problem.samples, 1)
    far = misfit > LOST_MISFIT if not solution.success else solved.passes >= PASSES and misfit > ALL_BUT
    broken = not solution.success and (fine or solution.constraint_violation > CLOSED)
    if solution.cost > cost_cutoff or far or broken or not np.all(np.isfinite(solution.x)):
        return True
    return (
        (fine and solved.event_shift < SETTLED)
        or time_is_up()
        or not np.all([_ordered(trajectory) for trajectory in solved.trajectories])
    )


def _events(trajectories: Sequence[ShootingTrajectory]) -> Array:
    """When every phase of all motions ends (e,) [s]."""
    return np.concatenate([trajectory.until for trajectory in trajectories])


@dataclass(frozen=True)
class _PassResult:
    """What one pass came to: the last solution, iterations of all, and whether it took the exact Hessian."""

    solution: Solution
    iterations: int
    exact: bool


def _tried(problem: Problem, tolerance: float, mu_init: float, exact: bool, slips: int) -> _PassResult:
    """Solve one pass with Gauss-Newton, where that creeps or wanders with the exact Hessian.

    Args:
        exact: the pass before took the exact Hessian: its answer is near, and Gauss-Newton would leave it again;
            slips: in all logs.
    """
    iterations = 0
    if exact:
        solution = solve(problem, tolerance=tolerance, mu_init=mu_init, iterations=PATIENCE, exact=True)
        if solution.success:
            return _PassResult(solution, solution.iterations, True)
        iterations = solution.iterations
    for most in (PATIENCE,) if slips < MANY else (ENOUGH, BRIEF):
        solution = solve(problem, tolerance=tolerance, mu_init=mu_init, iterations=most)
        iterations += solution.iterations
        follows = solution.constraint_violation < FOLLOWS and 2.0 * solution.cost < ALL_BUT * problem.samples
        if solution.success or follows:
            break
    if solution.success or not solution.constraint_violation < NEAR or time_is_up():
        return _PassResult(solution, iterations, False)
    # Gauss-Newton creeps along a ridge: go on from there with the exact Hessian.
    near = 2.0 * solution.cost < ALMOST * problem.samples
    vibrating = problem.layout.unknowns.model.vibrates  # bends the rows more than anything else
    patience = (1 + (near and vibrating)) * PATIENCE
    solution = solve(problem, tolerance=tolerance, iterations=patience, exact=True, start=solution.z)
    iterations += solution.iterations
    if (
        not solution.success
        and solution.constraint_violation < HANGS
        and 2.0 * solution.cost < ALMOST * problem.samples
    ):
        # The motion hangs together and is near: what is left is the way along a valley.
        solution = solve(problem, tolerance=tolerance, iterations=OVERTIME, exact=True, start=solution.z)
        iterations += solution.iterations
    return _PassResult(solution, iterations, solution.success)


def _ordered(trajectory: ShootingTrajectory) -> bool:
    """Whether every event still follows the one before it."""
    return bool(np.all(np.isfinite(trajectory.until)) and np.all(np.diff(trajectory.until) > 0))


def _interval(log: LogData, trajectory: ShootingTrajectory) -> float:
    """How far samples lie apart [s], or the share of a slip that counts as that where slips are shorter (not where
    half of them last no time at all: a motion that no one can settle)."""
    slip = float(np.median(trajectory.slips)) if trajectory.slips.size else 0.0
    return min(log.interval, SAMPLE_OF_A_SLIP * slip) if slip > 0.0 else log.interval


def _shift_in_samples(
    problem: Problem, solution: Solution, logs: list[LogData], trajectories: list[ShootingTrajectory]
) -> float:
    """Largest event offset of this pass in sample intervals of its log; where slips last no longer than samples lie
    apart, in shares of a slip: in one pass no event leaves the phases beside it."""
    worst = 0.0
    for place, log, trajectory in zip(problem.layout.places, logs, trajectories, strict=True):
        index = place.events
        if index.size:
            interval = _interval(log, trajectory)
            offset = solution.x[index]
            worst = max(worst, float(np.max(np.abs(offset))) / interval)
            # A rest that vanishes halves from pass to pass, for ever, and moves nothing.
            far = goes_as_far_as_it_can(problem, solution.x, index)
            if np.any(far & (np.abs(offset) > VANISHING * interval)):
                worst = max(worst, 2.0 * SETTLED)
    return worst


def goes_as_far_as_it_can(problem: Problem, x: Array, events: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which offsets of events (e,), by their places in the unknowns x (n,), end at their bounds."""
    lower, upper = problem.layout.lower[events], problem.layout.upper[events]
    room = 1.0 - AT_BOUND
    return np.asarray((upper - x[events] < room * np.abs(upper)) | (x[events] - lower < room * np.abs(lower)))
