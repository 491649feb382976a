"""The ends of a ridge: where data do not tell a parameter, motion that was placed for one value may not suit another.

A profile walks with the course of the motion as it stands (which phases follow each other, in the way to sliding above
all). A motion placed anew where the data hardly object may take another course, and describe them better.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from identify.attempt import Attempt, Clock, place_on, solve_placed, usable
from identify.outcome import Status
from identify.uncertainty import LEVEL
from identify.unknowns import Unknowns

Array = NDArray[np.float64]

CLEAR = float(chi2.ppf(LEVEL, 1))
"""By which chi^2 must fall for another course to count."""


def better_course(attempt: Attempt, unknowns: Unknowns, likely: Array) -> Attempt | None:
    """Return the better answer to which a motion placed anew at one of the ends of the ridge leads; None if none does.

    likely: (m, f) points that the data hardly object to, from the answer.
    """
    free = np.flatnonzero(unknowns.free)
    if likely.size == 0:
        return None
    widest = int(np.argmax(np.ptp(likely, axis=0) / unknowns.spread[free]))
    best: Attempt | None = None
    for end in {int(np.argmin(likely[:, widest])), int(np.argmax(likely[:, widest]))}:
        theta = attempt.solved.theta.copy()
        theta[free] += likely[end]
        there = replace(unknowns, start=theta)
        logs = list(attempt.prepared)
        placed = place_on(logs, usable(logs), there)
        if len(placed) < len(logs) or [g.course for *_, g in placed] == [g.course for g in attempt.solved.guesses]:
            continue
        tried = solve_placed(logs, placed, there, Clock())
        if tried.gate.status is not Status.CONVERGED:
            continue
        limit = attempt.solved.solution.cost - CLEAR / 2 if best is None else best.solved.solution.cost
        if tried.solved.solution.cost < limit:
            best = replace(tried, logs=attempt.logs)
    return best
