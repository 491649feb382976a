"""Random pairs: how often the fit finds the truth: from the data alone, from a user's start alone, and from both, as
the command does where a scene gives start values.

Recovered: converged, no parameter called not identifiable, and all six within 5 % or joint distance
(theta - truth)' C^-1 (theta - truth) <= 22.5. False success: converged while the joint distance exceeds 40 and
a parameter is off by more than 10 %. Every case follows from the study and its number, so a study can be run in parts:
one line of JSON per case goes to FILE, and the table is made of the file. RANGES: usual, wide, or "wide, five logs".

    python experiments/run_recovery_study.py RANGES data|user|both NOISE_FACTOR RATE_FACTOR FIRST LAST FILE
    python experiments/run_recovery_study.py table FILE...
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.in_parts import append, started
from experiments.machine import describe
from experiments.study_problem import (
    FIFTH,
    NOISE,
    SPEEDS,
    USUAL,
    WIDE,
    Case,
    random_case,
    scene_of,
    with_fifth,
    wrong_start,
)
from identify.base.outcome import Status
from identify.diagnosis.findings import Findings
from identify.estimation.starts import Sources
from identify.identification import find

FRICTION = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
CLOSE, FAR = 22.5, 40.0
FIVE = "wide, five logs"  # the same pairs, with one faster log more
RANGES = {ranges.name: ranges for ranges in (USUAL, WIDE)} | {FIVE: WIDE}
CASES, SEED = 200, 4


@dataclass(frozen=True)
class Outcome:
    """One fit of the study. errors: relative, by parameter; distance: joint, squared; left_out: numbers of the logs
    that took no part."""

    status: Status
    verdicts: dict[str, str]
    errors: dict[str, float]
    distance: float
    seconds: float
    message: str
    left_out: tuple[int, ...] = ()

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
    further = [FIFTH[0]] * (len(case.records) - len(SPEEDS))
    scene = scene_of(case, start, further)
    _, found = find(scene, case.records, progress=lambda _stage, _share: None, starts=sources)
    return compared(found, case, time.perf_counter() - began)


def compared(found: Findings, case: Case, seconds: float) -> Outcome:
    """What was found against the truth."""
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
    return Outcome(found.status, verdicts, errors, distance, seconds, found.message, tuple(found.left_out))


@dataclass(frozen=True)
class Study:
    """From which ranges the pairs come, where the fit starts, factors on noise and sampling rate."""

    ranges: str
    sources: Sources = "data"
    noise: float = 1.0
    rate: float = 1.0

    def case(self, number: int) -> tuple[Case, dict[str, float] | None, int]:
        """Case, user's start and rejected draws of a number: the same pairs whatever the start."""
        random = np.random.default_rng([SEED, number])
        case, rejected = random_case(random, RANGES[self.ranges], noise=self.noise * NOISE, rate=self.rate)
        start = wrong_start(random, case.truth) if self.sources != "data" else None
        if self.ranges == FIVE:
            case = with_fifth(case, number, noise=self.noise * NOISE, rate=self.rate)
        return case, start, rejected

    def run(self, first: int, last: int, file: Path | None = None) -> list[dict[str, Any]]:
        """Fit the cases first to last; prints a line for each."""
        return [self._run(number, file) for number in range(first, last + 1)]

    def _run(self, number: int, file: Path | None) -> dict[str, Any]:
        case, start, rejected = self.case(number)
        outcome = fit_case(case, start, self.sources)
        word = "recovered" if outcome.recovered else "FALSE SUCCESS" if outcome.false_success else "not recovered"
        worst = max(outcome.errors, key=lambda n: abs(outcome.errors[n]))
        print(
            f"{number:4d} {word:13s} {outcome.status.value:17s} distance {outcome.distance:8.1f}  worst {worst:10s} "
            f"{100 * outcome.errors[worst]:7.2f} %  {outcome.seconds:5.2f} s  cycles {case.cycles}",
            flush=True,
        )
        if not outcome.recovered:
            pair = "  ".join(f"{n} {v:.4g}" for n, v in (case.truth | case.rig).items())
            print(f"       {pair}\n       {outcome.verdicts}\n       {outcome.message}", flush=True)
        line = asdict(self) | {
            "number": number,
            "rejected": rejected,
            "status": outcome.status.value,
            "recovered": outcome.recovered,
            "false_success": outcome.false_success,
            "distance": outcome.distance,
            "seconds": outcome.seconds,
            "verdicts": outcome.verdicts,
            "left_out": outcome.left_out,
        }
        append(file, line)
        return line


def table(lines: Sequence[dict[str, Any]]) -> None:
    """Counts and times, a row per study."""
    print(f"\n{describe()}\n")
    print("| pairs | start | noise | rate | cases | recovered | false success | status | seconds, median / worst |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    studies = sorted({tuple(line[k] for k in ("ranges", "sources", "noise", "rate")) for line in lines}, key=str)
    for study in studies:
        mine = [line for line in lines if study == tuple(line[k] for k in ("ranges", "sources", "noise", "rate"))]
        ranges, sources, noise, rate = study
        seconds = [line["seconds"] for line in mine]
        counts = ", ".join(f"{k} {v}" for k, v in Counter(line["status"] for line in mine).most_common())
        print(
            f"| {ranges} | {sources} | × {noise:g} | × {rate:g} | {len(mine)} "
            f"({sum(line['rejected'] for line in mine)} draws rejected) | {sum(line['recovered'] for line in mine)} "
            f"| {sum(line['false_success'] for line in mine)} | {counts} "
            f"| {np.median(seconds):.1f} / {max(seconds):.0f} |"
        )


def main(fast: bool = False) -> list[dict[str, Any]]:
    """The whole study: 200 cases of each kind; fast: 2 from the data and 2 from a user's start."""
    if fast:
        lines = Study("usual").run(1, 2) + Study("usual", "user").run(3, 4)
    else:
        kinds = (
            *(Study(r, s) for r in RANGES for s in ("data", "user")),
            Study("usual", noise=4.0),
            Study("usual", rate=0.25),
        )
        lines = [line for kind in kinds for line in kind.run(1, CASES)]
    table(lines)
    return lines


def sources_named(word: str) -> Sources:
    """Where a search starts, by its word on the command line."""
    return next(known for known in get_args(Sources) if known == word)


def part(said: Sequence[str]) -> None:
    """The part of the study that the words of a command line name."""
    ranges, word, noise, rate, first, last, file = said
    Study(ranges, sources_named(word), float(noise), float(rate)).run(int(first), int(last), Path(file))


if __name__ == "__main__":
    started(main, table, part)
