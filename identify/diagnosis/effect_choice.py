"""Which effects a model takes and why; `effects = "auto"` without logs, by the numbers of a scene.

Without logs all that the scene speaks of is simulated together; then each effect is left out by itself, and stays where
that changes drop, period or level of friction by more than the tolerance at one of the operating points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from identify.base.errors import SceneError, SimulationError
from identify.base.result import EffectReason, EffectsResult
from identify.effects import ALL, MAIN
from identify.effects.quantities import Effect
from identify.effects.typical import fall, slip_time, stick_time
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import initial_states, run

TOLERANCE = 0.01  # relative change of drop, period or level from which an effect stays
CYCLES = 12.0  # that are simulated; the first half settles
ACCURACY = 1e-6
SLIDES, STICKS = "slides without sticking", "sticks and slips where it slides with it"
NORMAL_FORCE = 1.0  # [N], where neither rig nor logs state one


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
            matters = None if values is None else effect.importance(values, normal_force, drive_speed)
            size = (f"{effect.says}; {matters.sentence}", matters.group, matters.value) if matters else (effect.says,)
            reasons.append(EffectReason(effect.name, True, *size))
    return Choice(tuple(reason.effect for reason in reasons), tuple(reasons))


def effects_result(choice: Choice, *, auto: bool) -> EffectsResult:
    """The effects as they stand in the result."""
    return EffectsResult(choice.effects, "auto" if auto else "listed", choice.reasons)


def price(effect: str, effects: Sequence[str]) -> str:
    """What an effect costs in a model with (or without) it, in words: states, operations of one evaluation of the
    motion, parameters; "" where the comparison does not compose."""
    others = tuple(e for e in effects if e != effect)
    try:
        with_it, without = assemble((*others, effect)), assemble(others)
    except SceneError:
        return ""
    states = len(with_it.states) - len(without.states)
    before, after = int(without.slip.n_instructions()), int(with_it.slip.n_instructions())
    parameters = sum(q.kind != "given" for q in with_it.parameters) - sum(q.kind != "given" for q in without.parameters)
    share = 100.0 * (after - before) / before
    return f"{states} states, {after - before} operations ({share:+.0f} %), {parameters} parameters"


@dataclass(frozen=True)
class CycleNumbers:
    """What a motion settles to: drop [N] and period [s] of its cycles (0 without any), mean force [N]."""

    drop: float
    period: float
    level: float


def choose_from_numbers(scene: Scene, tolerance: float = TOLERANCE) -> Choice:
    """The effects that the numbers of a scene call for, each with its reason.

    Candidates are those of the paper's model and every effect of which the scene gives a number.

    Parameters
    ----------
    tolerance: relative change of drop, period or level from which an effect stays.

    Raises
    ------
    SceneError: effects that do not go together, or no drive speed.
    SimulationError: the model of all candidates cannot be simulated.
    """
    candidates = _candidates(scene)
    full = scene.with_effects(candidates)
    points = _points(full)
    whole = [_settled(full, *point) for point in points]
    kept, reasons = [], list[EffectReason]()
    for effect in ALL:
        if effect.name not in full.model.effects:
            reasons.append(EffectReason(effect.name, False, "the scene gives no number of it"))
            continue
        error, sentence = _without(full, effect, points, whole)
        stays = error is None or error > tolerance
        matters = effect.importance(full.values(), points[0][1], points[0][0])
        kept += [effect.name, *effect.needs] if stays else []
        words = f"{matters.sentence}; {sentence}" if matters else sentence
        group, value = (matters.group, matters.value) if matters else ("", None)
        reasons.append(EffectReason(effect.name, stays, words, group, value, error, price(effect.name, candidates)))
    return Choice(tuple(e.name for e in ALL if e.name in kept), tuple(reasons))


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


def _points(scene: Scene) -> list[tuple[float, float]]:
    """Drive speeds [m/s] and normal forces [N] of the scene: those of its logs, else that of its rig."""
    out = []
    for rig in [scene.rig_for(entry) for entry in scene.logs] or [scene.rig]:
        speeds = [v for _, v in rig.drive_speed] if isinstance(rig.drive_speed, tuple) else [rig.drive_speed]
        out += [(abs(v), rig.normal_force or NORMAL_FORCE) for v in speeds if v]
    if not out:
        raise SceneError('the scene has no drive speed; give drive_speed = "… mm/s" under [rig]')
    return list(dict.fromkeys(out))


def _settled(scene: Scene, drive_speed: float, normal_force: float) -> CycleNumbers:
    """What the motion of a scene settles to at an operating point."""
    model, values = scene.model, scene.values()
    p = np.array([values[name] for name in model.parameter_names])
    start = initial_states(model, p, np.array([drive_speed, normal_force, 1.0, 0.0]), {})
    loading = values["stiffness"] * drive_speed
    cycle = stick_time(values, normal_force, drive_speed) + slip_time(values, normal_force, drive_speed)
    first = values["mu_s"] * normal_force / loading
    duration = 1.5 * first + CYCLES * max(cycle, fall(values, normal_force) / loading)
    motion = run(model, values, drive_speed, normal_force, duration, start=start, accuracy=ACCURACY)
    half = 0.5 * duration
    level = float(np.mean(motion.sample(np.linspace(half, duration, 4001)[:-1])["force"]))
    arrests = motion.arrests[motion.arrests > half]
    last = arrests[-1] if arrests.size else 0.0
    onsets = motion.onsets[(motion.onsets > half) & (motion.onsets < last)]
    if onsets.size < 2:
        return CycleNumbers(0.0, 0.0, level)
    ends = arrests[np.searchsorted(arrests, onsets, side="right")]
    drops = motion.sample(onsets)["force"] - motion.sample(ends)["force"]
    return CycleNumbers(float(np.mean(drops)), float((onsets[-1] - onsets[0]) / (onsets.size - 1)), level)


def _without(
    scene: Scene, effect: Effect, points: Sequence[tuple[float, float]], whole: Sequence[CycleNumbers]
) -> tuple[float | None, str]:
    """Largest relative change without an effect (None: it cannot be left out), and a sentence."""
    dependent = [e.name for e in ALL if effect.name in e.needs]
    names = [n for n in scene.model.effects if n != effect.name and n not in dependent]
    try:
        assemble(tuple(names))
        smaller = scene.with_effects(names)
        left = [_settled(smaller, *point) for point in points]
    except (SceneError, SimulationError) as refused:
        return None, f"it cannot be left out: {refused}"
    changes = [_change(a, b) for a, b in zip(whole, left, strict=True)]
    worst = int(np.argmax([c[0] for c in changes]))
    error, what = changes[worst]
    if what in (SLIDES, STICKS):
        return error, f"without it the mass {what}"
    at = f" at {1e3 * points[worst][0]:.3g} mm/s" if len(points) > 1 else ""
    return error, f"without it the {what} changes by {100 * error:.2g} %{at}"


def _change(whole: CycleNumbers, left: CycleNumbers) -> tuple[float, str]:
    """Largest relative change, and of what."""
    if (whole.drop > 0.0) != (left.drop > 0.0):
        return 1.0, SLIDES if whole.drop > 0.0 else STICKS
    changes = [(abs(left.level / whole.level - 1.0), "mean friction force")]
    if whole.drop > 0.0:
        changes += [(abs(left.drop / whole.drop - 1.0), "drop"), (abs(left.period / whole.period - 1.0), "period")]
    return max(changes)
