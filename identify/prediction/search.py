"""Stick-slip over a grid of settings, and the places between its nodes at which it, or stable sliding, ends.

Motions are settled at every node at once; where two neighbours differ the border between them is closed in on by
bisection: of the motion for the end of stick-slip, of the growth rate for the stability of sliding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import LEVEL
from identify.model.model import Model
from identify.prediction.batch import CycleBatch, Motions
from identify.simulation.sliding import growth_rates

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Rows = NDArray[np.intp]
At = Callable[[Rows, Array], Array]  # settings (k, n_w) of rows (k,) at their places (k,) along a coordinate
Holds = Callable[[Rows, Array], Bools]  # whether something holds there (k,)

QUANTILES = ((1 - LEVEL) / 2, (1 + LEVEL) / 2)  # of draws: the ends of an interval
CLOSER = 5  # halvings of a bracket by motions: to a sixtieth of it
CLOSEST = 40  # by growth rates, which cost next to nothing
FIRST, DOUBLINGS = 0.02, 8  # of the coordinate: first step from where an end is expected, and how often it is doubled


@dataclass(frozen=True)
class Border:
    """Where along edges between nodes something ends: numbers of both nodes (k, 2), the one that has it first; places
    (k, d) of the end; rest states (k, n_y) of stick-slip beside it, and the typical ones there; none of sliding."""

    nodes: Rows
    places: Array
    y: Array
    scale: Array


@dataclass(frozen=True)
class Survey:
    """What motions do at the nodes of a grid.

    places (n, d): their coordinates; settings_at: settings (k, n_w) at coordinates (k, d); sides: for each direction
    of the grid the pairs (m, 2) of nodes side by side; batch, motions: of all nodes.
    """

    model: Model
    places: Array
    settings_at: Callable[[Array], Array]
    sides: Sequence[Rows]
    batch: CycleBatch
    motions: Motions

    @staticmethod
    def of(model: Model, places: Array, settings_at: Callable[[Array], Array], sides: Sequence[Rows]) -> Survey:
        """Settle motions from a rested contact, from one that is almost renewed (small stick-slip may be out of reach
        from a rested one), and from the stick-slip of the nodes beside."""
        batch = CycleBatch(model, settings_at(places))
        found = batch.settle(batch.rested())
        left = np.flatnonzero(~found.sticks)
        if left.size:
            found.update(left, batch.take(left).settle(batch.take(left).renewed()))
        fresh = found.sticks.copy()
        while np.any(fresh):
            before = found.sticks.copy()
            for source, rows in (side.T[order] for side in sides for order in ([0, 1], [1, 0])):
                new = fresh[source] & ~found.sticks[rows]
                if np.any(new):
                    near, part = source[new], batch.take(rows[new])
                    found.update(rows[new], part.settle(found.y[near] * part.scale / batch.scale[near]))
            fresh = found.sticks & ~before
        return Survey(model, places, settings_at, sides, batch, found)

    def ends(self, rounds: int) -> Border:
        """Where stick-slip ends, its brackets halved so many times."""
        nodes = self._edges(self.motions.sticks)
        inside = nodes[:, 0]
        test = StickTest(self.model, self._along(nodes), self.motions.y[inside], self.batch.scale[inside])
        places = self._closed_in(test, nodes, rounds)
        return Border(nodes, places, test.shares * self.batch.scale[inside], self.batch.scale[inside])

    def losses(self) -> Border:
        """Where steady sliding becomes unstable."""
        nodes = self._edges(self.batch.growth >= 0.0)
        places = self._closed_in(growing(self.model, self._along(nodes)), nodes, CLOSEST)
        return Border(nodes, places, np.empty(0), np.empty(0))

    def _edges(self, has: Bools) -> Rows:
        pairs = np.concatenate([np.empty((0, 2), dtype=np.intp), *self.sides])
        pairs = pairs[has[pairs[:, 0]] != has[pairs[:, 1]]]
        return np.asarray(np.where(has[pairs[:, :1]], pairs, pairs[:, ::-1]))

    def _along(self, nodes: Rows) -> At:
        def at(rows: Rows, shares: Array) -> Array:
            first, last = self.places[nodes[rows, 0]], self.places[nodes[rows, 1]]
            return self.settings_at(first + shares[:, None] * (last - first))

        return at

    def _closed_in(self, holds: Holds, nodes: Rows, rounds: int) -> Array:
        inside, outside = np.zeros(len(nodes)), np.ones(len(nodes))
        share = np.mean(bisect(holds, inside, outside, rounds), axis=0)[:, None]
        return np.asarray((1.0 - share) * self.places[nodes[:, 0]] + share * self.places[nodes[:, 1]])


def in_a_row(count: int) -> list[Rows]:
    """The sides of a grid of one direction."""
    return [np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)]


def growing(model: Model, at: At) -> Holds:
    """Whether disturbances of steady sliding grow."""
    return lambda rows, places: growth_rates(model, at(rows, places)) >= 0.0


class StickTest:
    """Whether rows stick and slip at places along a coordinate, each from where it stuck last.

    Args:
        y (n, n_y), scale (n, n_y): rest states of stick-slip at the start, and the typical ones there. rested: whether
            a rested contact is tried too, until a row has stuck.
    """

    def __init__(self, model: Model, at: At, y: Array, scale: Array, *, rested: bool = False) -> None:
        self._model, self._at, self._strange = model, at, np.full(len(y), rested)
        self.shares = y / scale

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
        return stuck


def bisect(holds: Holds, inside: Array, outside: Array, rounds: int) -> tuple[Array, Array]:
    """Brackets (n,) of the places between `inside`, where something holds, and `outside`, halved so many times."""
    rows = np.arange(inside.size)
    for _ in range(rounds if rows.size else 0):
        middle = 0.5 * (inside + outside)
        now = holds(rows, middle)
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
        middle, (low, high) = 0.5 * (inside + outside), np.sort([inside, outside], axis=0)
        wanted = np.isfinite(middle)
        if np.any(wanted[:draws]):  # a quantile lies between two draws: both are closed in on
            ends = [np.nanquantile(middle[:draws], QUANTILES, method=side) for side in ("lower", "higher")]
            wanted[:draws] &= np.any([(low <= end) & (end <= high) for end in np.ravel(ends)], axis=0)[:draws]
        rows = np.flatnonzero(wanted)
        now = holds(rows, middle[rows])
        inside[rows[now]], outside[rows[~now]] = middle[rows[now]], middle[rows[~now]]
    return np.asarray(0.5 * (inside + outside))
