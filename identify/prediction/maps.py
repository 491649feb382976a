"""Maps of the nonlinear model over one or two quantities: stick-slip, steady sliding or both, and their borders; and
the nearest change of a quantity that makes sliding steady."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from contourpy import contour_generator
from numpy.typing import ArrayLike, NDArray

from data_io.atomic import atomic_write
from data_io.spelling import spelled
from identify.base.errors import SimulationError
from identify.base.result import Number
from identify.base.wording import range_text
from identify.model.model import Model
from identify.prediction.axes import Axis, Site, admissible, axis, check_axes, known_axes, moved
from identify.prediction.cycles import QUANTITIES, CycleBatch, check_calculable
from identify.prediction.predict import check_site
from identify.prediction.sources import Tested, site_of
from identify.prediction.windows import COARSE, FINE, Border, Survey, outcome_of
from identify.prediction.wording import shown
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
STEP, MARGIN = 1.25, 0.2  # of a change that is advised: factor between the values looked at, distance from the limit
# What advice is given on, and how far either way it is looked for.
CHANGED = {"drive_speed": 1e5}
CHANGED |= dict.fromkeys(("stiffness", "damping", "mass", "normal_force"), 100.0)


# The grid.


@dataclass(frozen=True)
class Plane:
    """A grid over two quantities: coordinates (n_x,) and (n_y,), rising and even; whether the model takes their
    settings (n_y, n_x). Over one quantity it has a single row."""

    site: Site
    x: Axis
    y: Axis
    x_places: Array
    y_places: Array
    admitted: Bools

    @property
    def shape(self) -> tuple[int, int]:
        """(n_y, n_x)."""
        return self.y_places.size, self.x_places.size

    @property
    def x_values(self) -> Array:
        """Values of the first quantity [SI], shape (n_x,)."""
        return self.x.value_at(self.x_places)

    @property
    def y_values(self) -> Array:
        """Values of the second quantity [SI], shape (n_y,)."""
        return self.y.value_at(self.y_places)

    def survey(self) -> Survey:
        """What motions do at the admitted nodes, row by row, by their coordinates (n, 2)."""
        number = self.numbers()[1:-1, 1:-1]
        sides = [
            np.stack([a.ravel(), b.ravel()], axis=1)[((a >= 0) & (b >= 0)).ravel()]
            for a, b in ((number[:, :-1], number[:, 1:]), (number[:-1], number[1:]))
        ]
        names = (self.x.name, self.y.name)[: 1 + (self.y_places.size > 1)]

        def settings_at(places: Array) -> Array:
            columns = zip((self.x, self.y), places.T, strict=True)
            return moved(self.site, {q.name: q.value_at(column) for q, column in columns if q.name in names})

        grid = np.stack(np.meshgrid(self.x_places, self.y_places), axis=-1)
        return Survey.of(self.site.model, grid[self.admitted], settings_at, sides)

    def numbers(self) -> NDArray[np.intp]:
        """Numbers of the admitted nodes, -1 elsewhere, with a frame of -1: (n_y + 2, n_x + 2)."""
        out = np.full(np.array(self.shape) + 2, -1)
        out[1:-1, 1:-1][self.admitted] = np.arange(int(self.admitted.sum()))
        return out

    def gridded(self, values: Array, empty: float = np.nan) -> Array:
        """Values (n,) at the admitted nodes on the grid (n_y, n_x)."""
        out = np.full(self.shape, empty, dtype=values.dtype)
        out[self.admitted] = values
        return out


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
        SimulationError: a model without cycles, quantities that cannot be moved (together), or a range or number of
            points that makes no grid.
    """
    check_calculable(site.model)
    check_axes(site, names)
    other = "normal_force" if names[0] == "drive_speed" else "drive_speed"
    x, y = axis(site, names[0]), axis(site, (*names, other)[1])
    places = []
    for q, span, count in zip((x, y)[: len(names)], ranges, points, strict=False):
        if not FEWEST <= count <= MOST:
            raise SimulationError(f"{count} points were asked for along {q.name}; expected {FEWEST} to {MOST}")
        low, high = around(q) if span is None else span
        if not low < high or not q.lower <= low or not high <= q.upper or (q.logarithmic and low <= 0.0):
            raise SimulationError(
                f"the range of {q.name} is {low:g} to {high:g}; expected two rising values within {q.lower:g} to "
                f"{q.upper:g} {q.unit}".rstrip()
            )
        places.append(np.linspace(q.place(low), q.place(high), count))
    x_places, y_places = (*places, np.array([y.place(y.value)]))[:2]
    columns = zip((x.name, y.name)[: len(names)], np.meshgrid(x.value_at(x_places), y.value_at(y_places)), strict=False)
    admitted = admissible(site.model, moved(site, dict(columns)))
    if not np.any(admitted):
        raise SimulationError(f"no pair of {x.name} and {y.name} in these ranges is one the model admits; move them")
    return Plane(site, x, y, x_places, y_places, admitted)


def around(q: Axis) -> Range:
    """A range around the value of a quantity [SI]."""
    if q.logarithmic:
        factor = REACH.get(q.name, FACTOR)
        return max(q.value / factor, q.lower), min(q.value * factor, q.upper)
    ends = sorted(q.value * share for share in SPAN) if q.value else [-0.1, 0.1]
    return max(ends[0], q.lower), min(ends[1], q.upper)


# The map.


@dataclass(frozen=True)
class Boundary:
    """The outline of a region: closed loops (n, 2) in coordinates, the region on their left, each with which of its
    points (n,) are no crossings but the frame of the grid or of what is possible."""

    loops: tuple[tuple[Array, Bools], ...]

    @staticmethod
    def of(grid: Plane, has: Array, border: Border) -> Boundary:
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

    outcomes: the words of `Outcome`, "not possible" or "no answer"; figures: QUANTITIES of the orbit, SI; NaN where
    there is none. sticking: outline of where stick-slip exists; unstable: of where steady sliding is unstable.
    """

    plane: Plane
    survey: Survey
    outcomes: NDArray[np.str_]
    figures: Mapping[str, Array]
    sticking: Boundary
    unstable: Boundary

    @staticmethod
    def of(grid: Plane, rounds: int) -> Chart:
        """What motions do over a grid; ends of stick-slip between nodes are closed in on in so many rounds."""
        survey = grid.survey()
        motions, growth = survey.motions, survey.batch.growth
        rows = np.full((growth.size, len(QUANTITIES)), np.nan)
        rows[motions.periodic] = survey.batch.take(motions.periodic).figures(motions.y[motions.periodic])
        answers = zip(motions.refused & ~motions.sticks, motions.periodic, motions.sticks, growth < 0.0, strict=True)
        words = [NO_ANSWER if refused else outcome_of(*answer).value for refused, *answer in answers]
        outcomes = np.full(grid.shape, NOT_ADMITTED, dtype="<U20")
        outcomes[grid.admitted] = words
        return Chart(
            plane=grid,
            survey=survey,
            outcomes=outcomes,
            figures={name: grid.gridded(column) for name, column in zip(QUANTITIES, rows.T, strict=True)},
            sticking=Boundary.of(grid, grid.gridded(motions.sticks.astype(float), 0.0), survey.ends(rounds)),
            unstable=Boundary.of(grid, grid.gridded((growth >= 0.0).astype(float), 0.0), survey.losses()),
        )

    @cached_property
    def growth(self) -> Array:
        """Rate of a disturbance of steady sliding [1/s]."""
        return self.plane.gridded(self.survey.batch.growth)

    @cached_property
    def sliding_force(self) -> Array:
        """What the load cell shows in steady sliding [N]."""
        forces = [state.force for state in slidings(self.plane.site.model, self.survey.batch.settings)]
        return self.plane.gridded(np.array(forces))

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

    def changes(self, boundary: Boundary) -> list[tuple[float, bool]]:
        """Of a map over one quantity: its values [SI] on a boundary, rising, and whether the region lies below each
        (else above)."""
        loops = ((loop[:, 0], loop[~framed, 0]) for loop, framed in boundary.loops)
        ends = ((place, place == np.max(loop)) for loop, crossed in loops for place in crossed.tolist())
        return sorted((float(self.plane.x.value_at(place)), bool(below)) for place, below in ends)


@spelled
def stability_map(
    scene: Scene | Site,
    x: str,
    y: str,
    x_range: Range | None = None,
    y_range: Range | None = None,
    points: int | tuple[int, int] = 60,
) -> Chart:
    """Where a pair sticks and slips, slides steadily, or does either, over two quantities (`axes.known_axes`).

    Parameters
    ----------
    scene : Scene | Site
        a scene with one drive speed and normal force under [rig] and values that are fixed, else start, else
        default; or an operating point.
    x, y : str
        the quantities, such as drive_speed and stiffness.
    x_range, y_range : Range | None, optional
        [SI]; None: around the point.
    points : int | tuple[int, int], optional
        along each quantity, or along x and y.

    Returns
    -------
    Chart
        a `Chart`: outcomes, drop, period and the rest on the grid, and the boundaries; `write_map` stores it,
        `report.draw_map.draw_map` draws it.

    Raises
    ------
    SimulationError
        a speed or a force that nobody stated; quantities, ranges or a model that make no map.
    """
    if isinstance(scene, Scene):
        scene = site_of(scene)
    grid = plane(scene, (x, y), (x_range, y_range), (points, points) if isinstance(points, int) else points)
    return Chart.of(grid, COARSE)


def line_map(site: Site, name: str, span: Range | None = None, points: int = 120) -> Chart:
    """A map of one row: orbits and steady sliding of an operating point while one quantity (`axes.known_axes`) moves.

    Args:
        span: of the quantity [SI]; None: around its value at the point.

    Raises:
        SimulationError: a quantity, range or model that makes no map.
    """
    return Chart.of(plane(site, (name,), (span,), (points,)), FINE)


# Stabilising changes: small disturbances of sliding die out and no stick-slip is found, neither from a rested contact
# (the strongest kick a start can give), nor from one that is almost renewed, nor beside what other values have.


@dataclass(frozen=True)
class ChangeAdvice:
    """The nearest value of a quantity at which sliding becomes steady, or stops to be: now, its limit and the value
    advised, which is a least or a most one (at; None without a limit)."""

    quantity: str
    label: str
    now: Number
    limit: Number
    advised: Number
    at: str | None
    extrapolated: bool
    reason: str

    @property
    def text(self) -> str:
        """One line."""
        unit, limit, advised = self.limit.unit, self.limit.value, self.advised.value
        if advised is None:
            return f"- {self.label}: {self.reason}{'' if limit is None else f' ({shown(limit, unit)})'}."
        notes = f"limit {shown(limit, unit)}, {self.limit.validity}"
        notes += "; extrapolated: outside the tested range" if self.extrapolated else ""
        if advised == self.now.value:
            return f"- {self.label}: as it is ({shown(advised, unit)}); {notes}."
        now = shown(self.now.value, unit)
        return f"- {self.label} at {self.at} {shown(advised, unit)}, now {now} ({notes})."


@dataclass(frozen=True)
class StabilisingAdvice:
    """What to change, one of these, so that sliding is steady with a margin, or stays so."""

    steady: bool
    margin: float
    changes: tuple[ChangeAdvice, ...]
    text: str


def stabilising_changes(site: Site, tested: Tested | None = None, margin: float = MARGIN) -> StabilisingAdvice:
    """What to change so that sliding is steady at an operating point.

    Args:
        tested: the range in which the pair was tested; what lies outside is marked extrapolated. None: not known.
        margin: share by which the quantity is to stay away from its limit.

    Returns:
        one change per quantity, all but that one held; limits and advised values without a value where there is none.

    Raises:
        SimulationError: a model or an operating point without an answer.
    """
    check_site(site)
    model = site.model
    if not admissible(model, site.setting):
        raise SimulationError(
            "the values at this point are none that the model takes: mu_s above mu_k0, and friction that stays "
            "positive at speed, were expected; look at the parameters that are not identified"
        )
    quantities = [axis(site, name) for name in CHANGED if name in known_axes(model)]
    changes = tuple(_change(site, q, tested, margin) for q in quantities if q.value > 0.0)
    steady = _steady(model, site.setting)
    goal = "To keep sliding steady" if steady else "To make sliding steady, one of these"
    where = f"{shown(site.drive_speed, 'm/s')} and {shown(site.normal_force, 'N')}"
    head = f"{goal} at {where} with a margin of {100 * margin:.3g} %, all else held:"
    return StabilisingAdvice(steady, margin, changes, "\n".join([head, *(row.text for row in changes)]))


def _steady(model: Model, setting: Array) -> bool:
    """Whether sliding is steady at a setting (n_w,)."""
    batch = CycleBatch(model, setting[None])
    return bool(batch.growth[0] < 0.0) and not batch.settle(batch.rested()).sticks[0]


def _change(site: Site, q: Axis, tested: Tested | None, margin: float) -> ChangeAdvice:
    """The change of one quantity, looked for over values a factor STEP apart around that of the point."""
    unit, low, high = q.unit, max(q.value / CHANGED[q.name], q.lower), min(q.value * CHANGED[q.name], q.upper)
    below, above = (int(abs(np.log(end / q.value)) / np.log(STEP) + 1e-9) for end in (low, high))
    ends = q.value * STEP**-below, q.value * STEP**above
    survey = plane(site, (q.name,), (ends,), (below + above + 1,)).survey()
    steady = (survey.batch.growth < 0.0) & ~survey.motions.sticks
    now_steady, now = bool(steady[below]), Number(q.value, unit)
    limit, advised, at, kind, reason = None, None, None, "", ""
    other = np.flatnonzero(steady != now_steady) - below
    if not other.size:
        kind = f"from {range_text(low, high, unit)}"
        reason = f"{'any value is steady' if now_steady else 'cannot be reached: none is steady'} {kind}"
    else:
        far = other[np.argmin(np.abs(other) - 0.25 * (other > 0))]  # of two as near the one above
        rising = bool((far > 0) != now_steady)  # steady lies above
        edge = below + np.sort([far, far - np.sign(far)])
        turns = [
            (float(q.value_at(place)), words)
            for border, words in ((survey.ends(FINE), "end of stick-slip"), (survey.losses(), "loss of stability"))
            for place, nodes in zip(border.places[:, 0], np.sort(border.nodes, axis=1), strict=True)
            if np.array_equal(nodes, edge)
        ]
        (limit, kind), at = (max if rising else min)(turns), "least" if rising else "most"  # steady only beyond both
        advised = limit * (1 + margin) if rising else limit / (1 + margin)
        if now_steady and (q.value >= advised if rising else q.value <= advised):
            advised = q.value
        elif not _steady(site.model, moved(site, {q.name: advised})):
            advised, reason = None, "sliding is steady only just beyond this limit: the margin does not fit"
    reached = next((value for value in (advised, limit) if value is not None), q.value)
    extrapolated = tested is not None and tested.extrapolated(q.name, reached)
    numbers = Number(limit, unit, None, kind), Number(advised, unit, None, reason)
    return ChangeAdvice(q.name, q.label, now, *numbers, at, extrapolated, reason)


# Maps as data.


def check_data_path(path: Path) -> None:
    """Refuse a file that is not to be a table.

    Raises:
        SimulationError: what was expected.
    """
    if path.suffix.lower() != ".csv":
        raise SimulationError(f"{path} is no format of data for a map; expected .csv: rename it")


def write_map(drawn: Chart, path: Path) -> list[Path]:
    """Write a map as CSV, one row per node; the boundaries of two quantities in a second file beside it.

    Returns:
        the files written.

    Raises:
        SimulationError: another ending. OSError: a file that cannot be written.
    """
    import pandas as pd

    check_data_path(path)
    grid = drawn.plane
    heads = [f"{q.name} [{q.unit}]" if q.unit else q.name for q in (grid.x, grid.y)]
    columns: dict[str, ArrayLike] = dict(zip(heads, np.meshgrid(grid.x_values, grid.y_values), strict=True))
    columns |= {"outcome": drawn.outcomes, "growth_rate [1/s]": drawn.growth}
    columns |= {f"{name} [{unit}]": drawn.figures[name] for name, unit in QUANTITIES.items()}
    columns |= {"sliding_force [N]": drawn.sliding_force}
    tables = {path: pd.DataFrame({name: np.ravel(values) for name, values in columns.items()})}
    if grid.y_places.size > 1:
        lines = {"end of stick-slip": drawn.sticking, "loss of stability of sliding": drawn.unstable}
        rows = [
            (words, number, *point)
            for words, boundary in lines.items()
            for number, points in enumerate(drawn.values_of(boundary), 1)
            for point in points
        ]
        beside = path.with_name(f"{path.stem}_boundaries.csv")
        tables[beside] = pd.DataFrame(rows, columns=["boundary", "piece", *heads])
    for place, table in tables.items():
        with atomic_write(place) as handle:
            table.to_csv(handle, index=False, lineterminator="\n")
    return list(tables)
