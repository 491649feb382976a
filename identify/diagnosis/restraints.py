"""What a scene says of a parameter beside the logs may be what they misfit by: a value it is held at, a prior, a bound,
a tie.

Each is a suspect as a wrong rig value is; what the logs say without it is named beside it, of a parameter that differs
between groups for the groups that contradict it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from identify.diagnosis.fitted import Fitted
from identify.diagnosis.group_values import group_values
from identify.diagnosis.suspects import Suspect, Words
from identify.effects.quantities import Parameter
from identify.estimation.attempt import Attempt
from identify.estimation.status_words import at_bounds
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.model.model import RIG_PARAMETERS
from identify.prediction.wording import listed, said
from identify.scene import Scene
from identify.scene.parameters import default_spec
from identify.scene.values import ParameterSpec, Tie

FAR = 3.0  # standard deviations of a prior beyond which a group's value contradicts it


def restraints(scene: Scene, at_bound: Collection[str]) -> tuple[Suspect, ...]:
    """A suspect for each parameter that the scene holds, gives a prior of, or bounds where the answer sits.

    Args:
        at_bound: names of the parameters that sit at a bound.
    """
    return _suspects(scene, lambda spec, p: _restraint(spec, p, p.name in at_bound))


def ties(scene: Scene) -> tuple[Suspect, ...]:
    """A suspect for each parameter that the scene ties to another one."""
    return _suspects(scene, lambda spec, p: "" if spec.tie is None else f"its tie ({_followed(spec.tie, p)})")


def _suspects(scene: Scene, restraint: Callable[[ParameterSpec, Parameter], str]) -> tuple[Suspect, ...]:
    """A suspect for each parameter that something restrains, said in words."""
    if scene.effects == "auto":
        return ()
    out = []
    for p in scene.model.parameters:
        spec = scene.parameters.get(p.name)
        words = "" if spec is None or p.kind == "given" else restraint(spec, p)
        if spec is not None and words:
            out.append(Suspect(p.name, _without(p), _words(p, spec, words), restrains=True))
    return tuple(out)


def sitting(unknowns: Unknowns, attempt: Attempt | None) -> set[str]:
    """Names of the parameters that sit at a bound, of one group at least."""
    if attempt is None:
        return set()
    thetas = [attempt.solved.theta, *(guess.theta(attempt.solved.theta) for guess in attempt.solved.guesses)]
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


def _words(p: Parameter, spec: ParameterSpec, restraint: str) -> Words:
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
