"""A covariance that holds what a curved likelihood allows: widened until every likely point lies within it.

Where the likelihood is no paraboloid, the covariance of its curvature at the answer leaves out points that the data
find as likely. Profiles walk to such points; the covariance is widened along the way to each, and no further.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

ENOUGH = 1.5  # times the limit that a point's squared distance may have
ROUNDS = 200
ROUNDING = 1e-9
FARTHEST = 20.0  # a logarithm that is farther off than that is open


def widened(covariance: Array, away: Array, limits: Array) -> Array:
    """The covariance (f, f) widened until no squared distance exceeds ENOUGH times its limit.

    Args:
        away: (m, f) likely points, from the answer; limits: (m,) squared distances at which they should lie.
    """
    out = np.array(covariance, float)
    if away.size == 0 or not np.all(np.isfinite(out)):
        return out
    for _ in range(ROUNDS):
        try:
            distances = np.sum(away * np.linalg.solve(out, away.T).T, axis=1)
        except np.linalg.LinAlgError:
            return out
        far = int(np.argmax(distances / limits))
        enough = ENOUGH * limits[far]
        if not distances[far] > enough * (1.0 + ROUNDING):
            return out
        # Rank one: the point itself then lies where it may, exactly, and nothing becomes surer than it was.
        out = out + (1.0 / enough - 1.0 / distances[far]) * np.outer(away[far], away[far])
    return out


def widened_on_both_scales(covariance: Array, away: Array, limits: Array, values: Array, logarithmic: Bools) -> Array:
    """The covariance (f, f) of theta, widened until it holds the likely points both as theta has them and as values.

    Standard errors and correlations of a result are a covariance of values, by which distances are measured: a ridge on
    which the product of two parameters is told is a straight line in logarithms, and none in values.

    Args:
        away, limits: as `widened`; values: (f,) at the answer; logarithmic: (f,) which of theta are logarithms of them.
    """
    out = widened(covariance, away, limits)
    if away.size == 0:
        return out
    scale = np.where(logarithmic, values, 1.0)
    moved = np.where(logarithmic, values * np.expm1(np.minimum(away, FARTHEST)), away)
    return widened(out * np.outer(scale, scale), moved, limits) / np.outer(scale, scale)
