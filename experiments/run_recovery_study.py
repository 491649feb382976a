"""Random pairs: how often the fit finds the truth, from the data alone and from a user's start alone.

Recovered: converged, no parameter called not identifiable, and all six within 5 % or joint distance
(theta - truth)' C^-1 (theta - truth) <= 22.5. False success: converged while the joint distance exceeds 40 and
a parameter is off by more than 10 %. Prints one line per case and the table.

    python experiments/run_recovery_study.py [cases] [seed] [data|user] [noise factor] [rate factor]
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.machine import describe
from experiments.study_problem import NOISE, Case, random_case, scene_of, wrong_start
from identify.identification import find
from identify.outcome import Status
from identify.search import Clock, Sources

FRICTION = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
CLOSE, FAR = 22.5, 40.0


@dataclass(frozen=True)
class Outcome:
    """One fit of the study. errors: relative, by parameter; distance: joint, squared."""

    status: Status
    verdicts: dict[str, str]
    errors: dict[str, float]
    distance: float
    seconds: float
    message: str

    @property
    def recovered(self) -> bool:
        """Whether the fit found the truth."""
        told = self.status is Status.CONVERGED and "not identifiable" not in self.verdicts.values()
        return told and (max(abs(e) for e in self.errors.values()) <= 0.05 or self.distance <= CLOSE)

    @property
    def false_success(self) -> bool:
        """Whether the fit claims an answer that is wrong."""
        wrong = self.distance > FAR and max(abs(e) for e in self.errors.values()) > 0.10
        return self.status is Status.CONVERGED and wrong


def fit_case(case: Case, start: dict[str, float] | None, sources: Sources) -> Outcome:
    """Fit one case and compare with its truth."""
    began = time.perf_counter()
    _, found = find(
        scene_of(case, start), case.records, clock=Clock(), progress=lambda _stage, _share: None, starts=sources
    )
    seconds = time.perf_counter() - began
    if found.attempt is None or found.covariance is None:
        return Outcome(found.status, {}, dict.fromkeys(FRICTION, np.inf), np.inf, seconds, found.message)
    unknowns, theta = found.unknowns, found.attempt.solved.theta
    base = unknowns.base(case.rig)
    true_theta = unknowns.theta(np.array([(case.truth | case.rig)[n] for n in unknowns.names]), base)
    off = (theta - true_theta)[unknowns.free]
    distance = float(off @ np.linalg.solve(found.covariance, off))
    values = dict(zip(unknowns.names, unknowns.values(theta, base).tolist(), strict=True))
    errors = {n: values[n] / case.truth[n] - 1 for n in FRICTION}
    verdicts = {e.name: e.verdict for e in found.estimates if e.name in FRICTION}
    return Outcome(found.status, verdicts, errors, distance, seconds, found.message)


def study(cases: int, seed: int, sources: Sources, noise: float, rate: float) -> list[Outcome]:
    """Fit random cases; prints a line for each."""
    random = np.random.default_rng(seed)
    outcomes, rejected = [], 0
    for number in range(1, cases + 1):
        case, passed_over = random_case(random, noise=noise * NOISE, rate=rate)
        rejected += passed_over
        start = wrong_start(random, case.truth) if sources == "user" else None
        outcome = fit_case(case, start, sources)
        outcomes.append(outcome)
        word = "recovered" if outcome.recovered else "FALSE SUCCESS" if outcome.false_success else "not recovered"
        worst = max(outcome.errors, key=lambda n: abs(outcome.errors[n]))
        print(
            f"{number:4d} {word:13s} {outcome.status.value:17s} distance {outcome.distance:8.1f}  worst {worst:10s} "
            f"{100 * outcome.errors[worst]:7.2f} %  {outcome.seconds:5.2f} s  cycles {case.cycles}",
            flush=True,
        )
        if not outcome.recovered:
            pair = "  ".join(f"{n} {v:.4g}" for n, v in case.truth.items())
            print(f"       {pair}\n       {outcome.verdicts}\n       {outcome.message}", flush=True)
    table(outcomes, rejected, sources, noise, rate)
    return outcomes


def table(outcomes: list[Outcome], rejected: int, sources: Sources, noise: float, rate: float) -> None:
    """Counts and times of a study."""
    seconds = [o.seconds for o in outcomes]
    counts = Counter(o.status.value for o in outcomes)
    verdicts = Counter(v for o in outcomes for v in o.verdicts.values())
    print(f"\n{describe()}")
    print(f"start from: {sources}; noise {noise:g} x {NOISE:g} N; sampling rate x {rate:g}")
    print(f"cases          {len(outcomes):5d}   (draws rejected: {rejected})")
    print(f"recovered      {sum(o.recovered for o in outcomes):5d}")
    print(f"false success  {sum(o.false_success for o in outcomes):5d}")
    print("status         " + ", ".join(f"{k} {v}" for k, v in counts.most_common()))
    print("verdicts       " + ", ".join(f"{k} {v}" for k, v in verdicts.most_common()))
    print(f"seconds        median {np.median(seconds):.2f}, worst {max(seconds):.2f}")


def main(fast: bool = False) -> list[Outcome]:
    """The whole study: 60 cases from the data alone and 60 from a user's start alone; fast: 2 of each."""
    count = 2 if fast else 60
    return study(count, 1, "data", 1.0, 1.0) + study(count, 2, "user", 1.0, 1.0)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    if not arguments:
        main()
    else:
        said = [*arguments, *("60", "1", "data", "1", "1")[len(arguments) :]]
        study(int(said[0]), int(said[1]), "user" if said[2] == "user" else "data", float(said[3]), float(said[4]))
