"""Maps and continuations as data: CSV for any program, HDF5 with units and boundaries."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_io.atomic import atomic_path, atomic_write
from identify.base.errors import SimulationError
from identify.prediction.chart import Boundary, Chart
from identify.prediction.continuation import Continuation
from identify.prediction.map_axes import Site
from identify.prediction.sensitivity import QUANTITIES

Array = NDArray[np.float64]

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


def _cell(value: Any) -> Any:
    """A number with all its digits; nothing where there is none."""
    if isinstance(value, float):
        return repr(value) if np.isfinite(value) else ""
    return value


def _write_hdf5(path: Path, site: Site, columns: Columns, lines: Mapping[str, Sequence[Array]]) -> None:
    import h5py

    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
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
