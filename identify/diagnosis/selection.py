"""effects = "auto" with logs: forward by score, backward by the Schwarz criterion (BIC; Ann. Statist. 6, 461, 1978).

What the logs plainly call for is fitted first. Scores say to first order by how much the criterion would fall with each
effect that is absent, Wald's test without each that is present: the most promising of them is fitted, and the model
taken if the criterion falls, until none is left. All models are parts of one: an absent effect is held at its null
values, so that functions are built once, sums compare exactly, and the score test has a column for each.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from identify.base.budget import time_is_up
from identify.base.progress import Notice, Progress, to_nobody
from identify.base.result import EffectReason
from identify.base.wording import three_figures
from identify.diagnosis.effect_choice import Choice
from identify.diagnosis.findings import against_data
from identify.diagnosis.fitted import fit_beside, fit_model
from identify.diagnosis.quantities import EFFECTS, held_quantities
from identify.diagnosis.score_test import score_table
from identify.effects import ALL
from identify.estimation.covariance import information_at
from identify.estimation.fit_wording import prefit_warnings, wrong_unit
from identify.estimation.search import alike
from identify.logs.log_data import swing
from identify.logs.prepare import Prepared
from identify.logs.scene_records import prepare_scene
from identify.logs.unknowns import stated_rig
from identify.logs.vibration import SpectralLine, rhythms
from identify.scene import Scene

Array = NDArray[np.float64]

ALWAYS = ("inertia",)
SURE = 10.0  # times what its parameters must gain: an effect that gains more to first order is not fitted without
# Effects whose null values are numbers: held there, they are absent.
HELD = ("velocity_weakening", "direct_effect", "load_dependence", "occlusion", "excitation", "finger_motion")
BY_NAME = {effect.name: effect for effect in ALL}
LOOKED_AT = (*ALWAYS, "hysteresis_damping", "contact_ageing", "velocity_weakening", "varying_normal_force")
NO_TIME = "the time limit ended the comparison before this effect was tested: give a longer --time-limit"
NOT_COMPARED = (
    "not compared: cycles differ too much among themselves, or from the rig, for a comparison of sums of squares"
)
CLEAR = 3.0  # standard errors by which a stick slope must differ from k v_0
SOFTER = 0.005  # share of the rig's stiffness that it must lack at least
SPAN = 0.03  # by which the normal force must vary (as a share) to tell how friction depends on it
LOAD_VARIES = 2e-3  # half range of the normal force over its mean from which its course counts
SLIP_SAMPLES = 6.0  # per slip: fewer cannot tell a lag or a direct effect
BANDS = {"breathing": (0.05, 0.5), "pulse": (0.5, 3.0), "tremor": (4.0, 20.0)}  # of a live finger [Hz]
UNASKED = "not looked for in the data: list it by name"


def choose_from_data(scene: Scene, records: Sequence[Record], progress: Progress | None = None) -> Choice:
    """The effects that the logs of a scene call for, each with its reason.

    Parameters
    ----------
    scene: its effects are to be chosen ("auto"); records: its logs, in their order.

    Raises
    ------
    FitError: a log of which nothing is left.
    SceneError: what the scene says does not go together.
    """
    report = progress or to_nobody
    report("looking at the logs", 0.0)
    prepared = prepare_scene(scene.with_effects(LOOKED_AT), records).logs
    for sentence in prefit_warnings(prepared):
        report(Notice(sentence), 0.0)
    if wrong_unit(prepared) or not alike([log for log in prepared if log.left_out is None]):
        return _choice(LOOKED_AT, (), {}, {effect.name: NOT_COMPARED for effect in ALL if effect.name not in ALWAYS})
    lines, left = rhythms(prepared)
    candidates = candidates_of(prepared, lines)
    comparison = _Comparison(with_one_noise(scene, prepared, lines, left), tuple(records), candidates, report)
    finished = comparison.run()
    notes = {} if finished else {e: NO_TIME for e in comparison.tried if e not in comparison.gains}
    choice = _choice(comparison.kept, candidates, comparison.gains, notes)
    return replace(choice, unfinished=not finished, ended=comparison.best)


@dataclass(frozen=True)
class Candidate:
    """One effect: whether the fits try it, and whether from the first of them; a sentence; where its parameters start
    (SI)."""

    effect: str
    tried: bool
    first: bool
    sentence: str
    starts: Mapping[str, float] = field(default_factory=dict)


def candidates_of(prepared: Sequence[Prepared], lines: Sequence[SpectralLine]) -> tuple[Candidate, ...]:
    """One look at the logs per effect, in the order in which they are tried; lines: the rhythms of the sticks."""
    loads = np.array([log.data.mean_normal_force for log in prepared])
    within = max(swing(log.data.normal_force, log.data.begin, log.data.end) for log in prepared)
    varies = max(float(np.ptp(loads) / 2 / np.mean(loads)), within)
    samples = max((log.segmentation.samples_per_slip for log in prepared if log.segmentation.count), default=0.0)
    resolved, damped = samples >= SLIP_SAMPLES, any(log.rig.damping > 0.0 for log in prepared)
    slips = f"slips have {samples:.3g} samples{'' if resolved else ', too few to resolve their start'}"
    lag = {"lag_time": 0.1 * float(np.mean([log.rig.half_period for log in prepared])) / np.pi}
    finger = [line for line in lines if any(low <= line.frequency <= high for low, high in BANDS.values())]
    vibration = [line for line in lines if line not in finger]
    swings = [
        f"the sticks oscillate at {', '.join(f'{line.frequency:.4g} Hz' for line in some)}"
        if some
        else "no such spectral line"
        for some in (finger, vibration)
    ]
    paper, ages = "the paper's model has it", "the friction level may drift along the logs"
    exponent = {"reference_force": float(np.exp(np.mean(np.log(loads)))), "load_exponent": 0.0}
    return (
        Candidate("hysteresis_damping", damped, damped, f"the rig {'has a' if damped else 'states no'} damping"),
        Candidate("contact_ageing", True, True, paper),
        Candidate("velocity_weakening", True, True, paper),
        Candidate("direct_effect", resolved, False, slips),
        Candidate("load_dependence", *2 * (varies >= SPAN,), f"the load varies by ± {100 * varies:.2g} %", exponent),
        Candidate("varying_normal_force", *2 * (within >= LOAD_VARIES,), f"by ± {100 * within:.2g} % within a log"),
        Candidate("occlusion", True, False, ages, {"occlusion_level": 0.0}),
        Candidate("finger_motion", *2 * (bool(finger),), swings[0]),
        Candidate("excitation", *2 * (bool(vibration),), swings[1]),
        Candidate("sensor_lag", resolved, False, slips, lag),
        _skin(prepared),
    )


def _skin(prepared: Sequence[Prepared]) -> Candidate:
    """Whether sticks rise more slowly than with stiffness times drive speed."""
    ratios, weights = [], []
    for log in prepared:
        slope = log.segmentation.stick_slope
        if slope is not None and log.data.drive_speed != 0.0:
            ratios.append(slope[0] / (log.rig.stiffness * log.data.drive_speed))
            weights.append(max(log.segmentation.stick_slopes.size, 1) / max(slope[1], 1e-3) ** 2)
    if not ratios:
        return Candidate("skin_compliance", False, False, "no stick shows its slope")
    ratio, error = float(np.average(ratios, weights=weights)), float(1.0 / np.sqrt(np.sum(weights)))
    rises = f"the sticks rise with {100 * ratio:.4g} ± {100 * error:.2g} % of k v_0"
    if not ratio < 1.0 - SOFTER:
        return Candidate("skin_compliance", False, False, f"{rises}: nothing gives in series")
    skin = float(np.mean([log.rig.stiffness for log in prepared])) * ratio / (1.0 - ratio)
    sentence = f"{rises}: something of {three_figures(skin)} N/m gives in series"
    return Candidate("skin_compliance", True, ratio < 1.0 - CLEAR * error, sentence, {"skin_stiffness": skin})


def with_one_noise(scene: Scene, prepared: Sequence[Prepared], lines: Sequence[SpectralLine], left: Array) -> Scene:
    """The scene with the noise of logs whose sticks swing stated once for all models: what is estimated from the sticks
    counts the swings in where a model lacks them, and no two sums could be compared.

    Args:
        lines, left: the rhythms of the sticks, and per log the share of that variance that they leave.
    """
    if not lines or len(prepared) != len(scene.logs):
        return scene
    logs = [
        replace(entry, noise=float(log.data.noise * np.sqrt(share))) if log.noise_estimated and share < 1.0 else entry
        for entry, log, share in zip(scene.logs, prepared, left, strict=True)
    ]
    return replace(scene, logs=tuple(logs))


class _Comparison:
    """From what the logs plainly call for to the effects that pay: those kept, their fit, and per effect by how much it
    lowers chi^2 and what its parameters ask for."""

    def __init__(
        self, scene: Scene, records: tuple[Record, ...], candidates: Sequence[Candidate], report: Progress
    ) -> None:
        self._scene, self._records, self._report = scene, records, report
        self._starts = {name: value for one in candidates if one.tried for name, value in one.starts.items()}
        self.tried = [one.effect for one in candidates if one.tried]
        self.kept = [one.effect for one in candidates if one.first]
        self.gains: dict[str, tuple[float, float]] = {}

    def run(self) -> bool:
        """Whether the time sufficed."""
        self._report("fitting all that plainly matters", 0.1)
        self.best = fit_model(self._with(self.kept), self._records, thorough=True)
        while not time_is_up():
            decreases = self._absent() | self._present()
            for effect in sorted(decreases, key=decreases.__getitem__, reverse=True):
                if time_is_up():
                    return False
                if self._step(effect):
                    break
            else:
                return not time_is_up()
        return False

    def _absent(self) -> dict[str, float]:
        """By how much the criterion would fall with each effect that is absent, to first order, where it would."""
        scores = {effect: 0.0 for effect in self.tried if effect not in self.kept}
        attempt, least = self.best.attempt, float(np.log(max(self.best.samples, 2)))
        if attempt is None or not scores:
            return {}
        owner = {q.name: effect for effect in HELD for q in BY_NAME[effect].parameters}
        owner |= {name: effect for name, (effect, _) in EFFECTS.items()} | {"stiffness": "skin_compliance"}
        columns = [column for column in held_quantities(attempt, self.best.unknowns) if column.name in owner]
        for one in score_table(attempt.solved, columns).scores:
            effect, softer = owner[one.column.name], one.column.name != "stiffness" or one.step < 0.0
            if one.log is None and softer and effect in scores and one.score > scores[effect]:
                scores[effect] = one.score
                if one.column.name in EFFECTS:
                    self._starts[EFFECTS[one.column.name][1]] = one.step
        self.gains |= {effect: (score, least) for effect, score in scores.items()}
        return {effect: score - least for effect, score in scores.items() if score > least}

    def _present(self) -> dict[str, float]:
        """By how much the criterion would fall without each effect, by the quadratic at the answer (Wald's test; null
        values are 0, of a scale one size away), where that may be. What has no null values is to be tried."""
        attempt, unknowns = self.best.attempt, self.best.unknowns
        decreases = dict.fromkeys(self.kept, 0.0)
        known = None if attempt is None else information_at(attempt.solved, unknowns)
        if attempt is None or known is None or not known.known:
            return decreases
        stated_ones = score_table(attempt.solved, held_quantities(attempt, unknowns))
        pulled = against_data(stated_ones, unknowns, stated_rig(self._scene))
        covariance, at = known.covariance(), {unknowns.names[i]: n for n, i in enumerate(known.free.tolist())}
        off = np.where(unknowns.logarithmic, 1.0, attempt.solved.theta)[known.free]
        for effect in self.kept:
            null = BY_NAME[effect].null
            mine = [at[name] for name in null if name in at]
            stated = [pulled[name] for name in null if name in pulled]
            if mine:
                loss = float(off[mine] @ np.linalg.solve(covariance[np.ix_(mine, mine)], off[mine]))
            elif stated:  # held: from where the data would put it
                loss = sum(
                    (1.0 + 2.0 * np.log(h.from_data / h.stated)) * (h.from_data / h.standard_error) ** 2 for h in stated
                )
            else:
                continue
            least = max(len(mine), 1) * float(np.log(max(self.best.samples, 2)))
            self.gains[effect] = loss, least
            if loss > SURE * least:
                del decreases[effect]
            else:
                decreases[effect] = least - loss
        return decreases

    def _step(self, effect: str) -> bool:
        """Take in an effect that is absent, or leave one out, if the Schwarz criterion falls by it."""
        add = effect not in self.kept
        effects = [*self.kept, effect] if add else [e for e in self.kept if e != effect]
        self._report(f"{'with' if add else 'without'} {effect}", 0.5)
        other = fit_beside(self.best, self._with(effects), self._records)
        larger, smaller = (other, self.best) if add else (self.best, other)
        fall, each = -np.inf if np.isfinite(smaller.excess) else 0.0, float(np.log(max(larger.samples, 2)))
        if np.isfinite(larger.excess):  # of chi^2, at the level of the noise that the larger model leaves
            fall = float((smaller.excess - larger.excess) / max(1.0, 1.0 + larger.excess / larger.samples))
        more = larger.searched - smaller.searched
        self.gains[effect] = fall, max(more, 1) * each
        if not np.isfinite(other.excess) or not (fall > more * each if add else fall < more * each):
            return False
        self.kept, self.best = effects, other
        return True

    def _with(self, effects: Iterable[str]) -> Scene:
        """The scene of a subset of effects: the others that can be are held at their null values."""
        present = {*ALWAYS, *effects}
        roles = {BY_NAME[name].role for name in present} - {""}
        held = [n for n in HELD if n in self.tried and n not in present and BY_NAME[n].role not in roles]
        made = self._scene.with_effects([e.name for e in ALL if e.name in present or e.name in held], self._starts)
        shared = {q.name for name in present for q in BY_NAME[name].parameters}
        parameters = dict(made.parameters)
        for effect in (BY_NAME[name] for name in held):
            for q in effect.parameters:
                if q.name in parameters and q.name not in shared:
                    absent = replace(parameters[q.name], start=None, prior_mean=None, prior_sd=None)
                    parameters[q.name] = replace(absent, fixed=effect.null.get(q.name, q.default))
        return replace(made, parameters=parameters)


def _choice(
    kept: Sequence[str],
    candidates: Sequence[Candidate],
    gains: Mapping[str, tuple[float, float]],
    notes: Mapping[str, str],
) -> Choice:
    """One reason per effect, in the order of their table."""
    effects = tuple(e.name for e in ALL if e.name in (*ALWAYS, *kept))
    looks, out = {one.effect: one for one in candidates}, list[EffectReason]()
    for name in (effect.name for effect in ALL):
        stays, look, (gain, least) = name in effects, looks.get(name), gains.get(name, (np.nan, np.nan))
        worth = "it gains nothing" if name in gains and not stays else "without it no start describes the data"
        if np.isfinite(gain):
            verdict = "worth" if stays else "not worth"
            worth = f"the fit gains {max(gain, 0.0):.3g} and its parameters require {least:.3g}: {verdict} them"
        sentence = UNASKED if look is None else f"{look.sentence}; {worth}" if look.tried else look.sentence
        if name in ALWAYS:
            sentence = "the equation of motion of a stick-slip record needs it"
        sentence = notes.get(name, sentence)
        out.append(EffectReason(name, stays, sentence, statistic=float(gain) if np.isfinite(gain) else None))
    return Choice(effects, tuple(out))
