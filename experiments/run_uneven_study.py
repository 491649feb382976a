"""Simulated uneven records, recovered: bias, coverage, bound on the creep time; printed case by case.

The records come from uneven_records.py, which shares nothing with the estimator. Deviations are of logarithms; the
strength is compared with that at the typical rest and, as "effective", with the median onset force above the slow
level over the cycles that were found.

    python experiments/run_uneven_study.py [records per case [first seed]]
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record
from experiments.uneven_records import SOFT, STIFF, Pair, Simulated, simulated
from identify.effects import MAIN
from identify.logs.prepare import Prepared, prepare
from identify.logs.unknowns import from_scene
from identify.scene import Scene
from identify.uneven.creep import creep_interval
from identify.uneven.estimator import maximise
from identify.uneven.events import sticks_of
from identify.uneven.slip_functions import PARAMETERS

Array = NDArray[np.float64]

CASES = {
    "soft": SOFT,
    "soft, rough": replace(SOFT, roughness=0.011),
    "stiff": STIFF,
    "stiff, rough": replace(STIFF, roughness=0.015),
}
QUANTITIES = (*PARAMETERS, "effective", "length")


def scene_of(pair: Pair) -> Scene:
    """The rig of a pair as a user states it; friction is searched."""
    rig = {
        "mass": pair.mass,
        "stiffness": pair.stiffness,
        "damping": pair.damping * float(np.sqrt(pair.stiffness / pair.mass)),
        "drive_speed": pair.drive_speed,
    }
    return Scene.from_document(
        {"effects": [*MAIN, "varying_normal_force"], "rig": rig, "logs": [{"path": "track.csv"}]}
    )


def prepared(pair: Pair, record: Record) -> Prepared:
    """A record of a pair as the estimators take it."""
    scene = scene_of(pair)
    return prepare(scene, scene.logs[0], record, from_scene(scene))


def truth_of(pair: Pair, rest: float) -> Array:
    """Logarithms of PARAMETERS (7,); strength after a rest [s]."""
    strength = pair.strength * -np.expm1(-rest / pair.creep_time)
    scales = (pair.level_wander, max(pair.scatter, 1e-6), max(pair.roughness, 1e-6))
    return np.log([strength, pair.weakening_rate, pair.creep_time, pair.mass, *scales])


def recovered(pair: Pair, track: Simulated) -> tuple[Array, Array, bool, bool, float]:
    """Errors and half widths of the intervals of QUANTITIES, whether it converged, whether the bounds of the creep time
    hold, seconds."""
    began = time.process_time()
    sticks = sticks_of(prepared(pair, track.record))
    maximum = maximise([sticks])
    creep = creep_interval([sticks], maximum)
    took = time.process_time() - began
    error = maximum.theta - truth_of(pair, sticks.usual_rest)
    nearest = np.abs(track.onset[:, None] - sticks.anchor).argmin(axis=0)
    effective = maximum.theta[0] - np.log(np.median(track.effective[nearest]))
    sd = np.sqrt(np.diag(maximum.covariance))
    both = np.sqrt(sd[0] ** 2 + sd[1] ** 2 - 2.0 * maximum.covariance[0, 1])
    holds = (creep.lower or 0.0) <= pair.creep_time <= (creep.upper or np.inf)
    return (
        np.array([*error, effective, error[0] - error[1]]),
        maximum.quantile * np.array([*sd, sd[0], both]),
        maximum.converged,
        holds,
        took,
    )


def main(fast: bool = False, count: int = 50, seed: int = 0) -> dict[str, tuple[Array, Array]]:
    """Mean error and coverage of QUANTITIES by case; fast: one record of one case."""
    cases = {"stiff": STIFF} if fast else CASES
    out = {}
    print(f"{'case':14}{'':10}" + "".join(f"{name[:9]:>10}" for name in QUANTITIES))
    for name, pair in cases.items():
        tracks = simulated(pair, 24 if fast else 50, list(range(seed, seed + (1 if fast else count))))
        rows = [recovered(pair, track) for track in tracks]
        error, half = (np.array([row[i] for row in rows]) for i in range(2))
        converged, holds, took = (np.array([row[i] for row in rows]) for i in range(2, 5))
        covered = np.mean(np.abs(error) < half, axis=0)
        print(f"{name:14}{'error':10}" + "".join(f"{value:10.3f}" for value in error.mean(axis=0)))
        print(f"{'':14}{'half width':10}" + "".join(f"{value:10.3f}" for value in half.mean(axis=0)))
        print(f"{'':14}{'covered':10}" + "".join(f"{value:10.2f}" for value in covered))
        print(
            f"{'':14}{converged.sum()} of {len(rows)} converged, bounds on the creep time hold in {holds.sum()}, "
            f"{took.mean():.1f} s each",
            flush=True,
        )
        out[name] = error.mean(axis=0), covered
    return out


if __name__ == "__main__":
    main(False, *map(int, sys.argv[1:]))
