"""What a scene says of a parameter beside the logs may be what they misfit by: a value it is held at, a prior, a bound.

Each is a suspect as a wrong rig value is; what the logs say without it is named beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from identify.diagnosis.suspects import Suspect
from identify.model.model import RIG_PARAMETERS
from identify.number_words import three_figures
from identify.preparation.prepare import Prepared
from identify.quantities import Parameter
from identify.scene import Scene
from identify.scene.parameters import default_spec
from identify.scene.values import ParameterSpec


def restraints(scene: Scene, at_bound: Collection[str]) -> tuple[Suspect, ...]:
    """A suspect for each parameter that the scene holds, gives a prior of, or bounds where the answer sits.

    Args:
        at_bound: names of the parameters that sit at a bound.
    """
    if scene.effects == "auto":
        return ()
    out = []
    for p in scene.model.parameters:
        spec = scene.parameters.get(p.name)
        restraint = "" if spec is None or p.kind == "given" else _restraint(spec, p, p.name in at_bound)
        if restraint:
            out.append(Suspect(p.name, _without(p), _words(p, restraint)))
    return tuple(out)


def _restraint(spec: ParameterSpec, p: Parameter, sits: bool) -> str:
    """What the scene restrains a parameter by, in words; "" where it leaves it to the logs."""
    if spec.fixed is not None:
        return f"the value it is held at ({_said(spec.fixed, p)})"
    if spec.prior_mean is not None and spec.prior_sd is not None:
        return f"its prior ({_said(spec.prior_mean, p)} ± {_said(spec.prior_sd, p)})"
    if sits and (spec.lower, spec.upper) != (p.lower, p.upper) and p.name not in RIG_PARAMETERS:
        return f"its bounds ({_said(spec.lower, p)} to {_said(spec.upper, p)})"
    return ""


def _without(p: Parameter) -> Callable[[Scene, Sequence[Prepared]], Scene | None]:
    """The scene that leaves a parameter to the logs; of a rig quantity only the prior is left out."""

    def freed(scene: Scene, _prepared: Sequence[Prepared]) -> Scene | None:
        spec, free = scene.parameters[p.name], default_spec(p)
        if p.name in RIG_PARAMETERS:
            free = replace(spec, prior_mean=None, prior_sd=None)
        left = replace(free, start=spec.start if spec.fixed is None else spec.fixed, per=spec.per)
        return replace(scene, parameters={**scene.parameters, p.name: left})

    return freed


def _words(p: Parameter, restraint: str) -> Callable[[float, float], str]:
    def words(value: float, _stated: float) -> str:
        return f"{p.name} = {_said(value, p)} (ruled out by {restraint}: correct that under [parameters])"

    return words


def _said(value: float, p: Parameter) -> str:
    return f"{three_figures(value)} {p.unit}".rstrip()
