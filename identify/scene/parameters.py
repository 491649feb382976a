"""The [parameters] table: start, bounds, fixed value and prior of each parameter of the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

from identify.base.errors import SceneError
from identify.effects import ALL
from identify.effects.quantities import Parameter
from identify.model.model import BASE_PARAMETERS, RIG_PARAMETERS, assemble
from identify.scene.tables import Key, TomlTable, share, text
from identify.scene.values import ParameterSpec

SEARCHED = ("start", "prior", "per")  # what makes a given parameter one that is searched


def declared_by(effects: Sequence[str] | Literal["auto"]) -> tuple[Parameter, ...]:
    """The parameters of the model with these effects; of every effect there is while they are still to be chosen.

    Raises:
        SceneError: a composition that is refused.
    """
    if effects != "auto":
        return assemble(tuple(effects)).parameters
    every = (*BASE_PARAMETERS, *(p for effect in ALL for p in effect.parameters))
    return tuple({p.name: p for p in reversed(every)}[name] for name in dict.fromkeys(p.name for p in every))


def read_parameters(
    value: object, declared: Sequence[Parameter], elsewhere: Mapping[str, tuple[str, float]]
) -> dict[str, ParameterSpec]:
    """What the scene says of every friction parameter, and of the rig quantities it names.

    Args:
        value: the [parameters] table.
        declared: the parameters of the model.
        elsewhere: values [SI] that other tables of the scene give, by name of the parameter, and where.

    Raises:
        SceneError: an unknown name, a value outside the model's box, or a contradiction.
    """
    known = {p.name: p for p in declared}
    off = {p.name: effect.name for effect in ALL for p in effect.parameters if p.name not in known}
    for name in value if isinstance(value, Mapping) else ():
        if name in off:
            raise SceneError(
                f"[parameters] names {name}, which belongs to the effect {off[name]}; add it to effects or drop {name}"
            )
    table = TomlTable.of(value, "[parameters]", known, "[parameters] mu_s = { start = 0.6 }").data
    specs = {
        name: _parameter(table[name], p) if name in table else default_spec(p)
        for name, p in known.items()
        if name in table or p.kind != "rig"
    }
    for name in elsewhere.keys() & specs.keys():
        where, number = elsewhere[name]
        if name in table and specs[name].fixed != number:
            raise SceneError(f"{name} stands in {where} and in [parameters] as well; keep one of them")
        _check_admitted(where, number, known[name])
        specs[name] = replace(specs[name], fixed=number, stated=True)
    return specs


def default_spec(p: Parameter) -> ParameterSpec:
    """What holds of a parameter of which the scene says nothing."""
    return ParameterSpec(p.name, None, p.lower, p.upper, fixed=p.default if p.kind == "given" else None)


def _check_admitted(where: str, number: float | None, p: Parameter) -> None:
    if number is not None and not p.lower <= number <= p.upper:
        raise SceneError(
            f"{where} is {number:g} {p.unit}; the model admits {p.lower:g} to {p.upper:g} {p.unit}: move it there"
        )


def _parameter(value: object, p: Parameter) -> ParameterSpec:
    """What [parameters] says of one parameter; the sd of a prior may be a share of its mean."""
    where, number = f"[parameters] {p.name}", Key(p.unit)
    if p.kind == "given" and isinstance(value, (str, int, float)):  # a bare value holds it there
        value = {"fixed": value}
    if p.kind == "given" and isinstance(value, Mapping) and not {"fixed", *SEARCHED} & set(value):
        raise SceneError(
            f"{where} has {'bounds' if value else 'an empty table'} only, and is taken as given; write a start or a "
            "prior to have it searched, or its value alone to hold it there"
        )
    known = dict.fromkeys(("start", "lower", "upper", "fixed"), number) | {"prior": Key(), "per": Key(read=text)}
    start = f'"{p.default:g} {p.unit}"' if p.unit else p.default
    table = TomlTable.of(value, where, known, f"{p.name} = {{ start = {start} }}")
    if p.name in RIG_PARAMETERS and "fixed" in table.data:
        raise SceneError(f"{where} is fixed, but its value stands in [rig]; drop the line to keep it there")
    lower, upper = table.get("lower"), table.get("upper")
    for word, bound in (("lower", lower), ("upper", upper)):
        _check_admitted(table.place(word), bound, p)
    prior = TomlTable.of(
        table.data.get("prior", {}), table.place("prior"), {"mean": number, "sd": number}, "{ mean = …, sd = … }"
    )
    if len(prior.data) == 1:
        raise SceneError(f"{prior.where} has only {next(iter(prior.data))!r}; give both mean and sd")
    mean, relative = prior.get("mean"), share(prior.data.get("sd"), prior.place("sd"))
    return ParameterSpec(
        name=p.name,
        start=table.get("start"),
        lower=p.lower if lower is None else lower,
        upper=p.upper if upper is None else upper,
        fixed=table.get("fixed"),
        prior_mean=mean,
        prior_sd=prior.get("sd") if relative is None else relative * abs(mean or 0.0),
        per=table.get("per"),
        stated=True,
    )
