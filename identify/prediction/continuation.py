"""Stick-slip and steady sliding continued over one quantity of rig, pair or operating point, and where they change."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_io.atomic import atomic_hdf5, atomic_write
from identify.base.errors import SimulationError
from identify.prediction.chart import Boundary, Chart, Range, chart, charted
from identify.prediction.map_axes import Axis, Site
from identify.prediction.map_grid import row
from identify.prediction.quantities import QUANTITIES
from identify.scene import Scene
from identify.simulation.sliding import slidings

Array = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class AnswerChange:
    """Where an answer changes: value of the quantity [SI], its derivatives (n_w,) by parameters, normal force and
    drive speed, and whether the answer holds below that value (else above)."""

    value: float
    slopes: Array
    below: bool


@dataclass(frozen=True)
class Continuation:
    """Answers over one quantity, values (n,) [SI], rising; NaN where there is none.

    figures: `sensitivity.QUANTITIES` of the orbit (n,); multipliers (n, n_y): its Floquet multipliers, largest
    magnitude first; eigenvalues (n, n_x) of steady sliding [1/s], descending real part; force of steady sliding [N];
    ends: where stick-slip ends; losses: where steady sliding becomes unstable.
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


def continuation(site: Site, name: str, span: Range | None = None, points: int = 120) -> Continuation:
    """Orbits and steady sliding of an operating point while one quantity (`axes.known_axes`) moves.

    Args:
        span: of the quantity [SI]; None: around its value at the point.

    Raises:
        SimulationError: a quantity, range or model that cannot be continued.
    """
    grid = row(site, name, span, points)
    chart, orbits_found = charted(grid)
    admitted, settings = grid.admitted[0], grid.settings[0]
    n_x = len(site.model.states)
    multipliers = np.full((points, n_x - 1), np.nan + 0j)
    for (_, i), orbit in orbits_found.orbits.items():
        multipliers[i] = orbit.multipliers
    eigenvalues, force = np.full((points, n_x), np.nan + 0j), np.full(points, np.nan)
    for i, state in zip(np.flatnonzero(admitted).tolist(), slidings(site.model, settings[admitted]), strict=True):
        eigenvalues[i, : state.eigenvalues.size] = state.eigenvalues
        force[i] = state.force
    return Continuation(
        grid.x,
        grid.x_values,
        chart.outcomes[0],
        {key: values[0] for key, values in chart.figures.items()},
        multipliers,
        eigenvalues,
        force,
        _changes(grid.x, np.isfinite(chart.multiplier[0]), chart.sticking),
        _changes(grid.x, chart.growth[0] >= 0.0, chart.unstable),
    )


def _changes(q: Axis, inside: NDArray[np.bool_], boundary: Boundary) -> tuple[AnswerChange, ...]:
    out = []
    for edge, crossing in sorted(boundary.crossings.items(), key=lambda each: each[0][2]):
        value = float(q.value_at(crossing.place))
        per_place = value if q.logarithmic else q.value_at(1.0)
        out.append(AnswerChange(value, per_place * crossing.slopes, bool(inside[edge[2]])))
    return tuple(out)


# ----------------------------------------------------------------------------------------------------------------------
# Maps and continuations as data: CSV for any program, HDF5 with units and boundaries.
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


def continuation_columns(answer: Continuation) -> Columns:
    """The arrays (n,) of a continuation by name, with their units."""
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


def write_continuation(answer: Continuation, site: Site, path: str | Path) -> list[Path]:
    """Write a continuation as .csv or .h5; ends of stick-slip and losses of stability stand in the .h5 alone.

    Raises:
        SimulationError: another ending. OSError: a file that cannot be written.
    """
    path = Path(path)
    check_data_path(path)
    if path.suffix.lower() == ".csv":
        _write_csv(path, continuation_columns(answer))
    else:
        ends = {
            words: [np.array([[change.value] for change in changes])] if changes else []
            for words, changes in zip(BOUNDARIES.values(), (answer.ends, answer.losses), strict=True)
        }
        _write_hdf5(path, site, continuation_columns(answer), ends)
    return [path]


def _lines(chart: Chart) -> dict[str, list[Array]]:
    """The pieces of each boundary, points (n, 2) in SI."""
    return {words: values_of(chart, getattr(chart, name)) for name, words in BOUNDARIES.items()}


def values_of(chart: Chart, boundary: Boundary) -> list[Array]:
    """The pieces of a boundary inside the map, as points (n, 2) of values [SI]."""
    x, y = chart.plane.x, chart.plane.y
    return [np.column_stack([x.value_at(p[:, 0]), y.value_at(p[:, 1])]) for p, _ in boundary.lines()]


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
# Maps and continuations for scripts: of a scene, by the names of the quantities.
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
        a `Chart`: outcomes, drop, period and the rest on the grid, and the boundaries; `chart_data.write_chart` stores
        it, `report.draw_map.draw_map` draws it.

    Raises:
        SimulationError: quantities, ranges or a model that make no map.
    """
    site = site_of(scene) if isinstance(scene, Scene) else scene
    return chart(site, (x, y), (x_range, y_range), (points, points))


def continue_over(scene: Scene | Site, quantity: str, span: Range | None = None, points: int = 120) -> Continuation:
    """Orbits, multipliers, eigenvalues and where stick-slip ends, over one quantity; arguments as of `stability_map`.

    Raises:
        SimulationError: a quantity, range or model that cannot be continued.
    """
    site = site_of(scene) if isinstance(scene, Scene) else scene
    return continuation(site, quantity, span, points)
