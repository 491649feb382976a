"""Search where parameters differ from group to group of logs: every group alone first, then all of them together.

A start that fits the mean of two materials fits neither; each group finds its own answer, those are pooled by the
information they hold on what is shared, and the joint problem starts from the motions found.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.base.stages import of_which, stage
from identify.estimation.attempt import Attempt, gated
from identify.estimation.covariance import information
from identify.estimation.search import SearchProblem, search
from identify.estimation.strategies import Strategy, run_strategy
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.passes import solve_in_passes
from identify.shooting.shooting_trajectory import ShootingTrajectory

Array = NDArray[np.float64]

LEAST = 1e-12  # of the largest information: what a group says less of is taken from the others


def search_grouped(problem: SearchProblem) -> tuple[Attempt | None, dict[int, str]]:
    """As `search`, for any scene: logs that share all their parameters are searched together first."""
    prepared, unknowns = problem.prepared, problem.unknowns
    parts = _parts(prepared, unknowns)
    if len(parts) == 1:
        return search(problem)
    alone = replace(unknowns, per=())
    found: list[Attempt] = []
    left_out: dict[int, str] = {}
    for part in parts:
        attempt, out = search(replace(problem, prepared=[prepared[i] for i in part], unknowns=alone))
        left_out |= {part[i]: why for i, why in out.items()}
        if attempt is None or attempt.gate.status is not Status.CONVERGED:
            # A group too poor to stand alone may still do with the others.
            return search(problem)
        found.append(replace(attempt, log_numbers=tuple(part[i] for i in attempt.log_numbers)))
    together = run_strategy(Strategy.GROUP_BY_GROUP, lambda: _together(found, unknowns))
    return search(problem) if together is None else (together, left_out)


def _parts(prepared: list[Prepared], unknowns: Unknowns) -> list[list[int]]:
    """Indices of the logs that share every parameter, part by part."""
    per = np.flatnonzero(unknowns.grouped).tolist()
    parts: dict[tuple[str, ...], list[int]] = {}
    for number, log in enumerate(prepared):
        key = tuple(log.data.groups[i] or f"log {number}" for i in per)
        parts.setdefault(key, []).append(number)
    return list(parts.values())


def _together(attempts: list[Attempt], unknowns: Unknowns) -> Attempt:
    """All groups in one problem, from the motions found."""
    numbers: list[int] = []
    logs: list[Prepared] = []
    trajectories: list[ShootingTrajectory] = []
    thetas: list[Array] = []
    for attempt, theta in zip(attempts, _pooled(attempts, unknowns), strict=True):
        for number, log, trajectory in zip(
            attempt.log_numbers, attempt.fitted_logs, attempt.solved.trajectories, strict=True
        ):
            mine = trajectory.theta(theta)
            numbers.append(number)
            logs.append(log)
            trajectories.append(replace(trajectory, own=np.where(unknowns.own, mine, np.nan)))
            thetas.append(mine)
    order = np.argsort(numbers).tolist()
    numbers, logs = [numbers[i] for i in order], [logs[i] for i in order]
    trajectories = [trajectories[i] for i in order]
    start = thetas[order[0]]
    trajectories[0] = replace(trajectories[0], own=np.empty(0))
    with stage("solve"):
        soft = replace(unknowns, start=start).with_weak_priors()
        solved = solve_in_passes([log.data for log in logs], trajectories, soft)
        of_which("build", solved.transcription_seconds, of="solve")
    return Attempt(tuple(numbers), tuple(logs), solved, gated(solved, logs))


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
