"""Stability map of the nonlinear model over two quantities: stick-slip, steady sliding or both, with exact boundaries.

Steady sliding is judged by its eigenvalues at every node; orbits are continued from node to node (`orbit_search`); the
end of stick-slip and the loss of stability of sliding are found on every edge of the grid that they cross.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from time import process_time

import numpy as np
from numpy.typing import NDArray

from identify.prediction.cycle import CycleMap, check_calculable
from identify.prediction.map_axes import Site
from identify.prediction.map_grid import Edge, Loop, Plane, outline, plane
from identify.prediction.orbit_search import OrbitSearch, OrbitsOnGrid, losses_of_stability
from identify.prediction.path import Crossing
from identify.prediction.quantities import QUANTITIES, quantities
from identify.prediction.windows import Outcome, outcome_of
from identify.simulation.sliding import growth_rates

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Range = tuple[float, float]

NOT_ADMITTED = "not possible"  # outcome where the model takes no such pair
NEARER = 0.87  # of the work of a step between neighbours, where they are half as far: measured 0.77 to 0.99
NO_ANSWER = "no answer"  # outcome where a motion cannot be integrated


@dataclass(frozen=True)
class Boundary:
    """The outline of a region in coordinates of the plane, and where it crosses edges of the grid."""

    loops: tuple[Loop, ...]
    crossings: Mapping[Edge, Crossing]

    def lines(self) -> list[tuple[Array, list[Edge | None]]]:
        """The pieces of the outline inside the map: points (n, 2), and the edges they cross."""
        return [
            (loop.points[piece], [loop.edges[i] for i in piece]) for loop in self.loops for piece in loop.open_pieces()
        ]


@dataclass(frozen=True)
class MapCost:
    """Processor seconds [s] of a map: of the functions and starts that any map needs, of the edges over which
    stick-slip ends, of all else, which is work at nodes."""

    starts: float
    edges: float
    nodes: float

    def seconds(self, factor: float) -> float:
        """Of the same map with so many times the points along each quantity: a boundary crosses as many times the
        edges, there are as many times as many nodes, squared, and nearer neighbours take fewer corrections each."""
        return self.starts + NEARER ** np.log2(factor) * (factor * self.edges + factor**2 * self.nodes)


@dataclass(frozen=True)
class Chart:
    """A map. Arrays (n_y, n_x) on the grid of `plane`.

    outcomes: the words of `Outcome`, "not possible" or "no answer"; growth: rate of a disturbance of steady sliding
    [1/s]; multiplier: largest Floquet multiplier of the orbit in magnitude; figures: QUANTITIES of the orbit, SI; NaN
    where there is none. sticking: outline of where stick-slip exists; unstable: of where steady sliding is unstable.
    """

    plane: Plane
    outcomes: NDArray[np.str_]
    growth: Array
    multiplier: Array
    figures: Mapping[str, Array]
    sticking: Boundary
    unstable: Boundary
    cost: MapCost

    @property
    def shares(self) -> dict[str, float]:
        """Share of the map by outcome, of what is possible, largest first."""
        words, counts = np.unique(self.outcomes[self.plane.admitted], return_counts=True)
        order = np.argsort(-counts, kind="stable")
        return {str(words[i]): float(counts[i] / counts.sum()) for i in order}


def chart(
    site: Site,
    names: tuple[str, str],
    ranges: tuple[Range | None, Range | None] = (None, None),
    points: tuple[int, int] = (60, 60),
) -> Chart:
    """The map of an operating point over two quantities (`axes.known_axes`).

    Args:
        ranges: of each quantity [SI]; None: around its value at the point. points: nodes along each.

    Raises:
        SimulationError: quantities, ranges or a model that make no map.
    """
    check_calculable(site.model)
    return charted(plane(site, names, ranges, points))[0]


def charted(grid: Plane) -> tuple[Chart, OrbitsOnGrid]:
    """The map on a grid, and the orbits behind it."""
    since, site = process_time(), grid.site
    check_calculable(site.model)
    growth = np.full(grid.shape, np.nan)
    growth[grid.admitted] = growth_rates(site.model, grid.settings[grid.admitted])
    origin = CycleMap.of(site.model, site.setting)
    built = process_time() - since
    known = OrbitSearch(grid, origin, growth).run()
    return _drawn(grid, growth, known, (since, built)), known


def _drawn(grid: Plane, growth: Array, found: OrbitsOnGrid, begun: tuple[float, float]) -> Chart:
    """The map of what was found; begun: processor time [s] at the beginning, and what was taken before the search."""
    outcomes = np.full(grid.shape, NOT_ADMITTED, dtype="<U20")
    multiplier = np.full(grid.shape, np.nan)
    figures = {name: np.full(grid.shape, np.nan) for name in QUANTITIES}
    for j, i in np.argwhere(grid.admitted).tolist():
        if (j, i) in found.refused:
            outcomes[j, i] = NO_ANSWER
            continue
        orbit, irregular = found.orbits.get((j, i)), (j, i) in found.irregular
        outcome: Outcome = outcome_of(orbit, irregular, bool(growth[j, i] < 0.0))
        outcomes[j, i] = outcome.value
        if orbit is not None:
            multiplier[j, i] = orbit.multiplier
            told = quantities(found.maps[j, i], orbit.cycle, orbit.drive_speed)
            for name, value in zip(QUANTITIES, told.tolist(), strict=True):
                figures[name][j, i] = value
    sticking = _boundary(grid, found.sticks(grid.shape), found.ends)
    unstable = _boundary(grid, growth >= 0.0, losses_of_stability(grid, growth))
    since, built = begun
    starts, edges = built + found.start_seconds, found.edge_seconds
    cost = MapCost(starts, edges, process_time() - since - starts - edges)
    return Chart(grid, outcomes, growth, multiplier, figures, sticking, unstable, cost)


def _boundary(grid: Plane, inside: Bools, crossings: Mapping[Edge, Crossing]) -> Boundary:
    """The outline of a region; an edge whose nodes turned out alike has no crossing."""
    n_y, n_x = grid.shape
    across = {"x": np.full((n_y, n_x - 1), np.nan), "y": np.full((n_y - 1, n_x), np.nan)}
    kept = {edge: crossings[edge] for edge in grid.edges(inside) if edge in crossings}
    for (direction, j, i), crossing in kept.items():
        across[direction][j, i] = crossing.place
    loops = outline(inside, grid.x_places, grid.y_places, across["x"], across["y"])
    return Boundary(tuple(loops), kept)
