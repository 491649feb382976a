"""Cycles that were not fitted, against those that an uneven fit draws: drop and period of the other half of a record.

The rule that draws cycles is that of `identify/uneven/drawn.py`, as it stood before this comparison. Half of a record
is fitted; the cycles of the other half are compared with the drawn ones: means, and the distributions by Kolmogorov's
distance, whose chance is that of as many drawn cycles, in chains of as many as follow each other in a draw. Simulated
tracks (`uneven_records.py`), and the measured records where they are there: both halves of these were looked at while
the estimator was made, so that they are no independent check.

    python experiments/run_uneven_prediction.py [tracks per case [first seed]]
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import ks_2samp

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.machine import describe
from experiments.measured_records import RECORDS, sticks_in
from experiments.uneven_records import CASES, prepared, simulated
from identify.uneven.drawn import CYCLES, SETTLING, Begin, Distribution, drawn_distributions
from identify.uneven.estimator import maximise
from identify.uneven.events import Sticks, sticks_of
from identify.uneven.likelihood import Likelihood

Array = NDArray[np.float64]

MEASURED = ("k168_v42", "k1002_v42")  # of which strength and weakening are told
NEAR, REJECTED = 0.15, 0.05  # of a mean; probability
REPEATS = 400  # sets of drawn cycles, for the chance of a distance
TRACK = 90  # cycles of a simulated record


@dataclass(frozen=True)
class Compared:
    """One quantity of one half: mean drawn over mean seen, and the chance of so large a distance."""

    ratio: float
    chance: float

    @property
    def agrees(self) -> tuple[bool, bool]:
        """By its mean, and by its distribution."""
        return abs(self.ratio - 1.0) <= NEAR, self.chance > REJECTED

    def __str__(self) -> str:
        return f"{self.ratio:.2f} p {self.chance:.2f}"


def predicted(fitted: Sticks, other: Sticks, seed: int) -> tuple[Compared, Compared] | None:
    """Drop and period of the other half; None where the fitted one has no maximum."""
    maximum = maximise([fitted])
    if not maximum.converged:
        return None
    cycles = Likelihood(fitted, maximum.nodes[0])(maximum.theta)
    begin = Begin(cycles.level_after, fitted.arrest, float(np.min(fitted.drop)), fitted.usual_rest)
    _, drop, period = drawn_distributions(fitted.rig, begin, maximum.theta, maximum.covariance, seed)
    follows = other.follows[1:]
    return compared(drop, other.drop, seed), compared(period, np.diff(other.anchor)[follows], seed)


def compared(drawn: Distribution, seen: Array, seed: int) -> Compared:
    """What was drawn of a quantity, against what was seen."""
    random = np.random.default_rng(seed)
    long = CYCLES - SETTLING
    chains = drawn.draws.reshape(drawn.draws.shape[0], -1, long)  # of every set of parameters
    everything = drawn.draws[np.isfinite(drawn.draws)]

    def distance(values: Array) -> float:
        return float(ks_2samp(values, everything).statistic)

    def again() -> float:
        of_one_set = chains[random.integers(chains.shape[0])]
        picked = of_one_set[random.integers(of_one_set.shape[0], size=2 * seen.size // long + 2)].ravel()
        return distance(picked[np.isfinite(picked)][: seen.size])

    found = distance(seen)
    chance = float(np.mean([again() >= found for _ in range(REPEATS)]))
    return Compared(float(np.mean(everything) / np.mean(seen)), chance)


def halves(sticks: Sticks) -> tuple[Sticks, Sticks]:
    """The first and the last cycles of a record."""
    first, second = np.split(np.arange(sticks.count), [sticks.count // 2])
    return sticks.part(first), sticks.part(second)


def main(fast: bool = False, count: int = 8, seed: int = 3000) -> list[Compared]:
    """Print the table; fast: one track of the stiff spring."""
    print(describe())
    found: list[Compared] = []

    def shown(name: str, fitted: Sticks, other: Sticks) -> None:
        both = predicted(fitted, other, seed)
        print(f"{name:28}" + ("no maximum" if both is None else f"drop {both[0]}   period {both[1]}"), flush=True)
        found.extend(both or ())

    for case, pair in CASES.items():
        if fast and case != "stiff":
            continue
        seeds = list(range(seed, seed + (1 if fast else count)))
        for number, track in zip(seeds, simulated(pair, 40 if fast else TRACK, seeds), strict=True):
            shown(f"{case} {number}", *halves(sticks_of(prepared(pair, track.record))))
    print(summary(found))
    if RECORDS.is_dir() and not fast:
        before = len(found)
        for name in MEASURED:
            first, second = halves(sticks_in(name, RECORDS))
            shown(f"{name}, second half", first, second)
            shown(f"{name}, first half", second, first)
        print(summary(found[before:]))
    return found


def summary(found: list[Compared]) -> str:
    """How many agree."""
    near, alike = (sum(q.agrees[i] for q in found) for i in (0, 1))
    return f"means within {100 * NEAR:.0f} %: {near} of {len(found)}; distributions not rejected: {alike}"


if __name__ == "__main__":
    main(False, *map(int, sys.argv[1:]))
