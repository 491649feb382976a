"""Broken logs by the thousand: every file is read as it was written, or refused in a sentence, or read with a warning.

Each input is a look-alike of a real format with random numbers, broken in up to three ways. Looked for: a traceback,
more than 2 s of processor time, and a number that is not the one written, without a warning.

    python experiments/run_reader_fuzz.py [count [first seed]]
"""

from __future__ import annotations

import functools
import random
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import LogError, Record, read_log
from experiments.lookalikes import ALL, TEXTS, LookAlike, Made, rows
from experiments.machine import describe
from experiments.mutations import BINARY, ORDER, TEXT, Mutation

WHOLE = 25  # files of each kind, of 20 to 92 rows
REORDERED = 0.2  # share of the texts
SLOW = 2.0  # [s] of processor time
BINARIES = tuple(name for name in ALL if name not in TEXTS)
CLOCKLESS = ("pair.lvm", "volts.csv")  # without a time column nobody can see that rows moved
WORST = {"same": 0, "part": 1, "refuse": 2, "any": 3}


def one(seed: int, folder: Path) -> tuple[str, str]:
    """What became of one input: (kind and mutations, outcome). Outcomes that begin with "WRONG" are defects."""
    draw = random.Random(seed)
    name = draw.choice(BINARIES) if draw.random() < 0.02 else draw.choice(TEXTS)
    table = TEXT if name in TEXTS else BINARY
    kind, made = ALL[name], whole(name, draw.randrange(WHOLE))
    chosen = draw.sample(sorted(table), draw.choice([1, 1, 1, 2, 2, 3]))
    chosen.sort(key="packed".__eq__)  # packing comes last
    data = made.data
    if reordered := name in TEXTS and random.Random(-3 - seed).random() < REORDERED:
        data = ORDER.change(data, draw)
    for label in chosen:
        data = table[label].change(data, draw)
    path = folder / kind.file_name
    path.write_bytes(data)
    begun = time.process_time()
    outcome = judge(path, kind, made, [table[label] for label in chosen], data)
    if (took := time.process_time() - begun) > SLOW:
        outcome = f"WRONG: {took:.1f} s"
    return f"{name}: {'columns in another order, ' * reordered}{', '.join(chosen)}", outcome


@functools.cache
def whole(name: str, seed: int) -> Made:
    """One of the files before they are broken."""
    return ALL[name].make(rows(20 + 3 * seed, seed))


def judge(path: Path, kind: LookAlike, made: Made, mutations: list[Mutation], data: bytes) -> str:
    """Read a file and say what became of it."""
    try:
        record = read_log(path, **kind.options)
    except LogError as error:
        text = str(error)
        return "refused" if "\n" not in text and text.startswith(str(path)) else f"WRONG: no sentence: {text!r:.200}"
    except Exception:  # noqa: BLE001 - the search for what is no LogError
        return "WRONG: " + traceback.format_exc(limit=-2).replace("\n", " | ")[-400:]
    if data == made.data and record.metadata["format"] != kind.form:
        return f"WRONG: read as {record.metadata['format']}"
    usual = {"step_gap_unknown", "normal_force_from_name"}
    if {f.code for f in record.findings if f.severity != "info"} - usual:
        return "read with a warning"
    if kind.file_name in CLOCKLESS and any(m in (TEXT["rows swapped"], TEXT["row twice"]) for m in mutations):
        return "read, changed"
    oracle = max((mutation.oracle for mutation in mutations), key=lambda oracle: WORST[oracle])
    if oracle == "any":
        return "read, changed"
    if oracle == "refuse" and not kind.options:
        return "WRONG: units were guessed"
    wrong = difference(record, made, whole=oracle == "same")
    return f"WRONG: {wrong}" if wrong else "read as written"


def difference(record: Record, made: Made, whole: bool) -> str:
    """Say in what a record differs from what was written, "" where it does not; unless `whole`, rows may be missing."""
    truth = made.columns()
    if whole and len(record) != truth["time"].size:
        return f"{len(record)} of {truth['time'].size} rows"
    first = 0
    for i in range(len(record)):
        forces = (record.normal_force[i], record.friction_force[i])
        if not np.isfinite(forces).all():
            return f"row {i} is empty without a warning"
        while first < truth["time"].size and not same(forces, truth, first):
            first += 1
        if first == truth["time"].size:
            return f"row {i} holds {forces}, which was not written in that order"
        if whole and not np.isclose(record.time[i], truth["time"][first], rtol=1e-12, atol=1e-11):
            return f"time of row {i} is {record.time[i]!r}, {truth['time'][first]!r} was written"
        first += 1
    return ""


def same(forces: tuple[float, float], truth: dict[str, np.ndarray], row: int) -> bool:
    """Whether two forces are those of a row, but for the last digit."""
    written = truth["normal_force"][row], truth["friction_force"][row]
    return all(abs(a - b) <= 4e-16 * abs(b) for a, b in zip(forces, written, strict=True))


def main(fast: bool = False, count: int | None = None, first: int = 0) -> Counter[str]:
    """Outcomes of so many inputs (fast: 300; else 10,000), from one seed on."""
    count = (300 if fast else 10_000) if count is None else count
    outcomes: Counter[str] = Counter()
    defects: list[str] = []
    begun, slowest = time.process_time(), 0.0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            since = time.process_time()
            label, outcome = one(seed, Path(folder))
            slowest = max(slowest, time.process_time() - since)
            outcomes["WRONG" if outcome.startswith("WRONG") else outcome] += 1
            if outcome.startswith("WRONG"):
                defects.append(f"seed {seed}, {label}: {outcome}")
                print(defects[-1], flush=True)
    print(f"{count} inputs from seed {first}, {time.process_time() - begun:.0f} s, the slowest {slowest:.2f} s")
    print(describe())
    for outcome, number in outcomes.most_common():
        print(f"  {number:7d}  {outcome}")
    return outcomes


if __name__ == "__main__":
    numbers = [int(argument) for argument in sys.argv[1:]]
    main(count=numbers[0] if numbers else None, first=numbers[1] if len(numbers) > 1 else 0)
