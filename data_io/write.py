"""Write a record so that it reads back bit for bit: HDF5 in the project's layout, or CSV with a units row."""

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path, PurePath
from typing import Any, Final

import numpy as np

from data_io.atomic import atomic_path, atomic_write
from data_io.errors import LogError
from data_io.frozen import Scalar
from data_io.record import Record

FORMAT: Final = "stickslip-log"
FORMAT_VERSION: Final = 1
ABOUT: Final = "about"
"""Name of the HDF5 dataset with metadata and findings as JSON."""

CSV_MARK: Final = f"# {FORMAT} "
"""How a CSV of ours begins; the format version follows."""


def write_hdf5(record: Record, path: str | Path) -> None:
    """Write `/run_1/step_1/{time,normal_force,friction_force,...}` with `units`, step parameters as attributes.

    The file appears whole or not at all. Raises `LogError` where it cannot be written.
    """
    _written(path, lambda: _write_hdf5(record, path))


def write_csv(record: Record, path: str | Path) -> None:
    """Write a mark, one line of JSON, names, units, rows; numbers with the fewest digits that give the same float64.

    The file appears whole or not at all. Raises `LogError` where it cannot be written.
    """
    _written(path, lambda: _write_csv(record, path))


def _written(path: str | Path, work: Callable[[], None]) -> None:
    try:
        work()
    except (OSError, UnicodeEncodeError) as error:
        reason = getattr(error, "strerror", None) or str(error).removeprefix(f"{path}: ")
        raise LogError(f"{path}: the log cannot be written ({reason}); choose another place") from error


def _write_hdf5(record: Record, path: str | Path) -> None:
    import h5py  # 0.3 s: only where HDF5 is wanted

    about = _about(record)
    with atomic_path(path) as temporary, h5py.File(temporary, "w", track_order=True) as file:
        file.attrs.update({"format": FORMAT, "format_version": FORMAT_VERSION})
        for key in ("source_file", "source_sha256"):
            file.attrs[key] = str(about["metadata"].get(key, ""))
        if isinstance(record.drive_speed, float):
            file.attrs.update({"drive_speed": record.drive_speed, "drive_speed_units": "m/s"})
        file[ABOUT] = json.dumps({"metadata": about["metadata"], "findings": about["findings"]})
        units = record.units()
        for step in record.steps:
            group = file.create_group(f"run_{step.run}/step_{step.number}", track_order=True)
            group.attrs.update(step.parameters)
            for name, values in record.columns().items():
                data = group.create_dataset(_link(name), data=values[step.start : step.stop])
                data.attrs["units"] = units[name]
                if _link(name) != name:
                    data.attrs["name"] = name


def _link(name: str) -> str:
    """Return the name of a column as an HDF5 link, which may not hold a slash nor be a dot."""
    return name.replace("/", "|") if name != "." else "(.)"


def _write_csv(record: Record, path: str | Path) -> None:
    columns = record.columns()
    units = record.units()
    head = io.StringIO()
    writer = csv.writer(head, lineterminator="\n")
    writer.writerow(columns)
    writer.writerow([units[name] for name in columns])
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    with atomic_write(path) as handle:
        handle.write(f"{CSV_MARK}{FORMAT_VERSION}\n# {json.dumps(_about(record))}\n{head.getvalue()}")
        handle.writelines(",".join(map(repr, row)) + "\n" for row in rows)


def _about(record: Record) -> dict[str, Any]:
    """Return the record's account; the file it came from keeps its name and hash, not its folder."""
    about = record.about()
    metadata: dict[str, Scalar] = {k: _plain(v) for k, v in about["metadata"].items()}
    path, digest, form = (metadata.pop(key, None) for key in ("path", "sha256", "format"))
    if path is not None and "source_file" not in metadata:
        metadata["source_file"] = PurePath(str(path)).name
        metadata["source_sha256"] = str(digest)
        metadata["source_format"] = str(form)
    return {**about, "metadata": metadata}


def _plain(value: Scalar) -> Scalar:
    return value.item() if isinstance(value, np.generic) else value
