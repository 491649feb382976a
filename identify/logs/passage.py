"""Where a tremor stands when something that rises slowly first reaches it.

A pull that loads a stick meets a grip that trembles in one of its dips, the first that is deep enough: at the onset of
a slip the grip is weaker than its mean, and half a period later, when the slip ends, stronger. A tremor that is not
followed has these means nevertheless, and a fit that takes it for noise about nothing answers with wrong friction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def first_passage(tremor: Array, step: float, rise: float, later: float, survived: float = 0.0) -> tuple[float, float]:
    """Return the mean of a tremor where a line that rises reaches it for the first time, and its mean `later` [s].

    The line may come from anywhere: every height at which it could start counts alike. Those that reach the tremor at a
    sample are as many as the tremor, less the rise, is lower there than ever before.

    Args:
        tremor: (n,) in units of the line, `step` [s] apart; rise: of the line [1/s]; survived [s]: a dip below the line
            that is over so soon does not count.
    """
    above = tremor - rise * step * np.arange(tremor.size)
    reached = np.append(0.0, -np.diff(np.minimum.accumulate(above)))
    after, soon = round(later / step), round(survived / step)
    if soon:
        reached[:-soon] = np.where(above[soon:] < above[:-soon], reached[:-soon], 0.0)
    whole = np.flatnonzero(reached[: max(tremor.size - after, 0)])
    if whole.size == 0:
        return 0.0, 0.0
    ends = np.average([tremor[whole], tremor[whole + after]], axis=1, weights=reached[whole])
    return float(ends[0]), float(ends[1])
