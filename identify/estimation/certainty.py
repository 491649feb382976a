"""How well an answer is known: finer steps, other optima, profiles, agreement of the logs, intervals, in this order.

Each step asks something of the answer that its covariance cannot say, and is left out where nothing depends on it or
the time is up: the intervals are then those known so far, at least the ones of the covariance.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import no_time_limit
from identify.base.progress import Progress
from identify.base.quantiles import LEVEL, NORMAL, chi_square
from identify.base.result import Status
from identify.estimation.attempt import Attempt, solve_again
from identify.estimation.covariance import (
    IDENTIFIED,
    Estimate,
    Information,
    estimates,
    information_at,
    sizes,
)
from identify.estimation.estimator import FINER_STEPS, in_time, tried
from identify.estimation.fit_wording import at_bounds, hints, not_determined, onsets
from identify.estimation.influence import Allowed, Bootstrap, allowed, bootstrap, contradiction, influence
from identify.estimation.multistart import OTHER_OPTIMA, Optimum, multistart
from identify.estimation.profile import Profiles, converged, profile
from identify.logs.unknowns import Unknowns
from identify.logs.vibration import rhythmic
from identify.shooting.accuracy import FitOptions
from identify.shooting.layout import kept_parameters
from identify.shooting.passes import Solved, goes_as_far_as_it_can

Array = NDArray[np.float64]

POORLY = 0.13  # standard error of a logarithm: an interval of a quarter each way, of which one curvature says little
CURVED = 0.012  # standard error of a logarithm beyond which the others may follow it on a bent path


@dataclass(frozen=True)
class Share:
    """A parameter of one group: index among the parameters, group in words, theta; place (-1: the shared one, which is
    that of the first group) among those beyond the free ones; log: the first one that has it (index in the attempt)."""

    index: int
    group: str
    theta: float
    place: int
    log: int


@dataclass(frozen=True)
class Certainty:
    """What is known of the free parameters (f,) at an answer.

    Attributes
    ----------
    attempt: the answer, in a lower optimum where one was met.
    information: of all parameters.
    allowed: covariances for white noise and with all that is allowed for.
    estimates: values, standard errors, intervals and verdicts.
    bounds, hints: sentences, by parameter, on those at a bound and on what would determine them.
    refused: status and sentence where it is no answer after all, though it fits.
    profiles, bootstrap: None where not run.
    optima: those that were found, the answer first; empty where none were sought.
    shares: groups with parameters of their own; of_groups: the estimates beyond the first group's.
    """

    attempt: Attempt
    information: Information
    allowed: Allowed
    estimates: list[Estimate]
    bounds: Mapping[str, str]
    hints: Mapping[str, str]
    refused: tuple[Status, str] | None = None
    profiles: Profiles | None = None
    bootstrap: Bootstrap | None = None
    optima: Sequence[Optimum] = ()
    shares: list[Share] = field(default_factory=list)
    of_groups: list[tuple[Share, Estimate]] = field(default_factory=list)

    @property
    def covariance(self) -> Array:
        """Covariance (f, f) with all that is allowed for."""
        return self.allowed.covariance

    @property
    def region(self) -> float:
        """The likelihood ratio within which all free parameters together are likely."""
        return chi_square(LEVEL, len(self.allowed.white)) * float(np.max(self.allowed.inflation, initial=1.0))

    def within(self, optima: Sequence[Optimum]) -> list[Optimum]:
        """Those of some optima, beside the answer, that the data do not rule out."""
        cost = self.attempt.solved.solution.cost
        return [o for o in optima if o.attempt is not self.attempt and 2.0 * (o.cost - cost) < self.region]


@dataclass(frozen=True)
class Question:
    """Of what, and under which options, certainty is asked: the search space; base (n_p,) of the rig the values are
    given for; speed_error: relative, of all drive speeds together; seed: of the starts about the answer and of the
    bootstrap."""

    unknowns: Unknowns
    base: Array
    options: FitOptions
    speed_error: float
    seed: int
    progress: Progress


def certainty(attempt: Attempt, q: Question) -> Certainty | None:
    """All that is said of how sure an answer is; None where the model has no derivatives there."""
    attempt, known = fine_enough(attempt, q.unknowns, q.options)
    if not known.known:
        return None
    optima, profiles, refused = list[Optimum](), None, None
    here, fits = _at(attempt, known, q), attempt.fits
    if fits and _poorly_determined(here, q) and in_time(OTHER_OPTIMA):
        q.progress("looking for other optima", None)
        optima = multistart(attempt, q.unknowns, q.seed, here.covariance)
        if optima[0].attempt is not attempt:
            here = _at(optima[0].attempt, information_at(optima[0].attempt.solved, q.unknowns), q)
    if fits:
        profiles = _profiles(here, q, restart=True)
    if profiles is not None and profiles.lower is not None:  # the fit starts again from there, once
        here, refused = _restarted(here, profiles, q)
        profiles = None if refused is not None else _profiles(here, q, restart=False)
    if profiles is not None:
        # Where a profile finds an end open, others may follow that parameter on its bent path.
        seen = _at(here.attempt, here.information, q, profiles)
        if (further := _profiles(seen, q, restart=False, done=profiles.ends)) is not None:
            profiles = replace(
                profiles, ends=profiles.ends | further.ends, curves={**profiles.curves, **further.curves}
            )
        halves = np.zeros(q.unknowns.free.size)
        halves[q.unknowns.free] = NORMAL * np.sqrt(np.diag(here.covariance))
        for other in here.within(optima):
            profiles = profiles.with_optimum(q.unknowns, other.attempt.solved.theta, halves)
        here = _at(here.attempt, here.information, q, profiles)
    if fits and refused is None and not here.bounds:  # at a bound of a parameter the scores do not cancel
        if message := active_event_bound(here.attempt.solved, here.attempt.names):
            refused = Status.WRONG_EVENT_COUNT, message
        elif len(here.attempt.log_numbers) > 1:
            message = contradiction(here.attempt, q.unknowns, q.base)
            refused = (Status.MODEL_MISFIT, message) if message else None
    shares, of_groups = _groups(here, q)
    here = replace(here, refused=refused, profiles=profiles, optima=optima, shares=shares, of_groups=of_groups)
    if refused is not None or not here.attempt.fits:
        return here
    here = replace(here, estimates=_without_late(here, q))
    if count := q.options.bootstrap:
        size = np.sqrt(np.diag(here.allowed.white))
        with no_time_limit():
            made = bootstrap(here.attempt, q.unknowns, size, count, seed=q.seed, progress=q.progress)
        here = replace(here, bootstrap=made)
    return here


def _at(attempt: Attempt, known: Information, q: Question, profiles: Profiles | None = None) -> Certainty:
    """What is known at an answer: from its covariance, and from profiles."""
    solved, unknowns = attempt.solved, q.unknowns
    seen = allowed(attempt, known, q.speed_error, unknowns.values(solved.theta, q.base))
    bounds = at_bounds(unknowns, solved.theta)
    texts = hints(attempt.fitted_logs, solved.trajectories, unknowns, solved.theta)
    ends = {} if profiles is None else {name: (low.end, high.end) for name, (low, high) in profiles.ends.items()}
    found = estimates(unknowns, solved.theta, q.base, seen.covariance, at_bound=bounds, hints=texts, profiles=ends)
    return Certainty(attempt, known, seen, not_determined(found, solved.trajectories, texts), bounds, texts)


def _groups(here: Certainty, q: Question) -> tuple[list[Share], list[tuple[Share, Estimate]]]:
    """Every group's value of every parameter that the scene gives to groups, and the estimates of the groups beyond the
    first, named "D (V08)"."""
    attempt, unknowns, solved = here.attempt, q.unknowns, here.attempt.solved
    layout, free = solved.problem.layout, np.flatnonzero(unknowns.free)
    own, out = kept_parameters(layout)[layout.free.size :].tolist(), list[Share]()
    thetas = [trajectory.theta(solved.theta) for trajectory in solved.trajectories]
    logs = list(zip(layout.places, attempt.fitted_logs, attempt.log_numbers, strict=True))
    for index in np.flatnonzero(unknowns.grouped).tolist():
        seen: set[int] = set()
        for i, (place, log, number) in enumerate(logs):
            unknown = int(place.own[index])
            at = own.index(unknown) if unknown in own else -1
            if at not in seen:
                seen.add(at)
                group = log.data.groups[index] or f"log {number + 1}"
                out.append(Share(index, group, float(thetas[i][index]), at, i))
    beyond = []
    for share in (share for share in out if share.place >= 0):
        order = np.where(free == share.index, free.size + share.place, np.arange(free.size))
        theta = np.where(np.arange(unknowns.free.size) == share.index, share.theta, solved.theta)
        block, bounds = here.allowed.joint[np.ix_(order, order)], at_bounds(unknowns, thetas[share.log])
        made = estimates(unknowns, theta, q.base, block, at_bound=bounds, hints=here.hints, profiles={})[share.index]
        beyond.append((share, replace(made, name=f"{made.name} ({share.group})")))
    return out, beyond


def _poorly_determined(here: Certainty, q: Question) -> bool:
    """Whether the curvature at one point says little about some interval, and there is more than one peak or level."""
    beside = rhythmic(q.unknowns)
    wide = np.sqrt(np.diag(here.covariance)) > POORLY
    open_ = {e.name for e in here.estimates if e.verdict == "not identifiable"}
    names = {name for name, aside in zip(q.unknowns.names, beside, strict=True) if not aside}
    loose = bool(np.any(wide & (q.unknowns.logarithmic & ~beside)[q.unknowns.free])) or bool(open_ & names)
    return loose and onsets(here.attempt.solved.trajectories) > 1


def _profiled(here: Certainty, q: Question) -> list[int]:
    """The parameters whose profile may differ from what the covariance says, but for those of harmonics: all where one
    is poorly determined; else those whose path may be bent, and coefficients whose verdict may depend on that."""
    unknowns = q.unknowns
    free, asked = np.flatnonzero(unknowns.free), ~rhythmic(unknowns)[unknowns.free]
    if q.options.profile or here.bounds or _poorly_determined(here, q):
        return free[asked].tolist()
    if onsets(here.attempt.solved.trajectories) < 2:
        return []
    sd, logarithmic = np.sqrt(np.diag(here.covariance)), unknowns.logarithmic[free]
    bent = asked & logarithmic & (sd > CURVED)
    side = NORMAL * sd / sizes(unknowns, unknowns.values(here.attempt.solved.theta, q.base))[free]
    # A bent path may add what is missing to the longest side of a coefficient that is identified.
    near = asked & ~logarithmic & (side > 0.4 * IDENTIFIED)
    return free[bent | near].tolist() if np.any(bent) else []


def _without_late(here: Certainty, q: Question) -> list[Estimate]:
    """The estimates, without intervals where a profile was due and the time did not suffice for it: also what the
    covariance seems to determine sharply follows a bent path, or belongs to another optimum that was not looked for."""
    names, done = q.unknowns.names, set() if here.profiles is None else set(here.profiles.ends)
    late = {names[i] for i in _profiled(here, q)} - done
    reason = (
        "the time limit left no time for its profile, and the curvature at the answer does not determine its interval"
    )
    return [
        e
        if name not in late or e.verdict in ("fixed", "at bound")
        else replace(e, standard_error=None, lower=None, upper=None, verdict="not profiled", reason=reason)
        for name, e in zip(names, here.estimates, strict=True)
    ]


def _profiles(here: Certainty, q: Question, *, restart: bool, done: Collection[str] = ()) -> Profiles | None:
    """Of the parameters that deserve one and are not done; None where there are none, or the time is up."""
    along = [i for i in _profiled(here, q) if q.unknowns.names[i] not in done]
    if not along or (not q.options.profile and not in_time("profiles")):
        return None
    q.progress("profiles", None)
    white, points = np.sqrt(np.diag(here.allowed.white)), 4 if q.options.profile else 1
    with no_time_limit() if q.options.profile else nullcontext():
        return profile(here.attempt.solved, q.unknowns, white, here.allowed.inflation, along, points, restart)


def _restarted(here: Certainty, profiles: Profiles, q: Question) -> tuple[Certainty, tuple[Status, str] | None]:
    """The answer from a lower point; the one there was where the solver does not converge within the joint region of
    that, or only at a bound; refused where it does not beyond."""
    attempt, unknowns, lower = here.attempt, q.unknowns, profiles.lower
    assert lower is not None
    there = replace(attempt, solved=replace(attempt.solved, trajectories=lower.trajectories))
    start = replace(unknowns, start=lower.theta)
    moved = tried("optimum of a profile", lambda: solve_again(there, start), attempt)
    if moved is None:
        return here, None
    theta = moved.solved.theta
    if profiles.gain < here.region and (not moved.fits or np.any(unknowns.at_own_bounds(theta))):
        return here, None
    if moved.fits:
        return _at(moved, information_at(moved.solved, unknowns), q), None
    values = unknowns.values(lower.theta, q.base)
    where = ", ".join(
        f"{unknowns.names[i]} = {values[i]:.4g} {unknowns.model.parameters[i].unit}".rstrip()
        for i in np.flatnonzero(unknowns.free).tolist()
    )
    remedy = "fix what is known of them, bound it or give it a prior under [parameters], or add a log at another speed"
    message = (
        f"a better place was met: chi^2 falls by {profiles.gain:.3g} below that of the answer found, and the solver "
        f"does not converge there ({moved.gate.solver}); {remedy}; that place: {where}"
    )
    return replace(here, attempt=moved), (Status.BETTER_START_FOUND, message)


def fine_enough(attempt: Attempt, unknowns: Unknowns, options: FitOptions) -> tuple[Attempt, Information]:
    """The answer, converged, with steps so fine that their error is a small part of each standard error."""
    level, known = options.accuracy, information_at(attempt.solved, unknowns)
    if attempt.fits and known.known:
        # The solver stops where going on along a sloppy direction gains next to nothing.
        errors = np.sqrt(np.diag(known.covariance()))
        solved = converged(attempt.solved, attempt.solved.problem, errors)
        if solved is not None and (settled := attempt.with_solved(solved)).fits:
            moved = np.abs(solved.theta - attempt.solved.theta)[unknowns.free] / errors
            attempt = settled
            known = known if np.max(moved, initial=0.0) < 0.05 else information_at(solved, unknowns)
    for _ in range(1 + level.refinements):
        if not attempt.fits or not known.known:
            break
        errors = np.sqrt(np.diag(known.covariance()))
        error = np.nan_to_num(attempt.solved.discretisation_error / errors).tolist()
        finer = 2 * attempt.solved.grid.steps
        if max(map(abs, error), default=0.0) <= level.share or finer > level.most:
            break
        before = attempt

        def refined(before: Attempt = before, steps: int = finer, errors: Array = errors) -> Attempt:
            solved = converged(before.solved, before.solved.problem.with_steps(steps), errors)
            if solved is None:
                return solve_again(before, replace(unknowns, start=before.solved.theta), steps=steps)
            return before.with_solved(solved)

        again = tried(FINER_STEPS, refined, before)
        if again is None or again.gate.status is Status.SOLVER_FAILED:
            break  # no reason to give up the answer: what its steps cost is reported
        attempt, known = again, information_at(again.solved, unknowns)
    return attempt, known


def active_event_bound(solved: Solved, names: Sequence[str]) -> str | None:
    """A sentence where a phase that can get no shorter holds the answer back by more than two standard errors: a rest,
    or a contact that re-ages in mid-slide, may shrink to nothing from pass to pass where at the answer it does not
    happen.

    Args:
        names: of the logs.
    """
    places = zip(solved.problem.layout.places, names, strict=True)
    x = solved.solution.x
    held = [name for place, name in places if goes_as_far_as_it_can(solved.problem, x, place.events).any()]
    if not held:
        return None
    try:  # by how far all pulls together move the answer: nothing, unless something holds it that is no information
        known = influence(solved)
        total, covariance = known.moves.sum(axis=0), known.covariances.sum(axis=0)
        size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        squared = float(total / size @ np.linalg.solve(covariance / np.outer(size, size), total / size))
    except (np.linalg.LinAlgError, RuntimeError):  # directions that no log determines: their verdicts say so
        return None
    if squared < 4.0:
        return None
    return (
        f"{held[0]}: at this answer a phase is as short as it can be, which moves the answer "
        f"by {np.sqrt(squared):.1f} standard errors; leave this log out or end it earlier"
    )
