"""effects = "auto" without logs: which effects the numbers of a scene call for.

Everything the scene speaks of is simulated together; then each effect is left out by itself, and stays where that
changes the drop, the period or the level of friction by more than the tolerance at one of the operating points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identify.base.errors import SceneError, SimulationError
from identify.diagnosis.choice import Choice, EffectReason, price
from identify.diagnosis.fitted import Fitted
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
NORMAL_FORCE = 1.0  # [N], where neither rig nor logs say one


@dataclass(frozen=True)
class CycleNumbers:
    """What a motion settles to: drop [N] and period [s] of its cycles (0 without any), mean force [N]."""

    drop: float
    period: float
    level: float


def choose_from_numbers(scene: Scene, tolerance: float = TOLERANCE) -> Choice:
    """The effects that the numbers of a scene call for, each with its reason.

    Candidates are those of the paper's model and every effect of which the scene gives a number.

    Args:
        tolerance: relative change of drop, period or level from which an effect stays.

    Raises:
        SceneError: effects that do not go together, or no drive speed.
        SimulationError: the model of all candidates cannot be simulated.
    """
    called = _called(scene)
    full = scene.with_effects(called)
    points = _points(full)
    whole = [_settled(full, *point) for point in points]
    kept, reasons = [], {}
    for effect in ALL:
        if effect.name not in full.model.effects:
            reasons[effect.name] = EffectReason(effect.name, False, "the scene gives no number of it")
            continue
        error, said = _without(full, effect, points, whole)
        stays = error is None or error > tolerance
        told = effect.importance(full.values(), points[0][1], points[0][0])
        sentence = f"{told.sentence}; {said}" if told else said
        kept += [effect.name] if stays else []
        reasons[effect.name] = EffectReason(
            effect.name,
            stays,
            sentence,
            told.group if told else "",
            told.value if told else None,
            error,
            price(effect.name, called),
        )
    for effect in ALL:
        if effect.name in kept:
            kept += [need for need in effect.needs if need not in kept]
    names = tuple(e.name for e in ALL if e.name in kept)
    return Choice(names, tuple(reasons[e.name] for e in ALL))


def _called(scene: Scene) -> tuple[str, ...]:
    """The paper's effects, and those of which the scene gives a number; of rival laws the one it speaks of."""
    stated = {name for name, spec in scene.parameters.items() if spec.states_value}
    spoken = {e.name for e in ALL if any(p.kind != "rig" and p.name in stated for p in e.parameters)}
    if scene.rig.damping == 0.0:
        spoken.discard("hysteresis_damping")
    wanted = set(MAIN) | spoken
    if scene.rig.damping == 0.0:
        wanted.discard("hysteresis_damping")
    for effect in ALL:
        rivals = [e for e in ALL if e.role and e.role == effect.role and e.name in wanted and e.name in spoken]
        if effect.role and effect.name in wanted and effect.name not in spoken and rivals:
            wanted.discard(effect.name)
    for effect in ALL:
        wanted |= set(effect.needs) if effect.name in wanted else set()
    return tuple(e.name for e in ALL if e.name in wanted)


def _points(scene: Scene) -> list[tuple[float, float]]:
    """Drive speeds [m/s] and normal forces [N] of the scene: those of its logs, else that of its rig."""
    rigs = [scene.rig_for(entry) for entry in scene.logs] or [scene.rig]
    out = []
    for rig in rigs:
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
    first = values["mu_s"] * normal_force / (values["stiffness"] * drive_speed)
    cycle = stick_time(values, normal_force, drive_speed) + slip_time(values, normal_force, drive_speed)
    duration = 1.5 * first + CYCLES * max(cycle, fall(values, normal_force) / (values["stiffness"] * drive_speed))
    motion = run(model, values, drive_speed, normal_force, duration, start=start, accuracy=ACCURACY)
    half = 0.5 * duration
    onsets, arrests = motion.onsets, motion.arrests
    late = np.linspace(half, duration, 4001)[:-1]
    level = float(np.mean(motion.sample(late)["force"]))
    arrests = arrests[arrests > half]
    onsets = onsets[(onsets > half) & (onsets < (arrests[-1] if arrests.size else 0.0))]
    if onsets.size < 2:
        return CycleNumbers(0.0, 0.0, level)
    arrests = np.array([arrests[arrests > t][0] for t in onsets])
    drops = motion.sample(onsets)["force"] - motion.sample(arrests)["force"]
    return CycleNumbers(float(np.mean(drops)), float((onsets[-1] - onsets[0]) / (onsets.size - 1)), level)


def _without(
    scene: Scene, effect: Effect, points: Sequence[tuple[float, float]], whole: Sequence[CycleNumbers]
) -> tuple[float | None, str]:
    """Largest relative change without an effect (None: it cannot be left out), and a sentence."""
    dependent = [e.name for e in ALL if effect.name in e.needs and e.name in scene.model.effects]
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


# ----------------------------------------------------------------------------------------------------------------------
# How the models of a selection are weighed: likelihood-ratio statistics, and what their parameters cost (Schwarz).
# ----------------------------------------------------------------------------------------------------------------------

ENOUGH = 25.0  # statistic of an effect that is never dropped: nothing costs more
CONFUSED = ("load_dependence",)  # logs that differ in load differ in speed as well, mostly, and drifts look the same
ALIKE, UNLIKE = 0.1, 0.1  # relative difference of speeds that are one, and of loads that are two


def statistic(larger: Fitted, smaller: Fitted) -> float:
    """Likelihood-ratio statistic of the larger model; an estimated or wrong noise level is taken out."""
    if larger.attempt is None:
        return 0.0 if smaller.attempt is None else -np.inf
    noise = max(1.0, 1.0 + larger.excess / larger.samples) if np.isfinite(larger.excess) else 1.0
    return float((smaller.excess - larger.excess) / noise) if np.isfinite(larger.excess) else -np.inf


def penalty(larger: Fitted, smaller: Fitted) -> float:
    """What the parameters of an effect must gain at least, never more than ENOUGH."""
    if larger.attempt is None:
        return ENOUGH
    least = float(np.log(larger.samples))
    return float(np.clip(_price(larger, larger.samples) - _price(smaller, larger.samples), least, ENOUGH))


def better(other: Fitted, than: Fitted) -> float:
    """By how much another model is better, its parameters paid for."""
    if other.attempt is None:
        return -np.inf
    return -statistic(than, other) + _price(than, other.samples) - _price(other, other.samples)


def _price(fitted: Fitted, samples: int) -> float:
    """What the parameters of a model cost on so many samples: the logarithm of their number each, and ENOUGH for an
    effect that the design of the logs confuses with others."""
    each = float(np.log(samples))
    confused = [name for name in CONFUSED if searched(fitted, name)] if not _told_apart(fitted) else []
    return fitted.searched * each + len(confused) * max(ENOUGH - each, 0.0)


def searched(fitted: Fitted, effect: str) -> bool:
    """Whether a parameter of this effect is searched."""
    own = {q.name for e in ALL if e.name == effect for q in e.parameters}
    return any(free and name in own for name, free in zip(fitted.unknowns.names, fitted.unknowns.free, strict=True))


def _told_apart(fitted: Fitted) -> bool:
    """Whether two logs at about one drive speed were taken under different loads."""
    at = [(log.data.drive_speed, log.data.mean_normal_force) for log in fitted.prepared]
    return any(
        abs(speed - other) <= ALIKE * abs(speed) and abs(load - under) > UNLIKE * load
        for i, (speed, load) in enumerate(at)
        for other, under in at[:i]
    )
