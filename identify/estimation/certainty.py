"""How well an answer is known: finer steps, other optima, profiles, agreement of the logs, intervals, in this order.

Each step asks something of the answer that its covariance cannot say, and is left out where nothing hangs on it or the
time is up: the intervals are then those known so far, at least the ones of the covariance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import no_time_limit, time_is_up
from identify.base.outcome import Status
from identify.base.progress import Progress
from identify.base.quantiles import LEVEL, NORMAL, chi_square
from identify.estimation.agreement import Allowed, agreeing, allowed, imbalance, influence_at
from identify.estimation.attempt import Attempt, gated, placed_anew, solve_again
from identify.estimation.bootstrap import Bootstrap, bootstrap
from identify.estimation.combinations import (
    Combination,
    Direction,
    Share,
    combinations,
    directions,
    share_estimates,
    shares,
)
from identify.estimation.covariance import (
    IDENTIFIED,
    Estimate,
    Information,
    Interval,
    estimates,
    information,
    sizes,
    widened,
)
from identify.estimation.goodness_of_fit import Gate
from identify.estimation.hints import hints, onsets, untold
from identify.estimation.influence import influence
from identify.estimation.multistart import Optimum, multistart, weakens
from identify.estimation.profile import CRITICAL, Profiles, converged, profile
from identify.estimation.residual_autocorrelation import Colour
from identify.estimation.status_words import at_bounds
from identify.estimation.strategies import Strategy, may_run, no_time_for, run_strategy
from identify.logs.unknowns import Unknowns
from identify.logs.vibration import rhythmic
from identify.shooting.accuracy import AccuracyRow, FitOptions, accuracy_table
from identify.shooting.passes import Solved, goes_as_far_as_it_can
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

POORLY = 0.13  # standard error of a logarithm: an interval of a quarter each way, of which one curvature says little
CURVED = 0.012  # standard error of a logarithm beyond which the others may follow it on a bent path
NEARLY = 0.4  # of the longest side of a coefficient that is identified: a bent path may add what is missing
CURVE_POINTS = 4  # of each side of a profile that is drawn
AS_IT_WAS = 0.05  # standard errors by which an answer moves that leave its covariance as it was
HELD = 4.0  # squared distance from which on an active event bound holds an answer: two standard errors


@dataclass(frozen=True)
class Certainty:
    """What is known of the free parameters (f,) at an answer.

    Attributes
    ----------
    attempt: the answer, in a lower optimum where one was met.
    information: of all parameters.
    covariance, white: (f, f) of theta, with all that is allowed for, and for white noise.
    colours: noise of each log.
    estimates: values, standard errors, intervals and verdicts.
    profiles, bootstrap, accuracy_table: None where not run.
    optima: those that were found, the answer first; empty where none were sought.
    discretisation: error of the integration steps by parameter, in standard errors.
    memory: (f,) by how much all that is allowed for beside white noise widens each variance.
    joint: (f + o, f + o) covariance with the parameters of single groups; shares: these groups; of_groups: the
        estimates beyond the first group's.
    combinations, directions: of the covariance.
    """

    attempt: Attempt
    information: Information
    covariance: Array
    white: Array
    colours: list[Colour]
    estimates: list[Estimate]
    profiles: Profiles | None
    bootstrap: Bootstrap | None = None
    accuracy_table: list[AccuracyRow] | None = None
    optima: Sequence[Optimum] = ()
    discretisation: Mapping[str, float] = field(default_factory=dict)
    memory: Array = field(default_factory=lambda: np.empty(0))
    joint: Array = field(default_factory=lambda: np.empty((0, 0)))
    shares: list[Share] = field(default_factory=list)
    of_groups: list[tuple[Share, Estimate]] = field(default_factory=list)
    combinations: list[Combination] = field(default_factory=list)
    directions: list[Direction] = field(default_factory=list)


@dataclass(frozen=True)
class _Question:
    """Of what, and under which options, certainty is asked; see `certainty`."""

    unknowns: Unknowns
    base: Array
    options: FitOptions
    speed_tolerance: float
    seed: int
    progress: Progress


@dataclass(frozen=True)
class _Uncertainty:
    """An answer and what is known there.

    known: information; bounds: sentences on parameters at a bound; hints: by parameter; seen: covariances with what is
    allowed for; joint: that of all parameters, wide enough for the likely points of profiles and optima; estimates.
    """

    attempt: Attempt
    known: Information
    bounds: Mapping[str, str]
    hints: Mapping[str, str]
    seen: Allowed
    joint: Array
    estimates: list[Estimate]

    @property
    def accepted(self) -> bool:
        """Whether the answer still is one."""
        return self.attempt.gate.status is Status.CONVERGED

    @property
    def covariance(self) -> Array:
        """Of the free theta (f, f)."""
        return self.joint[: len(self.seen.white), : len(self.seen.white)]


def certainty(
    attempt: Attempt,
    unknowns: Unknowns,
    base: Array,
    asked: FitOptions,
    *,
    speed_tolerance: float,
    seed: int,
    progress: Progress,
) -> Certainty | None:
    """All that is said of how sure an answer is; None where the model has no derivatives there.

    Args:
        base: (n_p,) of the rig the values are given for; speed_tolerance: relative error of all drive speeds together;
            seed: of the starts about the answer and of the bootstrap.
    """
    attempt, known, discretisation = fine_enough(attempt, unknowns, asked)
    if not np.all(np.isfinite(known.total)):
        return None
    q = _Question(unknowns, base, asked, speed_tolerance, seed, progress)
    here, optima, profiles = _unless_event_bound(_at(attempt, known, q)), list[Optimum](), None
    if here.accepted and _poorly_determined(here, q):
        optima = _optima(here, q)
        if optima and optima[0].attempt is not here.attempt:
            here = _unless_event_bound(_moved(optima[0].attempt, q))
    if here.accepted and (along := _profiled(here, q)):
        here, profiles = _with_profiles(here, along, optima, q)
    here = _unless_event_bound(here)
    if here.accepted and not here.bounds and len(here.attempt.log_numbers) > 1:  # at a bound the scores do not cancel
        here = replace(here, attempt=agreeing(here.attempt, unknowns, base, here.seen))
    out = _summary(here, optima, profiles, discretisation, q)
    if not here.accepted:
        return out
    with no_time_limit():
        out = _resampled(out, asked, seed, progress) if asked.bootstrap else out
        return _tabled(out, unknowns, progress) if asked.accuracy_table else out


def _summary(
    here: _Uncertainty,
    optima: list[Optimum],
    profiles: Profiles | None,
    discretisation: Mapping[str, float],
    q: _Question,
) -> Certainty:
    """With the estimates of groups, and what combinations of parameters are known to."""
    attempt, unknowns = here.attempt, q.unknowns
    theta, groups = attempt.solved.theta, shares(attempt, unknowns)
    bounds = {s.log: at_bounds(unknowns, attempt.solved.trajectories[s.log].theta(theta)) for s in groups}
    free = np.flatnonzero(unknowns.free).tolist()
    names, logs = [unknowns.names[i] for i in free], [bool(unknowns.logarithmic[i]) for i in free]
    values = dict(zip(unknowns.names, unknowns.values(theta, q.base).tolist(), strict=True))
    return Certainty(
        attempt=attempt,
        information=here.known,
        covariance=here.covariance,
        white=here.seen.white,
        colours=here.seen.colours,
        estimates=here.estimates,
        profiles=profiles,
        optima=optima,
        discretisation=discretisation,
        memory=here.seen.memory,
        joint=here.joint,
        shares=groups,
        of_groups=share_estimates(groups, unknowns, theta, q.base, here.joint, at_bound=bounds, hints=here.hints),
        combinations=combinations(names, logs, values, here.covariance) if here.accepted else [],
        directions=directions(names, logs, values, here.covariance) if here.accepted else [],
    )


def _at(
    attempt: Attempt, known: Information, q: _Question, profiles: Profiles | None = None, optima: Sequence[Optimum] = ()
) -> _Uncertainty:
    """What is known at an answer: from its covariance, profiles, and the other optima that the data do not rule out."""
    solved, unknowns = attempt.solved, q.unknowns
    theta, free = solved.theta, unknowns.free
    seen = allowed(attempt, known, q.speed_tolerance)
    f, joint = len(seen.white), seen.joint.copy()
    intervals = {} if profiles is None else {n: Interval(*(s.end for s in ends)) for n, ends in profiles.ends.items()}
    largest = float(np.max(seen.memory, initial=1.0))
    likely, limits = list[Array](), list[float]()
    if profiles is not None and profiles.likely.size:
        likely += list(profiles.likely + (profiles.best - theta)[free])
        limits += (profiles.ratios / largest).tolist()
    for other in _within(attempt, optima, largest * chi_square(LEVEL, f)):
        likely.append((other.attempt.solved.theta - theta)[free])
        limits.append(2.0 * (other.cost - solved.solution.cost) / largest)
    if likely:
        joint[:f, :f] = widened(seen.covariance, np.array(likely), np.maximum(limits, CRITICAL))
    bounds = at_bounds(unknowns, theta)
    told = {n: str(hint) for n, hint in hints(attempt.fitted_logs, solved.trajectories, unknowns, theta).items()}
    found = estimates(unknowns, theta, q.base, joint[:f, :f], at_bound=bounds, hints=told, profiles=intervals)
    return _Uncertainty(attempt, known, bounds, told, seen, joint, untold(found, solved.trajectories, told))


def _moved(attempt: Attempt, q: _Question) -> _Uncertainty:
    return _at(attempt, information_at(attempt, q.unknowns), q)


def _within(attempt: Attempt, optima: Sequence[Optimum], ratio: float) -> list[Optimum]:
    """The optima beside an answer whose likelihood ratio is below a limit."""
    cost = attempt.solved.solution.cost
    return [o for o in optima if o.attempt is not attempt and 2.0 * (o.cost - cost) < ratio]


# ----------------------------------------------------------------------------------------------------------------------
# What is worth asking.
# ----------------------------------------------------------------------------------------------------------------------


def _poorly_determined(here: _Uncertainty, q: _Question) -> bool:
    """Whether the curvature at one point says little about some interval, and there is more than one peak or level."""
    beside = rhythmic(q.unknowns)
    wide = np.sqrt(np.diag(here.covariance)) > POORLY
    open_ = {e.name for e in here.estimates if e.verdict == "not identifiable"}
    names = {name for name, aside in zip(q.unknowns.names, beside, strict=True) if not aside}
    loose = bool(np.any(wide & (q.unknowns.logarithmic & ~beside)[q.unknowns.free])) or bool(open_ & names)
    return loose and onsets(here.attempt.solved.trajectories) > 1


def _profiled(here: _Uncertainty, q: _Question) -> list[int]:
    """The parameters whose profile may differ from what the covariance says, but for those of harmonics: all where one
    is poorly determined; else those whose path may be bent, and coefficients whose verdict may hang on that."""
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


def _optima(here: _Uncertainty, q: _Question) -> list[Optimum]:
    """The optima about an answer; none where they are not sought."""
    if not may_run(Strategy.OTHER_OPTIMA):
        return []
    q.progress("looking for other optima", None)
    return multistart(here.attempt, q.unknowns, q.seed, here.covariance)


def _with_profiles(
    here: _Uncertainty, along: list[int], optima: list[Optimum], q: _Question
) -> tuple[_Uncertainty, Profiles | None]:
    """With profiles; where these meet a lower point, the fit starts again from there, once. An interval holds those of
    the other optima that the data do not rule out."""
    profiles = _profiles(here, along, q, restart=True)
    if profiles is not None and profiles.lower is not None:
        here = _restarted(here, profiles, q)
        if not here.accepted:
            return here, None
        profiles = _profiles(here, along, q, restart=False)
    if profiles is not None:
        region = chi_square(LEVEL, len(here.seen.white)) * float(np.max(here.seen.memory))
        for other in _within(here.attempt, optima, region):
            outside = profiles.outside(q.unknowns, other.attempt.solved.theta)
            about = _profiles(_moved(other.attempt, q), outside, q, restart=False) if outside else None
            profiles = profiles if about is None else profiles.joined(about)
    return _at(here.attempt, here.known, q, profiles, optima), profiles


def _profiles(here: _Uncertainty, along: list[int], q: _Question, *, restart: bool) -> Profiles | None:
    if time_is_up() and not q.options.profile:
        no_time_for("profiles")
        return None
    with no_time_limit() if q.options.profile else nullcontext():
        return profile(
            here.attempt.fitted_logs,
            here.attempt.solved,
            q.unknowns,
            np.sqrt(np.diag(here.seen.white)),
            here.seen.memory,
            only=along,
            points=CURVE_POINTS if q.options.profile else 1,
            restart=restart,
            progress=q.progress,
        )


def _restarted(here: _Uncertainty, profiles: Profiles, q: _Question) -> _Uncertainty:
    """The answer from a lower point; the one there was where the solver does not converge within the joint region of
    that, or only at a bound, or among contacts that weaken at rest; refused where it does not beyond."""
    attempt, unknowns, lower = here.attempt, q.unknowns, profiles.lower
    assert lower is not None

    def solved() -> Attempt:
        there = replace(attempt, solved=replace(attempt.solved, trajectories=lower.trajectories))
        moved = solve_again(there, replace(unknowns, start=lower.theta))
        fits = moved.gate.status is Status.CONVERGED
        return moved if fits else placed_anew(attempt, unknowns, lower.theta) or moved

    moved = run_strategy(Strategy.PROFILE_OPTIMUM, solved, attempt, attempt.log_numbers)
    if moved is None:
        return here
    converged, theta = moved.gate.status is Status.CONVERGED, moved.solved.theta
    region = chi_square(LEVEL, len(here.seen.white)) * float(np.max(here.seen.memory))
    if profiles.gain < region:
        lost = not converged or bool(np.any(unknowns.at_own_bounds(theta)))
        if lost or (weakens(unknowns, theta) and not weakens(unknowns, attempt.solved.theta)):
            return here
    if not converged:
        return replace(here, attempt=replace(moved, gate=_lower_start(moved, profiles, q)))
    return _moved(moved, q)


def _lower_start(moved: Attempt, profiles: Profiles, q: _Question) -> Gate:
    """The tests of an answer that a profile found a lower point than, at which the solver does not converge."""
    assert profiles.lower is not None
    unknowns, values = q.unknowns, q.unknowns.values(profiles.lower.theta, q.base)
    where = ", ".join(
        f"{unknowns.names[i]} = {values[i]:.4g} {unknowns.model.parameters[i].unit}".rstrip()
        for i in np.flatnonzero(unknowns.free).tolist()
    )
    remedy = "fix what is known of them, or give it a prior, under [parameters], or add a log that determines it"
    if weakens(unknowns, profiles.lower.theta):  # no start can say that
        remedy = (
            "contacts weaken there while they rest (mu_k0 above mu_s); bound mu_k0 from above by what is known of it "
            "under [parameters], or add a log at another speed"
        )
    message = (
        f"a better place was met: chi^2 falls by {profiles.gain:.3g} below that of the answer found, and the solver "
        f"does not converge there ({moved.gate.solver}); {remedy}; that place: {where}"
    )
    return replace(moved.gate, status=Status.BETTER_START_FOUND, message=message)


# ----------------------------------------------------------------------------------------------------------------------
# Steps of the integration so fine that their error is a small part of each standard error.
# ----------------------------------------------------------------------------------------------------------------------


def fine_enough(
    attempt: Attempt, unknowns: Unknowns, asked: FitOptions
) -> tuple[Attempt, Information, dict[str, float]]:
    """The answer, converged, with steps so fine that their error is a small part of each standard error, and that part
    by name."""
    level = asked.accuracy
    known = information_at(attempt, unknowns)
    if attempt.gate.status is Status.CONVERGED and np.all(np.isfinite(known.total)):
        # The solver stops where going on along a sloppy direction gains next to nothing.
        errors = np.sqrt(np.diag(known.covariance()))
        solved = converged(attempt.solved, attempt.solved.problem, errors)
        if solved is not None and (gate := gated(solved, attempt.fitted_logs)).status is Status.CONVERGED:
            moved = np.abs(solved.theta - attempt.solved.theta)[unknowns.free] / errors
            attempt = replace(attempt, solved=solved, gate=gate)
            known = known if np.max(moved, initial=0.0) < AS_IT_WAS else information_at(attempt, unknowns)
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
        errors = np.sqrt(np.diag(known.covariance()))
        again = run_strategy(Strategy.FINER_STEPS, partial(_finer, attempt, unknowns, finer, errors), attempt)
        if again is None or again.gate.status is Status.SOLVER_FAILED:
            break  # no reason to give up the answer: what its steps cost is told
        attempt, known = again, information_at(again, unknowns)
    return attempt, known, shares


def _finer(attempt: Attempt, unknowns: Unknowns, steps: int, sizes: Array) -> Attempt:
    """The answer with so many steps per interval, twice as many as before: by Newton's method, else by a new solve.

    Args:
        sizes: (f,) standard errors of the free parameters.
    """
    solved = attempt.solved
    finer = converged(solved, solved.problem.with_steps(steps), sizes)
    if finer is None:
        return solve_again(attempt, replace(unknowns, start=solved.theta), steps=steps)
    finer = replace(finer, grid=replace(solved.grid, steps=steps))
    return replace(attempt, solved=finer, gate=gated(finer, attempt.fitted_logs))


def information_at(attempt: Attempt, unknowns: Unknowns) -> Information:
    """The information of the data on all parameters, those held fixed too, at the answer."""
    solved = attempt.solved
    at_answer = replace(unknowns, start=solved.theta)
    return information(*solved.problem.with_all_parameters(at_answer, solved.solution.z))


# ----------------------------------------------------------------------------------------------------------------------
# An answer at which a phase shrinks to nothing.
# ----------------------------------------------------------------------------------------------------------------------


def _unless_event_bound(here: _Uncertainty) -> _Uncertainty:
    """The answer, refused where it is held by a phase that can get no shorter. At a bound of a parameter nothing is
    known of that: the scores do not cancel."""
    if not here.accepted or here.bounds:
        return here
    message = active_event_bound(here.attempt.solved, [log.name for log in here.attempt.fitted_logs])
    if message is None:
        return here
    gate = replace(here.attempt.gate, status=Status.WRONG_EVENT_COUNT, message=message)
    return replace(here, attempt=replace(here.attempt, gate=gate))


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


# ----------------------------------------------------------------------------------------------------------------------
# What is asked for beside intervals.
# ----------------------------------------------------------------------------------------------------------------------


def _resampled(out: Certainty, asked: FitOptions, seed: int, progress: Progress) -> Certainty:
    """With a bootstrap of cycle blocks."""
    progress("bootstrap", None)
    solved = out.attempt.solved
    cycles = [trajectory.parts for trajectory in solved.trajectories]
    known, z = influence(solved.problem, solved.solution.z, cycles), solved.solution.z
    made = bootstrap(solved.problem, z, known, asked.bootstrap, seed=seed, progress=progress)
    return replace(out, bootstrap=made)


def _tabled(out: Certainty, unknowns: Unknowns, progress: Progress) -> Certainty:
    """With what each accuracy costs and moves."""
    progress("table of accuracies", None)
    size = np.sqrt(np.diag(out.covariance))
    table = accuracy_table(out.attempt.fitted_logs, out.attempt.solved, unknowns, size)
    return replace(out, accuracy_table=table)
