"""One [[logs]] table: where the log is, and what differs from log to log."""

from __future__ import annotations

import os
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal

from identify.base.errors import SceneError
from identify.scene.rig import StatedDamping, is_dashpot, speed_or_quantity
from identify.scene.tables import Table, share, span
from identify.scene.values import LogEntry, Rig

LOG = tuple(field.name for field in fields(LogEntry))  # the keys are the fields


def read_log_entry(value: Any, number: int, folder: Path, rig: Rig, damped: StatedDamping) -> LogEntry:
    """One log of the scene.

    Args:
        number: its place among the logs, from 1.
        folder: what its relative path is relative to.
        rig: what [rig] says; damped: how it states the damping, which follows the log's own stiffness and mass.

    Raises:
        SceneError: an unknown key, no path, or a value no log can have.
    """
    where = f"[[logs]] number {number}"
    table = Table.of(value, where, LOG, '[[logs]] path = "slow.csv"')
    path = table.text("path")
    if path is None:
        raise SceneError(f'{where} has no path; give path = "slow.csv", relative to the scene file')
    exclude = table.data.get("exclude", [])
    if not isinstance(exclude, (list, tuple)):
        raise SceneError(f'{table.place("exclude")} is {exclude!r}; expected pairs of times [["5 s", "6 s"]]')
    speed = table.data.get("drive_speed")
    stiffness, mass = table.quantity("stiffness", "N/m"), table.quantity("mass", "kg")
    own = StatedDamping(dashpot=table.quantity("damping", "N s/m")) if is_dashpot(table) else damped
    follows = is_dashpot(table) or stiffness is not None or (mass is not None and damped.dashpot is not None)
    damping = own.at(stiffness or rig.stiffness, mass or rig.mass) if follows else None
    if "damping" in table.data and not is_dashpot(table):
        damping = table.quantity("damping", "N/m")
    return LogEntry(
        path=located(folder, path),
        drive_speed=None if speed is None else speed_or_quantity(speed, "m/s", table.place("drive_speed")),
        step=table.whole("step"),
        run=table.whole("run"),
        columns=table.words("columns"),
        units=table.words("units"),
        normal_force=table.quantity("normal_force", "N"),
        stiffness=stiffness,
        mass=mass,
        damping=damping,
        noise=table.quantity("noise", "N"),
        window=table.span("window"),
        exclude=tuple(span(pair, table.place("exclude")) for pair in exclude),
        skip_cycles=table.whole("skip_cycles") or 0,
        tare=_zero(table, "tare"),
        normal_tare=_zero(table, "normal_tare"),
        crosstalk=_or_strokes(table, "crosstalk", ""),
        tilt=_or_strokes(table, "tilt", "rad"),
        flip_sign=table.truth("flip_sign"),
        labels=table.words("labels") or {},
    )


def located(folder: Path, path: str) -> Path:
    """The file a scene or manifest names: relative to its folder; `~` is a home where there is such a user."""
    return folder / os.path.expanduser(path)  # noqa: PTH111 - that of pathlib raises where there is none


def _zero(table: Table, key: str) -> float | tuple[float, float] | None:
    """A force [N] to take off, or the times [s] between which it is measured."""
    return table.span(key) if isinstance(table.data.get(key), (list, tuple)) else table.quantity(key, "N")


def _or_strokes(table: Table, key: str, unit: str) -> float | Literal["strokes"] | None:
    """A number, or the word that has it taken from both stroke directions; a pure number may be in percent."""
    value = table.data.get(key)
    if value == "strokes":
        return "strokes"
    percent = None if unit else share(value, table.place(key))
    return table.quantity(key, unit) if percent is None else percent
