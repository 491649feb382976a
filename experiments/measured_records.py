"""Measured stick-slip records, paper on paper, which are not part of the project: their scenes, sticks and halves.

Mass and stiffness are estimated within wide bounds by the plain fit, as the records' description advises; the estimator
of uneven records, which takes over where cycles differ, finds the mass, and takes the stiffness from the sticks.

    python experiments/measured_records.py

prints the mass and the strength of every record and of its halves, whatever mass and damping the scene states.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).parents[1]))

from identify.effects import MAIN
from identify.logs.prepare import prepare
from identify.logs.scene_records import with_records
from identify.logs.unknowns import from_scene
from identify.scene import Scene
from identify.uneven.estimator import Maximum, mass_of, maximise, pooled_mass
from identify.uneven.events import Sticks, sticks_of
from identify.uneven.slip_functions import THETA

Array = NDArray[np.float64]

RECORDS = Path(__file__).resolve().parents[2] / "shared" / "data" / "paper_on_paper"
MASS = 0.019  # [kg], from the ringing
FILES = ("k168_v42", "k168_v1100", "k1002_v42", "k1002_v4300")
TOGETHER = (("k168_v42", "k168_v1100"), ("k1002_v42", "k1002_v4300"))
COMPARED = [i for i, name in enumerate(THETA) if name != "t_cr"]


def part(sticks: Sticks, rows: NDArray[np.int64]) -> Sticks:
    """Some of the cycles, in the order given; the chain is broken where a predecessor is left out."""
    kept = {name: value[rows] for name, value in vars(sticks).items() if isinstance(value, np.ndarray)}
    return replace(sticks, **kept | {"follows": kept["follows"] & np.append(False, np.diff(rows) == 1)})


def scene_of(names: Sequence[str], folder: Path = RECORDS, mass: float = MASS, zeta: float = 0.02) -> Scene:
    """The scene of records of one spring; stiffness [N/m] and drive speed [um/s] stand in the file names."""
    stiffness = float(names[0].split("_")[0][1:])
    document = {
        "effects": [*MAIN, "varying_normal_force"],
        "rig": {"mass": mass, "stiffness": stiffness, "zeta": zeta},
        "parameters": {
            "mass": {"lower": 0.3 * mass, "upper": 2.5 * mass},
            "stiffness": {"lower": 0.6 * stiffness, "upper": 1.6 * stiffness},
        },
        "logs": [{"path": str(folder / f"{n}.csv"), "drive_speed": 1e-6 * float(n.split("_v")[1])} for n in names],
    }
    return Scene.from_document(document)


def sticks_in(name: str, folder: Path = RECORDS, mass: float = MASS, zeta: float = 0.02) -> Sticks:
    """The sticks and slips of one record, in a scene that states this mass and damping."""
    scene, records = with_records(scene_of((name,), folder, mass, zeta), None)
    return sticks_of(prepare(scene, scene.logs[0], records[0], from_scene(scene)))


def halves(sticks: Sticks) -> tuple[float, float]:
    """Chi-squared of the difference between the estimates of both halves in all but the creep time, and its
    probability."""
    middle = sticks.count // 2
    first, second = (maximise([part(sticks, rows)]) for rows in np.split(np.arange(sticks.count), [middle]))
    gap = (first.theta - second.theta)[COMPARED]
    spread = (first.covariance + second.covariance)[np.ix_(COMPARED, COMPARED)]
    statistic = float(gap @ np.linalg.solve(spread, gap))
    return statistic, float(chi2.sf(statistic, len(COMPARED)))


def told(sticks: Sticks, maximum: Maximum) -> str:
    """Mass, strength and weakening length of a record or a part of it."""
    if not maximum.converged:
        return "no maximum"
    found = mass_of(maximum, sticks.rig.error)
    strength = [np.exp(maximum.theta[0]), *np.exp(maximum.interval(np.eye(len(THETA))[0]))]
    length = 1e6 * np.exp(maximum.theta[0] - maximum.theta[1])
    return (
        f"{1e3 * found.value:5.1f} g ({1e3 * found.lower:.1f} to {1e3 * found.upper:.1f}), strength {strength[0]:.4f} "
        f"({strength[1]:.4f} to {strength[2]:.4f}), length {length:.1f} um"
    )


def main() -> None:
    """Print masses [g] and strengths with their 95 % intervals, and by how much masses of records differ."""
    for mass, zeta in ((0.010, 0.01), (0.020, 0.2), (0.030, 0.01), (0.030, 0.2)):
        print(f"the scene states {1e3 * mass:.0f} g and zeta {zeta:g}")
        records = [sticks_in(name, mass=mass, zeta=zeta) for name in FILES]
        maxima = [maximise([sticks]) for sticks in records]
        for name, sticks, maximum in zip(FILES, records, maxima, strict=True):
            print(f"  {name:12} whole {told(sticks, maximum)}")
            for rows in np.split(np.arange(sticks.count), [sticks.count // 2]):
                print(f"  {name:12} half  {told(sticks, maximise([part(sticks, rows)]))}", flush=True)
        whole = [(sticks, found) for sticks, found in zip(records, maxima, strict=True) if found.converged]
        together = pooled_mass([sticks for sticks, _ in whole], [found for _, found in whole])
        low, high, (chi_squared, freedom, chance) = together.lower, together.upper, together.scatter or (0.0, 0, 1.0)
        print(f"  one mass: {1e3 * together.value:.1f} g ({1e3 * low:.1f} to {1e3 * high:.1f}), "
              f"chi2 {chi_squared:.2f} for {freedom}, p {chance:.3f}")  # fmt: skip


if __name__ == "__main__":
    main()
