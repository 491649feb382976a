"""Roots of many monotone equations at once: Newton's method, kept inside a shrinking bracket."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
EPSILON = float(np.finfo(float).eps)


def rising_root(equation: Callable[[Array], tuple[Array, Array]], low: Array, high: Array) -> Array:
    """Where each of n functions crosses zero from below, to the last digits the function has.

    Args:
        equation: (x (n,)) -> (value (n,), slope (n,)).
        low, high: shape (n,), with value(low) <= 0 <= value(high).

    A Newton step that leaves the bracket, or that does not halve the one before last (a double
    root at the end of the bracket), is replaced by halving the bracket.
    """
    low, high = low.copy(), high.copy()
    x = 0.5 * (low + high)
    before_last = last = high - low
    with np.errstate(all="ignore"):
        for _ in range(200):
            value, slope = equation(x)
            low, high = np.where(value <= 0, x, low), np.where(value > 0, x, high)
            newton = x - value / slope
            good = (newton >= low) & (newton <= high) & (np.abs(newton - x) <= 0.5 * before_last)
            new = np.where(good, newton, 0.5 * (low + high))
            before_last, last = last, np.abs(new - x)
            x = new
            if np.all((last <= EPSILON * np.abs(x)) | (high - low <= EPSILON * np.abs(high))):
                break
    return x
