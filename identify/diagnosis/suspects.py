"""What may be wrong with rig or sensor, or lack in a model: one table; a suspect is a scene with one thing more free.

Those of `GROSS` explain misfits; those of `SLIGHT` too, and hide in answers that fit. Beside them stand what a scene
says of its parameters (`restraints.py`) and the drive speeds of single logs (`log_speeds.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identify.base.wording import three_figures, told_apart
from identify.diagnosis.fitted import Fitted
from identify.logs.prepare import Prepared
from identify.logs.unknowns import stated_rig
from identify.scene import Scene
from identify.scene.parameters import ParameterSpec

REACH = 4.0  # factor up to which a rig value is suspected
SHIFTED = 0.02  # relative change of the drive speed below which the sticks do not call it wrong
OFF = 0.3  # of the normal force: how far the zero of the friction force is looked for
VARIED = 0.02  # relative range of the normal force below which nothing can be said of what it does

Freed = Callable[[Scene, Sequence[Prepared]], Scene | None]
Words = Callable[[Fitted, float, float], str]


@dataclass(frozen=True)
class Suspect:
    """What may be wrong: its parameter, the scene with it free (None where it is free already, or cannot be it), and
    the sentence that names it, given the fit with it free, the value found and the one stated (0 where none is). logs:
    numbers of those it is of alone (empty: all); nearby: of what no fit can search, the scene with its value times a
    factor; restrains: it is something that the scene says of a parameter beside the logs."""

    parameter: str
    freed: Freed
    words: Words
    logs: tuple[int, ...] = ()
    nearby: Callable[[Scene, float], Scene] | None = None
    restrains: bool = False


def found_and_stated(suspect: Suspect, fitted: Fitted, scene: Scene) -> tuple[float, float]:
    """Value that a fit found and value that the scene states of a suspect (0 where none is stated)."""
    assert fitted.attempt is not None
    if suspect.parameter == "drive_speed":
        first = (suspect.logs or (0,))[0]
        return constant_speed(fitted.scene, first) or 0.0, constant_speed(scene, first) or 0.0
    names = fitted.unknowns.names
    base = fitted.unknowns.base(stated_rig(scene))
    value = fitted.unknowns.values(fitted.attempt.solved.theta, base)[names.index(suspect.parameter)]
    return float(value), float(getattr(scene.rig, suspect.parameter, 0.0) or 0.0)


def _rig(name: str) -> Freed:
    """A scene with a rig quantity estimated from the data alone."""

    def freed(scene: Scene, _prepared: Sequence[Prepared]) -> Scene | None:
        value = float(getattr(scene.rig, name))
        if name in scene.parameters or value <= 0.0:
            return None
        spec = ParameterSpec(name, None, value / REACH, value * REACH)
        rig = replace(scene.rig, tolerances={n: t for n, t in scene.rig.tolerances.items() if n != name})
        return replace(scene, rig=rig, parameters={**scene.parameters, name: spec})

    return freed


def _effect(name: str, parameter: str, start: Callable[[Scene], float]) -> Freed:
    """A scene with one effect more, its parameter started where it matters."""

    def freed(scene: Scene, _prepared: Sequence[Prepared]) -> Scene | None:
        if scene.effects == "auto" or name in scene.effects:
            return None
        made = scene.with_effects((*scene.effects, name))
        spec = made.parameters[parameter]
        begun = replace(spec, fixed=None, start=float(np.clip(start(scene), spec.lower, spec.upper)))
        return replace(made, parameters={**made.parameters, parameter: begun})

    return freed


def _by_load(scene: Scene, prepared: Sequence[Prepared]) -> Scene | None:
    """A scene whose coefficients fall with the normal force, and hold at the mean of the logs."""
    made = _effect("load_dependence", "load_exponent", lambda _scene: 0.02)(scene, prepared)
    at = _varied_load(prepared)
    if made is None or at is None:
        return None
    given = replace(made.parameters["reference_force"], fixed=at)
    return replace(made, parameters={**made.parameters, "reference_force": given})


def _varied_load(prepared: Sequence[Prepared]) -> float | None:
    """The mean normal force of the logs [N]; None where it hardly varies."""
    loads = np.concatenate([log.data.normal_force.values for log in prepared])
    at = float(np.mean([log.data.mean_normal_force for log in prepared]))
    return at if np.ptp(loads) >= VARIED * at else None


def _by_zero(scene: Scene, prepared: Sequence[Prepared]) -> Scene | None:
    """A scene whose friction force has a zero of its own, which only a load that varies tells from a coefficient."""
    made = _effect("force_sensor", "sensor_offset", lambda _scene: 0.0)(scene, prepared)
    at = _varied_load(prepared)
    if made is None or at is None:
        return None
    free = replace(made.parameters["sensor_offset"], lower=-OFF * at, upper=OFF * at)
    return replace(made, parameters={**made.parameters, "sensor_offset": free})


def constant_speed(scene: Scene, log: int) -> float | None:
    """The drive speed [m/s] that a scene states for a log; None where it is a programme or not stated."""
    said = scene.rig_for(scene.logs[log]).drive_speed
    return None if said is None or isinstance(said, tuple) else float(said)


def with_speeds(scene: Scene, logs: Sequence[int], times: float) -> Scene:
    """The scene with the drive speeds of these logs, constant ones, times a factor."""
    changed = list(scene.logs)
    for log in logs:
        speed = constant_speed(scene, log)
        assert speed is not None
        changed[log] = replace(changed[log], drive_speed=times * speed)
    return replace(scene, logs=tuple(changed))


def _as_sticks_rise(scene: Scene, prepared: Sequence[Prepared]) -> Scene | None:
    """A scene with the drive speeds that its sticks tell with the stated stiffness, all changed by one factor."""
    slopes = [part.slope for log in prepared for part in log.judgement.slips if part.slope is not None]
    if not slopes or abs(float(np.median(slopes))) < SHIFTED:
        return None
    times = 1.0 + float(np.median(slopes))
    if not 1.0 / REACH < times < REACH or any(constant_speed(scene, i) is None for i in range(len(scene.logs))):
        return None
    return _all_speeds(scene, times)


def _all_speeds(scene: Scene, times: float) -> Scene:
    return with_speeds(scene, range(len(scene.logs)), times)


def _stated(name: str, unit: str, remedy: str) -> Words:
    def words(_fitted: Fitted, value: float, stated: float) -> str:
        found, before = told_apart(value, stated)
        return (
            f"a {name} of {found} {unit} instead of {before} {unit} "
            f'({remedy}, or let it be estimated: [parameters] {name} = {{ start = "{found} {unit}" }})'
        )

    return words


GROSS: tuple[Suspect, ...] = (
    Suspect("mass", _rig("mass"), _stated("mass", "kg", "weigh what moves")),
    Suspect("stiffness", _rig("stiffness"), _stated("stiffness", "N/m", "measure it against a rigid block")),
    Suspect("damping", _rig("damping"), _stated("damping", "N/m", "let the rig ring down without contact")),
    Suspect(
        "lag_time",
        _effect("sensor_lag", "lag_time", lambda scene: 0.3 * float(np.sqrt(scene.rig.mass / scene.rig.stiffness))),
        lambda _fitted, value, _stated: (
            f"a lag of the force sensor of {1e3 * value:.3g} ms (add sensor_lag to effects)"
        ),
    ),
    Suspect(
        "skin_stiffness",
        _effect("skin_compliance", "skin_stiffness", lambda scene: 5.0 * float(scene.rig.stiffness)),
        lambda _fitted, value, _stated: (
            f"something of {three_figures(value)} N/m in series with the rig (add skin_compliance to effects)"
        ),
    ),
    Suspect(
        "drive_speed",
        _as_sticks_rise,
        lambda _fitted, value, stated: (
            f"a drive speed {value / stated:.3g} times the stated one in all logs (look at the position of the drive, "
            "or time it over a known way) or, which these data cannot tell from it, a friction force that reads "
            f"{value / stated:.3g} times what it is (hang a known weight on its sensor)"
        ),
        nearby=_all_speeds,
    ),
)
SLIGHT: tuple[Suspect, ...] = (
    *GROSS,
    Suspect(
        "direct_strength",
        _effect("direct_effect", "direct_strength", lambda _scene: 1e-3),
        lambda _fitted, value, _stated: (
            f"a direct effect of {value:.3g} (friction that rises with speed at once: add direct_effect to effects)"
        ),
    ),
    Suspect(
        "load_exponent",
        _by_load,
        lambda _fitted, value, _stated: (
            f"friction coefficients that change with the normal force (exponent {-value:.3g}: add "
            "load_dependence to effects)"
        ),
    ),
    Suspect(
        "sensor_offset",
        _by_zero,
        lambda _fitted, value, _stated: (
            f"a friction force that reads {1e3 * value:.3g} mN at zero (zero the sensor, or take it off with "
            f'tare = "{1e3 * value:.3g} mN" in [[logs]])'
        ),
    ),
)
