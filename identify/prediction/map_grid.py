"""The grid of a map: the settings at its nodes, its edges, and outlines of regions through exact crossings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from contourpy import contour_generator
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.prediction.map_axes import Axis, Site, admissible, axis, check_axes, moved_values, setting_path
from identify.prediction.path import SettingPath

# ----------------------------------------------------------------------------------------------------------------------
# The outline of a region of a grid: closed loops through the edges of the grid at the places it is crossed at.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
MIDDLE = 1e-6  # of an edge: how far from its middle an outline crosses it
Edge = tuple[str, int, int]  # "x" or "y": from node (row, column) to the next in that direction; of the padded grid


@dataclass(frozen=True)
class Loop:
    """A closed outline, the region on its left: points (n, 2) as (x, y); edges of the grid (n,) as (direction, row,
    column) of the node before the crossing, None where the outline is the frame of the grid."""

    points: Array
    edges: tuple[Edge | None, ...]

    def open_pieces(self) -> list[list[int]]:
        """Runs of points that are no frame, as indices; a loop that never meets the frame is closed by its first."""
        n, framed = len(self.edges), [i for i, edge in enumerate(self.edges) if edge is None]
        if not framed:
            return [[*range(n), 0]]
        order = [(framed[0] + i) % n for i in range(n)]
        pieces: list[list[int]] = [[]]
        for i in order:
            if self.edges[i] is None:
                pieces.append([])
            else:
                pieces[-1].append(i)
        return [piece for piece in pieces if piece]


def outline(inside: Bools, x: Array, y: Array, across_x: Array, across_y: Array) -> list[Loop]:
    """The closed loops around a region.

    Args:
        inside: (n_y, n_x), whether a node belongs to it. x (n_x,), y (n_y,): coordinates, rising.
        across_x (n_y, n_x - 1): x at which the region is crossed between two nodes of a row that differ;
        across_y (n_y - 1, n_x): y between two nodes of a column. Where they are NaN, half the way.
    """
    frame = np.pad(inside, 1).astype(float)
    # On a grid of zeros and ones every point lies on the middle of an edge, which tells the edge; regions that meet at
    # a corner only are apart, as the level is above that of their middle.
    lines = contour_generator(z=frame, name="serial").lines(0.5 + MIDDLE)
    loops = []
    for points in lines:
        edges = [_edge(i, j) for i, j in np.asarray(points)[:-1].tolist()]
        crossings = np.array([_crossing(e, x, y, across_x, across_y) for e in edges])
        loops.append(Loop(crossings, tuple(_of_grid(e, x.size, y.size) for e in edges)))
    return loops


def _edge(i: float, j: float) -> Edge:
    """The edge of the padded grid on which a point (column, row) of an outline lies."""
    return ("x", round(j), int(i)) if j == round(j) else ("y", int(j), round(i))


def _of_grid(edge: Edge, n_x: int, n_y: int) -> Edge | None:
    """The edge in the grid without its padding; None for one that leads out of it."""
    direction, j, i = edge[0], edge[1] - 1, edge[2] - 1
    if direction == "x":
        return (direction, j, i) if 0 <= i < n_x - 1 else None
    return (direction, j, i) if 0 <= j < n_y - 1 else None


def _crossing(edge: Edge, x: Array, y: Array, across_x: Array, across_y: Array) -> tuple[float, float]:
    """The point at which an edge of the padded grid is crossed; an edge that leads out of it at the frame."""
    direction, j, i = edge[0], edge[1] - 1, edge[2] - 1
    inner = _of_grid(edge, x.size, y.size) is not None
    if direction == "x":
        return _between(x, i, across_x[j, i] if inner else np.nan), float(y[j])
    return float(x[i]), _between(y, j, across_y[j, i] if inner else np.nan)


def _between(places: Array, i: int, found: float) -> float:
    """Where it was found, else half way between a node and the next; beyond the first and the last node, there."""
    if np.isfinite(found):
        return float(found)
    low, high = places[max(i, 0)], places[min(i + 1, places.size - 1)]
    return float(0.5 * (low + high))


# ----------------------------------------------------------------------------------------------------------------------
# The grid of a map: settings at its nodes, and the ways along its edges.
# ----------------------------------------------------------------------------------------------------------------------

REACH = {"drive_speed": 30.0}  # factor either way of the default range; others:
FACTOR, SPAN = 10.0, (0.3, 1.7)  # of what is told in powers, of what is told evenly
FEWEST, MOST = 2, 1000  # nodes along an axis


@dataclass(frozen=True)
class Plane:
    """A grid over two quantities: coordinates (n_x,) and (n_y,), rising and even; settings (n_y, n_x, n_w), and
    whether the model takes them (n_y, n_x)."""

    site: Site
    x: Axis
    y: Axis
    x_places: Array
    y_places: Array
    settings: Array
    admitted: Bools

    @property
    def shape(self) -> tuple[int, int]:
        """(n_y, n_x)."""
        return self.y_places.size, self.x_places.size

    @property
    def x_values(self) -> Array:
        """Values of the first quantity [SI], shape (n_x,)."""
        return np.asarray(self.x.value_at(self.x_places))

    @property
    def y_values(self) -> Array:
        """Values of the second quantity [SI], shape (n_y,)."""
        return np.asarray(self.y.value_at(self.y_places))

    def way(self, edge: Edge) -> tuple[SettingPath, float, float]:
        """The path along an edge, and the coordinates at which it begins and ends."""
        direction, j, i = edge
        if direction == "x":
            held = {self.y.name: float(self.y.value_at(self.y_places[j]))}
            return setting_path(self.site, self.x, held), float(self.x_places[i]), float(self.x_places[i + 1])
        held = {self.x.name: float(self.x.value_at(self.x_places[i]))}
        return setting_path(self.site, self.y, held), float(self.y_places[j]), float(self.y_places[j + 1])

    def edges(self, differ: Bools) -> list[Edge]:
        """The edges between admitted nodes of which a property (n_y, n_x) differs."""
        ok = self.admitted
        rows = np.argwhere((differ[:, 1:] != differ[:, :-1]) & ok[:, 1:] & ok[:, :-1])
        columns = np.argwhere((differ[1:] != differ[:-1]) & ok[1:] & ok[:-1])
        return [("x", int(j), int(i)) for j, i in rows] + [("y", int(j), int(i)) for j, i in columns]


def plane(
    site: Site,
    names: tuple[str, str],
    ranges: tuple[tuple[float, float] | None, tuple[float, float] | None] = (None, None),
    points: tuple[int, int] = (60, 60),
) -> Plane:
    """A grid over two quantities of an operating point.

    Args:
        ranges: of each quantity [SI]; None: around its value at the point. points: nodes along each.

    Raises:
        SimulationError: quantities that cannot be moved (together), or a range or number of points that makes no grid.
    """
    check_axes(site, names)
    x, y = (axis(site, name) for name in names)
    x_places, y_places = (places(q, r, n) for q, r, n in zip((x, y), ranges, points, strict=True))
    return _filled(site, x, y, x_places, y_places)


def row(site: Site, name: str, span: tuple[float, float] | None = None, points: int = 120) -> Plane:
    """A grid over one quantity alone: a plane with one row, in which everything else is as at the point.

    Raises:
        SimulationError: as of `plane`.
    """
    x = axis(site, name)
    return row_at(site, x, places(x, span, points))


def row_at(site: Site, x: Axis, x_places: Array) -> Plane:
    """The same at given coordinates (n,), rising and even."""
    y = axis(site, "drive_speed" if x.name != "drive_speed" else "normal_force")
    return _filled(site, x, y, x_places, np.array([y.place(y.value)]))


def _filled(site: Site, x: Axis, y: Axis, x_places: Array, y_places: Array) -> Plane:
    grid_x, grid_y = np.meshgrid(x.value_at(x_places), y.value_at(y_places))
    columns = moved_values(site, {x.name: grid_x, y.name: grid_y}).values()
    settings = np.stack([np.broadcast_to(column, grid_x.shape) for column in columns], axis=-1)
    admitted = admissible(site.model, settings)
    if not np.any(admitted):
        raise SimulationError(f"no pair of {x.name} and {y.name} in these ranges is one the model admits; move them")
    return Plane(site, x, y, x_places, y_places, settings, admitted)


def places(q: Axis, span: tuple[float, float] | None, points: int) -> Array:
    """Even coordinates of a quantity over a range [SI], or around its value.

    Raises:
        SimulationError: a range or a number of points that makes no grid.
    """
    if not FEWEST <= points <= MOST:
        raise SimulationError(f"{points} points were asked for along {q.name}; expected {FEWEST} to {MOST}")
    low, high = around(q) if span is None else span
    if not low < high or not q.lower <= low or not high <= q.upper or (q.logarithmic and low <= 0.0):
        raise SimulationError(
            f"the range of {q.name} is {low:g} to {high:g}; expected two rising values within {q.lower:g} to "
            f"{q.upper:g} {q.unit}".rstrip()
        )
    return np.linspace(q.place(low), q.place(high), points)


def around(q: Axis) -> tuple[float, float]:
    """A range around the value of a quantity [SI]."""
    if q.logarithmic:
        factor = REACH.get(q.name, FACTOR)
        return max(q.value / factor, q.lower), min(q.value * factor, q.upper)
    ends = sorted(q.value * share for share in SPAN) if q.value else [-0.1, 0.1]
    return max(ends[0], q.lower), min(ends[1], q.upper)
