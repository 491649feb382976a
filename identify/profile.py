"""Profile likelihood: how far a parameter can be moved while all others follow, before the data object.

Run where the covariance finds a parameter weakly determined: there the log-likelihood is no parabola, and a
small standard error from its curvature at one point can be false. Every point is solved again, warm from its
neighbour; a failed point shortens the step and is never counted; a better optimum is handed back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from identify.guess import Guess
from identify.passes import Solved
from identify.prepare import Prepared
from identify.shooting import transcribe
from identify.solve import solve
from identify.uncertainty import LEVEL, WEAK
from identify.unknowns import Unknowns
from identify.vibration import rhythmic

Array = NDArray[np.float64]

CRITICAL = float(chi2.ppf(LEVEL, 1))  # of 2 (cost - smallest cost), one degree of freedom
REACH = 1.15 * float(np.log(WEAK))  # of a logarithm: beyond a factor of three nothing more is asked
REACH_LINEAR = 0.9  # of mu_s - mu_k0, for coefficients
POINTS = 14  # of one side
BETTER = 0.5  # how much smaller 2 cost must become for another optimum to count
CLOSED = 1e-6  # largest row of a point that counts
BEYOND = 1.15  # of a side: where others are asked whether they know a way on
OTHERS = 2  # how many are asked
PATIENCE = 40
STEPS = 4  # RK4 steps per interval


@dataclass(frozen=True)
class Side:
    """One end of a profile interval in theta; None: open (the data never object, or `failed` points)."""

    end: float | None
    failed: bool


@dataclass(frozen=True)
class Profiles:
    """Interval ends per parameter name, and theta of a better optimum where one was met."""

    ends: dict[str, tuple[Side, Side]]
    better: Array | None


@dataclass(frozen=True)
class _Point:
    """A solved point: theta (n_p,), the motion there, the cost of data and user's priors."""

    theta: Array
    guesses: list[Guess]
    cost: float


@dataclass(frozen=True)
class _Walk:
    """One side of a profile, and the last point before its end."""

    side: Side
    last: _Point


class _Line:
    """Solves with one parameter held; costs are of the data and the user's priors only."""

    def __init__(self, logs: tuple[Prepared, ...], solved: Solved, unknowns: Unknowns) -> None:
        self.logs = [log.data for log in logs]
        # Differences of cost need no finer steps than this: their error is common to all points.
        self.grid = replace(solved.grid, steps=min(solved.grid.steps, STEPS))
        self.unknowns = unknowns
        soft = unknowns.softened()
        self.soft = replace(soft, prior_mean=np.where(np.isfinite(unknowns.prior_sd), soft.prior_mean, solved.theta))
        self.seen: list[_Point] = []
        self.best = self.point(solved.theta, solved.guesses, None) or _Point(
            solved.theta, solved.guesses, solved.solution.cost
        )

    def point(self, theta: Array, guesses: list[Guess], held: int | None) -> _Point | None:
        """The best point with theta[held] as it is; None where the solver fails."""
        free = self.unknowns.free.copy()
        if held is not None:
            free[held] = False
        search = replace(self.soft, start=theta, free=free)
        problem = transcribe(self.logs, guesses, search, self.grid)
        solution = solve(problem, barrier=1e-6, iterations=PATIENCE, exact=True)
        if not (solution.success and solution.infeasibility < CLOSED and np.all(np.isfinite(solution.x))):
            return None
        found = theta.copy()
        found[problem.layout.free] = solution.x[: problem.layout.free.size]
        moved = [place.read(guess, solution.x) for place, guess in zip(problem.layout.places, guesses, strict=True)]
        none = free & ~np.isfinite(self.unknowns.prior_sd)
        penalty = 0.5 * float(np.sum(((found - self.soft.prior_mean) / self.soft.prior_sd)[none] ** 2))
        made = _Point(found, moved, solution.cost - penalty)
        self.seen.append(made)
        return made

    def loss_root(self, point: _Point) -> float:
        """The square root of what the data lose against the best point."""
        return float(np.sqrt(max(2 * (point.cost - self.best.cost), 0.0)))


def profile(
    logs: tuple[Prepared, ...],
    solved: Solved,
    unknowns: Unknowns,
    covariance: Array,
    progress: Callable[[str, float | None], None],
) -> Profiles:
    """Profile every free parameter of a solution but for those of harmonics, whose curvature tells all.

    Args:
        covariance: (f, f) of the free theta, for the first steps.
    """
    line = _Line(logs, solved, unknowns)
    walks: dict[tuple[int, float], _Walk] = {}
    beside = rhythmic(unknowns)
    free = np.flatnonzero(unknowns.free).tolist()
    for first, index in zip(np.sqrt(np.diag(covariance)).tolist(), free, strict=True):
        if beside[index]:
            continue
        progress(f"profile of {unknowns.names[index]}", None)
        for sign in (-1.0, 1.0):
            walks[index, sign] = _walk(line, index, sign, first, line.best)
    progress("profiles from other points", None)
    for (index, sign), walk in walks.items():
        if walk.side.end is not None:
            walks[index, sign] = _retried(line, index, sign, walk)
    lowest = min(line.seen, key=lambda point: point.cost)
    if 2 * (lowest.cost - line.best.cost) < -BETTER:
        return Profiles({}, lowest.theta)
    inside = np.array([point.theta for point in line.seen if line.loss_root(point) ** 2 < CRITICAL])
    return Profiles(
        {
            unknowns.names[i]: (
                _stretched(walks[i, -1.0].side, inside[:, i].min(), min),
                _stretched(walks[i, 1.0].side, inside[:, i].max(), max),
            )
            for i in free
            if not beside[i]
        },
        None,
    )


def _stretched(side: Side, farthest: float, farther: Callable[[float, float], float]) -> Side:
    """The end, stretched over every point of any walk that the data do not object to."""
    return side if side.end is None else replace(side, end=float(farther(side.end, farthest)))


def _step(unknowns: Unknowns, theta: Array) -> float:
    """mu_s - mu_k0, the size coefficients are judged by."""
    names = unknowns.names
    return float(abs(theta[names.index("mu_s")] - theta[names.index("mu_k0")])) or 0.1


def _reach(line: _Line, index: int) -> float:
    """How far from the answer a profile asks, in theta."""
    return REACH if line.unknowns.logarithmic[index] else REACH_LINEAR * _step(line.unknowns, line.best.theta)


def _walk(line: _Line, index: int, sign: float, first: float, begin: _Point) -> _Walk:
    """Walk one way from `begin` until the data object; the end by interpolation of the root of what they lose."""
    centre, reach = line.best.theta[index], _reach(line, index)
    here, failures = begin, 0
    done = float(sign * (begin.theta[index] - centre))
    done_root = line.loss_root(begin)
    length = float(np.clip(first, 0.02 * reach, 0.3 * reach))
    limit = float(np.sqrt(CRITICAL))
    for _ in range(POINTS):
        target = min(done + length, reach)
        theta = here.theta.copy()
        theta[index] = centre + sign * target
        bound = line.unknowns.lower[index] if sign < 0 else line.unknowns.upper[index]
        if sign * (theta[index] - bound) > 0:
            return _Walk(Side(None, False), here)
        point = line.point(theta, here.guesses, index)
        if point is None:
            failures += 1
            length *= 0.4
            if failures > 4:
                return _Walk(Side(None, True), here)
            continue
        root = line.loss_root(point)
        if root >= limit:
            if root < 1.6 * limit or target - done < 0.02 * reach:
                share = (limit - done_root) / max(root - done_root, 1e-12)
                return _Walk(Side(float(centre + sign * (done + share * (target - done))), False), here)
            length = (target - done) * max(0.3, (limit - done_root) / (root - done_root))
            continue
        if target >= reach:
            return _Walk(Side(None, False), point)
        slope = (root - done_root) / (target - done)
        length = float(np.clip(1.15 * (limit - root) / max(slope, 1e-9), 0.5 * length, 2.5 * length))
        done, done_root, here = target, root, point
    return _Walk(Side(None, True), here)


def _retried(line: _Line, index: int, sign: float, walk: _Walk) -> _Walk:
    """The walk, carried on where the points of other walks know a way past its end: a profile that follows one
    valley can miss that another one is open."""
    assert walk.side.end is not None
    centre, reach = line.best.theta[index], _reach(line, index)
    beyond = centre + sign * min(abs(walk.side.end - centre) * BEYOND, reach)
    near = [point for point in line.seen if line.loss_root(point) ** 2 < CRITICAL]
    near.sort(key=lambda point: abs(point.theta[index] - beyond))
    for known in near[:OTHERS]:
        theta = known.theta.copy()
        theta[index] = beyond
        point = line.point(theta, known.guesses, index)
        if point is not None and line.loss_root(point) ** 2 < CRITICAL:
            return _walk(line, index, sign, abs(beyond - centre) * 0.3, point)
    return walk
