"""How sure an accepted answer is: its steps, covariance for the noise there is, profiles, bootstrap, intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import no_time_limit
from identify.base.outcome import Status
from identify.base.progress import Progress
from identify.estimation.agreement import agreeing, imbalance, influence_at
from identify.estimation.attempt import Attempt
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
from identify.estimation.covariance import Estimate, Information
from identify.estimation.examined import AtBound, Question, examine, fine_enough
from identify.estimation.influence import influence
from identify.estimation.profile import Profiles
from identify.estimation.residual_autocorrelation import Colour
from identify.logs.log_data import ShootingTrajectory
from identify.logs.unknowns import Unknowns
from identify.shooting.accuracy import AccuracyRow, FitOptions, accuracy_table
from identify.shooting.passes import Solved, goes_as_far_as_it_can

Array = NDArray[np.float64]

HELD = 4.0  # squared distance from which on an answer hangs on what is no data: two standard errors


@dataclass(frozen=True)
class Certainty:
    """What is known of the free parameters (f,) at an answer.

    attempt: the answer, in a better optimum where a profile met one; information of all parameters; covariance (f, f)
    of theta with all that is allowed for, `white` (f, f) without the memory of the noise; colours: of the noise of
    each log; estimates; profiles, bootstrap, accuracy_table: None where not run; discretisation by name, in standard
    errors; memory (f,) by how much the memory of the noise (and the error of the drive speed) widens each variance;
    joint (f + o, f + o) covariance with the parameters of single groups, shares: these groups, of_groups: the
    estimates beyond the first group's; combinations and directions: of the covariance.
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
    discretisation: Mapping[str, float] = field(default_factory=dict)
    memory: Array = field(default_factory=lambda: np.empty(0))
    joint: Array = field(default_factory=lambda: np.empty((0, 0)))
    shares: list[Share] = field(default_factory=list)
    of_groups: list[tuple[Share, Estimate]] = field(default_factory=list)
    combinations: list[Combination] = field(default_factory=list)
    directions: list[Direction] = field(default_factory=list)


def certainty(
    attempt: Attempt,
    unknowns: Unknowns,
    base: Array,
    asked: FitOptions,
    at_bound: AtBound,
    *,
    speed_tolerance: float,
    seed: int,
    progress: Progress,
) -> Certainty | None:
    """All that is said of how sure an answer is; None where the model has no derivatives there.

    Args:
        base: (n_p,) of the rig the values are given for; at_bound: sentence per parameter that sits at a bound, from
            theta; speed_tolerance: relative error of all drive speeds together.
    """
    attempt, known, discretised = fine_enough(attempt, unknowns, asked)
    if not np.all(np.isfinite(known.total)):
        return None
    seen = examine(attempt, known, Question(unknowns, base, asked, at_bound, speed_tolerance, seed, progress))
    attempt, view = seen.attempt, seen.view
    if seen.unfinished:
        attempt = unexamined(attempt)
    elif seen.accepted and not view.bounds:  # at a bound the pulls of the logs do not cancel
        held = hanging(attempt.solved, [log.name for log in attempt.prepared])
        if held is not None:
            attempt = replace(attempt, gate=replace(attempt.gate, status=Status.WRONG_EVENT_COUNT, message=held))
        elif len(attempt.logs) > 1:
            attempt = agreeing(attempt, unknowns, base, view.allowed)
    theta, groups = attempt.solved.theta, shares(attempt, unknowns)
    bounds_of = {s.log: at_bound(attempt.solved.trajectories[s.log].theta(theta)) for s in groups}
    of_groups = share_estimates(groups, unknowns, theta, base, view.joint, at_bound=bounds_of, hints=view.hints)
    out = Certainty(
        attempt,
        seen.known,
        view.covariance,
        view.allowed.white,
        view.allowed.colours,
        view.found,
        seen.walked,
        discretisation=discretised,
        memory=view.allowed.memory,
        joint=view.joint,
        shares=groups,
        of_groups=of_groups,
    )
    if attempt.gate.status is not Status.CONVERGED:
        return out
    out = _combined(out, unknowns, base)
    with no_time_limit():
        out = _resampled(out, asked, seed, progress) if asked.bootstrap else out
        return _tabled(out, unknowns, progress) if asked.accuracy_table else out


def unexamined(attempt: Attempt) -> Attempt:
    """An answer that fits, and that there was no time to examine as far as it calls for: it is none to rely on."""
    gate = attempt.gate
    message = (
        f"an answer fits ({gate.message}), but the time limit ended the look at whether other values, or another "
        "cause, describe the logs as well; give more time"
    )
    return replace(attempt, gate=replace(gate, status=Status.SOLVER_FAILED, message=message))


def _combined(out: Certainty, unknowns: Unknowns, base: Array) -> Certainty:
    """With the combinations of parameters that the data tell better than their parts."""
    free = np.flatnonzero(unknowns.free).tolist()
    names, logs = [unknowns.names[i] for i in free], [bool(unknowns.logarithmic[i]) for i in free]
    values = dict(zip(unknowns.names, unknowns.values(out.attempt.solved.theta, base).tolist(), strict=True))
    return replace(
        out,
        combinations=combinations(names, logs, values, out.covariance),
        directions=directions(names, logs, values, out.covariance),
    )


def _resampled(out: Certainty, asked: FitOptions, seed: int, progress: Progress) -> Certainty:
    """With a bootstrap of cycle blocks."""
    progress("bootstrap", None)
    solved = out.attempt.solved
    cycles = [trajectory.parts for trajectory in solved.trajectories]
    known, z = influence(solved.problem, solved.solution.z, cycles), solved.solution.z
    made = bootstrap(solved.problem, z, known, asked.bootstrap, cycles=cycles, seed=seed, progress=progress)
    return replace(out, bootstrap=made)


def _tabled(out: Certainty, unknowns: Unknowns, progress: Progress) -> Certainty:
    """With what each accuracy costs and moves."""
    progress("table of accuracies", None)
    size = np.sqrt(np.diag(out.covariance))
    table = accuracy_table(out.attempt.prepared, out.attempt.solved, unknowns, size)
    return replace(out, accuracy_table=table)


def hanging(solved: Solved, names: Sequence[str]) -> str | None:
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
    if trajectory.times.size < 2:
        return float(trajectory.times[0]), float(trajectory.times[0])
    first = int(np.argmin(np.diff(trajectory.times)))
    return float(trajectory.times[first]), float(trajectory.times[first + 1])
