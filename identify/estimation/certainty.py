"""How sure an accepted answer is: its steps, covariance for the noise there is, profiles, bootstrap, intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import no_time_limit
from identify.base.outcome import Status
from identify.base.progress import Progress
from identify.estimation.agreement import agreeing
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
from identify.estimation.examined import Question, examine, fine_enough
from identify.estimation.influence import influence
from identify.estimation.profile import Profiles
from identify.estimation.residual_autocorrelation import Colour
from identify.estimation.status_words import at_bounds
from identify.estimation.strategies import no_time_for
from identify.logs.unknowns import Unknowns
from identify.shooting.accuracy import AccuracyRow, FitOptions, accuracy_table

Array = NDArray[np.float64]


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
    *,
    speed_tolerance: float,
    seed: int,
    progress: Progress,
) -> Certainty | None:
    """All that is said of how sure an answer is; None where the model has no derivatives there.

    Args:
        base: (n_p,) of the rig the values are given for; speed_tolerance: relative error of all drive speeds together.
    """
    attempt, known, discretised = fine_enough(attempt, unknowns, asked)
    if not np.all(np.isfinite(known.total)):
        return None
    seen = examine(attempt, known, Question(unknowns, base, asked, speed_tolerance, seed, progress))
    attempt, view = seen.attempt, seen.view
    if seen.unfinished:
        no_time_for("whether other values fit as well")
    if seen.accepted and not view.bounds and len(attempt.log_numbers) > 1:  # at a bound the scores do not cancel
        attempt = agreeing(attempt, unknowns, base, view.allowed)
    theta, groups = attempt.solved.theta, shares(attempt, unknowns)
    bounds_of = {s.log: at_bounds(unknowns, attempt.solved.trajectories[s.log].theta(theta)) for s in groups}
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
    made = bootstrap(solved.problem, z, known, asked.bootstrap, seed=seed, progress=progress)
    return replace(out, bootstrap=made)


def _tabled(out: Certainty, unknowns: Unknowns, progress: Progress) -> Certainty:
    """With what each accuracy costs and moves."""
    progress("table of accuracies", None)
    size = np.sqrt(np.diag(out.covariance))
    table = accuracy_table(out.attempt.fitted_logs, out.attempt.solved, unknowns, size)
    return replace(out, accuracy_table=table)
