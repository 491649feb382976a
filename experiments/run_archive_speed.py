"""HDF5 side by side with plain h5py, and a file larger than the memory that a process may take.

What is measured: the same three columns read by `h5py` (`dataset[()]`) and by `data_io.read_log`, which also checks
clock and forces and keeps the account; by turns. Twice: an archive as `convert` writes it (gzip, shuffled, checksums),
and a plain file without compression. A file that this process has not seen before is also walked through in another
process before it is read: "first look". Then a log whose columns are
several times the memory limit of a process: the whole is refused in a sentence, a window of it is read.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import LogError, Record, hdf5_open, read_log, write_hdf5
from data_io.write import changed_runs
from experiments.machine import describe

ROLES = ("time", "normal_force", "friction_force")
WANTED = 1.2
TURNS = (15, 3)  # of each reader, in full and in fast mode
ROWS = (10_000_000, 200_000)
HUGE = (100_000_000, 6_000_000)
LIMIT = (1 << 29, 1 << 27)  # bytes that the process may take beyond what it has when it begins to read
BLOCK = 1 << 20


def main(fast: bool = False) -> None:
    """Measure and print."""
    print(describe())
    with tempfile.TemporaryDirectory() as folder:
        _speed(Path(folder), ROWS[fast], TURNS[fast])
        _larger_than_memory(Path(folder), HUGE[fast], LIMIT[fast])


def _speed(folder: Path, rows: int, turns: int) -> None:
    random = np.random.default_rng(1)
    time_column = np.arange(rows) / 1000.0
    normal = 1.0 + 1e-3 * random.standard_normal(rows)
    record = Record(time_column, normal, 0.5 + 5e-3 * random.standard_normal(rows))
    began = time.perf_counter()
    write_hdf5(record, folder / "archive.h5")
    spent, size = time.perf_counter() - began, (folder / "archive.h5").stat().st_size
    print(
        f"\narchive of {rows:,} rows written, read back and compared in {spent:.1f} s; "
        f"it takes {size / (24 * rows):.2f} of its columns"
    )
    with h5py.File(folder / "plain.h5", "w") as file:
        for role, unit in zip(ROLES, ("s", "N", "N"), strict=True):
            file[f"run_1/step_1/{role}"] = record.columns()[role]
            file[f"run_1/step_1/{role}"].attrs["units"] = unit
    back = read_log(folder / "archive.h5")
    same = all(back.columns()[role].tobytes() == record.columns()[role].tobytes() for role in ROLES)
    print(f"read back bit for bit: {same}; runs whose checksum differs: {changed_runs(folder / 'archive.h5')}")
    del back, record
    print(f"\nmedians of {turns} turns; ratio: median of the ratios of the turns\n")
    print("| file | | h5py s | read_log s | ratio |\n| --- | --- | --- | --- | --- |")
    for name in ("archive.h5", "plain.h5"):
        for looked in (True, False):
            plain, ours = _by_turns(folder / name, turns, looked)
            for k, what in enumerate(("wall", "processor")):
                ratio = median(b[k] / a[k] for a, b in zip(plain, ours, strict=True))
                seconds = [median(times[k] for times in spent) for spent in (plain, ours)]
                label = what if looked else f"{what}, with first look"
                verdict = "" if ratio <= WANTED else f", above {WANTED}"
                print(f"| {name} | {label} | {seconds[0]:.3f} | {seconds[1]:.3f} | {ratio:.2f}{verdict} |")


def _raw(path: Path) -> int:
    with h5py.File(path, "r") as file:
        columns = [file[f"run_1/step_1/{role}"][()] for role in ROLES]
    return sum(column.size for column in columns)


def _by_turns(path: Path, turns: int, looked: bool) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Seconds by the clock and of computing of h5py and of ours, by turns, so that a busy machine hits both.

    looked: whether the file has been looked through before.
    """
    spent: tuple[list[tuple[float, float]], list[tuple[float, float]]] = ([], [])
    for _ in range(turns):
        for work, kept in zip((_raw, lambda p: len(read_log(p))), spent, strict=True):
            if not looked:
                hdf5_open._walked.clear()
            began, computed = time.perf_counter(), time.process_time()
            work(path)
            kept.append((time.perf_counter() - began, time.process_time() - computed))
    return spent


def _larger_than_memory(folder: Path, rows: int, limit: int) -> None:
    path = folder / "huge.h5"
    with h5py.File(path, "w", libver=("v110", "v110")) as file:
        file.attrs.update({"format": "stickslip-log", "format_version": 1})
        for role, unit in zip(ROLES, ("s", "N", "N"), strict=True):
            data = file.create_dataset(
                f"run_1/step_1/{role}", (rows,), "f8", chunks=(1 << 16,), shuffle=True, compression="gzip",
                compression_opts=1, fletcher32=True,
            )  # fmt: skip
            data.attrs["units"] = unit
            for begin in range(0, rows, BLOCK):
                index = np.arange(begin, min(begin + BLOCK, rows))
                data[begin : begin + index.size] = {
                    "time": index / 1000.0, "normal_force": 1.0 + (index % 3) * 1e-3,
                    "friction_force": 0.4 + (index % 400) * 5e-4,
                }[role]  # fmt: skip
    print(
        f"\n{path.name}: {24 * rows / 1e9:.2f} GB of columns in a file of {path.stat().st_size / 1e6:.0f} MB; "
        f"the process may take {limit / 1e9:.2f} GB more"
    )
    ran = subprocess.run(
        [
            sys.executable,
            "-c",
            f"from experiments.run_archive_speed import under_limit; under_limit({str(path)!r}, {limit})",
        ],
        cwd=Path(__file__).resolve().parent.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    print((ran.stdout + ran.stderr[-2000:]).strip())


def under_limit(path: str, limit: int) -> None:
    """Read in a process that may not grow by more than so many bytes; run by `main` in a process of its own."""
    read_log  # noqa: B018  everything is imported before the limit is set
    taken = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + limit, taken + limit))
    try:
        read_log(path)
        print("the whole log was read: the file is not larger than memory")
    except LogError as error:
        print(f"the whole: refused: {str(error).partition(': ')[2]}")
    with h5py.File(path, "r") as file:
        end = file["run_1/step_1/time"].shape[0] / 1000.0
    for share in (0.1, 0.9):
        start = share * end
        began = time.perf_counter()
        record = read_log(path, window=(start, start + 0.02 * end), channels=())
        expected = 0.4 + (np.arange(round(start * 1000), round(start * 1000) + len(record)) % 400) * 5e-4
        print(
            f"a window of {len(record):,} rows at {start:.0f} s: {time.perf_counter() - began:.2f} s, "
            f"numbers as written: {np.array_equal(record.friction_force, expected)}"
        )
    told = Path("/proc/self/status").read_text(encoding="ascii").split("VmHWM:")[1].split()[0]
    print(
        f"largest memory of the process, libraries and the numbers to compare with included: {int(told) / 1e6:.2f} GB"
    )


if __name__ == "__main__":
    main("--fast" in sys.argv)
