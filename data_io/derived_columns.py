"""Columns that a log holds in another form: friction force as coefficient times load, time as distance over speed."""

from dataclasses import replace

import numpy as np

from data_io.columns import KIND, Header, Name, coefficient_column, distance_columns
from data_io.errors import UnitError
from data_io.frozen import Finding, FloatArray
from data_io.part import Contents, Part
from data_io.source import Request
from data_io.units import SI_UNIT, factor


def with_derived_columns(request: Request, contents: Contents) -> Contents:
    """Return contents with a friction force or a time made of other columns where a part holds none.

    Each is said in a finding. Where a unit is missing nothing is made: the error about the missing column says so.
    """
    if contents.settled:
        return contents
    findings = list(contents.findings)
    parts = []
    for part in contents.parts:
        part, text = _friction(request, part)
        if text:
            findings.append(Finding("friction_from_coefficient", "warning", text))
        part, text = _time(request, part)
        if text:
            findings.append(Finding("time_from_distance", "warning", text))
        parts.append(part)
    return replace(contents, parts=parts, findings=list(dict.fromkeys(findings)))


def _friction(request: Request, part: Part) -> tuple[Part, str]:
    header, names = part.header, part.header.names
    index = coefficient_column(header)
    if "friction_force" in header.roles or index is None or index not in part.columns:
        return part, ""
    load = header.roles.get("normal_force")
    force: FloatArray | float
    if request.normal_force is not None:
        force, unit, told = request.normal_force, "N", f"the given {request.normal_force:g} N"
    elif load is not None and load in part.columns:
        force, told = part.columns[load], repr(names[load].raw)
        unit = request.units.get("normal_force") or request.units.get(names[load].name) or names[load].unit or ""
    else:
        return part, ""
    try:
        share = factor(names[index].unit or "", "")
    except UnitError:
        return part, ""
    name = f"{names[index].name} x load"
    made = _with_column(part, "friction_force", Name(name, name, unit or None), share * part.columns[index] * force)
    text = (
        f"the friction force was made of the coefficient {names[index].raw!r} times {told}; its sign is that of the "
        "coefficient, which many machines drop"
    )
    return made, text


def _time(request: Request, part: Part) -> tuple[Part, str]:
    names = part.header.names
    found = distance_columns(part.header)
    if "time" in part.header.roles or found is None or not set(found) <= set(part.columns) or part.rows < 2:
        return part, ""
    values = []
    for index, kind in zip(found, ("length", "speed"), strict=True):
        name = names[index]
        own = request.units.get("drive_speed") if part.header.roles.get("drive_speed") == index else None
        try:
            scale = factor(own or request.units.get(name.name) or name.unit or "", SI_UNIT[kind])
        except UnitError:
            return part, ""
        values.append(scale * part.columns[index])
    distance, speed = values
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = 2.0 * np.diff(distance) / (speed[1:] + speed[:-1])
    if not (np.isfinite(steps).all() and (steps >= 0).all()):
        return part, ""
    name = Name("distance / speed", "distance / speed", SI_UNIT[KIND["time"]])
    made = _with_column(part, "time", name, np.concatenate(([0.0], np.cumsum(steps))))
    text = f"the time was made of {names[found[0]].raw!r} over {names[found[1]].raw!r}: the log holds no clock"
    return made, text


def _with_column(part: Part, role: str, name: Name, values: FloatArray) -> Part:
    index = len(part.header.names)
    header = Header((*part.header.names, name), {**part.header.roles, role: index}, part.header.passed_over)
    return replace(part, header=header, columns={**part.columns, index: values})
