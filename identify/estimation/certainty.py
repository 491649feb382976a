"""How well an answer is known: finer steps, other optima, profiles, agreement of the logs, intervals, in this order.

Each step asks something of the answer that its covariance cannot say, and is left out where nothing depends on it or
the time is up: the intervals are then those known so far, at least the ones of the covariance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import no_time_limit, time_is_up
from identify.base.outcome import Status
from identify.base.progress import Progress
from identify.base.quantiles import LEVEL, NORMAL, chi_square
from identify.estimation.attempt import Attempt, solve_again
from identify.estimation.bootstrap import Bootstrap, bootstrap
from identify.estimation.covariance import (
    IDENTIFIED,
    Estimate,
    Information,
    estimates,
    information_at,
    sizes,
    widened,
)
from identify.estimation.fit_wording import at_bounds, hints, not_determined, onsets
from identify.estimation.influence import Allowed, allowed, contradiction, imbalance, influence
from identify.estimation.multistart import OTHER_OPTIMA, Optimum, multistart
from identify.estimation.profile import CRITICAL, Profiles, converged, profile
from identify.estimation.strategies import FINER_STEPS, in_time, no_time_for, tried
from identify.logs.unknowns import Unknowns
from identify.logs.vibration import rhythmic
from identify.shooting.accuracy import AccuracyRow, FitOptions, accuracy_table
from identify.shooting.layout import kept_parameters
from identify.shooting.passes import Solved, goes_as_far_as_it_can

Array = NDArray[np.float64]

POORLY = 0.13  # standard error of a logarithm: an interval of a quarter each way, of which one curvature says little
CURVED = 0.012  # standard error of a logarithm beyond which the others may follow it on a bent path
NEARLY = 0.4  # of the longest side of a coefficient that is identified: a bent path may add what is missing
CURVE_POINTS = 4  # of each side of a profile that is drawn
AS_IT_WAS = 0.05  # standard errors by which an answer moves that leave its covariance as it was
HELD = 4.0  # squared distance from which on an active event bound holds an answer: two standard errors


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
    allowed: covariances for white noise and with all that is allowed for; the noise of each log.
    joint: (f + o, f + o) covariance with the parameters of single groups, wide enough for the likely points of profiles
        and optima.
    estimates: values, standard errors, intervals and verdicts.
    bounds, hints: sentences, by parameter, on those at a bound and on what would determine them.
    refused: status and sentence where it is no answer after all, though it fits.
    profiles, bootstrap, accuracy_table: None where not run.
    optima: those that were found, the answer first; empty where none were sought.
    discretisation: error of the integration steps by parameter, in standard errors.
    shares: groups with parameters of their own; of_groups: the estimates beyond the first group's.
    """

    attempt: Attempt
    information: Information
    allowed: Allowed
    joint: Array
    estimates: list[Estimate]
    bounds: Mapping[str, str]
    hints: Mapping[str, str]
    refused: tuple[Status, str] | None = None
    profiles: Profiles | None = None
    bootstrap: Bootstrap | None = None
    accuracy_table: list[AccuracyRow] | None = None
    optima: Sequence[Optimum] = ()
    discretisation: Mapping[str, float] = field(default_factory=dict)
    shares: list[Share] = field(default_factory=list)
    of_groups: list[tuple[Share, Estimate]] = field(default_factory=list)

    @property
    def covariance(self) -> Array:
        """Covariance (f, f) with all that is allowed for."""
        return self.joint[: len(self.allowed.white), : len(self.allowed.white)]

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
    attempt, known, discretisation = fine_enough(attempt, q.unknowns, q.options)
    if not known.known:
        return None
    optima, profiles, refused = list[Optimum](), None, None
    here = _at(attempt, known, q)
    if attempt.fits:
        refused = _held_by_event(here)
        if refused is None and _poorly_determined(here, q) and in_time(OTHER_OPTIMA):
            q.progress("looking for other optima", None)
            optima = multistart(attempt, q.unknowns, q.seed, here.covariance)
            if optima[0].attempt is not attempt:
                attempt = optima[0].attempt
                here = _at(attempt, information_at(attempt.solved, q.unknowns), q)
                refused = _held_by_event(here)
        if refused is None and (along := _profiled(here, q)):
            here, profiles, refused = _with_profiles(here, along, optima, q)
        if refused is None and not here.bounds:  # at a bound the scores do not cancel
            refused = _held_by_event(here)
            if refused is None and len(here.attempt.log_numbers) > 1:
                message = contradiction(here.attempt, q.unknowns, q.base, here.allowed.noise)
                refused = (Status.MODEL_MISFIT, message) if message else None
    shares, of_groups = _groups(here, q)
    judged = _without_late(here, profiles, q) if refused is None and here.attempt.fits else here.estimates
    out = replace(here, refused=refused, profiles=profiles, optima=optima, estimates=judged)
    out = replace(out, discretisation=discretisation, shares=shares, of_groups=of_groups)
    if refused is not None or not out.attempt.fits:
        return out
    with no_time_limit():
        if q.options.bootstrap:
            size, count = np.sqrt(np.diag(out.allowed.white)), q.options.bootstrap
            made = bootstrap(out.attempt, q.unknowns, out.allowed.noise, size, count, seed=q.seed, progress=q.progress)
            out = replace(out, bootstrap=made)
        if q.options.accuracy_table:
            q.progress("table of accuracies", None)
            logs, size = here.attempt.fitted_logs, np.sqrt(np.diag(out.covariance))
            out = replace(out, accuracy_table=accuracy_table(logs, here.attempt.solved, q.unknowns, size))
    return out


def _at(
    attempt: Attempt, known: Information, q: Question, profiles: Profiles | None = None, optima: Sequence[Optimum] = ()
) -> Certainty:
    """What is known at an answer: from its covariance, profiles, and the other optima that the data do not rule out."""
    solved, unknowns = attempt.solved, q.unknowns
    theta, free = solved.theta, unknowns.free
    seen = allowed(attempt, known, q.speed_error, unknowns.values(theta, q.base))
    bounds = at_bounds(unknowns, theta)
    texts = {n: str(hint) for n, hint in hints(attempt.fitted_logs, solved.trajectories, unknowns, theta).items()}
    out = Certainty(attempt, known, seen, seen.joint.copy(), [], bounds, texts)
    intervals = {} if profiles is None else {n: (low.end, high.end) for n, (low, high) in profiles.ends.items()}
    largest, likely, limits = float(np.max(seen.inflation, initial=1.0)), list[Array](), list[float]()
    if profiles is not None and profiles.likely.size:
        likely += list(profiles.likely)
        limits += (profiles.ratios / largest).tolist()
    for other in out.within(optima):
        likely.append((other.attempt.solved.theta - theta)[free])
        limits.append(2.0 * (other.cost - solved.solution.cost) / largest)
    if likely:
        f = len(seen.white)
        out.joint[:f, :f] = widened(seen.covariance, np.array(likely), np.maximum(limits, CRITICAL))
    found = estimates(unknowns, theta, q.base, out.covariance, at_bound=bounds, hints=texts, profiles=intervals)
    return replace(out, estimates=not_determined(found, solved.trajectories, texts))


def _groups(here: Certainty, q: Question) -> tuple[list[Share], list[tuple[Share, Estimate]]]:
    """Every group's value of every parameter that the scene gives to groups; and the estimates of the groups beyond
    the first, named "D (V08)"."""
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
        block, bounds = here.joint[np.ix_(order, order)], at_bounds(unknowns, thetas[share.log])
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
    near = asked & ~logarithmic & (side > NEARLY * IDENTIFIED)
    return free[bent | near].tolist() if np.any(bent) else []


def _with_profiles(
    here: Certainty, along: list[int], optima: list[Optimum], q: Question
) -> tuple[Certainty, Profiles | None, tuple[Status, str] | None]:
    """With profiles; where these meet a lower point, the fit starts again from there, once. An interval holds the other
    optima that the data do not rule out."""
    profiles = _profiles(here, along, q, restart=True)
    if profiles is not None and profiles.lower is not None:
        here, refused = _restarted(here, profiles, q)
        if refused is not None:
            return here, None, refused
        profiles = _profiles(here, along, q, restart=False)
    if profiles is not None:
        halves = np.zeros(q.unknowns.free.size)
        halves[q.unknowns.free] = NORMAL * np.sqrt(np.diag(here.allowed.covariance))
        for other in here.within(optima):
            profiles = profiles.with_optimum(q.unknowns, other.attempt.solved.theta, halves)
    return _at(here.attempt, here.information, q, profiles, optima), profiles, None


def _without_late(here: Certainty, profiles: Profiles | None, q: Question) -> list[Estimate]:
    """The estimates, without intervals where a profile was due and the time did not suffice for it. The covariance of
    what it identifies stays: so far a profile agrees with it, and beyond, it bends away; where some parameter is poorly
    determined the others follow that on a bent path, and only that of what is known sharply does."""
    names, done = q.unknowns.names, set() if profiles is None else set(profiles.ends)
    late = {names[i] for i in _profiled(here, q)} - done
    known = sizes(q.unknowns, q.unknowns.values(here.attempt.solved.theta, q.base))
    known = (CURVED if _poorly_determined(here, q) else POORLY) * known
    reason = (
        "the time limit left no time for its profile, and the curvature at the answer does not determine its interval"
    )

    def stays(e: Estimate, i: int) -> bool:
        sharp = e.verdict == "identified" and e.standard_error is not None and e.standard_error < known[i]
        return names[i] not in late or e.verdict in ("fixed", "at bound") or sharp

    return [
        e
        if stays(e, i)
        else replace(e, standard_error=None, lower=None, upper=None, verdict="not profiled", reason=reason)
        for i, e in enumerate(here.estimates)
    ]


def _profiles(here: Certainty, along: list[int], q: Question, *, restart: bool) -> Profiles | None:
    if time_is_up() and not q.options.profile:
        no_time_for("profiles")
        return None
    q.progress("profiles", None)
    attempt, white = here.attempt, np.sqrt(np.diag(here.allowed.white))
    with no_time_limit() if q.options.profile else nullcontext():
        points = CURVE_POINTS if q.options.profile else 1
        return profile(attempt.solved, q.unknowns, white, here.allowed.inflation, along, points, restart)


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


def fine_enough(
    attempt: Attempt, unknowns: Unknowns, options: FitOptions
) -> tuple[Attempt, Information, dict[str, float]]:
    """The answer, converged, with steps so fine that their error is a small part of each standard error, and that part
    by name."""
    level, known = options.accuracy, information_at(attempt.solved, unknowns)
    if attempt.fits and known.known:
        # The solver stops where going on along a sloppy direction gains next to nothing.
        errors = np.sqrt(np.diag(known.covariance()))
        solved = converged(attempt.solved, attempt.solved.problem, errors)
        if solved is not None and (settled := attempt.with_solved(solved)).fits:
            moved = np.abs(solved.theta - attempt.solved.theta)[unknowns.free] / errors
            attempt = settled
            known = known if np.max(moved, initial=0.0) < AS_IT_WAS else information_at(solved, unknowns)
    shares: dict[str, float] = {}
    for _ in range(1 + level.refinements):
        if not attempt.fits or not known.known:
            break
        errors = np.sqrt(np.diag(known.covariance()))
        free = np.flatnonzero(unknowns.free).tolist()
        error = np.nan_to_num(attempt.solved.discretisation_error / errors).tolist()
        shares = {unknowns.names[i]: share for i, share in zip(free, error, strict=True)}
        finer = 2 * attempt.solved.grid.steps
        if max(map(abs, error), default=0.0) <= level.share or finer > level.most:
            break
        before = attempt

        def refined(before: Attempt = before, steps: int = finer, errors: Array = errors) -> Attempt:
            solved = converged(before.solved, before.solved.problem.with_steps(steps), errors)
            if solved is None:
                return solve_again(before, replace(unknowns, start=before.solved.theta), steps=steps)
            return before.with_solved(replace(solved, grid=replace(before.solved.grid, steps=steps)))

        again = tried(FINER_STEPS, refined, before)
        if again is None or again.gate.status is Status.SOLVER_FAILED:
            break  # no reason to give up the answer: what its steps cost is told
        attempt, known = again, information_at(again.solved, unknowns)
    return attempt, known, shares


def _held_by_event(here: Certainty) -> tuple[Status, str] | None:
    """Status and sentence where an answer is held by a phase that can get no shorter. At a bound of a parameter nothing
    is known of that: the scores do not cancel."""
    message = None if here.bounds else active_event_bound(here.attempt.solved, here.attempt.names)
    return None if message is None else (Status.WRONG_EVENT_COUNT, message)


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
    try:
        squared = imbalance(influence(solved)) if held else 0.0
    except (np.linalg.LinAlgError, RuntimeError):  # directions that no log determines: their verdicts say so
        return None
    if squared < HELD:
        return None
    return (
        f"{held[0]}: at this answer a phase is as short as it can be, which moves the answer "
        f"by {np.sqrt(squared):.1f} standard errors; leave this log out or end it earlier"
    )
