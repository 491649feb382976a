"""Other valleys: where data do not tell a parameter, motion that was placed for one value may not suit another.

A profile walks with the course of the motion as it stands (which phases follow each other, in the way to sliding above
all). A motion placed anew where the data hardly object may take another course, and describe them better. So may one
of the other sign of delta_mu_k: few slips are nearly as well described by friction that falls with the sliding speed as
by friction that rises, and no walk leads across.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from identify.attempt import Attempt, Clock, place_on, solve_placed, usable
from identify.model import SPEED
from identify.outcome import Status
from identify.uncertainty import LEVEL
from identify.unknowns import Unknowns

Array = NDArray[np.float64]

CLEAR = float(chi2.ppf(LEVEL, 1))
"""By which chi^2 must fall for another course to count."""
FULL = 10.0  # times the highest sliding speed: a of a start whose friction changes at once
SHARE = 1 / 3  # of the drop of friction that is this change


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


def other_sign(attempt: Attempt, unknowns: Unknowns) -> Attempt | None:
    """Return the better answer whose friction changes with the sliding speed the other way; None if there is none."""
    start = _mirrored(attempt, unknowns)
    logs = list(attempt.prepared)
    placed = [] if start is None else place_on(logs, usable(logs), start)
    if start is None or len(placed) < len(logs):
        return None
    tried = solve_placed(logs, placed, start, Clock())
    better = tried.solved.solution.cost < attempt.solved.solution.cost - CLEAR / 2
    return replace(tried, logs=attempt.logs) if better and tried.gate.status is Status.CONVERGED else None


def _mirrored(attempt: Attempt, unknowns: Unknowns) -> Unknowns | None:
    """A start with the friction coefficient that the fastest slip of the answer has, and with it about its motion, but
    with a change of the other sign that is over at once; None where not all of this is searched."""
    names, theta = unknowns.names, attempt.solved.theta.copy()
    asked = [names.index(name) for name in ("mu_s", "mu_k0", "delta_mu_k", "a") if name in names]
    if len(asked) < 4 or not np.all(unknowns.free[asked]) or np.any(unknowns.own[asked]):
        return None
    mu_s, mu_k0, delta_mu_k, a = asked
    fastest = max((float(np.nanmax(g.slip[..., SPEED], initial=0.0)) for g in attempt.solved.guesses), default=0.0)
    if not fastest > 0.0:
        return None
    level = theta[mu_k0] - theta[delta_mu_k] * float(np.expm1(-fastest * np.exp(theta[a])))
    change = -float(np.copysign(SHARE * abs(theta[mu_s] - level), theta[delta_mu_k]))
    theta[[mu_k0, delta_mu_k, a]] = level - change, change, np.log(FULL / fastest)
    return replace(unknowns, start=np.clip(theta, unknowns.lower, unknowns.upper))
