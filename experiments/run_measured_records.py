"""The whole chain on measured stick-slip records, paper on paper: what a fit says of each file, alone and per spring.

The records (README beside them) are not part of the project; without them the script says so and stops. Mass and
stiffness are estimated within wide bounds by the plain fit, as the records' description advises; the estimator of
uneven records, which takes over where cycles differ, finds the mass, and takes the stiffness as stated. Of every record
it answers, the halves are estimated by themselves and compared: chi-squared of the difference over its covariance.

    python experiments/run_measured_records.py [folder of the records]
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).parents[1]))

from identify.effects import MAIN as NAMES
from identify.identification import fit
from identify.logs.prepare import prepare
from identify.logs.scene_records import with_records
from identify.logs.unknowns import from_scene
from identify.scene import Scene
from identify.uneven.estimator import maximise
from identify.uneven.events import Sticks, sticks_of
from identify.uneven.slip_functions import PARAMETERS

Array = NDArray[np.float64]

RECORDS = Path(__file__).resolve().parents[2] / "shared" / "data" / "paper_on_paper"
MASS = 0.019  # [kg], from the ringing
FAST_LIMIT = 20.0  # [s]
FILES = {"k168_v42": 168.0, "k168_v1100": 168.0, "k1002_v42": 1002.0, "k1002_v4300": 1002.0}
TOGETHER = (("k168_v42", "k168_v1100"), ("k1002_v42", "k1002_v4300"))
COMPARED = [i for i, name in enumerate(PARAMETERS) if name != "t_cr"]


def scene_of(names: tuple[str, ...], folder: Path) -> Scene:
    """The scene of records of one spring; the drive speed [um/s] stands in the file name."""
    stiffness = FILES[names[0]]
    document = {
        "effects": [*NAMES, "varying_normal_force"],
        "rig": {"mass": MASS, "stiffness": stiffness, "zeta": 0.02},
        "parameters": {
            "mass": {"lower": 0.3 * MASS, "upper": 2.5 * MASS},
            "stiffness": {"lower": 0.6 * stiffness, "upper": 1.6 * stiffness},
        },
        "logs": [{"path": str(folder / f"{n}.csv"), "drive_speed": 1e-6 * float(n.split("_v")[1])} for n in names],
    }
    return Scene.from_document(document)


def sticks_in(name: str, folder: Path) -> Sticks:
    """The sticks and slips of one record."""
    scene, records = with_records(scene_of((name,), folder), None)
    return sticks_of(prepare(scene, scene.logs[0], records[0], from_scene(scene)))


def halves(sticks: Sticks) -> tuple[float, float, Array]:
    """Chi-squared of the difference between both halves in all but the creep time, its probability, and the z-score
    of every such parameter."""
    middle = sticks.count // 2
    first, second = (maximise([sticks.part(rows)]) for rows in np.split(np.arange(sticks.count), [middle]))
    gap = (first.theta - second.theta)[COMPARED]
    spread = (first.covariance + second.covariance)[np.ix_(COMPARED, COMPARED)]
    statistic = float(gap @ np.linalg.solve(spread, gap))
    return statistic, float(chi2.sf(statistic, len(COMPARED))), gap / np.sqrt(np.diag(spread))


def main(fast: bool = False, folder: Path = RECORDS) -> dict[tuple[str, ...], str]:
    """Status by file, and by pair of files of one spring; fast: one file only, in less time. Empty where the
    records are absent."""
    if not folder.is_dir():
        print(f"{folder.name}: no measured records here; give their folder as argument")
        return {}
    found = {}
    for names in [("k1002_v42",)] if fast else [*((n,) for n in FILES), *TOGETHER]:
        began = time.process_time()
        scene = scene_of(names, folder)
        result = fit(replace(scene, time_limit=FAST_LIMIT) if fast else scene).result
        seconds = time.process_time() - began
        found[names] = result["status"]
        print(f"{' + '.join(names)}: {result['status']} by the {result['estimator']} estimator ({seconds:.1f} s)")
        print(f"  {result['message']}")
        for name, entry in result["parameters"].items():
            if entry["verdict"] != "not identifiable":
                ends = [None if end is None else float(f"{end:.3g}") for end in entry["interval"]]
                value, error = entry["value"], entry["standard_error"]
                told = (
                    "" if value is None else f"{value:.4g} {entry['unit']}, sd of its logarithm {error / value:.3f}, "
                )
                print(f"  {name:18}{told}{ends} {entry['verdict']}")
        if not fast and len(names) == 1 and result["parameters"].get("strength", {}).get("value") is not None:
            sticks = sticks_in(names[0], folder)
            began = time.process_time()
            maximise([sticks])
            seconds = (time.process_time() - began) * 60.0 / sticks.count
            statistic, probability, z = halves(sticks)
            each = ", ".join(f"{PARAMETERS[i]} {value:+.1f}" for i, value in zip(COMPARED, z, strict=True))
            print(
                f"  estimate: {seconds:.1f} s per 60 cycles; halves: chi2 {statistic:.1f}, p {probability:.2f} ({each})"
            )
        print(flush=True)
    return found


if __name__ == "__main__":
    main(folder=Path(sys.argv[1]) if len(sys.argv) > 1 else RECORDS)
