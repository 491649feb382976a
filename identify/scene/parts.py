"""From the tables of a scene file to the frozen values of a scene, part by part."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal

from data_io.thresholds import Thresholds
from data_io.units import UnitError, parse_quantity
from data_io.values import LogError
from identify.base.budget import DEFAULT_TIME_LIMIT
from identify.base.errors import SceneError
from identify.effects import ALL, MAIN, NAMES
from identify.model.model import RIG_PARAMETERS
from identify.scene.parameters import declared_by, read_parameters
from identify.scene.tables import (
    AREA_LAW,
    CONTACT,
    DAMPING,
    INITIAL,
    LOG,
    POSITIVE,
    RIG,
    SHARE,
    TIED,
    Key,
    TomlTable,
    is_number,
    nearest,
    part,
    stated,
)
from identify.scene.toml import TOP, Tables, is_rig, located, to_fill_in
from identify.scene.values import USUAL_TOLERANCES, Contact, Initial, LogEntry, Rig

Effects = tuple[str, ...] | Literal["auto"]
AREA = '[contact] area = "0.8 cm^2"'


def read_parts(document: Mapping[str, object], folder: Path) -> Tables:
    """The frozen values behind the tables of a scene file, as a `Scene` takes them; "name" is None where none is given.

    Args:
        folder: what relative log paths are relative to.

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
    rig, damping = _rig(document.get("rig"), parameters, effects)
    table, example = TomlTable.of(document.get("contact", {}), "[contact]", CONTACT, AREA), "{ coefficient, exponent }"
    law = TomlTable.of(table.data.get("area_law", {}), table.place("area_law"), AREA_LAW, example)
    if len(table.data) == 2 or len(law.data) == 1:
        raise SceneError(f"[contact] expects either an area or area_law = {example}; keep exactly one")
    contact = Contact(table.get("area"), law.get("coefficient"), law.get("exponent"))
    logs = document.get("logs", [])
    if not isinstance(logs, Sequence) or isinstance(logs, str):
        raise SceneError(f'[[logs]] is {logs!r}; expected one [[logs]] table per log, each with path = "…"')
    tables = {
        name: TomlTable.of(document.get(name, {}), f"[{name}]", keys, f"[{name}] {example}").values()
        for name, keys, example in (
            ("initial", INITIAL, 'elongation = "0 mm"'),
            ("fit", {"time_limit": Key("s", sign=POSITIVE)}, 'time_limit = "60 s"'),
            ("tolerances", dict.fromkeys(USUAL_TOLERANCES, SHARE), 'stiffness = "2 %"'),
        )
    }
    name = top.get("name")
    if name is not None and set(name) & set("/\0"):
        raise SceneError(f"name is {name!r}; expected a word that a folder can be called: leave out the slashes")
    return {
        "name": name,
        "effects": effects,
        "extrapolate": extrapolate,
        "rig": rig,
        "parameters": read_parameters(parameters, declared_by(effects), contact.parameters),
        "logs": tuple(_log_entry(entry, number, folder, rig, damping) for number, entry in enumerate(logs, 1)),
        "initial": Initial(**tables["initial"]),
        "contact": contact,
        "thresholds": _thresholds(document.get("quality", {})),
        "time_limit": tables["fit"].get("time_limit", DEFAULT_TIME_LIMIT),
        "tolerances": tables["tolerances"],
    }


# ----------------------------------------------------------------------------------------------------------------------
# The rig: values with their tolerances, damping in any of its forms, speeds and programmes.
# ----------------------------------------------------------------------------------------------------------------------


Damping = Callable[[float, float], float | None]
"""h [N/m] of a rig with this stiffness [N/m] and mass [kg]; None where h itself is stated."""


def _dashpot(c: float) -> Damping:
    """h = c sqrt(k/m) of a dashpot c [N s/m]."""
    return lambda stiffness, mass: c * math.sqrt(stiffness / mass)


def _rig(value: object, parameters: object, effects: Effects) -> tuple[Rig, Damping]:
    """The rig, and how its damping follows stiffness and mass."""
    on = effects if effects != "auto" else MAIN[:1]
    damped_by = next((e.name for e in ALL if e.name in on and any(p.name == "damping" for p in e.parameters)), None)
    table = TomlTable.of(value, "[rig]", RIG, '[rig] mass = "0.2 kg", stiffness = "1470 N/m"')
    table = TomlTable({**table.data, **_searched(table.data, parameters)}, "[rig]", RIG)
    given = [name for name in DAMPING if name in table.data]
    if len(given) > 1:
        raise SceneError(f"[rig] gives the damping {len(given)} times ({', '.join(given)}); keep one of them")
    if damped_by and not given:
        raise SceneError(
            f"[rig] has no damping although the effect {damped_by} is on; give one of {', '.join(DAMPING)}"
        )
    values: Tables = {}
    tolerances: dict[str, float] = {}
    ratios: dict[str, float] = {}
    dashpot = _is_dashpot(table)
    for key in ("mass", "stiffness", *DAMPING, "drive_speed", "normal_force", "noise"):
        unit = "N s/m" if key == "damping" and dashpot else RIG[key].unit
        number, tolerance = table.data.get(key), None
        if isinstance(number, Mapping):
            example = '{ value = "0.2 kg", tolerance = "2 %" }'
            inner = TomlTable.of(number, table.place(key), {"value": Key(), "tolerance": Key(read=part)}, example)
            if "value" not in number:
                raise SceneError(f"{inner.where} has no value; write {{ value = …, tolerance = … }}")
            number, tolerance = number["value"], inner.get("tolerance")
        values[key] = None if number is None else RIG[key].read(number, unit, table.place(key))
        if tolerance is not None:
            tolerances["damping" if key in DAMPING else key] = tolerance
        if tolerance and key in ("zeta", "loss_factor"):
            # Known of h/k: h is as uncertain as k on top of it, and errs with it.
            ratios["zeta"] = tolerance
            tolerances["damping"] = math.hypot(tolerance, tolerances.get("stiffness", 0.0))
    if TIED in table.data:
        ratios["natural_frequency"] = table.get(TIED)
    if "inertia" not in on:
        values["mass"] = values["mass"] or 0.0
    for key, example in (("mass", "0.2 kg"), ("stiffness", "1470 N/m")):
        if values[key] is None:
            raise SceneError(f'[rig] has no {key}; give {key} = "{example}"')
    zeta, factor, decrement = (values.pop(key) for key in DAMPING[1:])
    if zeta is not None and zeta > 1.0:
        raise SceneError(
            f"[rig] zeta is {zeta:g}, more than critical damping (1); expected a ratio such as 0.05 or "
            '"5 %"; for a rig that barely oscillates give damping = "… N/m"'
        )
    if decrement is not None:
        zeta = decrement / math.hypot(2.0 * math.pi, decrement)
    ratio = factor if zeta is None else 2.0 * zeta  # h/k
    if dashpot and not values["mass"]:
        raise SceneError("[rig] damping is in N s/m, which takes a mass to be h of eq. 1; give the mass, or h in N/m")
    how: Damping = lambda stiffness, _: None if ratio is None else ratio * stiffness  # noqa: E731
    how = _dashpot(values["damping"]) if dashpot else how
    followed = how(values["stiffness"], values["mass"])
    values["damping"] = values["damping"] or 0.0 if followed is None else followed
    return Rig(**values, tolerances=tolerances, ratio_tolerances=ratios), how


def _searched(rig: Mapping[str, object], parameters: object) -> dict[str, float]:
    """A value for each quantity that [rig] leaves out and [parameters] has searched: its start, the mean of its prior,
    or the middle of its bounds."""
    values = {}
    for key in RIG_PARAMETERS:
        table = parameters.get(key) if isinstance(parameters, Mapping) else None
        if not isinstance(table, Mapping) or any(name in rig for name in (DAMPING if key == "damping" else (key,))):
            continue
        where, unit, prior = f"[parameters] {key}", RIG[key].unit, table.get("prior")
        value = table.get("start", prior.get("mean") if isinstance(prior, Mapping) else None)
        if value is not None:
            values[key] = stated(value, unit, where)
        elif "lower" in table and "upper" in table:
            lower, upper = (stated(table[word], unit, f"{where} {word}") for word in ("lower", "upper"))
            values[key] = math.sqrt(lower * upper) if lower * upper > 0.0 else 0.5 * (lower + upper)
    return values


def _is_dashpot(table: TomlTable) -> bool:
    """Whether the damping is that of a dashpot, in N s/m."""
    value = table.data.get("damping")
    text = value.get("value") if isinstance(value, Mapping) else value
    try:
        return isinstance(text, str) and parse_quantity(text, "N s/m") is not None and not is_number(text)
    except UnitError:
        return False


# ----------------------------------------------------------------------------------------------------------------------
# The other parts.
# ----------------------------------------------------------------------------------------------------------------------


def _log_entry(value: object, number: int, folder: Path, rig: Rig, damping: Damping) -> LogEntry:
    """One log of the scene; the damping follows its own stiffness and mass where [rig] states it by them."""
    table = TomlTable.of(value, f"[[logs]] number {number}", LOG, '[[logs]] path = "slow.csv"')
    if "path" not in table.data:
        raise SceneError(f'{table.where} has no path; give path = "slow.csv", relative to the scene file')
    dashpot = _is_dashpot(table)
    values = {name: table.get(name) for name in table.data if name != "damping" or not dashpot}
    stiffness, mass = values.get("stiffness"), values.get("mass")
    if dashpot:
        damping = _dashpot(stated(table.data["damping"], "N s/m", table.place("damping")))
    if "damping" not in values and (dashpot or stiffness is not None or mass is not None):
        values["damping"] = damping(stiffness or rig.stiffness, mass or rig.mass)
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
    for what, names, wanted in (
        ("effects", () if value == "auto" else value, f'effects = ["{MAIN[0]}", …], or "auto"'),
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
