"""The first time at which a positive function falls to zero: scanned as finely as its time scales ask, then refined.

Knows nothing of friction. What is smooth (ramps, decays that begin at time zero) is seen on a geometric grid; where
something oscillates, the stretches in which it can reach zero are scanned at a fraction of its shortest period.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from identify.errors import SimulationError

Array = NDArray[np.float64]
Function = Callable[[Array], Array]  # times (n,) [s] -> values (n,)

DECADES = 16  # the grid begins at this many decades below its end
PER_DECADE = 12
PER_PERIOD = 16
CHUNK = 1024  # times per call while scanning an oscillation
MAX_SCAN = 500_000  # times of one search: a bound, so that no scene runs for ever
ZOOM, ZOOMS = 17, 8  # a dip is looked at with so many times, each round in the neighbourhood of the lowest
DEEP = 0.5  # a dip is looked at where a parabola comes within this share of its rise to zero

_GRID = np.concatenate([[0.0], np.geomspace(10.0**-DECADES, 1.0, DECADES * PER_DECADE + 1)])


def first_zero(function: Function, limit: float, period: float = np.inf, swing: float = 0.0) -> float | None:
    """The first time in (0, limit] at which the function is zero; None if it stays positive.

    Args:
        function: positive at 0; a smooth part whose time scales begin at time zero, plus an oscillation.
        limit: [s], positive and finite.
        period: shortest period of the oscillation [s]; infinite without one.
        swing: bound of the size of the oscillation, in the unit of the function.

    Raises:
        SimulationError: more than MAX_SCAN times would have to be looked at.
    """
    if swing <= 0.0 or period >= 1e3 * limit:
        period = np.inf
    looked = 0
    times = _GRID * limit
    values = function(times)
    for t, v in _stretches(function, times, values, period, swing):
        looked += t.size
        if looked > MAX_SCAN:
            raise SimulationError(
                f"the drive vibrates more than {MAX_SCAN // PER_PERIOD} times near the onset of one slip "
                f"(shortest period {period:.3g} s): too many to look at; leave out that vibration or shorten the record"
            )
        found = _first_in(function, t, v)
        if found is not None:
            return found
    return None


def _stretches(
    function: Function, times: Array, values: Array, period: float, swing: float
) -> Iterator[tuple[Array, Array]]:
    """The times to look at and the values there, in order; neighbours overlap by two times."""
    if not np.isfinite(period):
        yield times, values
        return
    padded = np.concatenate([values[:1], values, values[-1:]])
    lowest = np.min(np.stack([padded[:-3], padded[1:-2], padded[2:-1], padded[3:]]), axis=0)
    step = period / PER_PERIOD
    for i in np.flatnonzero(lowest <= 2.0 * swing).tolist():
        start, end = times[i], times[i + 1]
        n = max(int(np.ceil((end - start) / step)), 1)
        for first in range(0, n, CHUNK - 3):
            # One step more at both sides: a dip between two chunks is seen by one of them.
            places = start + (end - start) / n * np.arange(first - 1, min(first + CHUNK - 3, n) + 2)
            places = np.clip(places, 0.0, times[-1])
            yield places, function(places)


def _first_in(function: Function, t: Array, v: Array) -> float | None:
    """The first zero on a grid, or in a dip between its times."""
    fallen = np.flatnonzero(v[1:] <= 0.0)
    last = int(fallen[0]) + 1 if fallen.size else t.size
    inner = v[1:-1]
    rise = v[:-2] + v[2:] - 2.0 * inner
    dips = np.flatnonzero((inner <= v[:-2]) & (inner <= v[2:]) & (rise > 0.0) & (inner <= DEEP * rise)) + 1
    for i in dips[dips < last].tolist():
        found = _in_dip(function, t[i - 1], t[i + 1])
        if found is not None:
            return found
    return _refined(function, t[last - 1], t[last]) if fallen.size else None


def _in_dip(function: Function, low: float, high: float) -> float | None:
    """The first zero around a minimum between low and high, None if the minimum is positive."""
    start = low
    for _ in range(ZOOMS):
        t = np.linspace(low, high, ZOOM)
        v = function(t)
        i = int(np.argmin(v))
        if v[i] <= 0.0:
            below = int(np.flatnonzero(v <= 0.0)[0])
            return _refined(function, t[below - 1] if below else start, t[below])
        low, high = t[max(i - 1, 0)], t[min(i + 1, ZOOM - 1)]
    return None


def _refined(function: Function, low: float, high: float) -> float:
    """The zero between a time where the function is positive and one where it is not."""

    def value(t: float) -> float:
        return float(function(np.array([t]))[0])

    if value(low) <= 0.0 or value(high) == 0.0:
        return low if value(low) <= 0.0 else high
    return float(brentq(value, low, high, xtol=1e-16 * max(high, 1e-300), rtol=1e-15))
