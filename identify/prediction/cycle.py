"""One stick-slip cycle of the composed model, from one arrest to the next: the map whose fixed point is the orbit."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from identify.model.model import ELONGATION, SPEED, Model
from identify.prediction.glide import Glide, Glider
from identify.prediction.hold import Hold
from identify.simulation.plan import scales

Array = NDArray[np.float64]

SLIDES_AFTER = 12.0  # half periods sqrt(m/k) pi without coming to rest: the mass slides
CREEP = 1e-6  # of a half period: a slip this short is no slip, the contact creeps along with the drive
FLOOR, SPEED_FLOOR = 1e-2, 1e-4  # absolute over relative tolerance, of typical states: slips start from nothing


@dataclass(frozen=True)
class Cycle:
    """A stick and the slip that follows it, SI.

    start, onset, end: states (n_x,) at rest at the arrest before, at the onset of slip, at the arrest after;
    stick and slip are durations [s]; peak_speed is the largest sliding speed [m/s]; wear is the smallest value
    a bounded state reached (0: the contact was worn fresh; NaN without such a state). setting (n_w,): parameters,
    normal force and drive speed; glide: the slip step by step.
    """

    start: Array
    onset: Array
    end: Array
    stick: float
    slip: float
    peak_speed: float
    wear: float
    setting: Array = field(repr=False)
    glide: Glide = field(repr=False)


@dataclass(frozen=True)
class Tangent:
    """Derivatives of a cycle by the rest state before it and by its setting, m = n_y + n_w columns in this order.

    end (n_y, m): rest state after it; stick, slip (m,) durations; peak_speed (m,); distance (m,) slid;
    onset_load, arrest_load (m,): force the load cell sees.
    """

    end: Array
    stick: Array
    slip: Array
    peak_speed: Array
    distance: Array
    onset_load: Array
    arrest_load: Array


@dataclass(frozen=True)
class Flow:
    """A stick and the motion for a given time after it: rate (n_x,) and its tangent (n_x, m) at the end, at a fixed
    time; as a cycle that would end there, and the tangent of that."""

    rate: Array
    fixed: Array
    cycle: Cycle
    tangent: Tangent


class CycleMap:
    """The return map of one model under one normal force [N]; holds buffers, so one per thread.

    A rest state is written y (n_y,): the states of the model without the sliding speed.
    """

    def __init__(self, model: Model, normal_force: float, p: Array, rtol: float = 1e-6) -> None:
        self.model, self.normal_force, self.p = model, float(normal_force), np.asarray(p, float)
        self.rtol = rtol
        self.names = (*model.parameter_names, "normal_force", "drive_speed")
        typical = scales(model, self.p, normal_force)
        self.time, self.speed = typical.time, float(typical.state[SPEED])
        self.scale = np.delete(typical.state, SPEED)  # typical size of y
        floor = FLOOR * typical.state
        floor[SPEED] = SPEED_FLOOR * self.speed
        self.glider = Glider(model, rtol, rtol * floor, 1e-3 * typical.time)
        self._hold = Hold(model)

    @cached_property
    def half_period(self) -> float:
        """Half a natural period [s], of the mass on rig and series element together."""
        return float(np.pi * self.time * _softened(self.model, self.p))

    @cached_property
    def _drag(self) -> float:
        return _drag(self.model, self.p)

    def finer(self, rtol: float) -> CycleMap:
        """The same map with another tolerance."""
        return CycleMap(self.model, self.normal_force, self.p, rtol)

    def at(self, w: Array) -> CycleMap:
        """The map of the same model at another setting (n_w,)."""
        return CycleMap(self.model, float(w[-2]), w[:-2], self.rtol)

    def rested(self) -> Array:
        """Where a test starts: spring unloaded, every state saturated (the strongest first kick)."""
        states = [0.0, *(s.start if s.upper is None else s.upper for s in self.model.states[2:])]
        return np.array(states)

    def setting(self, drive_speed: float) -> Array:
        """w (n_w,), as `names`: parameters, normal force [N], drive speed [m/s]."""
        return np.append(self.p, [self.normal_force, drive_speed])

    def run(self, y: Array, drive_speed: float, patience: float = SLIDES_AFTER) -> Cycle | None:
        """The cycle that starts at rest in y; None when the mass does not come to rest within `patience` half periods
        (longer under heavy damping).

        Args:
            y: rest state (n_y,). drive_speed: [m/s], positive.
        """
        w, start = self.setting(drive_speed), np.insert(y, SPEED, 0.0)
        onset, duration = self._hold.onset(start, w)
        glide = self.glider.slide(onset, w, patience * self.half_period * self._drag)
        if not glide.rests or glide.t[-1] < CREEP * self.half_period:
            return None
        return self._cycle(start, onset, duration, w, glide)

    def flow(self, y: Array, w: Array, duration: float) -> Flow:
        """The stick from rest state y and `duration` [s] of the slip after it, through an arrest if there is one.

        Args:
            w: setting (n_w,), which need not be that of the map: only tolerances are the map's own.
        """
        start = np.insert(y, SPEED, 0.0)
        onset, stick_time = self._hold.onset(start, w, through_zero=True)
        glide = self.glider.slide(onset, w, duration, stops=False)
        return self._linearised(self._cycle(start, onset, stick_time, w, glide))

    def tangent(self, cycle: Cycle) -> Tangent:
        """How a cycle moves with its start and its setting."""
        return self._linearised(cycle).tangent

    def _cycle(self, start: Array, onset: Array, duration: float, w: Array, glide: Glide) -> Cycle:
        wear = np.nan if (i := self.model.clamped) is None else float(np.min(glide.x[:, i]))
        peak, _ = _peak(glide)
        return Cycle(start, onset, glide.x[-1], duration, float(glide.t[-1]), peak, wear, w, glide)

    def _linearised(self, cycle: Cycle) -> Flow:
        w, glide, last = cycle.setting, cycle.glide, cycle.glide.legs[-1]
        stick_slope, onset = self._hold.tangent(cycle.start, w, cycle.stick)
        speeds = np.zeros((1, *glide.x.shape))
        speeds[0, :, SPEED] = _peak(glide)[1]
        fixed, (peak,) = self.glider.tangents(glide, w, onset, speeds)
        rate = self.glider.rate(last.mode, glide.x[-1], last.direction)
        slip_slope = -fixed[SPEED] / rate[SPEED]
        end = fixed + np.outer(rate, slip_slope)
        end[SPEED] = 0.0
        distance = w[-1] * slip_slope - (end[ELONGATION] - onset[ELONGATION])
        distance[-1] += cycle.slip
        shown = [self._load_slope(x, w, slope) for x, slope in ((cycle.onset, onset), (cycle.end, end))]
        tangent = Tangent(np.delete(end, SPEED, 0), stick_slope, slip_slope, peak, distance, *shown)
        return Flow(rate, fixed, cycle, tangent)

    def holds(self, cycle: Cycle) -> bool:
        """Whether the mass, at rest at the end of the cycle, stays there."""
        pull, grip = self.glider.hold(cycle.end, cycle.setting)
        return abs(pull) < grip

    def load(self, x: Array, w: Array) -> float:
        """Force the load cell sees in state x [N]."""
        return self._hold.load(x, w)[0]

    def load_slopes(self, x: Array, w: Array) -> tuple[Array, Array]:
        """Derivatives of that force by the state (n_x,) and by the setting (n_w,)."""
        _, by_state, by_setting = self._hold.load(x, w)
        return by_state, by_setting

    def onset_slopes(self, cycle: Cycle) -> Array:
        """How the state at the onset (n_x,) moves with the rest state and the setting: (n_x, m)."""
        return self._hold.tangent(cycle.start, cycle.setting, cycle.stick)[1]

    def _load_slope(self, x: Array, w: Array, moved: Array) -> Array:
        """Derivatives (m,) of the force in a state whose derivatives are `moved` (n_x, m)."""
        by_state, by_setting = self.load_slopes(x, w)
        out: Array = by_state @ moved
        out[-w.size :] += by_setting
        return out


def _softened(model: Model, p: Array) -> float:
    """By how much a series element makes the natural period longer: root of the compliance over that of the rig."""
    u = np.array([0.0, 1.0, 1.0, 0.0])
    low, high = (np.array(model.at_force(force, p, u)).ravel() for force in (0.0, 1.0))
    pull = float(model.driving_force(high, p, u)) - float(model.driving_force(low, p, u))
    give = float(high[ELONGATION] - low[ELONGATION])
    return float(np.sqrt(give * p[model.parameter_names.index("stiffness")] / pull))


def _drag(model: Model, p: Array) -> float:
    """How much longer than a few swings a slip takes under heavy damping: an overdamped mass creeps to rest."""
    x = np.zeros(len(model.states))
    pulls = [float(model.driving_force(x, p, np.array([speed, 1.0, 1.0, 0.0]))) for speed in (0.0, 1.0)]
    values = dict(zip(model.parameter_names, p.tolist(), strict=True))
    zeta = (pulls[1] - pulls[0]) / (2.0 * float(np.sqrt(values["mass"] * values["stiffness"])))
    return 1.0 + zeta if zeta > 1.0 else 1.0


def _peak(glide: Glide) -> tuple[float, Array]:
    """Largest speed, vertex of the parabola through the highest node and its neighbours; weights (s+1,) of its
    derivative: as the vertex stands still, it moves as the interpolated speed there does."""
    times, speeds = glide.t, glide.x[:, SPEED]
    weights = np.zeros(times.size)
    i = int(np.argmax(speeds))
    if 0 < i < times.size - 1 and times[i - 1] < times[i] < times[i + 1]:
        left, right = times[i - 1] - times[i], times[i + 1] - times[i]
        below, above = (speeds[i - 1] - speeds[i]) / left, (speeds[i + 1] - speeds[i]) / right
        bend = (above - below) / (right - left)
        slope = below - bend * left
        if bend < 0.0:
            s = -slope / (2.0 * bend)
            weights[i - 1] = s * (s - right) / (left * (left - right))
            weights[i] = (s - left) * (s - right) / (left * right)
            weights[i + 1] = s * (s - left) / (right * (right - left))
            return float(weights @ speeds), weights
    weights[i] = 1.0
    return float(speeds[i]), weights


def rest_state(x: Array) -> Array:
    """y of a state at rest."""
    return np.delete(x, SPEED)


def loads(map_: CycleMap, cycle: Cycle) -> tuple[float, float]:
    """Force the load cell sees at the onset of slip and at the arrest [N]."""
    return map_.load(cycle.onset, cycle.setting), map_.load(cycle.end, cycle.setting)
