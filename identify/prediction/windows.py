"""Windows of drive speed in which a pair sticks and slips, slides steadily, or does either.

The whole range of drive speeds is searched on a grid that the pair and the rig alone determine, so that the windows are
the same whatever speed is asked for; their ends are closed in on by bisection.
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
from identify.prediction.batch import CycleBatch
from identify.prediction.search import CLOSEST, StickTest, bisect, explore
from identify.simulation.sliding import growth_rates

Array = NDArray[np.float64]

POINTS = 120  # at which it is looked whether steady sliding is stable
SPACING = 0.3  # of the logarithm of the drive speed between nodes
SLOWEST, FASTEST = 1e-2, 30.0  # range searched, over the slowest and the typical speed of pair and rig
HALVINGS = 12  # of the spacing, towards an end of stick-slip


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

    speeds (n,), rising: of the motions known in it; states (n, n_y): rest states of each; periodic (n,): whether it
    settles.
    """

    low: float | None
    high: float | None
    speeds: Array = field(repr=False)
    states: Array = field(repr=False)
    periodic: NDArray[np.bool_] = field(repr=False)

    def holds(self, speed: float) -> bool:
        """Whether a drive speed [m/s] lies in it."""
        return (self.low is None or self.low <= speed) and (self.high is None or speed <= self.high)


@dataclass(frozen=True)
class Window:
    """Drive speeds from `low` to `high` [m/s] over which the outcome is the same."""

    low: float
    high: float
    outcome: Outcome


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
        for part in self.sticking:
            if part.holds(speed):
                return np.asarray(part.states[int(np.argmin(np.abs(np.log(part.speeds / speed))))])
        return None

    def sticks(self, speed: float) -> bool:
        """Whether stick-slip exists at a drive speed [m/s]."""
        return any(part.holds(speed) for part in self.sticking)

    def listed(self) -> tuple[Window, ...]:
        """The windows in rising order, without a gap."""
        low, high = self.searched
        limits = [limit for part in self.sticking for limit in (part.low, part.high) if limit is not None]
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


def typical_speed(model: Model, w: Array) -> float:
    """Speed [m/s] that the whole fall of friction gives the mass, (mu_s - mu_k) F_n / sqrt(m k), at w (n_w,)."""
    v = dict(zip(model.parameter_names, w[:-2].tolist(), strict=True))
    return _fall(v, float(w[-2])) / float(np.sqrt(v["mass"] * v["stiffness"]))


def _fall(v: dict[str, float], normal_force: float) -> float:
    """Force [N] by which friction can fall."""
    kinetic = v["mu_k0"] + min(0.0, v.get("delta_mu_k", 0.0))
    return max(v["mu_s"] - kinetic, 1e-3 * v["mu_s"]) * normal_force


def _slowest(model: Model, w: Array) -> float:
    """Drive speed [m/s] below which neither ageing nor weakening nor the swing of the mass changes any more."""
    v, speeds = dict(zip(model.parameter_names, w[:-2].tolist(), strict=True)), [typical_speed(model, w)]
    if "a" in v:
        speeds.append(1.0 / v["a"])
    if "t_cr" in v:
        speeds.append(_fall(v, float(w[-2])) / (v["stiffness"] * v["t_cr"]))
        if "D" in v:
            speeds.append(v["D"] / v["t_cr"])
    return min(speeds)


def speed_windows(model: Model, setting: Array, asked: Sequence[float] = ()) -> Windows:
    """The windows of drive speed of a pair at a setting (n_w,), of whatever drive speed.

    Args:
        asked: drive speeds [m/s] that are nodes too; the range searched is widened to hold them.

    Raises:
        SimulationError: the motion cannot be integrated, or there is no steady sliding.
    """
    return _windows(model, np.append(setting[:-1], 1.0).tobytes(), tuple(asked))


@lru_cache(maxsize=64)  # a fit and its report, and the page with every turn of its speed, ask again for those of a pair
def _windows(model: Model, setting: bytes, asked: tuple[float, ...]) -> Windows:
    w = np.frombuffer(setting)
    anchor = float(np.log(typical_speed(model, w)))
    ends = [np.log(SLOWEST * _slowest(model, w)), anchor + np.log(FASTEST), *np.log(asked)]
    first, last = (np.floor((min(ends) - anchor) / SPACING), np.ceil((max(ends) - anchor) / SPACING))
    places = np.union1d(anchor + SPACING * np.arange(first, last + 1), np.log(asked))
    n = places.size

    def at(_rows: NDArray[np.intp], places: Array) -> Array:
        settings = np.tile(w, (places.size, 1))
        settings[:, -1] = np.exp(places)
        return settings

    batch, number = CycleBatch(model, at(np.arange(n), places)), np.arange(n)
    found = explore(batch, np.stack([number - 1, np.where(number + 1 < n, number + 1, -1)], axis=1))
    changes = np.diff(np.concatenate([[0], found.sticks.astype(int), [0]]))
    starts, stops = np.flatnonzero(changes > 0), np.flatnonzero(changes < 0) - 1
    inside, outside = np.concatenate([starts, stops]), np.concatenate([starts - 1, stops + 1])
    ended = (outside >= 0) & (outside < n)
    inner = inside[ended]
    test = StickTest(model, at, found.y[inner], batch.scale[inner])
    last, beyond = bisect(test, places[inner], places[outside[ended]], HALVINGS)
    limits = np.full(inside.size, np.nan)
    limits[ended] = np.exp(0.5 * (last + beyond))
    closest = test.shares * CycleBatch(model, at(inner, last)).scale
    ranges = []
    for k, (start, stop) in enumerate(zip(starts, stops, strict=True)):
        known = np.arange(start, stop + 1)
        mine = np.isin(np.flatnonzero(ended), [k, k + starts.size])
        speeds = np.exp(np.concatenate([places[known], last[mine]]))
        order = np.argsort(speeds, kind="stable")
        low, high = (None if np.isnan(limits[i]) else float(limits[i]) for i in (k, k + starts.size))
        states = np.concatenate([found.y[known], closest[mine]])[order]
        periodic = np.concatenate([found.periodic[known], test.periodic[mine]])[order]
        ranges.append(SpeedRange(low, high, speeds[order], states, periodic))
    searched = float(np.exp(places[0])), float(np.exp(places[-1]))
    return Windows(searched, tuple(ranges), unstable_speeds(model, w, *searched))


def unstable_speeds(model: Model, setting: Array, lowest: float, highest: float) -> tuple[tuple[float, float], ...]:
    """Intervals of drive speed [m/s] within [lowest, highest] in which steady sliding is unstable, at a setting (n_w,).

    An interval narrower than the grid (logarithmic, `POINTS`) is missed. Ends at `lowest` or `highest` are those of the
    search.
    """

    def growing(_rows: NDArray[np.intp], places: Array) -> NDArray[np.bool_]:
        settings = np.tile(setting, (places.size, 1))
        settings[:, -1] = np.exp(places)
        return growth_rates(model, settings) >= 0.0

    places = np.linspace(np.log(lowest), np.log(highest), POINTS)
    grows = growing(np.arange(POINTS), places)
    at = np.flatnonzero(grows[1:] != grows[:-1])
    inside, outside = np.where(grows[at], at, at + 1), np.where(grows[at], at + 1, at)
    inner, outer = bisect(growing, places[inside], places[outside], CLOSEST)
    losses = np.exp(0.5 * (inner + outer)).tolist()
    ends = [lowest] * bool(grows[0]) + losses + [highest] * bool(grows[-1])
    return tuple(zip(ends[::2], ends[1::2], strict=True))
