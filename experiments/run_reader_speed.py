"""How long text takes to read, beside the fastest plain `pandas.read_csv` that yields the same columns; and the memory.

A table in CETR's layout is written once with nine columns, and once with the three of a log. Each reading runs in a
process of its own for its peak memory, then several times by turns, in random order, with the others for its time: the
ratio is the median over turns of ours to the way of pandas that is fastest by its median. pandas is told everything we
have to find out: rows to skip, columns, types, that nothing is missing, that nothing is quoted. It gives numbers as
they stand; ours are in SI, checked, with sign and clock. Both use the processors there are: pandas does from version
3.1 on, where it is given a path and reads all columns. `taskset -c 0` in front compares them on one.

    python experiments/run_reader_speed.py [rows [turns]]
"""

from __future__ import annotations

import csv
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import read_log
from experiments.machine import describe

NAMES = ("Fx", "Fz", "Z", "Y", "X", "V1", "T", "Ff", "COF")
UNITS = ("g", "g", "mm", "mm", "mm", "mm/sec", "sec", "g", "")
ROLES = [0, 1, 6]
WANTED = 1.3
POOL = 20_000  # rows whose numbers are drawn; then only the time is new


def write(path: Path, rows: int, columns: list[int]) -> None:
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


def plain(path: Path, use: list[int] | None, **more: object) -> pd.DataFrame:
    """One plain call."""
    return pd.read_csv(path, skiprows=2, header=None, usecols=use, **more)  # type: ignore[call-overload]


FAST = {"na_filter": False, "dtype": np.float64}
PLAIN: dict[str, dict[str, object]] = {
    "as it is": {},
    "numbers only": FAST,
    "nothing quoted": {**FAST, "quoting": csv.QUOTE_NONE},
    "memory map": {**FAST, "memory_map": True},
    "in one piece": {**FAST, "low_memory": False},
}
FILES = {"nine.csv": list(range(9)), "three.csv": [6, 0, 1]}
CASES: dict[str, tuple[str, list[int] | None, Callable[[Path], object]]] = {
    "3 of 9 columns": ("nine.csv", ROLES, lambda p: read_log(p, channels=())),
    "9 of 9 columns": ("nine.csv", None, read_log),
    "3 of 3 columns": ("three.csv", None, read_log),
}


def readings(case: str) -> dict[str, Callable[[Path], object]]:
    """Every way to read the columns of a case; ours last."""
    _, use, ours = CASES[case]
    ways: dict[str, Callable[[Path], object]] = {
        f"pandas, {name}": lambda path, more=more: plain(path, use, **more) for name, more in PLAIN.items()
    }
    return {**ways, "ours": ours}


def peak(case: str, way: str, path: Path) -> float:
    """Peak memory [MiB] of one reading in a process of its own, without what the imports take; Linux only."""
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parents[1])!r}); "
        "from experiments.run_reader_speed import highest, readings, Path; before = highest(); "
        f"kept = readings({case!r})[{way!r}](Path({str(path)!r})); print(highest() - before)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(ran.stdout)


def highest() -> float:
    """The most memory [MiB] that this process has taken so far."""
    told = Path("/proc/self/status")
    return int(told.read_text(encoding="ascii").split("VmHWM:")[1].split()[0]) / 1024 if told.exists() else np.nan


def main(fast: bool = False, rows: int | None = None, turns: int | None = None) -> dict[str, float]:
    """Ratio of processor times by case, the median over turns; fast: 20,000 rows, else ten million."""
    rows = (20_000 if fast else 10_000_000) if rows is None else rows
    turns = (2 if fast else 5) if turns is None else turns
    print(f"{rows:,} rows, {turns} turns; pandas {pd.__version__}; {describe()}")
    ratios = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, columns in FILES.items():
            write(Path(folder) / name, rows, columns)
        for case, (name, _, _) in CASES.items():
            ratios[case] = _case(case, Path(folder) / name, turns, memory=not fast)
    return ratios


def _case(case: str, path: Path, turns: int, *, memory: bool) -> float:
    ways = readings(case)
    memories = {way: peak(case, way, path) if memory else np.nan for way in ways}
    spent: dict[str, list[tuple[float, float]]] = {way: [] for way in ways}
    CASES[case][2](path)  # units are looked up once
    order = np.random.default_rng(1)  # what ran before leaves its mark on the memory
    for _ in range(turns):
        for way in order.permutation(list(ways)).tolist():
            reading = ways[way]
            begun, begun_wall = time.process_time(), time.perf_counter()
            reading(path)
            spent[way].append((time.process_time() - begun, time.perf_counter() - begun_wall))
    print(f"\n{case}, {path.stat().st_size / 2**20:.0f} MiB\n")
    print("| reading | processor s | wall s | memory MiB |\n| --- | --- | --- | --- |")
    for way, times in spent.items():
        computed, wall = (median(values) for values in zip(*times, strict=True))
        print(f"| {way} | {computed:.2f} | {wall:.2f} | {memories[way]:.0f} |")
    print()
    ratios = []
    for k, what in enumerate(("processor", "wall")):
        fastest = min((way for way in ways if way != "ours"), key=lambda way: median(t[k] for t in spent[way]))
        turns_of = [spent["ours"][turn][k] / spent[fastest][turn][k] for turn in range(turns)]
        ratios.append(median(turns_of))
        shown = ", ".join(f"{ratio:.2f}" for ratio in turns_of)
        verdict = "" if ratios[-1] <= WANTED else f", above {WANTED}"
        print(f"{ratios[-1]:.2f} times the {what} time of {fastest}{verdict} (turns: {shown})")
    return ratios[0]


if __name__ == "__main__":
    numbers = [int(argument) for argument in sys.argv[1:]]
    main(rows=numbers[0] if numbers else None, turns=numbers[1] if len(numbers) > 1 else None)
