"""What the grid of a fit costs and what it is worth: parameters on ever finer grids, in standard errors."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.answers import answer
from experiments.study_problem import DEMO, RIG, scene_of, simulated_case
from identify.estimation.covariance import information
from identify.scene import Scene
from identify.shooting.grid import COARSE_GRID, Grid
from identify.shooting.placing import place
from identify.shooting.shooting import shooting_problem
from identify.shooting.solve import solve

Array = NDArray[np.float64]

ROUNDS = 3  # of assigning samples to steps anew: the event times stand still then


@dataclass(frozen=True)
class Fitted:
    """A fit on one grid: seconds of transcribing and solving, unknowns, theta of the free parameters (f,)."""

    grid: Grid
    seconds: float
    unknowns: int
    theta: Array


def fitted(steps: Sequence[int], logs: Sequence[int]) -> tuple[list[Fitted], list[str], Array]:
    """Fits of the study problem's logs on grids of so many steps per interval; the finest comes last.

    Returns:
        the fits, the names of the free parameters, their standard errors (f,) on the finest grid.
    """
    case = simulated_case(DEMO, 1)
    scene = scene_of(case)
    document = scene.as_document()
    scene = Scene.from_document(document | {"logs": [document["logs"][i] for i in logs]}, Path())
    records = [case.records[i] for i in logs]
    found, unknowns = answer(scene, records)
    data = [log.data for log in found.fitted_logs]
    base = unknowns.base(RIG)
    truth = unknowns.theta(np.array([(DEMO | RIG)[name] for name in unknowns.names]), base)
    out: list[Fitted] = []
    free = np.flatnonzero(unknowns.free)
    errors = np.empty(0)
    for count in steps:
        grid, theta = replace(COARSE_GRID, steps=count), truth
        p = [unknowns.values(truth, log.base) for log in data]
        placed = place(unknowns.model, data, p, [log.falls for log in found.fitted_logs], grid)
        trajectories = [trajectory for trajectory in placed if trajectory is not None]
        since = time.process_time()
        for _ in range(ROUNDS):
            start = replace(unknowns, start=theta)
            problem = shooting_problem(data, trajectories, start, grid)
            solution = solve(problem, tolerance=1e-9, mu_init=1e-6)
            theta = theta.copy()
            theta[problem.layout.free] = solution.x[: problem.layout.free.size]
            trajectories = [
                place_.read(g, solution.x) for place_, g in zip(problem.layout.places, trajectories, strict=True)
            ]
        out.append(Fitted(grid, time.process_time() - since, problem.layout.size, theta[free]))
        if count == steps[-1]:
            whole = problem.with_all_parameters(replace(unknowns, start=theta), solution.z)
            errors = np.sqrt(np.diag(information(*whole).covariance()))
    return out, [unknowns.names[i] for i in free], errors


def table(steps: Sequence[int], logs: Sequence[int]) -> list[str]:
    """Markdown: seconds, unknowns and the shift of every parameter against the finest grid, in standard errors."""
    fits, names, errors = fitted(steps, logs)
    finest = fits[-1]
    fastest = min(fit.seconds for fit in fits)
    rows = [
        "| RK4 steps per interval | time (fastest = 1) | unknowns | "
        + " | ".join(f"`{name}`" for name in names)
        + " |",
        "| ---" * (3 + len(names)) + " |",
    ]
    for fit in fits:
        shifts = np.abs(fit.theta - finest.theta) / errors
        cells = [f"{shift:.1e}" for shift in shifts] if fit is not finest else ["reference"] * len(names)
        rows.append(
            f"| {fit.grid.steps} | {fit.seconds / fastest:.2f} ({fit.seconds:.2f} s) | {fit.unknowns} | "
            + " | ".join(cells)
            + " |"
        )
    return rows
