"""An answer is refused where one of its logs contradicts the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.estimation.agreement import contradiction, pulls_of_logs
from identify.estimation.allowed import Allowed, influence_at, slowness
from identify.estimation.attempt import Attempt
from identify.logs.unknowns import Unknowns
from identify.shooting.passes import solve_in_passes

Array = NDArray[np.float64]


def agreeing(attempt: Attempt, unknowns: Unknowns, base: Array, seen: Allowed) -> Attempt:
    """The answer, refused where one of its logs contradicts the others.

    Args:
        base: (n_p,) of the rig the values are given for; seen: what is allowed for at the answer.
    """
    solved, names = attempt.solved, [log.name for log in attempt.prepared]
    slow = slowness(attempt, seen.colours)
    try:
        found = pulls_of_logs(solved.problem, solved.solution.z, seen.reached or influence_at(solved), slow)
    except np.linalg.LinAlgError:  # directions that no log tells: their verdicts say so
        return attempt
    message = contradiction(
        found, unknowns, solved.theta, base, names, lambda log: _without_log(attempt, unknowns, log)
    )
    if not message:
        return attempt
    return replace(attempt, gate=replace(attempt.gate, status=Status.MODEL_MISFIT, message=message))


def _without_log(attempt: Attempt, unknowns: Unknowns, log: int) -> Array | None:
    """The answer (n_p,) of all logs but one, from the common one; None where the solver does not settle, or logs have
    parameters of their own, which the first of them lends its place in theta."""
    if np.any(unknowns.own):
        return None
    rest = [i for i in range(len(attempt.logs)) if i != log]
    at_answer = replace(unknowns, start=attempt.solved.theta).softened()
    data, motion = [attempt.prepared[i].data for i in rest], [attempt.solved.guesses[i] for i in rest]
    solved = solve_in_passes(data, motion, at_answer)
    return solved.theta if solved.solution.success else None
