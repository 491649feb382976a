"""The points of a profile: the best answer with one parameter held, warm from a neighbour, else by the solver."""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.preparation.guess import Guess
from identify.preparation.prepare import Prepared
from identify.preparation.unknowns import Unknowns
from identify.shooting.layout import kept_parameters
from identify.shooting.passes import Solved
from identify.shooting.shooting import Problem, transcribe
from identify.shooting.solve import solve
from identify.shooting.warm import Settled, Warm

Array = NDArray[np.float64]

CLOSED = 1e-6  # largest row of a point that counts
PATIENCE = 40
STEPS = 4  # RK4 steps per interval
MOVED = 2.0  # samples that an event may move before its samples must be assigned anew
HOMES = 3  # how often on the way to one point
KEPT = 3  # homes, besides that of the answer
FREE = -1  # no parameter is held


@dataclass(frozen=True)
class Home:
    """The neighbourhood of a motion: the theta (n_p,) and guesses it was formed from, Newton's steps in it, and how far
    each unknown (n,) may be from its start for the samples to stay where they were assigned."""

    theta: Array
    guesses: list[Guess]
    warm: Warm
    limits: Array

    @property
    def problem(self) -> Problem:
        """The problem formed from the motion."""
        return self.warm.problem


@dataclass(frozen=True)
class ProfilePoint:
    """A solved point: theta (n_p,), the motion there, the cost of data and user's priors; the parameter held (FREE:
    none); where it was reached warm the home, as long as it is kept, z (n,) and multipliers (m,) in its problem, else
    None."""

    theta: Array
    guesses: list[Guess]
    cost: float
    held: int
    home: weakref.ReferenceType[Home] | None = None
    z: Array | None = None
    multipliers: Array | None = None


class ProfileLine:
    """Solves with one parameter held; costs are of the data and the user's priors only.

    `best` is where the walks begin: the answer, settled; where the answer is no lowest point, that which was found from
    it, whose cost is below that of the `answer`.
    """

    def __init__(self, logs: Sequence[Prepared], solved: Solved, unknowns: Unknowns, size: Array) -> None:
        self.logs = [log.data for log in logs]
        # Differences of cost need no finer steps than this: their error is common to all points.
        self.grid = replace(solved.grid, steps=min(solved.grid.steps, STEPS))
        self.unknowns, self.size = unknowns, size
        soft = unknowns.softened()
        told = np.isfinite(unknowns.prior_sd)
        mean = np.where(told, soft.prior_mean, solved.theta)
        self.soft = replace(soft, prior_mean=mean, start=solved.theta)
        self.seen: list[ProfilePoint] = []
        self._recent: deque[Home] = deque(maxlen=KEPT)  # of a long log each takes as much memory as the log
        home = self._first = self._home(solved.theta, solved.guesses)
        self.answer = solved.solution.cost
        if home is not None:  # with the steps and without the soft priors of all other points
            self.answer = home.problem.evaluate(home.problem.start, derivatives=False).cost
        settled = None if home is None else home.warm.settle(home.problem.start)
        if home is None or settled is None:
            known = ProfilePoint(solved.theta, solved.guesses, solved.solution.cost, FREE)
            self.best = self._solved(solved.theta, solved.guesses, FREE) or known
        else:
            self.best = self._seen(home, settled, FREE)

    def point(self, near: ProfilePoint, held: int, value: float) -> ProfilePoint | None:
        """The best point with theta[held] = value, from a neighbour; None where nothing succeeds."""
        return self._warm(near, held, value) or self._from_theta(near, held, value)

    def settled(self, theta: Array, guesses: list[Guess]) -> ProfilePoint | None:
        """The lowest point near a motion, nothing held; None where the solver fails."""
        return self._solved(theta, guesses, FREE)

    def _warm(self, near: ProfilePoint, held: int, value: float) -> ProfilePoint | None:
        """The point by Newton's steps from a neighbour, None where they do not get there; where events move far, once
        more with the samples assigned anew."""
        home, z, multipliers = near.home() if near.home is not None else None, near.z, near.multipliers
        for _ in range(HOMES):
            if home is None or z is None:
                home = self._home(near.theta, near.guesses)
                if home is None:
                    return None
                z, multipliers = home.problem.start, home.warm.multipliers
            problem, scale = home.problem, home.problem.layout.scale
            place = int(np.flatnonzero(problem.layout.free == held)[0])
            found = home.warm.settle(z, multipliers=multipliers, held=(place, value / scale[place]), within=0.05)
            if found is None:
                return None
            if np.all(np.abs(found.z * scale) <= home.limits):
                return self._seen(home, found, held)
            near, home = self._made(problem, home.guesses, found.z, found.cost, home.theta, held), None
        return None

    def _from_theta(self, near: ProfilePoint, held: int, value: float) -> ProfilePoint | None:
        theta = near.theta.copy()
        theta[held] = value
        return self._solved(theta, near.guesses, held)

    def loss_root(self, point: ProfilePoint) -> float:
        """The square root of what the data lose against the best point."""
        return float(np.sqrt(max(2 * (point.cost - self.best.cost), 0.0)))

    def _home(self, theta: Array, guesses: list[Guess]) -> Home | None:
        """The neighbourhood of a motion; None where it is none for Newton's steps."""
        problem = transcribe(self.logs, guesses, replace(self.soft, start=theta), self.grid)
        kept = kept_parameters(problem.layout)
        own = np.full(kept.size - problem.layout.free.size, float(np.max(self.size)))
        try:
            warm = Warm(problem, problem.start, kept, np.concatenate([self.size, own]))
        except np.linalg.LinAlgError:
            return None
        limits = np.full(problem.layout.size, np.inf)
        for place, log in zip(problem.layout.places, self.logs, strict=True):
            index = np.concatenate([place.onset, place.saturation, place.arrest])
            limits[index[index >= 0]] = MOVED * log.interval
        self._recent.append(Home(theta, guesses, warm, limits))
        return self._recent[-1]

    def _seen(self, home: Home, settled: Settled, held: int) -> ProfilePoint:
        """The point that settled, kept."""
        made = self._made(home.problem, home.guesses, settled.z, settled.cost, home.theta, held)
        made = replace(made, home=weakref.ref(home), z=settled.z, multipliers=settled.multipliers)
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
        made = self._made(problem, guesses, solution.z, solution.cost, theta, held)
        self.seen.append(made)
        return made

    def _made(
        self, problem: Problem, guesses: list[Guess], z: Array, cost: float, theta: Array, held: int
    ) -> ProfilePoint:
        """The point of the unknowns z (n,), without the cost of the priors that only keep the search in place, and with
        that of the user's prior for what is held: where it is no unknown, the problem does not count it."""
        layout, x = problem.layout, z * problem.layout.scale
        found = theta.copy()
        found[layout.free] = x[: layout.free.size]
        counted = np.zeros(found.size, bool)
        counted[layout.free] = True
        told = np.isfinite(self.unknowns.prior_sd)
        priors = 0.5 * ((found - self.soft.prior_mean) / self.soft.prior_sd) ** 2
        missing = np.sum(priors[self.unknowns.free & told & ~counted])
        cost += float(missing - np.sum(priors[counted & ~told]))
        moved = [place.read(guess, x) for place, guess in zip(layout.places, guesses, strict=True)]
        return ProfilePoint(found, moved, cost, held)
