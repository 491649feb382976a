"""Write records so that they read back bit for bit: HDF5 in the project's layout, or CSV with a units row."""

import csv
import io
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final, TypeVar

from data_io.account_of import about_of
from data_io.archive import FORMAT, FORMAT_VERSION, Entry, write_file, write_runs
from data_io.atomic import atomic_write
from data_io.errors import LogError
from data_io.record import Record
from data_io.source import no_progress

CSV_MARK: Final = f"# {FORMAT} "
"""How a CSV of ours begins; the format version follows."""

T = TypeVar("T")


def write_hdf5(
    record: Record, path: str | Path, progress: Callable[[float], None] = no_progress, *, dated: bool = True
) -> None:
    """Write `/run_1/step_1/{time,normal_force,friction_force,...}` with `units`, step parameters as attributes.

    Compressed, with checksums; the file is read back and compared, and appears whole or not at all. progress: called
    with the share written. dated: the file tells when it was written. Raises `LogError` where it cannot be written.
    """
    _written(path, lambda: write_file(record, Path(path), progress, dated=dated))


def write_archive(records: Iterable[Record], path: str | Path, *, dated: bool = True) -> tuple[Entry, ...]:
    """Write many logs into one file: run 1, run 2, ... and an index of them, which is returned.

    Records are taken one after the other; only one need be in memory. Read one back with `read_log(path, run=2)`.
    Raises `LogError` where it cannot be written or there is none.
    """
    return _written(path, lambda: write_runs(records, Path(path), dated=dated))


def write_csv(record: Record, path: str | Path) -> None:
    """Write a mark, one line of JSON, names, units, rows; numbers with the fewest digits that give the same float64.

    The file appears whole or not at all. Raises `LogError` where it cannot be written.
    """
    _written(path, lambda: _write_csv(record, path))


def _written(path: str | Path, work: Callable[[], T]) -> T:
    try:
        return work()
    except (OSError, UnicodeEncodeError) as error:
        reason = getattr(error, "strerror", None) or str(error).removeprefix(f"{path}: ")
        raise LogError(f"{path}: the log cannot be written ({reason}); choose another place") from error


def _write_csv(record: Record, path: str | Path) -> None:
    columns = record.columns()
    units = record.units()
    head = io.StringIO()
    writer = csv.writer(head, lineterminator="\n")
    writer.writerow(columns)
    writer.writerow([units[name] for name in columns])
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    with atomic_write(path) as handle:
        handle.write(f"{CSV_MARK}{FORMAT_VERSION}\n# {json.dumps(about_of(record))}\n{head.getvalue()}")
        handle.writelines(",".join(map(repr, row)) + "\n" for row in rows)
