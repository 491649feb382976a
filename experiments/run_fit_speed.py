"""How fast the fit is: from files to result, beside least squares on a simulation, in a new process.

Processor seconds, medians, taking turns where two are compared.

a. The four logs of the test problem (33,000 samples, 36 cycles) as files, in a warm process on one core.
b. The hard-constrained solve started at the truth against scipy.optimize.least_squares on the event-driven integrator
   of the tests (sticks in closed form, slips by DOP853) at 1e-8, started at the truth, the same samples.
c. The four files in a new process, interpreter and imports included, with the cache that earlier fits left.

    python experiments/run_fit_speed.py
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")  # before numpy: one core means one thread

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from scipy.optimize import least_squares  # noqa: E402

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record, write_hdf5  # noqa: E402
from experiments.machine import describe  # noqa: E402
from experiments.study_problem import DEMO, NORMAL_FORCE, RIG, SPEEDS, coefficients_only, simulated_case  # noqa: E402
from identify import Scene, fit  # noqa: E402
from identify.base import native  # noqa: E402
from identify.effects import MAIN  # noqa: E402
from identify.logs.log_data import LogData  # noqa: E402
from identify.logs.prepare import prepare  # noqa: E402
from identify.logs.unknowns import from_scene  # noqa: E402
from identify.shooting.layout import COARSE_GRID  # noqa: E402
from identify.shooting.passes import solve_in_passes  # noqa: E402
from identify.shooting.placing import place  # noqa: E402
from tests.support import oracle  # noqa: E402

Array = NDArray[np.float64]
TRUTH = DEMO | RIG
RTOL, DIFF_STEP = 1e-8, 1e-6  # of slips; relative, well above their error and well below a sample
DOCUMENT = "scene.json"
COLD = f"""
import json, pathlib, sys
from identify import Scene, fit
folder = pathlib.Path(sys.argv[1])
print(fit(Scene.from_document(json.loads((folder / "{DOCUMENT}").read_text()), folder)).result["status"])
"""


def written(records: Sequence[Record], chosen: Sequence[int], folder: Path) -> Scene:
    """The records as HDF5 files, and the scene that lists them, which goes to a file too."""
    logs = []
    for i, record in zip(chosen, records, strict=True):
        path = folder / f"log_{i}.h5"
        write_hdf5(record, path)
        logs.append({"path": str(path), "drive_speed": SPEEDS[i][0]})
    document = {"effects": [*MAIN, "varying_normal_force"], "rig": dict(RIG), "logs": logs}
    (folder / DOCUMENT).write_text(json.dumps(document), encoding="utf-8")
    return Scene.from_document(document, folder)


def seconds(work: Callable[[], Any], repeats: int) -> float:
    """Median processor time [s]."""
    taken = []
    for _ in range(repeats):
        since = time.process_time()
        work()
        taken.append(time.process_time() - since)
    return float(np.median(taken))


def fit_by_least_squares(logs: Sequence[tuple[LogData, Array]], most: int | None) -> None:
    """Fit the six friction parameters to logs, each with the rows that count, started at the truth; settings are
    scipy's but for the difference step. most: give up after so many evaluations (None: scipy's own limit)."""

    def residuals(ratio: Array) -> Array:
        p = TRUTH | {name: DEMO[name] * float(r) for name, r in zip(DEMO, ratio, strict=True)}
        parts = []
        for log, mine in logs:
            motion = oracle.simulate(p, log.drive_speed, NORMAL_FORCE, log.end, rtol=RTOL)
            parts.append((motion.force(log.time[mine]) - log.force[mine]) * np.sqrt(log.weight[mine]))
        return np.concatenate(parts)

    least_squares(residuals, np.ones(len(DEMO)), diff_step=DIFF_STEP, max_nfev=most)


def against_least_squares(
    records: Sequence[Record], scene: Scene, repeats: int, most: int | None
) -> tuple[float, float]:
    """Seconds of the hard solve and of least squares, both from the truth on the same samples."""
    unknowns = from_scene(scene)
    logs = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]
    data = [log.data for log in logs]
    truth = unknowns.theta(np.array([TRUTH[name] for name in unknowns.names]), data[0].base)
    start = replace(unknowns, start=truth)

    def hard() -> None:
        p = [start.values(truth, log.base) for log in data]
        trajectories = place(start.model, data, p, [log.slip_times for log in logs], COARSE_GRID)
        solve_in_passes(data, [g for g in trajectories if g is not None], start.with_weak_priors())

    rows = [(log, (log.time >= log.begin) & (log.time <= log.end) & (log.weight > 0)) for log in data]
    hard()
    return seconds(hard, repeats), seconds(lambda: fit_by_least_squares(rows, most), 1)


def in_a_new_process(folder: Path) -> float:
    """Processor time [s] of a new process that fits the scene in this folder."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    surroundings = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    subprocess.run([sys.executable, "-c", COLD, str(folder)], env=surroundings, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main(fast: bool = False) -> None:
    """Measure and print; fast: one log, of which only the coefficients are searched, once."""
    chosen, repeats = ((3,), 1) if fast else ((0, 1, 2, 3), 5)
    records = [simulated_case(DEMO, 1).records[i] for i in chosen]
    print(describe())
    with tempfile.TemporaryDirectory() as place_:
        folder = Path(place_)
        scene = written(records, chosen, folder)
        scene = coefficients_only(scene, DEMO) if fast else scene
        made = fit(scene)
        native.wait()  # no compiler runs beside what is timed
        print(f"a. {made.result['fit']['samples']} samples, {made.result['fit']['cycles']} cycles, {made.status}")
        print(f"   from files to result        {seconds(lambda: fit(scene), repeats):6.2f} s")
        hard, usual = against_least_squares(records, scene, repeats, 1 if fast else None)
        print(f"b. hard solve from the truth   {hard:6.2f} s, least squares {usual:.2f} s: {usual / hard:.0f} times")
        if not fast:
            new = np.median([in_a_new_process(folder) for _ in range(repeats)])
            print(f"c. new process, cache kept     {new:6.2f} s")


if __name__ == "__main__":
    main("--fast" in sys.argv[1:])
