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
import scipy
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.linear import Factors, optimality_matrix
from identify.base.quantiles import LEVEL, chi_square
from identify.estimation.covariance import WEAK
from identify.estimation.estimator import no_time_for
from identify.logs.unknowns import Unknowns
from identify.shooting.layout import kept_parameters
from identify.shooting.passes import SETTLED, Solved, solve
from identify.shooting.shooting import Problem, shooting_problem
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

CRITICAL = chi_square(LEVEL, 1)  # of the likelihood ratio 2 (cost - smallest cost), one degree of freedom
BETTER = 0.5  # by which 2 cost must be smaller for a point to count as lower than the answer
REACH_LOG = 3.0 * float(np.log(WEAK))  # of a logarithm: farther than a verdict asks, ends of others depend on open ones
REACH_STEP, REACH_VALUE = 0.9, 1.05 * (1.0 - 1.0 / WEAK)  # of a coefficient: of mu_s - mu_k0, and of its own value
SHORTER, SHORTEST = 0.3, 0.05  # times the step before; and of that of the covariance
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
class Profiles:
    """Profile intervals and curves by parameter; a point that lies lower than the answer (None: there is none) and the
    likelihood ratio by which it does."""

    ends: dict[str, tuple[Side, Side]]
    curves: Mapping[str, Curve] = field(default_factory=dict)
    lower: ProfilePoint | None = None
    gain: float = 0.0

    def with_optimum(self, unknowns: Unknowns, theta: Array, halves: Array) -> Profiles:
        """With intervals that hold another optimum (n_p,) too, and `halves` (n_p,) on both sides of it."""
        ends = dict(self.ends)
        for name, (low, high) in self.ends.items():
            i = unknowns.names.index(name)
            down = low if low.end is None else replace(low, end=min(low.end, float(theta[i] - halves[i])))
            up = high if high.end is None else replace(high, end=max(high.end, float(theta[i] + halves[i])))
            ends[name] = down, up
        return replace(self, ends=ends)


def profile(
    solved: Solved,
    unknowns: Unknowns,
    sizes: Array,
    inflation: Array,
    only: Sequence[int],
    points: int = 1,
    restart: bool = False,
) -> Profiles:
    """Profile intervals about an answer. Where the time is up, the parameters that are left have none.

    Args:
        sizes: (f,) standard errors of the free theta for white noise; inflation: (f,) of each variance by all that is
            allowed for beside white noise: the critical likelihood ratio is so much larger (Kent, Biometrika 69, 1982).
        only: indices of the parameters; points: of each side at least: 1 finds its end, more draw the curve.
        restart: end at the first point that lies lower than the answer.
    """
    search = _Search(solved, unknowns, sizes)
    around = search.problem_about(solved.theta, list(solved.problem.layout.trajectories))
    both = np.concatenate([solved.solution.z, solved.solution.multipliers])
    answer = search.point(around, both, FREE).cost
    lowest = _newton(around, both, sizes)
    best = None if lowest is None else search.point(around, lowest, FREE)
    best = best or search.by_ipopt(solved.theta, solved.trajectories, FREE)
    if best is None:
        return Profiles({})
    place = {index: number for number, index in enumerate(np.flatnonzero(unknowns.free).tolist())}
    sides, seen = dict[int, tuple[Side, Side]](), [best]
    for index in only:
        root = float(np.sqrt(CRITICAL * inflation[place[index]]))
        (low, down), (high, up) = (
            _side(search, best, index, root, sign * sizes[place[index]], points) for sign in (-1, 1)
        )
        if time_is_up():
            no_time_for("profiles")
            break
        sides[index] = low, high
        seen += [*down, *up]
        if restart and 2.0 * (answer - min(point.cost for point in seen)) > BETTER:
            break
    lower = min(seen, key=lambda point: point.cost)
    gain = max(0.0, 2.0 * (answer - lower.cost))
    ends, curves = {}, {}
    for index, (low, high) in sides.items():
        name, wider = unknowns.names[index], float(inflation[place[index]])
        # A side holds every likely point of any profile.
        inside = [float(p.theta[index]) for p in seen if p.ratio(best) < CRITICAL * wider]
        ends[name] = (
            low if low.end is None else replace(low, end=min(low.end, *inside)),
            high if high.end is None else replace(high, end=max(high.end, *inside)),
        )
        # Of points at one place the lower one counts.
        mine = sorted((p for p in seen if p.fixed in (FREE, index)), key=lambda p: -p.cost)
        loss = {float(p.theta[index]): p.ratio(best) / wider for p in mine}
        curves[name] = Curve(np.array(sorted(loss)), np.array([loss[theta] for theta in sorted(loss)]))
    return Profiles(ends, curves, lower if gain > BETTER else None, gain)


# One side of a profile.


def _side(
    search: _Search, best: ProfilePoint, index: int, limit: float, size: float, count: int
) -> tuple[Side, list[ProfilePoint]]:
    """One side of a profile and its points from the answer outwards, until the root of the likelihood ratio against the
    lowest one reaches its limit.

    Args:
        size: standard error of theta, with the sign of the side; count: of points at least.
    """
    sign, step = float(np.sign(size)), limit * abs(size)  # where the covariance has the end
    centre = float(best.theta[index])
    # As far as a verdict asks, or to a bound, which may be of the scene.
    unknowns, theta = search.unknowns, best.theta
    static, kinetic = (float(theta[unknowns.names.index(name)]) for name in ("mu_s", "mu_k0"))
    own = REACH_VALUE * abs(centre) if unknowns.names[index] in ("mu_s", "mu_k0") else 0.0
    reach = REACH_LOG if unknowns.logarithmic[index] else max(REACH_STEP * (abs(static - kinetic) or 0.1), own)
    bound = unknowns.lower[index] if sign < 0 else unknowns.upper[index]
    to_bound, walled = max(float(sign * (bound - centre)), 0.0), False
    if to_bound < reach:
        reach, walled = to_bound, bool(unknowns.user_bounds[0 if sign < 0 else 1, index])
    at_reach = Side(centre + sign * reach if walled else None, False, walled)
    if reach <= 0.0:
        return at_reach, []
    path, before = [best], (0.0, 0.0, limit / step)  # distance, root of the likelihood ratio, and its slope
    longest = np.inf if count == 1 else step / count
    length, solves = min(step, longest), 0
    for _ in range(20 + count):  # points of a side at most
        target = min(before[0] + length, reach)
        found = search.followed(path[-2:], index, centre + sign * target)
        if found is None and time_is_up():
            break
        if found is None and SHORTER * length > SHORTEST * step:
            length *= SHORTER
            continue
        if found is None and solves < 3:
            # The path bends, as where friction does not depend on speed and its rate may be any: IPOPT goes past that.
            length, solves = min(SHORTER * step, longest), solves + 1
            target = min(before[0] + length, reach)
            theta = np.where(np.arange(best.theta.size) == index, centre + sign * target, path[-1].theta)
            found = search.by_ipopt(theta, path[-1].trajectories, index)
        if found is None:
            break
        root = float(np.sqrt(found.ratio(best)))
        node = target, root, sign * found.slope / root if root > 0.0 else 0.0
        # Where the root reaches its limit: beyond the step on the tangent, inside it on the cubic with the slopes.
        if root < limit:
            end = target + (limit - root) / node[2] if node[2] > 0.0 else None
        else:
            (ends, roots, slopes) = zip(before, node, strict=True)
            inside = scipy.interpolate.CubicHermiteSpline(ends, np.array(roots) - limit, slopes).roots(
                extrapolate=False
            )
            chord = before[0] + (target - before[0]) * (limit - before[1]) / (root - before[1])
            end = float(inside[0]) if inside.size else chord
        if root > 1.3 * limit and target - before[0] > SHORTER * step and end is not None:
            length = end - before[0]
            continue
        path.append(found)
        if end is not None and end <= reach and (root >= limit or end - target < 0.05 * target):
            return Side(centre + sign * end, False), path[1:]
        if target >= reach:
            return at_reach, path[1:]
        wanted = np.inf if end is None else end - target
        length = float(np.clip(wanted, SHORTEST * step, max(SHORTEST * step, min(2.5 * length, longest))))
        before = node
    return Side(None, True), path[1:]


# The points of a profile: continuation of the optimality conditions in the fixed parameter.

REASSIGNED = 5.0  # standard errors of the first correction at most, where samples are assigned again
CONVERGED = 0.02  # standard errors of the last step of Newton's method
MOVED = 2.0  # samples by which an event may move before the samples are assigned to it again


def _place(problem: Problem, index: int) -> int:
    """Of a parameter among the unknowns; FREE where none is fixed."""
    return FREE if index == FREE else int(np.flatnonzero(problem.layout.free == index)[0])


@dataclass(frozen=True)
class ProfilePoint:
    """The lowest cost with one parameter fixed (FREE: none): theta (n_p,), the motion there, the cost of data and
    user's priors; scaled unknowns and multipliers (n + m,) of the problem about a motion nearby."""

    theta: Array
    trajectories: list[ShootingTrajectory]
    cost: float
    fixed: int
    problem: Problem
    both: Array

    def ratio(self, best: ProfilePoint) -> float:
        """The likelihood ratio against the lowest point."""
        return max(2.0 * (self.cost - best.cost), 0.0)

    @cached_property
    def factors(self) -> Factors | None:
        """Of the optimality conditions there."""
        return _factors(self.problem, self.both)

    @property
    def slope(self) -> float:
        """Derivative of the lowest cost with respect to the theta that is fixed."""
        place = _place(self.problem, self.fixed)
        return float(_conditions(self.problem, self.both)[place] / self.problem.layout.scale[place])


def _factors(problem: Problem, both: Array) -> Factors | None:
    """Of the optimality conditions with the exact Hessian (n + m,); None where they are singular."""
    n = problem.layout.size
    point = problem.evaluate(both[:n], derivatives=True)
    try:
        return Factors(optimality_matrix(problem.exact_hessian(both[:n], 1.0, both[n:]), point.jacobian))
    except RuntimeError:  # SuperLU's only word for it
        return None


def _conditions(problem: Problem, both: Array) -> Array:
    """Gradient of the Lagrangian and rows (n + m,)."""
    n = problem.layout.size
    point = problem.evaluate(both[:n], derivatives=True)
    with np.errstate(invalid="ignore"):
        return np.concatenate([point.gradient + point.jacobian.T @ both[n:], point.rows])


def _tangent(problem: Problem, factors: Factors, place: int) -> Array:
    """Of unknowns and multipliers (n + m,) per unit of the unknown that is fixed."""
    unit = np.zeros(problem.layout.size + problem.layout.rows)
    unit[place] = 1.0
    column = factors.solve(unit)
    with np.errstate(all="ignore"):
        return np.asarray(column / column[place])


def _newton(
    problem: Problem,
    both: Array,
    sizes: Array,
    place: int = FREE,
    factors: Factors | None = None,
    largest: float = 2.0,
    closed: float = 1e-4,
) -> Array | None:
    """Unknowns and multipliers (n + m,) that fulfil the conditions of optimality with the unknown at `place` fixed
    (FREE: none), from a prediction; None where Newton's method does not contract at once.

    Args:
        sizes: (f,) standard errors of the free theta; factors: at a point nearby, kept as long as the steps contract.
        largest: first step [standard errors]; closed: largest row at the end.
    """
    layout, before, tangent = problem.layout, np.inf, None
    kept, n = kept_parameters(layout), layout.size
    own = np.full(kept.size - layout.free.size, float(np.max(sizes)))
    size = np.concatenate([sizes, own]) / layout.scale[kept]
    for number in range(8):
        left = -_conditions(problem, both)
        if place != FREE:
            left[place] = 0.0
        if not np.all(np.isfinite(left)):
            return None
        if before < CONVERGED and np.max(np.abs(left[n:]), initial=0.0) < closed:
            x = both[kept] * layout.scale[kept]
            inside = np.all(x >= layout.lower[kept]) and np.all(x <= layout.upper[kept])
            return both if inside and np.isfinite(problem.evaluate(both[:n], derivatives=True).cost) else None
        old = factors is not None
        while True:
            if factors is None:
                factors, tangent = _factors(problem, both), None
                if factors is None:
                    return None
            step = factors.solve(left)
            if place != FREE:
                tangent = _tangent(problem, factors, place) if tangent is None else tangent
                step = step - tangent * step[place]
            length = float(np.max(np.abs(step[kept]) / size))
            if not old or length <= max(0.2 * before, CONVERGED):  # else the matrix is factored again
                break
            factors, old = None, False
        if not length <= (max(before, CONVERGED) if number else largest):
            return None
        both, before = both + step, length
    return None


class _Search:
    """What all points have in common: logs; grid; unknowns as the scene gives them; with weak priors that keep the
    search in place, whose cost no point counts; sizes (f,)."""

    def __init__(self, solved: Solved, unknowns: Unknowns, sizes: Array) -> None:
        weak = unknowns.with_weak_priors()
        mean = np.where(np.isfinite(unknowns.prior_sd), weak.prior_mean, solved.theta)
        self.logs, self.grid, self.sizes = solved.problem.logs, solved.grid, sizes
        self.unknowns, self.weak = unknowns, replace(weak, prior_mean=mean, start=solved.theta)

    def problem_about(self, theta: Array, trajectories: list[ShootingTrajectory], fixed: int = FREE) -> Problem:
        """The problem about a motion of theta (n_p,), with a parameter fixed (FREE: none)."""
        free = self.unknowns.free & (np.arange(theta.size) != fixed)
        return shooting_problem(self.logs, trajectories, replace(self.weak, start=theta, free=free), self.grid)

    def followed(self, path: Sequence[ProfilePoint], index: int, value: float) -> ProfilePoint | None:
        """The point with theta[index] = value, predicted from the last one of a path, or two, with its tangent; None
        where it is not found, or the time is up."""
        last, problem = path[-1], path[-1].problem
        place, layout = _place(problem, index), problem.layout
        if time_is_up() or last.factors is None:
            return None
        tangent = _tangent(problem, last.factors, place)
        step = value / layout.scale[place] - last.both[place]
        both = last.both + step * tangent
        if len(path) > 1 and path[-2].problem is problem:
            chord = last.both - path[-2].both
            both += (tangent - chord / chord[place]) / chord[place] * step**2
        corrected = _newton(problem, both, self.sizes, place, last.factors)
        if corrected is None:
            return None
        found, x = self.point(problem, corrected, index), np.abs(corrected[: layout.size] * layout.scale)
        room = np.minimum(-layout.lower, layout.upper)
        stays = (  # whether samples may stay where they are assigned: no event moved too far
            np.all(x[at.events] <= np.minimum(MOVED * log.interval, room[at.events]))
            for at, log in zip(layout.places, problem.logs, strict=True)
        )
        return found if all(stays) else self.reassigned(found)

    def reassigned(self, found: ProfilePoint) -> ProfilePoint | None:
        """A point with the samples assigned to its own events."""
        problem = self.problem_about(found.theta, found.trajectories)
        dual = found.both[found.problem.layout.size :]
        if problem.layout.rows != dual.size:
            return None
        start, place = np.concatenate([problem.start, dual]), _place(problem, found.fixed)
        both = _newton(problem, start, self.sizes, place, largest=REASSIGNED)
        return None if both is None else self.point(problem, both, found.fixed)

    def by_ipopt(self, theta: Array, trajectories: list[ShootingTrajectory], index: int) -> ProfilePoint | None:
        """The point with theta[index] (FREE: none) as it is, by IPOPT from any motion; None where it fails."""
        problem = self.problem_about(theta, trajectories, index)
        solution = solve(problem, mu_init=1e-6, iterations=25, exact=True)
        if not (solution.success and solution.constraint_violation < 1e-6 and np.all(np.isfinite(solution.x))):
            return None
        both = np.concatenate([solution.z, solution.multipliers])
        return self.reassigned(self.point(problem, both, index))

    def point(self, problem: Problem, both: Array, index: int) -> ProfilePoint:
        """Of unknowns and multipliers (n + m,), without the cost of the weak priors and with that of the user's prior
        of what is fixed."""
        layout, z = problem.layout, both[: problem.layout.size]
        x = z * layout.scale
        theta, moved = layout.at(x)
        counted = layout.off_prior(x)[: layout.free.size]
        stated = self.unknowns.off_prior(theta)[self.unknowns.free]
        at = problem.evaluate(z, derivatives=True)
        # Right to second order where rows are not quite closed.
        cost = at.cost + 0.5 * float(stated @ stated - counted @ counted) + float(both[layout.size :] @ at.rows)
        return ProfilePoint(theta, moved, cost, index, problem, both)


def converged(solved: Solved, problem: Problem, sizes: Array, farthest: float = SETTLED) -> Solved | None:
    """A solution on its own problem, or on one that is the same unknown by unknown, by Newton's method with the exact
    Hessian from where it is; None where that does not converge.

    Args:
        sizes: (f,) standard errors of the free theta; farthest: an event may be from where its samples were assigned
            [samples].
    """
    layout, n = problem.layout, problem.layout.size
    start = np.concatenate([solved.solution.z, solved.solution.multipliers])
    both = _newton(problem, start, sizes, largest=REASSIGNED, closed=1e-9)
    if both is None:
        return None
    x, point = both[:n] * layout.scale, problem.evaluate(both[:n], derivatives=False)
    pairs = zip(layout.places, problem.logs, strict=True)
    shift = max(float(np.max(np.abs(x[at.events]), initial=0.0)) / log.interval for at, log in pairs)
    if shift >= farthest:
        return None
    theta, moved = layout.at(x)
    rows = float(np.max(np.abs(point.rows), initial=0.0))
    solution = replace(
        solved.solution, z=both[:n], x=x, cost=point.cost, multipliers=both[n:], constraint_violation=rows
    )
    return replace(solved, problem=problem, solution=solution, trajectories=moved, theta=theta, event_shift=shift)
