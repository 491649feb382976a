"""Roots: of many monotone equations at once, and the first time at which a positive function falls to zero."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from identify.base.errors import SimulationError

Array = NDArray[np.float64]

NEWTON_STEPS = 100  # for a root, at most


def rising_root(
    equation: Callable[..., tuple[Array, Array]], low: Array, high: Array, parameters: tuple[Array, ...] = ()
) -> Array:
    """Where each of n functions crosses zero from below, to the last digits the function has: Newton's method within a
    bracket.

    Args:
        equation: (x (n,), *parameters (n,) each) -> (value (n,), slope (n,)).
        low, high: shape (n,), with value(low) <= 0 <= value(high).
        parameters: by what the functions differ, (n,) each.
    """
    x = 0.5 * (low + high)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            value, slope = equation(x, *parameters)
            low, high = np.where(value <= 0.0, x, low), np.where(value >= 0.0, x, high)
            newton = x - value / slope
            after = np.where((low <= newton) & (newton <= high), newton, 0.5 * (low + high))
            if np.all((np.abs(after - x) <= np.spacing(np.abs(x))) | np.isnan(value)):
                break
            x = after
    return np.asarray(after if x.size else x)


# The first time at which a positive function falls to zero: scanned as finely as its time scales ask, then refined.
#
# Knows nothing of friction. What is smooth (ramps, decays that begin at time zero) is seen on a geometric grid; where
# something oscillates, only the stretches in which it can reach zero are scanned, at a fraction of its shortest period:
# those in which a smooth function that is nowhere above it has fallen to zero.

Function = Callable[[Array], Array]  # times (n,) [s] -> values (n,)

DECADES = 16  # the grid begins at this many decades below its end
PER_DECADE = 12
PER_PERIOD = 16
CHUNK = 256  # times per call while scanning an oscillation
MAX_SCAN = 500_000  # times of one search: a bound, so that no scene runs for ever
DEEP = 0.5  # a dip is looked at where a parabola comes within this share of its rise to zero

_GRID = np.concatenate([[0.0], np.geomspace(10.0**-DECADES, 1.0, DECADES * PER_DECADE + 1)])


def first_zero(function: Function, limit: float, period: float = np.inf, below: Function | None = None) -> float | None:
    """The first time in (0, limit] at which the function is zero; None if it stays positive.

    Args:
        function: positive at 0; a smooth part whose time scales begin at time zero, plus an oscillation.
        limit: [s], positive and finite.
        period: the shortest one of the oscillation [s]; infinite without.
        below: a smooth function that nowhere exceeds it.

    Raises:
        SimulationError: more than MAX_SCAN times would have to be looked at.
    """
    grid = _GRID * limit
    if period >= 1e3 * limit:
        return _first_in(function, grid, function(grid))
    # Before the bound falls to zero there is nothing to be found.
    low = 0.0 if below is None or below(grid[:1])[0] <= 0.0 else _first_in(below, grid, below(grid))
    if low is None:
        return None
    n = max(int(np.ceil((limit - low) * PER_PERIOD / period)), 2)  # a dip needs a time at either side
    step = (limit - low) / n
    for first in range(0, n, CHUNK):  # neighbours overlap: a dip between two chunks is in one of them
        times = np.clip(low + step * np.arange(first - 1, min(first + CHUNK, n) + 2), 0.0, limit)
        if first > MAX_SCAN:
            raise SimulationError(
                f"the drive vibrates more than {MAX_SCAN // PER_PERIOD} times near the onset of one slip "
                f"(shortest period {period:.3g} s): too many to look at; leave out that vibration or shorten "
                "the record"
            )
        zero = _first_in(function, times, function(times))
        if zero is not None:
            return zero
    return None


def _dips(v: Array) -> NDArray[np.intp]:
    """Places of minima that a parabola through their neighbours brings near zero."""
    inner = v[1:-1]
    rise = v[:-2] + v[2:] - 2.0 * inner
    return np.flatnonzero((inner <= v[:-2]) & (inner <= v[2:]) & (rise > 0.0) & (inner <= DEEP * rise)) + 1


def _first_in(function: Function, t: Array, v: Array) -> float | None:
    """The first zero on a grid, or in a dip between its times."""
    fallen = np.flatnonzero(v[1:] <= 0.0)
    last = int(fallen[0]) + 1 if fallen.size else t.size
    dips = _dips(v)
    for i in dips[dips < last].tolist():
        # From its start on: scipy's tolerance is relative to the time, which after an hour is many periods.
        low, span = float(t[i - 1]), float(t[i + 1] - t[i - 1])
        value = lambda part, low=low: float(function(np.array([low + part]))[0])  # noqa: E731
        lowest = scipy.optimize.minimize_scalar(value, bounds=(0.0, span), options={"xatol": 0.0})
        if lowest.fun <= 0.0:
            return _refined(function, low, low + float(lowest.x))
    return _refined(function, t[last - 1], t[last]) if fallen.size else None


def _refined(function: Function, low: float, high: float) -> float:
    """The zero between a time where the function is positive and one where it is not, to the last digits."""

    def value(t: float) -> float:
        return float(function(np.array([t]))[0])

    if value(low) <= 0.0 or value(high) == 0.0:
        return low if value(low) <= 0.0 else high
    return float(scipy.optimize.brentq(value, low, high, xtol=1e-16 * max(high, 1e-300), rtol=1e-15))
