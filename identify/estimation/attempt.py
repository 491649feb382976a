"""One start, placed on the logs and solved, and an answer solved again; the gate says what came of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.base.stages import of_which, stage
from identify.estimation.goodness_of_fit import Gate, pass_gate
from identify.estimation.sequence import (
    TRIES,
    followed,
    hardly,
    is_clear,
    is_near_grazing,
    resimulated,
    resimulated_whole,
)
from identify.logs.prepare import Prepared, beginning, cut_in_last_stick
from identify.logs.unknowns import Unknowns
from identify.shooting.following import glide
from identify.shooting.grid import COARSE_GRID
from identify.shooting.passes import Solved, solve_in_passes
from identify.shooting.placing import place
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]
PlacedLog = tuple[
    int, Prepared, ShootingTrajectory
]  # number of a log, the log as it is cut, and the motion placed on it

CREEPING = 0.2  # of the noise variance: a misfit that is no reason to look for another start
OBEYS = 1e-7  # largest row of a motion that obeys the model: its misfit counts, though the solver stalled
HORIZONS = (0.125, 0.25, 0.5, 1.0)  # shares of a course before it slides steadily, each solved from the one before
BETTER = 2.0  # squares in noise variances by which another motion must fit better to be taken
PRIOR_SCHEDULE = (
    20.0,
    13.0,
    8.0,
    5.6,
    4.0,
    2.8,
    2.0,
    1.4,
    1.0,
)  # where the start is off besides: small steps find the way
FIRST = 5  # of these: how firmly a start is held before another one is taken


@dataclass(frozen=True)
class Attempt:
    """A solved start: the numbers of the logs that took part (from 0), and these logs as far as they were followed; the
    solution and its gate; found_by: the titles of the strategies that led to it, in their order."""

    log_numbers: tuple[int, ...]
    fitted_logs: tuple[Prepared, ...]
    solved: Solved
    gate: Gate
    found_by: tuple[str, ...] = ()

    @property
    def cost_per_sample(self) -> float | None:
        """Sum of squares in noise variances per sample; None where there is none."""
        cost = 2.0 * self.solved.solution.cost / max(self.solved.problem.samples, 1)
        return cost if np.isfinite(cost) else None

    @property
    def excess(self) -> float:
        """Sum of squares in noise variances less the number of samples; infinite where the motion is none of the
        model."""
        solution = self.solved.solution
        obeys = solution.success or solution.constraint_violation < OBEYS
        return 2.0 * solution.cost - self.solved.problem.samples if obeys else np.inf


def usable(prepared: Sequence[Prepared]) -> list[int]:
    """Numbers of the logs that are not left out."""
    return [i for i, log in enumerate(prepared) if log.left_out is None]


def solve_from(
    prepared: list[Prepared],
    chosen: list[int],
    unknowns: Unknowns,
    tightness: float = 1.0,
    cost_cutoff: float = np.inf,
) -> Attempt | None:
    """Place the start on the chosen logs and solve; None where no log can be placed.

    Args:
        cost_cutoff: a pass that ends with a larger cost is the last one.
    """
    with stage("place"):
        placed = place_on(prepared, chosen, unknowns) if chosen else []
    return solve_placed(prepared, placed, unknowns, tightness, cost_cutoff) if placed else None


def solve_placed(
    prepared: list[Prepared],
    placed: list[PlacedLog],
    unknowns: Unknowns,
    tightness: float = 1.0,
    cost_cutoff: float = np.inf,
) -> Attempt:
    """Solve from a start that is placed on some of the logs, one at least; where slips rest by a hair, again with the
    motion that follows from the answer, and where courses are not met for sure, by way of their beginnings."""
    attempt = _solved(prepared, placed, unknowns, tightness, cost_cutoff)
    if attempt.solved.solution.cost > cost_cutoff or not np.all(np.isfinite(attempt.solved.theta)) or time_is_up():
        return attempt
    # A rest that can get no shorter is also what the solver fails on.
    at_answer = replace(unknowns, start=attempt.solved.theta)
    whole = [prepared[number] for number in attempt.log_numbers]
    anew = resimulated_whole(whole, attempt.fitted_logs, attempt.solved.trajectories, at_answer)
    if anew is not None:
        placed = list(zip(attempt.log_numbers, *anew, strict=True))
        other = _solved(prepared, placed, at_answer, tightness, cost_cutoff)
        return other if other.excess < attempt.excess - BETTER else attempt
    courses = [
        (log, trajectory)
        for log, trajectory in zip(attempt.fitted_logs, attempt.solved.trajectories, strict=True)
        if log.fit_mode.name == "continuous"
    ]
    # A sequence may agree with its own answer, and the data with another, where the mass rests by a hair.
    met = attempt.gate.status is Status.CONVERGED and not any(hardly(*course) for course in courses)
    if met or not courses:
        return attempt
    extended = _by_horizons(prepared, attempt.log_numbers, unknowns, tightness)
    return extended if extended is not None and extended.excess < attempt.excess - BETTER else attempt


def _by_horizons(
    prepared: list[Prepared], numbers: Sequence[int], unknowns: Unknowns, tightness: float
) -> Attempt | None:
    """Solve with short beginnings of the courses, then with longer ones, each from the answer before; None where a
    beginning is not met. Parameters that are off make another sequence of sticks and slips in the long run, which no
    solve leaves again; over a few of them it is that of the data."""
    found: Attempt | None = None
    for share in HORIZONS:
        logs = [beginning(log, share) if log.fit_mode.name == "continuous" else log for log in prepared]
        placed = place_on(logs, list(numbers), unknowns)
        if len(placed) < len(numbers) or time_is_up():
            return None
        found = _solved(logs, placed, unknowns, tightness, np.inf)
        if not abs(found.gate.chi2_per_sample - 1.0) < CREEPING:
            return None
        unknowns = replace(unknowns, start=found.solved.theta)
    return found


def _solved(
    prepared: list[Prepared],
    placed: list[PlacedLog],
    unknowns: Unknowns,
    tightness: float,
    cost_cutoff: float,
) -> Attempt:
    """Solve until every course is that of the answer."""
    with stage("solve"):
        attempt = _solved_until_resimulated(prepared, placed, unknowns, tightness, cost_cutoff)
        of_which("build", attempt.solved.transcription_seconds, of="solve")
    return attempt


def _solved_until_resimulated(
    prepared: list[Prepared], placed: list[PlacedLog], unknowns: Unknowns, tightness: float, cost_cutoff: float
) -> Attempt:
    numbers, logs, trajectories = (list(column) for column in zip(*placed, strict=True))
    # What every log has for itself, the first log has in the shared theta.
    unknowns = replace(unknowns, start=trajectories[0].theta(unknowns.start))
    trajectories[0] = replace(trajectories[0], own=np.empty(0))
    data, soft = [log.data for log in logs], unknowns.with_weak_priors(tightness)
    solved = solve_in_passes(data, trajectories, soft, cost_cutoff=cost_cutoff)
    tried = list[tuple[list[Prepared], list[ShootingTrajectory], Solved]]()
    for _ in range(TRIES):
        if solved.solution.cost > cost_cutoff or time_is_up():
            break
        at_answer = replace(unknowns, start=solved.theta)
        again = resimulated([prepared[i] for i in numbers], logs, solved.trajectories, at_answer)
        if again is None:
            break
        tried.append((logs, trajectories, solved))
        logs, trajectories = again
        solved = solve_in_passes([log.data for log in logs], trajectories, at_answer.with_weak_priors(tightness))
    # Where the mass rests by a hair, the data know better whether it does than the answer, which is off by its error.
    for before in tried:
        hair = not any(is_clear(log, one, other) for log, one, other in zip(logs, before[1], trajectories, strict=True))
        if hair and _fits_better(before[2], solved):
            logs, trajectories, solved = before
    return Attempt(tuple(numbers), tuple(logs), solved, gated(solved, logs))


def _fits_better(one: Solved, other: Solved) -> bool:
    """Whether a solution that was found fits clearly better than another, of no more samples."""
    here, there = (2.0 * solved.solution.cost - solved.problem.samples for solved in (one, other))
    return one.solution.success and one.problem.samples >= other.problem.samples and not there <= here + BETTER


def retested(attempt: Attempt) -> Attempt:
    """The attempt with the gate of its own solution: one that was taken over from another model has that model's."""
    return replace(attempt, gate=gated(attempt.solved, attempt.fitted_logs))


def gated(solved: Solved, logs: Sequence[Prepared]) -> Gate:
    """The goodness-of-fit tests of a solution of these logs."""
    return pass_gate(solved, [log.name for log in logs], [log.noise_estimated for log in logs])


def stalled(attempt: Attempt) -> bool:
    """Whether the curve fits, and the solver found no end to a ridge along which the data tell nothing."""
    gate = attempt.gate
    return gate.status is Status.SOLVER_FAILED and abs(gate.chi2_per_sample - 1.0) < CREEPING


def solve_by_continuation(
    prepared: list[Prepared], chosen: list[int], unknowns: Unknowns, ways: int = 1
) -> Attempt | None:
    """Solve from a start with priors around it that hold what the data do not tell, then let go of them as far as the
    solver follows; None where it follows nowhere. The information matrix never sees these priors.

    Args:
        ways: how many are tried. How firm priors have to be at first differs from start to start: what wanders off from
            the softer ones is held by the firmer ones, and released in steps so small that each is an easy solve.
    """
    best: Attempt | None = None
    loosest = np.inf
    for first in range(ways):
        if time_is_up():
            break
        released_to = np.inf
        for tightness, tried in _with_weakening_priors(prepared, chosen, unknowns, PRIOR_SCHEDULE[first:]):
            if not tried.solved.solution.success:
                break
            released_to = tightness
            if tried.gate.status is Status.CONVERGED and tightness < loosest:
                best, loosest = tried, tightness
        if released_to == PRIOR_SCHEDULE[-1]:  # nothing wandered off: to hold it less firmly leads to the same place
            break
    return best


def _with_weakening_priors(
    prepared: list[Prepared], chosen: list[int], unknowns: Unknowns, firm: Sequence[float]
) -> Iterator[tuple[float, Attempt]]:
    """Solves with softer and softer priors around the start, each from the answer of the one before; with the tightness
    of each."""
    tried = solve_from(prepared, chosen, unknowns, firm[0])
    if tried is not None:
        yield firm[0], tried
        yield from with_weakening_priors(tried, unknowns, firm[1:])


def with_weakening_priors(held: Attempt, unknowns: Unknowns, firm: Sequence[float]) -> Iterator[tuple[float, Attempt]]:
    """Solves of the same samples with softer and softer priors around unknowns.start, each from the answer of the one
    before; with the tightness of each."""
    for tightness in firm:
        if time_is_up():
            return
        held = solve_again(held, replace(unknowns.with_weak_priors(tightness), start=held.solved.theta))
        yield tightness, held


def solve_again(attempt: Attempt, unknowns: Unknowns, *, steps: int = 0, most: int = 1000) -> Attempt:
    """Solve the logs of an attempt again from another theta (unknowns.start) and the motion found before, with at least
    and at most so many steps per interval."""
    logs, soft = attempt.fitted_logs, unknowns.with_weak_priors()
    solved = solve_in_passes([log.data for log in logs], attempt.solved.trajectories, soft, steps=steps, most=most)
    return replace(attempt, solved=solved, gate=gated(solved, logs))


def placed_anew(attempt: Attempt, unknowns: Unknowns, theta: Array) -> Attempt | None:
    """The logs of an attempt solved from theta (n_p,) as from a start that a user gives, with the motion that follows
    from it; None where that is no answer of all of them, or fits no better."""
    logs = list(attempt.fitted_logs)
    found = solve_from(logs, list(range(len(logs))), replace(unknowns, start=theta))
    if found is None or found.gate.status is not Status.CONVERGED or len(found.log_numbers) < len(logs):
        return None
    return replace(found, log_numbers=attempt.log_numbers) if found.excess < attempt.excess else None


def place_on(prepared: list[Prepared], chosen: list[int], unknowns: Unknowns) -> list[PlacedLog]:
    """Number, cut log and trajectory of every chosen log that the start can be placed on."""
    out: list[PlacedLog] = []
    for number in chosen:
        if prepared[number].fit_mode.name != "cycles":
            out += [(number, *found) for found in _followed(prepared[number], unknowns)]
    chosen = [i for i in chosen if prepared[i].fit_mode.name == "cycles"]
    logs = [prepared[i] for i in chosen]
    p = [unknowns.values(log.data.theta(unknowns.start), log.data.base) for log in logs]
    placed = place(unknowns.model, [log.data for log in logs], p, [log.falls for log in logs], COARSE_GRID)
    for number, log, trajectory in zip(chosen, logs, placed, strict=True):
        if trajectory is None or not _joins_up(trajectory, log):
            if trajectory is not None and is_near_grazing(
                log, trajectory
            ):  # rests are shorter than slips are placed exactly
                out += [(number, *found) for found in _followed(log.as_continuous, unknowns)]
            continue
        out.append((number, as_far_as_placed(log, trajectory), trajectory))
    return sorted(out, key=lambda entry: entry[0])


def as_far_as_placed(log: Prepared, trajectory: ShootingTrajectory) -> Prepared:
    """The log of cycles cut in the stick behind its last placed slip: what comes then is on no data yet."""
    sticks = trajectory.onset - np.concatenate([[log.data.begin], trajectory.arrest[:-1]])
    typical = float(np.median(sticks[1:])) if sticks.size > 1 else float(sticks[0])
    return cut_in_last_stick(log, float(trajectory.arrest[-1]), typical)


def _followed(log: Prepared, unknowns: Unknowns) -> list[tuple[Prepared, ShootingTrajectory]]:
    """The log of a course of its own, or of sliding, cut to what the start follows of it; empty where it does not."""
    p = unknowns.values(log.data.theta(unknowns.start), log.data.base)
    if log.fit_mode.name == "sliding":
        gliding = glide(unknowns.model, log.data, p)
        return [] if gliding is None else [(log, gliding)]
    found = followed(log, unknowns)
    return [] if found is None else [found]


def _joins_up(trajectory: ShootingTrajectory, log: Prepared) -> bool:
    """Whether every stick has a length, the last one too."""
    ends = np.append(trajectory.onset[1:], log.data.end)
    return bool(trajectory.onset[0] > log.data.begin and np.all(ends > trajectory.arrest))
