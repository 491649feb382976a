"""How fast the fit is: from files to result, against least squares on a simulation, and with the sampling rate.

a. The four logs of the test problem (33,000 samples, 36 cycles), written to files, fitted again and again in a
   warm process on one core.
b. The hard-constrained solve started at the truth (place, then solve in passes) against
   scipy.optimize.least_squares on an event-driven solve_ivp simulation started at the truth, the same samples.
c. The same logs sampled 30 times as fast: the time after reading.
d. The same logs 10 and 30 times as long: the time after reading, and by how much the process grows.
e. The four files in a new process, interpreter and imports included: with the machine code that earlier fits left
   in the cache, and with an empty one; taking turns. The modules have their bytecode, as pip leaves an installed
   package.

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
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")  # before numpy: one core means one thread

import numpy as np  # noqa: E402

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record, write_hdf5  # noqa: E402
from experiments.answers import answer  # noqa: E402
from experiments.event_driven import Series, fit_by_least_squares  # noqa: E402
from experiments.machine import describe  # noqa: E402
from experiments.study_problem import DEMO, KNOWN, NOISE, NORMAL_FORCE, RIG, SPEEDS  # noqa: E402
from experiments.workprec import one_core  # noqa: E402
from identify import Scene, fit  # noqa: E402
from identify.base import native  # noqa: E402
from identify.effects import MAIN as NAMES  # noqa: E402
from identify.model.model import assemble  # noqa: E402
from identify.shooting.grid import COARSE_GRID  # noqa: E402
from identify.shooting.passes import solve_in_passes  # noqa: E402
from identify.shooting.placing import place  # noqa: E402
from identify.simulation.simulate import run  # noqa: E402

LIMIT, TIMES_FASTER, RATE_LIMIT = 0.6, 15.0, 1.3  # what is asked for: s, ratio, ratio
LONGER_LIMIT, LONGEST = 35.0, 10.0  # ratio, s
COLD_LIMIT = 3.0  # s
RATE = 30.0
LENGTHS = (1.0, 10.0, 30.0)  # of the durations; the last for the figures that are asked for
TRUTH = DEMO | RIG
DOCUMENT = "scene.json"
COLD = f"""
import json, pathlib, sys
from identify import Scene, fit
folder = pathlib.Path(sys.argv[1])
print(fit(Scene.from_document(json.loads((folder / "{DOCUMENT}").read_text()), folder)).result["status"])
"""


@dataclass(frozen=True)
class Timing:
    """Repeated wall times [s] of one thing, and the processor times beside them."""

    wall: tuple[float, ...]
    cpu: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median wall time [s]."""
        return float(np.median(self.wall))

    @staticmethod
    def together(timings: Sequence[Timing]) -> Timing:
        """All repetitions of several timings of one thing."""
        return Timing(sum((t.wall for t in timings), ()), sum((t.cpu for t in timings), ()))

    @property
    def seen(self) -> str:
        """The median and the range of the wall times."""
        return f"{self.median:6.2f} s  ({min(self.wall):.2f} to {max(self.wall):.2f} s)"

    def __str__(self) -> str:
        return f"{self.seen[:-1]}; processor {np.median(self.cpu):.2f} s)"


@dataclass(frozen=True)
class Figures:
    """What was measured. fit: from files to result; stages: median seconds of each; solve and least_squares from
    the truth; after_reading and its stages at the rates 1 and RATE; samples and cycles of the fit and its
    status; cold: a new process, with the cache that is there and with an empty one."""

    fit: Timing
    stages: dict[str, float]
    samples: int
    cycles: int
    status: str
    solve: Timing
    least_squares: Timing
    after_reading: tuple[Timing, Timing]
    after_stages: tuple[dict[str, float], dict[str, float]]
    dense_samples: int
    longer: tuple[Longer, ...]
    cold: tuple[Timing, Timing]

    @property
    def times_faster(self) -> float:
        """How many times faster the hard solve is than least squares."""
        return self.least_squares.median / self.solve.median

    @property
    def rate_ratio(self) -> float:
        """Time after reading at RATE times the sampling rate over that at the plain rate."""
        return self.after_reading[1].median / self.after_reading[0].median


@dataclass(frozen=True)
class Longer:
    """The fit of logs that are longer by a factor: seconds after reading, cycles, samples, status, and by how many
    megabytes the largest size of the process grew."""

    factor: float
    seconds: float
    cycles: int
    samples: int
    status: str
    megabytes: float


def timed(function: Callable[[], Any], repeats: int) -> tuple[Timing, list[Any]]:
    """Call again and again; times and results."""
    wall, cpu, results = [], [], []
    for _ in range(repeats):
        since, used = time.perf_counter(), time.process_time()
        results.append(function())
        wall.append(time.perf_counter() - since)
        cpu.append(time.process_time() - used)
    return Timing(tuple(wall), tuple(cpu)), results


def simulated(chosen: Sequence[int], rate: float, length: float = 1.0) -> list[Record]:
    """The chosen logs of the test problem at `rate` times their sampling rates and `length` times as long."""
    model, random, records = assemble(NAMES), np.random.default_rng(1), []
    for speed, duration, hertz in (SPEEDS[i] for i in chosen):
        lasting = duration * length
        times = np.arange(round(lasting * hertz * rate) + 1) / (hertz * rate)
        force = run(model, TRUTH, speed, NORMAL_FORCE, lasting).sample(times)["force"]
        noise = NOISE * random.standard_normal(times.size)
        records.append(Record(times, np.full(times.size, NORMAL_FORCE), force + noise))
    return records


def written(records: Sequence[Record], chosen: Sequence[int], folder: Path, known: Sequence[str] = ()) -> Scene:
    """The records as HDF5 files, and the scene that lists them and states what is known, which goes to a file too."""
    logs = []
    for i, record in zip(chosen, records, strict=True):
        path = folder / f"log_{i}.h5"
        write_hdf5(record, path)
        logs.append({"path": str(path), "drive_speed": SPEEDS[i][0]})
    document = {"effects": [*NAMES, "varying_normal_force"], "rig": dict(RIG), "logs": logs}
    document["parameters"] = {name: {"fixed": TRUTH[name]} for name in known}
    (folder / DOCUMENT).write_text(json.dumps(document), encoding="utf-8")
    return Scene.from_document(document, folder)


def in_new_processes(folder: Path, repeats: int) -> tuple[Timing, Timing]:
    """Whole times of new processes that fit the scene in this folder: with the cache as it is, with an empty one."""
    times: tuple[list[Timing], list[Timing]] = ([], [])
    command = [sys.executable, "-c", COLD, str(folder)]
    root = str(Path(__file__).parents[1])
    surroundings = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    surroundings |= {"PYTHONPATH": root}
    if repeats > 1:
        surroundings["PYTHONPYCACHEPREFIX"] = str(folder / "bytecode")
        subprocess.run(command, env=surroundings, check=True, stdout=subprocess.PIPE)  # leaves the bytecode
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as empty:
            for which, cache in enumerate(({}, {"STICKSLIP_CACHE": empty})):
                once = partial(subprocess.run, command, env=surroundings | cache, check=True, stdout=subprocess.PIPE)
                timing, (done,) = timed(once, 1)
                assert done.stdout.decode().strip() == "converged", done.stdout
                times[which].append(timing)
    return Timing.together(times[0]), Timing.together(times[1])


def against_least_squares(
    records: Sequence[Record], scene: Scene, repeats: int, most: int | None
) -> tuple[Timing, Timing]:
    """The hard solve and least squares, both from the truth on the same samples, taking turns."""
    found, unknowns = answer(scene, records)
    logs = found.fitted_logs
    base = unknowns.base(RIG)
    truth = unknowns.theta(np.array([TRUTH[name] for name in unknowns.names]), base)
    data, start = [log.data for log in logs], replace(unknowns, start=truth)

    def hard() -> float:
        p = [start.values(truth, base) for _ in data]
        trajectories = place(start.model, data, p, [log.falls for log in logs], COARSE_GRID)
        return solve_in_passes(data, [g for g in trajectories if g is not None], start.with_weak_priors()).solution.cost

    series = []
    for log in data:
        mine = (log.time >= log.begin) & (log.time <= log.end) & (log.weight > 0)
        noise = float(log.weight[mine][0] ** -0.5)
        series.append(Series(log.time[mine], log.force[mine], log.drive_speed, NORMAL_FORCE, noise))
    first, costs = timed(hard, repeats)
    usual, results = timed(lambda: fit_by_least_squares(TRUTH, series, most), 1)
    second, _ = timed(hard, repeats)
    cut = ", cut short" if most else ""
    print(
        f"half chi^2: hard solve {costs[0]:.1f}, least squares {results[0].cost:.1f} "
        f"({results[0].nfev} evaluations, {results[0].njev} Jacobians{cut})"
    )
    return Timing.together([first, second]), usual


def with_the_rate(
    plain: Sequence[Record], dense: Sequence[Record], scene: Scene, repeats: int
) -> tuple[tuple[Timing, Timing], tuple[dict[str, float], dict[str, float]]]:
    """Times after reading of both, taking turns, and their median stages."""
    times: tuple[list[Timing], list[Timing]] = ([], [])
    fits: tuple[list[Any], list[Any]] = ([], [])
    for _ in range(repeats):
        for which, records in enumerate((plain, dense)):
            timing, made = timed(partial(fit, scene, records), 1)
            times[which].append(timing)
            fits[which].extend(made)
    return (Timing.together(times[0]), Timing.together(times[1])), (stages_of(fits[0]), stages_of(fits[1]))


def as_they_grow(chosen: Sequence[int], scene: Scene, lengths: Sequence[float]) -> tuple[Longer, ...]:
    """Fits of longer and longer logs, the shortest first: the size of a process only grows."""
    out = []
    for length in lengths:
        records = simulated(chosen, 1.0, length)
        before = _peak()
        timing, fits = timed(partial(fit, scene, records), 1)
        made = fits[0].result
        grown = _peak() - before
        out.append(Longer(length, timing.median, made["fit"]["cycles"], made["fit"]["samples"], made["status"], grown))
    return tuple(out)


def _peak() -> float:
    """Largest size of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def stages_of(fits: Sequence[Any]) -> dict[str, float]:
    """Median seconds of each stage; what no stage claims is the result document."""
    stages = {name: float(np.median([f.result["timing_s"][name] for f in fits])) for name in fits[0].result["timing_s"]}
    total = stages.pop("total")
    return stages | {"document": total - sum(stages.values())}


def main(fast: bool = False) -> Figures:
    """Measure and print. fast: one log, hardly denser or longer, of which only the coefficients are searched, one
    repetition, not warmed up, least squares cut short."""
    chosen, repeats, most = ((2,), 1, 1) if fast else ((0, 1, 2, 3), 5, None)
    records = simulated(chosen, 1.0)
    print(describe())
    with one_core(), tempfile.TemporaryDirectory() as folder:
        scene = written(records, chosen, Path(folder), KNOWN if fast else ())
        if not fast:
            fit(scene)
            native.wait()  # no compiler runs beside what is timed
            fit(scene)  # what it has compiled is loaded
        longer = as_they_grow(chosen, scene, LENGTHS[:1] if fast else LENGTHS)
        dense = simulated(chosen, 2.0 if fast else RATE)
        native.wait()
        whole, fits = timed(lambda: fit(scene), repeats)
        few = max(repeats // 2, 1)
        solve, usual = against_least_squares(records, scene, few, most)
        after, after_stages = with_the_rate(records, dense, scene, repeats)
        cold = in_new_processes(Path(folder), repeats)
    made = fits[0].result["fit"]
    figures = Figures(
        fit=whole,
        stages=stages_of(fits),
        samples=made["samples"],
        cycles=made["cycles"],
        status=fits[0].result["status"],
        solve=solve,
        least_squares=usual,
        after_reading=after,
        after_stages=after_stages,
        dense_samples=sum(record.time.size for record in dense),
        longer=longer,
        cold=cold,
    )
    table(figures)
    return figures


def _listed(stages: dict[str, float]) -> str:
    return "   " + ", ".join(f"{name} {1e3 * seconds:.0f}" for name, seconds in stages.items()) + " ms"


def table(f: Figures) -> None:
    """Print the figures beside what is asked for."""
    print(f"\n{f.samples} samples, {f.cycles} cycles, {f.status}")
    print(f"a. from files to result           {f.fit}   asked: below {LIMIT} s")
    print(_listed(f.stages))
    print(f"b. hard solve from the truth      {f.solve}")
    print(f"   least squares from the truth   {f.least_squares}")
    print(f"   times faster                   {f.times_faster:6.1f}   asked: at least {TIMES_FASTER:g}")
    print(f"c. after reading                  {f.after_reading[0]}")
    print(_listed(f.after_stages[0]))
    print(f"   {RATE:g} x the sampling rate         {f.after_reading[1]}   {f.dense_samples} samples")
    print(_listed(f.after_stages[1]))
    print(f"   ratio                          {f.rate_ratio:6.2f}   asked: below {RATE_LIMIT}")
    print("d. longer logs: seconds after reading, times the first, growth of the process")
    for one in f.longer:
        print(
            f"   {one.factor:3g} x  {one.seconds:6.2f} s  {one.seconds / f.longer[0].seconds:5.1f} x  "
            f"{one.megabytes:5.0f} MB  {one.cycles} cycles, {one.samples} samples, {one.status}"
        )
    print(f"   asked for 30 x: at most {LONGER_LIMIT:g} x and {LONGEST:g} s; size linear")
    print(f"e. new process, cache kept        {f.cold[0].seen}   asked: below {COLD_LIMIT:g} s")
    print(f"   new process, empty cache       {f.cold[1].seen}")


if __name__ == "__main__":
    main("--fast" in sys.argv[1:])
