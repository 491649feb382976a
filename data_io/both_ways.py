"""Crosstalk and tilt from the two directions of a reciprocating test: what does not change sign with the motion."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.frozen import FloatArray

FEWEST: Final = 20
"""Rows of a stroke that is worth a mean."""
_MIDDLE: Final = (0.25, 0.95)
"""Part of a stroke that is averaged: behind the turn the spring is still being loaded the other way."""
_CLEAR: Final = 0.3
"""Share of the swing of the ratio between both directions that counts as a direction."""
_TURNING: Final = 0.4
"""Share of the rows that may lie between both directions: the turns. A saw-tooth of one direction has 0.75."""
_WIDTH: Final = 0.01


@dataclass(frozen=True)
class BothWays:
    """A mean over pairs of neighbouring strokes, its standard error (None with one pair), and how many pairs."""

    value: float
    standard_error: float | None
    pairs: int


def crosstalk(friction: FloatArray, normal: FloatArray) -> BothWays | None:
    """Return c of `friction measured = friction + c * normal`, None where the record does not go both ways.

    Forward and backward the ratio of the forces is c + mu and c - mu: their mean is c. Both forces (n,) [N], tare
    taken off, NaN where they do not count.
    """
    return _mean_of_pairs(_ratios(friction, normal))


def tilt(friction: FloatArray, normal: FloatArray) -> BothWays | None:
    """Return the angle [rad] by which the surface climbs along positive friction force; arguments as `crosstalk`.

    In the axes of the machine the ratio of the forces is tan(phi + angle) forward and tan(-phi + angle) backward, with
    the angle of friction phi: the mean of their arcs is the angle, however large phi is.
    """
    return _mean_of_pairs([(sign, float(np.arctan(ratio))) for sign, ratio in _ratios(friction, normal)])


def levelled(friction: FloatArray, normal: FloatArray, angle: float) -> tuple[FloatArray, FloatArray]:
    """Return friction and normal force along and across a surface that is tilted by an angle [rad] to the machine."""
    cos, sin = np.cos(angle), np.sin(angle)
    return friction * cos - normal * sin, normal * cos + friction * sin


def _ratios(friction: FloatArray, normal: FloatArray) -> list[tuple[int, float]]:
    """Return direction and mean friction over mean normal force of the middle of every stroke."""
    found = []
    for start, stop, sign in _strokes(friction, normal):
        rows = slice(start + int(_MIDDLE[0] * (stop - start)), start + int(_MIDDLE[1] * (stop - start)))
        good = np.isfinite(friction[rows]) & np.isfinite(normal[rows])
        if np.count_nonzero(good) >= FEWEST and (load := float(np.mean(normal[rows][good]))) > 0:
            found.append((sign, float(np.mean(friction[rows][good])) / load))
    return found


def _strokes(friction: FloatArray, normal: FloatArray) -> list[tuple[int, int, int]]:
    """Return rows [start, stop) and direction of every stroke, by the side of the middle on which the ratio stays."""
    load = float(np.nanmedian(normal))
    if not load > 0:
        return []
    rows = np.arange(friction.size)
    good = np.isfinite(friction) & np.isfinite(normal) & (normal > 0.5 * load)
    if np.count_nonzero(good) < 4 * FEWEST:
        return []
    ratio = np.interp(rows, rows[good], friction[good] / normal[good])
    width = max(int(_WIDTH * friction.size), 3) | 1
    ratio = np.convolve(np.pad(ratio, width // 2, mode="edge"), np.ones(width) / width, mode="valid")
    low, high = (float(q) for q in np.quantile(ratio, [0.1, 0.9]))
    middle, clear = 0.5 * (low + high), _CLEAR * (high - low)
    if not (low < middle - clear and high > middle + clear):
        return []
    if np.mean(np.abs(ratio - middle) < clear) > _TURNING:
        return []  # it swings through the middle and dwells on neither side: stick-slip one way
    side = np.where(ratio > middle + clear, 1, np.where(ratio < middle - clear, -1, 0))
    return _runs(side)


def _runs(side: npt.NDArray[np.int_]) -> list[tuple[int, int, int]]:
    """Return the stretches of one sign; undecided rows between them belong to none."""
    edges = np.flatnonzero(np.diff(side)) + 1
    bounds = [0, *edges.tolist(), side.size]
    return [(a, b, int(side[a])) for a, b in pairwise(bounds) if side[a] != 0 and b - a >= FEWEST]


def _mean_of_pairs(strokes: list[tuple[int, float]]) -> BothWays | None:
    """Return the mean over pairs of neighbours of opposite sign; every stroke stands in one pair only."""
    pairs, i = [], 0
    while i + 1 < len(strokes):
        (one, a), (other, b) = strokes[i], strokes[i + 1]
        if one == -other:
            pairs.append(0.5 * (a + b))
        i += 2 if one == -other else 1
    if not pairs:
        return None
    error = float(np.std(pairs, ddof=1) / np.sqrt(len(pairs))) if len(pairs) > 1 else None
    return BothWays(float(np.mean(pairs)), error, len(pairs))
