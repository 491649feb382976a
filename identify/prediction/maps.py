"""Maps of the nonlinear model over one or two quantities: stick-slip, steady sliding or both, and their borders.

Motions are settled at every node at once (`search.explore`); where two neighbours differ the border between them is
closed in on by bisection: of the motion for the end of stick-slip, of the growth rate for the stability of sliding.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from contourpy import contour_generator
from numpy.typing import NDArray

from data_io.atomic import atomic_hdf5, atomic_write
from identify.base.errors import SimulationError
from identify.prediction.axes import Axis, Site, admissible, axis, check_axes, moved, moved_values
from identify.prediction.batch import CycleBatch, Motions
from identify.prediction.closed_forms import beyond, known_settings
from identify.prediction.draws import AnswerInterval, Draws
from identify.prediction.groups import formed
from identify.prediction.orbit import check_calculable
from identify.prediction.quantities import QUANTITIES
from identify.prediction.search import CLOSER, CLOSEST, StickTest, bisect, explore, locate
from identify.prediction.stability import critical_friction, log_critical_loading
from identify.prediction.windows import HALVINGS, outcome_of
from identify.scene import Scene
from identify.simulation.sliding import growth_rates, slidings

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Complexes = NDArray[np.complex128]
Range = tuple[float, float]

REACH = {"drive_speed": 30.0}  # factor either way of the default range; others:
FACTOR, SPAN = 10.0, (0.3, 1.7)  # of what is told in powers, of what is told evenly
FEWEST, MOST = 2, 1000  # nodes along an axis
NOT_ADMITTED = "not possible"  # outcome where the model takes no such pair
NO_ANSWER = "no answer"  # outcome where a motion cannot be integrated
MIDDLE = 1e-6  # of an edge: how far from its middle an outline of the grid crosses it

# ----------------------------------------------------------------------------------------------------------------------
# The grid: settings at its nodes and between them.
# ----------------------------------------------------------------------------------------------------------------------


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

    def at(self, x: Array, y: Array) -> Array:
        """Settings (n, n_w) at coordinates x, y (n,)."""
        changes = {self.x.name: self.x.value_at(x)}
        return moved(self.site, changes if self.y_places.size == 1 else changes | {self.y.name: self.y.value_at(y)})


def plane(
    site: Site,
    names: tuple[str, ...],
    ranges: Sequence[Range | None] = (None, None),
    points: Sequence[int] = (60, 60),
) -> Plane:
    """A grid over one or two quantities of an operating point; over one it has a single row.

    Args:
        ranges: of each quantity [SI]; None: around its value at the point. points: nodes along each.

    Raises:
        SimulationError: quantities that cannot be moved (together), or a range or number of points that makes no grid.
    """
    check_axes(site, names)
    x = axis(site, names[0])
    other = names[1] if len(names) > 1 else "normal_force" if names[0] == "drive_speed" else "drive_speed"
    y = axis(site, other)
    y_places = places(y, ranges[1], points[1]) if len(names) > 1 else np.array([y.place(y.value)])
    return plane_at(site, x, y, places(x, ranges[0], points[0]), y_places)


def plane_at(site: Site, x: Axis, y: Axis, x_places: Array, y_places: Array) -> Plane:
    """The same at given coordinates (n_x,), (n_y,), rising."""
    empty = Plane(site, x, y, x_places, y_places, np.empty(0), np.empty(0, dtype=bool))
    grid_x, grid_y = np.meshgrid(x_places, y_places)
    settings = empty.at(grid_x, grid_y)
    admitted = admissible(site.model, settings)
    if not np.any(admitted):
        raise SimulationError(f"no pair of {x.name} and {y.name} in these ranges is one the model admits; move them")
    return Plane(site, x, y, x_places, y_places, settings, admitted)


def places(q: Axis, span: Range | None, points: int) -> Array:
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


def around(q: Axis) -> Range:
    """A range around the value of a quantity [SI]."""
    if q.logarithmic:
        factor = REACH.get(q.name, FACTOR)
        return max(q.value / factor, q.lower), min(q.value * factor, q.upper)
    ends = sorted(q.value * share for share in SPAN) if q.value else [-0.1, 0.1]
    return max(ends[0], q.lower), min(ends[1], q.upper)


# ----------------------------------------------------------------------------------------------------------------------
# Outlines of regions of a grid, through the places at which its edges are crossed.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Boundary:
    """The outline of a region: coordinate at which each edge of the grid is crossed, NaN where it is not: across_x
    (n_y, n_x - 1) along x, across_y (n_y - 1, n_x) along y; closed loops (n, 2) in coordinates, the region on their
    left, each with which of its points (n,) are no crossings but the frame of the grid or of what is possible."""

    across_x: Array
    across_y: Array
    loops: tuple[tuple[Array, Bools], ...]

    def lines(self) -> list[Array]:
        """The pieces of the outline inside the map, points (n, 2) each; one that never meets a frame is closed."""
        out = []
        for points, framed in self.loops:
            if not np.any(framed):
                out.append(np.vstack([points, points[:1]]))
                continue
            first = int(np.argmax(framed))
            points, framed = np.roll(points, -first, axis=0), np.roll(framed, -first)
            cuts = np.flatnonzero(np.diff(framed.astype(int)) != 0) + 1
            out += [piece for piece in np.split(points, cuts)[1::2] if len(piece)]
        return out


def outline(inside: Bools, x: Array, y: Array, across_x: Array, across_y: Array) -> Boundary:
    """The outline of a region.

    Args:
        inside: (n_y, n_x), whether a node belongs to it. x (n_x,), y (n_y,): coordinates, rising. across_x, across_y:
            as of `Boundary`; where they are NaN, half the way.
    """
    padded = [np.concatenate([q[:1], q, q[-1:]]) for q in (x, y)]
    half = [0.5 * (q[1:] + q[:-1]) for q in padded]
    along_x = np.tile(half[0], (y.size + 2, 1))
    along_y = np.tile(half[1][:, None], (1, x.size + 2))
    along_x[1:-1, 1:-1] = np.where(np.isfinite(across_x), across_x, along_x[1:-1, 1:-1])
    along_y[1:-1, 1:-1] = np.where(np.isfinite(across_y), across_y, along_y[1:-1, 1:-1])
    crossed_x, crossed_y = np.pad(np.isfinite(across_x), 1), np.pad(np.isfinite(across_y), 1)
    # On a grid of zeros and ones every point lies on the middle of an edge, which tells the edge; regions that meet at
    # a corner only are apart, as the level is above that of their middle.
    loops = []
    for line in contour_generator(z=np.pad(inside, 1).astype(float), name="serial").lines(0.5 + MIDDLE):
        column, row = np.asarray(line)[:-1].T
        level = row == np.round(row)  # on an edge along x
        j, i = np.where(level, np.round(row), row).astype(int), np.where(level, column, np.round(column)).astype(int)
        k, m = np.minimum(i, x.size), np.minimum(j, y.size)
        points = np.where(
            level[:, None], np.stack([along_x[j, k], padded[1][j]], 1), np.stack([padded[0][i], along_y[m, i]], 1)
        )
        framed = np.where(level, ~crossed_x[j, k], ~crossed_y[m, i])
        loops.append((points, framed))
    return Boundary(across_x, across_y, tuple(loops))


@dataclass(frozen=True)
class Edges:
    """The edges between admitted nodes of which a property differs: rows and columns (k,) of the node that has it and
    of the one that has not, whether they lie along x (k,), and the coordinates of both ends along the edge."""

    j: NDArray[np.intp]
    i: NDArray[np.intp]
    along_x: Bools
    low_node: Bools  # whether the node of lower coordinate has the property
    inside: Array
    outside: Array
    near: NDArray[np.intp]  # number of the node that has it, row by row

    @staticmethod
    def of(grid: Plane, has: Bools) -> Edges:
        """Of a property (n_y, n_x) of a grid."""
        ok, (_, n_x) = grid.admitted, grid.shape
        rows = np.argwhere((has[:, 1:] != has[:, :-1]) & ok[:, 1:] & ok[:, :-1])
        columns = np.argwhere((has[1:] != has[:-1]) & ok[1:] & ok[:-1])
        j, i = np.concatenate([rows, columns]).T
        along_x = np.arange(j.size) < len(rows)
        low = has[j, i]
        up_j, up_i = np.where(along_x, j, j + 1), np.where(along_x, i + 1, i)
        ends = [np.where(along_x, grid.x_places[b], grid.y_places[a]) for a, b in ((j, i), (up_j, up_i))]
        near = np.where(low, j * n_x + i, up_j * n_x + up_i)
        return Edges(j, i, along_x, low, np.where(low, *ends), np.where(low, *ends[::-1]), near)

    def at(self, grid: Plane, rows: NDArray[np.intp], along: Array) -> Array:
        """Settings (k, n_w) on some edges at coordinates (k,) along them."""
        j, i, level = self.j[rows], self.i[rows], self.along_x[rows]
        return grid.at(np.where(level, along, grid.x_places[i]), np.where(level, grid.y_places[j], along))

    def boundary(self, grid: Plane, has: Bools, crossed: Array) -> Boundary:
        """The outline of the region that has the property, crossed at these coordinates (k,)."""
        n_y, n_x = grid.shape
        across_x, across_y = np.full((n_y, n_x - 1), np.nan), np.full((n_y - 1, n_x), np.nan)
        for across, which in ((across_x, self.along_x), (across_y, ~self.along_x)):
            across[self.j[which], self.i[which]] = crossed[which]
        return outline(has, grid.x_places, grid.y_places, across_x, across_y)


# ----------------------------------------------------------------------------------------------------------------------
# The map.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Chart:
    """A map. Arrays (n_y, n_x) on the grid of `plane`.

    outcomes: the words of `Outcome`, "not possible" or "no answer"; growth: rate of a disturbance of steady sliding
    [1/s]; multiplier: largest Floquet multiplier of the orbit in magnitude; figures: QUANTITIES of the orbit, SI; NaN
    where there is none. sticking: outline of where stick-slip exists; unstable: of where steady sliding is unstable.
    """

    plane: Plane
    outcomes: NDArray[np.str_]
    growth: Array
    multiplier: Array
    figures: Mapping[str, Array]
    sticking: Boundary
    unstable: Boundary

    @property
    def shares(self) -> dict[str, float]:
        """Share of the map by outcome, of what is possible, largest first."""
        words, counts = np.unique(self.outcomes[self.plane.admitted], return_counts=True)
        order = np.argsort(-counts, kind="stable")
        return {str(words[i]): float(counts[i] / counts.sum()) for i in order}


def chart(
    site: Site,
    names: tuple[str, str],
    ranges: Sequence[Range | None] = (None, None),
    points: Sequence[int] = (60, 60),
) -> Chart:
    """The map of an operating point over two quantities (`axes.known_axes`); arguments as of `plane`.

    Raises:
        SimulationError: quantities, ranges or a model that make no map.
    """
    check_calculable(site.model)
    return charted(plane(site, names, ranges, points))[0]


def charted(grid: Plane) -> tuple[Chart, Motions]:
    """The map on a grid, and the motions at its admitted nodes, row by row."""
    model, ok = grid.site.model, grid.admitted
    batch = CycleBatch(model, grid.settings[ok])
    found = explore(batch, _beside(ok))
    growth, multiplier = np.full(grid.shape, np.nan), np.full(grid.shape, np.nan)
    growth[ok], multiplier[ok] = batch.growth, found.multipliers[:, 0].real
    rows = np.full((batch.settings.shape[0], len(QUANTITIES)), np.nan)
    if np.any(found.periodic):
        rows[found.periodic] = batch.take(found.periodic).figures(found.y[found.periodic])[0]
    figures = {name: np.full(grid.shape, np.nan) for name in QUANTITIES}
    for name, column in zip(QUANTITIES, rows.T, strict=True):
        figures[name][ok] = column
    outcomes = np.full(grid.shape, NOT_ADMITTED, dtype="<U20")
    outcomes[ok] = [
        NO_ANSWER if refused else outcome_of(periodic, sticks, stable).value
        for refused, periodic, sticks, stable in zip(
            found.refused & ~found.sticks, found.periodic, found.sticks, batch.growth < 0.0, strict=True
        )
    ]
    sticks = np.zeros(grid.shape, dtype=bool)
    sticks[ok] = found.sticks
    edges = Edges.of(grid, sticks)
    place = np.cumsum(ok.ravel()) - 1
    near = place[edges.near]
    test = StickTest(model, lambda rows, along: edges.at(grid, rows, along), found.y[near], batch.scale[near])
    rounds = HALVINGS if grid.y_places.size == 1 else CLOSER
    ends = np.mean(bisect(test, edges.inside, edges.outside, rounds), axis=0)
    losses = Edges.of(grid, growth >= 0.0)
    lost = np.mean(bisect(_growing(grid, losses), losses.inside, losses.outside, CLOSEST), axis=0)
    sticking, unstable = edges.boundary(grid, sticks, ends), losses.boundary(grid, growth >= 0.0, lost)
    return Chart(grid, outcomes, growth, multiplier, figures, sticking, unstable), found


def _growing(grid: Plane, edges: Edges) -> Any:
    """Whether disturbances of steady sliding grow on edges at coordinates along them."""
    return lambda rows, along: growth_rates(grid.site.model, edges.at(grid, rows, along)) >= 0.0


def _beside(ok: Bools) -> NDArray[np.intp]:
    """The neighbours (n, 4) of every admitted node among the admitted ones, -1 where there is none."""
    numbers = np.full(np.array(ok.shape) + 2, -1)
    numbers[1:-1, 1:-1][ok] = np.arange(int(ok.sum()))
    shifted = [numbers[1:-1, :-2], numbers[1:-1, 2:], numbers[:-2, 1:-1], numbers[2:, 1:-1]]
    return np.stack([each[ok] for each in shifted], axis=1)


# ----------------------------------------------------------------------------------------------------------------------
# Over one quantity alone.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class AnswerChange:
    """Where an answer changes: value of the quantity [SI], whether the answer holds below that value (else above), and
    its interval, None where nothing is uncertain."""

    value: float
    below: bool
    interval: AnswerInterval | None = None


@dataclass(frozen=True)
class LineMap:
    """Answers over one quantity, values (n,) [SI], rising; NaN where there is none.

    figures: QUANTITIES of the orbit (n,); multipliers (n, n_y): its Floquet multipliers, largest magnitude first;
    eigenvalues (n, n_x) of steady sliding [1/s], descending real part; force of steady sliding [N]; ends: where
    stick-slip ends; losses: where steady sliding becomes unstable.
    """

    quantity: Axis
    values: Array
    outcomes: NDArray[np.str_]
    figures: Mapping[str, Array]
    multipliers: Complexes
    eigenvalues: Complexes
    sliding_force: Array
    ends: tuple[AnswerChange, ...]
    losses: tuple[AnswerChange, ...]


def line_map(
    site: Site, name: str, span: Range | None = None, points: int = 120, draws: Draws | None = None
) -> LineMap:
    """Orbits and steady sliding of an operating point while one quantity (`axes.known_axes`) moves.

    Args:
        span: of the quantity [SI]; None: around its value at the point. draws: what is known of the point.

    Raises:
        SimulationError: a quantity, range or model that makes no map.
    """
    check_calculable(site.model)
    grid = plane(site, (name,), (span,), (points,))
    made, found = charted(grid)
    ok, n_x = grid.admitted[0], len(site.model.states)
    multipliers, eigenvalues = np.full((points, n_x - 1), np.nan + 0j), np.full((points, n_x), np.nan + 0j)
    multipliers[ok], force = found.multipliers, np.full(points, np.nan)
    for i, state in zip(np.flatnonzero(ok).tolist(), slidings(site.model, grid.settings[0][ok]), strict=True):
        eigenvalues[i, : state.eigenvalues.size] = state.eigenvalues
        force[i] = state.force
    sticks = np.zeros(points, dtype=bool)
    sticks[ok] = found.sticks
    y = np.full((points, n_x - 1), np.nan)
    y[ok] = found.y
    return LineMap(
        grid.x,
        grid.x_values,
        made.outcomes[0],
        {key: values[0] for key, values in made.figures.items()},
        multipliers,
        eigenvalues,
        force,
        _changes(site, grid, made.sticking, sticks, draws, y),
        _changes(site, grid, made.unstable, made.growth[0] >= 0.0, draws, None),
    )


def _changes(
    site: Site, grid: Plane, boundary: Boundary, holds: Bools, draws: Draws | None, y: Array | None
) -> tuple[AnswerChange, ...]:
    out = []
    for i in np.flatnonzero(np.isfinite(boundary.across_x[0])).tolist():
        place, below = float(boundary.across_x[0, i]), bool(holds[i])
        near = i if below else i + 1
        interval = None
        if draws is not None and set(draws.names) != {grid.x.name}:
            start = None if y is None else (y[near], CycleBatch(site.model, grid.settings[0, near : near + 1]).scale[0])
            interval = end_interval(draws, site, grid.x, place, below, start)
        out.append(AnswerChange(float(grid.x.value_at(place)), below, interval))
    return tuple(out)


def end_interval(
    draws: Draws, site: Site, q: Axis, place: float, below: bool, start: tuple[Array, Array] | None
) -> AnswerInterval:
    """The interval of the value of a quantity [SI] at which something ends; arguments as of `ends_of_draws`."""
    return draws.interval(ends_of_draws(draws, site, q, place, below, start), float(q.value_at(place)))


def ends_of_draws(
    draws: Draws, site: Site, q: Axis, place: float, below: bool, start: tuple[Array, Array] | None
) -> Array:
    """Values (rows,) [SI] of a quantity at which stick-slip ends or sliding loses its stability, by rows of draws.

    Args:
        site: the operating point. place: the end of the estimate, as a coordinate. below: whether it holds below it.
        start: a rest state (n_y,) of stick-slip near the end and the typical one there; None for steady sliding.
    """
    settings, model = draws.settings, site.model

    def at(rows: NDArray[np.intp], along: Array) -> Array:
        return moved(site, {q.name: q.value_at(along)}, settings[rows])

    def growing(rows: NDArray[np.intp], along: Array) -> Bools:
        return growth_rates(model, at(rows, along)) >= 0.0

    n, ahead = len(settings), 1.0 if below else -1.0
    if start is None:
        found = locate(growing, np.full(n, place), ahead, CLOSEST, draws.count)
    else:
        test = StickTest(model, at, *(np.tile(each, (n, 1)) for each in start), rested=True)
        found = locate(test, np.full(n, place), ahead, CLOSER, draws.count)
    return np.asarray(q.value_at(found))


# ----------------------------------------------------------------------------------------------------------------------
# The paper's closed forms over the plane of a map: where they see stick-slip end and sliding lose its stability.
# ----------------------------------------------------------------------------------------------------------------------

CLOSED_POINTS = 240  # along each quantity
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


def closed_plane(plane: Plane, points: int = CLOSED_POINTS) -> ClosedPlane | None:
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
# Maps as data: CSV for any program, HDF5 with units and boundaries.
# ----------------------------------------------------------------------------------------------------------------------

FORMATS = (".csv", ".h5", ".hdf5")
FORMAT, VERSION = "stickslip-map", 1
BOUNDARIES = {"sticking": "end of stick-slip", "unstable": "loss of stability of sliding"}
Columns = Mapping[str, tuple[str, Any]]  # name: unit, values


def check_data_path(path: Path) -> None:
    """Refuse a file of which the ending tells no format.

    Raises:
        SimulationError: what was expected.
    """
    if path.suffix.lower() not in FORMATS:
        raise SimulationError(f"{path} ends in no format of data; expected {', '.join(FORMATS)}: rename it")


def chart_columns(chart: Chart) -> Columns:
    """The arrays (n_y, n_x) of a map by name, with their units; outcomes are words."""
    x, y = chart.plane.x, chart.plane.y
    grid_x, grid_y = np.meshgrid(chart.plane.x_values, chart.plane.y_values)
    head: Columns = {x.name: (x.unit, grid_x), y.name: (y.unit, grid_y), "outcome": ("", chart.outcomes)}
    figures = {name: (unit, chart.figures[name]) for name, unit in QUANTITIES.items()}
    return {**head, "growth_rate": ("1/s", chart.growth), "multiplier": ("", chart.multiplier), **figures}


def line_columns(answer: LineMap) -> Columns:
    """The arrays (n,) of a map over one quantity by name, with their units."""
    out: dict[str, tuple[str, Any]] = {answer.quantity.name: (answer.quantity.unit, answer.values)}
    out["outcome"] = ("", answer.outcomes)
    out |= {name: (unit, answer.figures[name]) for name, unit in QUANTITIES.items()}
    out["sliding_force"] = ("N", answer.sliding_force)
    for stem, unit, table in (("multiplier", "", answer.multipliers), ("eigenvalue", "1/s", answer.eigenvalues)):
        for i in range(table.shape[1]):
            out[f"{stem}_{i + 1}_real"] = (unit, table[:, i].real)
            out[f"{stem}_{i + 1}_imag"] = (unit, table[:, i].imag)
    return out


def write_chart(chart: Chart, path: str | Path) -> list[Path]:
    """Write a map as .csv (one row per node; the boundaries in a second file beside it) or .h5 (arrays and boundaries).

    Returns:
        the files written.

    Raises:
        SimulationError: another ending. OSError: a file that cannot be written.
    """
    path = Path(path)
    check_data_path(path)
    if path.suffix.lower() != ".csv":
        _write_hdf5(path, chart.plane.site, chart_columns(chart), _lines(chart))
        return [path]
    _write_csv(path, chart_columns(chart))
    beside = path.with_name(f"{path.stem}_boundaries.csv")
    x, y = chart.plane.x, chart.plane.y
    rows = [
        (words, piece + 1, *point)
        for words, pieces in _lines(chart).items()
        for piece, points in enumerate(pieces)
        for point in points.tolist()
    ]
    _write_rows(beside, ("boundary", "piece", _head(x.name, x.unit), _head(y.name, y.unit)), rows)
    return [path, beside]


def write_line(answer: LineMap, site: Site, path: str | Path) -> list[Path]:
    """Write a map over one quantity as .csv or .h5; ends of stick-slip and losses of stability stand in the .h5 alone.

    Raises:
        SimulationError: another ending. OSError: a file that cannot be written.
    """
    path = Path(path)
    check_data_path(path)
    if path.suffix.lower() == ".csv":
        _write_csv(path, line_columns(answer))
    else:
        ends = {
            words: [np.array([[change.value] for change in changes])] if changes else []
            for words, changes in zip(BOUNDARIES.values(), (answer.ends, answer.losses), strict=True)
        }
        _write_hdf5(path, site, line_columns(answer), ends)
    return [path]


def _lines(chart: Chart) -> dict[str, list[Array]]:
    """The pieces of each boundary, points (n, 2) in SI."""
    return {words: values_of(chart, getattr(chart, name)) for name, words in BOUNDARIES.items()}


def values_of(chart: Chart, boundary: Boundary) -> list[Array]:
    """The pieces of a boundary inside the map, as points (n, 2) of values [SI]."""
    x, y = chart.plane.x, chart.plane.y
    return [np.column_stack([x.value_at(p[:, 0]), y.value_at(p[:, 1])]) for p in boundary.lines()]


def _head(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _write_csv(path: Path, columns: Columns) -> None:
    flat = [np.asarray(values).ravel().tolist() for _, values in columns.values()]
    _write_rows(path, [_head(name, unit) for name, (unit, _) in columns.items()], zip(*flat, strict=True))


def _write_rows(path: Path, head: Sequence[str], rows: Any) -> None:
    with atomic_write(path) as handle:
        writer = csv.writer(handle, lineterminator="\n")
        writer.writerow(head)
        writer.writerows([[_cell(value) for value in row] for row in rows])


def _cell(value: object) -> Any:
    """A number with all its digits; nothing where there is none."""
    if isinstance(value, float):
        return repr(value) if np.isfinite(value) else ""
    return value


def _write_hdf5(path: Path, site: Site, columns: Columns, lines: Mapping[str, Sequence[Array]]) -> None:
    import h5py

    with atomic_hdf5(path) as file:
        file.attrs["format"], file.attrs["format_version"] = FORMAT, VERSION
        point = {**site.values, "drive_speed": site.drive_speed, "normal_force": site.normal_force}
        file.create_group("operating_point").attrs.update(point)
        for name, (unit, values) in columns.items():
            data = values.astype(h5py.string_dtype()) if values.dtype.kind == "U" else values
            file.create_dataset(name, data=data).attrs["units"] = unit
        for words, pieces in lines.items():
            group = file.create_group(f"boundaries/{words.replace(' ', '_')}")
            for number, points in enumerate(pieces):
                group.create_dataset(f"piece_{number + 1}", data=points)


# ----------------------------------------------------------------------------------------------------------------------
# Maps for scripts: of a scene, by the names of the quantities.
# ----------------------------------------------------------------------------------------------------------------------


def site_of(scene: Scene, drive_speed: float | None = None, normal_force: float | None = None) -> Site:
    """The operating point of a scene: its values (fixed, else start, else default), its rig and its contact.

    Args:
        drive_speed: [m/s], sign irrelevant; None: that of the rig. normal_force: [N]; None: that of the rig.

    Raises:
        SimulationError: a speed or a force that nobody said.
    """
    speed = scene.rig.drive_speed if drive_speed is None else drive_speed
    load = scene.rig.normal_force if normal_force is None else normal_force
    if isinstance(speed, tuple) or not speed or not load:
        raise SimulationError(
            "the scene gives no single drive speed or no normal force; say both: drive_speed=1e-3, normal_force=1.0"
        )
    contact = scene.contact
    area = contact.area_at(float(load))
    return Site(
        scene.model,
        scene.values(None),
        abs(float(speed)),
        float(load),
        area,
        (contact.exponent or 0.0) if area else 0.0,
    )


def stability_map(
    scene: Scene | Site,
    x: str,
    y: str,
    x_range: Range | None = None,
    y_range: Range | None = None,
    points: int = 60,
) -> Chart:
    """Where a pair sticks and slips, slides steadily, or does either, over two quantities (`axes.known_axes`).

    Args:
        scene: a scene, or an operating point of it (`site_of`). x_range, y_range: [SI]; None: around the point.
        points: along each quantity.

    Returns:
        a `Chart`: outcomes, drop, period and the rest on the grid, and the boundaries; `write_chart` stores it,
        `report.draw_map.draw_map` draws it.

    Raises:
        SimulationError: quantities, ranges or a model that make no map.
    """
    site = site_of(scene) if isinstance(scene, Scene) else scene
    return chart(site, (x, y), (x_range, y_range), (points, points))
