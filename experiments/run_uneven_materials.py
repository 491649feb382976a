"""Three materials, eight volunteers, uneven friction: the order by strength, and false differences, after pooling.

Whole fits of simulated records (uneven_records.py, the stiff rig) at each of three strengths tell by how much a fit is
off and what it says of that. A study draws people and gives each volunteer on each material the error and the stated
deviation of one of the fits of that strength; 200 studies of 24 fits each would be the same fits again and again.

    python experiments/run_uneven_materials.py FIRST LAST FILE     # fits of these seeds, at each strength
    python experiments/run_uneven_materials.py table FILE...       # what the studies made of them come to
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments.in_parts import append, by_processor_time, cases, read, started
from experiments.run_uneven_study import scene_of, truth_of
from experiments.uneven_records import STIFF, simulated
from identify import fit
from identify.studies.mixed import Setting
from identify.studies.pooled import DIFFERENT, Pooled, pool
from identify.uneven.answer import UnevenEstimator

STRENGTHS = (0.030, 0.045, 0.060)
CYCLES, STUDIES, VOLUNTEERS = 40, 200, 8
PEOPLE, CROSSED = 0.20, 0.15  # sd of the logarithm: between people, and of a person on one material
STORED = Path(__file__).parent / "results" / "uneven_materials.jsonl"


def fitted(seed: int) -> list[dict[str, Any]]:
    """A fit at each strength: error of its logarithm at the typical rest, and the stated deviation; None where it tells
    no strength."""
    lines = []
    for strength in STRENGTHS:
        pair, began = replace(STIFF, strength=strength), time.process_time()
        (track,) = simulated(pair, CYCLES, [seed])
        result = fit(scene_of(pair), [track.record], estimator=UnevenEstimator()).result
        told = result["parameters"]["strength"] if result["status"] == "converged" else {"standard_error": None}
        line = {"seed": seed, "strength": strength, "status": result["status"], "error": None, "deviation": None}
        if told["standard_error"] is not None:
            truth = truth_of(pair, float(np.nanmedian(result["uneven_cycles"][0]["rest_s"])))[0]
            line["error"] = float(np.log(told["value"]) - truth)
            line["deviation"] = told["standard_error"] / told["value"]
        lines.append({**line, "seconds": time.process_time() - began})
    return lines


def fits(first: int, last: int, file: Path | None = None) -> list[dict[str, Any]]:
    """The fits of seeds first to last, line by line."""
    by_processor_time()
    out = []
    for seed in range(first, last + 1):
        for line in fitted(seed):
            append(file, line)
            out.append(line)
            print(seed, line["strength"], line["status"], line["error"], line["deviation"], flush=True)
    return out


def study(materials: Sequence[float], by_strength: Mapping[float, np.ndarray], random: np.random.Generator) -> Pooled:
    """The pooled strengths of one study; every volunteer tries every material once."""
    people = PEOPLE * random.standard_normal(VOLUNTEERS)
    found, variances, groups, subjects = [], [], [], []
    for number, strength in enumerate(materials):
        errors, deviations = random.choice(by_strength[strength], VOLUNTEERS).T
        own = np.log(strength) + people + CROSSED * random.standard_normal(VOLUNTEERS)
        found.append(own + errors)
        variances.append(deviations**2)
        groups += [f"M{number + 1}"] * VOLUNTEERS
        subjects += [f"V{volunteer + 1}" for volunteer in range(VOLUNTEERS)]
    return pool(np.concatenate(found), np.concatenate(variances), Setting(tuple(groups), tuple(subjects)))


def table(lines: Sequence[Mapping[str, Any]], studies: int = STUDIES) -> tuple[int, int, int]:
    """Studies in the right order, studies that claim a difference where there is none, and studies of each kind."""
    by_strength = {}
    for strength in STRENGTHS:
        mine = [line for line in lines if line["strength"] == strength]
        told = np.array([(line["error"], line["deviation"]) for line in mine if line["deviation"] is not None])
        by_strength[strength] = told
        covered = float(np.mean(np.abs(told[:, 0]) < 1.96 * told[:, 1]))
        print(
            f"strength {strength}: {len(told)} of {len(mine)} fits tell it; bias {told[:, 0].mean():+.3f}, scatter "
            f"{told[:, 0].std():.3f}, stated {np.median(told[:, 1]):.3f}, covered {covered:.2f}"
        )
    random = np.random.default_rng(1)
    right = false = 0
    for _ in range(studies):
        means = [m.value for m in sorted(study(STRENGTHS, by_strength, random).means, key=lambda m: m.group)]
        right += means == sorted(means)
        same = study([STRENGTHS[1]] * 3, by_strength, random)
        false += any(d.verdict == DIFFERENT for d in same.differences)
    print(f"order by strength right in {right} of {studies} studies; a false difference in {false} of {studies}")
    return right, false, studies


def main(fast: bool = False) -> tuple[int, int, int]:
    """Fits of thirty seeds, and the studies made of them; fast: studies made of the fits that are stored."""
    return table(read([STORED]), 8) if fast else table(fits(0, 29))


if __name__ == "__main__":
    started(main, lambda lines: table(lines), cases(fits))
