"""Maps of the nonlinear model over one or two quantities: stick-slip, steady sliding or both, and their borders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from contourpy import contour_generator
from numpy.typing import NDArray

from data_io.atomic import atomic_write
from identify.base.errors import SimulationError
from identify.prediction.axes import Axis, Site, admissible, axis, check_axes, moved
from identify.prediction.draws import AnswerInterval, Draws
from identify.prediction.orbit import QUANTITIES, check_calculable
from identify.prediction.search import CLOSER, Border, Survey
from identify.prediction.windows import HALVINGS, outcome_of
from identify.scene import Scene
from identify.simulation.sliding import slidings

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Range = tuple[float, float]

REACH = {"drive_speed": 30.0}  # factor either way of the default range; others:
FACTOR, SPAN = 10.0, (0.3, 1.7)  # of what is drawn in powers, of what is drawn evenly
FEWEST, MOST = 2, 1000  # nodes along an axis
NOT_ADMITTED = "not possible"  # outcome where the model takes no such pair
NO_ANSWER = "no answer"  # outcome where a motion cannot be integrated
MIDDLE = 1e-6  # of an edge: how far from its middle an outline of the grid crosses it


# ----------------------------------------------------------------------------------------------------------------------
# The grid.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Plane:
    """A grid over two quantities: coordinates (n_x,) and (n_y,), rising and even; settings (n_y, n_x, n_w), and
    whether the model takes them (n_y, n_x). Over one quantity it has a single row."""

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

    def survey(self) -> Survey:
        """What motions do at the admitted nodes, row by row, by their coordinates (n, 2)."""
        number = self.numbers()[1:-1, 1:-1]
        sides = [
            np.stack([a.ravel(), b.ravel()], axis=1)[((a >= 0) & (b >= 0)).ravel()]
            for a, b in ((number[:, :-1], number[:, 1:]), (number[:-1], number[1:]))
        ]
        grid = np.stack(np.meshgrid(self.x_places, self.y_places), axis=-1)
        return Survey.of(self.site.model, grid[self.admitted], self._settings_at, sides)

    def numbers(self) -> NDArray[np.intp]:
        """Numbers of the admitted nodes, -1 elsewhere, with a frame of -1: (n_y + 2, n_x + 2)."""
        out = np.full(np.array(self.shape) + 2, -1)
        out[1:-1, 1:-1][self.admitted] = np.arange(int(self.admitted.sum()))
        return out

    def _settings_at(self, places: Array) -> Array:
        changes = {self.x.name: self.x.value_at(places[:, 0])}
        both = {self.y.name: self.y.value_at(places[:, 1])} if self.y_places.size > 1 else {}
        return moved(self.site, changes | both)


def plane(
    site: Site,
    names: Sequence[str],
    ranges: Sequence[Range | None] = (None, None),
    points: Sequence[int] = (60, 60),
) -> Plane:
    """A grid over one or two quantities of an operating point.

    Args:
        ranges: of each quantity [SI]; None: around its value at the point. points: nodes along each.

    Raises:
        SimulationError: quantities that cannot be moved (together), or a range or number of points that makes no grid.
    """
    check_axes(site, names)
    x = axis(site, names[0])
    other = names[1] if len(names) > 1 else "normal_force" if names[0] == "drive_speed" else "drive_speed"
    y = axis(site, other)
    x_places = _places(x, ranges[0], points[0])
    y_places = _places(y, ranges[1], points[1]) if len(names) > 1 else np.array([y.place(y.value)])
    columns = np.meshgrid(x.value_at(x_places), y.value_at(y_places))
    settings = moved(site, dict(zip((x.name, y.name)[: len(names)], columns, strict=False)))
    admitted = np.asarray(admissible(site.model, settings))
    if not np.any(admitted):
        raise SimulationError(f"no pair of {x.name} and {y.name} in these ranges is one the model admits; move them")
    return Plane(site, x, y, x_places, y_places, settings, admitted)


def _places(q: Axis, span: Range | None, points: int) -> Array:
    """Even coordinates of a quantity over a range [SI], or around its value."""
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
# The map.
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Boundary:
    """The outline of a region: closed loops (n, 2) in coordinates, the region on their left, each with which of its
    points (n,) are no crossings but the frame of the grid or of what is possible."""

    loops: tuple[tuple[Array, Bools], ...]

    @staticmethod
    def of(grid: Plane, has: Bools, border: Border) -> Boundary:
        """Of the nodes (n_y, n_x) that have something, through the places at which edges of the grid are crossed."""
        crossed = {frozenset(pair): place for pair, place in zip(border.nodes.tolist(), border.places, strict=True)}
        number = grid.numbers()
        x, y = (np.concatenate([q[:1], q, q[-1:]]) for q in (grid.x_places, grid.y_places))
        loops = []
        # On a grid of zeros and ones every point lies on the middle of an edge; regions that meet at a corner only are
        # apart, as the level is above that of their middle.
        for line in contour_generator(z=np.pad(has, 1).astype(float), name="serial").lines(0.5 + MIDDLE):
            points, framed = [], []
            for column, row in np.asarray(line)[:-1].tolist():
                (i, k), (j, m) = ((round(q),) * 2 if q == round(q) else (int(q), int(q) + 1) for q in (column, row))
                place = crossed.get(frozenset((int(number[j, i]), int(number[m, k]))))
                points.append([0.5 * (x[i] + x[k]), 0.5 * (y[j] + y[m])] if place is None else place)
                framed.append(place is None)
            loops.append((np.array(points), np.array(framed)))
        return Boundary(tuple(loops))

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

    def values_of(self, boundary: Boundary) -> list[Array]:
        """The pieces of a boundary inside the map, as points (n, 2) of values [SI]."""
        x, y = self.plane.x, self.plane.y
        return [np.column_stack([x.value_at(p[:, 0]), y.value_at(p[:, 1])]) for p in boundary.lines()]


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
    grid = plane(site, names, ranges, points)
    survey = grid.survey()
    return _charted(grid, survey, survey.ends(CLOSER), survey.losses())


def _charted(grid: Plane, survey: Survey, ends: Border, losses: Border) -> Chart:
    found, growth, none = survey.motions, survey.batch.growth, np.full(survey.batch.growth.shape, np.nan)
    rows = np.full((none.size, len(QUANTITIES)), np.nan)
    if np.any(found.periodic):
        rows[found.periodic] = survey.batch.take(found.periodic).figures(found.y[found.periodic])
    answers = zip(found.refused & ~found.sticks, found.periodic, found.sticks, growth < 0.0, strict=True)
    words = [NO_ANSWER if refused else outcome_of(*answer).value for refused, *answer in answers]

    def gridded(values: NDArray[Any], empty: Any) -> NDArray[Any]:
        out = np.full(grid.shape, empty, dtype=values.dtype)
        out[grid.admitted] = values
        return out

    return Chart(
        plane=grid,
        outcomes=gridded(np.array(words, dtype="<U20"), NOT_ADMITTED),
        growth=gridded(growth, np.nan),
        multiplier=gridded(found.multipliers[:, 0].real, np.nan),
        figures={name: gridded(column, np.nan) for name, column in zip(QUANTITIES, rows.T, strict=True)},
        sticking=Boundary.of(grid, gridded(found.sticks, False), ends),
        unstable=Boundary.of(grid, gridded(growth >= 0.0, False), losses),
    )


@dataclass(frozen=True)
class AnswerChange:
    """Where an answer changes: value of the quantity [SI], whether the answer holds below that value (else above), and
    its interval, None where nothing is uncertain."""

    value: float
    below: bool
    interval: AnswerInterval | None = None


@dataclass(frozen=True)
class LineMap:
    """Answers over one quantity (n values): a map of one row, the force of steady sliding (n,) [N], where stick-slip
    ends and where steady sliding becomes unstable."""

    chart: Chart
    sliding_force: Array
    ends: tuple[AnswerChange, ...]
    losses: tuple[AnswerChange, ...]

    @property
    def quantity(self) -> Axis:
        """What is moved."""
        return self.chart.plane.x

    @property
    def values(self) -> Array:
        """Its values (n,) [SI], rising."""
        return self.chart.plane.x_values


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
    survey = grid.survey()
    ends, losses = survey.ends(HALVINGS), survey.losses()
    force = np.full(points, np.nan)
    force[grid.admitted[0]] = [state.force for state in slidings(site.model, survey.batch.settings)]
    changes = []
    for border in (ends, losses):
        found = []
        for k, place in enumerate(border.places[:, 0].tolist()):
            below, interval = bool(border.nodes[k, 0] < border.nodes[k, 1]), None
            if draws is not None and set(draws.names) != {name}:
                start = (border.y[k], border.scale[k]) if border.y.size else None
                value = float(grid.x.value_at(place))
                interval = draws.interval(draws.ends(site, grid.x, place, below, start), value)
            found.append(AnswerChange(float(grid.x.value_at(place)), below, interval))
        changes.append(tuple(found))
    return LineMap(_charted(grid, survey, ends, losses), force, changes[0], changes[1])


# ----------------------------------------------------------------------------------------------------------------------
# Maps as data.
# ----------------------------------------------------------------------------------------------------------------------


def check_data_path(path: Path) -> None:
    """Refuse a file that is not to be a table.

    Raises:
        SimulationError: what was expected.
    """
    if path.suffix.lower() != ".csv":
        raise SimulationError(f"{path} is no format of data for a map; expected .csv: rename it")


def write_map(made: Chart | LineMap, path: Path) -> list[Path]:
    """Write a map as CSV, one row per node; the boundaries of two quantities in a second file beside it.

    Returns:
        the files written.

    Raises:
        SimulationError: another ending. OSError: a file that cannot be written.
    """
    check_data_path(path)
    drawn = made if isinstance(made, Chart) else made.chart
    grid = drawn.plane
    heads = [f"{q.name} [{q.unit}]" if q.unit else q.name for q in (grid.x, grid.y)]
    columns: dict[str, NDArray[Any]] = dict(zip(heads, np.meshgrid(grid.x_values, grid.y_values), strict=True))
    columns |= {"outcome": drawn.outcomes, "growth_rate [1/s]": drawn.growth, "multiplier": drawn.multiplier}
    columns |= {f"{name} [{unit}]": drawn.figures[name] for name, unit in QUANTITIES.items()}
    if isinstance(made, LineMap):
        _write_csv(path, columns | {"sliding_force [N]": made.sliding_force})
        return [path]
    lines = {"end of stick-slip": drawn.sticking, "loss of stability of sliding": drawn.unstable}
    pieces = [(words, i + 1, p) for words, b in lines.items() for i, p in enumerate(drawn.values_of(b))]
    rows = [(words, piece, *point) for words, piece, points in pieces for point in points]
    beside = path.with_name(f"{path.stem}_boundaries.csv")
    _write_csv(path, columns)
    _write_csv(beside, {head: [row[k] for row in rows] for k, head in enumerate(("boundary", "piece", *heads))})
    return [path, beside]


def _write_csv(path: Path, columns: Mapping[str, Any]) -> None:
    import pandas as pd

    with atomic_write(path) as handle:
        frame = pd.DataFrame({name: np.ravel(values) for name, values in columns.items()})
        frame.to_csv(handle, index=False, lineterminator="\n")


# ----------------------------------------------------------------------------------------------------------------------
# Maps for scripts: of a scene, by the names of the quantities.
# ----------------------------------------------------------------------------------------------------------------------


def site_of(scene: Scene, drive_speed: float | None = None, normal_force: float | None = None) -> Site:
    """The operating point of a scene: its values (fixed, else start, else default), its rig and its contact.

    Args:
        drive_speed: [m/s], sign irrelevant; None: that of the rig. normal_force: [N]; None: that of the rig.

    Raises:
        SimulationError: a speed or a force that nobody stated.
    """
    speed = scene.rig.drive_speed if drive_speed is None else drive_speed
    load = scene.rig.normal_force if normal_force is None else normal_force
    if isinstance(speed, tuple) or not speed or not load:
        raise SimulationError(
            "the scene gives no single drive speed or no normal force; give both: drive_speed=1e-3, normal_force=1.0"
        )
    area = scene.contact.area_at(float(load))
    exponent = (scene.contact.exponent or 0.0) if area else 0.0
    return Site(scene.model, scene.values(None), abs(float(speed)), float(load), area, exponent)


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
        a `Chart`: outcomes, drop, period and the rest on the grid, and the boundaries; `write_map` stores it,
        `report.draw_map.draw_map` draws it.

    Raises:
        SimulationError: quantities, ranges or a model that make no map.
    """
    site = site_of(scene) if isinstance(scene, Scene) else scene
    return chart(site, (x, y), (x_range, y_range), (points, points))
