"""An accepted answer under examination: it is walked along its ridges, and moves where a better place is met."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.asked import Asked
from identify.examination.allowed import Allowed, allowed
from identify.examination.fine_enough import information_at
from identify.examination.ridge_ends import better_course, other_sign
from identify.examination.valleys import lowest_valley
from identify.examination.worth_a_walk import doubtful, ridge
from identify.numerics.level import LEVEL
from identify.numerics.quantiles import chi_square
from identify.outcome import Status
from identify.preparation.unknowns import Unknowns
from identify.search.attempt import Attempt, resolve_firmly
from identify.search.gate import Gate
from identify.search.inward import at_own_bounds
from identify.telling import Progress
from identify.uncertainty.hints import hints, onsets, untold
from identify.uncertainty.profile import Profiles, profile
from identify.uncertainty.profile_ground import ProfilePoint
from identify.uncertainty.uncertainty import Estimate, Information, Interval, estimates
from identify.uncertainty.widened import widened

Array = NDArray[np.float64]
AtBound = Callable[[Array], Mapping[str, str]]

BETTER_TRIES = 3  # how often a profile, or the ends of a ridge, may hand back a better optimum
CURVE_STEPS = 4  # of each side of a profile that is drawn


@dataclass(frozen=True)
class Question:
    """What is asked of an answer: unknowns; base (n_p,) of the rig the values are given for; asked; at_bound: sentence
    per parameter that sits at a bound, from theta; speed_tolerance: relative error of all drive speeds together; seed:
    of the starts that are thrown about it."""

    unknowns: Unknowns
    base: Array
    asked: Asked
    at_bound: AtBound
    speed_tolerance: float
    seed: int
    progress: Progress


@dataclass(frozen=True)
class View:
    """What is seen from one answer: bounds that parameters sit at, hints, what is allowed for, joint covariance
    (f + o, f + o) widened to hold the points of the walk, the estimates."""

    bounds: Mapping[str, str]
    hints: Mapping[str, str]
    allowed: Allowed
    joint: Array
    found: list[Estimate]

    @property
    def covariance(self) -> Array:
        """Of the free parameters (f, f)."""
        f = len(self.allowed.white)
        return self.joint[:f, :f]

    @property
    def leaves_open(self) -> bool:
        """Whether the data do not tell some parameter."""
        return any(e.verdict == "not identifiable" for e in self.found)


class Examination:
    """An answer, the information at it, and the profiles walked from it; all change where the answer moves."""

    def __init__(self, attempt: Attempt, known: Information, question: Question) -> None:
        self._q = question
        self._mirrored = False
        self._valleys: list[Attempt] = []
        self._met: tuple[ProfilePoint, ...] = ()  # by the walk before, of so many samples
        self._samples = 0
        self._stand(attempt, known, None)
        self.view = self._seen()
        self._look_around()
        for tries in range(BETTER_TRIES):
            if not (self._elsewhere() or self._walk(last=tries + 1 == BETTER_TRIES)):
                break
            self.view = self._seen()

    @property
    def accepted(self) -> bool:
        """Whether the answer still is one."""
        return self.attempt.gate.status is Status.CONVERGED

    def _seen(self) -> View:
        q, solved = self._q, self.attempt.solved
        bounds = q.at_bound(solved.theta)
        told = hints(self.attempt.prepared, solved.guesses, q.unknowns, solved.theta)
        joint, f = self._allowed.joint.copy(), len(self._allowed.white)
        if self.walked is not None:
            joint[:f, :f] = widened(self._allowed.covariance, self.walked.likely, self.walked.objection)
        ends = {} if self.walked is None else self.walked.ends
        intervals = {name: Interval(*(side.end for side in sides)) for name, sides in ends.items()}
        found = estimates(
            q.unknowns, solved.theta, q.base, joint[:f, :f], at_bound=bounds, hints=told, profiles=intervals
        )
        return View(bounds, told, self._allowed, joint, untold(found, solved.guesses, told))

    def _elsewhere(self) -> bool:
        """Whether the answer moved: to friction that rises instead of falling, or from the ends of a ridge to another
        course of the motion."""
        if not (self.accepted and self.view.leaves_open):
            return False
        other: Attempt | None = None
        if not self._mirrored:
            self._mirrored = True
            other = other_sign(self.attempt, self._q.unknowns)
        if other is None and self.walked is not None:
            other = better_course(self.attempt, self._q.unknowns, self.walked.likely)
        if other is None:
            return False
        self._move(other, None)
        return True

    def _look_around(self) -> None:
        """Where the data hardly tell some parameter, the lowest of the valleys about the answer takes its place."""
        q = self._q
        if not (self.accepted and self._doubtful()):
            return
        q.progress("looking for other valleys", None)
        lowest, self._valleys = lowest_valley(self.attempt, q.unknowns, q.seed)
        if lowest is not self.attempt:
            self._move(lowest, None)
            self.view = self._seen()

    def _move(self, attempt: Attempt, walked: Profiles | None) -> None:
        self._stand(attempt, information_at(attempt, self._q.unknowns), walked)

    def _stand(self, attempt: Attempt, known: Information, walked: Profiles | None) -> None:
        self.attempt, self.known, self.walked = attempt, known, walked
        self._allowed = allowed(attempt, known, self._q.speed_tolerance)  # walks do not change it

    def _along(self) -> list[int] | None:
        """The parameters that a walk is worth while for; None: all."""
        q, view, solved = self._q, self.view, self.attempt.solved
        if q.asked.profile or view.bounds or self._doubtful():
            return None
        return ridge(q.unknowns, view.covariance, solved.theta, q.base) if self._tells else []

    @property
    def _tells(self) -> bool:
        """Whether there is more than one peak or one level: what these do not tell, no walk will find an end of."""
        return onsets(self.attempt.solved.guesses) > 1

    def _doubtful(self) -> bool:
        return self._tells and doubtful(self._q.unknowns, self.view.covariance, self.view.found)

    def _walk(self, last: bool) -> bool:
        """Whether a walk along the ridges was worth while, once at each answer; where it meets a better place, the
        answer moves there.

        Args:
            last: no other walk will follow.
        """
        if self.walked is not None or not self.accepted:
            return False
        along = self._along()
        if along == []:
            return False
        q, solved = self._q, self.attempt.solved
        self.walked = profile(
            self.attempt.prepared,
            solved,
            q.unknowns,
            self.view.allowed.white,
            q.progress,
            memory=self.view.allowed.memory,
            steps=CURVE_STEPS if q.asked.profile else 1,
            only=along,
            valleys=[valley.solved for valley in self._valleys],
            before=self._met if self._samples == solved.problem.samples else (),
        )
        self._samples, self._met = solved.problem.samples, self.walked.met
        if self.walked.better is not None:
            self._to_better(self.walked, self.walked.better, last)
        return True

    def _to_better(self, walked: Profiles, better: ProfilePoint, last: bool) -> None:
        """The answer moves to the better place that a walk met, where the solver settles there."""
        q, solved = self._q, self.attempt.solved
        moved = resolve_firmly(self.attempt, q.unknowns, better.theta, better.guesses)
        inside = walked.gain < chi_square(LEVEL, int(np.sum(q.unknowns.free)))
        converged = moved.gate.status is Status.CONVERGED
        if inside and (not converged or np.any(at_own_bounds(q.unknowns, moved.solved.theta))):
            # Inside the joint region: another point of the same ridge, at which the solver finds no end, or which has
            # none within the model.
            self.walked = walked.seen_from(q.unknowns, solved.theta)
            return
        if not converged:
            moved = replace(moved, gate=_another_start(moved, q.unknowns, walked.gain, better, q.base))
        if inside:  # the data hardly prefer the one to the other
            self._valleys.append(self.attempt)
        self._move(moved, walked.seen_from(q.unknowns, moved.solved.theta) if last else None)


def _another_start(moved: Attempt, unknowns: Unknowns, gain: float, better: ProfilePoint, base: Array) -> Gate:
    """The gate of an answer that a profile found a better place than, at which the solver does not settle."""
    values = unknowns.values(better.theta, base)
    told = ", ".join(
        f"{unknowns.names[i]} = {values[i]:.4g} {unknowns.model.parameters[i].unit}".rstrip()
        for i in np.flatnonzero(unknowns.free).tolist()
    )
    message = (
        f"another start is better: chi^2 falls by {gain:.3g} below that of the answer found, and the solver "
        f"does not settle there ({moved.gate.solver}); give these as start values under [parameters]: {told}"
    )
    return replace(moved.gate, status=Status.BETTER_START_FOUND, message=message)
