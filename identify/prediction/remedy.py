"""The nearest value of one rig quantity at which sliding turns steady, or stops being so: the composed model asked.

Steady means that small disturbances of sliding die out and that no stick-slip is found, neither from a rested contact
(the strongest kick a start can give) nor from the stick-slip of the last value that had it. Outwards in both
directions from the value there is, in steps of a factor; then the step is halved, and the limit polished along its
tangent, which also tells how it moves with everything else.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from identify.prediction.course import drive_course
from identify.prediction.cycle import CycleMap
from identify.prediction.orbit import Orbit, close, settle
from identify.prediction.sliding import clearances, growth_rates
from identify.prediction.trace import End, trace
from identify.prediction.windows import long_enough

Array = NDArray[np.float64]

Kind = Literal["end of stick-slip", "loss of stability", "wear of the contact"]
TIED = {"stiffness_at_zeta": ("stiffness", "damping")}  # settings that one quantity moves in proportion
STEP = 1.25  # factor between the values looked at
HALVINGS = 22
NEAR = 1e-4  # share of the value by which the stick-slip that is followed to its end lies inside
DIFFERENCE, LEAST = 1e-5, 1e-6  # relative step of a difference, and absolute for what is zero
REACH = 0.5  # of the logarithm of the drive speed, within which that end is looked for
POLISHED = 0.02  # share by which the end of stick-slip may differ from where it was found


@dataclass(frozen=True)
class Turn:
    """A value [SI] of a quantity at which the answer changes; rising: whether it is steady above; kind of limit;
    slopes (n_w,) by parameters, normal force and drive speed, NaN where they are not to be had."""

    value: float
    rising: bool
    kind: Kind
    slopes: Array


@dataclass(frozen=True)
class _State:
    steady: bool
    growth: float
    orbit: Orbit | None


class Search:
    """An operating point whose settings are moved one at a time: setting w (n_w,) as `CycleMap.setting`."""

    def __init__(self, map_: CycleMap, drive_speed: float, orbit: Orbit | None = None) -> None:
        self.map, self.w = map_, map_.setting(drive_speed)
        self.here = self.state(self.w, orbit)

    def state(self, w: Array, near: Orbit | None = None) -> _State:
        """What happens at a setting; `near` is a stick-slip close by."""
        growth = float(self._growth(w[None, :])[0])
        map_, speed = self.map.at(w), float(w[-1])
        wait = long_enough(growth * map_.half_period)
        orbit = close(map_, near.y, speed, patience=wait) if near is not None else None
        if orbit is not None and orbit.stable:
            return _State(False, growth, orbit)
        settled = settle(map_, speed, patience=wait)
        return _State(growth < 0 and not settled.sticks, growth, settled.orbit)

    def columns(self, name: str) -> list[int]:
        """The places in a setting that a quantity moves: its own, or those of TIED, whose first it is told by."""
        return [self.map.names.index(n) for n in TIED.get(name, (name,))]

    def now(self, name: str) -> float:
        """The value a quantity has at the operating point."""
        return float(self.w[self.columns(name)[0]])

    def moved(self, name: str, value: float) -> Array:
        """The setting with one quantity at another value."""
        w, columns = self.w.copy(), self.columns(name)
        w[columns[1:]] *= value / self.now(name)
        w[columns[0]] = value
        return w

    def turn(self, name: str, low: float, high: float) -> Turn | None:
        """The nearest value between low and high at which the answer changes; None where it stays the same."""
        now, steps = self.now(name), _outwards(self.now(name), low, high)
        growth = self._growth(np.stack([self.moved(name, after) for _, after in steps])) if steps else np.empty(0)
        for (before, after), rate in zip(steps, growth, strict=True):
            if rate >= 0 and not self.here.steady:
                continue  # not steady there either
            state = self.state(self.moved(name, after), self.here.orbit if before == now else None)
            if state.steady != self.here.steady:
                return self._narrowed(name, before, after)
        return None

    def _growth(self, w: Array) -> Array:
        return growth_rates(self.map.model, np.ascontiguousarray(w[:, :-2]), w[:, -1], w[:, -2])

    def _narrowed(self, name: str, near: float, far: float) -> Turn:
        """The change between two values, of which `near` answers as the operating point does."""
        steady_near = self.here.steady
        states = {steady_near: self.state(self.moved(name, near)), not steady_near: self.state(self.moved(name, far))}
        for _ in range(HALVINGS):
            middle = float(np.sqrt(near * far))
            state = self.state(self.moved(name, middle), states[False].orbit)
            states[state.steady] = state
            near, far = (middle, far) if state.steady == steady_near else (near, middle)
        loud, quiet = (far, near) if steady_near else (near, far)
        if states[False].growth >= 0:  # unstable right up to the limit
            return self._by_stability(name, loud, quiet)
        value, slopes = self._by_fold(name, float(np.sqrt(loud * quiet)), states[False].orbit)
        return Turn(value, quiet > loud, "end of stick-slip", slopes)

    def _by_stability(self, name: str, loud: float, quiet: float) -> Turn:
        value = float(np.sqrt(loud * quiet))
        w = self.moved(name, value)
        ends = self._growth(np.stack([self.moved(name, loud), self.moved(name, quiet)]))
        far = self._growth(np.stack([self.moved(name, value * (1 + s)) for s in (-1e-3, 1e-3)]))
        jumps = abs(ends[1] - ends[0]) > 0.5 * abs(far[1] - far[0])
        steps = DIFFERENCE * np.where(w == 0.0, LEAST / DIFFERENCE, np.abs(w))
        each = np.concatenate([w + np.diag(steps), w - np.diag(steps)])
        if jumps:
            rates = clearances(self.map.model, np.ascontiguousarray(each[:, :-2]), each[:, -1], each[:, -2])
        else:
            rates = self._growth(each)
        by = (rates[: w.size] - rates[w.size :]) / (2.0 * steps)
        with np.errstate(all="ignore"):
            slopes = -by / self._rate(name, by, w, value)
        return Turn(value, quiet > loud, "wear of the contact" if jumps else "loss of stability", slopes)

    def _rate(self, name: str, by: Array, w: Array, value: float) -> float:
        """Derivative by a quantity, from those by the settings it moves."""
        columns = self.columns(name)
        return float(by[columns] @ w[columns]) / value

    def _by_fold(self, name: str, value: float, orbit: Orbit | None) -> tuple[float, Array]:
        """Limit and slopes from the fold over drive speed at the value found; NaN slopes without one."""
        unknown = value, np.full(self.w.size, np.nan)
        if orbit is None:
            return unknown
        speed = float(self.w[-1])
        at = self.w if name == "drive_speed" else self.moved(name, value)
        end = self._fold(self.map.at(at), orbit)
        if end is None:
            return unknown
        ending, slopes = float(np.exp(end.place)), np.exp(end.place) * end.slopes
        if name == "drive_speed":
            slopes[-1] = np.nan
            return ending, slopes
        slopes[-1] = -1.0  # the end of stick-slip is to stay at the drive speed
        by = self._rate(name, slopes, at, value)
        with np.errstate(all="ignore"):
            better = value * float(np.exp((speed - ending) / (by * value)))
            slopes = -slopes / by
        return (better, slopes) if abs(better / value - 1) < POLISHED else (value, slopes)

    def _fold(self, map_: CycleMap, orbit: Orbit) -> End | None:
        """The fold over the logarithm of the drive speed nearest to an orbit, towards faster or slower drives."""
        ends = []
        here = float(np.log(orbit.drive_speed))
        for sign in (1, -1):
            place = here - sign * 10 * NEAR
            speed = float(np.exp(place))
            seed = close(map_, orbit.y, speed) or settle(map_, speed).orbit
            if seed is not None:
                course = drive_course(seed.cycle.setting)
                path = trace(map_, seed, course if sign > 0 else course.reversed(), sign * place, sign * place + REACH)
                ends += [] if path.end is None else [End(sign * path.end.place, sign * path.end.slopes)]
        return min(ends, key=lambda end: abs(end.place - here), default=None)


def _outwards(now: float, low: float, high: float) -> list[tuple[float, float]]:
    """Steps (from, to) away from `now` within low and high, alternating between up and down, nearest first."""
    steps = []
    for factor, end in ((STEP, high), (1 / STEP, low)):
        count = int(np.floor(np.log(end / now) / np.log(factor) + 1e-9))
        places = [now * factor**i for i in range(max(count, 0) + 1)]
        steps.append(list(pairwise(places)))
    up, down = steps
    longest = max(len(up), len(down))
    return [pair for i in range(longest) for pair in (*up[i : i + 1], *down[i : i + 1])]
