"""The paper's closed forms over the plane of a map: where they see stick-slip end and sliding lose its stability."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.prediction.comparison import beyond, contact
from identify.prediction.groups import groups, settings
from identify.prediction.limits import sliding_margin, slip_margin
from identify.prediction.map_axes import moved_values
from identify.prediction.plane import Plane

Array = NDArray[np.float64]

POINTS = 240  # along each quantity
SLOW, LONG, RESTED = 0.5, 10.0, 3.0  # a V_max at most; slip over D, stick over t_cr, at least: within 5 %, measured


@dataclass(frozen=True)
class ClosedPlane:
    """Coordinates x (n,), y (n,); on their grid (n, n), row by row in y: margins of the slip and of steady sliding,
    positive where the mass slides on, and where sliding is stable; whether what is assumed of a slip holds (of the one
    that would be, where the mass slides on)."""

    x: Array
    y: Array
    slip: Array
    sliding: Array
    valid: NDArray[np.bool_]


def closed_plane(plane: Plane, points: int = POINTS) -> ClosedPlane | None:
    """The closed forms over a plane; None where the model has effects that they know nothing of."""
    if beyond(plane.site.model.effects):
        return None
    x, y = (np.linspace(places[0], places[-1], points) for places in (plane.x_places, plane.y_places))
    grid_x, grid_y = np.meshgrid(plane.x.value_at(x), plane.y.value_at(y))
    values = moved_values(plane.site, {plane.x.name: grid_x, plane.y.name: grid_y})
    pair = contact(values)
    with np.errstate(all="ignore"):
        q = settings(pair.rig, pair.friction, values["drive_speed"], values["normal_force"])
        g = groups(pair.rig, pair.friction, values["drive_speed"], values["normal_force"])
        valid = _valid(q, g.alpha)
        return ClosedPlane(x, y, np.asarray(slip_margin(q)), np.asarray(sliding_margin(q)), valid)


def _valid(q: Mapping[str, Any], alpha: Array) -> NDArray[np.bool_]:
    """Whether friction is still linear at the fastest, the slip wears the contact out at once, and the stick that the
    drop takes saturates it."""
    size = (q["mu_s"] - q["mu_k0"]) * q["normal_force"]
    fastest = q["drive_speed"] + size / np.sqrt(q["mass"] * q["stiffness"])
    drop, ageing = 2.0 * size / q["stiffness"], (q["D"] > 0.0) & (q["t_cr"] > 0.0)
    worn = ~ageing | (drop > LONG * q["D"])
    saturated = ~ageing | (drop / q["drive_speed"] > RESTED * q["t_cr"])
    return np.asarray((q["a"] * fastest < SLOW) & worn & saturated & (alpha > -1.0))
