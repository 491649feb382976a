"""Why a fit misfits, or why an answer that fits is none to rely on: the most likely cause, with its number and remedy.

The score test ranks all that the fit took as stated. What leads is set free and fitted again, for its value, and to see
whether it does explain the data: a cause is named only where it does, together with what these data do not tell apart
from it. Where it does not, or the next one is as likely, that is fitted again too. The other scores are a table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from data_io import Record
from identify.base.budget import now, seconds_left
from identify.base.budget import time_limit as within
from identify.base.errors import FitError, SceneError
from identify.base.progress import Progress
from identify.base.result import CauseResult, SearchTrial, Status
from identify.diagnosis.findings import Findings, held_scores
from identify.diagnosis.fitted import Fitted, fit_beside, fit_model
from identify.diagnosis.quantities import EFFECTS, REACH, Suggestion, held_quantities, in_series, smoothed, suggestion
from identify.diagnosis.score_test import ALIKE, Score, ScoreTable, score_table
from identify.estimation.attempt import Attempt, solve_again
from identify.estimation.covariance import sizes
from identify.estimation.estimator import in_time, note, tracing
from identify.estimation.fit_wording import EXCHANGE, wrong_unit
from identify.estimation.goodness_of_fit import stick_scatter
from identify.estimation.search import SearchProblem, search
from identify.estimation.stick_strength import likeliest, with_strengths
from identify.logs.prepare import Prepared
from identify.logs.segment import sensor_place
from identify.logs.unknowns import Unknowns, stated_rig
from identify.model.model import RIG_PARAMETERS
from identify.scene import Scene
from identify.shooting.shooting import shooting_problem

MISFITS = (Status.MODEL_MISFIT, Status.WRONG_EVENT_COUNT, Status.SOLVER_FAILED)
CLEAR = 16.0  # fall of chi^2 that noise does not reach
REMAINS = 0.1  # share of a misfit that remains to first order where its cause is clear
MATTERS = 0.05  # of its size by which a parameter must move for an answer that fits to be refused
REFITTED = 3  # quantities that are fitted again at most
ROUNDS = 6  # solves with a quantity moved, each from the step of the one before
SETTLED = 0.3  # standard errors: a step that is smaller is the last one
REFIT = "refit of a cause"
REQUIRED_CYCLES = 3  # of a log that an answer has to describe
SENSOR_SHARE = 0.5  # of the time that is left, for a fit with the force measured elsewhere
LISTED, SEEN = 12, 2  # causes in the table; findings of the quality gate that are named


@dataclass(frozen=True)
class _Cause:
    """A quantity fitted again: how far it moved, the standard error of that, the fit and its search space, and what
    looks like it there with how far that would move."""

    score: Score
    size: float
    attempt: Attempt
    unknowns: Unknowns
    error: float
    alike: tuple[tuple[Score, float], ...] = ()

    @property
    def all(self) -> list[tuple[Score, float, float]]:
        """Quantity, move and standard error: its own, then of what looks like it."""
        return [(self.score, self.size, self.error), *((one, size, one.error) for one, size in self.alike)]


def explain(
    findings: Findings, scene: Scene, read: Sequence[Record], prepared: Sequence[Prepared], progress: Progress
) -> Findings:
    """What a fit found, with the most likely cause of a misfit as its first sentence, and refused where it only looks
    right.

    Args:
        read: the records of the scene; prepared: its logs as they are followed.
    """
    attempt, misfits = findings.attempt, findings.status in MISFITS
    refused, taken = "", [log for log in prepared if log.left_out is None]
    swapped = dict.fromkeys(log.entry.path.name for log in prepared if log.judgement.swapped)
    if misfits and swapped and all(log.judgement.swapped for log in taken):
        refused = f"normal force and friction force look swapped in {', '.join(swapped)}; {EXCHANGE}"
    elif misfits and attempt is None:
        refused = wrong_unit(prepared, placed=False) or smoothed(taken, [log.data.force for log in taken])
    elif attempt is not None and findings.status is not Status.AT_BOUND:
        refused = smoothed(attempt.fitted_logs, attempt.solved.fitted)
    if refused:
        return replace(findings, status=Status.MODEL_MISFIT, message=refused, explained=True)
    if misfits and (attempt is None or any(log.unlike for log in prepared)):
        return _unexplained(findings, prepared)
    if attempt is None or not (misfits or findings.status in (Status.CONVERGED, Status.AT_BOUND)):
        return findings
    progress("looking for what is wrong", 0.95)
    return _with_cause(findings, scene, read, Fitted(scene, findings.unknowns, tuple(prepared), attempt))


def sensor_elsewhere(
    scene: Scene, read: Sequence[Record], prepared: Sequence[Prepared], unknowns: Unknowns
) -> Findings | None:
    """Findings that the force was measured elsewhere than the scene says: the drops of the logs look so (jumps under a
    counterface, none at the drive), and a fit with the other sensor confirms it. Else None."""
    each = np.array([log.jumps for log in prepared if log.left_out is None or log.never_slips] or [(0, 0)])
    count, drops = each.sum(axis=0).tolist()
    place = sensor_place(count, drops)
    if place is None or place == scene.rig.force_sensor:
        return None
    began = now()
    with tracing(apart=True), within(SENSOR_SHARE * seconds_left()):
        refit = fit_model(replace(scene, rig=replace(scene.rig, force_sensor=place)), read, thorough=True)
    note(SearchTrial(f"{REFIT}: force_sensor", (), "examined", None, round(now() - began, 4)))
    if refit.attempt is None or not refit.attempt.fits:
        return None
    solved, at = refit.attempt.solved, replace(unknowns, start=refit.attempt.solved.theta)
    stated = shooting_problem([log.data for log in refit.attempt.fitted_logs], solved.trajectories, at, solved.grid)
    squares = 2.0 * stated.evaluate(stated.start, derivatives=False).cost / max(stated.samples, 1)
    cause = CauseResult("force_sensor", None, 1, squares * stated.samples - refit.excess, None, count / drops, None)
    where = "by a plate under the counterface" if place == "counterface" else "between drive and mass"
    message = (
        f"a force measured {where} ({count} of {drops} drops are jumps) explains the misfit within the noise: "
        f'force_sensor = "{place}" under [rig]; as stated the model does not describe these data (misfit {squares:.3g} '
        "times the noise variance there)"
    )
    return Findings(Status.MODEL_MISFIT, message, unknowns, causes=(cause,), explained=True)


def takes_misfit(attempt: Attempt, unknowns: Unknowns) -> bool:
    """Whether one quantity that was stated takes all but REMAINS of a misfit away, to first order, or sticks contradict
    it where no motion of the model was met."""
    solved = attempt.solved
    misfit = (attempt.gate.chi2_per_sample - 1.0) * solved.problem.samples  # also where the solver left the model
    if not np.isfinite(attempt.excess) and _of_sticks(attempt, unknowns).scores:
        return True
    scores = score_table(solved, held_quantities(attempt, unknowns)).scores if np.isfinite(misfit) else ()
    return bool(scores) and scores[0].score > (1.0 - REMAINS) * misfit


def _of_sticks(attempt: Attempt, unknowns: Unknowns) -> ScoreTable:
    """The scores of force and drive speed of single logs by their sticks, which rise at stiffness times drive speed,
    whatever the slips do: all that is known before a motion of the model was met, where other scores mean nothing."""
    columns = {column.name: column for column in held_quantities(attempt, unknowns)}
    still, scores = np.zeros(np.count_nonzero(unknowns.free)), list[Score]()
    for place, log in enumerate(attempt.fitted_logs):
        slopes, rise = log.segmentation.stick_slopes, log.segmentation.stick_slope
        if rise is None or not log.judgement.slope_errors or slopes.size < REQUIRED_CYCLES:
            continue
        step = float(np.log1p(log.judgement.slope_errors[0]))
        error = max(1.25 * rise[1] / float(np.sqrt(slopes.size)), 1e-6)  # of a median
        if (step / error) ** 2 > CLEAR:
            of_log = (columns["force_gain"], columns["drive_speed"])
            scores += [Score(column, place, (step / error) ** 2, step, error, still) for column in of_log]
    scores.sort(key=lambda score: -score.score)
    same = np.array([[one.log == other.log for other in scores] for one in scores])
    inverse = np.array([1.0 / one.error for one in scores])
    return ScoreTable(tuple(scores), same * np.outer(inverse, inverse))


def _of_alike_sticks(ended: Fitted) -> tuple[Fitted, float]:
    """The fit with sticks that are all alike, and by how much strengths of their own make the logs likelier, in
    2 ln(likelihood). These take up what a wrong statement does to slips: what explains the logs as well is asked there.
    """
    attempt = ended.attempt
    assert attempt is not None
    sd = attempt.fitted_logs[0].data.strength_sd
    if not sd > 0.0:
        return ended, 0.0
    alike = replace(attempt, fitted_logs=tuple(with_strengths(attempt.fitted_logs, 0.0)))
    solved = solve_again(alike, replace(ended.unknowns, start=attempt.solved.theta))
    prepared = tuple(with_strengths(ended.prepared, 0.0))
    return replace(ended, prepared=prepared, attempt=solved), likeliest(attempt.solved, sd)[1]


def _with_cause(findings: Findings, scene: Scene, read: Sequence[Record], ended: Fitted) -> Findings:
    """The findings with the cause that the score test names, where setting it free confirms it."""
    assert ended.attempt is not None
    fits, scores = ended.attempt.fits or ended.fits, findings.scores
    ended, scatter = _of_alike_sticks(ended) if fits else (ended, 0.0)
    attempt, unknowns = ended.attempt, ended.unknowns
    assert attempt is not None
    table = scores if scores is not None and attempt is findings.attempt else held_scores(attempt, unknowns)
    if not np.isfinite(attempt.excess) and (of_sticks := _of_sticks(attempt, unknowns)).scores:
        table = of_sticks
    # First one of each class, by its highest score, and of a class that which has to move least for what is usual.
    classes = [sorted(some, key=lambda one: abs(one.step) / one.column.usual) for some in table.classes(CLEAR)]
    # Beside an answer that fits already a cause has to fit clearly better, or as well as a scatter of sticks.
    clearly = CLEAR * attempt.inflation
    enough = attempt.excess - max(clearly, scatter - clearly) if fits else np.inf
    causes, tries = list[_Cause](), 0
    while classes:
        some = classes.pop(0)
        if not some:
            continue
        score = some.pop(0)
        # What passes as autocorrelated noise may yet be a misfit that another cause has not.
        settled = any(replace(ended, attempt=cause.attempt).fits for cause in causes)
        as_likely = score.score > ALIKE**2 * table.scores[0].score
        if tries == REFITTED or (settled and not as_likely) or not in_time(REFIT):
            break
        if any(score.key == one.key for cause in causes for one, _ in cause.alike):
            classes.append(some)
            continue
        tries, began = tries + 1, now()
        with tracing(apart=True):
            with_effect = score.column.name in EFFECTS
            cause = _with_effect(scene, read, ended, score) if with_effect else _refitted(ended, score)
        note(SearchTrial(f"{REFIT}: {score.column.name}", (), "examined", None, round(now() - began, 4)))
        # What takes nearly all of a misfit is of the right class: the next of that is tried before the other classes.
        near = cause is not None and cause.attempt.excess < REMAINS * attempt.excess
        classes.insert(0 if near else len(classes), some)
        if cause is not None and cause.attempt.fits and cause.attempt.excess < enough:
            unsure = with_effect or cause.score.column.change is None  # its error is that of the score before
            if unsure or abs(cause.size) > np.sqrt(CLEAR) * cause.error:
                causes.append(cause)
            else:  # it stays as stated: the search had stopped at another optimum
                of_it = np.array(unknowns.names) == cause.score.column.name
                findings = replace(findings, restart=np.where(of_it, attempt.solved.theta, cause.attempt.solved.theta))
                break
    causes.sort(key=lambda cause: cause.attempt.excess)
    causes = [each for each in causes if each.attempt.excess < causes[0].attempt.excess + CLEAR]
    rows = _rows(scene, attempt, unknowns, table, causes)
    findings = replace(findings, causes=rows, explained=bool(causes))
    if causes:
        return _caused(findings, scene, causes, attempt.excess, fits=fits)
    return _unexplained(findings, ended.prepared) if findings.status in MISFITS else findings


def _refitted(ended: Fitted, score: Score) -> _Cause | None:
    """The fit with a quantity where the data want it: a parameter set free, anything else moved in steps, each from the
    score at the answer before; None where that leads to no answer of the same logs, or farther off than any statement.
    """
    best, unknowns, column, step, size = ended.attempt, ended.unknowns, score.column, score, 0.0
    assert best is not None
    others = [c for c in held_quantities(best, unknowns) if c.name != column.name]
    origin, theta = best.solved.theta, best.solved.theta.copy()
    theta[np.flatnonzero(unknowns.free)] += score.shift
    for number in range(ROUNDS):
        if column.name in unknowns.names and number == 0:
            i = unknowns.names.index(column.name)
            best = _set_free(ended, score, i)
            stated = unknowns.prior_mean[i] if column.prior else origin[i]
            size = float(best.solved.theta[i] - stated)
            if not set(best.log_numbers) >= set(ended.logs) or not np.isfinite(best.excess):
                return None
            if column.change is None:
                return _Cause(score, size, best, unknowns, score.error)
            theta = np.where(np.arange(origin.size) == i, origin, best.solved.theta)
        else:
            size = float(np.clip(size + step.step, -column.most, column.most))
        logs, fitted = list(ended.prepared), list(best.fitted_logs)
        for place, (log, curve) in enumerate(zip(best.log_numbers, best.solved.fitted, strict=True)):
            if column.change is not None and score.log in (None, place):
                data, cut = column.change(logs[log].data, curve, 0.0, size), best.fitted_logs[place].data
                logs[log] = replace(logs[log], data=data)
                fitted[place] = replace(fitted[place], data=replace(data, begin=cut.begin, end=cut.end))
        start = replace(unknowns, start=np.clip(theta, unknowns.lower, unknowns.upper))
        met = np.isfinite(best.excess)  # else there is no motion to go on from
        found = solve_again(replace(best, fitted_logs=tuple(fitted)), start) if met else best
        if not found.solved.solution.success:
            other, _ = search(SearchProblem(logs, unknowns, thorough=False))
            found = found if other is None or other.log_numbers != best.log_numbers else other
        table = score_table(found.solved, [replace(column, at=size), *others], found.inflation)
        keys = [one.key for one in table.scores]
        if score.key not in keys or not np.isfinite(found.excess):
            return None
        best, theta, mine = found, found.solved.theta, keys.index(score.key)
        step = table.scores[mine]
        if abs(step.step) < SETTLED * step.error or number == ROUNDS - 1:
            ratio = table.information[mine] / np.diag(table.information)
            near = np.flatnonzero(np.abs(table.correlation[mine]) > ALIKE).tolist()
            # Of another set of logs, which log a score is of says nothing here.
            same = best.log_numbers == ended.logs
            others_alike = [j for j in near if j != mine and (same or table.scores[j].log is None)]
            alike = tuple((table.scores[j], float(size * ratio[j])) for j in others_alike)
            return _Cause(score, size, best, unknowns, step.error, alike) if abs(size) < column.most else None
    return None


def _with_effect(scene: Scene, read: Sequence[Record], ended: Fitted, score: Score) -> _Cause | None:
    """The fit with the effect that brings a quantity; None where that is of other logs."""
    effect, name = EFFECTS[score.column.name]
    more = scene.with_effects((*scene.effects, effect))
    spec = more.parameters[name]
    start = float(np.clip(score.step, spec.lower, spec.upper))
    parameters = {**more.parameters, name: replace(spec, fixed=None, start=start)}
    if effect == "load_dependence":
        at = float(np.mean([log.data.mean_normal_force for log in ended.prepared]))
        parameters["reference_force"] = replace(parameters["reference_force"], fixed=at)
    more = replace(more, parameters=parameters)
    try:
        found = fit_beside(ended, more, read)
        if found.attempt is None or not found.attempt.fits:
            found = min(found, fit_model(more, read), key=lambda each: each.excess)
    except (FitError, SceneError):
        return None
    if found.attempt is None or not set(found.logs) >= set(ended.logs) or not np.isfinite(found.excess):
        return None
    i = found.unknowns.names.index(name)
    size = float(found.attempt.solved.theta[i])
    size = float(np.exp(size)) if found.unknowns.logarithmic[i] else size
    return _Cause(score, size, found.attempt, found.unknowns, score.error) if abs(size) < score.column.most else None


def _set_free(ended: Fitted, score: Score, i: int) -> Attempt:
    """The fit with parameter i free, whatever the scene says of it: from the data, and where that does not fit from
    where the score points."""
    attempt, unknowns = ended.attempt, ended.unknowns
    assert attempt is not None
    before, declared = float(attempt.solved.theta[i]), unknowns.model.parameters[i]
    with np.errstate(divide="ignore"):
        ends = np.array([declared.lower, declared.upper])
        low, high = np.log(ends) if declared.scale == "log" else ends
    if declared.name in RIG_PARAMETERS:
        low, high = before - REACH, before + REACH
    at = np.arange(unknowns.free.size) == i
    freed = replace(
        unknowns,
        free=unknowns.free | at,
        start=np.where(at, np.clip(before + score.step, low, high), unknowns.start),
        lower=np.where(at, low, unknowns.lower),
        upper=np.where(at, high, unknowns.upper),
        prior_sd=np.where(at, np.inf, unknowns.prior_sd),
        prior_about=np.where(at, -1, unknowns.prior_about),
        user_bounds=unknowns.user_bounds & ~at,
    )
    found, _ = search(SearchProblem(list(ended.prepared), freed, thorough=False))
    if found is not None and found.fits:
        return found
    theta = attempt.solved.theta.copy()
    theta[np.flatnonzero(unknowns.free)] += score.shift
    theta[i] = before + score.step
    other = solve_again(attempt, replace(freed, start=np.clip(theta, freed.lower, freed.upper)))
    return other if found is None or other.excess < found.excess else found


# How it is said.


def _caused(findings: Findings, scene: Scene, causes: Sequence[_Cause], excess: float, *, fits: bool) -> Findings:
    """The findings of a fit whose cause is known, that first; excess: of the fit as all was stated, of sticks that are
    alike."""
    attempt, best = findings.attempt, causes[0]
    assert attempt is not None
    named: dict[str, Suggestion] = {}
    for cause in causes:
        asked = [suggestion(scene, attempt, findings.unknowns, *each) for each in cause.all]
        series = [softer for each in asked if (softer := in_series(scene, each)) is not None]
        named |= {each.words: each for each in (*asked, *series)}
    apart = ", which these data cannot distinguish" if len(named) > 1 else ""
    words, remedies = ", or ".join(named), "; or ".join(dict.fromkeys(each.remedy for each in named.values()))
    if not fits:
        message = (
            f"{words}{apart and f'{apart},'} explains the misfit within the noise: {remedies}; as stated the model "
            f"does not describe these data (misfit {attempt.gate.chi2_per_sample:.3g} times the noise variance)"
        )
        return replace(findings, status=Status.MODEL_MISFIT, message=message)
    # The parameter that moves most for its size, of those the data determine.
    unknowns, rig = findings.unknowns, stated_rig(scene)
    before, after = (
        dict(zip(u.names, u.values(a.solved.theta, u.base(rig)).tolist(), strict=True))
        for u, a in ((unknowns, attempt), (best.unknowns, best.attempt))
    )
    known = {e.name for e in findings.estimates if e.verdict in ("identified", "weak")} - {best.score.column.name}
    size = dict(zip(before, sizes(unknowns, np.array(list(before.values()))).tolist(), strict=True))
    moves = [(abs(after[name] - before[name]) / max(size[name], 1e-300), name) for name in known]
    moved, name = max(moves, default=(0.0, ""))
    fall = f"chi^2 falls by {(excess - best.attempt.excess) / attempt.inflation:.3g}"
    fall += f", and {name} moves by {100.0 * moved:.2g} %" if name else ""
    beside = ", as with static friction that differs from stick to stick" if stick_scatter(attempt.solved) else ""
    message = f"the fit is better with {words}{apart}{beside}: {remedies} ({fall}); {findings.message}"
    refused = moved > MATTERS and findings.status is Status.CONVERGED
    return replace(findings, status=Status.MODEL_MISFIT if refused else findings.status, message=message)


def _rows(
    scene: Scene, attempt: Attempt, unknowns: Unknowns, table: ScoreTable, causes: Sequence[_Cause]
) -> tuple[CauseResult, ...]:
    """The scores that noise does not explain, as the result lists them: causes first, with their refitted values."""
    known = {score.key: (size, error) for cause in causes for score, size, error in cause.all}
    named = {cause.score.key for cause in causes}
    classes = sorted(table.classes(CLEAR), key=lambda some: not any(one.key in named for one in some))
    out = []
    for number, some in enumerate(classes, 1):
        for one in sorted(some, key=lambda each: each.key not in named):
            asked = suggestion(scene, attempt, unknowns, one, *known.get(one.key, (one.step, one.error)))
            values = asked.stated, asked.suggested, asked.standard_error
            out.append(CauseResult(asked.quantity, asked.log, number, one.score, *values))
    return tuple(out[:LISTED])


def _unexplained(findings: Findings, prepared: Sequence[Prepared]) -> Findings:
    """A misfit that nothing explains that was stated, with what the quality gate saw before the fit."""
    seen = dict[str, str]()
    for log in prepared:
        for finding in log.judgement.findings if log.left_out is None else ():
            if finding.severity != "info":
                seen.setdefault(finding.code, f"{log.entry.path.name}: {finding.message}")
    before = f"; findings before the fit: {'; '.join(list(seen.values())[:SEEN])}" if seen else ""
    return replace(findings, message=f"{findings.message}{before}")
