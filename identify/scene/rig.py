"""The [rig] table: values with their tolerances, damping in any of its forms, speeds and programmes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from identify.base.errors import SceneError
from identify.scene.tables import Table, share, stated
from identify.scene.values import DriveSpeed, Rig

DAMPING = ("damping", "zeta", "loss_factor", "log_decrement")
RIG = ("mass", "stiffness", *DAMPING, "damping_frequency", "drive_speed", "normal_force", "noise")
RIG_UNITS = {"mass": "kg", "stiffness": "N/m", "damping": "N/m", "normal_force": "N", "noise": "N"}


def _with_tolerance(table: Table, key: str, unit: str) -> tuple[Any, float | None]:
    """The value of a rig key, and its relative standard deviation where one is stated."""
    value = table.data.get(key)
    if not isinstance(value, Mapping):
        return value, None
    inner = Table.of(value, table.place(key), ("value", "tolerance"), '{ value = "0.2 kg", tolerance = "2 %" }')
    if "value" not in value:
        raise SceneError(f"{inner.where} has no value; write {{ value = …, tolerance = … }}")
    tolerance = value.get("tolerance")
    relative = share(tolerance, inner.place("tolerance"))
    if relative is not None:
        return value["value"], relative
    if isinstance(tolerance, str):
        reference = speed_or_quantity(value["value"], unit, inner.where)
        if isinstance(reference, tuple):
            raise SceneError(
                f"{inner.place('tolerance')} of a programme is {tolerance!r}; expected a share such as 2 %"
            )
        try:
            error = stated(tolerance, unit, inner.place("tolerance"))
        except SceneError as reason:
            raise SceneError(f"{reason}; a share such as 2 % does as well") from None
        return value["value"], error / abs(reference)
    return value["value"], inner.quantity("tolerance", "")


def speed_or_quantity(value: Any, unit: str, where: str) -> DriveSpeed:
    """A quantity in SI; a speed may be a programme, pairs of start [s] and speed [m/s].

    Raises:
        SceneError: neither.
    """
    if unit != "m/s" or not isinstance(value, (list, tuple)):
        return stated(value, unit, where)
    if not all(isinstance(pair, (list, tuple)) and len(pair) == 2 for pair in value):
        raise SceneError(f'{where} is {value!r}; expected pairs of start and speed: [[0, "0.1 mm/s"], [30, "0 mm/s"]]')
    return tuple((stated(start, "s", where), stated(speed, "m/s", where)) for start, speed in value)


def read_rig(table: Table, damped_by: str | None, inertial: bool = True) -> tuple[Rig, float | None]:
    """The rig, and h/k where the damping was stated as a ratio (it then follows a log's own stiffness).

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
    for key in (*RIG_UNITS, "drive_speed", *DAMPING[1:]):
        unit = RIG_UNITS.get(key, "m/s" if key == "drive_speed" else "")
        value, tolerance = _with_tolerance(table, key, unit)
        values[key] = None if value is None else speed_or_quantity(value, unit, table.place(key))
        if tolerance is not None:
            tolerances["damping" if key in DAMPING else key] = tolerance
    for key, example in (("mass", "0.2 kg"), ("stiffness", "1470 N/m")):
        if key == "mass" and not inertial:
            values[key] = values[key] or 0.0
        if values[key] is None:
            raise SceneError(f'[rig] has no {key}; give {key} = "{example}"')
    ratio = _damping_ratio({key: values.pop(key) for key in DAMPING[1:]})
    if ratio is not None:
        values["damping"] = ratio * values["stiffness"]
    values["damping"] = values["damping"] if values["damping"] is not None else 0.0
    return Rig(**values, tolerances=tolerances), ratio


def _damping_ratio(stated: Mapping[str, float | None]) -> float | None:
    """h/k = 2 zeta = loss factor, from whichever is stated; log decrement d: zeta = d/sqrt(4 pi^2 + d^2)."""
    if stated["zeta"] is not None:
        return 2.0 * stated["zeta"]
    decrement = stated["log_decrement"]
    if decrement is not None:
        return 2.0 * decrement / math.hypot(2.0 * math.pi, decrement)
    return stated["loss_factor"]
