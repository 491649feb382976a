"""How sure an accepted answer is: its steps, covariance for the noise there is, profiles, bootstrap, intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from identify.accuracy import AccuracyRow, accuracy_table
from identify.agreement import contradiction, pulls_of_logs
from identify.asked import Asked
from identify.attempt import Attempt, resolve, resolve_firmly
from identify.bootstrap import Bootstrap, bootstrap
from identify.coloured import Colour, colour, coloured_covariance
from identify.combinations import Combination, Direction, combinations, directions
from identify.discretisation import discretisation_error
from identify.gate import Gate
from identify.hints import hints, onsets, untold
from identify.influence import Influence, influence, sample_moves
from identify.inward import at_own_bounds, taken_inside
from identify.level import LEVEL, NORMAL
from identify.outcome import Status
from identify.passes import solve_in_passes
from identify.profile import Profiles, profile
from identify.profile_line import ProfilePoint
from identify.quantiles import chi_square
from identify.ridge_ends import better_course, other_sign, strengthened
from identify.shares import Share, share_estimates, shares
from identify.uncertainty import IDENTIFIED, Estimate, Information, Interval, estimates, information, sizes
from identify.unknowns import Unknowns
from identify.valleys import Valley, other_valleys
from identify.vibration import rhythmic
from identify.widened import widened

Array = NDArray[np.float64]
Progress = Callable[[str, float | None], None]

BETTER_TRIES = 3  # how often a profile, or the ends of a ridge, may hand back a better optimum
DOUBTFUL = 0.13  # standard error of a logarithm: an interval of a quarter each way
CURVED = 0.012  # standard error of a logarithm beyond which the ridge along it may bend
NEAR = 0.4  # of the longest side of a coefficient that is identified: a bent ridge may add what is missing
CURVE_STEPS = 4  # of each side of a profile that is drawn


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
    asked: Asked,
    at_bound: Callable[[Array], Mapping[str, str]],
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
    if attempt.gate.status is Status.CONVERGED:
        attempt = strengthened(attempt, unknowns) or attempt
        attempt = taken_inside(attempt, unknowns) or attempt
    attempt, known, discretised = fine_enough(attempt, unknowns, asked)
    if not np.all(np.isfinite(known.total)):
        return None
    accepted = attempt.gate.status is Status.CONVERGED
    walked: Profiles | None = None
    mirrored = False
    valleys: list[Valley] | None = []  # None: looked for before the next walk
    met: tuple[ProfilePoint, ...] = ()  # by the walk before, of so many samples
    samples = 0
    for tries in range(1 + BETTER_TRIES):
        solved = attempt.solved
        bounds = at_bound(solved.theta)
        told = hints(attempt.prepared, solved.guesses, unknowns, solved.theta)
        by_speed = known.drive_speed_shift()
        white = known.covariance()
        colours = noise_colours(attempt)
        reached = _reached(attempt) if accepted and not all(c.white for c in colours) else None
        covariance = white + speed_tolerance**2 * np.outer(by_speed, by_speed)
        joint = known.joint_covariance()
        joint[: len(white), : len(white)] = covariance
        if reached is not None:
            joint = joint + _excess(attempt, reached, colours)
            covariance = joint[: len(white), : len(white)]
        memory = np.diag(covariance) / np.diag(white)
        if walked is not None:
            covariance = widened(covariance, walked.likely, walked.objection)
            joint[: len(white), : len(white)] = covariance
        ends = _intervals(walked)
        found = estimates(unknowns, solved.theta, base, covariance, at_bound=bounds, hints=told, profiles=ends)
        found = untold(found, solved.guesses, told)
        if accepted and not mirrored and tries < BETTER_TRIES and _leave_open(found):
            mirrored, other = True, other_sign(attempt, unknowns)
            if other is not None:
                attempt, known, walked = other, information_at(other, unknowns), None
                continue
            valleys = None
        # What one peak or one level does not tell, no walk along it will find an end of.
        tells = onsets(solved.guesses) > 1
        asks = asked.profile or bool(bounds) or (tells and doubtful(unknowns, covariance, found))
        if walked is not None and accepted and tries < BETTER_TRIES and _leave_open(found):
            other = better_course(attempt, unknowns, walked.likely)
            if other is not None:
                attempt, known, walked = other, information_at(other, unknowns), None
                continue
        along = None if asks else ridge(unknowns, covariance, solved.theta, base) if tells else []
        if walked is not None or not accepted or along == [] or tries == BETTER_TRIES:
            break
        steps = CURVE_STEPS if asked.profile else 1
        if valleys is None:
            progress("looking for other valleys", None)
            valleys = other_valleys(attempt, unknowns)
        met = () if samples != solved.problem.samples else met
        walked = profile(
            attempt.prepared,
            solved,
            unknowns,
            white,
            progress,
            memory=memory,
            steps=steps,
            only=along,
            valleys=valleys,
            before=met,
        )
        samples, met = solved.problem.samples, walked.met
        if walked.better is not None:
            moved = resolve_firmly(attempt, unknowns, walked.better.theta, walked.better.guesses)
            inside = walked.gain < chi_square(LEVEL, int(np.sum(unknowns.free)))
            outside = np.any(at_own_bounds(unknowns, moved.solved.theta))
            if inside and (moved.gate.status is not Status.CONVERGED or outside):
                # Inside the joint region: another point of the same ridge, at which the solver finds no end, or which
                # has none within the model.
                walked = walked.seen_from(unknowns, solved.theta)
                continue
            if moved.gate.status is not Status.CONVERGED:
                moved = replace(moved, gate=_another_start(moved, unknowns, walked, base))
            seen = walked.seen_from(unknowns, moved.solved.theta) if tries + 1 == BETTER_TRIES else None
            if inside:  # the data hardly prefer the one to the other
                valleys = [*valleys, Valley(solved.theta, solved.guesses)]
            attempt, known, walked = moved, information_at(moved, unknowns), seen
            accepted = attempt.gate.status is Status.CONVERGED
    if accepted and not bounds and len(attempt.logs) > 1:  # at a bound the pulls of the logs do not cancel
        attempt = _agreeing(attempt, unknowns, base, reached or _reached(attempt), colours)
        accepted = attempt.gate.status is Status.CONVERGED
    groups = shares(attempt, unknowns)
    bounds_of = {s.log: at_bound(attempt.solved.guesses[s.log].theta(attempt.solved.theta)) for s in groups}
    of_groups = share_estimates(groups, unknowns, attempt.solved.theta, base, joint, at_bound=bounds_of, hints=told)
    out = Certainty(
        attempt,
        known,
        covariance,
        white,
        colours,
        found,
        walked,
        discretisation=discretised,
        memory=memory,
        joint=joint,
        shares=groups,
        of_groups=of_groups,
    )
    return _deeper(out, unknowns, base, asked, reached, seed, progress) if accepted else out


def _agreeing(attempt: Attempt, unknowns: Unknowns, base: Array, reached: Influence, colours: list[Colour]) -> Attempt:
    """The answer, refused where one of its logs contradicts the others."""
    solved, names = attempt.solved, [log.name for log in attempt.prepared]
    try:
        found = pulls_of_logs(solved.problem, solved.solution.z, reached, slowness(attempt, colours))
    except np.linalg.LinAlgError:  # directions that no log tells: their verdicts say so
        return attempt
    message = contradiction(
        found, unknowns, solved.theta, base, names, lambda log: _without_log(attempt, unknowns, log)
    )
    if not message:
        return attempt
    return replace(attempt, gate=replace(attempt.gate, status=Status.MODEL_MISFIT, message=message))


def _without_log(attempt: Attempt, unknowns: Unknowns, log: int) -> Array | None:
    """The answer (n_p,) of all logs but one, from the common one; None where the solver does not settle, or logs have
    parameters of their own, which the first of them lends its place in theta."""
    if np.any(unknowns.own):
        return None
    rest = [i for i in range(len(attempt.logs)) if i != log]
    at_answer = replace(unknowns, start=attempt.solved.theta).softened()
    data, motion = [attempt.prepared[i].data for i in rest], [attempt.solved.guesses[i] for i in rest]
    solved = solve_in_passes(data, motion, at_answer)
    return solved.theta if solved.solution.success else None


def _another_start(moved: Attempt, unknowns: Unknowns, walked: Profiles, base: Array) -> Gate:
    """The gate of an answer that a profile found a better place than, at which the solver does not settle."""
    assert walked.better is not None
    values = unknowns.values(walked.better.theta, base)
    told = ", ".join(
        f"{unknowns.names[i]} = {values[i]:.4g} {unknowns.model.parameters[i].unit}".rstrip()
        for i in np.flatnonzero(unknowns.free).tolist()
    )
    message = (
        f"another start is better: chi^2 falls by {walked.gain:.3g} below that of the answer found, and the solver "
        f"does not settle there ({moved.gate.solver}); give these as start values under [parameters]: {told}"
    )
    return replace(moved.gate, status=Status.BETTER_START_FOUND, message=message)


def _deeper(
    out: Certainty,
    unknowns: Unknowns,
    base: Array,
    asked: Asked,
    reached: Influence | None,
    seed: int,
    progress: Progress,
) -> Certainty:
    """Combinations always; bootstrap and accuracy table where they are asked for."""
    solved = out.attempt.solved
    free = np.flatnonzero(unknowns.free).tolist()
    names, logs = [unknowns.names[i] for i in free], [bool(unknowns.logarithmic[i]) for i in free]
    values = dict(zip(unknowns.names, unknowns.values(solved.theta, base).tolist(), strict=True))
    out = replace(
        out,
        combinations=combinations(names, logs, values, out.covariance),
        directions=directions(names, logs, values, out.covariance),
    )
    cycles = [guess.parts for guess in solved.guesses]
    if asked.bootstrap:
        progress("bootstrap", None)
        known = influence(solved.problem, solved.solution.z, cycles)
        z = solved.solution.z
        out = replace(
            out,
            bootstrap=bootstrap(solved.problem, z, known, asked.bootstrap, cycles=cycles, seed=seed, progress=progress),
        )
    if asked.accuracy_table:
        progress("table of accuracies", None)
        size = np.sqrt(np.diag(out.covariance))
        out = replace(out, accuracy_table=accuracy_table(out.attempt.prepared, solved, unknowns, size))
    return out


def _leave_open(found: list[Estimate]) -> bool:
    """Whether the data do not tell some parameter."""
    return any(e.verdict == "not identifiable" for e in found)


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


def fine_enough(attempt: Attempt, unknowns: Unknowns, asked: Asked) -> tuple[Attempt, Information, dict[str, float]]:
    """The answer with steps so fine that their error is a small part of each standard error, and that part by name."""
    level = asked.accuracy
    if attempt.gate.status is Status.CONVERGED and attempt.solved.grid.steps > level.most:
        attempt = resolve(attempt, replace(unknowns, start=attempt.solved.theta), most=level.most)
    known = information_at(attempt, unknowns)
    shares: dict[str, float] = {}
    for _ in range(1 + level.refinements):
        if attempt.gate.status is not Status.CONVERGED or not np.all(np.isfinite(known.total)):
            break
        error = discretisation_error(attempt.solved) / np.sqrt(np.diag(known.covariance()))
        free = np.flatnonzero(unknowns.free).tolist()
        shares = {unknowns.names[i]: float(np.nan_to_num(e)) for i, e in zip(free, error, strict=True)}
        if not shares or max(abs(e) for e in shares.values()) <= level.share:
            break
        finer = 2 * attempt.solved.grid.steps
        if finer > level.most:
            break
        again = resolve(attempt, replace(unknowns, start=attempt.solved.theta), steps=finer)
        if again.gate.status is Status.SOLVER_FAILED:  # no reason to give up the answer: what its steps cost is told
            break
        attempt, known = again, information_at(again, unknowns)
    return attempt, known, shares


def information_at(attempt: Attempt, unknowns: Unknowns) -> Information:
    """The information of the data on all parameters, those held fixed too, at the answer."""
    solved = attempt.solved
    at_answer = replace(unknowns, start=solved.theta)
    return information(*solved.problem.with_all_parameters(at_answer, solved.solution.z))


def noise_colours(attempt: Attempt) -> list[Colour]:
    """The colour of the residuals of every log of an attempt."""
    fitted = attempt.solved.fitted
    return [
        colour(np.where(log.data.weight > 0, log.data.force - curve, np.nan))
        for log, curve in zip(attempt.prepared, fitted, strict=True)
    ]


def slowness(attempt: Attempt, colours: Sequence[Colour]) -> float:
    """By how much the memory and the level of the noise widen the variance of what changes slowly, at most."""
    return max(1.0, attempt.gate.level) * max([1.0, *(colour.memory for colour in colours)])


def _reached(attempt: Attempt) -> Influence:
    solved = attempt.solved
    cycles = [guess.parts for guess in solved.guesses]
    return influence(solved.problem, solved.solution.z, cycles, absorbed=False)


def _excess(attempt: Attempt, known: Influence, colours: list[Colour]) -> Array:
    """What the memory of the noise adds to the covariance of white noise."""
    problem = attempt.solved.problem
    moves = sample_moves(problem, attempt.solved.solution.z, known.columns)
    levels = np.broadcast_to(attempt.gate.levels, len(problem.logs)).tolist()
    variances = [
        level / max(float(np.max(log.weight)), 1e-300) for log, level in zip(problem.logs, levels, strict=True)
    ]
    return coloured_covariance(moves, variances, colours) - known.white.sum(axis=0)


def _intervals(walked: Profiles | None) -> dict[str, Interval]:
    if walked is None:
        return {}
    return {name: Interval(*(side.end for side in sides)) for name, sides in walked.ends.items()}
