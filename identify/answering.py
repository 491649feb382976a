"""From prepared logs to an answer: searched, with how sure it is, and looked into."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from data_io import Record
from identify.base.budget import seconds_left, time_limit
from identify.base.outcome import Status
from identify.base.progress import Progress
from identify.base.stages import stage
from identify.diagnosis.findings import Findings, Held, against_data
from identify.diagnosis.fitted import as_it_ended, described
from identify.diagnosis.second_look import looked_into
from identify.estimation.agreement import largest_inflation
from identify.estimation.attempt import Attempt, solve_from
from identify.estimation.certainty import Certainty, certainty
from identify.estimation.grouped import search_grouped
from identify.estimation.hints import what_is_held
from identify.estimation.known_early import wrong_unit
from identify.estimation.other_optima import multistart_around
from identify.estimation.search import SearchProblem, rejected_as_incomplete, required_logs
from identify.estimation.starts import Sources
from identify.estimation.status_words import at_bounds, ended, underivable, untried
from identify.estimation.stick_strength import with_strengths
from identify.estimation.strategies import Strategy, run_strategy
from identify.logs.loads import calmed
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns, stated_rig
from identify.scene import Scene
from identify.shooting.accuracy import FitOptions

_Searched = tuple[list[Prepared], Attempt | None, dict[int, str]]  # logs, the answer, why logs were left out
Answer = tuple[list[Prepared], Findings]  # the logs as they are followed, and what was found

SEARCH_SHARE = 0.6  # of the time limit: the rest is for the intervals of an answer, or the cause of a misfit
ANSWERS = 3  # of one model, each better than the one before, that are looked into


@dataclass(frozen=True)
class Task:
    """What is to be answered: a scene, its records and logs, what is searched, what was asked beside the answer, and
    the seed of all that is drawn by lot."""

    scene: Scene
    read: Sequence[Record]
    prepared: list[Prepared]
    unknowns: Unknowns
    asked: FitOptions
    seed: int


def answered(task: Task, sources: Sources, progress: Progress) -> Answer:
    """The logs as they are followed, and what was found of them. Start values that lead to no answer of all logs do not
    stand in the way of one that the data lead to."""
    own = _answered(task, sources, progress)
    lacking = _falls_short(own)
    if sources != "user" or not any(lacking):
        return own
    other = _answered(task, "data", progress)
    if _falls_short(other) >= lacking:
        return own
    logs, findings = other
    unused = "from the data, since the start values led to no answer of all logs"
    return logs, replace(findings, message=f"{findings.message}; {unused}")


def _falls_short(answer: Answer) -> tuple[bool, int]:
    """Whether an answer is none, and how many logs it leaves out that could take part."""
    prepared, findings = answer
    able = {i for i, log in enumerate(prepared) if log.left_out is None}
    return findings.status is not Status.CONVERGED, len(able & set(findings.left_out))


def _answered(task: Task, sources: Sources, progress: Progress) -> Answer:
    """What a search from these starts ends in, looked into."""
    prepared, unknowns, seed = task.prepared, task.unknowns, task.seed
    if refused := wrong_unit(prepared):
        return prepared, Findings(Status.MODEL_MISFIT, refused, unknowns)

    def searched(logs: list[Prepared]) -> _Searched:
        found = search_grouped(SearchProblem(logs, unknowns, sources, seed, progress=progress))
        scatter = 0.0 if found[0] is None else found[0].fitted_logs[0].data.strength_sd
        return with_strengths(logs, scatter), *found

    with time_limit(SEARCH_SHARE * seconds_left()):
        prepared, attempt, left_out = _by_way_of_calm(prepared, unknowns, searched)
        if attempt is not None and unknowns.model.vibrates:
            progress("solving from other starts", 0.85)
            found = attempt
            with stage("solve"):
                better = run_strategy(
                    Strategy.VIBRATION_STARTS, lambda: multistart_around(found, prepared, unknowns, seed), found
                )
            attempt = better or found
    progress("intervals", 0.9)
    with stage("intervals"):
        return prepared, _examined(task, prepared, attempt, left_out, progress)


def _examined(
    task: Task, prepared: list[Prepared], attempt: Attempt | None, left_out: dict[int, str], progress: Progress
) -> Findings:
    """How sure an answer is and what else the data say, of each better answer that this leads to as well."""
    for _ in range(ANSWERS):
        findings = _findings(task, prepared, attempt, left_out, progress)
        findings, better = looked_into(findings, task.scene, task.read, prepared, progress)
        if better is None:
            return findings
        better = replace(better, found_by=(Strategy.HYPOTHESES.title,))
        attempt = rejected_as_incomplete(better, prepared, required_logs(prepared))
        left_out = {i: why for i, why in left_out.items() if i not in attempt.log_numbers}
    return _findings(task, prepared, attempt, left_out, progress)  # the last better answer is one to report, too


def _by_way_of_calm(
    prepared: list[Prepared], unknowns: Unknowns, searched: Callable[[list[Prepared]], _Searched]
) -> _Searched:
    """What a search finds; where loads tremble it goes by way of calm ones, whose answer is easily found, and follows
    the tremor from there. What no motion follows counts as unknown."""
    calm = [replace(log, data=calmed(log.data)) for log in prepared]
    if all(quiet.data is log.data for quiet, log in zip(calm, prepared, strict=True)):
        return searched(prepared)
    logs, known, left_out = searched(calm)
    if known is None or known.gate.status is not Status.CONVERGED:
        found = searched(prepared)
        converged = found[1] is not None and found[1].gate.status is Status.CONVERGED
        return found if converged or known is None else (logs, known, left_out)
    there = replace(unknowns, start=known.solved.theta)
    followed = run_strategy(
        Strategy.CALM_LOAD, lambda: solve_from(prepared, list(known.log_numbers), there), known, known.log_numbers
    )
    if followed is None or followed.gate.status is not Status.CONVERGED:
        return logs, known, left_out
    return prepared, followed, left_out


def _findings(
    task: Task, prepared: list[Prepared], attempt: Attempt | None, left_out: dict[int, str], progress: Progress
) -> Findings:
    """Status, estimates and what else the result document is made of; the logs as they are followed."""
    scene, unknowns = task.scene, task.unknowns
    if attempt is None:
        status, message = untried(prepared, left_out)
        return Findings(status, message, unknowns, left_out=left_out)
    if not np.all(np.isfinite(attempt.solved.theta)):
        status, message = ended(attempt, {})
        return Findings(status, message, unknowns, attempt, left_out)
    base = unknowns.base(stated_rig(scene))
    sure = certainty(
        attempt,
        unknowns,
        base,
        task.asked,
        speed_tolerance=scene.rig.tolerances.get("drive_speed", 0.0),
        seed=task.seed,
        progress=progress,
    )
    if sure is None:
        return Findings(Status.SOLVER_FAILED, underivable(attempt), unknowns, attempt, left_out)
    attempt = sure.attempt
    theta = attempt.solved.theta
    bounds: dict[str, str] = {}
    for at in (theta, *(trajectory.theta(theta) for trajectory in attempt.solved.trajectories)):
        bounds = at_bounds(unknowns, at) | bounds
    status, message = ended(attempt, bounds)
    if status is Status.CONVERGED:
        message = what_is_held(attempt.fitted_logs, attempt.solved.trajectories, sure.colours) or message
    held = _held(scene, sure) if described(as_it_ended(scene, unknowns, prepared, attempt)) else []
    return Findings(status, message, unknowns, attempt, left_out, sure, held)


def _held(scene: Scene, sure: Certainty) -> list[Held]:
    """The rig as stated, against the data."""
    memory = largest_inflation(sure.attempt, sure.colours)
    theta = sure.attempt.solved.theta
    return against_data(sure.information, theta, stated_rig(scene), memory, tolerances=scene.rig.tolerances)
