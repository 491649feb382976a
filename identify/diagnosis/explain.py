"""Why a fit misfits, or why an answer that fits is none to rely on: the most likely cause, with its number and remedy.

The score test ranks all that the fit took as stated. What leads is set free and fitted again, for its value, and to see
whether it does explain the data: a cause is named only where it does, together with what these data do not tell apart
from it. Where it does not, or the next one is as likely, that is fitted again too. The other scores are a table.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.base.errors import FitError, SceneError
from identify.base.outcome import Status
from identify.base.progress import Progress
from identify.base.result import CauseResult
from identify.base.wording import START_VALUES
from identify.diagnosis.findings import Findings
from identify.diagnosis.fitted import Fitted, fit_beside, fit_model
from identify.diagnosis.quantities import (
    EFFECTS,
    REACH,
    Suggestion,
    held_quantities,
    in_series,
    smoothed,
    suggestion,
    unknowns_of,
)
from identify.diagnosis.score_test import ALIKE, Column, Score, ScoreTable, score_table
from identify.estimation.attempt import Attempt, solve_again, solve_from
from identify.estimation.covariance import sizes
from identify.estimation.fit_wording import EXCHANGE, wrong_unit
from identify.estimation.influence import largest_inflation, noise_of
from identify.estimation.search import SearchProblem, required_logs, search
from identify.estimation.strategies import Strategy, as_one_trial, may_run
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns, stated_rig
from identify.model.model import RIG_PARAMETERS
from identify.prediction.wording import listed
from identify.scene import Scene

Array = NDArray[np.float64]

MISFITS = (Status.MODEL_MISFIT, Status.WRONG_EVENT_COUNT, Status.SOLVER_FAILED)
CLEAR = 16.0  # fall of chi^2 that noise does not reach
REMAINS = 0.1  # share of a misfit that may remain where its cause is named
MATTERS = 0.05  # of its size by which a parameter must move for an answer that fits to be refused
REFITTED = 3  # quantities that are fitted again at most
ROUNDS = 6  # solves with a quantity moved, each from the step of the one before
SETTLED = 0.3  # standard errors: a step that is smaller is the last one
AUTOCORRELATED = 2.0  # samples that count as one: noise that a treatment of the signal may have left
LISTED, SEEN = 12, 2  # causes in the table; findings of the quality gate that are named


@dataclass(frozen=True)
class _Cause:
    """A quantity set free and fitted again: how far it moved, the standard error of that, the fit, the search that this
    was of, and what looks like it there with how far that would move."""

    score: Score
    size: float
    attempt: Attempt
    unknowns: Unknowns
    error: float = np.inf
    alike: tuple[tuple[Score, float], ...] = ()

    @property
    def all(self) -> list[tuple[Score, float, float]]:
        """Quantity, move and standard error: its own, then of what looks like it."""
        return [(self.score, self.size, self.error), *((one, size, one.error) for one, size in self.alike)]


def explain(
    findings: Findings, scene: Scene, read: Sequence[Record], prepared: Sequence[Prepared], progress: Progress
) -> tuple[Findings, Attempt | None]:
    """What a fit found, with the most likely cause of a misfit as its first sentence, and refused where it only looks
    right; and a better answer of the same model that was met on the way, None without one.

    Args:
        read: the records of the scene; prepared: the logs as they are followed.
    """
    attempt = findings.attempt
    refused, taken = "", [log for log in prepared if log.left_out is None]
    if findings.status in MISFITS:
        others = [log for log in taken if not log.judgement.swapped]
        swapped = dict.fromkeys(log.entry.path.name for log in prepared if log.judgement.swapped)
        if swapped and not others:
            refused = f"normal force and friction force look swapped in {', '.join(swapped)}; {EXCHANGE}"
        elif attempt is None:
            refused = wrong_unit(prepared, placed=False) or smoothed(taken, [log.data.force for log in taken])
    if attempt is not None and not refused and findings.status is not Status.AT_BOUND:
        refused = smoothed(attempt.fitted_logs, attempt.solved.fitted)
    if refused:
        return replace(findings, status=Status.MODEL_MISFIT, message=refused), None
    if findings.status in MISFITS:
        if attempt is None or any(log.unlike for log in prepared):
            return _unexplained(findings, prepared), None
    elif attempt is None or findings.status not in (Status.CONVERGED, Status.AT_BOUND) or not _doubtful(findings):
        return findings, None
    progress("looking for what is wrong", 0.95)
    return _with_cause(findings, scene, read, Fitted(scene, findings.unknowns, tuple(prepared), attempt))


def _doubtful(findings: Findings) -> bool:
    """Whether what fits is looked at again: the data contradict the rig as it was stated, noise is autocorrelated,
    friction rises with the sliding speed, which is rare and what a lagging sensor makes of friction that falls, or the
    scene says something of a parameter."""
    unknowns, attempt = findings.unknowns, findings.attempt
    assert attempt is not None
    change = next((e.value for e in findings.estimates if e.name == "delta_mu_k" and e.verdict != "fixed"), None)
    friction = np.array([p.kind == "friction" for p in unknowns.model.parameters])
    theta, near = attempt.solved.theta, 1e-6 * unknowns.spread
    sits = (theta - unknowns.lower < near) & unknowns.walls[0] | (unknowns.upper - theta < near) & unknowns.walls[1]
    stated = (~unknowns.free | np.isfinite(unknowns.prior_sd) | sits) & friction
    return bool(
        any(held.contradicted for held in findings.held)
        or (change is not None and change > 0.0)
        or np.any(stated)
        or any(model.inflation > AUTOCORRELATED for model in (findings.sure.noise if findings.sure else ()))
    )


def _with_cause(
    findings: Findings, scene: Scene, read: Sequence[Record], ended: Fitted
) -> tuple[Findings, Attempt | None]:
    """The findings with the cause that the score test names, where setting it free confirms it."""
    attempt, unknowns = ended.attempt, ended.unknowns
    assert attempt is not None
    fits = attempt.fits or ended.fits
    table = _scores(attempt, held_quantities(attempt, unknowns))
    if table is None:
        return _unexplained(findings, ended.prepared), None
    # First one of each class, by its highest score, and of a class that which has to move least for what is usual.
    classes = [sorted(some, key=lambda one: abs(one.step) / one.column.usual) for some in table.classes(CLEAR)]
    ordered = [one for row in zip_longest(*classes) for one in row if one is not None]
    causes, tries = list[_Cause](), 0
    for score in ordered:
        # What passes as autocorrelated noise may yet be a misfit that another cause has not.
        settled = any(replace(ended, attempt=cause.attempt).fits for cause in causes)
        as_likely = score.score > ALIKE**2 * table.scores[0].score
        if tries == REFITTED or (settled and not as_likely) or not may_run(Strategy.CAUSES):
            break
        if any(score.key == one.key for cause in causes for one, _ in cause.alike):
            continue
        tries += 1
        with as_one_trial(Strategy.CAUSES, score.column.name):
            cause = _refitted(scene, read, ended, score)
        if cause is None:
            continue
        # Of an answer that fits already it has to fit clearly better, else to leave little of the misfit.
        clearly = attempt.excess - CLEAR * _inflation(attempt) if fits else REMAINS * attempt.excess
        if not (cause.attempt.excess < clearly or (cause.attempt.fits and not fits)):
            continue
        cause = _with_alike(cause, {one.column.name for one in table.scores})
        if (better := _as_stated(cause, ended)) is not None:
            return findings, better
        causes.append(cause)
    causes.sort(key=lambda cause: cause.attempt.excess)
    causes = [each for each in causes if each.attempt.excess < causes[0].attempt.excess + CLEAR]
    rows = _rows(scene, attempt, unknowns, table, causes)
    findings = replace(findings, causes=rows, explained=bool(causes))
    if causes:
        return _caused(findings, scene, causes, fits=fits), None
    return _unexplained(findings, ended.prepared) if findings.status in MISFITS else findings, None


def _scores(attempt: Attempt, columns: Sequence[Column], held: Sequence[int] = ()) -> ScoreTable | None:
    """The scores at an attempt; None where its optimality conditions are singular."""
    try:
        return score_table(attempt.solved, columns, _inflation(attempt), held)
    except np.linalg.LinAlgError:
        return None


def _inflation(attempt: Attempt) -> float:
    return largest_inflation(attempt, noise_of(attempt))


# ----------------------------------------------------------------------------------------------------------------------
# What leads, set free: a parameter of the model among the others, anything else by steps, each from the score at the
# answer with the step before.
# ----------------------------------------------------------------------------------------------------------------------


def _refitted(scene: Scene, read: Sequence[Record], ended: Fitted, score: Score) -> _Cause | None:
    """None where that leads to no answer of the same logs, or farther off than any statement is."""
    if score.column.name in ended.unknowns.names:
        cause = _set_free(ended, score)
    elif score.column.name in EFFECTS:
        cause = _with_effect(scene, read, ended, score)
    else:
        cause = _moved(ended, score)
    if cause is None or not np.isfinite(cause.attempt.excess) or not abs(cause.size) < score.column.most:
        return None
    return cause if set(cause.attempt.log_numbers) >= set(ended.logs) else None


def _set_free(ended: Fitted, score: Score) -> _Cause | None:
    """The fit with a parameter free, whatever the scene says of it: from the data, and where that does not fit from
    where the score points."""
    attempt, unknowns = ended.attempt, ended.unknowns
    assert attempt is not None
    i = unknowns.names.index(score.column.name)
    before, declared = float(attempt.solved.theta[unknowns.source[i]]), unknowns.model.parameters[i]
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
        walls=unknowns.walls & ~at,
        ties=tuple(tie for tie in unknowns.ties if tie[0] != i),
    )
    found, _ = search(SearchProblem(list(ended.prepared), freed, thorough=False))
    if found is None or not found.fits:
        theta = attempt.solved.theta.copy()
        theta[np.flatnonzero(unknowns.free)] += score.shift
        theta[i] = before + score.step
        other = solve_again(attempt, replace(freed, start=np.clip(theta, freed.lower, freed.upper)))
        found = other if found is None or other.excess < found.excess else found
    stated = float(unknowns.prior_mean[i]) if score.column.prior else before
    return _Cause(score, float(found.solved.theta[i]) - stated, found, freed)


def _with_effect(scene: Scene, read: Sequence[Record], ended: Fitted, score: Score) -> _Cause | None:
    """The fit with the effect that brings a quantity."""
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
    if found.attempt is None:
        return None
    size = float(found.attempt.solved.theta[found.unknowns.names.index(name)])
    logarithmic = found.unknowns.model.parameter(name).scale == "log"
    return _Cause(score, float(np.exp(size)) if logarithmic else size, found.attempt, found.unknowns)


def _moved(ended: Fitted, score: Score) -> _Cause | None:
    """The fit with a quantity that is none of the model moved, from step to step."""
    best, unknowns, column = ended.attempt, ended.unknowns, score.column
    assert best is not None and column.change is not None
    size = float(np.clip(score.step, -column.most, column.most))
    theta = best.solved.theta.copy()
    theta[np.flatnonzero(unknowns.free)] += score.shift * size / score.step
    at = replace(unknowns, start=np.clip(theta, unknowns.lower, unknowns.upper))
    for _ in range(ROUNDS):
        logs, fitted = list(ended.prepared), list(best.fitted_logs)
        for place, (number, curve) in enumerate(zip(best.log_numbers, best.solved.fitted, strict=True)):
            if score.log in (None, place):
                data = column.change(logs[number].data, curve, 0.0, size)
                cut = best.fitted_logs[place].data
                logs[number] = replace(logs[number], data=data)
                fitted[place] = replace(fitted[place], data=replace(data, begin=cut.begin, end=cut.end))
        found = solve_again(replace(best, fitted_logs=tuple(fitted)), at)
        if not found.solved.solution.success:
            other, _ = search(SearchProblem(logs, unknowns, thorough=False))
            found = found if other is None or other.log_numbers != found.log_numbers else other
        if not np.isfinite(found.excess):
            return None
        best, at = found, replace(at, start=found.solved.theta)
        again = _scores(best, [replace(column, at=size)])
        step = next((one for one in again.scores if one.log == score.log), None) if again is not None else None
        if step is None:
            return None
        if abs(step.step) < SETTLED * step.error:
            break
        size = float(np.clip(size + step.step, -column.most, column.most))
    return _Cause(score, size, best, unknowns)


def _with_alike(cause: _Cause, names: set[str]) -> _Cause:
    """A cause with the standard error of its quantity, and which of some quantities look like that at its answer, where
    the model describes the data."""
    attempt, unknowns, name, size, unit = cause.attempt, cause.unknowns, cause.score.column.name, cause.size, 1.0
    name = EFFECTS.get(name, ("", name))[1]
    held: tuple[int, ...] = ()
    if name in unknowns.names:
        i = unknowns.names.index(name)
        held = unknowns_of(attempt, i)
        if cause.score.column.name in EFFECTS and unknowns.logarithmic[i]:
            size, unit = 1.0, cause.size  # its column is of the logarithm, of which nothing is no value
        unknowns = replace(unknowns, free=unknowns.free & (np.arange(unknowns.free.size) != i))
    table = _scores(attempt, held_quantities(attempt, unknowns), held)
    of = [] if table is None else [one.key for one in table.scores]
    if table is None or (name, cause.score.log) not in of:
        return cause
    mine = of.index((name, cause.score.log))
    ratio = table.information[mine] / np.diag(table.information)
    near = np.flatnonzero(np.abs(table.correlation[mine]) > ALIKE).tolist()
    # Of loads that are moved apart an exponent and zeros look like the gain of one: they were no quantities before.
    near = [j for j in near if j != mine and table.scores[j].column.name in names]
    alike = tuple((table.scores[j], float(size * ratio[j])) for j in near)
    return replace(cause, error=unit * table.scores[mine].error, alike=alike)


def _as_stated(cause: _Cause, ended: Fitted) -> Attempt | None:
    """The answer of the model as it is stated that lies beside a cause, where that is nearer to the data than the one
    that was found: the misfit was the search's, and what was set free only led elsewhere."""
    attempt, unknowns = ended.attempt, ended.unknowns
    assert attempt is not None
    beside = cause.attempt.excess + _inflation(cause.attempt) * (cause.size / cause.error) ** 2
    if not beside < 0.5 * attempt.excess:
        return None
    theta = dict(zip(cause.unknowns.names, cause.attempt.solved.theta.tolist(), strict=True))
    start = np.where(unknowns.free, [theta[name] for name in unknowns.names], unknowns.start)
    at = replace(unknowns, start=np.clip(start, unknowns.lower, unknowns.upper))
    back = solve_from(list(ended.prepared), list(attempt.log_numbers), at)
    if back is None or not set(back.log_numbers) >= set(attempt.log_numbers):
        return None
    return back if back.excess < 0.5 * attempt.excess else None


# ----------------------------------------------------------------------------------------------------------------------
# How it is said.
# ----------------------------------------------------------------------------------------------------------------------


def _caused(findings: Findings, scene: Scene, causes: Sequence[_Cause], *, fits: bool) -> Findings:
    """The findings of a fit whose cause is known, that first."""
    attempt, best = findings.attempt, causes[0]
    assert attempt is not None
    named: dict[str, Suggestion] = {}
    for cause in causes:
        asked = [suggestion(scene, attempt, findings.unknowns, *each) for each in cause.all]
        series = [softer for each in asked if (softer := in_series(scene, each)) is not None]
        named |= {each.words: each for each in (*asked, *series)}
    apart = ", which these data cannot tell apart" if len(named) > 1 else ""
    words, remedies = ", or ".join(named), "; or ".join(dict.fromkeys(each.remedy for each in named.values()))
    if not fits:
        share = f"but for {100.0 * max(best.attempt.excess, 0.0) / attempt.excess:.2g} % of it"
        message = (
            f"{words}{apart and f'{apart},'} explains the misfit {'within the noise' if best.attempt.fits else share}: "
            f"{remedies}; as stated the model does not describe these data (misfit {attempt.gate.chi2_per_sample:.3g} "
            "times the noise variance)"
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
    fall = f"chi^2 falls by {(attempt.excess - best.attempt.excess) / _inflation(attempt):.3g}"
    fall += f", and {name} moves by {100.0 * moved:.2g} %" if name else ""
    message = f"the data ask for {words}{apart}: {remedies} ({fall}); {findings.message}"
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
    attempt, seen = findings.attempt, dict[str, str]()
    missing = [] if attempt is None else [i for i in required_logs(prepared) if i not in attempt.log_numbers]
    # An attempt that was taken over from another model has the tests of that.
    if missing and attempt is not None and attempt.with_solved(attempt.solved).fits:
        names = listed([prepared[i].name for i in missing])
        message = (
            f"no answer of all logs was found: that of the others does not stick-slip as {names} does, and nothing "
            f"that was stated stands out in them: check what [[logs]] says of {names}, fit it alone, or {START_VALUES}"
        )
        return replace(findings, status=Status.SOLVER_FAILED, message=message)
    for log in prepared:
        for finding in log.judgement.findings if log.left_out is None else ():
            if finding.severity != "info":
                seen.setdefault(finding.code, f"{log.entry.path.name}: {finding.message}")
    before = f"; before the fit this was seen: {'; '.join(list(seen.values())[:SEEN])}" if seen else ""
    return replace(findings, message=f"{findings.message}{before}")
