"""Does one uneven record foretell another of its pair at another speed or spring, and is it said where it does not?

Two simulated records (uneven_records.py) of one pair at two drive speeds, or on two springs, are fitted together; each
is left out in turn and foretold from the other. Control: the second record is of friction that is stronger by half.
With the measured records beside this checkout, those of 42 um/s on two springs follow.

    python experiments/run_uneven_transfer.py FIRST LAST FILE     # sets of these seeds
    python experiments/run_uneven_transfer.py table FILE...
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.in_parts import append, by_processor_time, cases, started
from experiments.uneven_records import STIFF, Pair, scene_of, simulated
from identify import Scene, fit
from identify.uneven.answer import UnevenEstimator

CYCLES = 40
ELSEWHERE: Mapping[str, Pair] = {
    "another speed": replace(STIFF, drive_speed=2.0 * STIFF.drive_speed),
    "another spring": replace(STIFF, stiffness=0.5 * STIFF.stiffness),
    "control": replace(STIFF, drive_speed=2.0 * STIFF.drive_speed, strength=1.5 * STIFF.strength),
}


def scene_of_both(one: Pair, other: Pair) -> Scene:
    """Two logs, each with its speed and spring."""
    rig = scene_of(one).as_document()["rig"]
    logs = [
        {"path": f"{i}.csv", "drive_speed": pair.drive_speed, "stiffness": pair.stiffness}
        for i, pair in enumerate((one, other), 1)
    ]
    effects = scene_of(one).as_document()["effects"]
    return Scene.from_document({"effects": effects, "rig": rig, "logs": logs})


def told(name: str, seed: int, cycles: int = CYCLES) -> dict[str, Any]:
    """One set: how the fit ended, whether each record is foretold from the other, and what is said."""
    records = [simulated(pair, cycles, [seed + 500 * i])[0].record for i, pair in enumerate((STIFF, ELSEWHERE[name]))]
    result = fit(scene_of_both(STIFF, ELSEWHERE[name]), records, estimator=UnevenEstimator()).result
    return {
        "set": name,
        "seed": seed,
        "status": result["status"],
        "holds": [entry["holds"] for entry in result.get("transfer", [])],
        "said": [result["message"], *result["notes"]],
    }


def sets(
    first: int, last: int, file: Path | None = None, names: Sequence[str] = tuple(ELSEWHERE)
) -> list[dict[str, Any]]:
    """The sets of seeds first to last, line by line."""
    by_processor_time()
    out = []
    for seed in range(first, last + 1):
        for name in names:
            out.append(told(name, seed))
            append(file, out[-1])
            print(name, seed, out[-1]["status"], out[-1]["holds"], flush=True)
    return out


def table(lines: Sequence[Mapping[str, Any]]) -> None:
    """How often a record is foretold, and how often it is said where it is not."""
    for name in ELSEWHERE:
        mine = [line for line in lines if line["set"] == name]
        holds = [held for line in mine for held in line["holds"]]
        failed = [line for line in mine if line["status"] != "converged" or not all(line["holds"])]
        print(
            f"{name}: {len(mine)} sets, {sum(line['status'] == 'converged' for line in mine)} converged; foretold "
            f"{sum(holds)} of {len(holds)}; {len(failed)} sets say that one record does not foretell the other"
        )


def main(fast: bool = False) -> list[dict[str, Any]]:
    """Some sets, and their table; fast: one."""
    lines = sets(0, 0, names=("control",)) if fast else sets(0, 9)
    table(lines)
    return lines


if __name__ == "__main__":
    started(main, table, cases(sets))
