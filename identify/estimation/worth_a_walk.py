"""Which parameters a profile has to walk along: what the curvature at one point says too little about."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import NORMAL
from identify.estimation.uncertainty import IDENTIFIED, Estimate, sizes
from identify.logs.unknowns import Unknowns
from identify.shooting.vibration import rhythmic

Array = NDArray[np.float64]

DOUBTFUL = 0.13  # standard error of a logarithm: an interval of a quarter each way
CURVED = 0.012  # standard error of a logarithm beyond which the ridge along it may bend
NEAR = 0.4  # of the longest side of a coefficient that is identified: a bent ridge may add what is missing


def doubtful(unknowns: Unknowns, covariance: Array, found: list[Estimate]) -> bool:
    """Whether some parameter is so uncertain that the curvature at one point says little about its interval."""
    beside = rhythmic(unknowns)
    wide = np.sqrt(np.diag(covariance)) > DOUBTFUL
    asked = {name for name, aside in zip(unknowns.names, beside, strict=True) if not aside}
    return bool(np.any(wide & (unknowns.logarithmic & ~beside)[unknowns.free])) or any(
        e.verdict == "not identifiable" and e.name in asked for e in found
    )


def ridge(unknowns: Unknowns, covariance: Array, theta: Array, base: Array) -> list[int]:
    """The parameters that are so uncertain that the others may follow each of them on a bent path; and with these the
    coefficients whose verdict may hang on what that path adds to their intervals."""
    free, sd = np.flatnonzero(unknowns.free), np.sqrt(np.diag(covariance))
    asked, logarithmic = ~rhythmic(unknowns)[free], unknowns.logarithmic[free]
    bent = asked & logarithmic & (sd > CURVED)
    side = NORMAL * sd / sizes(unknowns, unknowns.values(theta, base))[free]
    near = asked & ~logarithmic & (side > NEAR * IDENTIFIED)
    return free[bent | near].tolist() if np.any(bent) else []
