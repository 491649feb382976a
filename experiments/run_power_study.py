"""Is the chance of telling two materials apart what the plan says? Ten designs, simulated.

Every person has a strength of their own, every stick scatters about it, and the means of each person are compared with
scipy's t-tests, which know nothing of the formula.

    python experiments/run_power_study.py
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy import stats

sys.path.insert(0, str(Path(__file__).parents[1]))

from identify.bench.power import TwoMaterials

DRAWS, SEED = 4000, 54
# Difference, scatter of sticks, between people, of their response, cycles, paired; volunteers.
DESIGNS = (
    (TwoMaterials(0.15, 0.20, 0.20, 0.10, 5, True), 6),
    (TwoMaterials(0.15, 0.20, 0.20, 0.10, 30, True), 6),
    (TwoMaterials(0.10, 0.20, 0.20, 0.10, 30, True), 12),
    (TwoMaterials(0.10, 0.40, 0.30, 0.05, 10, True), 20),
    (TwoMaterials(0.30, 0.20, 0.30, 0.15, 20, True), 4),
    (TwoMaterials(0.15, 0.20, 0.20, 0.10, 5, False), 10),
    (TwoMaterials(0.30, 0.20, 0.20, 0.10, 30, False), 8),
    (TwoMaterials(0.30, 0.20, 0.30, 0.10, 30, False), 20),
    (TwoMaterials(0.20, 0.50, 0.10, 0.10, 4, False), 15),
    (TwoMaterials(0.05, 0.20, 0.20, 0.10, 30, False), 30),
)


def simulated(design: TwoMaterials, volunteers: int, draws: int, seed: int) -> float:
    """Share of simulated studies in which the test tells the materials apart."""
    random = np.random.default_rng([SEED, seed])
    shape = (draws, volunteers)
    people = design.between * random.standard_normal(shape)
    others = people if design.paired else design.between * random.standard_normal(shape)
    extra = design.response * random.standard_normal(shape) if design.paired else 0.0

    def measured(level: np.ndarray) -> np.ndarray:
        sticks = random.standard_normal((*shape, design.cycles))
        return np.asarray(level + design.scatter * np.mean(sticks, axis=-1))

    first, second = measured(people), measured(others + design.difference + extra)
    test = stats.ttest_rel if design.paired else stats.ttest_ind
    return float(np.mean(test(first, second, axis=1).pvalue < 0.05))


def main(fast: bool = False) -> list[tuple[float, float]]:
    """Predicted and simulated chance of every design."""
    out = []
    print("| difference | scatter | between | cycles | paired | volunteers | predicted | simulated |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for number, (design, volunteers) in enumerate(DESIGNS):
        chances = design.chance(volunteers), simulated(design, volunteers, DRAWS // (4 if fast else 1), number)
        out.append(chances)
        told = f"{100 * design.difference:.0f} % | {100 * design.scatter:.0f} % | {100 * design.between:.0f} %"
        print(f"| {told} | {design.cycles} | {design.paired} | {volunteers} ", end="")
        print(f"| {100 * chances[0]:.0f} % | {100 * chances[1]:.0f} % |")
    off = max(abs(a - b) for a, b in out)
    print(f"\nlargest difference: {100 * off:.1f} points")
    return out


if __name__ == "__main__":
    main()
