"""One stick-slip cycle of the composed model, from one arrest to the next: the map whose fixed point is the orbit."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.compiled import compiled
from identify.glide import Glide, Glider
from identify.model import ELONGATION, SPEED, Model
from identify.phases import scales, stick
from identify.stepping import Situated

Array = NDArray[np.float64]

SLIDES_AFTER = 12.0  # half periods sqrt(m/k) pi without coming to rest: the mass slides
CREEP = 1e-6  # of a half period: a slip this short is no slip, the contact creeps along with the drive
FLOOR = 1e-6  # absolute tolerance over relative tolerance, of a typical state: slips start from nothing


@dataclass(frozen=True)
class Cycle:
    """A stick and the slip that follows it, SI.

    start, onset, end: states (n_x,) at rest at the arrest before, at the onset of slip, at the arrest after;
    stick and slip are durations [s]; peak_speed is the largest sliding speed [m/s]; wear is the smallest value
    a bounded state reached (0: the contact was worn fresh; NaN without such a state). setting (n_w,): parameters,
    drive speed and normal force; glide: the slip step by step.
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


@lru_cache(maxsize=16)
def _functions(model: Model) -> dict[str, ca.Function]:
    """Of a stick, by (x, w, t): `spare` = grip minus pull of the drive after resting for t, its slope and the state;
    `spare_slope` its derivatives by (x, w, t), one column per row. `load`: (x, w) -> load cell and derivatives."""
    n_x, n_p = len(model.states), len(model.parameters)
    x, w, t = ca.SX.sym("x", n_x), ca.SX.sym("w", n_p + 2), ca.SX.sym("t")
    p, u = w[:n_p], ca.vertcat(w[n_p], w[n_p + 1], 1)
    rested = model.rest(x, p, u, t)
    spare = model.grip(rested, p, u) - model.driving_force(rested, p, u)
    both = ca.vertcat(spare, rested)
    row = ca.vertcat(spare, ca.jacobian(spare, t), rested)
    slope = ca.jacobian(both, ca.vertcat(x, w, t)).T
    load = model.load_cell(x, p, u)
    loads = ca.horzcat(load, ca.jacobian(load, ca.vertcat(x, w)))
    return {
        "spare": ca.Function("spare", [x, w, t], [ca.densify(row)]),
        "spare_slope": ca.Function("spare_slope", [x, w, t], [ca.densify(slope)]),
        "load": ca.Function("load", [x, w], [ca.densify(loads)]),
    }


class CycleMap:
    """The return map of one model under one normal force [N]; holds buffers, so one per thread.

    A rest state is written y (n_y,): the states of the model without the sliding speed.
    """

    def __init__(self, model: Model, normal_force: float, p: Array, rtol: float = 1e-7) -> None:
        self.model, self.normal_force, self.p = model, float(normal_force), np.asarray(p, float)
        self.names = (*model.parameter_names, "drive_speed", "normal_force")
        typical = scales(model, self.p, normal_force)
        self.time, self.speed = typical.time, float(typical.state[SPEED])
        self.scale = np.delete(typical.state, SPEED)  # typical size of y
        self.glider = Glider(model, rtol, rtol * FLOOR * typical.state, 1e-3 * typical.time)
        self._x, self._w, self._t = np.zeros(len(model.states)), np.zeros(self.p.size + 2), np.zeros(1)
        self._calls = {name: compiled(f) for name, f in _functions(model).items()}
        for call in self._calls.values():
            call.bind([self._x, self._w, self._t][: len(call.given)])
        self._stiffness = model.parameter_names.index("stiffness")

    @property
    def half_period(self) -> float:
        """Half a natural period [s]."""
        return float(np.pi * self.time)

    def at(self, normal_force: float) -> CycleMap:
        """The same pair and rig under another normal force [N]."""
        return CycleMap(self.model, normal_force, self.p)

    def rested(self) -> Array:
        """Where a test starts: spring unloaded, every state saturated (the strongest first kick)."""
        states = [0.0, *(s.start if s.upper is None else s.upper for s in self.model.states[2:])]
        return np.array(states)

    def setting(self, drive_speed: float, p: Array | None = None) -> Array:
        """w (n_w,), as `names`: parameters, drive speed [m/s], normal force [N]."""
        return np.append(self.p if p is None else p, [drive_speed, self.normal_force])

    def run(self, y: Array, drive_speed: float, p: Array | None = None, patience: float = SLIDES_AFTER) -> Cycle | None:
        """The cycle that starts at rest in y; None when the mass does not come to rest within `patience` half periods.

        Args:
            y: rest state (n_y,). drive_speed: [m/s], positive. p: parameters (n_p,), if not those of the map.
        """
        w, start = self.setting(drive_speed, p), np.insert(y, SPEED, 0.0)
        onset, duration = self._stick(start, w)
        glide = self.glider.slide(onset, w, patience * self.half_period)
        if not glide.rests or glide.t[-1] < CREEP * self.half_period:
            return None
        return self._cycle(start, onset, duration, w, glide)

    def flow(self, y: Array, drive_speed: float, duration: float) -> Flow:
        """The stick from rest state y and `duration` [s] of the slip after it, through an arrest if there is one."""
        w, start = self.setting(drive_speed), np.insert(y, SPEED, 0.0)
        onset, stick_time = self._stick(start, w, through_zero=True)
        glide = self.glider.slide(onset, w, duration, stops=False)
        cycle = self._cycle(start, onset, stick_time, w, glide)
        return self._linearised(cycle)

    def tangent(self, cycle: Cycle) -> Tangent:
        """How a cycle moves with its start and its setting."""
        return self._linearised(cycle).tangent

    def _cycle(self, start: Array, onset: Array, duration: float, w: Array, glide: Glide) -> Cycle:
        wear = np.nan if (i := self.model.clamped) is None else float(np.min(glide.x[:, i]))
        peak, _ = _peak(glide)
        return Cycle(start, onset, glide.x[-1], duration, float(glide.t[-1]), peak, wear, w, glide)

    def _linearised(self, cycle: Cycle) -> Flow:
        w, glide, last = cycle.setting, cycle.glide, cycle.glide.legs[-1]
        stick_slope, onset = self._onset_tangent(cycle.start, w, cycle.stick)
        nodes = self.glider.tangents(glide, w, onset)
        rate = self.glider.rate(last.mode, glide.x[-1], last.direction)
        slip_slope = -nodes[-1][SPEED] / rate[SPEED]
        end = nodes[-1] + np.outer(rate, slip_slope)
        end[SPEED] = 0.0
        peak = np.tensordot(_peak(glide)[1], nodes[:, SPEED], axes=1)
        distance = w[-2] * slip_slope - (end[ELONGATION] - onset[ELONGATION])
        distance[-2] += cycle.slip
        loads = [self._load(x, w, slope)[1] for x, slope in ((cycle.onset, onset), (cycle.end, end))]
        tangent = Tangent(np.delete(end, SPEED, 0), stick_slope, slip_slope, peak, distance, *loads)
        return Flow(rate, nodes[-1], cycle, tangent)

    def holds(self, cycle: Cycle) -> bool:
        """Whether the mass, at rest at the end of the cycle, stays there."""
        pull, grip = self.glider.hold(cycle.end, cycle.setting)
        return abs(pull) < grip

    def load(self, x: Array, w: Array) -> float:
        """Force the load cell sees in state x [N]."""
        return self._load(x, w, np.zeros((x.size, w.size)))[0]

    def _load(self, x: Array, w: Array, slope: Array) -> tuple[float, Array]:
        self._x[:], self._w[:] = x, w
        row = self._calls["load"]()
        out = row[1 : 1 + x.size] @ slope
        out[-w.size :] += row[1 + x.size :]
        return float(row[0]), out

    def _stick(self, start: Array, w: Array, *, through_zero: bool = False) -> tuple[Array, float]:
        """State at the onset of slip, and how long the stick lasted [s].

        `through_zero`: where the drive moves the mass at once, the negative time at which it would begin to, so
        that the onset stays a smooth function of the start. The spare grip is concave in time (the pull grows evenly, ageing saturates), so Newton's method from
        the right converges without a step back; where it is not, the general search takes over.
        """
        k, speed, load = w[self._stiffness], w[-2], w[-1]
        # Longer than any stick: by then the spring alone pulls with more than the strongest grip.
        longest = 2.0 * (float(np.max(w[:2])) * load + k * abs(start[ELONGATION])) / (k * speed)
        self._x[:], self._w[:], self._t[0] = start, w, 0.0
        spare = self._calls["spare"]
        first, t = float(spare()[1]), longest
        for _ in range(60):
            self._t[0] = t
            row = spare()
            value, slope = float(row[0]), float(row[1])
            step = value / slope if slope else np.nan
            if not (slope < 0.0 and step >= -1e-9 * abs(t) and (slope <= first or t <= 0.0)):
                break
            if abs(step) <= max(1e-14 * abs(t), 4e-16 * longest):
                return row[2:].copy(), t
            t = t - step if through_zero else max(t - step, 0.0)
        rest = stick(self.model, start, Situated(w[:-2], speed, 1.0, load, 0.0), 0.0, 5.0 * longest)
        return rest.x[-1], rest.duration

    def _onset_tangent(self, start: Array, w: Array, duration: float) -> tuple[Array, Array]:
        """Derivatives of the stick's duration (m,) and of the onset state (n_x, m)."""
        self._x[:], self._w[:], self._t[0] = start, w, duration
        n = start.size
        slope = self._calls["spare_slope"]().reshape(n + 1, n + w.size + 1)
        free = np.delete(slope[:, :-1], SPEED, axis=1)
        stick_slope = -free[0] / slope[0, -1] if duration else np.zeros(free.shape[1])
        return stick_slope, free[1:] + np.outer(slope[1:, -1], stick_slope)


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
