"""Broken logs by the thousand: every file is read as it was written, or refused in a sentence, or read with a warning.

An input is a look-alike of a real format with random numbers, broken in up to three ways; or one that is drawn: any
bytes, small logs broken byte by byte, sound tables in any layout. Looked for: a traceback, more than 2 s of
processor time, and a number that is not the one written, without a warning.

    python experiments/run_reader_fuzz.py [count [first seed [how many draws]]]
"""

from __future__ import annotations

import functools
import random
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import LogError, Record, read_log
from experiments.drawn_logs import DRAWS
from experiments.lookalikes import ALL, EXPORTS, TEXTS, LookAlike, Made, rows
from experiments.machine import describe
from experiments.mutations import BINARY, ORDER, TEXT, Mutation

WHOLE = 25  # files of each kind, of 20 to 92 rows
REORDERED = 0.2  # share of the texts
SLOW = 2.0  # [s] of processor time
BINARIES = tuple(name for name in ALL if name not in TEXTS)
CLOCKLESS = tuple(ALL[name] for name in ("lvm", "volts"))  # without a time column nobody can see that rows moved
NO_PLAIN_HEADER = ("ni pairs", "settings", "quoted", "thousands", "cells", "iso", "day clock", "stamped", "data logger")
FIXED = (*NO_PLAIN_HEADER, *EXPORTS)  # their columns cannot change places
WORST = {"same": 0, "part": 1, "refuse": 2, "any": 3}


def mutated(number: int, folder: Path) -> tuple[str, str]:
    """What became of a look-alike: (kind and mutations, outcome). Outcomes that begin with "WRONG" are defects."""
    draw = random.Random(number)
    name = draw.choice(BINARIES if draw.random() < 0.02 else TEXTS)
    ways, kind = TEXT if name in TEXTS else BINARY, ALL[name]
    made = whole(name, draw.randrange(WHOLE))
    chosen = draw.sample(sorted(ways), draw.choice([1, 1, 1, 2, 2, 3]))
    chosen.sort(key="packed".__eq__)  # packing comes last
    data, reordered = made.data, name in TEXTS and name not in FIXED and draw.random() < REORDERED
    for mutation in [ORDER] * reordered + [ways[label] for label in chosen]:
        data = mutation.change(data, draw)
    path = folder / kind.file_name
    path.write_bytes(data)
    outcome = judge(path, kind, made, [ways[label] for label in chosen], data)
    return f"{name}: {'columns in another order, ' * reordered}{', '.join(chosen)}", outcome


@functools.cache
def whole(name: str, number: int) -> Made:
    """One of the files before they are broken."""
    return ALL[name].make(rows(20 + 3 * number, number))


def _read(read: Callable[[], Record], path: Path) -> Record | str:
    """The record, or how it was refused."""
    begun = time.process_time()
    try:
        record: Record | str = read()
    except LogError as error:
        text = str(error)
        record = "refused" if "\n" not in text and text.startswith(str(path)) else f"WRONG: no sentence: {text!r:.200}"
    except Exception:  # noqa: BLE001 - the search for what is no LogError
        return "WRONG: " + traceback.format_exc(limit=-2).replace("\n", " | ")[-400:]
    took = time.process_time() - begun
    return record if took <= SLOW else f"WRONG: {took:.1f} s"


def judge(path: Path, kind: LookAlike, made: Made, mutations: list[Mutation], data: bytes) -> str:
    """Read a broken look-alike and say what became of it."""
    record = _read(lambda: read_log(path, **kind.options), path)
    if isinstance(record, str):
        return record
    if data == made.data and record.metadata["format"] != kind.form:
        return f"WRONG: read as {record.metadata['format']}"
    if {f.code for f in record.findings if f.severity != "info"} - {"step_gap_unknown"}:
        return "read with a warning"
    oracle = max((mutation.oracle for mutation in mutations), key=lambda oracle: WORST[oracle])
    moved = any(mutation in (TEXT["rows swapped"], TEXT["row twice"]) for mutation in mutations)
    if oracle == "any" or (kind in CLOCKLESS and moved):
        return "read, changed"
    if oracle == "refuse" and not kind.options and kind is not ALL["cells"]:  # there the cells say them
        return "WRONG: units were guessed"
    wrong = difference(record, made, whole=oracle == "same")
    return f"WRONG: {wrong}" if wrong else "read as written"


def difference(record: Record, made: Made, whole: bool) -> str:
    """Say in what a record differs from what was written, "" where it does not; unless `whole`, rows may be missing."""
    truth = made.columns()
    written = np.stack([truth["normal_force"], truth["friction_force"]])
    if whole and len(record) != truth["time"].size:
        return f"{len(record)} of {truth['time'].size} rows"
    last = 4e-16 * (truth["time"][-1] + float(record.metadata.get("file_time_start", 0.0)))  # digit of the clock
    first = 0
    for i, forces in enumerate(np.stack([record.normal_force, record.friction_force]).T):
        if not np.isfinite(forces).all():
            return f"row {i} is empty without a warning"
        same = np.abs(written[:, first:] - forces[:, None]) <= 4e-16 * np.abs(written[:, first:])
        alike = np.flatnonzero(np.all(same, axis=0))
        if not alike.size:
            return f"row {i} holds {forces}, which was not written in that order"
        first += int(alike[0])
        if whole and not np.isclose(record.time[i], truth["time"][first], rtol=4e-16, atol=last):
            return f"time of row {i} is {record.time[i]!r}, {truth['time'][first]!r} was written"
        first += 1
    return ""


def drawn(number: int, folder: Path) -> tuple[str, str]:
    """What became of a draw, of DRAWS in turn: (what it is, outcome); of a table every number is known."""
    made, path = DRAWS[number % len(DRAWS)](random.Random(number)), folder / "log.csv"
    path.write_bytes(made if isinstance(made, bytes) else made.data)
    label, record = f"{made!r:.300}", _read(lambda: read_log(path), path)
    if isinstance(record, str):
        return label, record
    if any(finding.severity != "info" for finding in record.findings):
        return label, "read with a warning"
    if isinstance(made, bytes):
        return label, "read, changed"
    wrong = difference(record, made, whole=True)
    return label, f"WRONG: {wrong}" if wrong else "read as written"


def main(fast: bool = False, count: int | None = None, first: int = 0, draws: int | None = None) -> Counter[str]:
    """Outcomes of so many broken look-alikes (fast: 300; else 10,000) and draws, from one seed on."""
    count = (300 if fast else 10_000) if count is None else count
    draws = (90 if fast else 3_000) if draws is None else draws
    print(describe())
    both: Counter[str] = Counter()
    for kind, look, many in (("broken look-alikes", mutated, count), ("draws", drawn, draws)):
        outcomes: Counter[str] = Counter()
        begun = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            for number in range(first, first + many):
                label, outcome = look(number, Path(folder))
                outcomes["WRONG" if outcome.startswith("WRONG") else outcome] += 1
                if outcome.startswith("WRONG"):
                    print(f"seed {number}, {label}: {outcome}", flush=True)
        print(f"{outcomes.total()} {kind} from seed {first}, {time.process_time() - begun:.0f} s")
        for outcome, times in outcomes.most_common():
            print(f"  {times:7d}  {outcome}")
        both += outcomes
    return both


if __name__ == "__main__":
    main(False, *(int(argument) for argument in sys.argv[1:]))
