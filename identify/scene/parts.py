"""From the tables of a scene file to the frozen values of a scene, part by part: rig, logs, parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

from data_io.quality import Thresholds
from data_io.spelling import nearest
from data_io.values import LogError
from identify.base.budget import DEFAULT_TIME_LIMIT
from identify.base.errors import SceneError
from identify.effects import ALL, MAIN, NAMES
from identify.effects.quantities import Parameter
from identify.model.model import BASE_PARAMETERS, RIG_PARAMETERS, assemble
from identify.scene.tables import (
    CONTACT,
    DAMPING,
    INITIAL,
    POSITIVE,
    RIG,
    SHARE,
    TIED,
    Key,
    TomlTable,
    inner,
    part,
    share,
    table_schema,
    text,
    words,
)
from identify.scene.toml import Tables, is_rig, located, to_fill_in
from identify.scene.values import (
    LOG,
    RIG_TOLERANCES,
    USUAL_TOLERANCES,
    Contact,
    DriveSpeed,
    Initial,
    LogEntry,
    ParameterSpec,
    Rig,
)

Effects = tuple[str, ...] | Literal["auto"]
LOGGED: Mapping[str, Key] = {**LOG, "drive": RIG["drive"]}
TOLERATED: Mapping[str, Key] = {"value": Key(), "tolerance": Key(read=part)}
TOP: Mapping[str, Key] = dict.fromkeys("effects extrapolate rig parameters quality logs".split(), Key()) | {
    "name": Key(read=text),
    **{
        name: Key(read=partial(inner, f"[{name}]", keys, f"[{name}] {example}"))
        for name, keys, example in (
            ("contact", CONTACT, 'area = "0.8 cm^2"'),
            ("initial", INITIAL, 'elongation = "0 mm"'),
            ("fit", {"time_limit": Key("s", sign=POSITIVE)}, 'time_limit = "60 s"'),
            ("tolerances", dict.fromkeys(USUAL_TOLERANCES, SHARE), 'stiffness = "2 %"'),
        )
    },
}


def scene_schema() -> dict[str, object]:
    """The JSON schema of a scene file, by which editors complete and check it."""
    quantity, names = Key().schema, {"type": "array", "items": {"enum": list(NAMES)}}
    rig = {name: {"anyOf": [key.schema, table_schema(TOLERATED, "value")]} for name, key in RIG.items()}
    parameter = {"anyOf": [quantity, table_schema(parameter_keys(""))]}
    tables = {
        "effects": {"anyOf": [{"const": "auto"}, names]},
        "extrapolate": names,
        "rig": {"anyOf": [{"type": "string"}, table_schema({}) | {"properties": rig}]},
        "parameters": table_schema({}) | {"properties": {p.name: parameter for p in declared_by("auto")}},
        "quality": {"type": "object"},
        "logs": {"type": "array", "items": table_schema(LOGGED, "path")},
    }
    whole = {name: key.schema for name, key in TOP.items()} | tables
    return table_schema({}, "effects", "rig") | {"properties": whole}


def read_parts(document: Mapping[str, object], folder: Path, name: str) -> Tables:
    """The frozen values behind the tables of a scene file, as a `Scene` takes them.

    Args:
        folder: what relative log paths are relative to; name: of a scene that states none.

    Raises:
        SceneError: one sentence: what was found where, what was expected, what to do.
    """
    if is_rig(document):
        raise SceneError(
            "it holds a rig, as stickslip rig writes it, and no scene; give a scene that names it: "
            'rig = "RIG.toml" in place of its [rig] table'
        )
    top = TomlTable.of(document, "the scene", TOP, '[rig] mass = "0.2 kg"')
    if missing := list(to_fill_in(document)):
        raise SceneError(f"still to fill in: {', '.join(missing)}; replace each TODO by a quantity with its unit")
    effects, extrapolate = _effects(document.get("effects"), document.get("extrapolate", []))
    parameters = document.get("parameters", {})
    rig, ratio = _rig(document.get("rig"), effects)
    area: Tables = top.get("contact") or {}
    law = area.get("area_law", {})
    if len(area) == 2 or len(law) == 1:
        raise SceneError("[contact] expects either an area or area_law = { coefficient, exponent }; keep exactly one")
    contact = Contact(area.get("area"), law.get("coefficient"), law.get("exponent"))
    logs = document.get("logs", [])
    if not isinstance(logs, Sequence) or isinstance(logs, str):
        raise SceneError(f'[[logs]] is {logs!r}; expected one [[logs]] table per log, each with path = "…"')
    name = top.get("name") or name
    if set(name) & set("/\0"):
        raise SceneError(f"name is {name!r}; expected a word that a folder can be called: leave out the slashes")
    return {
        "name": name,
        "effects": effects,
        "extrapolate": extrapolate,
        "rig": rig,
        "parameters": read_parameters(parameters, declared_by(effects), contact.parameters),
        "logs": tuple(_log_entry(entry, number, folder, ratio) for number, entry in enumerate(logs, 1)),
        "initial": Initial(**(top.get("initial") or {})),
        "contact": contact,
        "thresholds": _thresholds(document.get("quality", {})),
        "time_limit": (top.get("fit") or {}).get("time_limit", DEFAULT_TIME_LIMIT),
        "tolerances": top.get("tolerances") or {},
    }


# The rig: values with their tolerances, damping in any of its forms, speeds and programmes; and the other parts.


def _rig(value: object, effects: Effects) -> tuple[Rig, float | None]:
    """The rig, and its h/k where the scene states the damping by that ratio."""
    on = effects if effects != "auto" else MAIN[:1]
    damped_by = next((e.name for e in ALL if e.name in on and any(p.name == "damping" for p in e.parameters)), None)
    table = TomlTable.of(value, "[rig]", RIG, '[rig] mass = "0.2 kg", stiffness = "1470 N/m"')
    given = [name for name in DAMPING if name in table.data]
    if len(given) > 1:
        raise SceneError(f"[rig] gives the damping {len(given)} times ({', '.join(given)}); keep one of them")
    if damped_by and not given:
        raise SceneError(
            f"[rig] has no damping although the effect {damped_by} is on; give one of {', '.join(DAMPING)}"
        )
    values: Tables = dict.fromkeys((*RIG_TOLERANCES, *DAMPING, "normal_force", "noise", "arm"))
    tolerances: dict[str, float] = {}
    ratios = {} if TIED not in table.data else {"natural_frequency": table.get(TIED)}
    for key in [name for name in values if name in table.data]:
        number, tolerance = table.data[key], None
        if isinstance(number, Mapping):
            example = '{ value = "0.2 kg", tolerance = "2 %" }'
            both = TomlTable.of(number, table.place(key), TOLERATED, example)
            if "value" not in number:
                raise SceneError(f"{both.where} has no value; write {{ value = …, tolerance = … }}")
            number, tolerance = number["value"], both.get("tolerance")
        values[key] = RIG[key].read(number, RIG[key].unit, table.place(key))
        if tolerance is not None:
            tolerances["damping" if key in DAMPING else key] = tolerance
    if "inertia" not in on:
        values["mass"] = values["mass"] or 0.0
    for key, example in (("mass", "0.2 kg"), ("stiffness", "1470 N/m")):
        if values[key] is None:
            raise SceneError(f'[rig] has no {key}; give {key} = "{example}"')
    if tolerances.get("damping") and given[0] in ("zeta", "loss_factor"):
        # Known of h/k: h is as uncertain as k on top of it, and errs with it.
        ratios["zeta"] = tolerances["damping"]
        tolerances["damping"] = math.hypot(ratios["zeta"], tolerances.get("stiffness", 0.0))
    zeta, factor, decrement = (values.pop(key) for key in DAMPING[1:])
    if zeta is not None and zeta > 1.0:
        raise SceneError(
            f"[rig] zeta is {zeta:g}, more than critical damping (1); expected a ratio such as 0.05 or "
            '"5 %"; for a rig that barely oscillates give damping = "… N/m"'
        )
    if decrement is not None:
        zeta = decrement / math.hypot(2.0 * math.pi, decrement)
    ratio = factor if zeta is None else 2.0 * zeta
    values["damping"] = values["damping"] or 0.0 if ratio is None else ratio * values["stiffness"]
    values["force_sensor"] = table.get("force_sensor") or "drive"
    values["drive_speed"] = _drive(table, values["drive_speed"])
    return Rig(**values, tolerances=tolerances, ratio_tolerances=ratios), ratio


def _drive(table: TomlTable, speed: DriveSpeed | None) -> DriveSpeed | None:
    """The speed of the drive, or its course."""
    if speed is not None and "drive" in table.data:
        raise SceneError(f"{table.where} gives both drive_speed and drive; keep one of them")
    return table.get("drive") if "drive" in table.data else speed


def _log_entry(value: object, number: int, folder: Path, ratio: float | None) -> LogEntry:
    """One log of the scene; the damping follows its own stiffness where [rig] states it by the ratio h/k."""
    table = TomlTable.of(value, f"[[logs]] number {number}", LOGGED, '[[logs]] path = "slow.csv"')
    if "path" not in table.data:
        raise SceneError(f'{table.where} has no path; give path = "slow.csv", relative to the scene file')
    values = table.values()
    values["drive_speed"] = _drive(table, values.get("drive_speed"))
    values.pop("drive", None)
    if ratio is not None and "stiffness" in values:
        values = {"damping": ratio * values["stiffness"]} | values
    return LogEntry(**(values | {"path": located(folder, values["path"])}))


def _thresholds(value: object) -> Thresholds:
    """The user's own thresholds of the quality gate: pure numbers, or shares in percent."""
    table = TomlTable.of(value, "[quality]", None, "[quality] jitter = 0.1")
    numbers = {
        name: math.inf if number in (math.inf, "inf") else part(number, "", table.place(name))
        for name, number in table.data.items()
    }
    try:
        return Thresholds(numbers)
    except LogError as error:
        raise SceneError(f"[quality]: {error}") from None


def known_effects(value: Sequence[str], where: str = "effects") -> tuple[str, ...]:
    """The effects named, in the order of the table of effects.

    Raises:
        SceneError: an unknown name; the nearest known one is named.
    """
    for name in value:
        if name not in NAMES:
            raise SceneError(
                f"{where} names {name!r}, which is not known; did you mean {nearest(name, NAMES)!r}? "
                f"Known are {', '.join(NAMES)}"
            )
    return tuple(name for name in NAMES if name in value)


def _effects(value: object, extrapolate: object) -> tuple[Effects, tuple[str, ...]]:
    """The effects of a scene, and those used outside the range of their measurements."""
    usual = ", ".join(f'"{name}"' for name in MAIN)
    for what, names, wanted in (
        ("effects", () if value == "auto" else value, f'effects = [{usual}] as a rule, or "auto"'),
        ("extrapolate", extrapolate, 'extrapolate = ["power_law"]'),
    ):
        if not isinstance(names, (list, tuple)) or not all(isinstance(name, str) for name in names):
            text = "the scene has no effects" if names is None else f"{what} is {names!r}"
            raise SceneError(f"{text}; expected a list: {wanted}")
        if len(set(names)) < len(names):
            raise SceneError(f"{what} names one effect twice ({', '.join(names)}); remove one of the two")
    effects: Effects = "auto" if value == "auto" else known_effects(value)  # type: ignore[arg-type]
    allowed = known_effects(extrapolate, "extrapolate")  # type: ignore[arg-type]
    off = [name for name in allowed if effects != "auto" and name not in effects]
    if off:
        raise SceneError(f"extrapolate names {off[0]}, which is not among the effects; add it there, or drop it here")
    return effects, allowed


# The [parameters] table: start, bounds, fixed value and prior of each parameter of the model.

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


def parameter_keys(unit: str) -> dict[str, Key]:
    """What a table of [parameters] holds, of a parameter with this unit."""
    return dict.fromkeys(("start", "lower", "upper", "fixed"), Key(unit)) | {
        "prior": Key(read=words),
        "per": Key(read=text),
    }


def _parameter(value: object, p: Parameter) -> ParameterSpec:
    """What [parameters] says of one parameter; the sd of a prior may be a share of its mean."""
    where = f"[parameters] {p.name}"
    if p.kind == "given" and isinstance(value, (str, int, float)):  # a bare value holds it there
        value = {"fixed": value}
    if p.kind == "given" and isinstance(value, Mapping) and not {"fixed", *SEARCHED} & set(value):
        raise SceneError(
            f"{where} has {'bounds' if value else 'an empty table'} only, and is taken as given; write a start or a "
            "prior to have it searched, or its value alone to hold it there"
        )
    start = f'"{p.default:g} {p.unit}"' if p.unit else p.default
    table = TomlTable.of(value, where, parameter_keys(p.unit), f"{p.name} = {{ start = {start} }}")
    if p.name in RIG_PARAMETERS and "fixed" in table.data:
        raise SceneError(f"{where} is fixed, but its value stands in [rig]; drop the line to keep it there")
    lower, upper = table.get("lower"), table.get("upper")
    for word, bound in (("lower", lower), ("upper", upper)):
        _check_admitted(table.place(word), bound, p)
    moments = dict.fromkeys(("mean", "sd"), Key(p.unit))
    prior = TomlTable.of(table.data.get("prior", {}), table.place("prior"), moments, "{ mean = …, sd = … }")
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
