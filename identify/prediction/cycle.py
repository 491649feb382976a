"""One stick-slip cycle of the composed model, from one arrest to the next: the map whose fixed point is the orbit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import compiled
from identify.base.errors import SimulationError
from identify.effects import ALL
from identify.model.model import ELONGATION, SPEED, Model, assemble
from identify.prediction.slip import SlipIntegrator, SlipMotion
from identify.simulation.phases import stick
from identify.simulation.plan import scales
from identify.simulation.stepper import Situated

# ----------------------------------------------------------------------------------------------------------------------
# One stick, fast: when the drive overcomes the grip, and how that moves with start, parameters and rig.
#
# The setting w (n_w,) = parameters, normal force [N], drive speed [m/s] holds during the stick, as in `slip`.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

NEWTON_STEPS = 60
DOUBLINGS = 60


@lru_cache(maxsize=16)
def _functions(model: Model) -> dict[str, ca.Function]:
    """Of a stick, by (x, w, t): `spare` = grip minus pull of the drive after resting for t, its slope and the state;
    `spare_slope` its derivatives by (x, w, t), one column per row. `load`: (x, w) -> load cell and derivatives."""
    n_x, n_p = len(model.states), len(model.parameters)
    x, w, t = ca.SX.sym("x", n_x), ca.SX.sym("w", n_p + 2), ca.SX.sym("t")
    p, u = w[:n_p], ca.vertcat(w[n_p + 1], w[n_p], 1, 0)
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


class StickSolver:
    """Sticks of one model; holds buffers, so one per thread."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self._x, self._w, self._t = np.zeros(len(model.states)), np.zeros(len(model.parameters) + 2), np.zeros(1)
        self._calls = {name: compiled(f) for name, f in _functions(model).items()}
        for call in self._calls.values():
            call.bind([self._x, self._w, self._t][: len(call.given)])
        self._stiffness = model.parameter_names.index("stiffness")

    def onset(self, start: Array, w: Array, *, through_zero: bool = False) -> tuple[Array, float]:
        """State at the onset of slip (n_x,), and how long the stick lasted [s].

        Args:
            start: state at rest (n_x,).
            through_zero: where the drive moves the mass at once, take the negative time at which it would begin
                to, so that the onset stays a smooth function of the start.

        The spare grip is concave in time (the pull grows evenly, ageing saturates), so Newton's method from
        the right converges without a step back; where it is not (a series element brings a transient: the slope
        at the start tells), the general search takes over.
        """
        k, load, speed = w[self._stiffness], w[-2], w[-1]
        self._x[:], self._w[:], self._t[0] = start, w, 0.0
        spare = self._calls["spare"]
        first = float(spare()[1])
        # Longer than any stick: by then the spring alone pulls with more than a grip that is as strong as mu_s says.
        longest = 2.0 * (float(np.max(w[:2])) * load + k * abs(start[ELONGATION])) / (k * speed)
        for _ in range(DOUBLINGS):
            self._t[0] = t = longest
            if spare()[0] < 0.0:
                break
            longest *= 2.0
        for _ in range(NEWTON_STEPS):
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

    def tangent(self, start: Array, w: Array, duration: float) -> tuple[Array, Array]:
        """Derivatives of the stick's duration (m,) and of the onset state (n_x, m).

        The m directions are the rest state (start without its speed) and w.
        """
        self._x[:], self._w[:], self._t[0] = start, w, duration
        n = start.size
        slope = self._calls["spare_slope"]().reshape(n + 1, n + w.size + 1)
        used = [i for i in range(n + w.size) if i != SPEED]
        free = slope[:, used]
        stick_slope = -free[0] / slope[0, -1] if duration else np.zeros(free.shape[1])
        return stick_slope, free[1:] + np.outer(slope[1:, -1], stick_slope)

    def load(self, x: Array, w: Array) -> tuple[float, Array, Array]:
        """Force the load cell sees in state x [N], and its derivatives by the state (n_x,) and by w (n_w,)."""
        self._x[:], self._w[:] = x, w
        row = self._calls["load"]()
        return float(row[0]), row[1 : 1 + x.size].copy(), row[-w.size :].copy()


# ----------------------------------------------------------------------------------------------------------------------
# Which models repeat themselves: only they have a cycle, a steady sliding and a critical speed to be asked for.
# ----------------------------------------------------------------------------------------------------------------------


def check_calculable(model: Model) -> None:
    """Refuse a model of which no cycle is like the one before.

    Raises:
        SimulationError: the effects that are to blame, and what to do.
    """
    if model.balance is not None:
        raise SimulationError(
            "the effect inertia is off: stability and amplitude of stick-slip are those of a moving mass; "
            "add inertia to effects and give the mass under [rig]"
        )
    for what, why in (
        (lambda m: m.clocked, "changes with time as such, so that no cycle is like the one before"),
        (lambda m: m.jumps, "deals every stick its own friction, so that no cycle is like the one before"),
    ):
        if what(model):
            names = _to_blame(model, what)
            effects, it = f"effect {names[0]}" if len(names) == 1 else f"effects {' and '.join(names)}", names[0]
            raise SimulationError(
                f"the {effects} {why}; leave {it if len(names) == 1 else 'them'} out for stability and amplitude "
                f"({' '.join(f'--without {name}' for name in names)}), or look at a simulation"
            )


def _to_blame(model: Model, what: Callable[[Model], bool]) -> list[str]:
    """The effects that bring it by themselves; all of them where it takes several."""
    own = [e for e in ALL if e.name in model.effects and e.name != "inertia"]
    alone = [e.name for e in own if what(assemble(tuple(dict.fromkeys(("inertia", *e.needs, e.name)))))]
    return alone or list(model.effects)


SLIDES_AFTER = 12.0  # half periods sqrt(m/k) pi without coming to rest: the mass slides
CREEP = 1e-6  # of a half period: a slip this short is no slip, the contact creeps along with the drive
RENEWED = 0.01  # of the saturation: of a contact that is almost renewed
ALMOST = 1.0 - 1e-6  # of the elongation at which a contact breaks loose
FLOOR, SPEED_FLOOR = 1e-2, 1e-4  # absolute over relative tolerance, of typical states: slips start from nothing


@dataclass(frozen=True)
class Cycle:
    """A stick and the slip that follows it, SI.

    start, onset, end: states (n_x,) at rest at the arrest before, at the onset of slip, at the arrest after;
    stick and slip are durations [s]; peak_speed is the largest sliding speed [m/s]; wear is the smallest value
    a bounded state reached (0: the contact was worn fresh; NaN without such a state). setting (n_w,): parameters,
    normal force and drive speed; slip: the slip step by step.
    """

    start: Array
    onset: Array
    end: Array
    stick: float
    slip: float
    peak_speed: float
    wear: float
    setting: Array = field(repr=False)
    slip_motion: SlipMotion = field(repr=False)


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
        self.slip_integrator = SlipIntegrator(model, rtol, rtol * floor, 1e-3 * typical.time)
        self._stick_solver = StickSolver(model)

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
        """The map of the same model at another setting (n_w,); this one where only the drive speed differs."""
        if w[-2] == self.normal_force and np.array_equal(w[:-2], self.p):
            return self
        return CycleMap(self.model, float(w[-2]), w[:-2], self.rtol)

    def rested(self) -> Array:
        """Where a test starts: spring unloaded, every state saturated (the strongest first kick)."""
        states = [0.0, *(s.start if s.upper is None else s.upper for s in self.model.states[2:])]
        return np.array(states)

    def renewed(self, drive_speed: float) -> Array | None:
        """Where a test of a contact that is almost renewed starts: spring about to break it loose at this speed [m/s];
        None where nothing ages."""
        if self.model.clamped is None:
            return None
        w, x = self.setting(drive_speed), np.insert(self.rested(), SPEED, 0.0)
        x[self.model.clamped] = RENEWED
        (slack, strength), step = self.slip_integrator.hold(x, w), float(self.scale[ELONGATION])
        x[ELONGATION] = step
        stretched, _ = self.slip_integrator.hold(x, w)
        x[ELONGATION] = ALMOST * step * (strength - slack) / (stretched - slack)
        return rest_state(x)

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
        onset, duration = self._stick_solver.onset(start, w)
        slip_motion = self.slip_integrator.slide(onset, w, patience * self.half_period * self._drag)
        if not slip_motion.rests or slip_motion.t[-1] < CREEP * self.half_period:
            return None
        return self._cycle(start, onset, duration, w, slip_motion)

    def flow(self, y: Array, w: Array, duration: float) -> Flow:
        """The stick from rest state y and `duration` [s] of the slip after it, through an arrest if there is one.

        Args:
            w: setting (n_w,), which need not be that of the map: only tolerances are the map's own.
        """
        start = np.insert(y, SPEED, 0.0)
        onset, stick_time = self._stick_solver.onset(start, w, through_zero=True)
        slip_motion = self.slip_integrator.slide(onset, w, duration, stops=False)
        return self._linearised(self._cycle(start, onset, stick_time, w, slip_motion))

    def tangent(self, cycle: Cycle) -> Tangent:
        """How a cycle moves with its start and its setting."""
        return self._linearised(cycle).tangent

    def _cycle(self, start: Array, onset: Array, duration: float, w: Array, slip_motion: SlipMotion) -> Cycle:
        wear = np.nan if (i := self.model.clamped) is None else float(np.min(slip_motion.x[:, i]))
        peak, _ = _peak(slip_motion)
        return Cycle(start, onset, slip_motion.x[-1], duration, float(slip_motion.t[-1]), peak, wear, w, slip_motion)

    def _linearised(self, cycle: Cycle) -> Flow:
        w, slip_motion, last = cycle.setting, cycle.slip_motion, cycle.slip_motion.segments[-1]
        stick_slope, onset = self._stick_solver.tangent(cycle.start, w, cycle.stick)
        speeds = np.zeros((1, *slip_motion.x.shape))
        speeds[0, :, SPEED] = _peak(slip_motion)[1]
        fixed, (peak,) = self.slip_integrator.tangents(slip_motion, w, onset, speeds)
        rate = self.slip_integrator.rate(last.mode, slip_motion.x[-1], last.direction)
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
        pull, grip = self.slip_integrator.hold(cycle.end, cycle.setting)
        return abs(pull) < grip

    def load(self, x: Array, w: Array) -> float:
        """Force the load cell sees in state x [N]."""
        return self._stick_solver.load(x, w)[0]

    def load_slopes(self, x: Array, w: Array) -> tuple[Array, Array]:
        """Derivatives of that force by the state (n_x,) and by the setting (n_w,)."""
        _, by_state, by_setting = self._stick_solver.load(x, w)
        return by_state, by_setting

    def onset_slopes(self, cycle: Cycle) -> Array:
        """How the state at the onset (n_x,) moves with the rest state and the setting: (n_x, m)."""
        return self._stick_solver.tangent(cycle.start, cycle.setting, cycle.stick)[1]

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


def _peak(slip_motion: SlipMotion) -> tuple[float, Array]:
    """Largest speed, vertex of the parabola through the highest node and its neighbours; weights (s+1,) of its
    derivative: as the vertex stands still, it moves as the interpolated speed there does."""
    times, speeds = slip_motion.t, slip_motion.x[:, SPEED]
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
