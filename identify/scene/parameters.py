"""The [parameters] table: start, bounds, fixed values and priors of each parameter of the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

from identify.base.errors import SceneError
from identify.effects import ALL
from identify.effects.quantities import Parameter
from identify.model.model import BASE_PARAMETERS, RIG_PARAMETERS, assemble
from identify.scene.tables import Key, TomlTable, share, text
from identify.scene.values import ParameterSpec, Tie

SEARCHED = ("start", "prior", "per", "tie")  # what makes a given parameter one that is searched


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
    for effect in ALL:
        for p in effect.parameters:
            if isinstance(value, Mapping) and p.name in value and p.name not in known:
                raise SceneError(
                    f"[parameters] names {p.name}, which belongs to the effect {effect.name}; add it to effects or "
                    f"drop {p.name}"
                )
    table = TomlTable.of(value, "[parameters]", known, "[parameters] mu_s = { start = 0.6 }")
    specs = {}
    for name, p in known.items():
        if name in table.data:
            specs[name] = _parameter(_opened(table.data[name], p), p)
        elif p.kind != "rig":
            specs[name] = default_spec(p)
    check_ties(specs, declared)
    for name, (where, number) in elsewhere.items():
        if name in specs:
            specs[name] = _given_elsewhere(specs[name], known[name], where, number, name in table.data)
    return specs


def default_spec(p: Parameter) -> ParameterSpec:
    """What holds of a parameter of which the scene says nothing."""
    return ParameterSpec(p.name, None, p.lower, p.upper, fixed=p.default if p.kind == "given" else None)


def _opened(value: object, p: Parameter) -> Any:
    """The table of one parameter; a bare value of one that is taken as given holds it there."""
    if p.kind != "given":
        return value
    if isinstance(value, (str, int, float)):
        return {"fixed": value}
    if isinstance(value, Mapping) and "fixed" not in value and not any(word in value for word in SEARCHED):
        raise SceneError(
            f"[parameters] {p.name} has {'bounds' if value else 'an empty table'} only, and is taken as given; "
            f"write a start or a prior to have it searched, or its value alone to hold it there"
        )
    return value


def _given_elsewhere(said: ParameterSpec, p: Parameter, where: str, number: float, twice: bool) -> ParameterSpec:
    """The parameter held at the value that another table gives."""
    if twice and said.fixed != number:
        raise SceneError(f"{p.name} stands in {where} and in [parameters] as well; keep one of them")
    if not p.lower <= number <= p.upper:
        raise SceneError(
            f"{where} is {number:g} {p.unit}; the model admits {p.lower:g} to {p.upper:g} {p.unit}: move it there"
        )
    return replace(said, fixed=number, stated=True)


def _parameter(value: object, p: Parameter) -> ParameterSpec:
    example = (
        f'{p.name} = {{ start = "{p.default:g} {p.unit}" }}' if p.unit else f"{p.name} = {{ start = {p.default} }}"
    )
    number = Key(p.unit)
    keys = {"start": number, "lower": number, "upper": number, "fixed": number, "prior": Key(), "per": Key(read=text)}
    table = TomlTable.of(value, f"[parameters] {p.name}", keys | {"tie": Key()}, example)
    if p.name in RIG_PARAMETERS and "fixed" in table.data:
        raise SceneError(f"{table.where} is fixed, but its value stands in [rig]; drop the line to keep it there")
    example, known = "prior = { mean = …, sd = … }", {"mean": number, "sd": number}
    prior = TomlTable.of(table.data.get("prior", {}), table.place("prior"), known, example)
    if len(prior.data) == 1:
        raise SceneError(f"{prior.where} has only {next(iter(prior.data))!r}; give both mean and sd")
    lower, upper = table.get("lower"), table.get("upper")
    for word, bound in (("lower", lower), ("upper", upper)):
        if bound is not None and not p.lower <= bound <= p.upper:
            raise SceneError(
                f"{table.place(word)} is {bound:g}; the model admits {p.lower:g} to {p.upper:g} {p.unit}: move it there"
            )
    return ParameterSpec(
        name=p.name,
        start=table.get("start"),
        lower=p.lower if lower is None else lower,
        upper=p.upper if upper is None else upper,
        fixed=table.get("fixed"),
        prior_mean=prior.get("mean"),
        prior_sd=_sd(prior),
        per=table.get("per"),
        tie=_tie(table, p),
        stated=True,
    )


def _tie(table: TomlTable, p: Parameter) -> Tie | None:
    """The parameter this one follows.

    Raises:
        SceneError: no name, or a relation that its scale does not have.
    """
    if "tie" not in table.data:
        return None
    known = {"to": Key(read=text), "factor": Key(), "offset": Key(p.unit)}
    said = TomlTable.of(table.data["tie"], table.place("tie"), known, 'tie = { to = "mu_s" }')
    to = said.get("to")
    if to is None:
        raise SceneError(f'{said.where} names no parameter; give tie = {{ to = "mu_s" }}')
    wrong = "offset" if p.scale == "log" else "factor"
    if wrong in said.data:
        right = "factor" if wrong == "offset" else "offset"
        raise SceneError(f"{said.where} has {wrong}, which {p.name} cannot take; give {right} instead")
    factor, offset = said.get("factor"), said.get("offset")
    if factor is not None and not factor > 0.0:
        raise SceneError(f"{said.place('factor')} is {factor:g}; expected a positive number: correct it")
    return Tie(to, 1.0 if factor is None else factor, 0.0 if offset is None else offset)


def check_ties(specs: Mapping[str, ParameterSpec], declared: Sequence[Parameter]) -> None:
    """Refuse ties to what is not there, is tied itself, or has another scale.

    Raises:
        SceneError: one sentence.
    """
    scales = {p.name: p.scale for p in declared if p.kind != "rig"}
    for name, spec in specs.items():
        if spec.tie is None:
            continue
        other = specs.get(spec.tie.to)
        if spec.tie.to not in scales or name not in scales or other is None:
            raise SceneError(
                f"{name} is tied to {spec.tie.to!r}, which is no friction parameter of this scene; expected one of "
                f"{', '.join(scales)}: correct it"
            )
        if other.tie is not None or other.fixed is not None or spec.tie.to == name:
            raise SceneError(f"{name} is tied to {spec.tie.to}, which is not searched itself; tie it to one that is")
        if scales[name] != scales[spec.tie.to]:
            raise SceneError(
                f"{name} is tied to {spec.tie.to}, but one is searched by its logarithm and the other is not; tie "
                "parameters of one kind"
            )


def _sd(prior: TomlTable) -> float | None:
    relative = share(prior.data.get("sd"), prior.place("sd"))
    deviation: float | None = prior.get("sd") if relative is None else relative * abs(prior.get("mean") or 0.0)
    return deviation
