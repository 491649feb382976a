"""What a load cell shows that averages: the mean of its force over the last moments, exact on smooth pieces."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
TURN = 2.0  # length of a piece in time constants, or radians: the rule is exact to rounding on it
GONE = 40.0  # time constants after which a decay is below rounding


def averaged(force: Callable[[Array], Array], edges: Array, times: Array, span: float) -> Array:
    """Mean force over the last `span` [s] before each of `times` (n,) [s]; before `span`, over what there is.

    Args:
        force: force [N] at rising times [s].
        edges: rising times [s] between which the force is smooth; they enclose `times`, and begin at the start.
    """
    begin = np.maximum(times - span, edges[0])
    last = edges.size - 2
    first_piece = np.clip(np.searchsorted(edges, begin, side="right") - 1, 0, last)
    last_piece = np.clip(np.searchsorted(edges, times, side="left") - 1, 0, last)
    one = first_piece >= last_piece
    whole = np.zeros(edges.size)
    np.add.at(whole, first_piece[~one] + 1, 1.0)
    np.add.at(whole, last_piece[~one], -1.0)
    needed = np.flatnonzero(np.cumsum(whole)[:-1] > 0)
    # In one go, so that the motion is sampled once: pieces inside a window, and what is cut off at its two ends.
    lefts = np.concatenate([edges[needed], begin, np.where(one, times, edges[last_piece])])
    rights = np.concatenate([edges[needed + 1], np.where(one, times, edges[first_piece + 1]), times])
    parts = _integrals(force, lefts, rights)
    summed = np.zeros(edges.size)
    summed[needed + 1] = parts[: needed.size]
    summed = np.cumsum(summed)
    tail, head = np.split(parts[needed.size :], 2)
    inside = np.where(one, 0.0, summed[last_piece] - summed[np.minimum(first_piece + 1, edges.size - 1)])
    length = times - begin
    out = (tail + inside + head) / np.where(length > 0.0, length, 1.0)
    still = np.flatnonzero(length <= 0.0)
    if still.size:
        out[still] = force(times[still])
    return np.asarray(out)


def rest_edges(duration: float, rates: Array, omegas: Array) -> Array:
    """Times [s] from the start of a rest between which its force is smooth: decay rates [1/s], frequencies [rad/s]."""
    pieces = [np.array([0.0, duration])]
    for rate in rates:
        pieces.append(np.arange(0.0, min(duration, GONE / rate), TURN / rate))
    fastest = float(np.max(omegas, initial=0.0))
    if fastest > 0.0:
        pieces.append(np.linspace(0.0, duration, 2 + int(duration * fastest / TURN)))
    return np.unique(np.concatenate(pieces))


def _integrals(force: Callable[[Array], Array], left: Array, right: Array) -> Array:
    """Integrals over [left, right] (m,) each [N s]."""
    half = 0.5 * (right - left)
    points = (left + half)[:, None] + half[:, None] * _POINTS
    flat = points.ravel()
    order = np.argsort(flat, kind="stable")
    values = np.empty_like(flat)
    values[order] = force(flat[order])
    return np.asarray(half * (values.reshape(points.shape) @ _WEIGHTS))
