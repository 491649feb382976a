"""What a bootstrap and a profile cost, in fits: 200 replicates within 30 fits, a profile of all six within 40.

The joint fit of the four study logs from their samples in a warm process, then on its answer the bootstrap, the profile
that finds the ends of all intervals, and the one that is drawn. Processor time, so that a busy machine counts less.

    python experiments/run_uncertainty_cost.py
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.machine import describe
from experiments.study_problem import DEMO, coefficients_only, scene_of, simulated_case
from identify.estimation.agreement import noise_of
from identify.estimation.bootstrap import bootstrap
from identify.estimation.examined import CURVE_STEPS
from identify.estimation.influence import influence
from identify.estimation.profile import ProfileNoise, ProfileOptions, profile
from identify.identification import find

REPLICATES, FIT_REPEATS = 200, 3
ALLOWED = {"bootstrap": 30.0, "profile": 40.0, "profile, drawn": 40.0}


def timed(work: Callable[[], object]) -> tuple[float, object]:
    """Processor seconds of some work, and what it gives."""
    since = time.process_time()
    made = work()
    return time.process_time() - since, made


def main(fast: bool = False) -> dict[str, float]:
    """Costs in fits, by name; fast: fewer replicates and no curves, where only the coefficients are searched."""
    replicates = 10 if fast else REPLICATES
    case = simulated_case(DEMO, 1)
    scene = coefficients_only(scene_of(case), DEMO) if fast else scene_of(case)

    def fit() -> object:
        return find(scene, case.records, progress=lambda _stage, _share: None)[1]

    if not fast:
        fit()  # the functions of the model are built once per process
    fits = [timed(fit) for _ in range(1 if fast else FIT_REPEATS)]
    one, found = float(np.median([seconds for seconds, _ in fits])), fits[-1][1]
    attempt, unknowns = found.attempt, found.unknowns  # type: ignore[attr-defined]
    covariance, solved = found.covariance, attempt.solved  # type: ignore[attr-defined]
    cycles = [trajectory.cycles for trajectory in solved.trajectories]

    def resample() -> object:
        known = influence(solved.problem, solved.solution.z, cycles)
        return bootstrap(solved.problem, solved.solution.z, known, replicates)

    def walk(steps: int) -> object:
        noise = ProfileNoise(covariance, noise_of(attempt))
        return profile(attempt.fitted_logs, solved, unknowns, noise, ProfileOptions(steps=steps))

    print(describe())
    print(f"{solved.problem.samples} samples, {sum(cycles)} cycles; one fit {one:.2f} s of processor time")
    costs = {}
    works = {"bootstrap": resample, "profile": lambda: walk(1), "profile, drawn": lambda: walk(CURVE_STEPS)}
    for name, work in list(works.items())[: 2 if fast else None]:
        seconds, made = timed(work)
        costs[name] = seconds / one
        failed = int(np.count_nonzero(~made.settled)) if name == "bootstrap" else 0  # type: ignore[attr-defined]
        told = f", {replicates} replicates, {failed} did not settle" if name == "bootstrap" else ""
        print(f"{name:16s} {seconds:7.2f} s = {costs[name]:6.1f} fits (allowed {ALLOWED[name]:g}){told}", flush=True)
    return costs


if __name__ == "__main__":
    main()
