"""The [parameters] table: start, bounds, fixed values and priors of each parameter of the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from identify.effects import ALL
from identify.errors import SceneError
from identify.model import RIG_PARAMETERS
from identify.quantities import Parameter
from identify.scene.tables import Table, share
from identify.scene.values import ParameterSpec


def read_parameters(value: Any, declared: Sequence[Parameter], effects: Sequence[str]) -> dict[str, ParameterSpec]:
    """What the scene says of every friction parameter, and of the rig quantities it names.

    Args:
        value: the [parameters] table.
        declared: the parameters of the model.
        effects: the effects that are on.

    Raises:
        SceneError: an unknown name, a value outside the model's box, or a contradiction.
    """
    known = {p.name: p for p in declared}
    for effect in ALL:
        for p in effect.parameters:
            if isinstance(value, Mapping) and p.name in value and effect.name not in effects:
                raise SceneError(
                    f"[parameters] names {p.name}, which belongs to the effect {effect.name}; add it to effects or "
                    f"drop {p.name}"
                )
    table = Table.of(value, "[parameters]", known, "[parameters] mu_s = { start = 0.6 }")
    specs = {}
    for name, p in known.items():
        if name in table.data or p.kind != "rig":
            untold = {"fixed": p.default} if p.kind == "given" else {}
            said = table.data.get(name, untold)
            specs[name] = _parameter(
                {"fixed": said} if p.kind == "given" and isinstance(said, (str, int, float)) else said, p
            )
    return specs


def _parameter(value: Any, p: Parameter) -> ParameterSpec:
    example = (
        f'{p.name} = {{ start = "{p.default:g} {p.unit}" }}' if p.unit else f"{p.name} = {{ start = {p.default} }}"
    )
    table = Table.of(value, f"[parameters] {p.name}", ("start", "lower", "upper", "fixed", "prior"), example)
    if p.name in RIG_PARAMETERS and "fixed" in table.data:
        raise SceneError(f"{table.where} is fixed, but its value stands in [rig]; drop the line to keep it there")
    prior = Table.of(table.data.get("prior", {}), table.place("prior"), ("mean", "sd"), "prior = { mean = …, sd = … }")
    if len(prior.data) == 1:
        raise SceneError(f"{prior.where} has only {next(iter(prior.data))!r}; give both mean and sd")
    lower, upper = table.quantity("lower", p.unit), table.quantity("upper", p.unit)
    for word, bound in (("lower", lower), ("upper", upper)):
        if bound is not None and not p.lower <= bound <= p.upper:
            raise SceneError(
                f"{table.place(word)} is {bound:g}; the model admits {p.lower:g} to {p.upper:g} {p.unit}: move it there"
            )
    return ParameterSpec(
        name=p.name,
        start=table.quantity("start", p.unit),
        lower=p.lower if lower is None else lower,
        upper=p.upper if upper is None else upper,
        fixed=table.quantity("fixed", p.unit),
        prior_mean=prior.quantity("mean", p.unit),
        prior_sd=_sd(prior, p),
    )


def _sd(prior: Table, p: Parameter) -> float | None:
    relative = share(prior.data.get("sd"), prior.place("sd"))
    if relative is None:
        return prior.quantity("sd", p.unit)
    return relative * abs(prior.quantity("mean", p.unit) or 0.0)
