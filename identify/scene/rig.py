"""The [rig] table: values with their tolerances, damping in any of its forms, speeds and programmes."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data_io.units import UnitError, parse_quantity
from identify.base.errors import SceneError
from identify.scene.tables import DAMPING, LOG, RIG, TIED, TomlTable, is_number, share, stated
from identify.scene.values import LogEntry, Rig

RIG_PARAMETERS = ("mass", "stiffness", "damping")
BACKSLASH = "a backslash within \" begins an escape: write paths of Windows within ', as in 'C:\\logs\\new.txt'"
LARGEST = 1e300  # what is larger is no number, and refused as that


@dataclass(frozen=True)
class StatedDamping:
    """How [rig] states the damping, where it follows the stiffness or the mass that a log has for itself: `ratio` h/k,
    or `dashpot` c [N s/m], with h = c sqrt(k/m); both None: h itself."""

    ratio: float | None = None
    dashpot: float | None = None

    def at(self, stiffness: float, mass: float) -> float | None:
        """h [N/m] of a rig with this stiffness [N/m] and mass [kg]; None where h itself is stated."""
        if self.dashpot is not None:
            return self.dashpot * math.sqrt(stiffness / mass)
        return None if self.ratio is None else self.ratio * stiffness


def question_bare_numbers(document: Mapping[str, object]) -> None:
    """Refuse a number without a unit that no tribometer has in SI: its unit was forgotten.

    Raises:
        SceneError: which one, and how to write it.
    """
    logs = document.get("logs", [])
    logs = logs if isinstance(logs, list) else []
    tables = [("[rig]", document.get("rig")), *((f"[[logs]] number {n}", log) for n, log in enumerate(logs, 1))]
    for where, table in tables:
        for name, key in RIG.items() if isinstance(table, Mapping) else ():
            value = table.get(name)
            for number in _bare_numbers(value.get("value") if isinstance(value, Mapping) else value):
                if key.usual and number and not key.usual[0] <= abs(number) <= key.usual[1]:
                    raise SceneError(
                        f"{where} {name} is the bare number {number:g}, that is {number:g} {key.unit}, which no usual "
                        f'tribometer has; write its unit: "{number:g} {key.usual[2]}", or "{number:g} {key.unit}" if '
                        "so meant"
                    )


def _bare_numbers(value: object) -> list[float]:
    """A number, or the speeds of a programme; none of text."""
    if isinstance(value, (list, tuple)):
        return [speed for pair in value if isinstance(pair, (list, tuple)) for speed in _bare_numbers_of(pair[1:2])]
    return _bare_numbers_of([value])


def _bare_numbers_of(values: Sequence[object]) -> list[float]:
    return [v for v in values if isinstance(v, (int, float)) and not isinstance(v, bool) and abs(v) < LARGEST]


def with_listed(rig: Mapping[str, object], parameters: object) -> dict[str, Any]:
    """The [rig] table with a value for each quantity that it leaves out and [parameters] has searched: its start, the
    mean of its prior, or the middle of its bounds.

    Raises:
        SceneError: one of these that cannot be read.
    """
    found = dict(rig)
    for key in RIG_PARAMETERS:
        given = any(name in rig for name in (DAMPING if key == "damping" else (key,)))
        said = parameters.get(key) if isinstance(parameters, Mapping) else None
        if given or not isinstance(said, Mapping):
            continue
        where, unit, prior = f"[parameters] {key}", RIG[key].unit, said.get("prior")
        mean = prior.get("mean") if isinstance(prior, Mapping) else None
        if (value := said.get("start", mean)) is not None:
            found[key] = stated(value, unit, where)
        elif "lower" in said and "upper" in said:
            lower, upper = (stated(said[word], unit, f"{where} {word}") for word in ("lower", "upper"))
            found[key] = math.sqrt(lower * upper) if lower * upper > 0.0 else 0.5 * (lower + upper)
    return found


def _with_tolerance(table: TomlTable, key: str, unit: str) -> tuple[Any, float | None]:
    """The value of a rig key, and its relative standard deviation where one is stated."""
    value = table.data.get(key)
    if not isinstance(value, Mapping):
        return value, None
    inner = TomlTable.of(value, table.place(key), ("value", "tolerance"), '{ value = "0.2 kg", tolerance = "2 %" }')
    if "value" not in value:
        raise SceneError(f"{inner.where} has no value; write {{ value = …, tolerance = … }}")
    tolerance = value.get("tolerance")
    relative = share(tolerance, inner.place("tolerance"))
    if relative is not None:
        return value["value"], relative
    if isinstance(tolerance, str):
        reference = RIG[key].read(value["value"], unit, inner.where)
        if isinstance(reference, tuple):
            raise SceneError(
                f"{inner.place('tolerance')} of a programme is {tolerance!r}; expected a share such as 2 %"
            )
        try:
            error = stated(tolerance, unit, inner.place("tolerance"))
        except SceneError as reason:
            raise SceneError(f"{reason}; a share such as 2 % does as well") from None
        return value["value"], error / abs(reference)
    return value["value"], None if tolerance is None else stated(tolerance, "", inner.place("tolerance"))


def read_rig(table: TomlTable, damped_by: str | None, inertial: bool = True) -> tuple[Rig, StatedDamping]:
    """The rig, and how its damping was stated.

    Args:
        damped_by: the effect that is on and needs a damping, None without one.
        inertial: whether a mass is needed; 0 stands for none.

    Raises:
        SceneError: a missing mass, stiffness or damping, several dampings, or a value no rig can have.
    """
    given = [name for name in DAMPING if name in table.data]
    if len(given) > 1:
        raise SceneError(f"[rig] gives the damping {len(given)} times ({', '.join(given)}); keep one of them")
    if damped_by and not given:
        raise SceneError(
            f"[rig] has no damping although the effect {damped_by} is on; give one of {', '.join(DAMPING)}"
        )
    values: dict[str, Any] = {}
    tolerances: dict[str, float] = {}
    ratios: dict[str, float] = {}
    dashpot = is_dashpot(table)
    for key in ("mass", "stiffness", *DAMPING, "drive_speed", "normal_force", "noise"):
        unit = "N s/m" if key == "damping" and dashpot else RIG[key].unit
        value, tolerance = _with_tolerance(table, key, unit)
        values[key] = None if value is None else RIG[key].read(value, unit, table.place(key))
        if tolerance is not None:
            tolerances["damping" if key in DAMPING else key] = tolerance
        if tolerance and key in ("zeta", "loss_factor"):
            # Known of h/k: h is as uncertain as k on top of it, and errs with it.
            ratios["zeta"] = tolerance
            tolerances["damping"] = math.hypot(tolerance, tolerances.get("stiffness", 0.0))
    if TIED in table.data:
        ratios["natural_frequency"] = table.get(TIED)
    for key, example in (("mass", "0.2 kg"), ("stiffness", "1470 N/m")):
        if key == "mass" and not inertial:
            values[key] = values[key] or 0.0
        if values[key] is None:
            raise SceneError(f'[rig] has no {key}; give {key} = "{example}"')
    ratio = _damping_ratio({key: values.pop(key) for key in DAMPING[1:]})
    how = StatedDamping(ratio, values["damping"] if dashpot else None)
    if dashpot and not values["mass"]:
        raise SceneError("[rig] damping is in N s/m, which takes a mass to be h of eq. 1; give the mass, or h in N/m")
    followed = how.at(values["stiffness"], values["mass"])
    values["damping"] = values["damping"] or 0.0 if followed is None else followed
    return Rig(**values, tolerances=tolerances, ratio_tolerances=ratios), how


def is_dashpot(table: TomlTable) -> bool:
    """Whether the damping is that of a dashpot, in N s/m."""
    value = table.data.get("damping")
    text = value.get("value") if isinstance(value, Mapping) else value
    if not isinstance(text, str):
        return False
    try:
        parse_quantity(text, "N s/m")
    except UnitError:
        return False
    return not is_number(text)


def _damping_ratio(stated: Mapping[str, float | None]) -> float | None:
    """h/k = 2 zeta = loss factor, from whichever is stated; log decrement d: zeta = d/sqrt(4 pi^2 + d^2)."""
    if stated["zeta"] is not None:
        if stated["zeta"] > 1.0:
            raise SceneError(
                f"[rig] zeta is {stated['zeta']:g}, more than critical damping (1); expected a ratio such as 0.05 or "
                '"5 %"; a rig that hardly swings has damping = "… N/m"'
            )
        return 2.0 * stated["zeta"]
    decrement = stated["log_decrement"]
    if decrement is not None:
        return 2.0 * decrement / math.hypot(2.0 * math.pi, decrement)
    return stated["loss_factor"]


# ----------------------------------------------------------------------------------------------------------------------
# One [[logs]] table: where the log is, and what differs from log to log.
# ----------------------------------------------------------------------------------------------------------------------


def read_log_entry(value: object, number: int, folder: Path, rig: Rig, damped: StatedDamping) -> LogEntry:
    """One log of the scene.

    Args:
        number: its place among the logs, from 1.
        folder: what its relative path is relative to.
        rig: what [rig] says; damped: how it states the damping, which follows the log's own stiffness and mass.

    Raises:
        SceneError: an unknown key, no path, or a value no log can have.
    """
    where = f"[[logs]] number {number}"
    table = TomlTable.of(value, where, LOG, '[[logs]] path = "slow.csv"')
    if "path" not in table.data:
        raise SceneError(f'{where} has no path; give path = "slow.csv", relative to the scene file')
    dashpot = is_dashpot(table)
    found = {name: table.get(name) for name in table.data if name != "damping" or not dashpot}
    stiffness, mass = found.get("stiffness"), found.get("mass")
    own = StatedDamping(dashpot=stated(table.data["damping"], "N s/m", table.place("damping"))) if dashpot else damped
    follows = dashpot or stiffness is not None or (mass is not None and damped.dashpot is not None)
    if follows and "damping" not in found:
        found["damping"] = own.at(stiffness or rig.stiffness, mass or rig.mass)
    return LogEntry(**(found | {"path": located(folder, found["path"])}))


def located(folder: Path, path: str) -> Path:
    """The file a scene or manifest names: relative to its folder; `~` is a home where there is such a user."""
    if any(letter < " " for letter in path):
        raise SceneError(f"the path {path!r} holds a control character; {BACKSLASH}")
    return folder / os.path.expanduser(path)  # noqa: PTH111 - that of pathlib raises where there is none
