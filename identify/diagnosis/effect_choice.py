"""Which effects a model takes and why; `effects = "auto"` without logs, by the numbers of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from identify.base.result import EffectReason, EffectsResult
from identify.effects import ALL, MAIN
from identify.scene import Scene

if TYPE_CHECKING:
    from identify.diagnosis.fitted import Fitted

NORMAL_FORCE = 1.0  # [N], where neither rig nor logs state one


@dataclass(frozen=True)
class Choice:
    """The effects of a model, in the order of their table, and a reason per effect that was looked at; unfinished: the
    time was up before the fits had decided all of them; ended: the last of these fits."""

    effects: tuple[str, ...]
    reasons: tuple[EffectReason, ...]
    unfinished: bool = False
    ended: Fitted | None = None


def as_listed(
    effects: Sequence[str], values: Mapping[str, float] | None, normal_force: float, drive_speed: float
) -> Choice:
    """The effects a scene lists, each with what it does and when it matters, at an operating point in SI; without
    values that can be relied on (None) what it does alone."""
    reasons = []
    for effect in ALL:
        if effect.name in effects:
            matters = None if values is None else effect.importance(values, normal_force, drive_speed)
            size = (f"{effect.says}; {matters.sentence}", matters.group, matters.value) if matters else (effect.says,)
            reasons.append(EffectReason(effect.name, True, *size))
    return Choice(tuple(reason.effect for reason in reasons), tuple(reasons))


def effects_result(choice: Choice, *, auto: bool) -> EffectsResult:
    """The effects as they stand in the result."""
    return EffectsResult(choice.effects, "auto" if auto else "listed", choice.reasons)


def choose_from_numbers(scene: Scene) -> Choice:
    """The effects that the numbers of a scene call for, without logs: those of the paper's model, and every effect of
    which the scene gives a number.

    Raises
    ------
    SceneError: effects that do not go together.
    """
    chosen = _candidates(scene)
    full, rigs = scene.with_effects(chosen), [scene.rig_for(entry) for entry in scene.logs] or [scene.rig]
    values, reasons = full.values(), list[EffectReason]()
    speed = next((r.drive_speed for r in rigs if isinstance(r.drive_speed, float) and r.drive_speed), None)
    for effect in ALL:
        kept = effect.name in full.model.effects
        sentence, group, value = "the scene gives no number of it", "", None
        if kept:
            sentence = "it is part of the paper's model" if effect.name in MAIN else "the scene gives a number of it"
            matters = effect.importance(values, rigs[0].normal_force or NORMAL_FORCE, abs(speed)) if speed else None
            if matters is not None:
                sentence, group, value = f"{matters.sentence}; {sentence}", matters.group, matters.value
        reasons.append(EffectReason(effect.name, kept, sentence, group, value))
    return Choice(tuple(e.name for e in ALL if e.name in full.model.effects), tuple(reasons))


def _candidates(scene: Scene) -> tuple[str, ...]:
    """The paper's effects, and those of which the scene gives a number; of rival laws the one it speaks of."""
    stated = {name for name, spec in scene.parameters.items() if spec.states_value}
    spoken = {e.name for e in ALL if any(p.kind != "rig" and p.name in stated for p in e.parameters)}
    wanted = set(MAIN) | spoken
    if scene.rig.damping == 0.0:
        wanted.discard("hysteresis_damping")
    rivals = {e.role for e in ALL if e.role and e.name in spoken}
    wanted -= {e.name for e in ALL if e.role in rivals and e.name not in spoken}
    for effect in ALL:
        wanted |= set(effect.needs) if effect.name in wanted else set()
    return tuple(e.name for e in ALL if e.name in wanted)
