"""Every kind of record a lab makes is fitted: how often the truth is found, and how often its wrong twin is refused.

Found: converged with all logs, and each parameter that gets an interval within it or within 5 % of the truth. False
success: converged, and a parameter with an interval off by more than 10 % and by more than four standard errors.
Intervals: how many of those given (identified or weak) hold the truth. The wrong twin is the same records under a scene
that says something false of the drive; it is refused where the fit does not converge, or leaves out the log that was
told wrong, or all of it but its steady end, and says so.

    python experiments/run_record_kinds.py [repeats [name ...]]
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.machine import describe
from experiments.record_kinds import KINDS, Kind
from identify import fit

REPEATS = 5
QUICK = ("speed steps",)
CLOSE, FAR, SURE = 0.05, 0.10, 4.0


@dataclass(frozen=True)
class Line:
    """One fit: status, whether the truth was found, whether it is a false success, intervals given and that hold the
    truth, logs left out, seconds."""

    status: str
    found: bool
    false: bool
    given: int
    held: int
    left_out: int
    seconds: float
    message: str


def line(kind: Kind, seed: int, *, wrong: bool = False) -> Line:
    """Fit one record, or its wrong twin."""
    scene, records = kind.made(seed, wrong=wrong)
    since = time.perf_counter()
    result: dict[str, Any] = dict(fit(scene, records).result)
    seconds = time.perf_counter() - since
    given = held = 0
    found, false = result["status"] == "converged", False
    for name, parameter in result["parameters"].items():
        if parameter["standard_error"] is None or name not in kind.pair:
            continue
        truth, value = kind.pair[name], parameter["value"]
        low, high = parameter["interval"]
        inside = (low is None or low <= truth) and (high is None or truth <= high)
        off = abs(value - truth)
        given, held = given + 1, held + int(inside)
        found &= inside or off <= CLOSE * abs(truth)
        false |= off > FAR * abs(truth) and off > SURE * parameter["standard_error"]
    left_out = sum(log["reason_left_out"] is not None for log in result["logs"])
    left_out += sum("only what slides steadily" in note for note in result["notes"])
    found &= left_out == 0
    false &= result["status"] == "converged"
    return Line(result["status"], found, false, given, held, left_out, seconds, result["message"])


def main(fast: bool = False, repeats: int = REPEATS, names: tuple[str, ...] = ()) -> None:
    """Print the table."""
    kinds = [kind for kind in KINDS if kind.name in (QUICK if fast else names or {k.name for k in KINDS})]
    print(f"\n{describe()}\n")
    print("| record | fits | found | false success | intervals that hold the truth | s | wrong twin refused |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for kind in kinds:
        seeds = range(1, 2 if fast else repeats + 1)
        lines = [line(kind, seed) for seed in seeds]
        twins = [] if fast else [line(kind, seed, wrong=True) for seed in seeds]
        refused = sum(twin.status != "converged" or twin.left_out > 0 for twin in twins)
        middle = sorted(made.seconds for made in lines)[len(lines) // 2]
        found, false = sum(made.found for made in lines), sum(made.false for made in lines)
        held, given = sum(made.held for made in lines), sum(made.given for made in lines)
        refusals = f"{refused} of {len(twins)}" if twins else "–"
        row = [kind.name, len(lines), found, false, f"{held} of {given}", f"{middle:.1f}", refusals]
        print("| " + " | ".join(map(str, row)) + " |", flush=True)
        for made in lines:
            if not made.found:
                print(f"    {made.status}: {made.message}", flush=True)


if __name__ == "__main__":
    main(repeats=int(sys.argv[1]) if len(sys.argv) > 1 else REPEATS, names=tuple(sys.argv[2:]))
