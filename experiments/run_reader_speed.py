"""How long text takes to read, beside the fastest plain `pandas.read_csv` that yields the same columns; and the memory.

A table in CETR's layout is written once. Each reading runs in a process of its own for its peak memory, then several
times in turn with the others for its time. pandas is told everything we have to find out: rows to skip, columns, types,
that nothing is missing. It gives numbers as they stand; ours are in SI, checked, with sign and clock.

    python experiments/run_reader_speed.py [rows]
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import read_log
from experiments.machine import describe

NAMES = ("Fx", "Fz", "Z", "Y", "X", "V1", "T", "Ff", "COF")
UNITS = ("g", "g", "mm", "mm", "mm", "mm/sec", "sec", "g", "")
ROLES = [0, 1, 6]


def write(path: Path, rows: int) -> None:
    """Rows of nine columns with six decimals, in pieces."""
    draw = np.random.default_rng(1)
    with path.open("w") as file:
        file.write(",".join(NAMES) + "\n" + ",".join(UNITS) + "\n")
        for first in range(0, rows, 100_000):
            n = min(100_000, rows - first)
            values = draw.normal((90, -200, 0, 0, 4, 0.1, 0, 90, 0.45), (9, 1, 1, 1, 1, 0.01, 0, 9, 0.05), (n, 9))
            values[:, 6] = 0.002 * (first + np.arange(n))
            np.savetxt(file, values, fmt="%.6f", delimiter=",")


def plain(path: Path, use: list[int] | None, **more: object) -> pd.DataFrame:
    """One plain call."""
    return pd.read_csv(path, skiprows=2, header=None, usecols=use, **more)  # type: ignore[call-overload]


FAST = {"na_filter": False, "dtype": np.float64}
READINGS: dict[str, Callable[[Path], object]] = {
    "pandas, 3 columns, as it is": lambda p: plain(p, ROLES),
    "pandas, 3 columns, fastest": lambda p: plain(p, ROLES, **FAST),
    "pandas, 3 columns, memory_map": lambda p: plain(p, ROLES, memory_map=True, **FAST),
    "pandas, 3 columns, in one piece": lambda p: plain(p, ROLES, low_memory=False, **FAST),
    "ours, 3 columns": lambda p: read_log(p, channels=()),
    "pandas, 9 columns, fastest": lambda p: plain(p, None, **FAST),
    "ours, 9 columns": lambda p: read_log(p),
}


def peak(name: str, path: Path) -> float:
    """Peak memory [MiB] of one reading in a process of its own, without what the imports take."""
    code = (
        "import resource, sys; from pathlib import Path; "
        f"sys.path.insert(0, {str(Path(__file__).parents[1])!r}); "
        "from experiments.run_reader_speed import READINGS; use = lambda: resource.getrusage(resource.RUSAGE_SELF)."
        f"ru_maxrss / 1024; before = use(); kept = READINGS[{name!r}](Path({str(path)!r})); print(use() - before)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(ran.stdout)


def main(fast: bool = False, rows: int | None = None) -> dict[str, float]:
    """Least processor and wall time [s] of each reading; fast: 50,000 rows, else ten million."""
    rows = (50_000 if fast else 10_000_000) if rows is None else rows
    repeats = 2 if fast else 3
    cpu: dict[str, list[float]] = {name: [] for name in READINGS}
    wall: dict[str, list[float]] = {name: [] for name in READINGS}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        write(path, rows)
        size = path.stat().st_size / 2**20
        memory = {name: np.nan if fast else peak(name, path) for name in READINGS}
        for _ in range(repeats):
            for name, reading in READINGS.items():
                begun, begun_wall = time.process_time(), time.perf_counter()
                reading(path)
                cpu[name].append(time.process_time() - begun)
                wall[name].append(time.perf_counter() - begun_wall)
    print(f"{rows} rows, {size:.0f} MiB; {describe()}")
    print("| reading | processor s | wall s | memory MiB |\n| --- | --- | --- | --- |")
    for name in READINGS:
        print(f"| {name} | {min(cpu[name]):.2f} | {min(wall[name]):.2f} | {memory[name]:.0f} |")
    for columns in (3, 9):
        rivals = [name for name in READINGS if name.startswith(f"pandas, {columns}")]
        for what, least in (("processor", cpu), ("wall", wall)):
            ratio = min(least[f"ours, {columns} columns"]) / min(min(least[name]) for name in rivals)
            print(f"{columns} columns: {ratio:.2f} times the {what} time of the fastest plain read_csv")
    return {name: min(times) for name, times in cpu.items()}


if __name__ == "__main__":
    main(rows=int(sys.argv[1]) if len(sys.argv) > 1 else None)
