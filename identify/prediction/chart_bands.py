"""What is drawn on a chart beside the answer: bands of its boundaries, and boundaries of the closed forms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import NORMAL
from identify.prediction.chart import Boundary
from identify.prediction.closed_forms import beyond, known_settings
from identify.prediction.groups import formed
from identify.prediction.map_axes import Axis, Site, axis, moved_values
from identify.prediction.map_grid import Plane
from identify.prediction.stability import critical_friction, log_critical_loading

# ----------------------------------------------------------------------------------------------------------------------
# The paper's closed forms over the plane of a map: where they see stick-slip end and sliding lose its stability.
# ----------------------------------------------------------------------------------------------------------------------

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
    with np.errstate(all="ignore"):
        q = known_settings(values)
        return ClosedPlane(x, y, slip_margin(q), sliding_margin(q), _valid(q, formed(q)["alpha"]))


def slip_margin(q: Mapping[str, object]) -> Array:
    """ln Phi_cr - ln Phi of `settings` (eqs. 17-18): positive where the slip goes on for ever."""
    g = formed(q)
    limit, never = log_critical_loading(g["alpha"]), np.where(g["alpha"] > -1, np.inf, np.nan)
    return np.where(g["loading"] > 0, limit - np.log(g["loading"]), never)


def sliding_margin(q: Mapping[str, object]) -> Array:
    """Pi_fc - Pi of `settings` (eqs. 19-25), z where the contact is worn: positive where sliding is stable."""
    g = formed(q)
    decided = g["z"] * g["tau_cr"] > -1
    ageing = np.where(decided, critical_friction(g["z"] / 2, g["tau_cr"]) - g["Pi"], -np.inf)
    return np.where(g["v_acr"] <= 1, ageing, g["z"])


def _valid(q: Mapping[str, Any], alpha: Array) -> NDArray[np.bool_]:
    """Whether friction is still linear at the fastest, the slip wears the contact out at once, and the stick that the
    drop takes saturates it."""
    size = (q["mu_s"] - q["mu_k0"]) * q["normal_force"]
    fastest = q["drive_speed"] + size / np.sqrt(q["mass"] * q["stiffness"])
    drop, ageing = 2.0 * size / q["stiffness"], (q["D"] > 0.0) & (q["t_cr"] > 0.0)
    worn = ~ageing | (drop > LONG * q["D"])
    saturated = ~ageing | (drop / q["drive_speed"] > RESTED * q["t_cr"])
    return np.asarray((q["a"] * fastest < SLOW) & worn & saturated & (alpha > -1.0))


# ----------------------------------------------------------------------------------------------------------------------
# What the uncertainty of pair and rig means on a map: the region of the operating point, bands around boundaries.
#
# The region is what is known of the two quantities themselves. A boundary is drawn for the estimates of everything
# else, so its band is what those others leave open when the two quantities are given (conditional covariance).
# ----------------------------------------------------------------------------------------------------------------------

LEVEL = 5.991464547107979  # chi-square of two dimensions, 95 %
STEP = 1e-6  # relative, of what the covariance names
WIDEST = 0.5  # half width of a band, as a share of the map, beyond which nothing is drawn
CORNERS = 181  # of an ellipse
SMOOTH = 2  # points either way over which the direction of a boundary is taken


@dataclass(frozen=True)
class KnownCovariance:
    """Covariance (f, f) of named values [SI]: parameters of the model, "drive_speed", "normal_force"."""

    names: tuple[str, ...]
    covariance: Array

    @staticmethod
    def of(names: Sequence[str], covariance: Array) -> KnownCovariance | None:
        """What is known, without the names whose variance is not finite; None if nothing is left."""
        kept = [i for i in range(len(names)) if np.isfinite(covariance[i, i]) and covariance[i, i] >= 0.0]
        matrix = covariance[np.ix_(kept, kept)]
        if not kept or not np.all(np.isfinite(matrix)):
            return None
        return KnownCovariance(tuple(names[i] for i in kept), matrix)


def _moved(site: Site, name: str, by: float) -> Site:
    if name == "drive_speed":
        return replace(site, drive_speed=site.drive_speed + by)
    if name == "normal_force":
        return replace(site, normal_force=site.normal_force + by)
    return replace(site, values={**site.values, name: site.values[name] + by})


def _value(site: Site, name: str) -> float:
    own = {"drive_speed": site.drive_speed, "normal_force": site.normal_force}
    return float(own[name] if name in own else site.values[name])


def _slopes(plane: Plane, known: KnownCovariance) -> Array:
    """How the coordinates of the operating point move with what is known: shape (2, f)."""
    out = np.zeros((2, len(known.names)))
    for column, name in enumerate(known.names):
        step = STEP * (abs(_value(plane.site, name)) or 1.0)
        for row, q in enumerate((plane.x, plane.y)):
            above, below = (axis(_moved(plane.site, name, s * step), q.name).value for s in (1.0, -1.0))
            out[row, column] = (_place(q, above) - _place(q, below)) / (2.0 * step)
    return out


def _place(q: Axis, value: float) -> float:
    return q.place(max(value, 1e-300)) if q.logarithmic else q.place(value)


def region(plane: Plane, known: KnownCovariance) -> Array | None:
    """The 95 % confidence region of the operating point: a closed line (n, 2) in coordinates; None where neither
    quantity is uncertain."""
    slopes = _slopes(plane, known)
    variances, directions = np.linalg.eigh(slopes @ known.covariance @ slopes.T)
    if not variances[-1] > 0.0:
        return None
    turn = np.linspace(0.0, 2.0 * np.pi, CORNERS)
    radii = np.sqrt(LEVEL * np.maximum(variances, 0.0))
    centre = np.array([plane.x.place(plane.x.value), plane.y.place(plane.y.value)])
    return np.asarray(centre + np.column_stack([radii[0] * np.cos(turn), radii[1] * np.sin(turn)]) @ directions.T)


def _given_axes(plane: Plane, known: KnownCovariance) -> Array:
    """Covariance of what is known while the two quantities of the map are given."""
    slopes, c = _slopes(plane, known), known.covariance
    both = c @ slopes.T
    return np.asarray(c - both @ np.linalg.pinv(slopes @ both, rcond=1e-12) @ both.T)


def bands(plane: Plane, boundary: Boundary, known: KnownCovariance) -> list[tuple[Array, Array]]:
    """Both sides of the 95 % band of every piece of a boundary, (n, 2) each in coordinates: how far the boundary moves
    along the edge it crosses, seen at a right angle to the boundary in the picture."""
    covariance, names = _given_axes(plane, known), (*plane.site.model.parameter_names, "normal_force", "drive_speed")
    columns = [names.index(name) for name in known.names]
    origin = np.array([plane.x_places[0], plane.y_places[0]])
    size = np.array([np.ptp(plane.x_places), np.ptp(plane.y_places)])
    out = []
    for points, edges in boundary.lines():
        widths = np.full(len(edges), np.nan)
        for i, edge in enumerate(edges):
            if edge is not None and edge in boundary.crossings:
                slope = boundary.crossings[edge].slopes[columns]
                variance = float(slope @ covariance @ slope)
                share = NORMAL * float(np.sqrt(max(variance, 0.0)))
                widths[i] = share / size[0 if edge[0] == "x" else 1]
        flat = (points - origin) / size
        ahead, behind = (np.clip(np.arange(len(flat)) + s * SMOOTH, 0, len(flat) - 1) for s in (1, -1))
        along = flat[ahead] - flat[behind]
        with np.errstate(all="ignore"):
            normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
        direction = np.array([0 if edge is not None and edge[0] == "x" else 1 for edge in edges])
        push = widths * np.abs(normal[np.arange(len(edges)), direction])
        ok = np.isfinite(push) & (push < WIDEST)
        if np.sum(ok) > 2:
            out.append(tuple(origin + size * (flat[ok] + s * push[ok, None] * normal[ok]) for s in (1.0, -1.0)))
    return [(left, right) for left, right in out]
