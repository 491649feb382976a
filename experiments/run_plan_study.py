"""Does a fit of the logs that `stickslip plan` asks for know what the plan promises?

Random pairs and rigs; the plan of each scene, then the logs it asks for, simulated with the scene's values and new
noise, and fitted. Counted: standard errors of the fit over those that the plan expects; what the worst parameter is
expected to be known to, against ten random sets of logs of the same duration and sampling rate; verdicts of a single
log that tells little (fast, slow or sampled at 50 Hz), as the plan expects them and as the fit gives them; processor
seconds of a plan. Defaults: the same pairs as a new user has them, who knows nothing of friction and the rig from its
records alone: planned from the defaults, and fitted with the rig's intervals as priors. Counted: fits that converge,
and intervals that hold the truth.

    python experiments/run_plan_study.py sets|verdicts|defaults FIRST LAST FILE
    python experiments/run_plan_study.py table FILE...
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record
from experiments.in_parts import append, by_processor_time, kind_and_cases, started
from experiments.machine import describe
from experiments.run_rig_study import FRICTION, calibration, priors_of
from experiments.study_problem import NOISE, RIG, USUAL, coefficients_only
from identify import Scene
from identify.base.outcome import Status
from identify.base.quantiles import NORMAL
from identify.bench.designs import Knowledge, PlannedLog, Rehearsals
from identify.bench.plan import Choices, plan
from identify.bench.plan_words import verdict
from identify.bench.rehearsal import LogDesign
from identify.diagnosis.findings import Findings
from identify.effects import MAIN
from identify.identification import find
from identify.model.model import assemble
from identify.simulation.simulate import run

SEED, CASES, RANDOM_SETS = 53, 50, 10
LOAD_ERROR = 1e-4  # what a fit takes a constant normal force to be off by
CHOICES = Choices(load_error=LOAD_ERROR)
EFFECTS = [*MAIN, "varying_normal_force"]


def scene(number: int, known: bool = False) -> tuple[Scene, dict[str, float]]:
    """A random scene of the usual ranges, and its values; known: only the coefficients are searched."""
    random = np.random.default_rng([SEED, number])
    while True:
        mu_s, step = random.uniform(*USUAL.mu_s), random.uniform(*USUAL.step)
        truth = {"mu_s": mu_s, "mu_k0": mu_s - step, "delta_mu_k": random.uniform(*USUAL.delta_mu_k)}
        for name in ("a", "D", "t_cr"):
            truth[name] = float(np.exp(random.uniform(*np.log(getattr(USUAL, name)))))
        rig = {name: value * USUAL.rig ** random.uniform(-1.0, 1.0) for name, value in RIG.items()}
        if truth["mu_k0"] + truth["delta_mu_k"] > 0.05 and mu_s <= 3 * truth["mu_k0"]:
            break
    document = {
        "effects": EFFECTS,
        "rig": {**rig, "drive_speed": 1e-3, "normal_force": 1.0, "noise": NOISE},
        "parameters": {name: {"start": value} for name, value in truth.items()},
    }
    made = Scene.from_document(document)
    return coefficients_only(made, truth) if known else made, truth | rig


def recorded(values: dict[str, float], log: PlannedLog, random: np.random.Generator) -> tuple[Record, Any]:
    """A planned log, simulated, and its drive as a scene states it."""
    drive, duration = log.design.drive, log.duration
    if isinstance(drive, tuple) and log.times > 1:
        once = log.design.duration
        drive = tuple((start + i * once, speed) for i in range(log.times) for start, speed in drive)
    times = np.arange(round(duration * log.rate) + 1) / log.rate
    motion = run(assemble(MAIN), values, drive, log.design.normal_force, float(times[-1]))
    force = motion.sample(times)["force"] + NOISE * random.standard_normal(times.size)
    told = [list(pair) for pair in drive] if isinstance(drive, tuple) else drive
    return Record(times, np.full(times.size, log.design.normal_force), force), told


def fitted(made: Scene, values: dict[str, float], logs: Sequence[PlannedLog], number: int) -> Findings:
    """The fit of planned logs after recording them."""
    random = np.random.default_rng([SEED, 1, number])
    pairs = [recorded(values, log, random) for log in logs]
    document = made.as_document()
    document["logs"] = [{"path": f"log_{i}.csv", "drive_speed": drive} for i, (_, drive) in enumerate(pairs, 1)]
    document["rig"].pop("drive_speed")
    records = [record for record, _ in pairs]
    return find(Scene.from_document(document), records, progress=lambda _s, _x: None)[1]


def sets(number: int, known: bool = False) -> dict[str, Any]:
    """The recommended set of one scene: promised and fitted standard errors, and random sets of the same duration."""
    made, values = scene(number, known)
    began = time.process_time()
    planned = plan(made, (), CHOICES)
    seconds = time.process_time() - began
    k, tried = planned.knowledge, Rehearsals(planned.knowledge)
    expected = _halves(k, [tried.information(log.design, log.times, 0) for log in planned.logs])
    worst = float(np.max(expected))
    found = fitted(made, values, planned.logs, number)
    ratios = {}
    for place, name in enumerate(k.names):
        estimate = next(e for e in found.estimates if e.name == name)
        if estimate.standard_error is not None and found.status is Status.CONVERGED:
            shown = estimate.standard_error / (abs(values["mu_s"] - values["mu_k0"]) if name == "delta_mu_k" else 1.0)
            shown = shown if name == "delta_mu_k" else shown / abs(values[name])
            ratios[name] = float(
                shown
                / (
                    math.log1p(expected[place]) / NORMAL
                    if k.unknowns.logarithmic[np.flatnonzero(k.unknowns.free)[k.kept[place]]]
                    else expected[place] / NORMAL
                )
            )
    return {
        "study": "sets",
        "number": number,
        "seconds": seconds,
        "logs": [[log.design.speed, log.duration, log.rate, list(log.design.holds)] for log in planned.logs],
        "promised": dict(zip(k.names, planned.then.tolist(), strict=True)),
        "status": found.status.value,
        "left_out": sorted(found.left_out),
        "ratios": ratios,
        "gain": _random_worst(tried, planned.logs, number) / worst,
    }


def _halves(k: Knowledge, told: Sequence[Any]) -> Any:
    """Half lengths (k,) at the likeliest place, with logs that hold this information."""
    return replace(k, places=k.places[:1]).halves(k.known[:1] + sum(told, start=np.zeros(())))


def _random_worst(tried: Rehearsals, logs: Sequence[PlannedLog], number: int) -> float:
    """What the worst parameter is known to, geometric mean over random sets: as many logs, of the same duration and
    rates in all, at speeds drawn within the range that the plan had."""
    random, k = np.random.default_rng([SEED, 2, number]), tried.knowledge
    worst = []
    for _ in range(RANDOM_SETS):
        told = []
        for log in logs:
            design = LogDesign(float(np.exp(random.uniform(*np.log((1e-3 / 30.0, 1e-3 * 30.0))))), 1.0)
            made = tried.at(design, 0)
            if made is not None:
                long = log.duration / made.duration if made.slips else 1.0
                told.append(made.information(log.rate, k.variance, k.load_error, long))
        worst.append(float(np.max(_halves(k, told))))
    return float(np.exp(np.mean(np.log(np.minimum(worst, 1e3)))))


def verdicts(number: int, known: bool = False) -> dict[str, Any]:
    """A single poor log: the verdicts that the plan expects of its fit, and those of the fit."""
    made, values = scene(number, known)
    random = np.random.default_rng([SEED, 3, number])
    planned = plan(made, (), replace(CHOICES, budget=61.0, speeds=(1e-3,)))
    k, tried = planned.knowledge, Rehearsals(planned.knowledge)
    design = LogDesign(float(random.choice([1e-4, 1e-3, 5e-3])), 1.0)
    rehearsed = tried.at(design, 0)
    if rehearsed is None or not rehearsed.slips:
        return {"study": "verdicts", "number": number, "status": "nothing slips"}
    rate = float(random.choice([50.0, 200.0, 1000.0]))
    log = PlannedLog(design, 1, rate, rehearsed.duration, rehearsed.slips, planned.now, {})
    told = rehearsed.information(rate, k.variance, k.load_error)
    expected = [verdict(float(half)) for half in _halves(k, [told])]
    found = fitted(made, values, [log], number)
    given = {e.name: e.verdict for e in found.estimates}
    return {
        "study": "verdicts",
        "number": number,
        "status": found.status.value,
        "expected": dict(zip(k.names, expected, strict=True)),
        "given": {name: given.get(name, "") for name in k.names},
    }


def defaults(number: int, known: bool = False) -> dict[str, Any]:
    """The pair of a new user: planned from the defaults and the rig's records, and whether the fit of the logs that the
    plan asks for holds the truth."""
    _, values = scene(number)
    rig = priors_of(calibration({name: values[name] for name in RIG}, np.random.default_rng([SEED, 4, number])))
    document = {"effects": EFFECTS, "rig": {**rig, "drive_speed": 1e-3, "normal_force": 1.0, "noise": NOISE}}
    made = Scene.from_document(document)
    logs = plan(made, (), CHOICES).logs
    began = time.process_time()
    found = fitted(coefficients_only(made, values) if known else made, values, logs, number)
    told = [e for e in found.estimates if e.name in FRICTION and e.lower is not None and e.upper is not None]
    converged = found.status is Status.CONVERGED
    return {
        "study": "defaults",
        "number": number,
        "seconds": time.process_time() - began,
        "logs": [[log.design.speed, log.duration, log.rate, list(log.design.holds)] for log in logs],
        "status": found.status.value,
        "left_out": sorted(found.left_out),
        "held": {e.name: bool(e.lower <= values[e.name] <= e.upper) for e in told} if converged else {},
        "verdicts": {e.name: e.verdict for e in told} if converged else {},
    }


STUDIES = {"sets": sets, "verdicts": verdicts, "defaults": defaults}


def study(name: str, first: int, last: int, file: Path | None = None, known: bool = False) -> list[dict[str, Any]]:
    """Cases first to last, each printed, and appended to a file if one is given."""
    out = []
    for number in range(first, last + 1):
        out.append(STUDIES[name](number, known))
        print(out[-1], flush=True)
        append(file, out[-1])
    return out


def table(lines: Sequence[dict[str, Any]]) -> None:
    """Counts of both studies."""
    print(f"\n{describe()}\n")
    mine = [line for line in lines if line["study"] == "sets"]
    if mine:
        ratios = [r for line in mine for r in line["ratios"].values()]
        off = np.abs(np.log(ratios)) if ratios else np.array([np.nan])
        print(f"sets: {len(mine)}, of which {sum(line['status'] == 'converged' for line in mine)} converge, ", end="")
        print(f"{sum(bool(line['left_out']) for line in mine)} without one of the logs")
        print(f"fitted over promised standard error: median {np.median(ratios or [np.nan]):.2f}, ", end="")
        print(f"median off by {100 * (math.exp(np.median(off)) - 1):.0f} %")
        print(
            f"worst parameter against random sets: median {np.median([line['gain'] for line in mine]):.1f} x, ", end=""
        )
        print(f"2 x and more in {sum(line['gain'] >= 2.0 for line in mine)} of {len(mine)}")
        print(f"processor seconds of a plan: {np.median([line['seconds'] for line in mine]):.1f}, ", end="")
        print(f"at most {max(line['seconds'] for line in mine):.1f}")
    new = [line for line in lines if line["study"] == "defaults"]
    if new:
        held = [h for line in new for h in line["held"].values()]
        print(
            f"planned from the defaults: {len(new)}, of which {sum(bool(line['held']) for line in new)} converge, ",
            end="",
        )
        print(f"{sum(bool(line['left_out']) for line in new)} without one of the logs; ", end="")
        print(f"intervals that hold the truth: {sum(held)} of {len(held)}; ", end="")
        print(f"a fit took at most {max(line['seconds'] for line in new):.1f} s of processor time")
    poor = [line for line in lines if line["study"] == "verdicts" and line["status"] == "converged"]
    if poor:
        pairs = [(line["expected"][name], line["given"][name]) for line in poor for name in line["expected"]]
        open_ = [given for expected, given in pairs if expected == "not identifiable"]
        print(f"single logs that converge: {len(poor)}; called not identifiable by the plan: {len(open_)}, ", end="")
        print(f"by the fit as well: {sum(given == 'not identifiable' for given in open_)}")
        print(f"all verdicts alike: {sum(a == b for a, b in pairs)} of {len(pairs)}")


def main(fast: bool = False) -> list[dict[str, Any]]:
    """The whole study; fast: one single log, of which only the coefficients are searched."""
    counts = {"verdicts": 1} if fast else {"sets": CASES, "verdicts": CASES}
    lines = [line for name, count in counts.items() for line in study(name, 1, count, known=fast)]
    table(lines)
    return lines


if __name__ == "__main__":
    by_processor_time()
    started(main, table, kind_and_cases(study))
