"""result.h5: the document of result.json, and the measured and fitted curves of every log."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np
from numpy.typing import NDArray

from data_io.atomic import atomic_hdf5
from identify.base.document import Json
from identify.base.errors import FitError
from identify.base.outcome import LogCurves, SlipDetail
from identify.report.stored_result import as_json, plain

if TYPE_CHECKING:
    from identify.report.finished import Fit


FORMAT_VERSION = 1
CURVE_UNITS = {
    "time": "s",
    "normal_force": "N",
    "friction_force": "N",
    "fitted_force": "N",
    "used": "1",
}
CYCLE_UNITS = {"onset": "s", "arrest": "s", "onset_force": "N", "arrest_force": "N", "misfit_z": "1"}
SLIP_UNITS = {
    "time": "s",
    "force": "N",
    "elongation": "m",
    "sliding_speed": "m/s",
    "gamma": "1",
    "coefficient": "1",
}


def write_result_h5(fit: Fit, path: Path) -> None:
    """Write the fit to an HDF5 file (an existing one is replaced), whole or not at all.

    `/document`: the text of result.json; `/result`: the same as groups and datasets (null is an empty
    dataset); `/curves/log_<n>`: time, forces and mask at every sample, `cycles/`, `slip/`, each with `units`.
    """
    with atomic_hdf5(path) as file:
        file.attrs["format"] = "stickslip-result"
        file.attrs["format_version"] = FORMAT_VERSION
        file.create_dataset("document", data=as_json(fit.result), dtype=h5py.string_dtype())
        _put(file, "result", plain(fit.result))
        for position, curves in enumerate(fit.logs, start=1):
            _put_curves(file.create_group(f"curves/log_{position}"), curves)


def _put_curves(group: h5py.Group, curves: LogCurves) -> None:
    group.attrs["name"] = storable(curves.name)
    group.attrs["noise_N"] = curves.noise
    group.attrs["drive_speed_m_per_s"] = curves.drive_speed
    for name, unit in CURVE_UNITS.items():
        _array(group, name, getattr(curves, name), unit)
    if curves.raw_force is not None:
        _array(group, "raw_friction_force", curves.raw_force, "N")
    for column, (name, unit) in enumerate(CYCLE_UNITS.items()):
        _array(group, f"cycles/{name}", curves.cycles[:, column], unit)
        if column < curves.measured.shape[1]:
            _array(group, f"measured_cycles/{name}", curves.measured[:, column], unit)
    if curves.slip is not None:
        inner = group.create_group("slip")
        inner.attrs["cycle"] = curves.slip.cycle
        for name, unit in SLIP_UNITS.items():
            _array(inner, name, getattr(curves.slip, name), unit)
        _array(inner, "samples", curves.slip.samples, "1")


def read_curves(path: Path) -> tuple[LogCurves, ...]:
    """The curves of a result.h5, one per log; none where the file holds none.

    Raises:
        FitError: the file is no result.h5, or damaged.
    """
    try:
        with h5py.File(path) as file:
            groups = file.get("curves", {})
            return tuple(_curves(groups[f"log_{i}"]) for i in range(1, len(groups) + 1))
    except (OSError, KeyError, ValueError) as error:
        raise FitError(f"{path} holds no curves of a fit ({error}); fit again, or delete it to do without") from None


def _curves(group: h5py.Group) -> LogCurves:
    data = {name: group[name][()] for name in CURVE_UNITS}
    cycles = np.stack([group[f"cycles/{name}"][()] for name in CYCLE_UNITS], axis=1)
    measured = np.stack([group[f"measured_cycles/{name}"][()] for name in list(CYCLE_UNITS)[:4]], axis=1)
    slip = None
    if "slip" in group:
        inner = group["slip"]
        arrays = {name: inner[name][()] for name in (*SLIP_UNITS, "samples")}
        slip = SlipDetail(cycle=int(inner.attrs["cycle"]), **arrays)
    raw = group["raw_friction_force"][()] if "raw_friction_force" in group else None
    noise, speed = (float(group.attrs[name]) for name in ("noise_N", "drive_speed_m_per_s"))
    name = str(group.attrs["name"])
    time, load, force, fitted, used = data.values()  # in the order of CURVE_UNITS
    return LogCurves(name, time, load, force, fitted, used, noise, speed, cycles, measured, slip, raw)


def _array(group: h5py.Group, name: str, values: NDArray[np.generic], unit: str) -> None:
    # Small arrays stay unpacked: chunking would cost more than it saves.
    packing = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if len(values) > 4096 else {}
    group.create_dataset(name, data=values, **packing).attrs["units"] = unit


def _put(parent: h5py.Group, name: str, value: Json) -> None:
    """One item of the document below `parent`; a list that is no plain array becomes a group of 1, 2, ..."""
    key = storable(name).replace("/", "|") or "-"
    if isinstance(value, list) and (array := _as_array(value)) is not None:
        parent.create_dataset(key, data=array)
    elif isinstance(value, Mapping | list):
        items = value.items() if isinstance(value, Mapping) else ((str(i), v) for i, v in enumerate(value, start=1))
        group = parent.create_group(key, track_order=True)
        for inner, item in items:
            _put(group, str(inner), item)
    elif value is None:
        parent.create_dataset(key, data=h5py.Empty("f8"))
    elif isinstance(value, str):
        parent.create_dataset(key, data=storable(value), dtype=h5py.string_dtype())
    else:
        parent.create_dataset(key, data=value)


def storable(text: str) -> str:
    """HDF5 ends a text at the first zero character and knows no half characters."""
    return text.replace("\0", "\N{REPLACEMENT CHARACTER}").encode("utf-8", "replace").decode("utf-8")


def _as_array(value: list[Json]) -> NDArray[np.float64] | None:
    """Numbers (null as NaN) or rows of them of equal length as an array, else None."""
    lists = [row for row in value if isinstance(row, list)]
    rows = lists if value and len(lists) == len(value) else [value]
    flat = [item for row in rows for item in row]
    numeric = all(item is None or (isinstance(item, int | float) and not isinstance(item, bool)) for item in flat)
    if not flat or not numeric or len({len(row) for row in rows}) != 1:
        return None
    array = np.array(rows, dtype=np.float64)
    return array if rows is lists else array[0]
