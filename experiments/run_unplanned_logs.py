"""Logs that nobody planned: is what a fit of them claims true?

One or two logs of a wide pair of the recovery study, at a drive speed, a sampling rate, a normal force, a length and a
noise by lot: slips of two samples, slips that the noise hides, sticks longer than the log, a hundred slips or one. Most
such logs tell little; a fit that claims no more than they tell is right. Counted, with `fit` as the command runs it:
intervals of what is `identified` or `weak` that hold the truth, and what is identified, more than WRONG off and outside
its interval ("confidently wrong"). An error that is no sentence ends the study. At a rate [Hz] that is given,
usual pairs: two or three logs, whose drive speed follows from the samples of a cycle, 12 to 300 by lot; at 50 Hz a slip
has one to five.

    python experiments/run_unplanned_logs.py FIRST LAST FILE [RATE]
    python experiments/run_unplanned_logs.py table FILE...
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from data_io import LogError, Record
from experiments.in_parts import append, started
from experiments.judgement import FRICTION
from experiments.machine import describe
from experiments.study_problem import USUAL, WIDE, coefficients_only, random_case
from identify import Scene, fit
from identify.base import budget
from identify.base.errors import IdentifyError
from identify.effects import MAIN
from identify.model.model import assemble
from identify.simulation.simulate import run

CASES, SEED, FAST = 100, 90_000, 3
WRONG = 0.1
FALL = 5e-4  # m per newton of normal force: how far the drive moves in a cycle, roughly
FEWEST, MOST, LONGEST = 60, 20_000, 600.0  # samples, samples, s
SEEN = (12.0, 300.0)  # samples of a cycle at a rate that is given


def drawn(number: int, at: float | None = None) -> tuple[Scene, list[Record], dict[str, float]]:
    """The scene, its records and the true parameters of one case; at: sampling rate [Hz], None: by lot."""
    random = np.random.default_rng(SEED + number)
    case, _ = random_case(random, WIDE if at is None else USUAL)
    count, load = int(random.integers(1, 3)) + (at is not None), float(10 ** random.uniform(-0.5, 1.0))
    noise = load * 10 ** random.uniform(-3.0, -1.7)
    records, entries = [], []
    for log in range(1, count + 1):
        speed, rate = (float(10 ** random.uniform(*ends)) for ends in ((-5.3, -1.8), (1.3, 3.3)))
        if at is not None:
            rate, speed = at, FALL * load * at / float(np.exp(random.uniform(*np.log(SEEN))))
        cycles, share = random.uniform(3.0, 12.0), random.uniform(0.3, 1.0)
        duration = min(cycles * share * FALL * load / speed, MOST / rate, LONGEST)
        times = np.arange(max(round(duration * rate), FEWEST) + 1) / rate
        motion = run(assemble(MAIN), case.truth | case.rig, speed, load, float(times[-1]))
        force = motion.sample(times)["force"] + noise * random.standard_normal(times.size)
        records.append(Record(times, np.full(times.size, load), force))
        entries.append({"path": f"log_{log}.csv", "drive_speed": speed})
    document = {
        "effects": [*MAIN, "varying_normal_force"],
        "rig": dict(case.rig),
        "logs": entries,
    }
    return Scene.from_document(document, Path()), records, case.truth


def trial(number: int, known: bool = False, at: float | None = None) -> dict[str, Any]:
    """One case: what its fit says of each parameter, beside the truth; known: of the coefficients alone."""
    scene, records, truth = drawn(number, at)
    scene = coefficients_only(scene, truth) if known else scene
    line: dict[str, Any] = {
        "number": number,
        "rate": at,
        "samples": [len(r.time) for r in records],
        "truth": truth,
        "told": {},
    }
    began = time.process_time()
    try:
        result = fit(scene, records).result
    except (IdentifyError, LogError) as refused:
        line |= {"status": "refused", "message": str(refused)}
    else:
        line |= {"status": result["status"], "message": result["message"]}
        if result["status"] == "converged":
            line["told"] = {
                name: {key: result["parameters"][name][key] for key in ("value", "interval", "verdict")}
                for name in FRICTION
                if name in result["parameters"]
            }
    line["seconds"] = time.process_time() - began
    out = ", ".join(f"{name} {verdict}" for name, verdict in misses(line).items())
    print(f"{number:4d} {line['status']:17s} {line['seconds']:6.1f} s  {out}", flush=True)
    return line


def claims(line: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """What is identified or weak."""
    return {name: told for name, told in line["told"].items() if told["verdict"] in ("identified", "weak")}


def misses(line: dict[str, Any]) -> dict[str, str]:
    """The claims whose interval does not hold the truth, with their verdict, or "CONFIDENTLY WRONG"."""
    out = {}
    for name, told in claims(line).items():
        truth, (low, high) = line["truth"][name], told["interval"]
        if (low is None or low <= truth) and (high is None or truth <= high):
            continue
        scale = abs(line["truth"]["mu_s"] - line["truth"]["mu_k0"]) if name == "delta_mu_k" else abs(truth)
        far = told["verdict"] == "identified" and abs(told["value"] - truth) > WRONG * scale
        out[name] = "CONFIDENTLY WRONG" if far else told["verdict"]
    return out


def table(lines: Sequence[dict[str, Any]]) -> None:
    """Counts over all cases."""
    print(f"\n{describe()}\n")
    print("| parameter | claimed | interval holds the truth | confidently wrong |\n| --- | --- | --- | --- |")
    for name in (*FRICTION, "all"):
        mine = FRICTION if name == "all" else (name,)
        claimed = sum(one in claims(line) for line in lines for one in mine)
        missed = [(line["number"], miss) for line in lines for one, miss in misses(line).items() if one in mine]
        wrong = sorted({number for number, miss in missed if miss == "CONFIDENTLY WRONG"})
        print(f"| {name} | {claimed} | {claimed - len(missed)} | {len(wrong)} {wrong or ''} |")
    seconds = [line["seconds"] for line in lines]
    print(f"\n{len(lines)} cases: {dict(Counter(line['status'] for line in lines))}; ", end="")
    print(f"processor time {np.median(seconds):.0f} s, median, {max(seconds):.0f} s at most")


def study(
    first: int, last: int, file: Path | None = None, known: bool = False, at: float | None = None
) -> list[dict[str, Any]]:
    """Cases of these numbers; each goes to the file at once. The time limit of a fit counts processor time."""
    budget.time = SimpleNamespace(perf_counter=time.process_time)  # type: ignore[assignment]
    lines = []
    for number in range(first, last + 1):
        lines.append(trial(number, known, at))
        append(file, lines[-1])
    return lines


def main(fast: bool = False) -> list[dict[str, Any]]:
    """The whole study; fast: one case that is soon done, of which only the coefficients are searched."""
    lines = study(FAST, FAST, known=True) if fast else study(0, CASES - 1)
    table(lines)
    return lines


if __name__ == "__main__":
    started(
        main,
        table,
        lambda said: study(int(said[0]), int(said[1]), Path(said[2]), at=float(said[3]) if said[3:] else None),
    )
