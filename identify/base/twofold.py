"""Sums and products of floats with their rounding errors (Dekker, Knuth): for differences of nearly equal numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SPLITTER = 2.0**27 + 1.0


def product(a: Array, b: Array) -> tuple[Array, Array]:
    """a b rounded, and what was rounded away."""
    top = a * b
    (a_high, a_low), (b_high, b_low) = _halves(a), _halves(b)
    return top, ((a_high * b_high - top) + a_high * b_low + a_low * b_high) + a_low * b_low


def _sum(a: Array, b: Array) -> tuple[Array, Array]:
    top = a + b
    part = top - a
    return top, (a - (top - part)) + (b - part)


def _halves(a: Array) -> tuple[Array, Array]:
    shifted = SPLITTER * a
    high = shifted - (shifted - a)
    return high, a - high


def one_plus_two_products(a: Array, b: Array) -> Array:
    """1 + 2 a b + b^2, to the last digits also where the terms nearly cancel (plain where squares overflow)."""
    square, lost = product(b, b)
    mixed, left = product(2.0 * a, b)
    first, small = _sum(square, mixed)
    top, smaller = _sum(first, np.ones_like(first))
    value = top + (small + smaller + lost + left)
    return np.where(np.isfinite(value), value, 1.0 + b * (2.0 * a + b))
