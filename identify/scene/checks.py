"""Parts of a scene that contradict each other, and measured laws outside the range of their measurements."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from identify.base.errors import SceneError
from identify.effects import ALL
from identify.model.model import RIG_PARAMETERS
from identify.scene.values import EACH_LOG, DriveSpeed

if TYPE_CHECKING:
    from identify.scene.scene import Scene

LOAD_LAW = "load law"  # role of the effects whose range is one of normal force


def check_ranges(
    effects: Sequence[str],
    extrapolate: Sequence[str],
    values: Mapping[str, float],
    drive_speed: DriveSpeed | None,
    normal_forces: Iterable[float] = (),
) -> None:
    """Refuse a law outside the range of its measurements.

    Args:
        effects: those that are on. extrapolate: those of them that are used all the same.
        values: parameters by name [SI].
        drive_speed: [m/s], or a programme; while the drive stands nothing slides. normal_forces: [N], none: unknown.

    Raises:
        SceneError: the effect's own sentence, and how to override it.
    """
    programme = drive_speed if isinstance(drive_speed, tuple) else ((0.0, drive_speed or 0.0),)
    speeds = [speed for _, speed in programme if speed != 0.0]
    loads = list(normal_forces)
    for effect in ALL:
        if effect.name not in effects or effect.name in extrapolate:
            continue
        asked = loads if effect.role == LOAD_LAW else loads[:1] or [1.0]
        for load in asked:
            for speed in speeds if effect.role != LOAD_LAW else speeds[:1] or [1.0]:
                sentence = effect.refusal(values, load, speed)
                if sentence is not None:
                    raise SceneError(f'{sentence}, or use it there all the same: extrapolate = ["{effect.name}"]')


def check_groups(scene: Scene) -> None:
    """A parameter that differs by a label asks for that label of every log."""
    for name, spec in scene.parameters.items():
        if spec.per is None or spec.per == EACH_LOG:
            continue
        for entry in scene.logs:
            if spec.per not in entry.labels:
                raise SceneError(
                    f"{name} differs by {spec.per}, of which log {entry.path.name} says nothing; give it labels = "
                    f'{{ {spec.per} = "…" }}, or write per = "log"'
                )


def check_log_overrides(scene: Scene) -> None:
    """A log may not give its own value of what is estimated for all."""
    for entry in scene.logs:
        for name in RIG_PARAMETERS:
            if name in scene.parameters and getattr(entry, name) is not None:
                raise SceneError(
                    f"log {entry.path.name} gives its own {name}, but [parameters] estimates one {name} for all logs; "
                    "drop one of the two"
                )


def check_mass(scene: Scene) -> None:
    """Only a model without inertia does without a mass."""
    if scene.rig.mass == 0.0 and (scene.effects == "auto" or "inertia" in scene.effects):
        raise SceneError("mass is 0 kg; expected a positive number: correct it, or take inertia out of effects")


def check_rig_bounds(scene: Scene) -> None:
    """A rig quantity that is estimated starts within its bounds."""
    for name in RIG_PARAMETERS:
        spec, value = scene.parameters.get(name), getattr(scene.rig, name)
        if spec and not spec.lower <= value <= spec.upper:
            raise SceneError(
                f"{name} = {value:g} of [rig] is outside the bounds {spec.lower:g} to {spec.upper:g} of [parameters]; "
                "widen them"
            )


def check_coefficients(scene: Scene) -> None:
    """Kinetic friction lies below static friction, and above zero."""
    values = scene.values()
    static, kinetic = values["mu_s"], values["mu_k0"]
    change = values.get("delta_mu_k", 0.0) if scene.effects != "auto" else 0.0  # which law holds is still open
    if kinetic >= static:
        raise SceneError(
            f"mu_k0 = {kinetic:g} is not below mu_s = {static:g} (start values, or defaults where none is given); "
            "give [parameters] a start of mu_k0 below that of mu_s"
        )
    if not kinetic + change > 0.0 or math.isnan(change):
        raise SceneError(
            f"mu_k0 + delta_mu_k = {kinetic + change:g} is the kinetic coefficient at high speed; expected a positive "
            "number: raise one of the two in [parameters]"
        )
