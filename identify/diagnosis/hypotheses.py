"""What may be wrong with rig or sensor, or lack in a model: one table; a hypothesis is a scene with one thing more
free.

Those of `GROSS` explain misfits; those of `SLIGHT` too, and hide in answers that fit. Beside them stand what a scene
says of its parameters (`restraints`) and the drive speeds of single logs (`log_speeds`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identify.base.wording import speed_scale, three_figures, told_apart
from identify.diagnosis.fitted import Fitted
from identify.effects.quantities import Parameter
from identify.estimation.attempt import Attempt
from identify.estimation.combinations import shares
from identify.estimation.status_words import at_bounds
from identify.logs.parting import name_of_recording, recordings
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns, stated_rig
from identify.model.model import RIG_PARAMETERS
from identify.prediction.wording import listed, said
from identify.scene import Scene
from identify.scene.parameters import default_spec
from identify.scene.values import ParameterSpec, Tie

REACH = 4.0  # factor up to which a rig value is suspected
SHIFTED = 0.02  # relative change of the drive speed below which the sticks do not call it wrong
OFF = 0.3  # of the normal force: how far the zero of the friction force is looked for
VARIED = 0.02  # relative range of the normal force below which nothing can be said of what it does

Freed = Callable[[Scene, Sequence[Prepared]], Scene | None]
Words = Callable[[Fitted, float, float], str]


@dataclass(frozen=True)
class Hypothesis:
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


def found_and_stated(hypothesis: Hypothesis, fitted: Fitted, scene: Scene) -> tuple[float, float]:
    """Value that a fit found and value that the scene states of a hypothesis (0 where none is stated)."""
    assert fitted.attempt is not None
    if hypothesis.parameter == "drive_speed":
        first = (hypothesis.logs or (0,))[0]
        return constant_speed(fitted.scene, first) or 0.0, constant_speed(scene, first) or 0.0
    names = fitted.unknowns.names
    base = fitted.unknowns.base(stated_rig(scene))
    value = fitted.unknowns.values(fitted.attempt.solved.theta, base)[names.index(hypothesis.parameter)]
    return float(value), float(getattr(scene.rig, hypothesis.parameter, 0.0) or 0.0)


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


GROSS: tuple[Hypothesis, ...] = (
    Hypothesis("mass", _rig("mass"), _stated("mass", "kg", "weigh what moves")),
    Hypothesis("stiffness", _rig("stiffness"), _stated("stiffness", "N/m", "measure it against a rigid block")),
    Hypothesis("damping", _rig("damping"), _stated("damping", "N/m", "let the rig ring down without contact")),
    Hypothesis(
        "lag_time",
        _effect("sensor_lag", "lag_time", lambda scene: 0.3 * float(np.sqrt(scene.rig.mass / scene.rig.stiffness))),
        lambda _fitted, value, _stated: (
            f"a lag of the force sensor of {1e3 * value:.3g} ms (add sensor_lag to effects)"
        ),
    ),
    Hypothesis(
        "skin_stiffness",
        _effect("skin_compliance", "skin_stiffness", lambda scene: 5.0 * float(scene.rig.stiffness)),
        lambda _fitted, value, _stated: (
            f"something of {three_figures(value)} N/m in series with the rig (add skin_compliance to effects)"
        ),
    ),
    Hypothesis(
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
SLIGHT: tuple[Hypothesis, ...] = (
    *GROSS,
    Hypothesis(
        "direct_strength",
        _effect("direct_effect", "direct_strength", lambda _scene: 1e-3),
        lambda _fitted, value, _stated: (
            f"a direct effect of {value:.3g} (friction that rises with speed at once: add direct_effect to effects)"
        ),
    ),
    Hypothesis(
        "load_exponent",
        _by_load,
        lambda _fitted, value, _stated: (
            f"friction coefficients that change with the normal force (exponent {-value:.3g}: add "
            "load_dependence to effects)"
        ),
    ),
    Hypothesis(
        "sensor_offset",
        _by_zero,
        lambda _fitted, value, _stated: (
            f"a friction force that reads {1e3 * value:.3g} mN at zero (zero the sensor, or take it off with "
            f'tare = "{1e3 * value:.3g} mN" in [[logs]])'
        ),
    ),
)


# ----------------------------------------------------------------------------------------------------------------------
# What a fit found of one parameter, for every group that has its own.
# ----------------------------------------------------------------------------------------------------------------------


def group_values(fitted: Fitted, name: str) -> dict[str, float]:
    """The value [SI] of a parameter by group; of one that is shared by all logs under the empty name."""
    assert fitted.attempt is not None
    unknowns, theta = fitted.unknowns, fitted.attempt.solved.theta
    index, base = unknowns.names.index(name), unknowns.base(stated_rig(fitted.scene))
    found = {"": theta[index]} | {
        share.group: share.theta for share in shares(fitted.attempt, unknowns) if share.index == index
    }
    if len(found) > 1:
        del found[""]
    out = {}
    for group, own in found.items():
        at = theta.copy()
        at[unknowns.source[index]] = own
        out[group] = float(unknowns.values(at, base)[index])
    return out


# ----------------------------------------------------------------------------------------------------------------------
# The drive speed of one log may be what logs misfit by: a hypothesis for each whose sticks rise otherwise than stated.
#
# Where the sticks of all logs do, rig or drive are wrong for all of them, and no single log is suspected.
# ----------------------------------------------------------------------------------------------------------------------

TRIED = 2  # logs at most


def log_speeds(scene: Scene, prepared: Sequence[Prepared], misfits: Sequence[float]) -> tuple[Hypothesis, ...]:
    """A hypothesis for each log whose sticks say another speed than the one stated, and than those of the others do.

    Args:
        misfits: of each log; the logs that misfit most come first.
    """
    logs = recordings(scene)
    slopes = [_slope([prepared[i] for i in some]) for some in logs]
    found = []
    for number, (some, slope) in enumerate(zip(logs, slopes, strict=True)):
        others = [other for n, other in enumerate(slopes) if n != number and other is not None]
        if slope is None or not others or any(constant_speed(scene, i) is None for i in some):
            continue
        stands_out = min(abs(slope), abs(slope - float(np.median(others)))) > SHIFTED
        if stands_out and 1.0 / REACH < 1.0 + slope < REACH:
            found.append((max(misfits[i] for i in some), _suspect(scene, some, 1.0 + slope)))
    found.sort(key=lambda each: -each[0])
    return tuple(hypothesis for _, hypothesis in found[:TRIED])


def _slope(log: Sequence[Prepared]) -> float | None:
    """Slope of the sticks of a log, or of its parts, over stiffness times drive speed, less 1; None without one."""
    slopes = [slip.slope for part in log for slip in part.judgement.slips if slip.slope is not None]
    return float(np.median(slopes)) if slopes else None


def _suspect(scene: Scene, logs: Sequence[int], times: float) -> Hypothesis:
    def nearby(freed: Scene, factor: float) -> Scene:
        return with_speeds(freed, logs, factor)

    words = _words(name_of_recording(scene, logs))
    return Hypothesis("drive_speed", _at(logs, times), words, logs=tuple(logs), nearby=nearby)


def _at(logs: Sequence[int], times: float) -> Freed:
    def freed(scene: Scene, _prepared: Sequence[Prepared]) -> Scene:
        return with_speeds(scene, logs, times)

    return freed


def _words(name: str) -> Words:
    def words(_fitted: Fitted, value: float, stated: float) -> str:
        unit, scale = speed_scale(stated)
        return (
            f"a drive speed of {name} {value / stated:.3g} times the stated one ({value / scale:.3g} {unit} instead of "
            f"{stated / scale:.3g} {unit}: look at the position of the drive, or time it over a known way)"
        )

    return words


# ----------------------------------------------------------------------------------------------------------------------
# What a scene says of a parameter beside the logs may be what they misfit by: a value it is held at, a prior, a bound,
# a tie.
#
# Each is a hypothesis as a wrong rig value is; what the logs say without it is named beside it, of a parameter that
# differs between groups for the groups that contradict it.
# ----------------------------------------------------------------------------------------------------------------------

FAR = 3.0  # standard deviations of a prior beyond which a group's value contradicts it


def restraints(scene: Scene, at_bound: Collection[str]) -> tuple[Hypothesis, ...]:
    """A hypothesis for each parameter that the scene holds, gives a prior of, or bounds where the answer sits.

    Args:
        at_bound: names of the parameters that sit at a bound.
    """
    return _hypotheses(scene, lambda spec, p: _restraint(spec, p, p.name in at_bound))


def ties(scene: Scene) -> tuple[Hypothesis, ...]:
    """A hypothesis for each parameter that the scene ties to another one."""
    return _hypotheses(scene, lambda spec, p: "" if spec.tie is None else f"its tie ({_followed(spec.tie, p)})")


def _hypotheses(scene: Scene, restraint: Callable[[ParameterSpec, Parameter], str]) -> tuple[Hypothesis, ...]:
    """A hypothesis for each parameter that something restrains, said in words."""
    if scene.effects == "auto":
        return ()
    out = []
    for p in scene.model.parameters:
        spec = scene.parameters.get(p.name)
        words = "" if spec is None or p.kind == "given" else restraint(spec, p)
        if spec is not None and words:
            out.append(Hypothesis(p.name, _without(p), _restraints_words(p, spec, words), restrains=True))
    return tuple(out)


def sitting(unknowns: Unknowns, attempt: Attempt | None) -> set[str]:
    """Names of the parameters that sit at a bound, of one group at least."""
    if attempt is None:
        return set()
    thetas = [
        attempt.solved.theta,
        *(trajectory.theta(attempt.solved.theta) for trajectory in attempt.solved.trajectories),
    ]
    return {name for theta in thetas for name in at_bounds(unknowns, theta)}


def _restraint(spec: ParameterSpec, p: Parameter, sits: bool) -> str:
    """What the scene restrains a parameter by, in words; "" where it leaves it to the logs."""
    if spec.fixed is not None:
        return f"the value it is held at ({said(spec.fixed, p.unit)})"
    if spec.prior_mean is not None and spec.prior_sd is not None:
        return f"its prior ({said(spec.prior_mean, p.unit)} ± {said(spec.prior_sd, p.unit, spec.prior_mean)})"
    if sits and (spec.lower, spec.upper) != (p.lower, p.upper) and p.name not in RIG_PARAMETERS:
        return f"its bounds ({said(spec.lower, p.unit)} to {said(spec.upper, p.unit)})"
    return ""


def _followed(tie: Tie, p: Parameter) -> str:
    """What a tied parameter equals: "mu_s - 0.19", "0.5 D"."""
    if p.scale == "log":
        return f"{tie.factor:.3g} {tie.to}"
    return f"{tie.to} {'-' if tie.offset < 0.0 else '+'} {said(abs(tie.offset), p.unit)}"


def _without(p: Parameter) -> Callable[[Scene, Sequence[Prepared]], Scene | None]:
    """The scene that leaves a parameter to the logs; of a rig quantity only the prior is left out. What was tied to a
    parameter that differs between groups differs between them too."""

    def freed(scene: Scene, _prepared: Sequence[Prepared]) -> Scene | None:
        spec, free = scene.parameters[p.name], default_spec(p)
        if p.name in RIG_PARAMETERS:
            free = replace(spec, prior_mean=None, prior_sd=None)
        followed = None if spec.tie is None else scene.parameters.get(spec.tie.to)
        per = spec.per if followed is None else followed.per
        left = replace(free, start=spec.start if spec.fixed is None else spec.fixed, per=per)
        return replace(scene, parameters={**scene.parameters, p.name: left})

    return freed


def _restraints_words(p: Parameter, spec: ParameterSpec, restraint: str) -> Words:
    def words(fitted: Fitted, _found: float, _stated: float) -> str:
        found = group_values(fitted, p.name)
        farthest = max(_off(value, spec, p) for value in found.values())
        named = {group: value for group, value in found.items() if _off(value, spec, p) >= min(FAR, farthest)}
        values = [f"{p.name}{f' ({group})' if group else ''} = {said(value, p.unit)}" for group, value in named.items()]
        return f"{listed(values)} (ruled out by {restraint}: correct that under [parameters])"

    return words


def _off(value: float, spec: ParameterSpec, p: Parameter) -> float:
    """How far a value lies from what the scene says: in standard deviations of its prior; infinite beyond its bounds or
    where nothing else is allowed."""
    if spec.prior_mean is None or spec.prior_sd is None:
        allowed = spec.fixed is None and spec.tie is None and spec.lower < value < spec.upper
        return 0.0 if allowed else np.inf
    if p.scale == "log":
        return float(abs(np.log(value / spec.prior_mean)) * spec.prior_mean / spec.prior_sd)
    return abs(value - spec.prior_mean) / spec.prior_sd
