"""Write records so that they read back bit for bit: HDF5 in the project's layout, or CSV with a units row."""

import csv
import io
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path, PurePath
from typing import Any, Final

import numpy as np

from data_io.atomic import atomic_hdf5, atomic_write
from data_io.record import Record
from data_io.source import no_progress
from data_io.values import SEVERITIES, Finding, LogError, Scalar, Step

# The JSON account in our own files of what is no column: read back with every value of the kind it must be.


@dataclass(frozen=True)
class Account:
    """Metadata and findings; steps and a constant drive speed [m/s] where the file keeps them in the account."""

    metadata: Mapping[str, Scalar]
    findings: Sequence[Finding] = ()
    steps: Sequence[Step] = ()
    drive_speed: float | None = None


def read_account(text: str) -> Account:
    """Read the JSON that `write` makes. Raises `ValueError` for anything else."""
    try:
        about: dict[str, Any] = json.loads(text)
        metadata = dict(about["metadata"])
        findings = [Finding(*finding) for finding in about["findings"]]
        steps = [Step(*step) for step in about.get("steps", ())]
        speed = about.get("drive_speed")
        float(metadata.get("file_time_start", 0.0))
        sound = (
            all(isinstance(value, (str, int, float)) for value in metadata.values())
            and all(isinstance(f.message, str) and f.severity in SEVERITIES for f in findings)
            and all(isinstance(n, int) for s in steps for n in (s.run, s.number, s.start, s.stop))
        )
        account = Account(metadata, findings, steps, None if speed is None else float(speed))
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError("not the JSON account of a log") from error
    if not sound:
        raise ValueError("a value of the wrong kind in the JSON account of a log")
    return account


# The account of a record as our files keep it: the file it came from keeps its name and hash, not its folder.


def about_of(record: Record) -> dict[str, Any]:
    """Return what is no column as plain values that JSON can hold."""
    about = record.about()
    plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in about["metadata"].items()}
    metadata: dict[str, Scalar] = plain
    path, digest, form = (metadata.pop(key, None) for key in ("path", "sha256", "format"))
    if path is not None and "source_file" not in metadata:
        metadata["source_file"] = PurePath(str(path)).name
        metadata["source_sha256"] = str(digest)
        metadata["source_format"] = str(form)
    return {**about, "metadata": metadata}


# The HDF5 layout of this project: `/run_1/step_1/{time,normal_force,friction_force,...}`, float64, compressed, with the
# library's checksums, each dataset with its `units`; metadata and findings as JSON in `about`.

FORMAT: Final = "stickslip-log"
FORMAT_VERSION: Final = 1
ABOUT: Final = "about"
"""Name of the HDF5 dataset with metadata and findings as JSON."""

_DISTRIBUTION: Final = "stick-slip-workbench"
_CHUNK: Final = 1 << 16
_BLOCK: Final = 1 << 22


CSV_MARK: Final = f"# {FORMAT} "
"""How a CSV of ours begins; the format version follows."""


@contextmanager
def _writing(path: str | Path) -> Iterator[None]:
    """Say in a sentence why the system does not let a file be written. Raises `LogError`."""
    try:
        yield
    except (OSError, UnicodeEncodeError) as error:
        reason = getattr(error, "strerror", None) or str(error).removeprefix(f"{path}: ")
        raise LogError(f"{path}: the log cannot be written ({reason}); choose another place") from error


def write_hdf5(
    record: Record, path: str | Path, progress: Callable[[float], None] = no_progress, *, dated: bool = True
) -> None:
    """Write `/run_1/step_1/{time,normal_force,friction_force,...}` with `units`, step parameters as attributes.

    Compressed, with checksums; the file appears whole or not at all. progress: called with the share written. dated:
    the file tells when it was written. Raises `LogError` where it cannot be written.
    """
    # the structure is protected by checksums, which HDF5 writes from format 1.10 on
    with _writing(path), atomic_hdf5(path, track_order=True, libver=("v110", "v110")) as file:
        file.attrs.update({"format": FORMAT, "format_version": FORMAT_VERSION})
        file.attrs["created_by"] = f"{_DISTRIBUTION} {metadata.version(_DISTRIBUTION)}"
        if dated:
            file.attrs["created"] = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        about = about_of(record)
        if isinstance(record.drive_speed, float):
            file.attrs.update({"drive_speed": record.drive_speed, "drive_speed_units": "m/s"})
        file[ABOUT] = json.dumps({"metadata": about["metadata"], "findings": about["findings"]})
        units, columns = record.units(), record.columns()
        done, whole = 0, len(record) * len(columns)
        for step in record.steps:
            group = file.require_group(f"run_{step.run}").create_group(f"step_{step.number}", track_order=True)
            group.attrs.update(step.parameters)
            for name, values in columns.items():
                part = values[step.start : step.stop]
                link = name.replace("/", "|") if name != "." else "(.)"  # no link may hold a slash
                data = group.create_dataset(
                    link, shape=part.shape, dtype=np.float64, chunks=(min(part.size, _CHUNK),), shuffle=True,
                    compression="gzip", compression_opts=1, fletcher32=True,
                )  # fmt: skip
                for begin in range(0, part.size, _BLOCK):
                    data[begin : begin + _BLOCK] = part[begin : begin + _BLOCK]
                    done += min(part.size - begin, _BLOCK)
                    progress(done / whole)
                data.attrs["units"] = units[name]
                if link != name:
                    data.attrs["name"] = name
        for key in ("source_file", "source_sha256"):
            file.attrs[key] = str(about["metadata"].get(key, ""))


def write_csv(record: Record, path: str | Path) -> None:
    """Write a mark, one line of JSON, names, units, rows; numbers with the fewest digits that give the same float64.

    The file appears whole or not at all. Raises `LogError` where it cannot be written.
    """
    columns, units, head = record.columns(), record.units(), io.StringIO()
    writer = csv.writer(head, lineterminator="\n")
    writer.writerow(columns)
    writer.writerow([units[name] for name in columns])
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    with _writing(path), atomic_write(path) as handle:
        handle.write(f"{CSV_MARK}{FORMAT_VERSION}\n# {json.dumps(about_of(record))}\n{head.getvalue()}")
        handle.writelines(",".join(map(repr, row)) + "\n" for row in rows)
