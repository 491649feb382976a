"""Cycles that were not fitted, against those that an uneven fit draws: drop and period of the other half of a record.

Half of a record is fitted; the cycles of the other half are compared with the drawn ones by their means. Simulated
tracks (`uneven_records.py`), and the measured records where they are there: both halves of these were looked at while
the estimator was made, so that they are no independent check.

    python experiments/run_uneven_prediction.py [tracks per case [first seed]]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.machine import describe
from experiments.measured_records import RECORDS, part, sticks_in
from experiments.uneven_records import CASES, prepared, simulated
from identify.uneven.drawn import Begin, drawn_distributions
from identify.uneven.estimator import maximise
from identify.uneven.events import Sticks, sticks_of
from identify.uneven.likelihood import Likelihood

MEASURED = ("k168_v42", "k1002_v42")  # of which strength and weakening are told
NEAR = 0.15  # of a mean
TRACK = 90  # cycles of a simulated record


def predicted(fitted: Sticks, other: Sticks, seed: int) -> list[float]:
    """Mean drop and mean period, drawn over seen, of the other half; empty where the fitted one has no maximum."""
    maximum = maximise([fitted])
    if not maximum.converged:
        return []
    cycles = Likelihood(fitted, maximum.nodes[0])(maximum.theta)
    begin = Begin(cycles.level_after, fitted.arrest, float(np.min(fitted.drop)), fitted.usual_rest)
    _, *drawn = drawn_distributions(fitted.rig, begin, maximum.theta, maximum.covariance, seed)
    seen = (other.drop, np.diff(other.anchor)[other.follows[1:]])
    return [
        float(np.nanmean(one.draws[np.isfinite(one.draws)]) / np.mean(of)) for one, of in zip(drawn, seen, strict=True)
    ]


def halves(sticks: Sticks) -> tuple[Sticks, Sticks]:
    """The first and the last cycles of a record."""
    first, second = np.split(np.arange(sticks.count), [sticks.count // 2])
    return part(sticks, first), part(sticks, second)


def main(fast: bool = False, count: int = 8, seed: int = 3000) -> list[float]:
    """Print the table and return the ratios; fast: one track of the stiff spring."""
    print(describe())
    found: dict[str, list[float]] = {"simulated": [], "measured": []}

    def shown(kind: str, name: str, fitted: Sticks, other: Sticks) -> None:
        ratios = predicted(fitted, other, seed)
        print(f"{name:28}" + ("drop {:.2f}   period {:.2f}".format(*ratios) if ratios else "no maximum"), flush=True)
        found[kind].extend(ratios)

    seeds = list(range(seed, seed + (1 if fast else count)))
    for case in ("stiff",) if fast else CASES:
        for number, track in zip(seeds, simulated(CASES[case], 40 if fast else TRACK, seeds), strict=True):
            shown("simulated", f"{case} {number}", *halves(sticks_of(prepared(CASES[case], track.record))))
    for name in MEASURED if RECORDS.is_dir() and not fast else ():
        first, second = halves(sticks_in(name, RECORDS))
        shown("measured", f"{name}, second half", first, second)
        shown("measured", f"{name}, first half", second, first)
    for kind, ratios in found.items():
        near = sum(abs(ratio - 1.0) <= NEAR for ratio in ratios)
        print(f"{kind}: means within {100 * NEAR:.0f} %: {near} of {len(ratios)}")
    return found["simulated"]


if __name__ == "__main__":
    main(False, *map(int, sys.argv[1:]))
