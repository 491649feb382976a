"""Rotary modules: the speed at the contact is 2 pi rpm / 60 times the radius of the track; and stated speeds."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from data_io.columns import Header, Name
from data_io.errors import UnitError
from data_io.frozen import Finding
from data_io.part import Contents, Part
from data_io.source import Request
from data_io.units import factor

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
    (rotary). radius [m]: of the track, None where the head states none. speeds [m/s]: by module, what it would mean.
    """

    value: float
    module: Module | None
    radius: float | None
    speeds: Mapping[Module, float]

    @property
    def unit(self) -> str | None:
        """Unit of the value, None where the module is not told."""
        return None if self.module is None else {"linear": "mm/min", "rotary": "rpm"}[self.module]


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
    return StatedVelocity(value, module, abs(radius) * 1e-3 if radius else None, speeds)


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
    turned = [_turned(request, part) for part in contents.parts]
    told = [text for _, text in turned if text]
    if not told:
        return contents
    text = f"the drive speed is {told[0]}, as a rotary module has it"
    findings = [*contents.findings, Finding("speed_from_rotation", "info", text)]
    return replace(contents, parts=[part for part, _ in turned], findings=findings)


def _turned(request: Request, part: Part) -> tuple[Part, str]:
    names = part.header.names
    turns = next((i for i, n in enumerate(names) if (n.unit or "").lower() in _RPM and i in part.columns), None)
    if turns is None or "drive_speed" in part.header.roles:
        return part, ""
    radius = next((i for i, n in enumerate(names) if n.key in _RADIUS and i in part.columns), None)
    if radius is None and _ROTARY.search(names[turns].name):
        radius = next((i for i, n in enumerate(names) if n.key == "yposition" and i in part.columns), None)
    if radius is None:
        return part, ""
    try:
        scale = factor(request.units.get(names[radius].name) or names[radius].unit or "", "m")
    except UnitError:
        return part, ""
    speed = 2.0 * np.pi / 60.0 * part.columns[turns] * np.abs(part.columns[radius]) * scale
    if not np.isfinite(speed).all() or not speed.any():
        return part, ""
    index = len(names)
    header = Header((*names, Name(NAME, NAME, "m/s")), {**part.header.roles, "drive_speed": index},
                    part.header.passed_over)  # fmt: skip
    text = f"2 pi {names[turns].name} / 60 times {names[radius].name}"
    return replace(part, header=header, columns={**part.columns, index: speed}), text
