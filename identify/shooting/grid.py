"""The grid of a shooting problem: how many intervals the parts of a slip have, and how many steps an interval."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identify.logs.log_data import LogData
from identify.logs.unknowns import Unknowns
from identify.shooting.shooting_trajectory import ShootingTrajectory

STEPS = (4, 6, 8, 12)  # RK4 steps per interval of the fine passes
FASTEST = 0.5  # largest step times the rate |delta_mu_k| a F_n / m
SLACK = 0.5  # a linear decay is followed well with twice the step


@dataclass(frozen=True)
class Grid:
    """Shooting intervals and RK4 steps per interval in the two parts of a slip: while the bounded state
    falls (`slip`), and once it is at its bound (`worn`)."""

    slip: int
    worn: int
    steps: int


COARSE_GRID = Grid(slip=8, worn=8, steps=2)


def fine_grid(logs: list[LogData], trajectories: list[ShootingTrajectory], unknowns: Unknowns) -> Grid:
    """The grid of the fine passes: as many steps as the fastest rate of the worn slips asks for."""
    names = unknowns.names
    needed = 0.0
    for log, trajectory in zip(logs, trajectories, strict=True):
        p = dict(zip(names, unknowns.values(trajectory.theta(unknowns.start), log.base).tolist(), strict=True))
        rate = abs(p.get("delta_mu_k", 0.0)) * p.get("a", 0.0) * log.mean_normal_force / p["mass"]
        decays = np.array(unknowns.model.decays(np.array(list(p.values())))).ravel()
        rate = max([rate, *(SLACK * decays).tolist()])
        longest = np.nanmax(
            np.concatenate([trajectory.arrest - trajectory.wear, (trajectory.arrest - trajectory.onset) / 2, [0.0]])
        )
        needed = max(needed, rate * float(longest) / COARSE_GRID.worn / FASTEST)
    steps = next((s for s in STEPS if s >= needed), STEPS[-1])
    return replace(COARSE_GRID, steps=steps)
