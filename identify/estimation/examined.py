"""An accepted answer under examination: it is walked along its ridges, and moves where a better place is met."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import no_time_limit, time_is_up
from identify.base.outcome import Status
from identify.base.progress import Progress
from identify.base.quantiles import LEVEL, NORMAL, chi_square
from identify.estimation.agreement import Allowed, allowed, imbalance, influence_at
from identify.estimation.attempt import Attempt, gated, placed_anew, solve_again, solve_again_with_priors
from identify.estimation.covariance import (
    IDENTIFIED,
    Estimate,
    Information,
    Interval,
    estimates,
    information,
    sizes,
    widened_on_both_scales,
)
from identify.estimation.goodness_of_fit import Gate
from identify.estimation.hints import hints, onsets, untold
from identify.estimation.other_optima import lowest_optimum, weakens, within
from identify.estimation.profile import ProfileNoise, ProfileOptions, Profiles, profile
from identify.estimation.profile_line import ProfilePoint
from identify.estimation.status_words import at_bounds
from identify.estimation.strategies import Strategy, run_strategy
from identify.logs.unknowns import Unknowns
from identify.logs.vibration import rhythmic
from identify.shooting.accuracy import FitOptions
from identify.shooting.layout import kept_parameters
from identify.shooting.passes import SETTLED, Solved, goes_as_far_as_it_can
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.shooting.warm import Warm

# ----------------------------------------------------------------------------------------------------------------------
# Which parameters a profile has to walk along: what the curvature at one point says too little about.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

DOUBTFUL = 0.13  # standard error of a logarithm: an interval of a quarter each way
CURVED = 0.012  # standard error of a logarithm beyond which the ridge along it may bend
NEAR = 0.4  # of the longest side of a coefficient that is identified: a bent ridge may add what is missing


def doubtful(unknowns: Unknowns, covariance: Array, found: list[Estimate]) -> bool:
    """Whether some parameter is so uncertain that the curvature at one point says little about its interval."""
    beside = rhythmic(unknowns)
    wide = np.sqrt(np.diag(covariance)) > DOUBTFUL
    asked = {name for name, aside in zip(unknowns.names, beside, strict=True) if not aside}
    return bool(np.any(wide & (unknowns.logarithmic & ~beside)[unknowns.free])) or any(
        e.verdict == "not identifiable" and e.name in asked for e in found
    )


def ridge(unknowns: Unknowns, covariance: Array, theta: Array, base: Array) -> list[int]:
    """The parameters that are so uncertain that the others may follow each of them on a bent path; and with these the
    coefficients whose verdict may hang on what that path adds to their intervals."""
    free, sd = np.flatnonzero(unknowns.free), np.sqrt(np.diag(covariance))
    asked, logarithmic = ~rhythmic(unknowns)[free], unknowns.logarithmic[free]
    bent = asked & logarithmic & (sd > CURVED)
    side = NORMAL * sd / sizes(unknowns, unknowns.values(theta, base))[free]
    near = asked & ~logarithmic & (side > NEAR * IDENTIFIED)
    return free[bent | near].tolist() if np.any(bent) else []


# ----------------------------------------------------------------------------------------------------------------------
# Steps of the integration so fine that their error is a small part of each standard error.
# ----------------------------------------------------------------------------------------------------------------------


def fine_enough(
    attempt: Attempt, unknowns: Unknowns, asked: FitOptions
) -> tuple[Attempt, Information, dict[str, float]]:
    """The answer with steps so fine that their error is a small part of each standard error, and that part by name."""
    level = asked.accuracy
    if attempt.gate.status is Status.CONVERGED and attempt.solved.grid.steps > level.most:
        attempt = solve_again(attempt, replace(unknowns, start=attempt.solved.theta), most=level.most)
    known = information_at(attempt, unknowns)
    shares: dict[str, float] = {}
    for _ in range(1 + level.refinements):
        if attempt.gate.status is not Status.CONVERGED or not np.all(np.isfinite(known.total)):
            break
        error = attempt.solved.discretisation_error / np.sqrt(np.diag(known.covariance()))
        free = np.flatnonzero(unknowns.free).tolist()
        shares = {unknowns.names[i]: float(np.nan_to_num(e)) for i, e in zip(free, error, strict=True)}
        if not shares or max(abs(e) for e in shares.values()) <= level.share:
            break
        finer = 2 * attempt.solved.grid.steps
        if finer > level.most:
            break
        size = np.sqrt(np.diag(known.joint_covariance()))
        again = run_strategy(Strategy.FINER_STEPS, partial(_finer, attempt, unknowns, finer, size), attempt)
        if again is None or again.gate.status is Status.SOLVER_FAILED:
            break  # no reason to give up the answer: what its steps cost is told
        attempt, known = again, information_at(again, unknowns)
    return attempt, known, shares


def _finer(attempt: Attempt, unknowns: Unknowns, steps: int, size: Array) -> Attempt:
    """The answer with so many steps per interval, twice as many as before: by Newton's method from the answer, where
    that does not converge by a new solve.

    Args:
        size: (f + o,) standard errors of the free parameters and of those of single logs.
    """
    solved = attempt.solved
    problem, z = solved.problem.with_steps(steps), solved.solution.z
    layout = problem.layout
    kept = kept_parameters(layout)
    try:
        settled = Warm(problem, z, kept, size).settle(z, multipliers=solved.solution.multipliers)
    except np.linalg.LinAlgError:
        settled = None
    if settled is not None:
        x = settled.z * layout.scale
        moved = [place.read(one, x) for place, one in zip(layout.places, solved.formed_from, strict=True)]
        pairs = zip(layout.places, attempt.fitted_logs, strict=True)
        shift = max(float(np.max(np.abs(x[at.events]), initial=0.0)) / log.data.interval for at, log in pairs)
        if shift < SETTLED:
            theta = solved.theta.copy()
            theta[layout.free] = x[: layout.free.size]
            solution = replace(solved.solution, z=settled.z, x=x, cost=settled.cost, multipliers=settled.multipliers)
            grid = replace(solved.grid, steps=steps)
            finer = replace(solved, problem=problem, grid=grid, solution=solution, trajectories=moved, theta=theta)
            finer = replace(finer, event_shift=shift)
            return replace(attempt, solved=finer, gate=gated(finer, attempt.fitted_logs))
    return solve_again(attempt, replace(unknowns, start=solved.theta), steps=steps)


def information_at(attempt: Attempt, unknowns: Unknowns) -> Information:
    """The information of the data on all parameters, those held fixed too, at the answer."""
    solved = attempt.solved
    at_answer = replace(unknowns, start=solved.theta)
    return information(*solved.problem.with_all_parameters(at_answer, solved.solution.z))


BETTER_TRIES = 3  # how often a profile, or the ends of a ridge, may hand back a better optimum
CURVE_STEPS = 4  # of each side of a profile that is drawn


@dataclass(frozen=True)
class Question:
    """What is asked of an answer: unknowns; base (n_p,) of the rig the values are given for; asked; speed_tolerance:
    relative error of all drive speeds together; seed: of the starts that are thrown about it."""

    unknowns: Unknowns
    base: Array
    asked: FitOptions
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


@dataclass(frozen=True)
class History:
    """What was met on the way to an answer: optima beside it; points of the last walk, which was of so many
    samples."""

    optima: tuple[Attempt, ...] = ()
    met: tuple[ProfilePoint, ...] = ()
    samples: int = 0


@dataclass(frozen=True)
class Examined:
    """An answer, the information known at it, the profiles walked from it (None: none were), what is seen from it;
    unfinished: the time was up before all was looked at that this answer calls for."""

    attempt: Attempt
    known: Information
    walked: Profiles | None
    view: View
    history: History
    unfinished: bool = False

    @property
    def accepted(self) -> bool:
        """Whether the answer still is one."""
        return self.attempt.gate.status is Status.CONVERGED


def examine(attempt: Attempt, known: Information, question: Question) -> Examined:
    """The answer with the walks along its ridges that are worth while, or the better one to which these, thrown starts
    or another course of the motion lead.

    Args:
        known: at the answer that is given.
    """
    here = _unless_bound_is_active(_lowest_about(_standing(attempt, known, question, History()), question))
    for tries in range(BETTER_TRIES):
        there = _walked(here, question, last=tries + 1 == BETTER_TRIES)
        if there is None:
            break
        here = _unless_bound_is_active(there)
    calls_for_more = here.accepted and (_doubtful(here, question) or here.view.leaves_open)
    return replace(here, unfinished=time_is_up() and calls_for_more)


def _unless_bound_is_active(here: Examined) -> Examined:
    """The answer, refused where it hangs on a phase that can get no shorter: no walk from there comes to an end. At a
    bound the pulls of the logs do not cancel, and nothing is known of it."""
    gate = here.attempt.gate
    if not here.accepted or here.view.bounds:
        return here
    held = active_event_bound(here.attempt.solved, [log.name for log in here.attempt.fitted_logs])
    if held is None:
        return here
    refused = replace(gate, status=Status.WRONG_EVENT_COUNT, message=held)
    return replace(here, attempt=replace(here.attempt, gate=refused))


def _standing(
    attempt: Attempt, known: Information, q: Question, history: History, walked: Profiles | None = None
) -> Examined:
    """At an answer at which nothing was looked at yet."""
    seen = allowed(attempt, known, q.speed_tolerance)
    return Examined(attempt, known, walked, _view(attempt, seen, walked, q), history)


def _moved(attempt: Attempt, q: Question, history: History, walked: Profiles | None = None) -> Examined:
    """At another answer."""
    return _standing(attempt, information_at(attempt, q.unknowns), q, history, walked)


def _view(attempt: Attempt, seen: Allowed, walked: Profiles | None, q: Question) -> View:
    """What is seen from an answer; seen: what is allowed for there, which walks do not change."""
    solved = attempt.solved
    bounds = at_bounds(q.unknowns, solved.theta)
    hinted = hints(attempt.fitted_logs, solved.trajectories, q.unknowns, solved.theta)
    told = {name: str(hint) for name, hint in hinted.items()}
    joint, f = seen.joint.copy(), len(seen.white)
    free = q.unknowns.free
    if walked is not None and walked.likely.size:
        values, logarithmic = q.unknowns.values(solved.theta, q.base)[free], q.unknowns.logarithmic[free]
        joint[:f, :f] = widened_on_both_scales(seen.covariance, walked.likely, walked.objection, values, logarithmic)
    ends = {} if walked is None else walked.ends
    intervals = {name: Interval(*(side.end for side in sides)) for name, sides in ends.items()}
    found = estimates(q.unknowns, solved.theta, q.base, joint[:f, :f], at_bound=bounds, hints=told, profiles=intervals)
    return View(bounds, told, seen, joint, untold(found, solved.trajectories, told))


def _lowest_about(here: Examined, q: Question) -> Examined:
    """Where the data hardly tell some parameter, the lowest of the optima about the answer takes its place."""
    if not (here.accepted and _doubtful(here, q)):
        return here
    q.progress("looking for other optima", None)
    lowest, optima = lowest_optimum(here.attempt, q.unknowns, q.seed, here.view.allowed.noise)
    history = replace(here.history, optima=tuple(optima))
    return replace(here, history=history) if lowest is here.attempt else _moved(lowest, q, history)


def _tells(attempt: Attempt) -> bool:
    """Whether there is more than one peak or one level: what these do not tell, no walk will find an end of."""
    return onsets(attempt.solved.trajectories) > 1


def _doubtful(here: Examined, q: Question) -> bool:
    return _tells(here.attempt) and doubtful(q.unknowns, here.view.covariance, here.view.found)


def _along(here: Examined, q: Question) -> list[int] | None:
    """The parameters that a walk is worth while for; None: all."""
    if q.asked.profile or here.view.bounds or _doubtful(here, q):
        return None
    theta = here.attempt.solved.theta
    return ridge(q.unknowns, here.view.covariance, theta, q.base) if _tells(here.attempt) else []


def _walked(here: Examined, q: Question, *, last: bool) -> Examined | None:
    """After a walk along the ridges, once at each answer, at the better place where one was met; None where no walk is
    worth while.

    Args:
        last: no other walk will follow.
    """
    if here.walked is not None or not here.accepted:
        return None
    along = _along(here, q)
    if along == []:
        return None
    history, samples = here.history, here.attempt.solved.problem.samples
    with no_time_limit() if q.asked.profile else nullcontext():
        walked = _profile(here, here, along, q)
        for optimum in history.optima:
            sides = walked.outside(q.unknowns, optimum.solved.theta)
            noise = here.view.allowed.noise
            if walked.better is None and sides and within(here.attempt, optimum, q.unknowns, noise):
                there = _profile(_moved(optimum, q, History()), here, along, q, sides)
                walked = walked.joined(there, q.unknowns)
    here = replace(here, history=replace(history, met=walked.met, samples=samples))
    return _with_walk(here, walked, q) if walked.better is None else _at_better(here, walked, walked.better, q, last)


def _profile(
    place: Examined,
    answer: Examined,
    along: list[int] | None,
    q: Question,
    sides: Collection[tuple[int, float]] | None = None,
) -> Profiles:
    """The walks from a place: the answer, or an optimum beside it that the data hardly tell from it. That is walked
    from for itself, on the sides that do not hold it: where a slip has another phase the curves have another form,
    and no walk leads from the one to the other."""
    seen, history, solved = place.view.allowed, answer.history, place.attempt.solved
    beside = seen.memory / seen.variance_inflation
    noise = ProfileNoise(seen.white, answer.view.allowed.noise, seen.variance_inflation, beside)
    asked = ProfileOptions(only=along, sides=sides)
    if place is answer:
        asked = replace(
            asked,
            steps=CURVE_STEPS if q.asked.profile else 1,
            optima=[optimum.solved for optimum in history.optima],
            before=history.met if history.samples == solved.problem.samples else (),
        )
    return profile(place.attempt.fitted_logs, solved, q.unknowns, noise, asked, q.progress)


def _with_walk(here: Examined, walked: Profiles, q: Question) -> Examined:
    """At the same answer, with the walk from it."""
    return replace(here, walked=walked, view=_view(here.attempt, here.view.allowed, walked, q))


def _at_better(here: Examined, walked: Profiles, better: ProfilePoint, q: Question, last: bool) -> Examined:
    """At the better place that a walk met, where the solver settles there."""
    theta, history = here.attempt.solved.theta, here.history
    moved = run_strategy(
        Strategy.PROFILE_OPTIMUM,
        lambda: _settled(here.attempt, better, q.unknowns),
        here.attempt,
        here.attempt.log_numbers,
    )
    if moved is None:
        return _with_walk(here, walked.seen_from(q.unknowns, theta), q)
    inside = walked.clear < chi_square(LEVEL, int(np.sum(q.unknowns.free)))
    converged = moved.gate.status is Status.CONVERGED
    lost = not converged or bool(np.any(q.unknowns.at_own_bounds(moved.solved.theta)))
    if inside and (lost or _turns_weak(theta, moved.solved.theta, q.unknowns)):
        # Inside the joint region: another point of the same ridge, at which the solver finds no end, or which has
        # none within the model, or only among contacts that weaken while they rest.
        return _with_walk(here, walked.seen_from(q.unknowns, theta), q)
    if not converged:
        moved = replace(moved, gate=_another_start(moved, q.unknowns, walked.gain, better, q.base))
    if inside:  # the data hardly prefer the one to the other
        history = replace(history, optima=(*history.optima, here.attempt))
    return _moved(moved, q, history, walked.seen_from(q.unknowns, moved.solved.theta) if last else None)


def _settled(attempt: Attempt, better: ProfilePoint, unknowns: Unknowns) -> Attempt:
    """The answer at a better place, from the motion there, else from the one that its values make: what a user who
    gave them as start values would get."""
    moved = solve_again_with_priors(attempt, unknowns, better.theta, better.trajectories)
    if moved.gate.status is Status.CONVERGED:
        return moved
    return placed_anew(attempt, unknowns, better.theta) or moved


def _turns_weak(here: Array, there: Array, unknowns: Unknowns) -> bool:
    return weakens(unknowns, there) and not weakens(unknowns, here)


def _another_start(moved: Attempt, unknowns: Unknowns, gain: float, better: ProfilePoint, base: Array) -> Gate:
    """The gate of an answer that a profile found a better place than, at which the solver does not settle."""
    values = unknowns.values(better.theta, base)
    told = ", ".join(
        f"{unknowns.names[i]} = {values[i]:.4g} {unknowns.model.parameters[i].unit}".rstrip()
        for i in np.flatnonzero(unknowns.free).tolist()
    )
    static, kinetic = (values[unknowns.names.index(name)] for name in ("mu_s", "mu_k0"))
    remedy = (
        "neither from the motion found nor from that of these values; fix what is known of them, or give it a prior, "
        "under [parameters], or add a log that tells it; that place"
    )
    if not kinetic < static:  # no start can say that
        remedy = (
            "there contacts weaken while they rest (mu_k0 above mu_s); bound mu_k0 from above by what is known of it "
            "under [parameters], or add a log at another speed; that place"
        )
    message = (
        f"a better place was met: chi^2 falls by {gain:.3g} below that of the answer found, and the solver "
        f"does not settle there ({moved.gate.solver}); {remedy}: {told}"
    )
    return replace(moved.gate, status=Status.BETTER_START_FOUND, message=message)


# ----------------------------------------------------------------------------------------------------------------------
# Does an answer hang on a phase that shrinks to nothing?
# ----------------------------------------------------------------------------------------------------------------------

HELD = 4.0  # squared distance from which on an answer hangs on what is no data: two standard errors


def active_event_bound(solved: Solved, names: Sequence[str]) -> str | None:
    """A sentence where a phase that can get no shorter holds the answer back by more than two standard errors: a rest,
    or a contact that re-ages in mid-slide, may shrink to nothing from pass to pass where at the answer it does not
    happen.

    Args:
        names: of the logs.
    """
    problem, solution = solved.problem, solved.solution
    ends = [bool(goes_as_far_as_it_can(problem, solution.x, place.events).any()) for place in problem.layout.places]
    if not any(ends):
        return None
    try:
        squared, _ = imbalance(problem, solution.z, influence_at(solved))
    except np.linalg.LinAlgError:  # directions that no log tells: their verdicts say so
        return None
    if squared < HELD:
        return None
    there = zip(solved.trajectories, names, ends, strict=True)
    (begin, end), name = min(
        ((_shortest(trajectory), name) for trajectory, name, held in there if held),
        key=lambda found: found[0][1] - found[0][0],
    )
    return (
        f"{name}: at this answer what happens from {begin:.5g} s lasts {end - begin:.2g} s only, if it happens at all, "
        f"and holds the answer back by {np.sqrt(squared):.1f} standard errors; leave this log out or end it "
        "there"
    )


def _shortest(trajectory: ShootingTrajectory) -> tuple[float, float]:
    """Begin and end [s] of the shortest phase of a motion after its first onset."""
    if trajectory.until.size < 2:
        return float(trajectory.until[0]), float(trajectory.until[0])
    first = int(np.argmin(np.diff(trajectory.until)))
    return float(trajectory.until[first]), float(trajectory.until[first + 1])
