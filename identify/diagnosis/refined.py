"""A value that no fit can search, a drive speed say, taken where the misfit is least: a parabola through three fits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from identify.diagnosis.fitted import Fitted
from identify.diagnosis.suspects import Suspect
from identify.scene import Scene

STEP = 0.01  # of the value: about how well sticks tell it
FARTHEST = 3.0  # of these steps that it is moved


def refined(suspect: Suspect, fitted: Fitted, fit: Callable[[Fitted, Scene], Fitted]) -> Fitted:
    """The fit with the value of a suspect where the misfit is least, near the one it was given; the fit as it is where
    that is nowhere better.

    Args:
        fit: a scene from the values of a fit of one like it.
    """
    nearby = suspect.nearby
    if nearby is None or not np.isfinite(fitted.excess):
        return fitted
    low, high = (fit(fitted, nearby(fitted.scene, 1.0 + step)) for step in (-STEP, STEP))
    bend = low.excess - 2.0 * fitted.excess + high.excess
    found = [fitted, low, high]
    if np.isfinite(bend) and bend > 0.0:
        steps = float(np.clip(0.5 * (low.excess - high.excess) / bend, -FARTHEST, FARTHEST))
        found.append(fit(fitted, nearby(fitted.scene, 1.0 + steps * STEP)))
    return min((each for each in found if each.logs == fitted.logs), key=lambda each: each.excess)
