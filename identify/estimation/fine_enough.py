"""Steps of the integration so fine that their error is a small part of each standard error."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from identify.base.outcome import Status
from identify.estimation.attempt import Attempt, resolve
from identify.estimation.strategies import Strategy, attempted
from identify.estimation.uncertainty import Information, information
from identify.logs.unknowns import Unknowns
from identify.shooting.accuracy import Asked, discretisation_error


def fine_enough(attempt: Attempt, unknowns: Unknowns, asked: Asked) -> tuple[Attempt, Information, dict[str, float]]:
    """The answer with steps so fine that their error is a small part of each standard error, and that part by name."""
    level = asked.accuracy
    if attempt.gate.status is Status.CONVERGED and attempt.solved.grid.steps > level.most:
        attempt = resolve(attempt, replace(unknowns, start=attempt.solved.theta), most=level.most)
    known = information_at(attempt, unknowns)
    shares: dict[str, float] = {}
    for _ in range(1 + level.refinements):
        if attempt.gate.status is not Status.CONVERGED or not np.all(np.isfinite(known.total)):
            break
        error = discretisation_error(attempt.solved) / np.sqrt(np.diag(known.covariance()))
        free = np.flatnonzero(unknowns.free).tolist()
        shares = {unknowns.names[i]: float(np.nan_to_num(e)) for i, e in zip(free, error, strict=True)}
        if not shares or max(abs(e) for e in shares.values()) <= level.share:
            break
        finer = 2 * attempt.solved.grid.steps
        if finer > level.most:
            break
        again = attempted(Strategy.FINER_STEPS, partial(_finer, attempt, unknowns, finer), attempt)
        if again is None or again.gate.status is Status.SOLVER_FAILED:
            break  # no reason to give up the answer: what its steps cost is told
        attempt, known = again, information_at(again, unknowns)
    return attempt, known, shares


def _finer(attempt: Attempt, unknowns: Unknowns, steps: int) -> Attempt:
    return resolve(attempt, replace(unknowns, start=attempt.solved.theta), steps=steps)


def information_at(attempt: Attempt, unknowns: Unknowns) -> Information:
    """The information of the data on all parameters, those held fixed too, at the answer."""
    solved = attempt.solved
    at_answer = replace(unknowns, start=solved.theta)
    return information(*solved.problem.with_all_parameters(at_answer, solved.solution.z))
