"""Which effects a model takes and why: one reason per effect, for the result and the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SceneError
from identify.base.result import EffectReason, EffectsResult
from identify.base.wording import three_figures
from identify.effects import ALL
from identify.logs.loads import swing
from identify.logs.prepare import Prepared
from identify.logs.rhythms import SpectralLine
from identify.model.model import Model, assemble


@dataclass(frozen=True)
class Choice:
    """The effects of a model, in the order of their table, and a reason per effect that was looked at; unfinished: the
    time was up before the fits had decided all of them."""

    effects: tuple[str, ...]
    reasons: tuple[EffectReason, ...]
    unfinished: bool = False


def as_listed(
    effects: Sequence[str], values: Mapping[str, float] | None, normal_force: float, drive_speed: float
) -> Choice:
    """The effects a scene lists, each with what it does and when it matters, at an operating point in SI; without
    values that can be relied on (None) what it does alone."""
    reasons = []
    for effect in ALL:
        if effect.name in effects:
            told = None if values is None else effect.importance(values, normal_force, drive_speed)
            sentence = effect.says + (f"; {told.sentence}" if told else "")
            reasons.append(
                EffectReason(effect.name, True, sentence, told.group if told else "", told.value if told else None)
            )
    return Choice(tuple(reason.effect for reason in reasons), tuple(reasons))


def effects_result(choice: Choice, *, auto: bool) -> EffectsResult:
    """The effects as they stand in the result."""
    return EffectsResult(choice.effects, "auto" if auto else "listed", choice.reasons)


# ----------------------------------------------------------------------------------------------------------------------
# What an effect costs, counted: states, operations of one evaluation of the motion, parameters.
# ----------------------------------------------------------------------------------------------------------------------


def price(effect: str, effects: Sequence[str]) -> str:
    """In words, what an effect costs in a model with (or without) it; "" where the comparison does not compose."""
    others = tuple(e for e in effects if e != effect)
    try:
        with_it, without = assemble((*others, effect)), assemble(others)
    except SceneError:
        return ""
    states = len(with_it.states) - len(without.states)
    operations = _operations(with_it) - _operations(without)
    parameters = sum(q.kind != "given" for q in with_it.parameters) - sum(q.kind != "given" for q in without.parameters)
    share = 100.0 * operations / _operations(without)
    return f"{states} states, {operations} operations ({share:+.0f} %), {parameters} parameters"


def _operations(model: Model) -> int:
    return int(model.slip.n_instructions())


# ----------------------------------------------------------------------------------------------------------------------
# What the logs call for before anything is fitted: for each effect whether it is worth a try, and why or why not.
#
# Cheap looks at the detected cycles: the slope of the sticks, the drift of the onset forces, rhythms in the sticks, the
# course of the normal force. What passes here is decided by the fits.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

MAYBE = 2.0  # standard errors from which it is asked for
SURE = 3.0  # standard errors by which a look must differ from nothing
SOFTER = 0.005  # share of the rig's stiffness that a stick slope must lack at least
SPAN = 0.03  # by which the normal force must vary (as a share) to tell how friction depends on it
LOAD_VARIES = 2e-3  # half range of the normal force over its mean from which its course counts
SLIP_SAMPLES = 6.0  # per slip: fewer cannot tell a lag or a direct effect
DRIFT = (("occlusion_level", 0.0),)
LATE = 3  # settled cycles of a log that can tell a drift
BANDS = {"breathing": (0.05, 0.5), "pulse": (0.5, 3.0), "tremor": (4.0, 20.0)}  # of a live finger [Hz]


@dataclass(frozen=True)
class Screen:
    """One effect: whether the fits should try it, a sentence, whether the look alone is telling (else it is tried on
    top of the others), and where its parameters start (SI)."""

    effect: str
    asked: bool
    sentence: str
    sure: bool = True
    starts: tuple[tuple[str, float], ...] = ()


Look = Callable[[Sequence[Prepared], Sequence[SpectralLine]], Screen]


def screen(prepared: Sequence[Prepared], lines: Sequence[SpectralLine]) -> tuple[Screen, ...]:
    """One look per effect, in the order in which they are tried; lines: the rhythms of the sticks."""
    return tuple(look(prepared, lines) for look in LOOKS)


def _resolved(prepared: Sequence[Prepared]) -> float:
    """Samples per slip of the log that resolves its slips best."""
    return max((log.segmentation.samples_per_slip for log in prepared if log.segmentation.count), default=0.0)


def _damping(prepared: Sequence[Prepared], _lines: Sequence[SpectralLine]) -> Screen:
    damped = any(log.rig.damping > 0.0 for log in prepared)
    said = "the rig has a damping" if damped else "the rig states no damping"
    return Screen("hysteresis_damping", damped, said)


def _ageing(prepared: Sequence[Prepared], _lines: Sequence[SpectralLine]) -> Screen:
    return Screen("contact_ageing", True, "the paper's model has it")


def _weakening(prepared: Sequence[Prepared], _lines: Sequence[SpectralLine]) -> Screen:
    return Screen("velocity_weakening", True, "the paper's model has it")


def _direct(prepared: Sequence[Prepared], _lines: Sequence[SpectralLine]) -> Screen:
    samples = _resolved(prepared)
    if samples < SLIP_SAMPLES:
        return Screen("direct_effect", False, f"slips hold {samples:.2g} samples, too few to tell how they start")
    return Screen("direct_effect", True, f"slips hold {samples:.3g} samples", False)


def _loads(prepared: Sequence[Prepared]) -> Array:
    return np.array([log.data.mean_normal_force for log in prepared])


def _load_dependence(prepared: Sequence[Prepared], _lines: Sequence[SpectralLine]) -> Screen:
    loads = _loads(prepared)
    spread = float(np.ptp(loads) / 2 / np.mean(loads))
    within = max(swing(log.data.normal_force, log.data.begin, log.data.end) for log in prepared)
    if max(spread, within) < SPAN:
        return Screen(
            "load_dependence", False, f"the normal force is the same within {100 * max(spread, within):.2g} %"
        )
    middle = float(np.exp(np.mean(np.log(loads))))
    return Screen(
        "load_dependence",
        True,
        f"the normal force varies by ± {100 * max(spread, within):.2g} %",
        True,
        (("reference_force", middle), ("load_exponent", 0.0)),
    )


def _varying(prepared: Sequence[Prepared], _lines: Sequence[SpectralLine]) -> Screen:
    within = max(swing(log.data.normal_force, log.data.begin, log.data.end) for log in prepared)
    if within < LOAD_VARIES:
        return Screen("varying_normal_force", False, f"each log holds its normal force within {100 * within:.2g} %")
    return Screen("varying_normal_force", True, f"the normal force varies by ± {100 * within:.2g} % within a log")


def _occlusion(prepared: Sequence[Prepared], _lines: Sequence[SpectralLine]) -> Screen:
    best, told = 0.0, ""
    for log in prepared:
        c = log.segmentation.cycles
        settled = slice(1, None)
        t, level = c.onset[settled], c.onset_force[settled] + c.arrest_force[settled]
        if t.size < LATE:
            continue
        level = level / log.data.normal_force.at(t)
        t = t - np.mean(t)
        slope = float(np.sum(t * level) / np.sum(t * t))
        left = level - np.mean(level) - slope * t
        noise = log.data.noise / log.data.mean_normal_force
        error = max(float(np.std(left)), noise) / np.sqrt(float(np.sum(t * t)))
        if abs(slope) / error > best:
            share = abs(slope) * np.ptp(t) / abs(float(np.mean(level)))
            best, told = abs(slope) / error, f"the level drifts by {100 * share:.2g} % along {log.name}"
    if not told:
        return Screen("occlusion", False, "the logs are too short to tell a drift")
    if best < SURE:
        return Screen("occlusion", True, "the friction level hardly drifts along the logs", False, DRIFT)
    return Screen("occlusion", True, told)


def _skin(prepared: Sequence[Prepared], _lines: Sequence[SpectralLine]) -> Screen:
    ratios, weights = [], []
    for log in prepared:
        slope = log.segmentation.stick_slope
        if slope is None or log.data.drive_speed == 0.0:
            continue
        count = max(log.segmentation.stick_slopes.size, 1)
        ratios.append(slope[0] / (log.rig.stiffness * log.data.drive_speed))
        weights.append(1.0 / max(slope[1] / np.sqrt(count), 1e-3) ** 2)
    if not ratios:
        return Screen("skin_compliance", False, "no stick shows its slope")
    ratio = float(np.average(ratios, weights=weights))
    error = float(1.0 / np.sqrt(np.sum(weights)))
    if ratio > 1.0 - max(SOFTER, MAYBE * error):
        return Screen(
            "skin_compliance", False, f"the sticks rise with {100 * ratio:.4g} % of k v_0: nothing gives in series"
        )
    rig = float(np.mean([log.rig.stiffness for log in prepared]))
    skin = rig * ratio / (1.0 - ratio)
    said = f"the sticks rise with {100 * ratio:.3g} % of k v_0: something of {three_figures(skin)} N/m gives in series"
    sure = ratio < 1.0 - SURE * error
    if not sure:
        said = f"the sticks rise with {100 * ratio:.3g} ± {100 * error:.2g} % of k v_0: too unlike to tell"
    return Screen("skin_compliance", True, said, sure, (("skin_stiffness", skin),))


def _lag(prepared: Sequence[Prepared], _lines: Sequence[SpectralLine]) -> Screen:
    samples = _resolved(prepared)
    if samples < SLIP_SAMPLES:
        return Screen("sensor_lag", False, f"slips hold {samples:.2g} samples, too few to tell a lag")
    natural = float(np.mean([log.rig.half_period for log in prepared])) / np.pi
    return Screen("sensor_lag", True, f"slips hold {samples:.3g} samples", False, (("lag_time", 0.1 * natural),))


def _of_a_finger(line: SpectralLine) -> bool:
    return any(low <= line.frequency <= high for low, high in BANDS.values())


def _finger(prepared: Sequence[Prepared], lines: Sequence[SpectralLine]) -> Screen:
    mine = [line for line in lines if _of_a_finger(line)]
    if not mine:
        return Screen("finger_motion", False, "no rhythm of a finger in the sticks")
    said = ", ".join(f"{line.frequency:.3g} Hz" for line in mine)
    return Screen("finger_motion", True, f"the sticks swing at {said}")


def _excitation(prepared: Sequence[Prepared], lines: Sequence[SpectralLine]) -> Screen:
    mine = [line for line in lines if not _of_a_finger(line)]
    if not mine:
        return Screen("excitation", False, "no vibration in the sticks")
    return Screen("excitation", True, f"the sticks swing at {mine[0].frequency:.4g} Hz")


LOOKS: tuple[Look, ...] = (
    _damping,
    _ageing,
    _weakening,
    _direct,
    _load_dependence,
    _varying,
    _occlusion,
    _finger,
    _excitation,
    _skin,
    _lag,
)
