"""Columns that a log holds in another form: coefficient times load, distance over speed, rpm times radius."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from data_io.columns import KIND, Name, coefficient_column, distance_columns
from data_io.contents import Contents, Part, unit_of, with_column
from data_io.source import Request
from data_io.units import SI_UNIT, factor, kind_of
from data_io.values import Finding, FloatArray, UnitError


def with_derived_columns(request: Request, contents: Contents) -> Contents:
    """Return contents with a friction force or a time made of other columns where a part holds none.

    Each is said in a finding. Where a unit is missing nothing is made: the error about the missing column says so.
    """
    if contents.settled:
        return contents
    findings = list(contents.findings)
    parts = []
    for part in contents.parts:
        for make, code in ((_friction, "friction_from_coefficient"), (_time, "time_from_distance")):
            part, text = make(request, part)
            findings += [Finding(code, "warning", text)] if text else []
        parts.append(_of_torque(part))
    return replace(contents, parts=parts, findings=list(dict.fromkeys(findings)))


_TORQUES: Final = {
    "friction_force": (
        "torque", "frictiontorque", "torquefriction", "tob", "bittorque", "torqueonbit", "drehmoment", "reibmoment",
        "couple", "shearstress", "tau", "shear", "schubspannung",
    ),
    "normal_force": ("wob", "weightonbit", "bitweight", "normalstress", "sigman", "sigma", "normalspannung"),
}  # fmt: skip
"""Names of columns that make a force with an arm or an area, as keys."""


def _of_torque(part: Part) -> Part:
    """Return the part with a column of torque or stress, or of weight on a bit, for a force that it lacks."""
    roles, names = dict(part.header.roles), part.header.names
    for role, keys in _TORQUES.items():
        index = next((i for i, name in enumerate(names) if name.key in keys and i in part.columns), None)
        if role not in roles and index is not None:
            roles[role] = index
    return replace(part, header=replace(part.header, roles=roles))


def _friction(request: Request, part: Part) -> tuple[Part, str]:
    header, names = part.header, part.header.names
    index = coefficient_column(header)
    if "friction_force" in header.roles or index is None or index not in part.columns:
        return part, ""
    load = header.roles.get("normal_force")
    force: FloatArray | float
    if request.normal_force is not None:
        force, unit, source = request.normal_force, "N", f"the given {request.normal_force:g} N"
    elif load is not None and load in part.columns:
        force, source = part.columns[load], repr(names[load].raw)
        unit = unit_of(request, header, load) or ""
    else:
        return part, ""
    try:
        share = factor(names[index].unit or "", "")
    except UnitError:
        return part, ""
    name = f"{names[index].name} x load"
    derived = with_column(part, "friction_force", Name(name, name, unit or None), share * part.columns[index] * force)
    text = (
        f"the friction force was made of the coefficient {names[index].raw!r} times {source}; its sign is that of the "
        "coefficient, which many machines drop"
    )
    return derived, text


def _time(request: Request, part: Part) -> tuple[Part, str]:
    names = part.header.names
    columns = distance_columns(part.header)
    if "time" in part.header.roles or columns is None or not set(columns) <= set(part.columns) or part.rows < 2:
        return part, ""
    values = []
    for index, kind in zip(columns, ("length", "speed"), strict=True):
        try:
            scale = factor(unit_of(request, part.header, index) or "", SI_UNIT[kind])
        except UnitError:
            return part, ""
        values.append(scale * part.columns[index])
    distance, speed = values
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = 2.0 * np.diff(distance) / (speed[1:] + speed[:-1])
    if not (np.isfinite(steps).all() and (steps >= 0).all()):
        return part, ""
    name = Name("distance / speed", "distance / speed", SI_UNIT[KIND["time"]])
    derived = with_column(part, "time", name, np.concatenate(([0.0], np.cumsum(steps))))
    text = f"the time was made of {names[columns[0]].raw!r} over {names[columns[1]].raw!r}: the log has no clock"
    return derived, text


# Rotary modules: the speed at the contact is 2 pi rpm / 60 times the radius of the track; and stated speeds.

Module = Literal["linear", "rotary"]

_RPM: Final = ("rpm", "1/min", "min-1", "r/min", "rev/min", "u/min")
_RADIUS: Final = ("radius", "trackradius", "wearradius", "wearscarradius", "trackrad", "rayon", "raggio")
_ROTARY: Final = re.compile(r"rotary|rotat|disc|disk", re.IGNORECASE)
_LINEAR: Final = re.compile(r"linear|recip|stroke", re.IGNORECASE)
NAME: Final = "rpm x radius"


@dataclass(frozen=True)
class StatedVelocity:
    """The `Velocity` that the head of a CETR or Bruker step states without a unit.

    value: as it stands there. module: the drive module where the log tells it, whose unit is mm/min (linear) or rpm
    (rotary). speeds [m/s]: by module, what it would mean.
    """

    value: float
    module: Module | None
    speeds: Mapping[Module, float]


def stated_velocity(
    parameters: Mapping[str, object], about: Mapping[str, object], units: Mapping[str, str]
) -> StatedVelocity | None:
    """Read what the head of a step states of the drive; None where it states nothing or 0.

    parameters: of the step (`Step.parameters`). about: metadata of the log, whose script may name the module.
    units: units of the columns by name; one in revolutions per minute tells a rotary module.
    """
    value, radius = _number(parameters.get("Velocity")), _number(parameters.get("Radius"))
    if not value:
        return None
    words = " ".join(str(about.get(key, "")) for key in ("Script file", "note", "recipe", "Module", "Drive"))
    words = words.replace("\\", "/").rsplit("/", 1)[-1]
    rotary = any(unit in _RPM for unit in units.values()) or _ROTARY.search(words) is not None
    linear = _LINEAR.search(words) is not None
    module: Module | None = "rotary" if rotary and not linear else "linear" if linear and not rotary else None
    speeds: dict[Module, float] = {"linear": abs(value) * 1e-3 / 60.0}
    if radius:
        speeds["rotary"] = 2.0 * np.pi / 60.0 * abs(value) * abs(radius) * 1e-3
    return StatedVelocity(value, module, speeds)


def _number(text: object) -> float:
    match = re.match(r"\s*([+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d{1,2})?)\s*$", str(text or ""))
    return float(match[1]) if match else 0.0


def with_drive_of_rotation(request: Request, contents: Contents) -> Contents:
    """Return contents in which a rotary module tells the drive speed: its rpm times the radius of the track.

    The radius is a column of that name, or the Y carriage of an Rtec whose rotary module turns. Nothing changes where
    the user names a drive or a column already is one.
    """
    if contents.settled or "drive_speed" in request.columns:
        return contents
    parts, findings = list(contents.parts), list(contents.findings)
    for place, part in enumerate(parts):
        names = [(i, name) for i, name in enumerate(part.header.names) if i in part.columns]
        turns = next((i for i, name in names if (name.unit or "").lower() in _RPM), None)
        if turns is None or "drive_speed" in part.header.roles:
            continue
        turning = part.header.names[turns].name
        keys = (*_RADIUS, *(("yposition",) if _ROTARY.search(turning) else ()))
        radius = next((i for key in keys for i, name in names if name.key == key), None)
        unit = None if radius is None else unit_of(request, part.header, radius)
        if radius is None or kind_of(unit or "") != "length":
            continue
        speed = 2.0 * np.pi / 60.0 * part.columns[turns] * np.abs(part.columns[radius]) * factor(unit or "", "m")
        if np.isfinite(speed).all() and speed.any():
            parts[place] = with_column(part, "drive_speed", Name(NAME, NAME, "m/s"), speed)
            track = part.header.names[radius].name
            text = f"the drive speed is 2 pi {turning} / 60 times {track}, as a rotary module has it"
            findings.append(Finding("speed_from_rotation", "info", text))
    return replace(contents, parts=parts, findings=list(dict.fromkeys(findings)))
