"""fit: from a scene and its logs to a finished identification.

    prepare -> start -> solve -> test -> explain (no answer) or quantify (an answer) -> report

`estimation.search` starts, solves and tests; `estimation.certainty` quantifies; `diagnosis` explains. Status and
sentence of a fit are decided in `_estimated`, and by the explanation of a misfit, nowhere else.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.spelling import spelled
from identify.base.budget import now, seconds_left, stage, timing_stages
from identify.base.budget import time_limit as within
from identify.base.compiled import Mapped
from identify.base.errors import FitError
from identify.base.linear import keep_freed_memory
from identify.base.progress import Notice, Progress, noticed_once, to_nobody
from identify.base.result import LogCurves, SearchTrial, Status
from identify.base.wording import distinct
from identify.diagnosis.explain import CLEAR, MISFITS, explain, sensor_elsewhere, takes_misfit
from identify.diagnosis.findings import Findings, against_data, held_scores
from identify.diagnosis.fitted import Fitted, fit_beside, values_of
from identify.diagnosis.selection import choose_from_data
from identify.diagnosis.specimens import with_scatter
from identify.effects import ALL
from identify.estimation.attempt import Attempt
from identify.estimation.certainty import Question, certainty
from identify.estimation.estimator import EstimationTask, Estimator, Trace, note, tracing
from identify.estimation.fit_wording import (
    at_bounds,
    ended,
    prefit_warnings,
    slides_only,
    underivable,
    untried,
    wrong_unit,
)
from identify.estimation.goodness_of_fit import stick_scatter
from identify.estimation.search import SearchProblem, alike, search
from identify.estimation.starts import Sources
from identify.estimation.stick_strength import with_strengths
from identify.logs.prepare import Prepared
from identify.logs.scene_records import prepare_scene, with_drives, with_records
from identify.logs.unknowns import from_scene, stated_rig, user_start
from identify.model.model import RIG_PARAMETERS
from identify.report.log_document import fitted_curves, refused_curves
from identify.report.result import result_of, with_accuracy
from identify.scene import Scene
from identify.scene.tables import quantity
from identify.scene.values import USUAL_TOLERANCES
from identify.shooting.accuracy import DEFAULT_OPTIONS, FitOptions
from identify.uneven.answer import UnevenEstimator

if TYPE_CHECKING:
    from identify.report.finished import Fit

Array = NDArray[np.float64]

# Shares of the time limit.
REPORT_SHARE = 0.1  # for the document and its figures
CHOICE_SHARE = 0.5  # for the comparison of effects that are to be chosen
SEARCH_SHARE = 0.6  # of what is left: the rest is for the intervals of an answer, or the cause of a misfit
PLAIN_SHARE = 0.75  # where cycles differ: the estimator of uneven records needs the rest

UNEVEN_EFFECT = "friction_heterogeneity"  # asks for the estimator of uneven records
LAST_STAGE = "stability and amplitude"
BY_NAME = {effect.name: effect for effect in ALL}
LIKELY = 3.0  # standard deviations of the usual error of a rig or a sensor
ERRORS = {name: name for name in ("mass", "stiffness", "damping", "drive_speed")}
ERRORS |= {"force_gain": "friction_force", "load_gain": "normal_force"}
SCALES = ("drive_speed", "friction_force")  # what a stiffness, mass and damping that are estimated stand in for


@dataclass(frozen=True)
class Task(EstimationTask):
    """What is to be estimated: beside what every estimator is given, the records of the logs as they were read, how
    finely and which further results, and where the search starts, and before that at `known` (n_p,)."""

    logs: list[Prepared]
    records: Sequence[Record]
    options: FitOptions
    starts: Sources
    known: Array | None = None


@spelled
def fit(
    scene: Scene | str | Path | Mapping[str, object],
    records: Sequence[Record] | None = None,
    *,
    progress: Progress | None = None,
    starts: Sources | None = None,
    seed: int = 0,
    options: FitOptions = DEFAULT_OPTIONS,
    estimator: Estimator | None = None,
    time_limit: float | str | None = None,
) -> Fit:
    """Identify the parameters of a scene from all its logs together.

    Parameters
    ----------
    scene : Scene | str | Path | Mapping[str, object]
        rig, effects, parameters and logs; the path of a scene file, or its tables, does as well.
    records : Sequence[Record] | None, optional
        the scene's logs in their order; None reads them.
    progress : Progress | None, optional
        called as progress(stage, share of the whole).
    starts : Sources | None, optional
        where the search starts: "data", "user" (the scene's `start` values before the data), "both"; default both
        where the scene gives a start, else the data.
    seed : int, optional
        of the random starts, where the data's own do not fit or the data barely determine some parameter, and of the
        bootstrap.
    options : FitOptions, optional
        how finely, and which further looks at how sure the answer is.
    estimator : Estimator | None, optional
        another one than that of this package: multiple shooting, and where that fails since cycles differ, or where
        the effect friction_heterogeneity asks for it, the one of uneven records.
    time_limit : float | str | None, optional
        [s] or text with a unit, in place of that of the scene.

    Returns
    -------
    Fit

    Raises
    ------
    FitError, SceneError, LogError
        what cannot be set up, one sentence. A fit that does not succeed is no error: its status says so.
    """
    from identify.report.finished import Fit  # pages and predictions: not needed before there is a fit

    # Prepare: the scene with its drives and effects, the logs cut into cycles.
    began, worked, in_functions = time.perf_counter(), time.process_time(), Mapped.total
    report = noticed_once(progress or to_nobody)
    given = Scene.of(scene)
    if time_limit is not None:
        given = replace(given, time_limit=quantity(time_limit, "s", "time_limit"))
    stated, drives = with_drives(given, records)
    used, choice, left = stated, None, (1.0 - REPORT_SHARE) * stated.time_limit  # [s]
    with timing_stages() as seconds:
        uneven = used.effects != "auto" and UNEVEN_EFFECT in used.effects
        if estimator is None and uneven and BY_NAME[UNEVEN_EFFECT].unfit(used.values()) is not None:
            used, estimator = used.with_effects([e for e in used.effects if e != UNEVEN_EFFECT]), UnevenEstimator()
        if used.effects == "auto":
            used, records = with_records(used, records)
            before = now()
            with within(CHOICE_SHARE * left), stage("choose"):
                choice = choose_from_data(used, records, report)
            left -= now() - before
            used = used.with_effects(choice.effects)
        task = _prepared(used, records, options, starts, seed, report)
        if choice is not None and choice.ended is not None and choice.ended.attempt is not None:
            task = replace(task, known=values_of(choice.ended, task.unknowns))
        # Start, solve and test; then quantify an answer, or explain why there is none.
        with within(left), tracing() as trace:
            if choice is not None and choice.unfinished:
                trace.not_tried.append("comparison of effects")
            if estimator is None:
                logs, findings = plain_or_uneven(task)
            else:
                logs, findings = task.logs, estimated_by(estimator, task)
        findings = _with_trace(findings, trace, used.time_limit)
    # Report.
    report(LAST_STAGE, 0.95)
    used, curves = findings.scene or used, _curves(logs, findings)
    seconds["total"] = taken = time.perf_counter() - began
    processor, in_functions = time.process_time() - worked, Mapped.total - in_functions
    result = result_of(used, logs, findings, seconds, seed, choice)
    if findings.status is Status.CONVERGED:
        result = with_accuracy(result, findings, options, processor, in_functions / taken)
    document = (stated if stated.effects != "auto" else used).as_document()
    result = replace(
        result,
        notes=(*drives, *result.notes),
        provenance={**result.provenance, "scene": document, "starts": task.starts, "asked": options.document()},
    )
    report(LAST_STAGE, 1.0)
    return Fit(result.to_dict(), curves)


def _prepared(
    scene: Scene,
    records: Sequence[Record] | None,
    options: FitOptions,
    starts: Sources | None,
    seed: int,
    progress: Progress,
) -> Task:
    """The task of a fit: its logs read, cut into parts and prepared.

    Raises:
        FitError, SceneError, LogError: what cannot be fitted, one sentence.
    """
    keep_freed_memory()
    if not scene.model.inertial:
        raise FitError(
            "the effect inertia is off: a fit follows slips, which have no duration without a mass; "
            "add inertia to effects and give the mass under [rig]"
        )
    values = scene.values()
    if refusal := next(filter(None, (BY_NAME[name].unfit(values) for name in scene.effects)), None):
        raise FitError(refusal)
    if not np.any(from_scene(scene).free):
        raise FitError(
            "[parameters] fixes every parameter, so that nothing is left to fit; expected one that is free: "
            "give one of them a start instead of fixed, or look at what these values do: stickslip fit --preview"
        )
    progress("reading the logs", 0.0)
    with stage("read"):
        scene, read = with_records(scene, records)
    progress("detecting cycles", 0.05)
    with stage("detect"):
        ready = prepare_scene(scene, read)
        for sentence in prefit_warnings(ready.logs):
            progress(Notice(sentence), 0.08)
    starts = starts or ("both" if user_start(scene) else "data")
    return Task(ready.scene, ready.logs, ready.unknowns, seed, progress, ready.records, options, starts)


def plain_or_uneven(task: Task) -> tuple[list[Prepared], Findings]:
    """What multiple shooting finds, and where it fails since cycles differ among themselves, the estimator of uneven
    records; where that fails too, what multiple shooting found."""
    differ = not alike([log for log in task.logs if log.left_out is None])
    with within((PLAIN_SHARE if differ else 1.0) * seconds_left()):
        prepared, findings = _estimated(task)
    explained = findings.status is Status.CONVERGED or findings.explained
    if explained or alike([log for log in prepared if log.left_out is None]):
        return prepared, findings
    began = now()
    uneven = estimated_by(UnevenEstimator(), replace(task, logs=prepared))
    logs = tuple(i + 1 for i in range(len(prepared)) if i not in uneven.left_out)
    note(SearchTrial("uneven estimator", logs, uneven.status.value, None, round(now() - began, 4)))
    if uneven.status is not Status.CONVERGED:
        return prepared, replace(findings, message=f"{findings.message}; {uneven.message}")
    return prepared, uneven


def estimated_by(estimator: Estimator, task: Task) -> Findings:
    """What another estimator finds, as the result document takes it."""
    answer = estimator.estimate(task)
    findings = Findings(answer.status, answer.message, task.unknowns, left_out=answer.left_out, estimated=answer)
    return replace(findings, estimator=estimator.name)


def _estimated(task: Task) -> tuple[list[Prepared], Findings]:
    """The logs as they were fitted and what was found: started, solved and tested, then quantified or explained."""
    prepared, unknowns = task.logs, task.unknowns
    if elsewhere := sensor_elsewhere(task.scene, task.records, prepared, unknowns):
        return prepared, elsewhere
    if refused := wrong_unit(prepared):
        return prepared, Findings(Status.MODEL_MISFIT, refused, unknowns)
    known = task.known
    for explained in (partial(takes_misfit, unknowns=unknowns), SearchProblem.explained):
        with within(SEARCH_SHARE * seconds_left()):
            problem = SearchProblem(task.logs, unknowns, task.starts, task.seed, True, explained, known, task.progress)
            attempt, left_out = search(problem)
        if attempt is not None:
            prepared = with_strengths(task.logs, attempt.fitted_logs[0].data.strength_sd)
        with stage("intervals"):
            task.progress("intervals", 0.9)
            findings = _quantified(task, prepared, attempt, left_out)
            findings = explain(findings, task.scene, task.records, prepared, task.progress)
        unclear = findings.status in MISFITS and not findings.explained
        if findings.restart is not None:
            known = findings.restart
        elif attempt is None or not (unclear and takes_misfit(attempt, unknowns)):
            break  # else the search ended for what is no cause
    with stage("intervals"):
        prepared, findings = _with_rig_estimated(task, prepared, findings)
        if _logs_may_differ(task.scene, findings):
            return _with_logs_apart(task, prepared, findings)
    return prepared, findings


def _quantified(task: Task, prepared: list[Prepared], attempt: Attempt | None, left_out: dict[int, str]) -> Findings:
    """Status, sentence, estimates and intervals of where a search ended."""
    scene, unknowns = task.scene, task.unknowns
    if attempt is None:
        return Findings(*untried(prepared, left_out), unknowns, left_out=left_out)
    if not np.all(np.isfinite(attempt.solved.theta)):
        return Findings(*ended(attempt, {}), unknowns, attempt, left_out)
    rig, speed_error = stated_rig(scene), scene.rig.tolerances.get("drive_speed", 0.0)
    question = Question(unknowns, unknowns.base(rig), task.options, speed_error, task.seed, task.progress)
    sure = certainty(attempt, question)
    if sure is None:
        return Findings(Status.SOLVER_FAILED, underivable(attempt), unknowns, attempt, left_out)
    attempt, theta, bounds = sure.attempt, sure.attempt.solved.theta, dict[str, str]()
    for at in (theta, *(trajectory.theta(theta) for trajectory in attempt.solved.trajectories)):
        bounds = at_bounds(unknowns, at) | bounds
    status, message = sure.refused or ended(attempt, bounds)
    if status is Status.CONVERGED:
        message = slides_only(attempt.fitted_logs, attempt.solved.trajectories) or message
    scores = held_scores(attempt, unknowns)
    held = against_data(scores, unknowns, rig) if attempt.fits and sure.refused is None else {}
    return Findings(status, message, unknowns, attempt, left_out, sure, held, scores)


def _with_rig_estimated(task: Task, prepared: list[Prepared], findings: Findings) -> tuple[list[Prepared], Findings]:
    """The answer with what [rig] states without a tolerance known to its usual error, and estimated, where the cause
    that the data name is such an error of rig or sensor; else, or where it describes the data no better, as they were.
    """
    scene, usual = task.scene, {**USUAL_TOLERANCES, **task.scene.tolerances}
    named = [cause for cause in findings.causes if cause.number == 1]
    if not all(cause.quantity in ERRORS for cause in named):
        return prepared, findings
    # Errors that the data cannot distinguish add up, and all that scales the force by the way looks alike.
    together = {*SCALES, "stiffness", *(ERRORS[cause.quantity] for cause in named)}
    most = LIKELY * float(np.linalg.norm([usual[name] for name in together]))
    if not any(cause.stated and abs(cause.suggested / cause.stated - 1.0) < most for cause in named):
        return prepared, findings
    stated = stated_rig(scene)
    bare = [n for n in RIG_PARAMETERS if n not in scene.parameters and n not in scene.rig.tolerances]
    scales = [usual[name] for name in SCALES]
    shares = {n: float(np.linalg.norm([usual[n], *scales])) for n in bare if usual[n] * stated[n] > 0.0}
    eased = replace(scene, rig=replace(scene.rig, tolerances={**scene.rig.tolerances, **shares}))
    ended_at = Fitted(scene, findings.unknowns, tuple(prepared), findings.attempt)
    refitted = fit_beside(ended_at, eased, task.records)
    if refitted.attempt is None or not refitted.fits or set(refitted.logs) < set(ended_at.logs):
        return prepared, findings
    values = refitted.unknowns.values(refitted.attempt.solved.theta, refitted.unknowns.base(stated))
    rig = {name: float(values[refitted.unknowns.names.index(name)]) for name in shares}
    if any(abs(np.log(rig[name] / stated[name])) > LIKELY * share for name, share in shares.items()):
        return prepared, findings
    at = replace(task, scene=eased, logs=list(refitted.prepared), unknowns=refitted.unknowns)
    again = _quantified(at, at.logs, refitted.attempt, dict(findings.left_out))
    if again.status is not Status.CONVERGED:
        return prepared, findings
    template = "{} {} {unit} instead of {} {unit} (usual error {:.2g} %)"
    units = {parameter.name: parameter.unit for parameter in refitted.unknowns.model.parameters}
    words = ", ".join(
        template.format(name, *distinct(rig[name], stated[name]), 100.0 * share, unit=units[name])
        for name, share in shares.items()
    )
    message = f"the rig is not exactly as stated; estimated within its usual errors it is: {words}; {again.message}"
    return at.logs, replace(again, message=message, causes=findings.causes, scene=eased)


MOST_SCATTER = 0.06  # of friction from log to log, one standard deviation: specimens that differ by more are no repeats
GAINS = ("load_gain", "force_gain")


def _logs_may_differ(scene: Scene, findings: Findings) -> bool:
    """Whether a misfit, or a scatter of sticks, may be one of logs: a gain of one log explains it, or nothing does; and
    the scene does not say that all are of one specimen."""
    attempt, usual = findings.attempt, {**USUAL_TOLERANCES, **scene.tolerances}["specimen"]
    if attempt is None or len(attempt.log_numbers) < 2 or not usual or not np.isfinite(attempt.excess):
        return False
    if not alike(attempt.fitted_logs):  # sticks that differ so are no misfit of logs
        return False
    if findings.status is Status.CONVERGED:
        return stick_scatter(attempt.solved) is not None
    named = [cause for cause in findings.causes if cause.number == 1]
    of_logs = bool(named) and all(cause.log is not None and cause.quantity in GAINS for cause in named)
    return findings.status in MISFITS and (of_logs or not findings.explained)


def _with_logs_apart(task: Task, prepared: list[Prepared], findings: Findings) -> tuple[list[Prepared], Findings]:
    """The answer with friction that differs from log to log by a usual scatter; the findings as they were where that
    does not describe the data, or the data contradict the rig with it."""
    assert findings.attempt is not None
    least = {**USUAL_TOLERANCES, **task.scene.tolerances}["specimen"]
    random = with_scatter(findings.attempt, prepared, findings.unknowns, least)
    if random is None or random.sd > max(MOST_SCATTER, 2.0 * least):  # few logs barely determine it
        return prepared, findings
    again = _quantified(task, random.prepared, random.attempt, dict(findings.left_out))
    if again.status is not Status.CONVERGED or (again.scores is not None and again.scores.classes(CLEAR)):
        return prepared, findings
    each = zip(random.attempt.names, (100.0 * random.off).tolist(), strict=True)
    shares = ", ".join(f"{name} {level:+.2g} % and {static:+.2g} %" for name, (level, static) in each)
    message = (
        f"friction, and mu_s beside it, differs from log to log by {100.0 * random.sd:.2g} % (one standard deviation; "
        f"{shares}), which the intervals include; {again.message}"
    )
    return random.prepared, replace(again, message=message, causes=findings.causes, scatter=random.sd)


def _with_trace(findings: Findings, trace: Trace, limit: float) -> Findings:
    """Findings with what was tried for them, and, in the sentence, what the time limit [s] did not suffice for."""
    message = findings.message
    if trace.not_tried:
        message = (
            f"{message}; the time limit of {limit:g} s left no time for: {', '.join(trace.not_tried)} (see search in "
            "result.json); give more with --time-limit or time_limit under [fit], or fit fewer or shorter logs"
        )
    return replace(findings, trace=trace, message=message)


def _curves(prepared: list[Prepared], findings: Findings) -> tuple[LogCurves, ...]:
    """What was measured and fitted of each log."""
    curves = [log.curves for log in prepared]
    attempt, unknowns = findings.attempt, findings.unknowns
    if findings.estimated is not None:
        for number, curve in enumerate(findings.estimated.curves):
            if curve is not None:
                used = prepared[number].used & np.isfinite(curve)
                curves[number] = replace(curves[number], fitted_force=np.where(used, curve, np.nan), used=used)
    if attempt is None:
        return tuple(curves)
    solved = attempt.solved
    fitted = solved.fitted
    for place, number in enumerate(attempt.log_numbers):
        z = attempt.gate.z[attempt.gate.log == place + 1]
        curves[number] = fitted_curves(
            attempt.fitted_logs[place], unknowns, solved.theta, solved.trajectories[place], fitted[place], z
        )
        if findings.status not in (Status.CONVERGED, Status.AT_BOUND):
            curves[number] = refused_curves(prepared[number], curves[number])
    return tuple(curves)
