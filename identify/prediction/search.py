"""Stick-slip over a grid of settings, and the places along a coordinate at which it, or stable sliding, ends."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import LEVEL
from identify.model.model import Model
from identify.prediction.batch import CycleBatch, Motions

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Rows = NDArray[np.intp]
Holds = Callable[[Rows, Array], Bools]  # whether something holds for rows (k,) at their places (k,)
At = Callable[[Rows, Array], Array]  # settings (k, n_w) of rows (k,) at their places (k,)

CLOSER = 6  # halvings of a bracket by motions: to a hundredth of it
CLOSEST = 40  # by growth rates, which cost next to nothing
FIRST, DOUBLINGS = 0.02, 8  # of the coordinate: first step from where an end is expected, and how often it is doubled


def explore(batch: CycleBatch, beside: NDArray[np.intp]) -> Motions:
    """What motions do at every row: from a rested contact, from one that is almost renewed (small stick-slip may be
    out of reach from a rested one), and from the stick-slip of the rows beside it.

    Args:
        beside: neighbours (n, k) of each row, -1 where there is none.
    """
    found = batch.settle(batch.rested())
    left = np.flatnonzero(~found.sticks)
    if left.size:
        found.update(left, batch.take(left).settle(batch.take(left).renewed()))
    fresh = found.sticks.copy()
    while np.any(fresh):
        before = found.sticks.copy()
        for source in beside.T:
            rows = np.flatnonzero(~found.sticks & (source >= 0) & fresh[source])
            if rows.size:
                near = source[rows]
                part = batch.take(rows)
                found.update(rows, part.settle(found.y[near] * part.scale / batch.scale[near]))
        fresh = found.sticks & ~before
    return found


class StickTest:
    """Whether rows stick and slip at places along a coordinate, each from where it stuck last.

    Args:
        at: settings by rows and places. y (n, n_y), scale (n, n_y): rest states of stick-slip at the start, and the
            typical ones there. rested: whether a rested contact is tried too, until a row has stuck.
    """

    def __init__(self, model: Model, at: At, y: Array, scale: Array, *, rested: bool = False) -> None:
        self._model, self._at, self._strange = model, at, np.full(len(y), rested)
        self.shares, self.periodic = y / scale, np.ones(len(y), dtype=bool)

    def __call__(self, rows: Rows, places: Array) -> Bools:
        """Whether rows (k,) do at their places (k,)."""
        batch = CycleBatch(self._model, self._at(rows, places))
        found = batch.settle(self.shares[rows] * batch.scale)
        left = np.flatnonzero(~found.sticks & self._strange[rows])
        if left.size:
            found.update(left, batch.take(left).settle(batch.take(left).rested()))
        stuck = found.sticks
        self._strange[rows[stuck]] = False
        self.shares[rows[stuck]] = (found.y / batch.scale)[stuck]
        self.periodic[rows[stuck]] = found.periodic[stuck]
        return stuck


def bisect(holds: Holds, inside: Array, outside: Array, rounds: int) -> tuple[Array, Array]:
    """Brackets (n,) of the places between `inside`, where something holds, and `outside`, halved so many times."""
    inside, outside, every = inside.copy(), outside.copy(), np.arange(inside.size)
    for _ in range(rounds if every.size else 0):
        middle = 0.5 * (inside + outside)
        now = holds(every, middle)
        inside, outside = np.where(now, middle, inside), np.where(now, outside, middle)
    return inside, outside


def locate(holds: Holds, expected: Array, ahead: float, rounds: int, draws: int) -> Array:
    """Places (n,) at which something ends that holds before them in the direction `ahead` (1 or -1), NaN where there
    is none near to what is expected (n,).

    Of the first `draws` rows the outer quantiles are closed in on alone, the others are left as wide as they are.
    """
    place, inside, outside = expected.copy(), np.full(expected.size, np.nan), np.full(expected.size, np.nan)
    step = FIRST
    for turn in range(DOUBLINGS + 1):
        rows = np.flatnonzero(np.isnan(inside) | np.isnan(outside))
        if not rows.size:
            break
        now = holds(rows, place[rows])
        inside[rows[now]], outside[rows[~now]] = place[rows[now]], place[rows[~now]]
        place[rows] += np.where(now, ahead, -ahead) * step
        step *= 1.0 if turn == 0 else 2.0
    for _ in range(rounds):
        middle = 0.5 * (inside + outside)
        if not np.any(np.isfinite(middle[:draws])):
            break
        shares = [(1 - LEVEL) / 2, (1 + LEVEL) / 2]
        # A quantile lies between two of them: both are closed in on.
        ends = [np.nanquantile(middle[:draws], shares, method=side) for side in ("lower", "higher")]
        low, high = np.minimum(inside, outside), np.maximum(inside, outside)
        wanted = np.any([(low <= end) & (end <= high) for end in np.ravel(ends)], axis=0)
        wanted[draws:] = np.isfinite(middle[draws:])
        rows = np.flatnonzero(wanted)
        if not rows.size:
            break
        now = holds(rows, middle[rows])
        inside[rows[now]], outside[rows[~now]] = middle[rows[now]], middle[rows[~now]]
    return 0.5 * (inside + outside)
