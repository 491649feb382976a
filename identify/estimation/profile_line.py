"""The points of a profile: the best answer with one parameter held, warm from a neighbour, else by the solver."""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.estimation.residual_autocorrelation import UNCHANGED, CurveChange, NoiseAutocorrelation
from identify.logs.log_data import LogData
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.grid import Grid
from identify.shooting.layout import kept_parameters
from identify.shooting.passes import Solved
from identify.shooting.shooting import Problem, shooting_problem
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.shooting.solve import solve
from identify.shooting.warm import Settled, Warm

# ----------------------------------------------------------------------------------------------------------------------
# The ground that profiles are walked on: neighbourhoods of a motion, and the points that are solved in them.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

CLOSED = 1e-6  # largest row of a point that counts
PATIENCE = 40
STEPS = 4  # RK4 steps per interval
MOVED = 2.0  # samples that an event may move before its samples must be assigned anew
FREE = -1  # no parameter is held


@dataclass(frozen=True)
class Home:
    """The neighbourhood of a motion: the theta (n_p,) and trajectories it was formed from, Newton's steps in it, and
    how far each unknown (n,) may be from its start for the samples to stay where they were assigned."""

    theta: Array
    trajectories: list[ShootingTrajectory]
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
    trajectories: list[ShootingTrajectory]
    cost: float
    held: int
    change: CurveChange = UNCHANGED
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
    noise: NoiseAutocorrelation
    curves: list[Array]

    @classmethod
    def about(
        cls,
        logs: Sequence[Prepared],
        solved: Solved,
        unknowns: Unknowns,
        size: Array,
        noise: NoiseAutocorrelation,
        steps: int = STEPS,
    ) -> Ground:
        """The ground about an answer; size (f,): standard errors of the free parameters there; steps: RK4 steps per
        interval, those of the answer at most."""
        soft = unknowns.with_weak_priors()
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

    def home(self, theta: Array, trajectories: list[ShootingTrajectory]) -> Home | None:
        """The neighbourhood of a motion; None where it is none for Newton's steps."""
        problem = shooting_problem(list(self.logs), trajectories, replace(self.soft, start=theta), self.grid)
        kept = kept_parameters(problem.layout)
        own = np.full(kept.size - problem.layout.free.size, float(np.max(self.size)))
        try:
            warm = Warm(problem, problem.start, kept, np.concatenate([self.size, own]))
        except np.linalg.LinAlgError:
            return None
        limits = np.full(problem.layout.size, np.inf)
        for place, log in zip(problem.layout.places, self.logs, strict=True):
            limits[place.events] = MOVED * log.interval
        return Home(theta, trajectories, warm, limits)

    def settled(self, home: Home, found: Settled, held: int) -> ProfilePoint:
        """The point at which Newton's steps settled in a neighbourhood."""
        made = self.point(home.problem, home.trajectories, found.z, found.cost, home.theta, held)
        return replace(made, home=weakref.ref(home), z=found.z, multipliers=found.multipliers)

    def solved(self, theta: Array, trajectories: list[ShootingTrajectory], held: int) -> ProfilePoint | None:
        """The point by the solver, from any theta and motion; None where it fails."""
        free = self.unknowns.free.copy()
        if held >= 0:
            free[held] = False
        problem = shooting_problem(list(self.logs), trajectories, replace(self.soft, start=theta, free=free), self.grid)
        solution = solve(problem, mu_init=1e-6, iterations=PATIENCE, exact=True)
        if not (solution.success and solution.constraint_violation < CLOSED and np.all(np.isfinite(solution.x))):
            return None
        return self.point(problem, trajectories, solution.z, solution.cost, theta, held)

    def point(
        self, problem: Problem, trajectories: list[ShootingTrajectory], z: Array, cost: float, theta: Array, held: int
    ) -> ProfilePoint:
        """The point of the unknowns z (n,), without the cost of the priors that only keep the search in place, and with
        that of the user's priors, of what is held too: where it is no unknown, the problem does not count it."""
        layout, x = problem.layout, z * problem.layout.scale
        found = theta.copy()
        found[layout.free] = x[: layout.free.size]
        counted, stated = layout.off_prior(x)[: layout.free.size], self.unknowns.off_prior(found)[self.unknowns.free]
        cost += 0.5 * float(stated @ stated - counted @ counted)
        moved = [place.read(trajectory, x) for place, trajectory in zip(layout.places, trajectories, strict=True)]
        change = UNCHANGED if self.noise.white else self.noise.change(self.curves, problem.fitted(z))
        return ProfilePoint(found, moved, cost, held, change)


HOMES = 3  # how often on the way to one point
KEPT = 3  # homes, besides that of the answer


@dataclass(frozen=True, eq=False)
class ProfileLine:
    """Solves with one parameter held; costs are of the data and the user's priors only.

    best: where the walks begin: the answer, settled; where the answer is no lowest point, that which was found from it,
    whose cost is below that of the answer; answer: this cost, with the steps and without the soft priors of all other
    points; first: home of the answer, held so that walks from it stay warm (None: it has none). Two things change while
    it is walked: `seen` grows by every point that is solved, `recent` holds the last homes.
    """

    ground: Ground
    best: ProfilePoint
    answer: float
    first: Home | None
    seen: list[ProfilePoint]
    recent: deque[Home]

    @classmethod
    def at(
        cls, logs: Sequence[Prepared], solved: Solved, unknowns: Unknowns, size: Array, noise: NoiseAutocorrelation
    ) -> ProfileLine:
        """The line through an answer, which is settled first; size (f,): standard errors of the free parameters."""
        line = cls._on(Ground.about(logs, solved, unknowns, size, noise), solved)
        if line.seen or solved.grid.steps <= STEPS:
            return line
        # With steps coarser than those of the answer a slip may not close, and no walk would begin.
        return cls._on(Ground.about(logs, solved, unknowns, size, noise, solved.grid.steps), solved)

    @classmethod
    def _on(cls, ground: Ground, solved: Solved) -> ProfileLine:
        """The line through an answer on a ground; nothing was seen where the answer does not settle on it."""
        home = ground.home(solved.theta, solved.trajectories)
        recent = deque([] if home is None else [home], maxlen=KEPT)  # of a long log each is as large as the log
        answer, settled = solved.solution.cost, None
        if home is not None:
            answer = home.problem.evaluate(home.problem.start, derivatives=False).cost
            settled = home.warm.settle(home.problem.start)
        if home is None or settled is None:
            best = ground.solved(solved.theta, solved.trajectories, FREE)
        else:
            best = ground.settled(home, settled, FREE)
        known = best or ProfilePoint(solved.theta, solved.trajectories, solved.solution.cost, FREE)
        return cls(ground, known, answer, home, [] if best is None else [best], recent)

    @property
    def unknowns(self) -> Unknowns:
        """As the scene gives them."""
        return self.ground.unknowns

    def point(self, near: ProfilePoint, held: int, value: float) -> ProfilePoint | None:
        """The best point with theta[held] = value, from a neighbour; None where nothing succeeds, or the time is up."""
        return None if time_is_up() else self._warm(near, held, value) or self._from_theta(near, held, value)

    def settled(self, theta: Array, trajectories: list[ShootingTrajectory]) -> ProfilePoint | None:
        """The lowest point near a motion, nothing held, or where the solver finds none the parameter held that is
        farthest off; None where it fails then too."""
        free = np.flatnonzero(self.unknowns.free)
        farthest = int(free[np.argmax(np.abs(theta - self.best.theta)[free] / self.ground.size)])
        return self._solved(theta, trajectories, FREE) or self._solved(theta, trajectories, farthest)

    def loss_root(self, point: ProfilePoint) -> float:
        """The square root of what the data object to a point, against the best one."""
        return float(np.sqrt(max(point.change.objection(2 * (point.cost - self.best.cost)), 0.0)))

    def _warm(self, near: ProfilePoint, held: int, value: float) -> ProfilePoint | None:
        """The point by Newton's steps from a neighbour, None where they do not get there; where events move far, once
        more with the samples assigned anew."""
        home, z, multipliers = near.home() if near.home is not None else None, near.z, near.multipliers
        for _ in range(HOMES):
            if home is None or z is None:
                home = self._home(near.theta, near.trajectories)
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
            near, home = self.ground.point(problem, home.trajectories, found.z, found.cost, home.theta, held), None
        return None

    def _from_theta(self, near: ProfilePoint, held: int, value: float) -> ProfilePoint | None:
        theta = near.theta.copy()
        theta[held] = value
        return self._solved(theta, near.trajectories, held)

    def _home(self, theta: Array, trajectories: list[ShootingTrajectory]) -> Home | None:
        """The neighbourhood of a motion, kept for a while; None where it is none for Newton's steps."""
        home = self.ground.home(theta, trajectories)
        if home is not None:
            self.recent.append(home)
        return home

    def _seen(self, home: Home, found: Settled, held: int) -> ProfilePoint:
        """The point that settled, kept."""
        made = self.ground.settled(home, found, held)
        self.seen.append(made)
        return made

    def _solved(self, theta: Array, trajectories: list[ShootingTrajectory], held: int) -> ProfilePoint | None:
        """The point by the solver, kept; None where it fails."""
        made = self.ground.solved(theta, trajectories, held)
        if made is not None:
            self.seen.append(made)
        return made
