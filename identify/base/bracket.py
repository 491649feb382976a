"""Roots of many monotone equations at once: Newton's method, kept inside a shrinking bracket."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CROWD = 0.7  # share of functions still looked for, below which the others are left behind
EPSILON = float(np.finfo(float).eps)


def rising_root(
    equation: Callable[..., tuple[Array, Array]], low: Array, high: Array, parameters: tuple[Array, ...] = ()
) -> Array:
    """Where each of n functions crosses zero from below, to the last digits the function has.

    Args:
        equation: (x (m,), *parameters (m,) each) -> (value (m,), slope (m,)), for any m of the n functions.
        low, high: shape (n,), with value(low) <= 0 <= value(high).
        parameters: what tells the functions apart, (n,) each.

    A Newton step that leaves the bracket, or that does not halve the one before last (a double
    root at the end of the bracket), is replaced by halving the bracket.
    """
    out, places = np.empty_like(low), np.arange(low.size)
    x, low, high = 0.5 * (low + high), low.copy(), high.copy()
    before_last = last = high - low
    with np.errstate(all="ignore"):
        for _ in range(200):
            value, slope = equation(x, *parameters)
            below = value <= 0
            low, high = np.where(below, x, low), np.where(below, high, x)
            newton = x - value / slope
            good = (newton >= low) & (newton <= high) & (np.abs(newton - x) <= 0.5 * before_last)
            new = np.where(good, newton, 0.5 * (low + high))
            before_last, last = last, np.abs(new - x)
            x = new
            busy = (last > EPSILON * np.abs(x)) & (high - low > EPSILON * np.abs(high))
            count = np.count_nonzero(busy)
            if count == 0:
                break
            if count <= CROWD * busy.size:  # what is done is left behind
                out[places[~busy]] = x[~busy]
                places = places[busy]
                x, low, high, before_last, last = (q[busy] for q in (x, low, high, before_last, last))
                parameters = tuple(q[busy] for q in parameters)
    out[places] = x
    return out
