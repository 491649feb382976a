"""How long logs take to read, beside the fastest plain way of pandas and h5py.

A table in CETR's layout with nine columns, one with the three of a log, an archive as `convert` writes it and a plain
HDF5 file. Readings take turns; the ratio is the median over turns of ours to the other. pandas is told everything we
have to find out: rows to skip, columns, types, that nothing is missing; ours are in SI, checked, with sign and clock.

    python experiments/run_reader_speed.py [rows [turns]]
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import h5py
import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record, read_log, write_hdf5
from experiments.machine import describe

NAMES = ("Fx", "Fz", "Z", "Y", "X", "V1", "T", "Ff", "COF")
UNITS = ("g", "g", "mm", "mm", "mm", "mm/sec", "sec", "g", "")
ROLES = ("time", "normal_force", "friction_force")
POOL = 20_000  # rows whose numbers are drawn; then only the time is new


def write_text(path: Path, rows: int, columns: list[int]) -> None:
    """Rows of these columns with six decimals."""
    draw = np.random.default_rng(1)
    middle, spread = (90, -200, 0, 0, 4, 0.1, 0, 90, 0.45), (9, 1, 1, 1, 1, 0.01, 0, 9, 0.05)
    values = draw.normal(middle, spread, (POOL, 9))[:, columns]
    clock = columns.index(6)
    cells = [[f"{value:.6f}" for value in row] for row in values]
    front = ["".join(cell + "," for cell in row[:clock]) for row in cells]
    back = ["".join("," + cell for cell in row[clock + 1 :]) + "\n" for row in cells]
    with path.open("w") as file:
        file.writelines(",".join(names[column] for column in columns) + "\n" for names in (NAMES, UNITS))
        file.writelines(f"{front[i % POOL]}{0.002 * i:.6f}{back[i % POOL]}" for i in range(rows))


def write_plain(path: Path, columns: dict[str, np.ndarray], **more: object) -> None:
    """The columns in the project's layout."""
    with h5py.File(path, "w") as file:
        file.attrs.update({"format": "stickslip-log", "format_version": 1})
        for role, unit in zip(ROLES, ("s", "N", "N"), strict=True):
            file.create_dataset(f"run_1/step_1/{role}", data=columns[role], **more).attrs["units"] = unit


def by_pandas(path: Path, use: list[int] | None) -> object:
    """One plain call at its fastest."""
    return pd.read_csv(path, skiprows=2, header=None, usecols=use, na_filter=False, dtype=np.float64)  # type: ignore[call-overload]


def by_h5py(path: Path) -> object:
    """The columns as they stand."""
    with h5py.File(path, "r") as file:
        return [file[f"run_1/step_1/{role}"][()] for role in ROLES]


def ratio(name: str, plain: Callable[[], object], ours: Callable[[], object], turns: int) -> float:
    """Print seconds of both and the ratio; returns that of the processor time."""
    ours()  # units are looked up once
    spent: list[list[tuple[float, float]]] = [[], []]
    for _ in range(turns):
        for work, kept in zip((plain, ours), spent, strict=True):
            wall, cpu = time.perf_counter(), time.process_time()
            work()
            kept.append((time.process_time() - cpu, time.perf_counter() - wall))
    cells = [f"{median(row[k] for row in kept):.3f}" for k in (0, 1) for kept in spent]
    ratios = [median(b[k] / a[k] for a, b in zip(*spent, strict=True)) for k in (0, 1)]
    print(f"| {name} | {' | '.join(cells)} | {ratios[0]:.2f} | {ratios[1]:.2f} |", flush=True)
    return ratios[0]


def main(fast: bool = False, rows: int | None = None, turns: int | None = None) -> dict[str, float]:
    """Ratio of processor times by case; fast: 20,000 rows, else ten million."""
    rows = (20_000 if fast else 10_000_000) if rows is None else rows
    turns = (2 if fast else 7) if turns is None else turns
    print(f"{rows:,} rows, {turns} turns; pandas {pd.__version__}; {describe()}\n")
    print("| log | processor s, plain | ours | wall s, plain | ours | ratio of processor | of wall |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    draw, out = np.random.default_rng(1), {}
    with tempfile.TemporaryDirectory() as place:
        nine, three, archive, plain = (Path(place) / n for n in ("nine.csv", "three.csv", "archive.h5", "plain.h5"))
        write_text(nine, rows, list(range(9)))
        write_text(three, rows, [6, 0, 1])
        forces = 1.0 + 1e-3 * draw.standard_normal((2, rows))
        record = Record(np.arange(rows) / 1000.0, *forces)
        write_hdf5(record, archive)
        write_plain(plain, record.columns())
        for name, use, ours in (
            ("3 of 9 columns", [0, 1, 6], lambda: read_log(nine, channels=())),
            ("9 of 9 columns", None, lambda: read_log(nine)),
        ):
            out[name] = ratio(name, lambda use=use: by_pandas(nine, use), ours, turns)  # type: ignore[misc]
        out["3 of 3 columns"] = ratio("3 of 3 columns", lambda: by_pandas(three, None), lambda: read_log(three), turns)
        for name, path in (("HDF5 as `convert` writes it", archive), ("HDF5, plain", plain)):
            out[name] = ratio(name, lambda p=path: by_h5py(p), lambda p=path: read_log(p), turns)  # type: ignore[misc]
    return out


if __name__ == "__main__":
    numbers = [int(argument) for argument in sys.argv[1:]]
    main(rows=numbers[0] if numbers else None, turns=numbers[1] if len(numbers) > 1 else None)
