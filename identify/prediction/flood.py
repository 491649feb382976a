"""Stick-slip orbits at every node of a grid, each sought where its neighbour's derivatives expect it.

The sea of orbits spreads from a few motions that settled; where no orbit is found next to one, the branch is followed
along the edge between them, through the fold where stick-slip ends.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.prediction.branch import Followed, expected, piece
from identify.prediction.cycle import CycleMap
from identify.prediction.orbit import Orbit, close, settle
from identify.prediction.outline import Edge
from identify.prediction.plane import Plane
from identify.prediction.trace import End
from identify.prediction.windows import long_enough, patience

Array = NDArray[np.float64]
Node = tuple[int, int]  # row, column

SEEDS = 8  # along each axis: nodes from which a motion is started from a rested contact
HALVINGS = 5  # of an edge
HOVERS = 30  # cycles after which a motion near an unstable orbit is given up


@dataclass
class Sea:
    """What was found: orbits by node (with the map of each), nodes that stick without settling, ends by edge."""

    orbits: dict[Node, Orbit] = field(default_factory=dict)
    maps: dict[Node, CycleMap] = field(default_factory=dict)
    irregular: set[Node] = field(default_factory=set)
    refused: set[Node] = field(default_factory=set)  # motions that cannot be integrated
    ends: dict[Edge, End] = field(default_factory=dict)


class Flood:
    """Spreads orbits over a plane; growth (n_y, n_x): rates of steady sliding [1/s] at its nodes."""

    def __init__(self, plane: Plane, map_: CycleMap, growth: Array) -> None:
        self._plane, self._growth, self._origin = plane, growth, map_
        self.sea, self._n_w = Sea(), plane.settings.shape[-1]

    def run(self) -> Sea:
        """Orbits at every node that has one: from a coarse grid of starts, and from wherever sliding does not last."""
        rows, columns = (np.unique(np.linspace(0, n - 1, min(n, SEEDS)).astype(int)) for n in self._plane.shape)
        for j in rows.tolist():
            for i in columns.tolist():
                self._seed((j, i))
        for j, i in np.argwhere(self._growth >= 0.0).tolist():
            self._seed((j, i))
        self._close_in()
        return self.sea

    def _close_in(self) -> None:
        """Halve the edges over which stick-slip ends in no fold, as where its jumps fade away."""
        sticks = np.zeros(self._plane.shape, dtype=bool)
        for node in self.sea.orbits:
            sticks[node] = True
        for edge in self._plane.edges(sticks):
            ends = (edge[1], edge[2]), (edge[1], edge[2] + 1) if edge[0] == "x" else (edge[1] + 1, edge[2])
            if edge not in self.sea.ends and not any(self._given_up(node) for node in ends):
                inside = ends[0] if sticks[ends[0]] else ends[1]
                self.sea.ends[edge] = End(self._halved(edge, inside, inside == ends[0]), np.full(self._n_w, np.nan))

    def _halved(self, edge: Edge, inside: Node, first: bool) -> float:
        """The coordinate on an edge at which the motion from the orbit of one of its nodes no longer sticks."""
        course, begin, finish = self._plane.way(edge)
        sticks, slides = (begin, finish) if first else (finish, begin)
        orbit, scale = self.sea.orbits[inside], self.sea.maps[inside].scale
        for _ in range(HALVINGS):
            middle = 0.5 * (sticks + slides)
            w = course.setting(middle)
            map_ = self._origin.at(w)
            speed = float(w[-1])
            try:
                found = settle(map_, speed, expected(orbit, scale, map_, w), patience=patience(map_, speed)).orbit
            except SimulationError:
                found = None
            if found is None:
                slides = middle
            else:
                sticks, orbit, scale = middle, found, map_.scale
        return 0.5 * (sticks + slides)

    def _seed(self, node: Node) -> None:
        if not self._plane.admitted[node] or node in self.sea.orbits or self._given_up(node):
            return
        there = self._map(node)
        try:
            found = settle(there, self._speed(node), patience=self._patience(there, node))
        except SimulationError:
            self.sea.refused.add(node)
            return
        if found.orbit is not None:
            self._take(node, there, found.orbit)
            self._spread(node)
        elif found.sticks:
            self.sea.irregular.add(node)

    def _spread(self, start: Node) -> None:
        queue = deque([start])
        while queue:
            here = queue.popleft()
            for there, edge in self._neighbours(here):
                if there not in self.sea.orbits and edge not in self.sea.ends and self._reached(here, there, edge):
                    queue.append(there)

    def _reached(self, here: Node, there: Node, edge: Edge) -> bool:
        """Whether the orbit of one node leads to one of the next; else the end between them is noted."""
        if self._given_up(there):
            return False
        map_ = self._map(there)
        try:
            orbit = self._near(map_, there, self.sea.orbits[here], self.sea.maps[here].scale)
            if orbit is None and not self._given_up(there):
                orbit = self._along(map_, here, there, edge)
        except SimulationError:
            self.sea.refused.add(there)
            return False
        if orbit is not None:
            self._take(there, map_, orbit)
        return orbit is not None

    def _given_up(self, node: Node) -> bool:
        return node in self.sea.irregular or node in self.sea.refused

    def _near(self, map_: CycleMap, node: Node, orbit: Orbit, scale: Array) -> Orbit | None:
        """The stable orbit at a node that the derivatives of another one expect."""
        w, long = self._plane.settings[node], self._patience(map_, node)
        found = close(map_, expected(orbit, scale, map_, w), self._speed(node), patience=long)
        if found is None or found.stable:
            return found
        settled = settle(map_, self._speed(node), found.y, patience=long, cycles=HOVERS)
        if settled.orbit is None and settled.sticks:
            self.sea.irregular.add(node)
        return settled.orbit

    def _along(self, map_: CycleMap, here: Node, there: Node, edge: Edge) -> Orbit | None:
        """The orbit at the far end of an edge by following the branch along it; None where it ends before."""
        course, begin, finish = self._plane.way(edge)
        forwards = there > here
        if not forwards:
            course, begin, finish = course.reversed(), -finish, -begin
        start = Followed((self.sea.orbits[here],), (begin,), None)
        found = piece(self.sea.maps[here], start, course, finish, patience)
        last = found.orbits[-1]
        if found.ending is not None and found.ending.place < finish:
            sign = 1.0 if forwards else -1.0
            self.sea.ends[edge] = End(sign * found.ending.place, sign * found.ending.slopes)
            return None
        return self._near(map_, there, last, map_.at(last.cycle.setting).scale)

    def _take(self, node: Node, map_: CycleMap, orbit: Orbit) -> None:
        self.sea.orbits[node], self.sea.maps[node] = orbit, map_

    def _neighbours(self, node: Node) -> Iterator[tuple[Node, Edge]]:
        j, i = node
        (n_y, n_x), admitted = self._plane.shape, self._plane.admitted
        if i + 1 < n_x and admitted[j, i + 1]:
            yield (j, i + 1), ("x", j, i)
        if i > 0 and admitted[j, i - 1]:
            yield (j, i - 1), ("x", j, i - 1)
        if j + 1 < n_y and admitted[j + 1, i]:
            yield (j + 1, i), ("y", j, i)
        if j > 0 and admitted[j - 1, i]:
            yield (j - 1, i), ("y", j - 1, i)

    def _map(self, node: Node) -> CycleMap:
        return self._origin.at(self._plane.settings[node])

    def _speed(self, node: Node) -> float:
        return float(self._plane.settings[node][-1])

    def _patience(self, map_: CycleMap, node: Node) -> float:
        return long_enough(float(self._growth[node]) * map_.half_period)
