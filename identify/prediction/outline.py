"""The outline of a region of a grid: closed loops through the edges of the grid at the places it is crossed at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Edge = tuple[str, int, int]  # "x" or "y": from node (row, column) to the next in that direction; of the padded grid

# By the corners inside (1: lower left, 2: lower right, 4: upper right, 8: upper left): sides from which and to which
# the outline runs with the region on its left. B, R, T, L: bottom, right, top, left.
_RUNS: dict[int, tuple[tuple[str, str], ...]] = {
    1: (("B", "L"),),
    2: (("R", "B"),),
    3: (("R", "L"),),
    4: (("T", "R"),),
    5: (("B", "L"), ("T", "R")),
    6: (("T", "B"),),
    7: (("T", "L"),),
    8: (("L", "T"),),
    9: (("B", "T"),),
    10: (("R", "B"), ("L", "T")),
    11: (("R", "T"),),
    12: (("L", "R"),),
    13: (("B", "R"),),
    14: (("L", "B"),),
}


@dataclass(frozen=True)
class Loop:
    """A closed outline, the region on its left: points (n, 2) as (x, y); edges of the grid (n,) as (direction, row,
    column) of the node before the crossing, None where the outline is the frame of the grid."""

    points: Array
    edges: tuple[Edge | None, ...]

    def open_pieces(self) -> list[list[int]]:
        """Runs of points that are no frame, as indices; a loop that never meets the frame is closed by its first."""
        n, framed = len(self.edges), [i for i, edge in enumerate(self.edges) if edge is None]
        if not framed:
            return [[*range(n), 0]]
        order = [(framed[0] + i) % n for i in range(n)]
        pieces: list[list[int]] = [[]]
        for i in order:
            if self.edges[i] is None:
                pieces.append([])
            else:
                pieces[-1].append(i)
        return [piece for piece in pieces if piece]


def outline(inside: Bools, x: Array, y: Array, across_x: Array, across_y: Array) -> list[Loop]:
    """The closed loops around a region.

    Args:
        inside: (n_y, n_x), whether a node belongs to it. x (n_x,), y (n_y,): coordinates, rising.
        across_x (n_y, n_x - 1): x at which the region is crossed between two nodes of a row that differ;
        across_y (n_y - 1, n_x): y between two nodes of a column. Where they are NaN, half the way.
    """
    padded = np.pad(inside, 1)
    following: dict[Edge, Edge] = {}
    for j in range(padded.shape[0] - 1):
        for i in range(padded.shape[1] - 1):
            corners = padded[j, i], padded[j, i + 1], padded[j + 1, i + 1], padded[j + 1, i]
            sides: dict[str, Edge] = {"B": ("x", j, i), "T": ("x", j + 1, i), "L": ("y", j, i), "R": ("y", j, i + 1)}
            for start, end in _RUNS.get(sum(1 << bit for bit, corner in enumerate(corners) if corner), ()):
                following[sides[start]] = sides[end]
    loops = []
    while following:
        first, edge = next(iter(following.items()))
        del following[first]
        edges = [first]
        while edge != first:
            edges.append(edge)
            edge = following.pop(edge)
        points = np.array([_crossing(e, x, y, across_x, across_y) for e in edges])
        loops.append(Loop(points, tuple(_of_grid(e, x.size, y.size) for e in edges)))
    return loops


def _of_grid(edge: Edge, n_x: int, n_y: int) -> Edge | None:
    """The edge in the grid without its padding; None for one that leads out of it."""
    direction, j, i = edge[0], edge[1] - 1, edge[2] - 1
    if direction == "x":
        return (direction, j, i) if 0 <= i < n_x - 1 else None
    return (direction, j, i) if 0 <= j < n_y - 1 else None


def _crossing(edge: Edge, x: Array, y: Array, across_x: Array, across_y: Array) -> tuple[float, float]:
    """The point at which an edge of the padded grid is crossed; an edge that leads out of it at the frame."""
    direction, j, i = edge[0], edge[1] - 1, edge[2] - 1
    inner = _of_grid(edge, x.size, y.size) is not None
    if direction == "x":
        return _between(x, i, across_x[j, i] if inner else np.nan), float(y[j])
    return float(x[i]), _between(y, j, across_y[j, i] if inner else np.nan)


def _between(places: Array, i: int, found: float) -> float:
    """Where it was found, else half way between a node and the next; beyond the first and the last node, there."""
    if np.isfinite(found):
        return float(found)
    low, high = places[max(i, 0)], places[min(i + 1, places.size - 1)]
    return float(0.5 * (low + high))
