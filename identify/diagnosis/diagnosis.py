"""Why a model misfits: one thing at a time that may be wrong with rig or sensor is set free, and what explains the
logs within their noise is named.

A hypothesis explains a misfit where it alone takes it down to noise, or nearly all of it. What explains it is said,
never silently taken over: the answer stays a misfit until the user mends the scene. Where no hypothesis does, it may be
that one log does not agree with the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.base.errors import FitError, SceneError
from identify.base.outcome import Status
from identify.diagnosis.disagreement import ANOTHER_ANSWER, Cause, disagreement, misfits_of_logs
from identify.diagnosis.findings import Findings
from identify.diagnosis.fitted import Fitted, as_it_ended, described, fits
from identify.diagnosis.hypotheses import (
    GROSS,
    SLIGHT,
    Hypothesis,
    found_and_stated,
    log_speeds,
    restraints,
    sitting,
    ties,
)
from identify.diagnosis.nested import fit_beside, fit_from_values, fit_larger, fit_model, fit_smaller
from identify.estimation.agreement import contradiction, influence_at, largest_inflation, log_scores
from identify.estimation.attempt import Attempt, retested
from identify.estimation.covariance import sizes
from identify.estimation.strategies import Strategy, as_one_trial, may_run
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns, stated_rig
from identify.model.model import RIG_PARAMETERS
from identify.scene import Scene

# ----------------------------------------------------------------------------------------------------------------------
# Whether a fit leaves nothing to complain of: every cycle is described, and no log contradicts the others.
# ----------------------------------------------------------------------------------------------------------------------


def nothing_amiss(fitted: Fitted, scene: Scene, memory: float) -> bool:
    """Whether a fit passes the gate by itself, and its logs agree.

    Args:
        scene: whose rig the values are given for; memory: by how much that of the noise widens a variance.
    """
    if fitted.attempt is None or retested(fitted.attempt).gate.status is not Status.CONVERGED:
        return False
    solved, names = fitted.attempt.solved, [log.name for log in fitted.attempt.fitted_logs]
    try:
        found = log_scores(solved.problem, solved.solution.z, influence_at(solved), memory)
    except np.linalg.LinAlgError:  # directions that no log tells
        return False
    return not contradiction(found, fitted.unknowns, solved.theta, fitted.unknowns.base(stated_rig(scene)), names)


# ----------------------------------------------------------------------------------------------------------------------
# A value that no fit can search, a drive speed say, taken where the misfit is least: a parabola through three fits.
# ----------------------------------------------------------------------------------------------------------------------

STEP = 0.01  # of the value: about how well sticks tell it
FARTHEST = 3.0  # of these steps that it is moved


def refined(hypothesis: Hypothesis, fitted: Fitted, fit: Callable[[Fitted, Scene], Fitted]) -> Fitted:
    """The fit with the value of a hypothesis where the misfit is least, near the one it was given; the fit as it is
    where that is nowhere better.

    Args:
        fit: a scene from the values of a fit of one like it.
    """
    nearby = hypothesis.nearby
    if nearby is None or not np.isfinite(fitted.excess):
        return fitted
    low, high = (fit(fitted, nearby(fitted.scene, 1.0 + step)) for step in (-STEP, STEP))
    bend = low.excess - 2.0 * fitted.excess + high.excess
    found = [fitted, low, high]
    if np.isfinite(bend) and bend > 0.0:
        steps = float(np.clip(0.5 * (low.excess - high.excess) / bend, -FARTHEST, FARTHEST))
        found.append(fit(fitted, nearby(fitted.scene, 1.0 + steps * STEP)))
    return min((each for each in found if each.logs == fitted.logs), key=lambda each: each.excess)


Array = NDArray[np.float64]

REMAINS = 0.1  # share of the misfit that may remain for a hypothesis to be named
PROMISING = 0.5  # share that may remain with a value that is only about right
CLEAR = 0.005  # relative change of a rig value below which it is not called wrong
TOLD = 25.0  # likelihood-ratio statistic by which one explanation is better than another
NEAR = 3.0  # sum of squares per sample (in noise variances) up to which hypotheses start from the misfit's values
ASKED = 16.0  # statistic that makes an answer that fits doubtful, where something else does so already
ALIKE = 1e-3  # share of the samples by which fits may differ that are compared: the last stick is cut anew
MATTERS = 0.05  # of its size by which a parameter must move for an answer that fits to be refused


def diagnose(
    scene: Scene,
    records: Sequence[Record],
    prepared: Sequence[Prepared],
    unknowns: Unknowns,
    attempt: Attempt | None,
) -> Cause | None:
    """What alone would explain a misfit; None where nothing does.

    Args:
        scene, records, prepared, unknowns: those of the fit; attempt: where it ended.
    """
    ended = as_it_ended(scene, unknowns, prepared, attempt)
    if fits(ended):
        return None
    found: list[_Explanation] = []
    freed_fits: list[tuple[Hypothesis, Fitted]] = []
    beside = (
        *restraints(scene, sitting(unknowns, attempt)),
        *ties(scene),
        *log_speeds(scene, prepared, misfits_of_logs(ended)),
    )
    if attempt is not None and ended.excess < NEAR * ended.samples:
        tried = _tried((*beside, *SLIGHT), scene, prepared, lambda freed: _from_values(ended, freed, records))
        freed_fits = _refined(tried, ended, records)
        found = _explanations(freed_fits, scene, ended)
    if not found:
        tried = _tried((*beside, *GROSS), scene, prepared, lambda freed: fit_model(freed, records, thorough=False))
        more = _refined(tried, ended, records)
        freed_fits += more
        found = _explanations(more, scene, ended)
    if not found:
        return _as_stated(freed_fits, scene, records, ended) or disagreement(scene, records, ended)
    found.sort(key=lambda each: each.fitted.excess)
    alike = [each for each in found if each.fitted.excess < found[0].fitted.excess + TOLD]
    sentence = "; or ".join(each.words for each in sorted(alike, key=lambda each: not each.restrains))
    return Cause(sentence, _back(found[0].fitted, scene, records, ended))


def _as_stated(
    tried: list[tuple[Hypothesis, Fitted]], scene: Scene, records: Sequence[Record], ended: Fitted
) -> Cause | None:
    """The answer of the model as it is stated, where a hypothesis describes the logs and is no explanation, having the
    value that is stated; None where there is none."""
    led = [fitted for _, fitted in tried if fits(fitted) and set(fitted.logs) >= set(ended.logs)]
    if not led:
        return None
    better = _back(min(led, key=lambda each: each.excess), scene, records, ended)
    return None if better is None else Cause(ANOTHER_ANSWER, better)


def _back(freed: Fitted, scene: Scene, records: Sequence[Record], ended: Fitted) -> Attempt | None:
    """The answer of the model as it is stated, from the fit of a hypothesis, where it is nearer to the data: what was
    set free may explain nothing but have led the search elsewhere."""
    back = fit_beside(freed, scene, records)
    return back.attempt if _is_nearer(back, ended) else None


def _from_values(ended: Fitted, freed: Scene, records: Sequence[Record]) -> Fitted:
    """The model with one thing more free, from the values of the answer; where the solver loses its way from there, in
    small steps."""
    fitted = fit_from_values(ended, freed, records)
    if fitted.attempt is not None and fitted.attempt.solved.solution.success:
        return fitted
    slowly = fit_from_values(ended, freed, records, slowly=True)
    return slowly if slowly.excess < fitted.excess else fitted


def _is_nearer(back: Fitted, ended: Fitted) -> bool:
    """Whether another answer of the same model lies so much nearer to the data that it is to be looked into: it leaves
    out none of the logs, and may describe more."""
    worth = max(TOLD, REMAINS * ended.excess)
    return back.attempt is not None and set(back.logs) >= set(ended.logs) and ended.excess - back.excess > worth


def _tried(
    hypotheses: Sequence[Hypothesis], scene: Scene, prepared: Sequence[Prepared], fit: Callable[[Scene], Fitted]
) -> list[tuple[Hypothesis, Fitted]]:
    """Every hypothesis with what came of its fit, done in that way, where there is an answer."""
    out = []
    for hypothesis in hypotheses:
        fitted = None
        if not may_run(Strategy.HYPOTHESES):
            break
        try:
            freed = hypothesis.freed(scene, prepared)
            if freed is not None:
                with as_one_trial(Strategy.HYPOTHESES, hypothesis.parameter):
                    fitted = fit(freed)
        except (FitError, SceneError):
            continue
        if fitted is not None and fitted.attempt is not None:
            out.append((hypothesis, fitted))
    return out


def _refined(
    tried: list[tuple[Hypothesis, Fitted]], ended: Fitted, records: Sequence[Record]
) -> list[tuple[Hypothesis, Fitted]]:
    """Every hypothesis with its fit, of those that promise to explain the misfit with the value that does so best."""
    return [
        (hypothesis, refined(hypothesis, fitted, lambda near, scene: fit_from_values(near, scene, records)))
        if fitted.excess < PROMISING * ended.excess
        else (hypothesis, fitted)
        for hypothesis, fitted in tried
    ]


@dataclass(frozen=True)
class _Explanation:
    """A hypothesis that explains a misfit: the fit with it free, the words that name it, and whether the scene says
    it."""

    fitted: Fitted
    words: str
    restrains: bool


def _explanations(tried: list[tuple[Hypothesis, Fitted]], scene: Scene, ended: Fitted) -> list[_Explanation]:
    """Every hypothesis that explains a misfit, in all its logs: without one of them less is left in any case. What is
    of one log alone has to explain it whole."""
    found, excess = [], ended.excess
    for hypothesis, fitted in tried:
        nearly = np.isfinite(excess) and fitted.excess < REMAINS * excess and not hypothesis.logs
        if not (fits(fitted) or nearly) or not set(fitted.logs) >= set(ended.logs):
            continue
        value, stated = found_and_stated(hypothesis, fitted, scene)
        if stated > 0.0 and abs(value / stated - 1.0) < CLEAR:
            continue
        rest = "within the noise" if fits(fitted) else f"but for {100 * fitted.excess / excess:.2g} % of it"
        words = f"{hypothesis.words(fitted, value, stated)} explains the misfit {rest}"
        found.append(_Explanation(fitted, words, hypothesis.restrains))
    return found


@dataclass(frozen=True)
class Doubt:
    """What describes data better that an answer fits already: a sentence; gain: by how much chi^2 falls; moved: by how
    much of its size the parameter `worst` moves; better: another answer of the same model that is better too; whole:
    what the scene restrains a parameter by is named first, and without it nothing is left to complain of, in no log."""

    sentence: str
    gain: float
    moved: float
    worst: str
    better: Attempt | None = None
    whole: bool = False

    @property
    def matters(self) -> bool:
        """Whether an answer without it is none to rely on."""
        return self.moved > MATTERS


def doubt(
    scene: Scene,
    records: Sequence[Record],
    prepared: Sequence[Prepared],
    findings: Findings,
    *,
    beyond: bool,
    anew: bool,
) -> Doubt | None:
    """What alone would describe the data clearly better than an answer that fits; None where nothing does, or where the
    answer does not fit.

    Args:
        scene, records, prepared: as `diagnose`; findings: the answer and what is known of it.
        beyond: rig and sensor are suspected too, and not only what the scene says of single parameters.
        anew: an effect more is fitted from the data alone too, where the answer's own motion may hide what it does.
    """
    unknowns, attempt = findings.unknowns, findings.attempt
    if attempt is None:
        return None
    told = [e.name for e in findings.estimates if e.verdict in ("identified", "weak")]
    memory = 1.0 if findings.sure is None else largest_inflation(attempt, findings.sure.colours)
    ended = as_it_ended(scene, unknowns, prepared, attempt)
    if not described(ended):
        return None
    cleared = {h.name for h in findings.held if h.squared < ASKED / 2}
    rig = [s for s in SLIGHT if beyond and s.parameter not in cleared]
    hypotheses = [*restraints(scene, sitting(unknowns, attempt)), *rig]
    found: list[_Gain] = []
    for hypothesis, fitted in _tried(
        hypotheses, scene, prepared, lambda freed: _with_more(ended, freed, records, anew)
    ):
        gain = (ended.excess - fitted.excess) / memory
        if not gain > ASKED:
            continue
        back = fit_smaller(fitted, scene, records)
        back = back if back.attempt is None else replace(back, attempt=retested(back.attempt))
        if (ended.excess - back.excess) / memory > ASKED and back.logs == ended.logs and described(back):
            return Doubt(ANOTHER_ANSWER, gain, np.inf, "", back.attempt)
        words = hypothesis.words(fitted, *found_and_stated(hypothesis, fitted, scene))
        found.append(_Gain(gain, words, hypothesis.restrains, fitted))
    if not found:
        return None
    found.sort(key=lambda each: -each.gain)
    best = found[0]
    alike = sorted((each for each in found if each.gain > best.gain - TOLD), key=lambda each: not each.restrains)
    whole = alike[0].restrains and nothing_amiss(alike[0].fitted, scene, memory)
    sentence = "; or ".join(each.words for each in alike)
    return Doubt(sentence, best.gain, *_moved(ended, best.fitted, told), whole=whole)


@dataclass(frozen=True)
class _Gain:
    """A hypothesis without which an answer that fits is beaten: by how much chi^2 falls, the words that name it,
    whether the scene says it, and the fit with it free."""

    gain: float
    words: str
    restrains: bool
    fitted: Fitted


def _with_more(ended: Fitted, freed: Scene, records: Sequence[Record], anew: bool) -> Fitted:
    """The model with one thing more free, from the motion of the answer or, with one effect more, from the data."""
    from_motion = fit_larger(ended, freed, records)
    if not anew or freed.effects == ended.scene.effects:
        return from_motion
    from_data = fit_model(freed, records, thorough=False)
    comparable = abs(from_data.samples - ended.samples) < ALIKE * ended.samples
    return from_data if comparable and from_data.excess < from_motion.excess else from_motion


def _moved(ended: Fitted, other: Fitted, told: Sequence[str]) -> tuple[float, str]:
    """By how much of its size the parameter moves that moves most, of those the data tell, and its name."""
    here, there = (
        dict(zip(f.unknowns.names, f.unknowns.values(f.attempt.solved.theta, _neutral(f)).tolist(), strict=True))
        for f in (ended, other)
        if f.attempt is not None
    )
    size = dict(zip(ended.unknowns.names, sizes(ended.unknowns, np.array(list(here.values()))).tolist(), strict=True))
    moves = [(abs(there[n] - here[n]) / max(size[n], 1e-300), n) for n in told if n in there]
    return max(moves, default=(0.0, ""))


def _neutral(fitted: Fitted) -> Array:
    """Base values (n_p,) in which a rig quantity is its ratio to the stated one."""
    return fitted.unknowns.base(dict.fromkeys(RIG_PARAMETERS, 1.0))
