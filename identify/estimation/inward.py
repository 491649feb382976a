"""An answer that slid along what the data do not tell, to where the model admits no more, is taken back inside.

A bound that the scene gives is the user's word, and an answer at it is told. The model's own bounds only keep numbers
in range: an answer at one of them, which the data like no better than one inside, says nothing but that they do not
tell.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.base.outcome import Status
from identify.base.quantiles import LEVEL, chi_square
from identify.estimation.attempt import SLOWLY, Attempt, released
from identify.estimation.objection import Remembering
from identify.logs.unknowns import Unknowns

Array = NDArray[np.float64]

AT_BOUND = 1e-6  # of the spread: a parameter that close to its bound sits on it


def at_own_bounds(unknowns: Unknowns, theta: Array) -> NDArray[np.bool_]:
    """Which parameters (n_p,) sit at a bound of the model that is none of the scene."""
    near = AT_BOUND * unknowns.spread
    low = (np.abs(theta - unknowns.lower) < near) & ~unknowns.walls[0]
    high = (np.abs(theta - unknowns.upper) < near) & ~unknowns.walls[1]
    return np.asarray(unknowns.free & (low | high))


def taken_inside(attempt: Attempt, unknowns: Unknowns, noise: Remembering) -> Attempt | None:
    """Return the answer inside the model's bounds that the data like nearly as well, held as loosely as it can be; None
    where the answer is inside already, or the data want it where it is.

    Args:
        noise: of all logs: with a memory it objects less.
    """
    theta = attempt.solved.theta
    outside = at_own_bounds(unknowns, theta)
    if not np.any(outside):
        return None
    limit = chi_square(LEVEL, int(np.sum(unknowns.free)))
    about = replace(unknowns, start=np.where(outside, unknowns.start, theta))
    best: Attempt | None = None
    for _, tried in released(attempt, about, SLOWLY):
        if tried.gate.status is not Status.CONVERGED or np.any(at_own_bounds(unknowns, tried.solved.theta)):
            break
        loss = 2.0 * (tried.solved.solution.cost - attempt.solved.solution.cost)
        best = tried if noise.objection(attempt.solved.fitted, tried.solved.fitted, loss) < limit else best
    return best
