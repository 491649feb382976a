"""Profile likelihood: the lowest cost with one parameter fixed, as a function of that parameter.

An interval from the curvature at the answer is right where the cost is a paraboloid. A profile interval (Venzon and
Moolgavkar, Appl. Stat. 37, 1988) ends where the cost rises by the quantile of the likelihood ratio, whatever its shape.
Every point is solved again by Newton's method with the exact Hessian, from where tangents predict it; the slope of the
profile, which is the multiplier of the fixed parameter, leads to the end of each side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.linear import Factors, optimality_matrix
from identify.base.progress import Progress, to_nobody
from identify.base.quantiles import LEVEL, chi_square
from identify.estimation.covariance import WEAK
from identify.estimation.strategies import no_time_for
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.layout import kept_parameters
from identify.shooting.passes import SETTLED, Solved
from identify.shooting.shooting import Problem, shooting_problem
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.shooting.solve import solve

Array = NDArray[np.float64]

CRITICAL = chi_square(LEVEL, 1)  # of the likelihood ratio 2 (cost - smallest cost), one degree of freedom
BETTER = 0.5  # by which 2 cost must be smaller for a point to count as lower than the answer
REACH_LOG = 3.0 * float(np.log(WEAK))  # of a logarithm: farther than a verdict asks, ends of others depend on open ones
REACH_STEP, REACH_VALUE = 0.9, 1.05 * (1.0 - 1.0 / WEAK)  # of a coefficient: of mu_s - mu_k0, and of its own value
CLOSE = 0.05  # of a side, by which an end is extrapolated
FAR = 1.3  # of the root of the critical ratio: from a point no farther, an end is interpolated
FARTHER, SHORTER, LEAP, SHORTEST = 2.5, 0.3, 0.3, 0.05  # times the step before; and of that of the covariance
POINTS, SOLVES = 20, 3  # of one side: at most, and of these by IPOPT, where Newton's method finds none
FREE = -1  # no parameter is fixed


@dataclass(frozen=True)
class Side:
    """One end of an interval in theta; None: open, since the cost does not rise enough, or where the solver `failed`;
    walled: it ends at a bound of the scene."""

    end: float | None
    failed: bool
    walled: bool = False


@dataclass(frozen=True)
class Curve:
    """Theta (k,), rising, and the likelihood ratio there (k,), for white noise."""

    theta: Array
    loss: Array


@dataclass(frozen=True)
class ProfilePoint:
    """The lowest cost with one parameter fixed (FREE: none): theta (n_p,), the motion there, the cost of data and
    user's priors."""

    theta: Array
    trajectories: list[ShootingTrajectory]
    cost: float
    fixed: int


@dataclass(frozen=True)
class Profiles:
    """Profile intervals and curves by parameter, theta (n_p,) at the lowest cost, a point that lies lower than the
    answer (None: there is none) and the likelihood ratio by which it does; likely (m, f): points on the profiles from
    there, and the likelihood ratios (m,) at them, for white noise."""

    ends: dict[str, tuple[Side, Side]]
    curves: Mapping[str, Curve] = field(default_factory=dict)
    best: Array = field(default_factory=lambda: np.empty(0))
    lower: ProfilePoint | None = None
    gain: float = 0.0
    likely: Array = field(default_factory=lambda: np.empty((0, 0)))
    ratios: Array = field(default_factory=lambda: np.empty(0))

    def with_optimum(self, unknowns: Unknowns, theta: Array, halves: Array) -> Profiles:
        """With intervals that hold another optimum (n_p,) too, and `halves` (n_p,) on both sides of it."""
        ends = dict(self.ends)
        for name, (low, high) in self.ends.items():
            i = unknowns.names.index(name)
            if low.end is not None and high.end is not None:
                at = theta[i] - halves[i], theta[i] + halves[i]
                ends[name] = replace(low, end=min(low.end, at[0])), replace(high, end=max(high.end, at[1]))
        return replace(self, ends=ends)


def profile(
    logs: Sequence[Prepared],
    solved: Solved,
    unknowns: Unknowns,
    sizes: Array,
    inflation: Array,
    *,
    only: Sequence[int],
    points: int = 1,
    restart: bool = False,
    progress: Progress = to_nobody,
) -> Profiles:
    """Profile intervals about an answer. Where the time is up, the parameters that are left have none.

    Args:
        sizes: (f,) standard errors of the free theta for white noise; inflation: (f,) of each variance by all that is
            allowed for beside white noise: the critical likelihood ratio is so much larger (Kent, Biometrika 69, 1982).
        only: indices of the parameters; points: of each side at least: 1 finds its end, more draw the curve.
        restart: end at the first point that lies lower than the answer.
    """
    work = _Workspace(logs, solved, unknowns, sizes)
    best, answer = work.lowest(solved)
    if best is None:
        return Profiles({})
    at = {index: number for number, index in enumerate(np.flatnonzero(unknowns.free).tolist())}
    limits = {i: CRITICAL * float(inflation[at[i]]) for i in only}
    sides, seen = dict[int, tuple[Side, Side]](), [best.point]
    outermost = dict[tuple[int, float], ProfilePoint]()
    for index, limit in limits.items():
        progress(f"profile of {unknowns.names[index]}", None)
        root = float(np.sqrt(limit))
        (low, down), (high, up) = (_side(work, best, index, root, sign * sizes[at[index]], points) for sign in (-1, 1))
        if time_is_up():
            no_time_for("profiles")
            break
        sides[index] = low, high
        for sign, found in ((-1.0, down), (1.0, up)):
            outermost[index, sign] = found[-1] if found else best.point
        seen += [*down, *up]
        if restart and 2.0 * (answer - min(point.cost for point in seen)) > BETTER:
            break
    lowest = min(seen, key=lambda point: point.cost)
    gain = max(0.0, 2.0 * (answer - lowest.cost))
    ends, curves = {}, {}
    for index, (low, high) in sides.items():
        # A side holds every likely point of any profile.
        inside = [float(p.theta[index]) for p in seen if 2.0 * (p.cost - best.point.cost) < limits[index]]
        ends[unknowns.names[index]] = (
            low if low.end is None else replace(low, end=min(low.end, *inside)),
            high if high.end is None else replace(high, end=max(high.end, *inside)),
        )
        mine = [best.point, *(p for p in seen if p.fixed == index)]
        curves[unknowns.names[index]] = _curve(mine, index, limits[index] / CRITICAL)
    likely = np.array([(p.theta - best.point.theta)[unknowns.free] for p in outermost.values()])
    ratios = np.array([max(2.0 * (p.cost - best.point.cost), 0.0) for p in outermost.values()])
    return Profiles(ends, curves, best.point.theta, lowest if gain > BETTER else None, gain, likely, ratios)


def _curve(points: list[ProfilePoint], index: int, inflation: float) -> Curve:
    """The curve through the points (k,), the lowest one first; of those at one place the lower one counts."""
    costs = dict[float, float]()
    for point in points:
        place = float(point.theta[index])
        costs[place] = min(point.cost, costs.get(place, np.inf))
    theta = np.array(sorted(costs))
    loss = [max(2.0 * (costs[place] - points[0].cost), 0.0) / inflation for place in theta.tolist()]
    return Curve(theta, np.array(loss))


# ----------------------------------------------------------------------------------------------------------------------
# One side of a profile.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Node:
    """A point of one side: how far off the lowest one it is, the root of the likelihood ratio, and its slope."""

    at: _Solution
    off: float
    root: float
    slope: float

    def crossing(self, before: _Node, limit: float) -> float | None:
        """Where the root reaches its limit: inside the step on the cubic through both nodes with their slopes, beyond
        it on the tangent; None where it does not."""
        if self.root < limit:
            return self.off + (limit - self.root) / self.slope if self.slope > 0.0 else None
        h, rise = self.off - before.off, self.root - before.root
        c, d = 3.0 * rise - h * (2.0 * before.slope + self.slope), h * (before.slope + self.slope) - 2.0 * rise
        roots = np.roots([d, c, h * before.slope, before.root - limit])
        inside = [r.real for r in roots if abs(r.imag) < 1e-9 and -1e-9 <= r.real <= 1.0 + 1e-9]
        return before.off + h * (min(inside) if inside else (limit - before.root) / rise)


def _side(
    work: _Workspace, best: _Solution, index: int, limit: float, size: float, count: int
) -> tuple[Side, list[ProfilePoint]]:
    """One side of a profile and its points from the answer outwards, until the root of the likelihood ratio against the
    lowest one reaches its limit.

    Args:
        size: standard error of theta, with the sign of the side; count: of points at least.
    """
    sign, step = float(np.sign(size)), limit * abs(size)  # where the covariance has the end
    centre = float(best.point.theta[index])
    reach, walled = _reach(work.unknowns, best.point.theta, index, sign)
    at_reach = Side(centre + sign * reach if walled else None, False, walled)
    if reach <= 0.0:
        return at_reach, []
    path = [_Node(best, 0.0, 0.0, limit / step)]
    longest = np.inf if count == 1 else step / count
    points, length, solves = list[ProfilePoint](), min(step, longest), 0
    for _ in range(POINTS + count):
        last = path[-1]
        target = min(last.off + length, reach)
        found = work.followed([node.at for node in path], index, centre + sign * target)
        if found is None and SHORTER * length > SHORTEST * step and not time_is_up():
            length = SHORTER * length
            continue
        if found is None and solves < SOLVES and not time_is_up():
            # The path bends, as where friction does not depend on speed and its rate may be any: IPOPT goes past that.
            length, solves = min(LEAP * step, longest), solves + 1
            target = min(last.off + length, reach)
            theta = last.at.point.theta.copy()
            theta[index] = centre + sign * target
            found = work.solved(theta, last.at.point.trajectories, index)
        if found is None:
            break
        root = float(np.sqrt(max(2.0 * (found.point.cost - best.point.cost), 0.0)))
        node = _Node(found, target, root, sign * found.slope(index) / root if root > 0.0 else 0.0)
        end = node.crossing(last, limit)
        if root > FAR * limit and target - last.off > LEAP * step and end is not None:
            length = end - last.off
            continue
        points.append(found.point)
        if end is not None and end <= reach and (root >= limit or end - target < CLOSE * target):
            return Side(centre + sign * end, False), points
        if target >= reach:
            return at_reach, points
        wanted = np.inf if end is None else end - target
        length = float(np.clip(wanted, SHORTEST * step, max(SHORTEST * step, min(FARTHER * length, longest))))
        path = [last, node]
    return Side(None, True), points


def _reach(unknowns: Unknowns, theta: Array, index: int, sign: float) -> tuple[float, bool]:
    """How far a side goes from theta (n_p,) at most: as a verdict asks, or to a bound; whether this is of the scene."""
    static, kinetic = (float(theta[unknowns.names.index(name)]) for name in ("mu_s", "mu_k0"))
    own = REACH_VALUE * abs(float(theta[index])) if unknowns.names[index] in ("mu_s", "mu_k0") else 0.0
    reach = REACH_LOG if unknowns.logarithmic[index] else max(REACH_STEP * (abs(static - kinetic) or 0.1), own)
    bound = unknowns.lower[index] if sign < 0 else unknowns.upper[index]
    to_bound = max(float(sign * (bound - theta[index])), 0.0)
    return (to_bound, bool(unknowns.walls[0 if sign < 0 else 1, index])) if to_bound < reach else (reach, False)


# ----------------------------------------------------------------------------------------------------------------------
# The points of a profile: continuation of the optimality conditions in the fixed parameter.
# ----------------------------------------------------------------------------------------------------------------------

PREDICTED, REASSIGNED = 2.0, 5.0  # standard errors of the first correction at most; where samples are assigned again
CONTRACTION = (0.2, 1.0)  # of Newton's steps: above, the matrix is factored again, and then the prediction given up
NEWTON, CONVERGED, CLOSED = 8, 0.02, 1e-4  # steps, the last one in standard errors, and the largest row
ITERATIONS, FOLLOWED = 25, 1e-6  # of IPOPT, and the largest row it may leave
OBEYS = 1e-9  # largest row of an answer
MOVED = 2.0  # samples by which an event may move before the samples are assigned to it again


@dataclass(frozen=True)
class _Neighbourhood:
    """The problem about a motion of theta (n_p,): its samples stay where they are assigned as long as no unknown (n,)
    is farther from its start than limits; sizes (k,): standard errors of the kept parameters, scaled."""

    theta: Array
    trajectories: list[ShootingTrajectory]
    problem: Problem
    limits: Array
    kept: NDArray[np.int64]
    sizes: Array

    @classmethod
    def of(cls, problem: Problem, theta: Array, trajectories: list[ShootingTrajectory], sizes: Array) -> _Neighbourhood:
        """About the motion from which a problem was formed; sizes (f,): standard errors of the free theta."""
        layout, kept = problem.layout, kept_parameters(problem.layout)
        own = np.full(kept.size - layout.free.size, float(np.max(sizes)))
        limits = np.full(layout.size, np.inf)
        for place, log in zip(layout.places, problem.logs, strict=True):
            ends = np.minimum(-layout.lower[place.events], layout.upper[place.events])
            limits[place.events] = np.minimum(MOVED * log.interval, ends)
        return cls(theta, trajectories, problem, limits, kept, np.concatenate([sizes, own]) / layout.scale[kept])

    def place(self, index: int) -> int:
        """Of a parameter among the unknowns; FREE where none is fixed."""
        return FREE if index == FREE else int(np.flatnonzero(self.problem.layout.free == index)[0])

    def factors(self, both: Array) -> Factors | None:
        """Of the optimality conditions with the exact Hessian (n + m,); None where they are singular."""
        n = self.problem.layout.size
        point = self.problem.evaluate(both[:n], derivatives=True)
        assert point.jacobian is not None
        try:
            return Factors(optimality_matrix(self.problem.exact_hessian(both[:n], 1.0, both[n:]), point.jacobian))
        except RuntimeError:  # SuperLU's only word for it
            return None

    def gradient(self, both: Array) -> tuple[Array, Array]:
        """Of the Lagrangian (n,), and the rows (m,)."""
        n = self.problem.layout.size
        point = self.problem.evaluate(both[:n], derivatives=True)
        assert point.gradient is not None and point.jacobian is not None
        with np.errstate(invalid="ignore"):
            return point.gradient + point.jacobian.T @ both[n:], point.rows

    def tangent(self, factors: Factors, place: int) -> Array:
        """Of unknowns and multipliers (n + m,) per unit of the unknown that is fixed."""
        unit = np.zeros(self.problem.layout.size + self.problem.layout.rows)
        unit[place] = 1.0
        column = factors.solve(unit)
        with np.errstate(all="ignore"):
            return np.asarray(column / column[place])

    def corrected(
        self,
        both: Array,
        place: int,
        factors: Factors | None = None,
        *,
        largest: float = PREDICTED,
        closed: float = CLOSED,
    ) -> Array | None:
        """Unknowns and multipliers (n + m,) that fulfil the conditions of optimality with the unknown at `place` fixed
        (FREE: none), from a prediction; None where Newton's method does not contract at once.

        Args:
            factors: at a point nearby, kept as long as the steps contract.
            largest: first step [standard errors]; closed: largest row at the end.
        """
        layout, before, tangent = self.problem.layout, np.inf, None
        for number in range(NEWTON):
            slope, rows = self.gradient(both)
            if place != FREE:
                slope[place] = 0.0
            left = -np.concatenate([slope, rows])
            if not np.all(np.isfinite(left)):
                return None
            if before < CONVERGED and np.max(np.abs(rows), initial=0.0) < closed:
                x = both[self.kept] * layout.scale[self.kept]
                inside = np.all(x >= layout.lower[self.kept]) and np.all(x <= layout.upper[self.kept])
                cost = self.problem.evaluate(both[: layout.size], derivatives=True).cost
                return both if inside and np.isfinite(cost) else None
            kept = factors is not None
            while True:
                if factors is None:
                    factors, tangent = self.factors(both), None
                    if factors is None:
                        return None
                step = factors.solve(left)
                if place != FREE:
                    tangent = self.tangent(factors, place) if tangent is None else tangent
                    step = step - tangent * step[place]
                length = float(np.max(np.abs(step[self.kept]) / self.sizes))
                if not kept or length <= max(CONTRACTION[0] * before, CONVERGED):
                    break
                factors, kept = None, False
            if not length <= (max(CONTRACTION[1] * before, CONVERGED) if number else largest):
                return None
            both, before = both + step, length
        return None


@dataclass(frozen=True)
class _Solution:
    """A point, its neighbourhood, and the scaled unknowns and multipliers (n + m,) there."""

    point: ProfilePoint
    around: _Neighbourhood
    both: Array

    @cached_property
    def factors(self) -> Factors | None:
        """Of the optimality conditions there."""
        return self.around.factors(self.both)

    def slope(self, index: int) -> float:
        """Derivative of the lowest cost with respect to the theta that is fixed."""
        place = self.around.place(index)
        return float(self.around.gradient(self.both)[0][place] / self.around.problem.layout.scale[place])


class _Workspace:
    """What all points have in common: logs; grid; unknowns as the scene gives them; with weak priors that keep the
    search in place, whose cost no point counts; sizes (f,)."""

    def __init__(self, logs: Sequence[Prepared], solved: Solved, unknowns: Unknowns, sizes: Array) -> None:
        weak = unknowns.with_weak_priors()
        mean = np.where(np.isfinite(unknowns.prior_sd), weak.prior_mean, solved.theta)
        self.logs, self.grid, self.sizes = [log.data for log in logs], solved.grid, sizes
        self.unknowns, self.weak = unknowns, replace(weak, prior_mean=mean, start=solved.theta)

    def lowest(self, solved: Solved) -> tuple[_Solution | None, float]:
        """The lowest point about the answer, None where it is not found, and the cost of the answer itself."""
        around = self.neighbourhood(solved.theta, solved.formed_from)
        both = np.concatenate([solved.solution.z, solved.solution.multipliers])
        answer = self.solution(around, both, FREE).point.cost
        lowest = around.corrected(both, FREE)
        if lowest is not None:
            return self.solution(around, lowest, FREE), answer
        return self.solved(solved.theta, solved.trajectories, FREE), answer

    def followed(self, path: Sequence[_Solution], index: int, value: float) -> _Solution | None:
        """The point with theta[index] = value, predicted from the last one of a path, or two, with its tangent; None
        where it is not found, or the time is up."""
        last, around = path[-1], path[-1].around
        place = around.place(index)
        if time_is_up() or last.factors is None:
            return None
        tangent = around.tangent(last.factors, place)
        step = value / around.problem.layout.scale[place] - last.both[place]
        both = last.both + step * tangent
        if len(path) > 1 and path[-2].around is around:
            chord = last.both - path[-2].both
            both += (tangent - chord / chord[place]) / chord[place] * step**2
        corrected = around.corrected(both, place, last.factors)
        if corrected is None:
            return None
        found = self.solution(around, corrected, index)
        if np.all(np.abs(corrected[: around.limits.size] * around.problem.layout.scale) <= around.limits):
            return found
        return self.reassigned(found.point, corrected[around.limits.size :], index)

    def reassigned(self, point: ProfilePoint, dual: Array, index: int) -> _Solution | None:
        """A point with the samples assigned to its own events."""
        around = self.neighbourhood(point.theta, point.trajectories)
        if around.problem.layout.rows != dual.size:
            return None
        start = np.concatenate([around.problem.start, dual])
        both = around.corrected(start, around.place(index), largest=REASSIGNED)
        return None if both is None else self.solution(around, both, index)

    def solved(self, theta: Array, trajectories: list[ShootingTrajectory], index: int) -> _Solution | None:
        """The point with theta[index] (FREE: none) as it is, by IPOPT from any motion; None where it fails."""
        free = self.unknowns.free & (np.arange(theta.size) != index)
        problem = shooting_problem(self.logs, trajectories, replace(self.weak, start=theta, free=free), self.grid)
        solution = solve(problem, mu_init=1e-6, iterations=ITERATIONS, exact=True)
        if not (solution.success and solution.constraint_violation < FOLLOWED and np.all(np.isfinite(solution.x))):
            return None
        point = self.point(problem, theta, trajectories, solution.z, index)
        return self.reassigned(point, solution.multipliers, index)

    def neighbourhood(self, theta: Array, trajectories: list[ShootingTrajectory]) -> _Neighbourhood:
        """About a motion."""
        problem = shooting_problem(self.logs, trajectories, replace(self.weak, start=theta), self.grid)
        return _Neighbourhood.of(problem, theta, trajectories, self.sizes)

    def solution(self, around: _Neighbourhood, both: Array, index: int) -> _Solution:
        """The point of unknowns and multipliers (n + m,) in a neighbourhood."""
        z = both[: around.problem.layout.size]
        point = self.point(around.problem, around.theta, around.trajectories, z, index)
        rows = around.problem.evaluate(z, derivatives=True).rows
        # Right to second order where rows are not quite closed.
        return _Solution(replace(point, cost=point.cost + float(both[z.size :] @ rows)), around, both)

    def point(
        self, problem: Problem, start: Array, trajectories: list[ShootingTrajectory], z: Array, index: int
    ) -> ProfilePoint:
        """Without the cost of the weak priors, and with that of the user's prior of what is fixed."""
        layout, x = problem.layout, z * problem.layout.scale
        theta = start.copy()
        theta[layout.free] = x[: layout.free.size]
        counted = layout.off_prior(x)[: layout.free.size]
        stated = self.unknowns.off_prior(theta)[self.unknowns.free]
        cost = problem.evaluate(z, derivatives=False).cost + 0.5 * float(stated @ stated - counted @ counted)
        moved = [place.read(old, x) for place, old in zip(layout.places, trajectories, strict=True)]
        return ProfilePoint(theta, moved, cost, index)


def converged(solved: Solved, problem: Problem, sizes: Array, farthest: float = SETTLED) -> Solved | None:
    """A solution on its own problem, or on one that is the same unknown by unknown, by Newton's method with the exact
    Hessian from where it is; None where that does not converge.

    Args:
        sizes: (f,) standard errors of the free theta; farthest: an event may be from where its samples were assigned
            [samples].
    """
    layout, n = problem.layout, problem.layout.size
    around = _Neighbourhood.of(problem, solved.theta, solved.formed_from, sizes)
    start = np.concatenate([solved.solution.z, solved.solution.multipliers])
    both = around.corrected(start, FREE, largest=REASSIGNED, closed=OBEYS)
    if both is None:
        return None
    x, point = both[:n] * layout.scale, problem.evaluate(both[:n], derivatives=False)
    pairs = zip(layout.places, problem.logs, strict=True)
    shift = max(float(np.max(np.abs(x[at.events]), initial=0.0)) / log.interval for at, log in pairs)
    if shift >= farthest:
        return None
    theta = solved.theta.copy()
    theta[layout.free] = x[: layout.free.size]
    rows = float(np.max(np.abs(point.rows), initial=0.0))
    solution = replace(
        solved.solution, z=both[:n], x=x, cost=point.cost, multipliers=both[n:], constraint_violation=rows
    )
    moved = [place.read(old, x) for place, old in zip(layout.places, solved.formed_from, strict=True)]
    out = replace(solved, problem=problem, solution=solution, trajectories=moved, theta=theta)
    return replace(out, event_shift=shift)
