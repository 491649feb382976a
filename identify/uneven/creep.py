"""The creep time of an uneven record: mostly a bound, from the profile of the likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.uneven.estimator import Maximum, Objective
from identify.uneven.events import Sticks
from identify.uneven.slip_functions import PARAMETERS

Array = NDArray[np.float64]

REACH = 3.0  # logarithm of creep time over typical rest, or its inverse, beyond which no creep time is looked for
STRIDE = 0.75  # of the logarithm between places of the profile
STEPS = 6  # Gauss-Newton steps in the other parameters, at each of them, until they gain less than GAIN
GAIN = 0.03
FALL = 3.84  # of twice the log likelihood, at 95 %
PLACE = PARAMETERS.index("t_cr")


@dataclass(frozen=True)
class CreepTime:
    """Ends of the 95 % interval of the creep time [s]; None where the record does not bound it on that side. Where one
    is None the other is a one-sided bound."""

    lower: float | None
    upper: float | None


def creep_interval(records: Sequence[Sticks], maximum: Maximum) -> CreepTime:
    """The interval from the profile over creep times from a twentieth to twenty times the usual rest."""
    objective = Objective(records, maximum.start, maximum.nodes)
    typical = float(np.log(records[0].usual_rest))
    below, above = (_walked(objective, maximum, typical, side) for side in (-1.0, 1.0))
    best = max(max(profile) for _, profile in (below, above))
    ends = [_end(places, 2.0 * (best - np.array(profile))) for places, profile in (below, above)]
    # Fine roughness, which does not age, makes the profile too narrow: its ends held in 36 of 42 simulated records,
    # those of the covariance, which the scores' own scatter widens, in all. The farther end counts.
    reach = maximum.quantile * float(np.sqrt(maximum.covariance[PLACE, PLACE]))
    own = (maximum.theta[PLACE] - reach, maximum.theta[PLACE] + reach)
    farther = (
        None if end is None else pick(end, other) for end, other, pick in zip(ends, own, (min, max), strict=True)
    )
    bounds = (end if end is not None and abs(end - typical) < REACH + STRIDE else None for end in farther)
    return CreepTime(*(None if end is None else float(np.exp(end)) for end in bounds))


def _walked(objective: Objective, maximum: Maximum, typical: float, side: float) -> tuple[list[float], list[float]]:
    """Places (logarithms of the creep time) from the maximum to one side, and the log likelihood, without the prior,
    that is greatest in all other parameters there; until it has fallen for good, or the reach is walked through."""
    theta, places, profile = maximum.theta, [float(maximum.theta[PLACE])], [maximum.log_likelihood]
    while (
        not time_is_up() and 2.0 * (max(profile) - profile[-1]) < 2.0 * FALL and side * (places[-1] - typical) < REACH
    ):
        theta = theta.copy()
        theta[PLACE] += side * STRIDE
        theta, value = _profiled(objective, theta)
        places.append(float(theta[PLACE]))
        profile.append(value)
    return places, profile


def _profiled(objective: Objective, theta: Array) -> tuple[Array, float]:
    """Parameters of the greatest posterior at a creep time, and the log likelihood there."""
    others = np.array([i for i in range(theta.size) if i != PLACE])
    best, value, step = theta, -np.inf, np.zeros(others.size)
    for _ in range(STEPS):
        posterior, gradient, scores = objective.slope(theta)
        if posterior > value:
            best, value = theta, posterior
            information = scores.T @ scores + objective.tightness
            step = np.linalg.solve(information[np.ix_(others, others)], gradient[others])
            if 0.5 * float(step @ gradient[others]) < GAIN:
                break
        else:
            step = 0.3 * step
        theta = best.copy()
        theta[others] += step * min(1.0, 0.5 / float(np.max(np.abs(step)) + 1e-12))
    return best, value - objective.prior(best)[0]


def _end(places: list[float], rise: Array) -> float | None:
    """Where the rise passes FALL last, interpolated; None where it does not."""
    above = np.flatnonzero(rise > FALL)
    inside = np.flatnonzero(rise <= FALL)
    if above.size == 0 or inside.size == 0 or rise[-1] <= FALL:
        return None
    i = int(inside[-1])
    share = (FALL - rise[i]) / (rise[i + 1] - rise[i])
    return places[i] + float(share) * (places[i + 1] - places[i])
