"""Windows of drive speed in which a pair sticks and slips, slides steadily, or does either.

The whole range of drive speeds is searched on a grid that the pair and the rig alone determine, so that the windows are
the same whatever speed is asked for; their ends are closed in on by bisection.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from identify.model.model import Model
from identify.prediction.search import CLOSEST, Survey, bisect, growing, in_a_row
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

    speeds (n,), rising: of the motions known in it; states (n, n_y): rest states of each.
    """

    low: float | None
    high: float | None
    speeds: Array = field(repr=False)
    states: Array = field(repr=False)

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
            outcome = outcome_of(sticks, sticks, not any(a <= middle <= b for a, b in self.unstable))
            if out and out[-1].outcome is outcome:
                out[-1] = replace(out[-1], high=last)
            else:
                out.append(Window(first, last, outcome))
        return tuple(out)


def _speeds(model: Model, w: Array) -> tuple[float, float]:
    """Drive speed [m/s] below which neither ageing nor weakening nor the swing of the mass changes any more, and the
    speed that the whole fall of friction gives the mass, (mu_s - mu_k) F_n / sqrt(m k), at w (n_w,)."""
    v = dict(zip(model.parameter_names, w[:-2].tolist(), strict=True))
    kinetic = v["mu_k0"] + min(0.0, v.get("delta_mu_k", 0.0))
    fall = max(v["mu_s"] - kinetic, 1e-3 * v["mu_s"]) * float(w[-2])
    typical = fall / float(np.sqrt(v["mass"] * v["stiffness"]))
    speeds = [typical, *([1.0 / v["a"]] if "a" in v else [])]
    if "t_cr" in v:
        speeds += [fall / (v["stiffness"] * v["t_cr"]), *([v["D"] / v["t_cr"]] if "D" in v else [])]
    return min(speeds), typical


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
    slowest, typical = _speeds(model, w)
    anchor = float(np.log(typical))
    ends = [np.log(SLOWEST * slowest), anchor + np.log(FASTEST), *np.log(asked)]
    first, last = (np.floor((min(ends) - anchor) / SPACING), np.ceil((max(ends) - anchor) / SPACING))
    places = np.union1d(anchor + SPACING * np.arange(first, last + 1), np.log(asked))

    def settings_at(places: Array) -> Array:
        return np.column_stack([np.tile(w[:-1], (len(places), 1)), np.exp(places)])

    survey = Survey.of(model, places[:, None], settings_at, in_a_row(places.size))
    border, sticks = survey.ends(HALVINGS), survey.motions.sticks
    limits = np.exp(border.places[:, 0])
    ranges = []
    for part in np.split(np.arange(places.size), np.flatnonzero(np.diff(sticks)) + 1):
        if not sticks[part[0]]:
            continue
        low, high = (np.flatnonzero(np.all(border.nodes == pair, axis=1)) for pair in _beyond(part))
        mine = np.concatenate([low, high])
        speeds = np.append(np.exp(places[part]), limits[mine])
        order = np.argsort(speeds, kind="stable")
        states = np.concatenate([survey.motions.y[part], border.y[mine]])[order]
        found = [float(limits[side[0]]) if side.size else None for side in (low, high)]
        ranges.append(SpeedRange(found[0], found[1], speeds[order], states))
    fine = np.linspace(places[0], places[-1], POINTS)
    unstable = _unstable(model, lambda _, at: settings_at(at[:, None]), fine)
    return Windows((float(np.exp(places[0])), float(np.exp(places[-1]))), tuple(ranges), unstable)


def _beyond(part: NDArray[np.intp]) -> tuple[tuple[int, int], tuple[int, int]]:
    """The edges that lead out of a row of nodes below and above."""
    first, last = int(part[0]), int(part[-1])
    return (first, first - 1), (last, last + 1)


def _unstable(
    model: Model, at: Callable[[NDArray[np.intp], Array], Array], places: Array
) -> tuple[tuple[float, float], ...]:
    """Drive speeds [m/s] between which steady sliding is unstable; one narrower than the grid (n,) is missed."""
    grows = growth_rates(model, at(np.arange(places.size), places)) >= 0.0
    edge = np.flatnonzero(grows[1:] != grows[:-1])
    inside, outside = np.where(grows[edge], edge, edge + 1), np.where(grows[edge], edge + 1, edge)
    losses = np.mean(bisect(growing(model, at), places[inside], places[outside], CLOSEST), axis=0)
    ends = np.exp([*places[:1][grows[:1]], *losses, *places[-1:][grows[-1:]]]).tolist()
    return tuple(zip(ends[::2], ends[1::2], strict=True))
