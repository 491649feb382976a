"""The step of the grid on which all values of a sensor lie, told from the values alone."""

from __future__ import annotations

from typing import Final

import numpy as np

from data_io.frozen import FloatArray
from data_io.thinned import thinned

_REPEATS: Final = 8
"""Values met before from which on a grid is believed: noise of many digits hardly repeats a value."""
_OFF_GRID: Final = 0.2
"""Share of a step by which a difference may miss its multiple: the number format rounds too."""
_ON_GRID: Final = 0.9
"""Share of the differences that are multiples of the step, at least."""
_NEAR: Final = 10
"""Steps up to which a difference tells the step better: over more of them its own rounding adds up."""


def grid_step(values: FloatArray) -> float:
    """Return the step of the grid on which the values (n,) lie; 0 where they show none.

    Many of them repeat, and their differences are multiples of the step within rounding. The difference of two
    neighbours alone is no step: in a short ramp it is what the ramp rises in one row.
    """
    few = thinned(values)
    levels = np.unique(few)
    if few.size - levels.size < _REPEATS:
        return 0.0
    steps = np.diff(levels)
    steps = steps[steps > 1e-6 * (levels[-1] - levels[0])]
    if not steps.size:
        return 0.0
    near = steps[steps < (_NEAR + 0.5) * steps.min()]
    step = float(np.sum(near) / np.sum(np.round(near / steps.min())))
    missed = np.abs(steps / step - np.round(steps / step))
    return step if np.mean(missed < _OFF_GRID) >= _ON_GRID else 0.0
