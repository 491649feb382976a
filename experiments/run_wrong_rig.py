"""A wrong rig on purpose: is it noticed, is it named, and is the truth found with the quantity set free?

Random pairs at four drive speeds; the scene states a mass 1.5 times, or a stiffness 1.2 times the true one, or the
force sensor lags by 5 ms and the scene does not say so. Noticed: the fit does not end with `converged`. Named: its
message names the quantity, and the value it gives is within 5 % of the truth; alone: nothing else is named beside it
(a stiffness stated too high and something that gives in series are hard to tell apart). Recovered: with the quantity
free the fit converges, and the quantity is within 5 %. Every case follows from its number, so the study can be run in
parts.

    python experiments/run_wrong_rig.py mass|stiffness|lag FIRST LAST FILE
    python experiments/run_wrong_rig.py table FILE...
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import Record
from experiments.in_parts import append, kind_and_cases, started
from experiments.machine import describe
from experiments.study_problem import NOISE, NORMAL_FORCE, SPEEDS, USUAL, Case, coefficients_only, random_case, scene_of
from identify import Scene
from identify.base.outcome import Status
from identify.effects import MAIN
from identify.identification import find
from identify.model.model import assemble
from identify.scene.parameters import ParameterSpec
from identify.simulation.simulate import run

CASES, SEED = 100, 7
KINDS = {"mass": 1.5, "stiffness": 1.2, "lag": 5e-3}
CLOSE = 0.05
FINE = 20  # samples of the lagging force per sample of the log


def wrong(kind: str, number: int, first: int = 0) -> tuple[Case, Scene, float]:
    """Case, scene as the user states it, and the true value of what it states wrongly; of the logs from this one on."""
    random = np.random.default_rng([SEED, number])
    case, _ = random_case(random, USUAL)
    case = replace(case, records=case.records[first:])
    if kind == "lag":
        case = replace(case, records=_lagging(case, KINDS[kind], random))
        return case, _of_last(scene_of(case, None), case), KINDS[kind]
    stated = replace(case, rig=case.rig | {kind: case.rig[kind] * KINDS[kind]})
    return case, _of_last(scene_of(stated, None), case), case.rig[kind]


def _of_last(scene: Scene, case: Case) -> Scene:
    """The scene with the logs that the case still holds."""
    return replace(scene, logs=scene.logs[-len(case.records) :])


def _lagging(case: Case, lag: float, random: np.random.Generator) -> tuple[Record, ...]:
    """The records as a first-order sensor shows them: exact for a force that is linear between fine samples."""
    from scipy.signal import lfilter

    out = []
    for (speed, duration, rate), record in zip(SPEEDS[-len(case.records) :], case.records, strict=True):
        fine = FINE * rate * max(1.0, round(1.0 / (rate * lag)))
        step = 1.0 / fine
        motion = run(assemble(MAIN), case.truth | case.rig, speed, NORMAL_FORCE, duration)
        force = motion.sample(np.arange(round(duration * fine) + 1) * step)["force"]
        decay = np.exp(-step / lag)
        ramp = lag * (1.0 - decay) / step
        shown = lfilter([1.0 - ramp, ramp - decay], [1.0, -decay], force)[:: round(fine / rate)]
        noisy = shown[: record.time.size] + NOISE * random.standard_normal(record.time.size)
        out.append(Record(record.time, record.normal_force, noisy))
    return tuple(out)


def freed(scene: Scene, kind: str) -> Scene:
    """The scene with the quantity estimated."""
    if kind == "lag":
        return scene.with_effects((*scene.model.effects, "sensor_lag"))
    value = float(getattr(scene.rig, kind))
    return replace(scene, parameters={**scene.parameters, kind: ParameterSpec(kind, None, value / 4.0, value * 4.0)})


def trial(kind: str, number: int, also_freed: bool = True, known: bool = False) -> dict[str, Any]:
    """One case: fitted as stated, and with the quantity free; known: of two logs, and but for
    it only the coefficients are searched."""
    case, scene, truth = wrong(kind, number, 2 if known else 0)
    scene = coefficients_only(scene, case.truth) if known else scene
    began = time.process_time()
    _, found = find(scene, case.records, progress=lambda _s, _x: None, starts="data")
    seconds = time.process_time() - began
    told = _told(kind, found.message)
    if not also_freed:
        named = bool(np.isfinite(told) and abs(told / truth - 1.0) < CLOSE)
        return {"noticed": found.status is not Status.CONVERGED, "named": named, "status": found.status.value}
    _, open_ = find(freed(scene, kind), case.records, progress=lambda _s, _x: None, starts="data")
    value = np.nan
    if open_.attempt is not None:
        u = open_.unknowns
        base = u.base({n: float(getattr(scene.rig, n)) for n in ("mass", "stiffness", "damping")})
        name = "lag_time" if kind == "lag" else kind
        value = float(u.values(open_.attempt.solved.theta, base)[u.names.index(name)])
    return {
        "kind": kind,
        "number": number,
        "noticed": found.status is not Status.CONVERGED,
        "named": bool(np.isfinite(told) and abs(told / truth - 1.0) < CLOSE),
        "alone": found.message.count("explains the misfit") == 1,
        "recovered": open_.status is Status.CONVERGED and bool(abs(value / truth - 1.0) < CLOSE),
        "status": found.status.value,
        "freed": open_.status.value,
        "seconds": seconds,
        "message": found.message,
    }


def _told(kind: str, message: str) -> float:
    """The value of the quantity that the message names [SI]; NaN where it does not."""
    pattern = {"mass": r"a mass of (\S+) kg", "stiffness": r"a stiffness of (\S+) N/m", "lag": r"sensor of (\S+) ms"}
    match = re.search(pattern[kind], message)
    return np.nan if match is None else float(match[1]) * (1e-3 if kind == "lag" else 1.0)


def study(kind: str, first: int, last: int, file: Path | None = None, known: bool = False) -> list[dict[str, Any]]:
    """Cases first to last of a kind, each printed, and appended to a file if one is given."""
    out = []
    for number in range(first, last + 1):
        line = trial(kind, number, known=known)
        out.append(line)
        print(
            f"{kind:9s} {number:4d} noticed {line['noticed']!s:5} named {line['named']!s:5} recovered "
            f"{line['recovered']!s:5} {line['seconds']:5.1f} s  {line['message'][:150] if not line['named'] else ''}",
            flush=True,
        )
        append(file, line)
    return out


def table(lines: Sequence[dict[str, Any]]) -> None:
    """Counts, a row per kind of error."""
    print(f"\n{describe()}\n")
    print("| wrong | cases | noticed | named, within 5 % | alone | recovered when free | seconds, median |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for kind in KINDS:
        mine = [line for line in lines if line["kind"] == kind]
        if mine:
            alone = sum(line["named"] and line["alone"] for line in mine)
            noticed, named, recovered = (sum(line[what] for line in mine) for what in ("noticed", "named", "recovered"))
            counts = f"{noticed} | {named} | {alone} | {recovered}"
            print(f"| {kind} | {len(mine)} | {counts} | {np.median([line['seconds'] for line in mine]):.1f} |")


def main(fast: bool = False) -> list[dict[str, Any]]:
    """The whole study: CASES of each kind; fast: one, of which little is searched."""
    lines = study("lag", 1, 1, known=True) if fast else [line for kind in KINDS for line in study(kind, 1, CASES)]
    table(lines)
    return lines


if __name__ == "__main__":
    started(main, table, kind_and_cases(study))
