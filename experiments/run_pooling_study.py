"""Pooling on simulated studies: coverage of intervals, false verdicts, the right order, power.

Studies are drawn at the level of fit results (parameters with a covariance for every fit), volunteers repeated.
Prints, per plan: coverage of the 95 % intervals of the means; how often a study of materials that do not differ says
"different" anywhere (family-wise: all pairs, all parameters); then how often three materials come out in the right
order, and the power of a study by number of volunteers and size of the difference.

    python experiments/run_pooling_study.py [studies per plan] [number of the first plan, from 1]
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import t as student

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.machine import describe
from experiments.pooling_draws import CROSSED, QUANTITIES, Plan, Study, draw
from identify.studies.joint import Together
from identify.studies.pooled import DIFFERENT, Pooled, pool

NULL = (
    Plan("paired, 8 volunteers, 3 runs"),
    Plan("paired, 8 volunteers, a third of the runs lost", lost=0.33),
    Plan("each material its own 6 volunteers, 3 runs", paired=False, volunteers=6),
    Plan("paired, 4 volunteers, 2 runs", volunteers=4, runs=2),
    Plan("paired, 2 materials, 2 volunteers, 15 runs", volunteers=2, runs=15, materials=2),
    Plan("paired, a person is the same on all materials", crossed=0.0),
    Plan("paired, errors of the fits as large as people", fits=6.0),
    Plan("paired, 5 materials, 6 volunteers, 2 runs", materials=5, volunteers=6, runs=2),
)
SHARES = (1, 1, 2, 4, 4, 4, 4, 4)  # by which the number of studies of a plan is divided
CONTROL = Plan("each material its own 4 volunteers, 10 runs", paired=False, volunteers=4, runs=10)
ORDERED = Plan("three materials from eight volunteers", gap=2.0)
GAPS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)  # in standard deviations of a person on a material
VOLUNTEERS = (3, 4, 6, 8, 12, 16)
CREEP = np.array([0.0, 0.0, 0.0, 0.0, 1.0, -1.0])  # log D - log t_cr, the creep velocity


@dataclass(frozen=True)
class Tally:
    """Of the studies of one plan: intervals of means that cover, of how many; studies that say "different" anywhere;
    simultaneous intervals that all cover; creep velocities that the joint covariance covers, of how many."""

    covered: int
    intervals: int
    false: int
    together: int
    creep: int
    creeps: int
    studies: int


def pooled(study: Study, family: int = len(QUANTITIES)) -> list[Pooled]:
    """Every quantity of a study."""
    return [pool(study.y[:, k], study.noise[:, k, k], study.setting, family) for k in range(len(QUANTITIES))]


def tally(plan: Plan, studies: int, seed: int) -> Tally:
    """Draw and pool so many studies."""
    random = np.random.default_rng(seed)
    covered = intervals = false = together = creep = creeps = 0
    for _ in range(studies):
        study = draw(plan, random)
        found = pooled(study)
        hits = [_hit(m.interval, study.truth[_place(m.group), k]) for k, p in enumerate(found) for m in p.means]
        covered, intervals = covered + sum(hits), intervals + len(hits)
        false += any(d.verdict == DIFFERENT for p in found for d in p.differences)
        together += all(
            _hit(d.interval, study.truth[_place(d.first), k] - study.truth[_place(d.second), k])
            for k, p in enumerate(found)
            for d in p.differences
        )
        joint = Together(found, study.setting, study.noise).group("M1")
        df = float(min(joint.df[4], joint.df[5]))
        error = float(np.sqrt(CREEP @ joint.covariance @ CREEP))
        creep += abs(CREEP @ (joint.mean - study.truth[0])) <= student.ppf(0.975, df) * error
        creeps += 1
    return Tally(covered, intervals, false, together, creep, creeps, studies)


def _place(group: str) -> int:
    return int(group[1:]) - 1


def _hit(interval: tuple[float, float] | None, truth: float) -> bool:
    return interval is not None and interval[0] <= truth <= interval[1]


def naive_false(plan: Plan, studies: int, seed: int) -> int:
    """The negative control: the same studies with every fit taken for a person of its own."""
    random = np.random.default_rng(seed)
    false = 0
    for _ in range(studies):
        study = draw(plan, random)
        alone = replace(study.setting, subject=None)
        found = pooled(replace(study, setting=alone))
        false += any(d.verdict == DIFFERENT for p in found for d in p.differences)
    return false


def ordered(plan: Plan, studies: int, seed: int) -> np.ndarray:
    """Share of studies in which the means of each quantity stand in the right order."""
    random, right = np.random.default_rng(seed), np.zeros(len(QUANTITIES))
    for _ in range(studies):
        study = draw(plan, random)
        for k, p in enumerate(pooled(study)):
            means = [m.value for m in sorted(p.means, key=lambda m: m.group)]
            right[k] += means == sorted(means)
    return right / studies


def power(studies: int, seed: int) -> None:
    """Share of studies that call two of three materials different in mu_s, by volunteers and difference."""
    print(f"\npower: mu_s of two neighbours of three materials called different ({studies} studies each)")
    print("gap in sd of a person on a material (and in mu_s)")
    print(f"{'volunteers':>10s} " + " ".join(f"{g:4.1f} ({g * CROSSED[0]:.3f})" for g in GAPS))
    for volunteers in VOLUNTEERS:
        shares = []
        for place, gap in enumerate(GAPS):
            random = np.random.default_rng([seed, volunteers, place])
            plan, said, pairs = Plan("power", volunteers=volunteers, gap=gap), 0, 0
            for _ in range(studies):
                study = draw(plan, random)
                found = pool(study.y[:, 0], study.noise[:, 0, 0], study.setting, len(QUANTITIES))
                near = [d for d in found.differences if abs(_place(d.first) - _place(d.second)) == 1]
                said, pairs = said + sum(d.verdict == DIFFERENT for d in near), pairs + len(near)
            shares.append(said / pairs)
        print(f"{volunteers:10d} " + " ".join(f"{100 * s:8.0f} %  " for s in shares), flush=True)


def main(fast: bool = False, studies: int = 1000, first: int = 1) -> None:
    """The whole study; fast: a few studies of two plans."""
    count = 3 if fast else studies
    quarter = max(count // 4, 1)
    began = time.perf_counter()
    print(describe())
    print(f"{len(QUANTITIES)} parameters; nominal: means 95 %, family-wise error 5 %\n")
    print(f"{'':50s}{'':>8s}{'means':>9s}{'false':>9s}{'all':>9s}{'D/t_cr':>9s}")
    print(f"{'plan':50s}{'studies':>8s}{'covered':>9s}{'differ':>9s}{'covered':>9s}{'covered':>9s}")
    for number in range(first - 1, 2 if fast else len(NULL)):
        told(number, max(count // SHARES[number], 1))
    false = naive_false(CONTROL, quarter, 100)
    print(f"negative control ({CONTROL.name}; every fit as a person of its own): {100 * false / quarter:.1f} % false")
    ranked(quarter)
    if not fast:
        power(max(studies // 20, 1), 7)
    print(f"\n{time.perf_counter() - began:.0f} s")


def told(number: int, studies: int) -> None:
    """One line of the table."""
    t = tally(NULL[number], studies, 100 + number)
    print(
        f"{NULL[number].name:50s}{t.studies:8d}{100 * t.covered / t.intervals:7.2f} %{100 * t.false / t.studies:7.2f} %"
        f"{100 * t.together / t.studies:7.2f} %{100 * t.creep / t.creeps:7.2f} %",
        flush=True,
    )


def ranked(studies: int) -> None:
    """The right order of three materials."""
    shares = ordered(ORDERED, studies, 900)
    words = ", ".join(f"{name} {100 * share:.1f} %" for name, share in zip(QUANTITIES, shares, strict=True))
    print(f"\nright order, {ORDERED.name}, neighbours {ORDERED.gap:g} sd of a person on a material apart: {words}")


if __name__ == "__main__":
    main(
        studies=int(sys.argv[1]) if len(sys.argv) > 1 else 1000,
        first=int(sys.argv[2]) if len(sys.argv) > 2 else 1,
    )
