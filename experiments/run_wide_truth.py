"""Wide pairs that are answered with a parameter called not identifiable: can the data tell it?

The recovery study counts such a pair as not recovered. Here the verdicts of the fit are held against profiles by brute
force from the truth (`true_profile`), of the same noisy logs: a pair whose true profile is open, or longer than a
factor of three, cannot be recovered by any estimator that says what it does not know.

    python experiments/run_wide_truth.py FILE NUMBER...     (pairs of the wide study; one line of JSON each)
    python experiments/run_wide_truth.py table FILE...
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.in_parts import append, started
from experiments.machine import describe
from experiments.run_recovery_study import FRICTION, Study
from experiments.study_problem import NORMAL_FORCE, SPEEDS, Case, scene_of
from experiments.true_profile import Truth, true_profiles
from identify.effects import MAIN
from identify.identification import find
from identify.model.model import assemble
from identify.simulation.simulate import run

MOST = 700  # cycles of a log that takes part


def truths(case: Case, names: Sequence[str], answer: np.ndarray | None) -> dict[str, Truth]:
    """The profiles of the named parameters by brute force, of the logs with one cycle at least."""
    kept = [i for i, cycles in enumerate(case.cycles) if 1 <= cycles < MOST]
    model, pair = assemble(MAIN), case.truth | case.rig
    speeds = [SPEEDS[i][0] for i in kept]
    motions = [run(model, pair, SPEEDS[i][0], NORMAL_FORCE, SPEEDS[i][1]) for i in kept]
    records = [case.records[i] for i in kept]
    return true_profiles(scene_of(case), records, motions, speeds, pair, names, answer)


def trial(ranges: str, number: int, names: Sequence[str] = FRICTION) -> dict[str, Any]:
    """One pair: what the fit says, and what the brute force says."""
    case, _, _ = Study(ranges).case(number)
    began = time.process_time()
    _, found = find(scene_of(case), case.records, progress=lambda _stage, _share: None)
    answer = None if found.attempt is None else found.attempt.solved.theta
    known = truths(case, names, answer)
    line = {
        "number": number,
        "ranges": ranges,
        "status": found.status.value,
        "cycles": case.cycles,
        "told": {e.name: e.verdict for e in found.estimates if e.name in names},
        "truth": {n: asdict(t) | {"verdict": t.verdict(), "allowed": t.allowed} for n, t in known.items()},
        "seconds": time.process_time() - began,
    }
    print(f"{number:4d} {line['status']} cycles {case.cycles} {line['seconds']:.0f} s", flush=True)
    for name, t in known.items():
        said = line["told"].get(name, "none")
        unclear = ", not finished" if t.unclear else ""
        print(f"     {name:10s} fit: {said:16s} truth: {t.verdict():16s} {t.low} .. {t.value:.4g} .. {t.high}{unclear}")
    return line


def table(lines: Sequence[dict[str, Any]]) -> None:
    """Per pair what the fit calls not identifiable, and what is so in truth."""
    print(f"\n{describe()}\n")
    print("| pair | fit | called not identifiable | not identifiable in truth |")
    print("| --- | --- | --- | --- |")
    open_, proved = "not identifiable", 0
    for line in sorted(lines, key=lambda line: int(line["number"])):
        told = [name for name, verdict in line["told"].items() if verdict == open_]
        true = [name for name, t in line["truth"].items() if t["verdict"] == open_ and not t["unclear"]]
        proved += bool(true)
        print(f"| {line['number']} | {line['status']} | {', '.join(told) or '–'} | {', '.join(true) or '–'} |")
    print(f"\n{proved} of {len(lines)} pairs hold a parameter that their logs cannot tell")


def main(fast: bool = False, pairs: Sequence[int] = (18, 44, 89, 94, 154, 170, 182, 198)) -> list[dict[str, Any]]:
    """Pairs of the wide study; fast: `a` of the first usual pair."""
    lines = [trial("usual", 1, ("a",))] if fast else [trial("wide", number) for number in pairs]
    table(lines)
    return lines


def part(said: Sequence[str]) -> None:
    """The pairs that the words of a command line name."""
    for number in map(int, said[1:]):
        append(Path(said[0]), trial("wide", number))


if __name__ == "__main__":
    started(main, table, part)
