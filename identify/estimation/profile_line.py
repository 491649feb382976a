"""The points of a profile: the best answer with one parameter held, warm from a neighbour, else by the solver."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.estimation.objection import Remembering
from identify.estimation.profile_ground import FREE, STEPS, Ground, Home, ProfilePoint
from identify.logs.log_data import Guess
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.passes import Solved
from identify.shooting.warm import Settled

Array = NDArray[np.float64]

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
        cls, logs: Sequence[Prepared], solved: Solved, unknowns: Unknowns, size: Array, noise: Remembering
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
        home = ground.home(solved.theta, solved.guesses)
        recent = deque([] if home is None else [home], maxlen=KEPT)  # of a long log each is as large as the log
        answer, settled = solved.solution.cost, None
        if home is not None:
            answer = home.problem.evaluate(home.problem.start, derivatives=False).cost
            settled = home.warm.settle(home.problem.start)
        if home is None or settled is None:
            best = ground.solved(solved.theta, solved.guesses, FREE)
        else:
            best = ground.settled(home, settled, FREE)
        known = best or ProfilePoint(solved.theta, solved.guesses, solved.solution.cost, FREE)
        return cls(ground, known, answer, home, [] if best is None else [best], recent)

    @property
    def unknowns(self) -> Unknowns:
        """As the scene gives them."""
        return self.ground.unknowns

    def point(self, near: ProfilePoint, held: int, value: float) -> ProfilePoint | None:
        """The best point with theta[held] = value, from a neighbour; None where nothing succeeds, or the time is up."""
        return None if time_is_up() else self._warm(near, held, value) or self._from_theta(near, held, value)

    def settled(self, theta: Array, guesses: list[Guess]) -> ProfilePoint | None:
        """The lowest point near a motion, nothing held, or where the solver finds none the parameter held that is
        farthest off; None where it fails then too."""
        free = np.flatnonzero(self.unknowns.free)
        farthest = int(free[np.argmax(np.abs(theta - self.best.theta)[free] / self.ground.size)])
        return self._solved(theta, guesses, FREE) or self._solved(theta, guesses, farthest)

    def loss_root(self, point: ProfilePoint) -> float:
        """The square root of what the data object to a point, against the best one."""
        return float(np.sqrt(max(point.change.objection(2 * (point.cost - self.best.cost)), 0.0)))

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
            near, home = self.ground.point(problem, home.guesses, found.z, found.cost, home.theta, held), None
        return None

    def _from_theta(self, near: ProfilePoint, held: int, value: float) -> ProfilePoint | None:
        theta = near.theta.copy()
        theta[held] = value
        return self._solved(theta, near.guesses, held)

    def _home(self, theta: Array, guesses: list[Guess]) -> Home | None:
        """The neighbourhood of a motion, kept for a while; None where it is none for Newton's steps."""
        home = self.ground.home(theta, guesses)
        if home is not None:
            self.recent.append(home)
        return home

    def _seen(self, home: Home, found: Settled, held: int) -> ProfilePoint:
        """The point that settled, kept."""
        made = self.ground.settled(home, found, held)
        self.seen.append(made)
        return made

    def _solved(self, theta: Array, guesses: list[Guess], held: int) -> ProfilePoint | None:
        """The point by the solver, kept; None where it fails."""
        made = self.ground.solved(theta, guesses, held)
        if made is not None:
            self.seen.append(made)
        return made
