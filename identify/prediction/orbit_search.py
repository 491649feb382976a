"""Stick-slip and steady sliding over a grid of settings: orbits spread from node to node, and where each of them ends.

One search serves the windows of drive speed, the maps over two quantities, continuations and advice over one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from time import process_time

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.model.model import Model
from identify.prediction.cycle import CycleMap
from identify.prediction.map_grid import Edge, Plane
from identify.prediction.orbit import Orbit, close, long_enough, patience, settle
from identify.prediction.path import Crossing, expected, follow
from identify.simulation.sliding import clearances, growth_rates

# ----------------------------------------------------------------------------------------------------------------------
# Where steady sliding loses its stability, along the edges of a grid, and how those places move.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

ROUNDS, SPLITS = 3, 16  # of narrowing a crossing, and by how much each round narrows it
STEP, LEAST = 1e-5, 1e-6  # relative step of a setting, and absolute for what is zero
JUMPS = 0.1  # share of the change over an edge that is left in a narrowed crossing where the rate jumps


def losses_of_stability(plane: Plane, growth: Array) -> dict[Edge, Crossing]:
    """Every edge over which the growth rate (n_y, n_x) of steady sliding changes its sign, and where: where the rate is
    zero, or where it jumps as the contact wears out."""
    edges = plane.edges(growth >= 0.0)
    if not edges:
        return {}
    model, ways = plane.site.model, [plane.way(edge) for edge in edges]
    low, high = np.array([w[1] for w in ways]), np.array([w[2] for w in ways])
    shares = np.linspace(0.0, 1.0, SPLITS + 1)
    first = last = np.empty(0)
    for turn in range(ROUNDS):
        places = low[:, None] + shares * (high - low)[:, None]
        settings = np.array([[way[0].setting(p) for p in row] for way, row in zip(ways, places.tolist(), strict=True)])
        rates = growth_rates(model, settings.reshape(-1, settings.shape[-1])).reshape(places.shape)
        change = (rates[:, 1:] >= 0.0) != (rates[:, :1] >= 0.0)
        at, rows = np.argmax(change, axis=1), np.arange(len(edges))
        low, high = places[rows, at], places[rows, at + 1]
        before, after = rates[rows, at], rates[rows, at + 1]
        if turn == 0:
            first = np.abs(rates[:, -1] - rates[:, 0])
        last = np.abs(after - before)
    jumps = last > JUMPS * first
    ends = np.array([way[0].setting(p) for place in (low, high) for way, p in zip(ways, place.tolist(), strict=True)])
    clear, worn = clearances(model, ends).reshape(2, -1)
    # A law that bends there makes the rate jump too: somewhere in between.
    before, after = np.where(jumps, np.where(clear * worn < 0.0, (clear, worn), [[1.0], [-1.0]]), (before, after))
    found = low + before / (before - after) * (high - low)
    settings = np.array([way[0].setting(p) for way, p in zip(ways, found.tolist(), strict=True)])
    along = np.array([way[0].slope(p) for way, p in zip(ways, found.tolist(), strict=True)])
    slopes = _slopes(model, settings, along, jumps)
    return {e: Crossing(float(p), s, bool(j)) for e, p, s, j in zip(edges, found, slopes, jumps, strict=True)}


def _slopes(model: Model, settings: Array, along: Array, jumps: NDArray[np.bool_]) -> Array:
    """Derivatives of the crossings (n, n_w) at settings (n, n_w), where the coordinate moves them by `along`.

    Where the growth rate jumps, the contact wears out, and it is the clearance of its state that is zero.
    """
    n, n_w = settings.shape
    steps = STEP * np.where(settings == 0.0, LEAST / STEP, np.abs(settings))
    moves = np.zeros((n, 2, n_w, n_w))
    moves[:, 0, np.arange(n_w), np.arange(n_w)], moves[:, 1, np.arange(n_w), np.arange(n_w)] = steps, -steps
    moved = np.ascontiguousarray((settings[:, None, None, :] + moves).reshape(-1, n_w))
    values = growth_rates(model, moved).reshape(n, 2, n_w)
    if np.any(jumps):
        values = np.where(jumps[:, None, None], clearances(model, moved).reshape(n, 2, n_w), values)
    by_setting = (values[:, 0] - values[:, 1]) / (2.0 * steps)
    with np.errstate(all="ignore"):
        return np.asarray(-by_setting / np.sum(by_setting * along, axis=1)[:, None])


# ----------------------------------------------------------------------------------------------------------------------
# Stick-slip orbits at every node of a grid, each sought where its neighbour's derivatives expect it.
#
# The sea of orbits spreads from a few motions that settled; where no orbit is found next to one, the branch is followed
# along the edge between them, through the fold where stick-slip ends.
# ----------------------------------------------------------------------------------------------------------------------

Node = tuple[int, int]  # row, column

SEEDS = 8  # along each axis: nodes at which a motion is started, of a rested contact or an almost renewed one
HALVINGS = 5  # of an edge
HOVERS = 30  # cycles after which a motion near an unstable orbit is given up


@dataclass
class OrbitsOnGrid:
    """What was found: orbits by node (with the map of each), rest states of motions that stick without settling, ends
    by edge (with the last orbit of the branch before each fold); processor seconds [s] of the starts from a coarse grid
    and of the functions they build, and of the edges over which stick-slip ends."""

    orbits: dict[Node, Orbit] = field(default_factory=dict)
    maps: dict[Node, CycleMap] = field(default_factory=dict)
    irregular: dict[Node, Array] = field(default_factory=dict)
    refused: set[Node] = field(default_factory=set)  # motions that cannot be integrated
    ends: dict[Edge, Crossing] = field(default_factory=dict)
    last: dict[Edge, Orbit] = field(default_factory=dict)
    start_seconds: float = 0.0
    edge_seconds: float = 0.0

    def sticks(self, shape: tuple[int, int]) -> Bools:
        """Whether a node has stick-slip, periodic or not, (n_y, n_x)."""
        out = np.zeros(shape, dtype=bool)
        for node in (*self.orbits, *self.irregular):
            out[node] = True
        return out


class OrbitSearch:
    """Spreads orbits over a plane; growth (n_y, n_x): rates of steady sliding [1/s] at its nodes."""

    def __init__(self, plane: Plane, map_: CycleMap, growth: Array) -> None:
        self._plane, self._growth, self._origin = plane, growth, map_
        self.known, self._n_w = OrbitsOnGrid(), plane.settings.shape[-1]
        self._stepped: set[bool] = set()

    def run(self) -> OrbitsOnGrid:
        """Orbits at every node that has one: from a coarse grid of starts (from every node of a single row), and from
        wherever sliding does not last."""
        most = SEEDS if min(self._plane.shape) > 1 else max(self._plane.shape)
        rows, columns = (np.unique(np.linspace(0, n - 1, min(n, most)).astype(int)) for n in self._plane.shape)
        for j in rows.tolist():
            for i in columns.tolist():
                self.known.start_seconds += self._seed((j, i))
        for j, i in np.argwhere(self._growth >= 0.0).tolist():
            self._seed((j, i))
        since = process_time()
        self._close_in()
        self.known.edge_seconds += process_time() - since
        return self.known

    def _close_in(self) -> None:
        """Halve the edges over which stick-slip ends in no fold, as where its jumps fade away."""
        sticks = self.known.sticks(self._plane.shape)
        for edge in self._plane.edges(sticks):
            ends = (edge[1], edge[2]), (edge[1], edge[2] + 1) if edge[0] == "x" else (edge[1] + 1, edge[2])
            if edge not in self.known.ends and self.known.refused.isdisjoint(ends):
                inside = ends[0] if sticks[ends[0]] else ends[1]
                self.known.ends[edge] = Crossing(
                    self._halved(edge, inside, inside == ends[0]), np.full(self._n_w, np.nan)
                )

    def _halved(self, edge: Edge, inside: Node, first: bool) -> float:
        """The coordinate on an edge at which the motion from that of one of its nodes no longer sticks."""
        setting_path, begin, finish = self._plane.way(edge)
        sticks, slides = (begin, finish) if first else (finish, begin)
        map_ = self._map(inside)
        near = self.known.orbits.get(inside)
        state = self.known.irregular[inside] if near is None else near.y
        for _ in range(HALVINGS):
            middle = 0.5 * (sticks + slides)
            w = setting_path.setting(middle)
            there, speed = self._origin.at(w), float(w[-1])
            start = state * there.scale / map_.scale if near is None else expected(near, map_.scale, there, w)
            try:
                found = settle(there, speed, start, patience=patience(there, speed))
            except SimulationError:
                break
            if found.sticks:
                sticks, near, state, map_ = middle, found.orbit, found.state, there
            else:
                slides = middle
        return 0.5 * (sticks + slides)

    def _seed(self, node: Node) -> float:
        """Start a motion at a node, and spread its orbit; the processor seconds of the start alone are returned."""
        if not self._plane.admitted[node] or self._is_known(node):
            return 0.0
        since = process_time()
        try:
            # Small stick-slip of a contact that never rests for long may be out of reach from a rested one.
            renewed = self._map(node).renewed(self._speed(node))
            sticks = self._settled(node, None) or (renewed is not None and self._settled(node, renewed))
        except SimulationError:
            self.known.refused.add(node)
            sticks = False
        taken = process_time() - since
        if sticks:
            self._spread(node)
        return taken

    def _settled(self, node: Node, state: Array | None) -> bool:
        """Whether the motion at a node, from a rested contact or a rest state, goes on sticking; noted if it does."""
        map_ = self._map(node)
        found = settle(map_, self._speed(node), state, patience=self._patience(map_, node))
        if found.orbit is not None:
            self._take(node, map_, found.orbit)
        elif found.sticks:
            self.known.irregular[node] = found.state
        return found.sticks

    def _spread(self, start: Node) -> None:
        queue = deque([start])
        while queue:
            here = queue.popleft()
            for there, edge in self._neighbours(here):
                if self._is_known(there) or edge in self.known.ends:
                    continue
                since = process_time()
                reached = self._reached(here, there, edge)
                self._spent(process_time() - since, reached)
                if reached:
                    queue.append(there)

    def _spent(self, seconds: float, reached: bool) -> None:
        """Note what a step to a neighbour took: the first of a kind builds functions; where none is reached, it is a
        step over the end."""
        if reached not in self._stepped:
            self._stepped.add(reached)
            self.known.start_seconds += seconds
        elif not reached:
            self.known.edge_seconds += seconds

    def _reached(self, here: Node, there: Node, edge: Edge) -> bool:
        """Whether the stick-slip of one node leads to some at the next; else the end between them is noted."""
        map_ = self._map(there)
        try:
            if here in self.known.irregular:
                return self._settled(there, self.known.irregular[here] * (map_.scale / self._map(here).scale))
            orbit = self._near(map_, there, self.known.orbits[here], self.known.maps[here].scale)
            if orbit is None and there not in self.known.irregular:
                orbit = self._along(map_, here, there, edge)
        except SimulationError:
            self.known.refused.add(there)
            return False
        if orbit is not None:
            self._take(there, map_, orbit)
        return self._is_known(there)

    def _is_known(self, node: Node) -> bool:
        return node in self.known.orbits or node in self.known.irregular or node in self.known.refused

    def _near(self, map_: CycleMap, node: Node, orbit: Orbit, scale: Array) -> Orbit | None:
        """The stable orbit at a node that the derivatives of another one expect."""
        w, long = self._plane.settings[node], self._patience(map_, node)
        found = close(map_, expected(orbit, scale, map_, w), self._speed(node), patience=long)
        if found is None or found.stable:
            return found
        settled = settle(map_, self._speed(node), found.y, patience=long, cycles=HOVERS)
        if settled.orbit is None and settled.sticks:
            self.known.irregular[node] = settled.state
        return settled.orbit

    def _along(self, map_: CycleMap, here: Node, there: Node, edge: Edge) -> Orbit | None:
        """The orbit at the far end of an edge by following the branch along it; None where it ends before."""
        setting_path, begin, finish = self._plane.way(edge)
        forwards = there > here
        if not forwards:
            setting_path, begin, finish = setting_path.reversed(), -finish, -begin
        found = follow(self.known.maps[here], self.known.orbits[here], setting_path, begin, finish)
        last = found.orbits[-1]
        if found.end is not None and found.end.place < finish:
            sign = 1.0 if forwards else -1.0
            self.known.ends[edge] = Crossing(sign * found.end.place, sign * found.end.slopes)
            self.known.last[edge] = last
            return None
        return self._near(map_, there, last, map_.at(last.cycle.setting).scale)

    def _take(self, node: Node, map_: CycleMap, orbit: Orbit) -> None:
        self.known.orbits[node], self.known.maps[node] = orbit, map_

    def _neighbours(self, node: Node) -> Iterator[tuple[Node, Edge]]:
        j, i = node
        (n_y, n_x), admitted = self._plane.shape, self._plane.admitted
        for k, m in ((j, i + 1), (j, i - 1), (j + 1, i), (j - 1, i)):
            if 0 <= k < n_y and 0 <= m < n_x and admitted[k, m]:
                yield (k, m), ("x" if k == j else "y", min(j, k), min(i, m))

    def _map(self, node: Node) -> CycleMap:
        return self._origin.at(self._plane.settings[node])

    def _speed(self, node: Node) -> float:
        return float(self._plane.settings[node][-1])

    def _patience(self, map_: CycleMap, node: Node) -> float:
        return long_enough(float(self._growth[node]) * map_.half_period)
