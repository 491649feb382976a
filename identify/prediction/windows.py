"""Windows of drive speed in which a pair sticks and slips, slides steadily, or does either.

The whole range of drive speeds is searched on a grid that the pair and the rig alone determine, so that the windows are
the same whatever speed was asked for. At every node the motion is started from a rested contact (the strongest first
kick) and from the stick-slip of its neighbours; a stable orbit is followed to both sides through folds of its branch;
where the orbit is lost or unstable (flips, grazing, irregular motion) the motion itself is followed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identify.prediction.cycle import SLIDES_AFTER, CycleMap
from identify.prediction.orbit import Orbit, SettledMotion, settle
from identify.prediction.path import Crossing, OrbitPath, advance, drive_speed_path, moved_orbit, trace
from identify.simulation.sliding import growth_rates, unstable_speeds

Array = NDArray[np.float64]

SPACING = 0.2  # of the logarithm of the drive speed between nodes
SLOWEST, FASTEST = 1e-2, 30.0  # range searched, over the slowest and the typical speed of pair and rig
BEYOND = 1e-2  # of the logarithm: where stick-slip is looked for beyond the end of a branch
MARGINS, FARTHEST = (0.03, 0.1, 0.3, 1.0), 5.0  # of the logarithm: before a limit expected, and beyond
HALVINGS = 9  # of the gap between two nodes, where a motion ends in no fold
GROWN = 25.0  # e-foldings after which a disturbance of steady sliding is taken to have come to rest
LONGEST_PATIENCE = 100.0  # half periods


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
        unstable = unstable_speeds(map_.model, map_.p, map_.normal_force, *self.searched)
        return Windows(map_.normal_force, self.searched, tuple(moved), unstable)


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


def long_enough(growth: float) -> float:
    """Half periods until a disturbance of steady sliding that grows by e^`growth` in each has come to rest."""
    return float(np.clip(GROWN / growth, SLIDES_AFTER, LONGEST_PATIENCE)) if growth > 0 else SLIDES_AFTER


def patience(map_: CycleMap, speed: float) -> float:
    """Half periods after which a mass that has not come to rest at this drive speed [m/s] is taken to slide on."""
    rates = growth_rates(map_.model, map_.p, np.array([speed]), map_.normal_force)
    return long_enough(float(rates[0]) * map_.half_period)


def speed_windows(map_: CycleMap, asked: Sequence[float] = ()) -> Windows:
    """The windows of drive speed of a pair under the normal force of its map.

    Args:
        asked: drive speeds [m/s] that are nodes too; the range searched is widened to hold them.

    Raises:
        SimulationError: the motion cannot be integrated, or there is no steady sliding.
    """
    anchor = float(np.log(typical_speed(map_)))
    ends = [np.log(SLOWEST * _slowest(map_)), anchor + np.log(FASTEST), *np.log(asked)]
    first, last = (np.floor((min(ends) - anchor) / SPACING), np.ceil((max(ends) - anchor) / SPACING))
    places = np.union1d(anchor + SPACING * np.arange(first, last + 1), np.log(asked))
    sweep = _Sweep(map_, places)
    sweep.run()
    searched = float(np.exp(places[0])), float(np.exp(places[-1]))
    unstable = unstable_speeds(map_.model, map_.p, map_.normal_force, *searched)
    return Windows(map_.normal_force, searched, sweep.ranges(), unstable)


@dataclass(frozen=True)
class _Motion:
    """Stick-slip at a node, or next to it on the branch of a stable orbit."""

    state: Array
    orbit: Orbit | None


class _Sweep:
    """The search over the nodes `places` (n,), logarithms of the drive speed in m/s."""

    def __init__(self, map_: CycleMap, places: Array) -> None:
        self._map, self._places = map_, places
        growth = growth_rates(map_.model, map_.p, np.exp(places), map_.normal_force)
        self._patience = [long_enough(float(rate) * map_.half_period) for rate in growth]
        self._motions: list[_Motion | None] = [None] * places.size
        self._folds: list[tuple[int, Crossing, Orbit]] = []  # to faster (+1) or slower (-1) drives, orbit before

    def run(self) -> None:
        """Motions at every node that has stick-slip."""
        count = len(self._motions)
        for i in range(count):
            if self._motions[i] is None:
                self._start(i, None)
        changed = True
        while changed:
            changed = False
            for order, step in ((range(1, count), -1), (range(count - 2, -1, -1), 1)):
                for i in order:
                    beside = self._motions[i + step]
                    if self._motions[i] is None and beside is not None:
                        changed |= self._start(i, beside.state)

    def _settle(self, place: float, y: Array | None, patience: float) -> SettledMotion:
        return settle(self._map, float(np.exp(place)), y, patience=patience)

    def _start(self, i: int, y: Array | None) -> bool:
        """Look at the motion at a node from rest state y; whether it goes on sticking."""
        settled = self._settle(self._places[i], y, self._patience[i])
        if settled.sticks:
            self._motions[i] = _Motion(settled.state, settled.orbit)
            if settled.orbit is not None and settled.orbit.stable:
                for sign in (1, -1):
                    self._spread(i, settled.orbit, sign)
        return settled.sticks

    def _spread(self, i: int, orbit: Orbit, sign: int) -> None:
        """Follow the branch of a stable orbit at a node to faster (+1) or slower (-1) drives, as far as it is stable
        and nothing is known."""
        nodes = range(i + sign, len(self._motions) if sign > 0 else -1, sign)
        known = next((j for j in nodes if self._motions[j] is not None), nodes[-1] if nodes else None)
        if known is None:
            return
        setting_path = drive_speed_path(orbit.cycle.setting)
        setting_path = setting_path if sign > 0 else setting_path.reversed()
        path = trace(self._map, orbit, setting_path, sign * float(self._places[i]), sign * float(self._places[known]))
        kept = next((n for n, o in enumerate(path.orbits) if n and not o.stable), len(path.orbits))
        reached = path.places[kept - 1]
        if path.end is not None and kept == len(path.orbits):
            reached = path.end.place
            self._folds.append((sign, path.end, path.orbits[-1]))
        for j in nodes:
            here = sign * float(self._places[j])
            if here > reached:
                break
            if self._motions[j] is None:
                near = path.orbits[int(np.searchsorted(path.places[:kept], here, side="right")) - 1]
                self._motions[j] = _Motion(near.y, near)

    def ranges(self) -> tuple[SpeedRange, ...]:
        """The ranges of drive speed with stick-slip."""
        sticks = np.array([motion is not None for motion in self._motions])
        starts = np.flatnonzero(sticks & ~np.append(False, sticks[:-1]))
        stops = np.flatnonzero(sticks & ~np.append(sticks[1:], False))
        out = []
        for first, last in zip(starts.tolist(), stops.tolist(), strict=True):
            low = self._limit(first, first - 1) if first > 0 else None
            high = self._limit(last, last + 1) if last + 1 < sticks.size else None
            motions = [m for m in self._motions[first : last + 1] if m is not None]
            out.append(
                SpeedRange(
                    low,
                    high,
                    tuple(np.exp(self._places[first : last + 1]).tolist()),
                    tuple(m.orbit for m in motions),
                    tuple(m.state for m in motions),
                )
            )
        return tuple(out)

    def _limit(self, inside: int, outside: int) -> StickSlipLimit:
        """Where stick-slip ends between a node that has it and its neighbour that has not: at the fold or the fading of
        a branch, or where the motion itself, followed by halving the gap, sticks no more."""
        sign, motion = outside - inside, self._motions[inside]
        assert motion is not None
        sticks, slides, state = float(self._places[inside]), float(self._places[outside]), motion.state
        wait = max(self._patience[inside], self._patience[outside])
        ending = self._ending(sign, sign * sticks, sign * slides, motion)
        if ending is not None:
            end, orbit = ending
            place = sign * end.place
            beyond = place + sign * BEYOND
            settled = None if sign * (slides - beyond) <= 0.0 else self._settle(beyond, orbit.y, wait)
            if settled is None or not settled.sticks:
                speed = float(np.exp(place))
                return StickSlipLimit(speed, speed * sign * end.slopes, sign > 0, orbit)
            sticks, state = beyond, settled.state
        for _ in range(HALVINGS):
            middle = 0.5 * (sticks + slides)
            settled = self._settle(middle, state, wait)
            if settled.sticks:
                sticks, state = middle, settled.state
            else:
                slides = middle
        return StickSlipLimit(
            float(np.exp(0.5 * (sticks + slides))), np.full(self._map.setting(1.0).size, np.nan), sign > 0
        )

    def _ending(self, sign: int, first: float, last: float, motion: _Motion) -> tuple[Crossing, Orbit] | None:
        """The end of a branch between two coordinates, and its last orbit: a fold that was met, else that of the
        orbit of a motion."""
        met = [(end, orbit) for way, end, orbit in self._folds if way == sign and first <= end.place <= last]
        if met:
            return max(met, key=lambda each: each[0].place)
        orbit = motion.orbit
        if orbit is None or not orbit.stable:
            return None
        setting_path = drive_speed_path(orbit.cycle.setting)
        setting_path = setting_path if sign > 0 else setting_path.reversed()
        start = OrbitPath((orbit,), (sign * float(np.log(orbit.drive_speed)),), None)
        path = advance(self._map, start, setting_path, last, patience)
        return None if path.ending is None or not path.orbits[-1].stable else (path.ending, path.orbits[-1])
