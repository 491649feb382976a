"""Solve a transcribed problem: with IPOPT (the only file that spells its options), and in passes, coarse, then fine;
after each the samples are assigned anew to the event times of its solution.

A pass assigns samples to integration steps from constant event times. When the last pass moved no event by more than
half a sample, or events go to and fro at one cost, the assignment and the answer agree. Where a pass fails, it is
solved again from where it began within a trust region: a prior on the parameters about the iterate, whose weight grows
a hundredfold with a pass that fails and falls to a tenth with one that succeeds, until it is gone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.budget import seconds_left, stage, time_is_up
from identify.base.linear import optimality_matrix, solve_equilibrated
from identify.logs.log_data import LogData
from identify.logs.unknowns import Unknowns
from identify.shooting.layout import COARSE_GRID, Grid
from identify.shooting.shooting import Point, Problem, shooting_problem
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]
Ports = Sequence[tuple[str, ca.Sparsity]]  # of a function: names and shapes

OUT_OF_ORDER = "Events_Out_Of_Order"
ALWAYS = {  # options of every solve
    "print_time": False,
    "show_eval_warnings": False,  # IPOPT steps back from where a function is not defined
    "no_nlp_grad": True,
    "calc_lam_p": False,
    "calc_lam_x": False,
    "calc_f": False,
    "calc_g": False,
    "ipopt.sb": "yes",
    "ipopt.print_level": 0,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.dual_inf_tol": 1e-2,
    # On a ridge that the data hardly bend, Gauss-Newton creeps: stop where creeping gains nothing.
    "ipopt.acceptable_iter": 4,
    "ipopt.acceptable_tol": 1e10,
    "ipopt.acceptable_dual_inf_tol": 1e10,
    "ipopt.acceptable_constr_viol_tol": 1e-8,
    "ipopt.acceptable_compl_inf_tol": 1e-2,
    "ipopt.nlp_scaling_method": "none",
    # Rows and columns of the parameters meet all others: an ordering that sets them apart, and no permutation.
    "ipopt.mumps_pivot_order": 6,  # MUMPS: approximate minimum degree that looks for rows which are all but dense
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.bound_push": 1e-8,
    "ipopt.bound_frac": 1e-8,
}


@dataclass(frozen=True)
class Solution:
    """What the solver gave back: z (n,) scaled unknowns, x (n,) physical ones, its return_status, whether that means
    success, iterations, cost, largest row, multipliers (m,) of the rows: gradient + J^T multipliers = 0."""

    z: Array
    x: Array
    return_status: str
    success: bool
    iterations: int
    cost: float
    constraint_violation: float
    multipliers: Array


class _NlpCallback(ca.Callback):
    """One function of the problem as CasADi sees it: of arrays, to arrays, with the names and shapes of both."""

    def __init__(self, name: str, inputs: Ports, outputs: Ports, function: Callable[..., Sequence[ArrayLike]]) -> None:
        ca.Callback.__init__(self)
        self._in, self._out, self._function = inputs, outputs, function
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._in)

    def get_n_out(self) -> int:
        return len(self._out)

    def get_name_in(self, i: int) -> str:
        return self._in[i][0]

    def get_name_out(self, i: int) -> str:
        return self._out[i][0]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return self._in[i][1]

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return self._out[i][1]

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, given: Sequence[memoryview], wanted: Sequence[memoryview | None]) -> int:
        # CasADi's own memory: its matrix objects would cost more than the functions of a long log.
        arrays = [np.frombuffer(buffer) if buffer is not None else np.zeros(0) for buffer in given]
        for buffer, value in zip(wanted, self._function(*arrays), strict=True):
            if buffer is not None:
                np.frombuffer(buffer)[:] = value
        return 0


def solve(
    problem: Problem,
    *,
    tolerance: float = 1e-8,
    mu_init: float = 1e-4,
    iterations: int = 60,
    exact: bool = False,
    start: Array | None = None,
) -> Solution:
    """Solve the problem from its starting point, or from `start` (n,) scaled.

    Args:
        tolerance: on the scaled optimality conditions.
        mu_init: IPOPT's first barrier parameter: small from a good start.
        iterations: give up after this many.
        exact: with the exact Hessian instead of Gauss-Newton: dearer per iteration, but it does not creep along
            ridges; only near a solution.

    Returns:
        what the solver gave back; a failure with infinite cost where the events of the trajectory do not follow each
        other.
    """
    layout = problem.layout
    first = problem.start if start is None else start
    if np.any(layout.lower > layout.upper) or not np.isfinite(problem.evaluate(first, derivatives=True).cost):
        return Solution(problem.start, layout.start, OUT_OF_ORDER, False, 0, np.inf, np.inf, np.zeros(layout.rows))

    # The problem remembers the last point, so that what IPOPT asks one by one is computed once: after a value it nearly
    # always asks for the derivatives there.
    def at(z: Array) -> Point:
        return problem.evaluate(z, derivatives=True)

    def values(z: Array, _p: Array) -> Sequence[ArrayLike]:
        return at(z).cost, at(z).rows

    def hessian(z: Array, _p: Array, on_cost: Array, on_rows: Array) -> Sequence[ArrayLike]:
        return ((problem.exact_hessian(z, float(on_cost[0]), on_rows) if exact else on_cost[0] * at(z).hessian).data,)

    x, one, rows = (ca.Sparsity.dense(count) for count in (layout.size, 1, layout.rows))
    xp, pattern = [("x", x), ("p", ca.Sparsity.dense(0, 1))], problem.pattern
    jacobian, lower = [("g", rows), ("jac_g_x", pattern.jacobian.sparsity)], pattern.hessian.sparsity
    nlp = _NlpCallback("nlp", xp, [("f", one), ("g", rows)], values)
    options = ALWAYS | {
        "grad_f": _NlpCallback("grad_f", xp, [("f", one), ("grad_f_x", x)], lambda z, _: (at(z).cost, at(z).gradient)),
        "jac_g": _NlpCallback("jac_g", xp, jacobian, lambda z, _: (at(z).rows, at(z).jacobian.data)),
        "hess_lag": _NlpCallback(
            "hess_lag", [*xp, ("lam_f", one), ("lam_g", rows)], [("triu_hess_gamma_x_x", lower)], hessian
        ),
    }
    options |= {
        "ipopt.tol": tolerance,
        "ipopt.acceptable_obj_change_tol": 1e-3 / max(1.0, problem.samples / 2),  # of half chi^2 per iteration
        "ipopt.mu_init": mu_init,
        "ipopt.max_iter": iterations,
    }
    if math.isfinite(left := seconds_left()):
        options["ipopt.max_wall_time"] = max(left, 0.05)  # [s] also at the last moment
    solver = ca.nlpsol("identify", "ipopt", nlp, options)
    bounds = {"lbx": layout.lower / layout.scale, "ubx": layout.upper / layout.scale, "lbg": 0.0, "ubg": 0.0}
    result = solver(x0=first, **bounds)
    stats, z = solver.stats(), np.array(result["x"]).ravel()
    point = problem.evaluate(z, derivatives=False)
    return Solution(
        z=z,
        x=z * layout.scale,
        return_status=str(stats["return_status"]),
        success=bool(stats["success"]),
        iterations=int(stats["iter_count"]),
        cost=point.cost,
        constraint_violation=float(np.max(np.abs(point.rows), initial=0.0)),
        multipliers=np.array(result["lam_g"]).ravel(),
    )


# In passes.

ORDER = 4  # of the step formula
SETTLED = 0.5  # samples: the last event shift
SAME = 0.05  # cost: an optimum that differs by less, as events go to and fro, is the same one
AT_BOUND = 0.9  # of the way to the next event: as far as an event can go in one pass
PASSES, MOST_PASSES = 6, 40  # for every start; for one whose curve all but fits: an event comes 2 samples a pass nearer
GAUSS_NEWTON, EXACT = 12, 25  # iterations of a pass: more of the one is a ridge, of the other a wrong start
STEPS = (4, 6, 8, 12)  # RK4 steps per interval of the fine passes
FASTEST = 0.5  # largest step times the rate |delta_mu_k| a F_n / m; a linear decay is followed well with twice that


@dataclass(frozen=True)
class Solved:
    """The last pass: problem, solution, theta (n_p,) and the trajectories there, the largest event shift of the last
    pass in samples, iterations and passes in all."""

    problem: Problem
    solution: Solution
    theta: Array
    trajectories: list[ShootingTrajectory]
    event_shift: float
    iterations: int
    passes: int

    @property
    def grid(self) -> Grid:
        """Of the last pass."""
        return self.problem.layout.grid

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
    grid, coarse = first_grid(logs, trajectories, unknowns), True
    exact, weight, failures = False, 0.0, 0
    iterations = 0
    accepted: Solved | None = None
    failed: Solved | None = None
    before, cost, share = np.zeros(1), np.inf, 1.0  # of the fine pass before: event shifts, cost, share that was gone
    for number in range(1, MOST_PASSES + 1):
        pattern = None if accepted is None else accepted.problem.pattern
        region = unknowns if weight == 0.0 else unknowns.within_region(weight)
        with stage("build"):
            problem = shooting_problem(logs, trajectories, region, grid, pattern=pattern)
        # What was beside a jump in a fine pass stays out of later ones: else samples go in and out with its event.
        logs = logs if coarse else problem.logs
        begun = problem.evaluate(problem.start, derivatives=True).cost
        solution, spent, exact = _solve(problem, coarse=coarse, exact=exact)
        iterations += spent
        theta, moved = problem.layout.at(solution.x)
        shift = _shift_in_samples(problem, solution, logs, trajectories)
        passed = Solved(problem, solution, theta, moved, shift, iterations, number)
        # Squares in noise variances per sample.
        begun, misfit = (2.0 * each / max(problem.samples, 1) for each in (begun, solution.cost))
        # A pass that ends with ten times the misfit it began with, or the noise, has lost its way.
        if not (solution.success and misfit < 10.0 * max(begun, 1.0)):
            failed, failures = failed or passed, failures + 1
            if failures > 3 or time_is_up():  # passes in a trust region that fail before the start is given up
                break
            # In units of the weakest prior.
            weight, exact = 100.0 * max(weight, 1.0), False
            continue
        accepted, trajectories, unknowns = passed, moved, replace(unknowns, start=theta)
        if weight > 0.0:
            weight = weight / 10.0 if weight > 1.0 else 0.0
        elif not coarse:
            ends = np.concatenate([place.events for place in problem.layout.places])
            shifts, at = solution.x[ends], solution.x.copy()
            if float(np.sum(before * shifts)) < 0.0 and abs(solution.cost - cost) < SAME:
                passed = replace(passed, event_shift=0.0)  # to and fro, by what the data do not tell
            if passed.event_shift < SETTLED:
                return passed
            # Where events go to and fro, the next pass begins part of the way (Irons and Tuck 1969).
            turn, change = float(np.sum(before * (shifts - before))), float(np.sum((shifts - before) ** 2))
            share = min(-share * turn / change, 1.0) if turn < 0.0 else 1.0
            before, cost = shifts, solution.cost
            at[ends] *= share
            trajectories = problem.layout.at(at)[1]
        in_order = all(np.all(np.isfinite(one.until)) and np.all(np.diff(one.until) > 0) for one in moved)
        if solution.cost > cost_cutoff or time_is_up() or not in_order:
            return passed
        if number >= PASSES and failed is None and misfit > 1.2:  # times the noise variance
            return passed
        if weight == 0.0:
            fitting = fine_grid(logs, moved, unknowns)
            grid, coarse = replace(fitting, steps=max(fitting.steps, steps)), False
    return failed or accepted  # type: ignore[return-value]  # there is a pass at least


def first_grid(logs: list[LogData], trajectories: list[ShootingTrajectory], unknowns: Unknowns) -> Grid:
    """The coarse grid; the fine one where something lags: longer steps than its time constant are unstable."""
    lagging = unknowns.model.decays.size_out(0)[0] > 0
    return fine_grid(logs, trajectories, unknowns) if lagging else COARSE_GRID


def fine_grid(logs: list[LogData], trajectories: list[ShootingTrajectory], unknowns: Unknowns) -> Grid:
    """The grid of the fine passes: as many steps as the fastest rate of the renewed slips asks for."""
    names = unknowns.names
    needed = 0.0
    for log, trajectory in zip(logs, trajectories, strict=True):
        p = dict(zip(names, unknowns.values(trajectory.theta(unknowns.start), log.base).tolist(), strict=True))
        rate = abs(p.get("delta_mu_k", 0.0)) * p.get("a", 0.0) * log.mean_normal_force / p["mass"]
        decays = np.array(unknowns.model.decays(np.array(list(p.values())))).ravel()
        rate = max([rate, *(0.5 * decays).tolist()])
        # In the second half of a slip friction weakens as the speed falls.
        shares = [{"slip": 0.5, "renewed": 1.0}.get(kind, 0.0) / count for kind, _, count in trajectory.modes]
        longest = np.max(shares * np.diff([log.begin, *trajectory.until]), initial=0.0)
        needed = max(needed, rate * float(longest) / FASTEST)
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
    if solution.success or not solution.constraint_violation < 0.1 or time_is_up():  # far from any motion
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
            interval = min(log.interval, 0.2 * slip) if slip > 0.0 else log.interval
            worst = max(worst, float(np.max(np.abs(solution.x[place.events]))) / interval)
            if np.any(goes_as_far_as_it_can(problem, solution.x, place.events)):
                worst = max(worst, 2.0 * SETTLED)
    return worst


def goes_as_far_as_it_can(problem: Problem, x: Array, events: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which offsets of events (e,), by their places in the unknowns x (n,), end at their bounds."""
    lower, upper = problem.layout.lower[events], problem.layout.upper[events]
    room = 1.0 - AT_BOUND
    return np.asarray((upper - x[events] < room * np.abs(upper)) | (x[events] - lower < room * np.abs(lower)))
