"""Windows of drive speed in which a pair sticks and slips, slides steadily, or does either.

The whole range of drive speeds is searched on a grid that the pair and the rig alone determine, so that the windows are
the same whatever speed was asked for (`orbit_search`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identify.model.model import Model
from identify.prediction.cycle import CycleMap
from identify.prediction.map_axes import Site, axis
from identify.prediction.map_grid import Plane
from identify.prediction.orbit import Orbit, patience
from identify.prediction.orbit_search import OrbitSearch, OrbitsOnGrid, losses_of_stability
from identify.prediction.path import Crossing, drive_speed_path, moved_orbit, trace
from identify.simulation.sliding import growth_rates

Array = NDArray[np.float64]

POINTS = 120  # at which it is looked whether steady sliding is stable
SPACING = 0.3  # of the logarithm of the drive speed between nodes
SLOWEST, FASTEST = 1e-2, 30.0  # range searched, over the slowest and the typical speed of pair and rig
MARGINS, FARTHEST = (0.03, 0.1, 0.3, 1.0), 5.0  # of the logarithm: before a limit expected, and beyond


class Outcome(Enum):
    """What the pair does at an operating point; the value is the word in answers."""

    ALWAYS_STICKS = "always sticks"
    NEVER_STICKS = "never sticks"
    BISTABLE = "bistable"
    IRREGULAR = "sticks irregularly"
    UNDECIDED = "undecided"


@dataclass(frozen=True, eq=False)
class StickSlipLimit:
    """A drive speed [m/s] at which stick-slip ends, and its derivatives (n_w,) by parameters, normal force and drive
    speed; NaN where they are not to be had. upper: whether it sticks below; orbit: the last one before a fold."""

    speed: float
    slopes: Array = field(repr=False)
    upper: bool
    orbit: Orbit | None = field(default=None, repr=False)

    def under(self, now: float, normal_force: float) -> StickSlipLimit:
        """The limit under another normal force [N] close to the one `now`, by its derivative."""
        power = float(self.slopes[-2]) * now / self.speed
        return replace(self, speed=self.speed * (normal_force / now) ** power)

    def of(self, map_: CycleMap) -> float | None:
        """The same limit [m/s] of another pair: the fold that the branch there comes to; None where it is not found."""
        if self.orbit is None:
            return None
        sign, moved = 1.0 if self.upper else -1.0, map_.setting(self.speed) - self.orbit.cycle.setting
        there = float(np.log(self.speed) + self.slopes[:-1] @ moved[:-1] / self.speed)
        gap = abs(float(np.log(self.orbit.drive_speed / self.speed)))
        for margin in (gap, *(m for m in MARGINS if m > gap)):
            place = there - sign * margin
            speed = float(np.exp(place))
            orbit = moved_orbit(self.orbit, map_, speed, patience(map_, speed))
            if orbit is not None:
                setting_path = drive_speed_path(orbit.cycle.setting)
                setting_path = setting_path if self.upper else setting_path.reversed()
                path = trace(map_, orbit, setting_path, sign * place, sign * place + FARTHEST)
                return None if path.end is None else float(np.exp(sign * path.end.place))
        return None


@dataclass(frozen=True)
class SpeedRange:
    """Drive speeds at which stick-slip exists; a limit is None where it goes on to the end of the range searched.

    speeds: [m/s], of the motions known in it, rising; orbits, rest states (n_y,): of each (None: irregular).
    """

    low: StickSlipLimit | None
    high: StickSlipLimit | None
    speeds: tuple[float, ...]
    orbits: tuple[Orbit | None, ...] = field(repr=False)
    states: tuple[Array, ...] = field(repr=False)

    def holds(self, speed: float) -> bool:
        """Whether a drive speed [m/s] lies in it."""
        return self.distance(speed) == 0.0

    def distance(self, speed: float) -> float:
        """How far a drive speed [m/s] lies outside, of its logarithm."""
        below = 0.0 if self.low is None else float(np.log(self.low.speed / speed))
        above = 0.0 if self.high is None else float(np.log(speed / self.high.speed))
        return max(below, above, 0.0)


@dataclass(frozen=True)
class Window:
    """Drive speeds from `low` to `high` [m/s] over which the outcome is the same."""

    low: float
    high: float
    outcome: Outcome


@dataclass(frozen=True)
class Windows:
    """What one pair does under one normal force [N] at every drive speed within `searched` [m/s].

    sticking: where stick-slip exists; unstable: where steady sliding is unstable; both rising.
    """

    normal_force: float
    searched: tuple[float, float]
    sticking: tuple[SpeedRange, ...]
    unstable: tuple[tuple[float, float], ...]

    @property
    def end(self) -> StickSlipLimit | None:
        """Above which there is no stick-slip; None without stick-slip, or where it goes on."""
        return self.sticking[-1].high if self.sticking else None

    def near(self, speed: float) -> tuple[Array, Orbit | None] | None:
        """The known motion nearest to a drive speed [m/s] in the range with stick-slip that holds it."""
        for part in self.sticking:
            if part.holds(speed):
                i = int(np.argmin(np.abs(np.log(np.array(part.speeds) / speed))))
                return part.states[i], part.orbits[i]
        return None

    def sticks(self, speed: float) -> bool:
        """Whether stick-slip exists at a drive speed [m/s]."""
        return any(part.holds(speed) for part in self.sticking)

    def listed(self) -> tuple[Window, ...]:
        """The windows in rising order, without a gap."""
        low, high = self.searched
        limits = [limit.speed for part in self.sticking for limit in (part.low, part.high) if limit is not None]
        losses = [speed for pair in self.unstable for speed in pair]
        edges = sorted({low, high, *(speed for speed in (*limits, *losses) if low < speed < high)})
        out: list[Window] = []
        for first, last in pairwise(edges):
            middle = float(np.sqrt(first * last))
            stable = not any(a <= middle <= b for a, b in self.unstable)
            if self.sticks(middle):
                outcome = Outcome.BISTABLE if stable else Outcome.ALWAYS_STICKS
            else:
                outcome = Outcome.NEVER_STICKS if stable else Outcome.UNDECIDED
            if out and out[-1].outcome is outcome:
                out[-1] = replace(out[-1], high=last)
            else:
                out.append(Window(first, last, outcome))
        return tuple(out)

    def under(self, map_: CycleMap) -> Windows:
        """The windows under the normal force of another map of the same pair, close by: ends moved by derivatives."""
        if map_.normal_force == self.normal_force:
            return self
        now, force = self.normal_force, map_.normal_force
        moved = [
            replace(part, low=part.low and part.low.under(now, force), high=part.high and part.high.under(now, force))
            for part in self.sticking
        ]
        return Windows(map_.normal_force, self.searched, tuple(moved), unstable_speeds(map_, *self.searched))


def outcome_of(orbit: Orbit | None, sticks: bool, stable: bool) -> Outcome:
    """By the orbit there, whether the mass sticks at all, and whether steady sliding is stable."""
    if orbit is not None and orbit.stable:
        return Outcome.BISTABLE if stable else Outcome.ALWAYS_STICKS
    if orbit is not None or sticks:
        return Outcome.IRREGULAR
    return Outcome.NEVER_STICKS if stable else Outcome.UNDECIDED


def typical_speed(map_: CycleMap) -> float:
    """Speed that the whole fall of friction gives the mass, (mu_s - mu_k) F_n / sqrt(m k) [m/s]."""
    return _fall(map_) / float(np.sqrt(_value(map_, "mass") * _value(map_, "stiffness")))


def _value(map_: CycleMap, name: str) -> float:
    return float(map_.p[map_.names.index(name)])


def _fall(map_: CycleMap) -> float:
    """Force [N] by which friction can fall."""
    weakening = _value(map_, "delta_mu_k") if "delta_mu_k" in map_.names else 0.0
    kinetic, static = _value(map_, "mu_k0") + min(0.0, weakening), _value(map_, "mu_s")
    return max(static - kinetic, 1e-3 * static) * map_.normal_force


def _slowest(map_: CycleMap) -> float:
    """Drive speed [m/s] below which neither ageing nor weakening nor the swing of the mass changes any more."""
    speeds = [typical_speed(map_)]
    if "a" in map_.names:
        speeds.append(1.0 / _value(map_, "a"))
    if "t_cr" in map_.names:
        speeds.append(_fall(map_) / (_value(map_, "stiffness") * _value(map_, "t_cr")))
        if "D" in map_.names:
            speeds.append(_value(map_, "D") / _value(map_, "t_cr"))
    return min(speeds)


def speed_windows(map_: CycleMap, asked: Sequence[float] = ()) -> Windows:
    """The windows of drive speed of a pair under the normal force of its map.

    Args:
        asked: drive speeds [m/s] that are nodes too; the range searched is widened to hold them.

    Raises:
        SimulationError: the motion cannot be integrated, or there is no steady sliding.
    """
    return _windows(map_.model, map_.normal_force, map_.p.tobytes(), map_.rtol, tuple(asked))


@lru_cache(maxsize=32)  # a fit and its report, and the page with every turn of its speed, ask again for those of a pair
def _windows(model: Model, normal_force: float, p: bytes, rtol: float, asked: tuple[float, ...]) -> Windows:
    map_ = CycleMap(model, normal_force, np.frombuffer(p), rtol)
    anchor = float(np.log(typical_speed(map_)))
    ends = [np.log(SLOWEST * _slowest(map_)), anchor + np.log(FASTEST), *np.log(asked)]
    first, last = (np.floor((min(ends) - anchor) / SPACING), np.ceil((max(ends) - anchor) / SPACING))
    places = np.union1d(anchor + SPACING * np.arange(first, last + 1), np.log(asked))
    grid = _speed_row(map_, places)
    found = OrbitSearch(grid, map_, growth_rates(map_.model, grid.settings[0])[None, :]).run()
    searched = float(np.exp(places[0])), float(np.exp(places[-1]))
    return Windows(map_.normal_force, searched, _ranges(grid, found), unstable_speeds(map_, *searched))


def _speed_row(map_: CycleMap, places: Array) -> Plane:
    """The grid over drive speed alone, at logarithms `places` (n,) of it."""
    values = dict(zip(map_.model.parameter_names, map_.p.tolist(), strict=True))
    site = Site(map_.model, values, float(np.exp(places[0])), map_.normal_force)
    load = axis(site, "normal_force")
    settings = np.stack([map_.setting(speed) for speed in np.exp(places).tolist()])[None]
    admitted = np.ones(settings.shape[:2], dtype=bool)
    return Plane(site, axis(site, "drive_speed"), load, places, np.array([load.place(load.value)]), settings, admitted)


def unstable_speeds(map_: CycleMap, lowest: float, highest: float) -> tuple[tuple[float, float], ...]:
    """Intervals of drive speed [m/s] within [lowest, highest] in which steady sliding is unstable.

    An interval narrower than the grid (logarithmic, `POINTS`) is missed. Ends at `lowest` or `highest` are those of the
    search.
    """
    grid = _speed_row(map_, np.linspace(np.log(lowest), np.log(highest), POINTS))
    growth = growth_rates(map_.model, grid.settings[0])[None]
    losses = sorted(float(np.exp(loss.place)) for loss in losses_of_stability(grid, growth).values())
    ends = [lowest] * bool(growth[0, 0] >= 0.0) + losses + [highest] * bool(growth[0, -1] >= 0.0)
    return tuple(zip(ends[::2], ends[1::2], strict=True))


def _ranges(grid: Plane, found: OrbitsOnGrid) -> tuple[SpeedRange, ...]:
    """The ranges of drive speed with stick-slip."""
    sticks, speeds = found.sticks(grid.shape)[0], grid.x_values.tolist()
    starts = np.flatnonzero(sticks & ~np.append(False, sticks[:-1])).tolist()
    stops = np.flatnonzero(sticks & ~np.append(sticks[1:], False)).tolist()
    out = []
    for first, last in zip(starts, stops, strict=True):
        nodes = [(0, i) for i in range(first, last + 1)]
        orbits = [found.orbits.get(node) for node in nodes]
        states = [found.irregular[n] if orbit is None else orbit.y for n, orbit in zip(nodes, orbits, strict=True)]
        low = None if first == 0 else _limit(grid, found, first, first - 1)
        high = None if last + 1 == sticks.size else _limit(grid, found, last, last + 1)
        out.append(SpeedRange(low, high, tuple(speeds[first : last + 1]), tuple(orbits), tuple(states)))
    return tuple(out)


def _limit(grid: Plane, found: OrbitsOnGrid, inside: int, outside: int) -> StickSlipLimit:
    """Where stick-slip ends between a node that has it and its neighbour that has not."""
    middle = 0.5 * float(grid.x_places[inside] + grid.x_places[outside])
    unknown = Crossing(middle, np.full(grid.settings.shape[-1], np.nan))  # beside motions that cannot be integrated
    edge = ("x", 0, min(inside, outside))
    end = found.ends.get(edge, unknown)
    speed = float(np.exp(end.place))
    return StickSlipLimit(speed, speed * end.slopes, outside > inside, found.last.get(edge))
