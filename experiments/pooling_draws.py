"""Studies drawn at the level of fit results: volunteers, materials, repeats, and a covariance for every fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.studies.pooled import Setting

Array = NDArray[np.float64]

# Of mu_s, mu_k0, delta_mu_k and the logarithms of a, D and t_cr.
CENTRE = np.array([0.62, 0.43, -0.13, np.log(300.0), np.log(37.4e-6), np.log(0.5)])
# Standard deviations between people, of a person on one material, between runs, and of a fit.
PEOPLE = np.array([0.06, 0.05, 0.02, 0.25, 0.20, 0.20])
CROSSED = np.array([0.03, 0.025, 0.01, 0.12, 0.10, 0.10])
RUNS = np.array([0.02, 0.015, 0.008, 0.10, 0.08, 0.08])
FITS = np.array([0.004, 0.004, 0.004, 0.06, 0.05, 0.04])
# What goes together: a person with high static friction has high kinetic friction, and so on.
TOGETHER = np.array(
    [
        [1.0, 0.8, -0.3, 0.0, 0.1, 0.0],
        [0.8, 1.0, -0.5, 0.1, 0.0, 0.0],
        [-0.3, -0.5, 1.0, 0.2, 0.0, 0.1],
        [0.0, 0.1, 0.2, 1.0, -0.2, 0.0],
        [0.1, 0.0, 0.0, -0.2, 1.0, 0.5],
        [0.0, 0.0, 0.1, 0.0, 0.5, 1.0],
    ]
)


@dataclass(frozen=True)
class Plan:
    """A study: materials, volunteers per material and runs of each; paired: the same volunteers for all materials;
    scale: of all scatter but that of the fits; crossed, fits: further factors on these two; lost: share of the runs
    that is missing; gap: difference between neighbouring materials in units of CROSSED."""

    name: str
    materials: int = 3
    volunteers: int = 8
    runs: int = 3
    paired: bool = True
    crossed: float = 1.0
    fits: float = 1.0
    lost: float = 0.0
    gap: float = 0.0


@dataclass(frozen=True)
class Study:
    """What a study found: y (n, 6), covariance of each fit (n, 6, 6), labels, and the true means (materials, 6)."""

    y: Array
    noise: Array
    setting: Setting
    truth: Array


def draw(plan: Plan, random: np.random.Generator) -> Study:
    """One study after the plan; every material keeps at least one run."""
    root = np.linalg.cholesky(TOGETHER)
    truth = CENTRE + plan.gap * np.arange(plan.materials)[:, None] * CROSSED
    rows, groups, subjects, noise = [], [], [], []
    people = random.standard_normal((plan.materials * plan.volunteers, 6)) @ root.T * PEOPLE
    for m in range(plan.materials):
        for v in range(plan.volunteers):
            who = v if plan.paired else m * plan.volunteers + v
            crossed = random.standard_normal(6) @ root.T * CROSSED * plan.crossed
            kept = [r for r in range(plan.runs) if random.random() >= plan.lost] or [0]
            for _ in kept:
                S = _covariance(plan, random)
                run = random.standard_normal(6) @ root.T * RUNS
                error = np.linalg.cholesky(S) @ random.standard_normal(6)
                rows.append(truth[m] + people[who] + crossed + run + error)
                groups.append(f"M{m + 1}")
                subjects.append(f"V{who + 1}")
                noise.append(S)
    return Study(np.array(rows), np.array(noise), Setting(tuple(groups), tuple(subjects)), truth)


def _covariance(plan: Plan, random: np.random.Generator) -> Array:
    """Covariance of one fit: errors differ by a factor of a few from fit to fit and hang together."""
    sd = FITS * plan.fits * np.exp(0.4 * random.standard_normal(6) + 0.4 * random.standard_normal())
    R = 0.5 * np.eye(6) + 0.5 * TOGETHER
    return np.asarray(R * np.outer(sd, sd))
