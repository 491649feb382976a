"""Do 95 % intervals hold the truth in 95 % of repeats? Covariance, profile likelihood, cycle-block bootstrap.

Every repeat draws new noise (white, or with a memory: an autoregression of first order) on the same simulated logs and
solves again. Repeats start from the truth's motion, which a search would find as well: what is counted is the interval,
not the search. The normal force is exact, and the fit is told so; the noise level is given. The bootstrap is the one
linear in the residuals; a line shows how far replicates move when each is solved again.

    python experiments/run_coverage_study.py [repeats] [further ones with profile and bootstrap] [seed]
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record
from experiments.answers import answer
from experiments.machine import describe
from experiments.study_problem import DEMO, NORMAL_FORCE, RIG, coefficients_only
from identify.base.linear import Factors, optimality_matrix
from identify.effects import MAIN
from identify.estimation.bootstrap import bootstrap
from identify.estimation.influence import Influence, influence, sample_moves
from identify.estimation.profile import CRITICAL, ProfileNoise, profile
from identify.estimation.residual_autocorrelation import NoiseAutocorrelation, colour, coloured_covariance
from identify.logs.log_data import LogData
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.model.model import assemble
from identify.scene import Scene
from identify.shooting.passes import Solved, solve_in_passes
from identify.shooting.shooting import Problem
from identify.shooting.shooting_trajectory import ShootingTrajectory
from identify.shooting.warm import Settled, Warm
from identify.simulation.drive import NormalForce
from identify.simulation.simulate import run

Array = NDArray[np.float64]

# Drive speed [m/s], duration [s], sampling rate [Hz]: fewer samples than the study problem has; a repeat is cheap.
SPEEDS = ((1e-4, 14.0, 250.0), (1e-3, 2.2, 1000.0), (5e-3, 0.7, 2000.0))
NOISE = 5e-3
MEMORY = 0.8  # correlation from sample to sample of the coloured noise
QUANTILE = 1.959964
SHOWN_EVERY = {False: 500, True: 100}
WALKED_EVERY = 10  # in how many repeats the profile is walked as well
NEAR_END = 0.03
METHODS = ("covariance", "white covariance", "profile", "bootstrap")


@dataclass(frozen=True)
class Setting:
    """The problem without noise, solved: what every repeat starts from."""

    prepared: tuple[Prepared, ...]
    unknowns: Unknowns
    solved: Solved
    clean: list[Array]
    truth: Array
    warm: Warm


def setting(fast: bool) -> Setting:
    """Simulate the logs without noise, find their events once, solve."""
    speeds = SPEEDS[1:] if fast else SPEEDS
    model, records, clean = assemble(MAIN), [], []
    for number, (speed, duration, rate) in enumerate(speeds):
        times = np.arange(round(duration * rate) + 1) / rate
        force = run(model, DEMO | RIG, speed, NORMAL_FORCE, duration).sample(times)["force"]
        noise = NOISE * np.random.default_rng(1000 + number).standard_normal(times.size)
        clean.append(force)
        records.append(Record(times, np.full(times.size, NORMAL_FORCE), force + noise))
    document = {
        "effects": [*MAIN, "varying_normal_force"],
        "rig": RIG | {"noise": NOISE},
        "logs": [{"path": f"log_{i}.csv", "drive_speed": speed} for i, (speed, _, _) in enumerate(speeds, 1)],
    }
    scene = Scene.from_document(document, Path())
    found, searched = answer(coefficients_only(scene, DEMO) if fast else scene, records)
    logs = tuple(
        replace(
            log, data=replace(log.data, force=force, normal_force_sd=0.0, normal_force=NormalForce.of(NORMAL_FORCE))
        )
        for log, force in zip(found.fitted_logs, clean, strict=True)
    )
    data = [log.data for log in logs]
    solved = solve_in_passes(data, found.solved.trajectories, searched.with_weak_priors())
    unknowns = replace(searched, start=solved.theta)
    base = unknowns.base(RIG)
    truth = unknowns.theta(np.array([(DEMO | RIG)[n] for n in unknowns.names]), base)[unknowns.free]
    layout, z = solved.problem.layout, solved.solution.z
    size = np.sqrt(np.diag(_covariance(solved.problem, z)))
    # Curves and weights do not depend on the noise, so these factors serve every repeat.
    warm = Warm(solved.problem, z, np.arange(layout.free.size), size)
    return Setting(logs, unknowns, solved, clean, truth, warm)


def noisy(setting: Setting, random: np.random.Generator, memory: float) -> list[LogData]:
    """New noise on every log."""
    out = []
    for log, clean in zip(setting.prepared, setting.clean, strict=True):
        new = random.standard_normal(clean.size + 200) * np.sqrt(1 - memory**2)
        out.append(replace(log.data, force=clean + NOISE * lfilter([1.0], [1.0, -memory], new)[200:]))
    return out


def repeat(
    setting: Setting, random: np.random.Generator, memory: float, deep: bool, walked: bool = False
) -> dict[str, Array] | None:
    """One repeat: per method whether the interval of each parameter holds the truth (f,); None: it did not settle."""
    solved, data = setting.solved, noisy(setting, random, memory)
    layout = solved.problem.layout
    problem = Problem(data, layout)
    start = solved.solution.z
    f = layout.free.size
    settled = setting.warm.settle(start, problem=problem, within=1e-3)
    if settled is None:
        return None
    theta = (settled.z * layout.scale)[:f]
    cycles = [trajectory.cycles for trajectory in solved.trajectories]
    known = influence(problem, settled.z, cycles, absorbed=deep)
    fitted = problem.fitted(settled.z)
    colours = tuple(colour(log.force - curve) for log, curve in zip(data, fitted, strict=True))
    noise = NoiseAutocorrelation(tuple(log.weight for log in data), colours, (1.0,) * len(data))
    moves = sample_moves(problem, settled.z, known.columns)
    allowed = coloured_covariance(moves, [NOISE**2] * len(data), colours) + known.prior
    off = np.abs(theta - setting.truth)
    out = {
        "covariance": off <= QUANTILE * np.sqrt(np.diag(allowed)),
        "white covariance": off <= QUANTILE * np.sqrt(np.diag(known.covariance)),
    }
    if deep:
        out |= _deep(setting, problem, settled, known, allowed, noise, data, random, walked)
    return out


def _covariance(problem: Problem, z: Array) -> Array:
    point = problem.evaluate(z, derivatives=True)
    assert point.hessian is not None and point.jacobian is not None
    layout = problem.layout
    right = np.zeros((layout.size + layout.rows, layout.free.size))
    right[: layout.free.size] = np.diag(layout.scale[: layout.free.size])
    solved = Factors(optimality_matrix(point.hessian, point.jacobian)).solve(right)
    return np.asarray(layout.scale[: layout.free.size, None] * solved[: layout.free.size])


def _deep(
    setting: Setting,
    problem: Problem,
    settled: Settled,
    known: Influence,
    allowed: Array,
    noise: NoiseAutocorrelation,
    data: list[LogData],
    random: np.random.Generator,
    walked: bool,
) -> dict[str, Array]:
    """Profile and bootstrap of one repeat. A profile interval holds the truth where the data, with the parameter held
    there, object no more than the limit; `walked`: that the ends found by walking say the same is asserted."""
    layout, here = problem.layout, problem.fitted(settled.z)
    memory = np.diag(allowed) / np.diag(known.covariance)
    held = np.zeros(layout.free.size, bool)
    for i in range(layout.free.size):
        found = setting.warm.settle(
            settled.z,
            problem=problem,
            multipliers=settled.multipliers,
            held=(i, setting.truth[i] / layout.scale[i]),
            within=0.05,
        )
        if found is not None:
            loss = 2 * (found.cost - settled.cost)
            held[i] = noise.objection(here, problem.fitted(found.z), loss) <= CRITICAL
    if walked:
        _same_by_walking(setting, problem, settled.z, known, noise, memory, data, held)
    seed = int(random.integers(2**31))
    made = bootstrap(problem, settled.z, known, 200, seed=seed, refine=False)
    inside = (made.interval[:, 0] <= setting.truth) & (setting.truth <= made.interval[:, 1])
    return {"profile": held, "bootstrap": inside}


def _same_by_walking(
    setting: Setting,
    problem: Problem,
    z: Array,
    known: Influence,
    noise: NoiseAutocorrelation,
    memory: Array,
    data: list[LogData],
    held: Array,
) -> None:
    """The ends that a profile finds hold the truth where the objection to it says so, but within 3 % of an end."""
    solved, layout = setting.solved, problem.layout
    x = z * layout.scale
    trajectories: list[ShootingTrajectory] = [
        p.read(g, x) for p, g in zip(layout.places, solved.formed_from, strict=True)
    ]
    theta = setting.unknowns.start.copy()
    theta[layout.free] = x[: layout.free.size]
    here = replace(solved, problem=problem, trajectories=trajectories, theta=theta)
    logs = tuple(replace(log, data=d) for log, d in zip(setting.prepared, data, strict=True))
    unknowns = replace(setting.unknowns, start=theta)
    walked = profile(logs, here, unknowns, ProfileNoise(known.covariance, noise, memory))
    for i, index in enumerate(layout.free.tolist()):
        low, high = (side.end for side in walked.ends[unknowns.names[index]])
        if low is None or high is None:
            continue  # the truth is inside, unless it is at the other end
        margin = NEAR_END * (high - low)
        if min(abs(setting.truth[i] - low), abs(setting.truth[i] - high)) > margin:
            assert (low <= setting.truth[i] <= high) == held[i], unknowns.names[index]


def study(setting: Setting, repeats: int, deep: bool, seed: int, memory: float) -> dict[str, Array]:
    """Whether each interval holds the truth: per method (repeats, f). Prints the table on the way."""
    random, began = np.random.default_rng(seed), time.perf_counter()
    hits: dict[str, list[Array]] = {name: [] for name in METHODS}
    failed = 0
    for number in range(1, repeats + 1):
        seen = repeat(setting, random, memory, deep, number % WALKED_EVERY == 1)
        failed += seen is None
        for name, inside in (seen or {}).items():
            hits[name].append(inside)
        if number % SHOWN_EVERY[deep] == 0 or number == repeats:
            kind = "white noise" if memory == 0.0 else f"noise with a memory ({memory:g} from sample to sample)"
            spent = (time.perf_counter() - began) / number
            print(f"\n{kind}; {number} repeats, {failed} did not settle; {spent:.2f} s each")
            table(setting, hits)
    return {name: np.array(rows) for name, rows in hits.items()}


def table(setting: Setting, hits: dict[str, list[Array]]) -> None:
    """Counts and shares of intervals that hold the truth, one line per method."""
    names = [setting.unknowns.names[i] for i in np.flatnonzero(setting.unknowns.free)]
    print(f"{'':18s} {'repeats':>8s} " + " ".join(f"{name:>12s}" for name in names))
    for name, rows in hits.items():
        if rows:
            cells = " ".join(f"{n:5d} {100 * n / len(rows):5.1f}%" for n in np.sum(rows, axis=0))
            print(f"{name:18s} {len(rows):8d} {cells}", flush=True)


def refinement(setting: Setting) -> float:
    """Largest difference, in standard errors, between replicates solved again and those linear in the residuals."""
    random = np.random.default_rng(9)
    problem = Problem(noisy(setting, random, 0.0), setting.solved.problem.layout)
    cycles = [trajectory.cycles for trajectory in setting.solved.trajectories]
    z = setting.solved.solution.z
    settled = setting.warm.settle(z, problem=problem, within=1e-3)
    assert settled is not None
    known = influence(problem, settled.z, cycles)
    made = [bootstrap(problem, settled.z, known, 50, refine=refine) for refine in (True, False)]
    size = np.sqrt(np.diag(known.covariance))
    return float(np.max(np.abs(made[0].replicates - made[1].replicates[made[0].settled]) / size))


def main(fast: bool = False, repeats: int = 2000, deep: int = 400, seed: int = 1) -> dict[str, dict[str, Array]]:
    """The whole study, white and coloured; fast: a few repeats of two logs, of which only coefficients are searched."""
    if fast:
        repeats, deep = 3, 1
    made = setting(fast)
    print(describe())
    print(f"{len(made.clean)} logs, {sum(x.size for x in made.clean)} samples, ", end="")
    print(f"{sum(g.cycles for g in made.solved.trajectories)} cycles")
    print(f"replicates solved again differ by at most {refinement(made):.3f} standard errors from linear ones")
    out = {}
    for number, (kind, memory) in enumerate((("white", 0.0), ("coloured", MEMORY))):
        out[kind] = study(made, repeats, False, seed + number, memory)
    for number, (kind, memory) in enumerate((("white", 0.0),) if fast else (("white", 0.0), ("coloured", MEMORY))):
        out[kind] |= study(made, deep, True, seed + 10 + number, memory)
    return out


if __name__ == "__main__":
    said = [int(word) for word in sys.argv[1:]]
    main(False, *said)
