"""Search where parameters differ from group to group of logs: every group alone first, then all of them together.

A start that fits the mean of two materials fits neither; each group finds its own answer, those are pooled by the
information they hold on what is shared, and the joint problem starts from the motions found.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.base.progress import Progress
from identify.estimation.attempt import Attempt, Clock
from identify.estimation.covariance import information
from identify.estimation.goodness_of_fit import pass_gate
from identify.estimation.search import search
from identify.estimation.starts import Sources
from identify.estimation.strategies import Strategy, run_strategy
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.passes import solve_in_passes
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

LEAST = 1e-12  # of the largest information: what a group says less of is taken from the others


def search_grouped(
    prepared: list[Prepared],
    unknowns: Unknowns,
    *,
    sources: Sources = "data",
    seed: int = 0,
    clock: Clock | None = None,
    progress: Progress | None = None,
) -> tuple[Attempt | None, dict[int, str]]:
    """As `search`, for any scene: logs that share all their parameters are searched together first."""
    parts = _parts(prepared, unknowns)
    if len(parts) == 1:
        return search(prepared, unknowns, sources=sources, seed=seed, clock=clock, progress=progress)
    alone = replace(unknowns, per=())
    found: list[Attempt] = []
    left_out: dict[int, str] = {}
    for part in parts:
        logs = [prepared[i] for i in part]
        attempt, out = search(logs, alone, sources=sources, seed=seed, clock=clock, progress=progress)
        left_out |= {part[i]: why for i, why in out.items()}
        if attempt is None or attempt.gate.status is not Status.CONVERGED:
            # A group too poor to stand alone may still do with the others.
            return search(prepared, unknowns, sources=sources, seed=seed, clock=clock, progress=progress)
        found.append(replace(attempt, logs=tuple(part[i] for i in attempt.logs)))
    timer = clock or Clock()
    together = run_strategy(Strategy.GROUP_BY_GROUP, lambda: _together(found, unknowns, timer))
    if together is None:
        return search(prepared, unknowns, sources=sources, seed=seed, clock=clock, progress=progress)
    return together, left_out


def _parts(prepared: list[Prepared], unknowns: Unknowns) -> list[list[int]]:
    """Indices of the logs that share every parameter, part by part."""
    per = np.flatnonzero(unknowns.grouped).tolist()
    parts: dict[tuple[str, ...], list[int]] = {}
    for number, log in enumerate(prepared):
        key = tuple(log.data.groups[i] or f"log {number}" for i in per)
        parts.setdefault(key, []).append(number)
    return list(parts.values())


def _together(attempts: list[Attempt], unknowns: Unknowns, clock: Clock) -> Attempt:
    """All groups in one problem, from the motions found."""
    since = time.perf_counter()
    numbers: list[int] = []
    logs: list[Prepared] = []
    trajectories: list[ShootingTrajectory] = []
    thetas: list[Array] = []
    for attempt, theta in zip(attempts, _pooled(attempts, unknowns), strict=True):
        for number, log, trajectory in zip(attempt.logs, attempt.prepared, attempt.solved.trajectories, strict=True):
            mine = trajectory.theta(theta)
            numbers.append(number)
            logs.append(log)
            trajectories.append(replace(trajectory, own=np.where(unknowns.own, mine, np.nan)))
            thetas.append(mine)
    order = np.argsort(numbers).tolist()
    numbers, logs, trajectories = (
        [numbers[i] for i in order],
        [logs[i] for i in order],
        [trajectories[i] for i in order],
    )
    start = thetas[order[0]]
    trajectories[0] = replace(trajectories[0], own=np.empty(0))
    solved = solve_in_passes(
        [log.data for log in logs], trajectories, replace(unknowns, start=start).with_weak_priors()
    )
    clock.add("solve", since)
    gate = pass_gate(solved, [log.name for log in logs], [log.noise_estimated for log in logs])
    return Attempt(tuple(numbers), tuple(logs), solved, gate)


def _pooled(attempts: list[Attempt], unknowns: Unknowns) -> list[Array]:
    """Theta (n_p,) of each group, with one value of what is shared: least squares with each group's information."""
    free = np.flatnonzero(unknowns.free)
    shared = ~unknowns.own[free]
    total, pull = np.zeros((int(shared.sum()),) * 2), np.zeros(int(shared.sum()))
    for attempt in attempts:
        solved = attempt.solved
        at_answer = replace(unknowns, start=solved.theta, per=())
        made = solved.problem.with_all_parameters(at_answer, solved.solution.z)
        matrix = information(*made).total[np.ix_(free, free)]
        if not np.all(np.isfinite(matrix)):
            continue
        across, own = matrix[np.ix_(shared, ~shared)], matrix[np.ix_(~shared, ~shared)]
        left = matrix[np.ix_(shared, shared)] - across @ np.linalg.pinv(own) @ across.T
        total += left
        pull += left @ solved.theta[free][shared]
    mean = np.linalg.lstsq(total, pull, rcond=LEAST)[0]
    out = []
    for attempt in attempts:
        theta = attempt.solved.theta.copy()
        theta[free[shared]] = np.clip(mean, unknowns.lower[free[shared]], unknowns.upper[free[shared]])
        out.append(theta)
    return out
