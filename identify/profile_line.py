"""The points of a profile: the best answer with one parameter held, warm from a neighbour, else by the solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.guess import Guess
from identify.layout import kept_parameters
from identify.passes import Solved
from identify.prepare import Prepared
from identify.shooting import Problem, transcribe
from identify.solve import solve
from identify.unknowns import Unknowns
from identify.warm import Warm

Array = NDArray[np.float64]

CLOSED = 1e-6  # largest row of a point that counts
PATIENCE = 40
STEPS = 4  # RK4 steps per interval
MOVED = 2.0  # samples that an event may move before its samples must be assigned anew
FREE = -1  # no parameter is held


@dataclass(frozen=True)
class ProfilePoint:
    """A solved point: theta (n_p,), the motion there, the cost of data and user's priors; the parameter held (FREE:
    none); z (n,) and multipliers (m,) in the problem of the line where it was reached warm, else None."""

    theta: Array
    guesses: list[Guess]
    cost: float
    held: int
    z: Array | None = None
    multipliers: Array | None = None


class ProfileLine:
    """Solves with one parameter held; costs are of the data and the user's priors only."""

    def __init__(self, logs: Sequence[Prepared], solved: Solved, unknowns: Unknowns, size: Array) -> None:
        self.logs = [log.data for log in logs]
        # Differences of cost need no finer steps than this: their error is common to all points.
        self.grid = replace(solved.grid, steps=min(solved.grid.steps, STEPS))
        self.unknowns = unknowns
        soft = unknowns.softened()
        told = np.isfinite(unknowns.prior_sd)
        mean = np.where(told, soft.prior_mean, solved.theta)
        self.soft = replace(soft, prior_mean=mean, start=solved.theta)
        self.guesses = solved.guesses
        self.problem = transcribe(self.logs, solved.guesses, self.soft, self.grid)
        self.limits = self._limits()
        self.seen: list[ProfilePoint] = []
        layout = self.problem.layout
        kept = kept_parameters(layout)
        own = np.full(kept.size - layout.free.size, float(np.max(size)))
        self.warm: Warm | None = Warm(self.problem, self.problem.start, kept, np.concatenate([size, own]))
        settled = self.warm.settle(self.problem.start)
        if settled is None:
            self.warm = None
            known = ProfilePoint(solved.theta, solved.guesses, solved.solution.cost, FREE)
            self.best = self._solved(solved.theta, solved.guesses, FREE) or known
        else:
            self.best = self._warm_point(settled.z, settled.multipliers, settled.cost, FREE)

    def point(self, near: ProfilePoint, held: int, value: float) -> ProfilePoint | None:
        """The best point with theta[held] = value, from a neighbour; None where nothing succeeds."""
        if self.warm is not None and near.z is not None:
            place = int(np.flatnonzero(self.problem.layout.free == held)[0])
            target = value / self.problem.layout.scale[place]
            found = self.warm.settle(near.z, multipliers=near.multipliers, held=(place, target), within=0.05)
            if found is not None and np.all(np.abs(found.z * self.problem.layout.scale) <= self.limits):
                return self._warm_point(found.z, found.multipliers, found.cost, held)
        theta = near.theta.copy()
        theta[held] = value
        return self._solved(theta, near.guesses, held)

    def loss_root(self, point: ProfilePoint) -> float:
        """The square root of what the data lose against the best point."""
        return float(np.sqrt(max(2 * (point.cost - self.best.cost), 0.0)))

    def _limits(self) -> Array:
        """How far each unknown (n,) may be from the start for the samples to stay where they were assigned."""
        out = np.full(self.problem.layout.size, np.inf)
        for place, log in zip(self.problem.layout.places, self.logs, strict=True):
            index = np.concatenate([place.onset, place.saturation, place.arrest])
            out[index[index >= 0]] = MOVED * log.interval
        return out

    def _warm_point(self, z: Array, multipliers: Array, cost: float, held: int) -> ProfilePoint:
        made = self._made(self.problem, self.guesses, z * self.problem.layout.scale, cost, self.soft.start, held)
        made = replace(made, z=z, multipliers=multipliers)
        self.seen.append(made)
        return made

    def _solved(self, theta: Array, guesses: list[Guess], held: int) -> ProfilePoint | None:
        """The point by the solver, from any theta and motion; None where it fails."""
        free = self.unknowns.free.copy()
        if held >= 0:
            free[held] = False
        problem = transcribe(self.logs, guesses, replace(self.soft, start=theta, free=free), self.grid)
        solution = solve(problem, barrier=1e-6, iterations=PATIENCE, exact=True)
        if not (solution.success and solution.infeasibility < CLOSED and np.all(np.isfinite(solution.x))):
            return None
        made = self._made(problem, guesses, solution.x, solution.cost, theta, held)
        self.seen.append(made)
        return made

    def _made(
        self, problem: Problem, guesses: list[Guess], x: Array, cost: float, theta: Array, held: int
    ) -> ProfilePoint:
        """The point of the unknowns x (n,), without the cost of the priors that only keep the search in place."""
        layout = problem.layout
        found = theta.copy()
        found[layout.free] = x[: layout.free.size]
        mine = np.zeros(found.size, bool)
        mine[layout.free] = True
        mine &= ~np.isfinite(self.unknowns.prior_sd)
        penalty = 0.5 * float(np.sum(((found - self.soft.prior_mean) / self.soft.prior_sd)[mine] ** 2))
        moved = [place.read(guess, x) for place, guess in zip(layout.places, guesses, strict=True)]
        return ProfilePoint(found, moved, cost - penalty, held)
