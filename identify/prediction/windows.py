"""Stick-slip over a grid of settings, where it or stable sliding ends between nodes, and windows of drive speed.

Motions are settled at every node at once; where two neighbours differ the border between them is closed in on by
bisection: of the motion for the end of stick-slip, of the growth rate for the stability of sliding. The drive speeds
searched depend on pair and rig alone, so that the windows are the same whatever speed is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import LEVEL
from identify.model.model import Model
from identify.prediction.cycles import CycleBatch, Motions
from identify.simulation.sliding import growth_rates

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Rows = NDArray[np.intp]
At = Callable[[Rows, Array], Array]  # settings (k, n_w) of rows (k,) at their places (k,) along a coordinate
Holds = Callable[[Rows, Array], Bools]  # whether something holds there (k,)

QUANTILES = ((1 - LEVEL) / 2, (1 + LEVEL) / 2)  # of draws: the ends of an interval
ROUGH, COARSE, FINE = 3, 5, 12  # halvings of a bracket by motions: of one draw among many, on a map, along a line
CLOSEST = 40  # by growth rates, which cost next to nothing
FIRST, DOUBLINGS = 0.02, 8  # of the coordinate: first step from where an end is expected, and how often it is doubled
SPACING, FINER = 0.3, 8  # of the logarithm of the drive speed between nodes; so many times as fine for sliding
SLOWEST, FASTEST = 1e-2, 30.0  # range searched, over the slowest and the typical speed of pair and rig


# Over a grid.


@dataclass(frozen=True)
class Border:
    """Where along edges between nodes something ends: numbers of both nodes (k, 2), the one that has it first; places
    (k, d) of the end; rest states (k, n_y) of stick-slip beside it, none of sliding."""

    nodes: Rows
    places: Array
    y: Array


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
        motions = batch.settle(batch.rested())
        left = np.flatnonzero(~motions.sticks)
        motions.update(left, batch.take(left).settle(batch.take(left).renewed()))
        fresh = motions.sticks.copy()
        while np.any(fresh):
            before = motions.sticks.copy()
            for source, rows in (side.T[order] for side in sides for order in ([0, 1], [1, 0])):
                new = fresh[source] & ~motions.sticks[rows]
                near, part = source[new], batch.take(rows[new])
                motions.update(rows[new], part.settle(motions.y[near] * part.scale / batch.scale[near]))
            fresh = motions.sticks & ~before
        return Survey(model, places, settings_at, sides, batch, motions)

    def ends(self, rounds: int) -> Border:
        """Where stick-slip ends, its brackets halved so many times."""
        nodes, at = self._edges(self.motions.sticks)
        scale = self.batch.scale[nodes[:, 0]]
        test = StickTest(self.model, at, self.motions.y[nodes[:, 0]] / scale)
        return Border(nodes, self._closed_in(test, nodes, rounds), test.shares * scale)

    def losses(self) -> Border:
        """Where steady sliding becomes unstable."""
        nodes, at = self._edges(self.batch.growth >= 0.0)
        places = self._closed_in(lambda *edge: growth_rates(self.model, at(*edge)) >= 0.0, nodes, CLOSEST)
        return Border(nodes, places, np.empty(0))

    def _edges(self, has: Bools) -> tuple[Rows, At]:
        """Edges (k, 2) of which the first node has something and the other has not, and the settings along them."""
        pairs = np.concatenate([np.empty((0, 2), dtype=np.intp), *self.sides])
        pairs = pairs[has[pairs[:, 0]] != has[pairs[:, 1]]]
        nodes = np.where(has[pairs[:, :1]], pairs, pairs[:, ::-1])

        def at(rows: Rows, shares: Array) -> Array:
            first, last = self.places[nodes[rows, 0]], self.places[nodes[rows, 1]]
            return self.settings_at(first + shares[:, None] * (last - first))

        return nodes, at

    def _closed_in(self, holds: Holds, nodes: Rows, rounds: int) -> Array:
        count = len(nodes)
        share = _halved(holds, np.arange(count), np.zeros(count), np.ones(count), rounds)[:, None]
        return np.asarray((1.0 - share) * self.places[nodes[:, 0]] + share * self.places[nodes[:, 1]])


class StickTest:
    """Whether rows stick and slip at places along a coordinate, each from where it stuck last, and until it has stuck
    from a rested contact too.

    Args:
        shares (n, n_y): rest states of stick-slip at the start, over the typical ones there.
    """

    def __init__(self, model: Model, at: At, shares: Array) -> None:
        self._model, self._at, self.shares, self._strange = model, at, shares.copy(), np.full(len(shares), True)

    def __call__(self, rows: Rows, places: Array) -> Bools:
        """Whether rows (k,) do at their places (k,)."""
        batch = CycleBatch(self._model, self._at(rows, places))
        motions = batch.settle(self.shares[rows] * batch.scale)
        left = np.flatnonzero(~motions.sticks & self._strange[rows])
        motions.update(left, batch.take(left).settle(batch.take(left).rested()))
        stuck = motions.sticks
        self._strange[rows[stuck]] = False
        self.shares[rows[stuck]] = (motions.y / batch.scale)[stuck]
        return stuck


def locate(holds: Holds, expected: Array, ahead: Array, rounds: int) -> Array:
    """Places (n,) at which something ends that holds before them in the directions `ahead` (n,) (1 or -1), NaN where
    there is none near to what is expected (n,)."""
    place, inside, outside = expected.copy(), np.full(expected.size, np.nan), np.full(expected.size, np.nan)
    step = FIRST
    for turn in range(DOUBLINGS + 1):
        rows = np.flatnonzero(np.isnan(inside) | np.isnan(outside))
        if not rows.size:
            break
        now = holds(rows, place[rows])
        inside[rows[now]], outside[rows[~now]] = place[rows[now]], place[rows[~now]]
        place[rows] += np.where(now, ahead[rows], -ahead[rows]) * step
        step *= 1.0 if turn == 0 else 2.0
    rows, ends = np.flatnonzero(np.isfinite(inside + outside)), np.full(expected.size, np.nan)
    ends[rows] = _halved(holds, rows, inside[rows], outside[rows], rounds)
    return ends


def _halved(holds: Holds, rows: Rows, inside: Array, outside: Array, rounds: int) -> Array:
    """Middles (k,) of the brackets (k,) of rows (k,), halved so many times."""
    for _ in range(rounds if rows.size else 0):
        middle = 0.5 * (inside + outside)
        now = holds(rows, middle)
        inside, outside = np.where(now, middle, inside), np.where(now, outside, middle)
    return np.asarray(0.5 * (inside + outside))


# Over the drive speed.


class Outcome(Enum):
    """What the pair does at an operating point; the value is the word in answers."""

    ALWAYS_STICKS = "always sticks"
    NEVER_STICKS = "never sticks"
    BISTABLE = "bistable"
    IRREGULAR = "sticks irregularly"
    UNDECIDED = "undecided"


def outcome_of(periodic: bool, sticks: bool, stable: bool) -> Outcome:
    """By whether the mass settles on an orbit, whether it sticks at all, and whether steady sliding is stable."""
    if periodic:
        return Outcome.BISTABLE if stable else Outcome.ALWAYS_STICKS
    if sticks:
        return Outcome.IRREGULAR
    return Outcome.NEVER_STICKS if stable else Outcome.UNDECIDED


@dataclass(frozen=True, eq=False)
class SpeedRange:
    """Drive speeds [m/s] at which stick-slip exists; a limit is None where it goes on to the end of the range searched.

    speeds (n,), rising: of the motions known in it; states (n, n_y): rest states of each.
    """

    low: float | None
    high: float | None
    speeds: Array = field(repr=False)
    states: Array = field(repr=False)

    def end(self, upper: bool) -> float | None:
        """Its upper or its lower limit [m/s]."""
        return self.high if upper else self.low

    def holds(self, speed: float) -> bool:
        """Whether a drive speed [m/s] lies in it."""
        return (self.low is None or self.low <= speed) and (self.high is None or speed <= self.high)


@dataclass(frozen=True)
class Window:
    """What the pair does between two drive speeds [m/s]: the word of its `Outcome`."""

    low: float = field(metadata={"key": "from"})
    high: float = field(metadata={"key": "to"})
    outcome: str


@dataclass(frozen=True, eq=False)
class Windows:
    """What one pair does under one normal force [N] at every drive speed within `searched` [m/s].

    sticking: where stick-slip exists; unstable: where steady sliding is unstable; both rising.
    """

    searched: tuple[float, float]
    sticking: tuple[SpeedRange, ...]
    unstable: tuple[tuple[float, float], ...]

    @property
    def end(self) -> float | None:
        """Drive speed [m/s] above which there is no stick-slip; None without stick-slip, or where it goes on."""
        return self.sticking[-1].high if self.sticking else None

    def near(self, speed: float) -> Array | None:
        """The known rest state (n_y,) nearest to a drive speed [m/s] in the range with stick-slip that holds it."""
        part = next((part for part in self.sticking if part.holds(speed)), None)
        return None if part is None else np.asarray(part.states[np.argmin(np.abs(np.log(part.speeds / speed)))])

    def listed(self) -> tuple[Window, ...]:
        """The windows in rising order, without a gap."""
        low, high = self.searched
        limits = [limit for part in self.sticking for limit in (part.low, part.high) if limit is not None]
        losses = [speed for pair in self.unstable for speed in pair]
        edges = sorted({low, high, *(speed for speed in (*limits, *losses) if low < speed < high)})
        out: list[Window] = []
        for first, last in pairwise(edges):
            middle = float(np.sqrt(first * last))
            sticks = any(part.holds(middle) for part in self.sticking)
            outcome = outcome_of(sticks, sticks, not any(a <= middle <= b for a, b in self.unstable)).value
            if out and out[-1].outcome == outcome:
                out[-1] = replace(out[-1], high=last)
            else:
                out.append(Window(first, last, outcome))
        return tuple(out)


def speed_windows(model: Model, settings: Array, nodes: tuple[float, ...] = ()) -> list[Windows]:
    """The windows of drive speed of pairs at settings (k, n_w), of whatever drive speed.

    Args:
        nodes: drive speeds [m/s] that are looked at too; the range searched is widened to hold them.

    Raises:
        SimulationError: the motion cannot be integrated, or there is no steady sliding.
    """
    own = [tuple(setting[:-1].tolist()) for setting in settings]
    different = tuple(dict.fromkeys(own))
    known = dict(zip(different, _windows(model, different, nodes), strict=True)) if own else {}
    return [known[pair] for pair in own]


def _places(model: Model, pair: tuple[float, ...], nodes: tuple[float, ...]) -> Array:
    """Logarithms of the drive speeds (n,) that are looked at, rising."""
    v = dict(zip((*model.parameter_names, "load"), pair, strict=True))
    kinetic = v["mu_k0"] + min(0.0, v.get("delta_mu_k", 0.0))
    fall = max(v["mu_s"] - kinetic, 1e-3 * v["mu_s"]) * v["load"]
    # The speed that the whole fall of friction gives the mass, and those at which weakening and ageing change.
    typical = fall / float(np.sqrt(v["mass"] * v["stiffness"]))
    slowest = min([typical, *([1.0 / v["a"]] if "a" in v else [])])
    if "t_cr" in v:
        slowest = min(slowest, fall / (v["stiffness"] * v["t_cr"]), v.get("D", np.inf) / v["t_cr"])
    ends = np.log([SLOWEST * slowest, FASTEST * typical, *nodes]) - np.log(typical)
    grid = SPACING * np.arange(np.floor(min(ends) / SPACING), np.ceil(max(ends) / SPACING) + 1)
    return np.union1d(np.log(typical) + grid, np.log(nodes))


def rows_of(lines: Sequence[Array]) -> tuple[Array, list[Rows]]:
    """Lines of nodes, rising, as one grid: places (n, 2) = number of the line, coordinate; and its sides."""
    places = np.concatenate([np.column_stack([np.full(line.size, i), line]) for i, line in enumerate(lines)])
    first = np.flatnonzero(np.diff(places[:, 0]) == 0.0)
    return places, [np.stack([first, first + 1], axis=1)]


@lru_cache(maxsize=64)  # the page asks again for those of a pair with every turn of its speed
def _windows(model: Model, pairs: tuple[tuple[float, ...], ...], nodes: tuple[float, ...]) -> list[Windows]:
    known, lines = np.array(pairs), [_places(model, pair, nodes) for pair in pairs]

    def settings_at(places: Array) -> Array:
        return np.column_stack([known[places[:, 0].astype(int)], np.exp(places[:, 1])])

    places, sides = rows_of(lines)
    survey = Survey.of(model, places, settings_at, sides)
    border, sticks, speeds = survey.ends(FINE), survey.motions.sticks, np.exp(places[:, 1])
    limits = np.exp(border.places[:, 1])
    # Stability of sliding costs next to nothing, and may be lost between two nodes only.
    fine, sides = rows_of([np.linspace(line[0], line[-1], FINER * line.size) for line in lines])
    batch = CycleBatch(model, settings_at(fine))
    losses = replace(survey, places=fine, sides=sides, batch=batch).losses()
    grows, lost = batch.growth >= 0.0, np.exp(losses.places[:, 1])
    out = []
    for number in range(len(pairs)):
        rows, ranges = np.flatnonzero(places[:, 0] == number), []
        for part in np.split(rows, np.flatnonzero(np.diff(sticks[rows])) + 1):
            if not sticks[part[0]]:
                continue
            below = np.flatnonzero(np.all(border.nodes == (part[0], part[0] - 1), axis=1))
            above = np.flatnonzero(np.all(border.nodes == (part[-1], part[-1] + 1), axis=1))
            states = np.concatenate([border.y[below], survey.motions.y[part], border.y[above]])
            low, high = (float(limits[side[0]]) if side.size else None for side in (below, above))
            ranges.append(SpeedRange(low, high, np.concatenate([limits[below], speeds[part], limits[above]]), states))
        whole, mine = speeds[rows[[0, -1]]], np.flatnonzero(fine[:, 0] == number)[[0, -1]]
        turns = np.sort(lost[fine[losses.nodes[:, 0], 0] == number])
        ends = np.concatenate([whole[:1][grows[mine[:1]]], turns, whole[1:][grows[mine[1:]]]]).tolist()
        unstable = tuple(zip(ends[::2], ends[1::2], strict=True))
        out.append(Windows((float(whole[0]), float(whole[1])), tuple(ranges), unstable))
    return out
