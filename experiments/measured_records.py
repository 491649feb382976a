"""Measured stick-slip records, paper on paper, which are not part of the project: their scenes, sticks and halves.

Mass and stiffness are estimated within wide bounds by the plain fit, as the records' description advises; the estimator
of uneven records, which takes over where cycles differ, finds the mass, and takes the stiffness as stated.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from identify.effects import MAIN
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
FILES = ("k168_v42", "k168_v1100", "k1002_v42", "k1002_v4300")
TOGETHER = (("k168_v42", "k168_v1100"), ("k1002_v42", "k1002_v4300"))
COMPARED = [i for i, name in enumerate(PARAMETERS) if name != "t_cr"]


def scene_of(names: Sequence[str], folder: Path = RECORDS) -> Scene:
    """The scene of records of one spring; stiffness [N/m] and drive speed [um/s] stand in the file names."""
    stiffness = float(names[0].split("_")[0][1:])
    document = {
        "effects": [*MAIN, "varying_normal_force"],
        "rig": {"mass": MASS, "stiffness": stiffness, "zeta": 0.02},
        "parameters": {
            "mass": {"lower": 0.3 * MASS, "upper": 2.5 * MASS},
            "stiffness": {"lower": 0.6 * stiffness, "upper": 1.6 * stiffness},
        },
        "logs": [{"path": str(folder / f"{n}.csv"), "drive_speed": 1e-6 * float(n.split("_v")[1])} for n in names],
    }
    return Scene.from_document(document)


def sticks_in(name: str, folder: Path = RECORDS) -> Sticks:
    """The sticks and slips of one record."""
    scene, records = with_records(scene_of((name,), folder), None)
    return sticks_of(prepare(scene, scene.logs[0], records[0], from_scene(scene)))


def halves(sticks: Sticks) -> tuple[float, float]:
    """Chi-squared of the difference between the estimates of both halves in all but the creep time, and its
    probability."""
    middle = sticks.count // 2
    first, second = (maximise([sticks.part(rows)]) for rows in np.split(np.arange(sticks.count), [middle]))
    gap = (first.theta - second.theta)[COMPARED]
    spread = (first.covariance + second.covariance)[np.ix_(COMPARED, COMPARED)]
    statistic = float(gap @ np.linalg.solve(spread, gap))
    return statistic, float(chi2.sf(statistic, len(COMPARED)))
