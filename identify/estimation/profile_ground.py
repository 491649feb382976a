"""The ground that profiles are walked on: neighbourhoods of a motion, and the points that are solved in them."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.estimation.objection import UNCHANGED, Change, Remembering
from identify.logs.log_data import Grid, Guess, LogData
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
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
    none); change: of the curves since the answer; where it was reached warm the home, as long as it is kept, z (n,) and
    multipliers (m,) in its problem, else None."""

    theta: Array
    guesses: list[Guess]
    cost: float
    held: int
    change: Change = UNCHANGED
    home: weakref.ReferenceType[Home] | None = None
    z: Array | None = None
    multipliers: Array | None = None


@dataclass(frozen=True)
class Ground:
    """What all points of a profile have in common; costs are of the data and the user's priors only.

    logs; grid: steps of a point; unknowns: as the scene gives them; soft: with priors that only keep the search in
    place; size (f,): standard errors of the free parameters; noise of all logs; curves: what the load cell sees at the
    answer, per log (n,) [N].
    """

    logs: tuple[LogData, ...]
    grid: Grid
    unknowns: Unknowns
    soft: Unknowns
    size: Array
    noise: Remembering
    curves: list[Array]

    @classmethod
    def about(
        cls,
        logs: Sequence[Prepared],
        solved: Solved,
        unknowns: Unknowns,
        size: Array,
        noise: Remembering,
        steps: int = STEPS,
    ) -> Ground:
        """The ground about an answer; size (f,): standard errors of the free parameters there; steps: RK4 steps per
        interval, those of the answer at most."""
        soft = unknowns.softened()
        told = np.isfinite(unknowns.prior_sd)
        mean = np.where(told, soft.prior_mean, solved.theta)
        return cls(
            logs=tuple(log.data for log in logs),
            # Differences of cost need no finer steps than this: their error is common to all points.
            grid=replace(solved.grid, steps=min(solved.grid.steps, steps)),
            unknowns=unknowns,
            soft=replace(soft, prior_mean=mean, start=solved.theta),
            size=size,
            noise=noise,
            curves=[] if noise.white else solved.fitted,
        )

    def home(self, theta: Array, guesses: list[Guess]) -> Home | None:
        """The neighbourhood of a motion; None where it is none for Newton's steps."""
        problem = transcribe(list(self.logs), guesses, replace(self.soft, start=theta), self.grid)
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
        return Home(theta, guesses, warm, limits)

    def settled(self, home: Home, found: Settled, held: int) -> ProfilePoint:
        """The point at which Newton's steps settled in a neighbourhood."""
        made = self.point(home.problem, home.guesses, found.z, found.cost, home.theta, held)
        return replace(made, home=weakref.ref(home), z=found.z, multipliers=found.multipliers)

    def solved(self, theta: Array, guesses: list[Guess], held: int) -> ProfilePoint | None:
        """The point by the solver, from any theta and motion; None where it fails."""
        free = self.unknowns.free.copy()
        if held >= 0:
            free[held] = False
        problem = transcribe(list(self.logs), guesses, replace(self.soft, start=theta, free=free), self.grid)
        solution = solve(problem, barrier=1e-6, iterations=PATIENCE, exact=True)
        if not (solution.success and solution.infeasibility < CLOSED and np.all(np.isfinite(solution.x))):
            return None
        return self.point(problem, guesses, solution.z, solution.cost, theta, held)

    def point(
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
        change = UNCHANGED if self.noise.white else self.noise.change(self.curves, problem.fitted(z))
        return ProfilePoint(found, moved, cost, held, change)
