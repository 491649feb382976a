"""Whether a log without a slip ends while its first stick still loads: it was stopped too soon."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from identify.logs.local_fits import line_slope, slope_error
from identify.logs.segment import STICK, Segmentation

Array = NDArray[np.float64]

END = 0.1  # share of the samples at the end whose slope is asked for
FEWEST = 8  # of these samples, at least
AS_STEEP = 0.5  # of the slope of a stick: near its first slip a contact creeps already, and a soft skin takes its share
SURE = 3.0  # standard errors by which the slope at the end is more than that

ENDS_LOADING = "the log ends while the first stick still loads"
REMEDY = "record longer, or faster"


def still_loading(time: Array, force: Array, found: Segmentation, expected_slope: float | None) -> bool:
    """Whether the force still rises at the end as in a stick, in a log in which no slip was seen.

    Args:
        time, force: (n,) [s], [N], sliding positive, NaN where nothing counts.
        expected_slope: stiffness times drive speed [N/s]; None where not known: the first rise of the log counts.
    """
    if found.count or found.begins_in_slip or not found.phase.size or found.phase[-1] != STICK:
        return False
    slope = expected_slope or found.loading_slope
    good = np.isfinite(force) & ~found.spikes
    last = max(round(END * np.count_nonzero(good)), FEWEST)
    t, f = time[good][-last:], force[good][-last:]
    if slope is None or t.size < FEWEST:
        return False
    return line_slope(t, f, found.noise) > AS_STEEP * slope + SURE * slope_error(t, found.noise)
