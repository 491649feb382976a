"""Write records so that they read back bit for bit: HDF5 in the project's layout, or CSV with a units row."""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass, fields
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from data_io.atomic import atomic_hdf5, atomic_path, atomic_write
from data_io.hdf5_open import children, opened, signature_at
from data_io.record import Record
from data_io.source import load, no_progress
from data_io.values import SEVERITIES, Finding, LogError, Scalar, Step

if TYPE_CHECKING:
    import h5py

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
    metadata: dict[str, Scalar] = {k: _plain(v) for k, v in about["metadata"].items()}
    path, digest, form = (metadata.pop(key, None) for key in ("path", "sha256", "format"))
    if path is not None and "source_file" not in metadata:
        metadata["source_file"] = PurePath(str(path)).name
        metadata["source_sha256"] = str(digest)
        metadata["source_format"] = str(form)
    return {**about, "metadata": metadata}


def _plain(value: Scalar) -> Scalar:
    return value.item() if isinstance(value, np.generic) else value


# The HDF5 layout of this project: one log in a file, or many in an archive with an index; checked as it is written.
#
# `/run_1/step_1/{time,normal_force,friction_force,...}`, float64, compressed, each dataset with its `units`. In
# archives every log is a run with its own `about` (metadata and findings as JSON), and `/index` is a table of them.

FORMAT: Final = "stickslip-log"
FORMAT_VERSION: Final = 1
ABOUT: Final = "about"
"""Name of the HDF5 dataset with metadata and findings as JSON."""
INDEX: Final = "index"
"""Name of the table of an archive."""
CONTENT: Final = "content_sha256"
"""Attribute with the SHA-256 of all columns of a run: names, units and the bytes of their numbers."""

_DISTRIBUTION: Final = "stick-slip-workbench"
_CHUNK: Final = 1 << 16
_BLOCK: Final = 1 << 22
_LEVEL: Final = 1
"""Of gzip: with the bytes shuffled, higher levels cost time and gain little."""


@dataclass(frozen=True)
class Entry:
    """One line of the index. duration [s], rate [Hz], normal_force [N] (median), drive_speed [m/s] (NaN: not told)."""

    run: int
    source_file: str
    source_sha256: str
    source_format: str
    rows: int
    steps: int
    duration: float
    rate: float
    normal_force: float
    drive_speed: float
    content_sha256: str


def read_index(path: str | Path) -> tuple[Entry, ...]:
    """Return the index of an archive, empty for any other file. Raises `LogError` for a damaged one."""
    source = load(Path(path))
    if signature_at(source.head) is None:
        return ()
    with opened(source) as file:
        table = dict(children(file)).get(INDEX)
        names = tuple(field.name for field in fields(Entry))
        if table is None or getattr(table, "dtype", None) is None or table.dtype.names != names:
            return ()
        rows = table[()].tolist()

    def plain(value: Any) -> Any:
        return value.decode("utf-8", errors="replace") if isinstance(value, bytes) else value

    return tuple(Entry(*map(plain, row)) for row in rows)


def changed_runs(path: str | Path) -> list[str]:
    """Return the runs of a file of ours whose numbers are not those that were written; [] where all are.

    Raises `LogError` where the file is damaged or not ours.
    """
    source = load(Path(path))
    with opened(source) as file:
        if not _runs(file):
            raise source.error("the file holds no checksum of ours; a log or archive written by convert was expected")
        return _changed(file)


@contextmanager
def _created(path: str | Path, dated: bool) -> Iterator[h5py.File]:
    """Yield a new file and check it; its structure is protected by checksums, which HDF5 writes from format 1.10 on."""
    with _writing(path), atomic_path(path) as temporary:
        with atomic_hdf5(temporary, track_order=True, libver=("v110", "v110")) as file:
            file.attrs.update({"format": FORMAT, "format_version": FORMAT_VERSION})
            file.attrs["created_by"] = f"{_DISTRIBUTION} {metadata.version(_DISTRIBUTION)}"
            if dated:
                file.attrs["created"] = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
            yield file
        _check(temporary, path)


def _put(
    file: h5py.File, place: h5py.Group, record: Record, run: int | None, progress: Callable[[float], None]
) -> dict[str, Any]:
    """Write a record below `file` and its account to `place`; return the account. `run`: in place of its own number."""
    about = about_of(record)
    if isinstance(record.drive_speed, float):
        place.attrs.update({"drive_speed": record.drive_speed, "drive_speed_units": "m/s"})
    place[ABOUT] = json.dumps({"metadata": about["metadata"], "findings": about["findings"]})
    units, columns = record.units(), record.columns()
    done, whole = 0, len(record) * len(columns)
    digest = hashlib.sha256()
    for step in record.steps:
        group = file.require_group(f"run_{step.run if run is None else run}").create_group(
            f"step_{step.number}", track_order=True
        )
        group.attrs.update(step.parameters)
        for name, values in columns.items():
            part = values[step.start : step.stop]
            data = group.create_dataset(
                _link(name), shape=part.shape, dtype=np.float64, chunks=(min(part.size, _CHUNK),), shuffle=True,
                compression="gzip", compression_opts=_LEVEL, fletcher32=True,
            )  # fmt: skip
            for begin in range(0, part.size, _BLOCK):
                data[begin : begin + _BLOCK] = part[begin : begin + _BLOCK]
                done += min(part.size - begin, _BLOCK)
                progress(done / whole)
            data.attrs["units"] = units[name]
            if _link(name) != name:
                data.attrs["name"] = name
            _feed(digest, name, units[name], part)
    place.attrs[CONTENT] = digest.hexdigest()
    return about


def _link(name: str) -> str:
    """Return the name of a column as an HDF5 link, which may not hold a slash nor be a dot."""
    return name.replace("/", "|") if name != "." else "(.)"


def _feed(digest: Any, name: str, unit: str, values: Any) -> None:
    """Take in a column, an array or a dataset, block by block."""
    digest.update(f"{name}\0{unit}\0{values.size}\0".encode("utf-8", errors="surrogatepass"))
    for begin in range(0, values.size, _BLOCK):
        digest.update(np.ascontiguousarray(values[begin : begin + _BLOCK], dtype="<f8"))


def _runs(file: h5py.File) -> dict[str, tuple[str, h5py.Group]]:
    """Return the stored checksum and the group of every run; of a file with one log the whole file stands for it."""
    if CONTENT in file.attrs:
        return {"the log": (str(file.attrs[CONTENT]), file)}
    return {name: (str(group.attrs[CONTENT]), group) for name, group in file.items() if CONTENT in group.attrs}


def _changed(file: h5py.File) -> list[str]:
    """Return the runs whose numbers are not those that the stored checksum was made of."""
    return [name for name, (stored, group) in _runs(file).items() if stored != _content_of(group)]


def _content_of(group: h5py.Group) -> str:
    """Return the checksum of the numbers below a run, or below a file with one log, as they are now."""
    import h5py

    digest = hashlib.sha256()

    def take(item: h5py.Group) -> None:
        for name, inner in item.items():
            if isinstance(inner, h5py.Group):
                take(inner)
            elif name not in (ABOUT, INDEX):
                _feed(digest, inner.attrs.get("name", name), inner.attrs.get("units", ""), inner)

    take(group)
    return digest.hexdigest()


def _check(written: Path, path: str | Path) -> None:
    """Read the file again before it appears under its name."""
    import h5py

    with h5py.File(written, "r") as file:
        wrong = _changed(file)
    if wrong:
        raise LogError(f"{path}: {', '.join(wrong)} does not read back as it was written; check the disk")


def _entry(number: int, record: Record, about: Mapping[str, Any], content: str) -> Entry:
    told = about["metadata"]
    speed = float("nan") if record.drive_speed is None else float(np.median(np.abs(record.drive_speed)))
    return Entry(
        run=number,
        source_file=str(told.get("source_file", "")),
        source_sha256=str(told.get("source_sha256", "")),
        source_format=str(told.get("source_format", "")),
        rows=len(record),
        steps=len(record.steps),
        duration=float(record.time[-1]),
        rate=float(1.0 / np.median(np.diff(record.time))),
        normal_force=float(np.nanmedian(record.normal_force)),
        drive_speed=speed,
        content_sha256=content,
    )


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

    Compressed, with checksums; the file is read back and compared, and appears whole or not at all. progress: called
    with the share written. dated: the file tells when it was written. Raises `LogError` where it cannot be written.
    """
    with _created(path, dated) as file:
        about = _put(file, file, record, None, progress)
        for key in ("source_file", "source_sha256"):
            file.attrs[key] = str(about["metadata"].get(key, ""))


def write_archive(records: Iterable[Record], path: str | Path, *, dated: bool = True) -> tuple[Entry, ...]:
    """Write many logs into one file: run 1, run 2, ... and an index of them, which is returned.

    Records are taken one after the other; only one need be in memory. Read one back with `read_log(path, run=2)`.
    Raises `LogError` where it cannot be written or there is none.
    """
    import h5py

    entries: list[Entry] = []
    with _created(path, dated) as file:
        for number, record in enumerate(records, start=1):
            group = file.create_group(f"run_{number}", track_order=True)
            about = _put(file, group, record, number, no_progress)
            entries.append(_entry(number, record, about, str(group.attrs[CONTENT])))
        if not entries:
            raise LogError(f"{path}: no log is left to write; one at least was expected; see why each was refused")
        kinds: dict[Any, Any] = {"int": np.int64, "float": np.float64, "str": h5py.string_dtype()}
        kind = np.dtype([(field.name, kinds[field.type]) for field in fields(Entry)])
        file.create_dataset(INDEX, data=np.array([astuple(entry) for entry in entries], dtype=kind))
    return tuple(entries)


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
