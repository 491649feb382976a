"""One stick-slip cycle of the composed model, from one arrest to the next: the map whose fixed point is the orbit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Mapped
from identify.base.errors import SimulationError
from identify.effects import ALL
from identify.model.model import ELONGATION, SPEED, Model, assemble
from identify.model.modes import ModeName
from identify.simulation.phases import Machine, Slide
from identify.simulation.plan import Plan, scales
from identify.simulation.resting import borrowed, give_back
from identify.simulation.steppers import HIGH
from identify.simulation.tangents import node_slopes, situated_at, stepped

Array = NDArray[np.float64]

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


# ----------------------------------------------------------------------------------------------------------------------
# The return map: a stick and a slip of the simulator, and how they move with start, parameters and rig.
#
# The setting w (n_w,) = parameters, normal force [N], drive speed [m/s] holds during a stick and its slip.
# ----------------------------------------------------------------------------------------------------------------------

ACCURATE = 1e-8  # relative tolerance of a step: a tenth of it, and less, is left in durations and jumps
SLIDES_AFTER = 12.0  # half periods sqrt(m/k) pi without coming to rest: the mass slides
CREEP = 1e-6  # of a half period: a slip this short is no slip, the contact creeps along with the drive
RENEWED = 0.01  # of the saturation: of a contact that is almost renewed
ALMOST = 1.0 - 1e-6  # of the elongation at which a contact breaks loose
DOUBLINGS = 60  # of the longest stick that the spring alone allows for
MOST_TURNS = 200  # of the direction of one slip; more is chatter


@lru_cache(maxsize=16)
def _rest_slopes(model: Model) -> Mapped:
    """Of a stick, by (x, w, t): derivatives of its breakaway margin and its state by (x, w, t), one column per row."""
    x, w, t = (ca.SX.sym(name, n) for name, n in (("x", len(model.states)), ("w", len(model.parameters) + 2), ("t", 1)))
    p, u = w[:-2], ca.vertcat(w[-1], w[-2], 1, 0)
    rested = model.rest(x, p, u, t)
    margin = model.grip(rested, p, u) - model.driving_force(rested, p, u)
    slope = ca.jacobian(ca.vertcat(margin, rested), ca.vertcat(x, w, t)).T
    return Mapped(ca.Function("rest_slopes", [x, w, t], [ca.densify(slope)]))


@lru_cache(maxsize=16)
def _load(model: Model) -> Mapped:
    """The force that the load cell sees, by (x, w), and its derivatives by these."""
    x, w = ca.SX.sym("x", len(model.states)), ca.SX.sym("w", len(model.parameters) + 2)
    load = model.load_cell(x, w[:-2], ca.vertcat(w[-1], w[-2], 1, 0))
    row = ca.horzcat(load, ca.jacobian(load, ca.vertcat(x, w)))
    return Mapped(ca.Function("load", [x, w], [ca.densify(row)]))


@dataclass(frozen=True)
class Cycle:
    """A stick and the slip that follows it, SI.

    start, onset, end: states (n_x,) at rest at the arrest before, at the onset of slip, at the arrest after; stick and
    slip are durations [s]. setting (n_w,): parameters, normal force and drive speed; slides: the slip by modes and
    directions, their starts counted from the onset.
    """

    start: Array
    onset: Array
    end: Array
    stick: float
    slip: float
    setting: Array = field(repr=False)
    slides: tuple[Slide, ...] = field(repr=False)

    @property
    def turns(self) -> bool:
        """Whether the mass slid backwards on the way."""
        return any(part.situated.direction < 0.0 for part in self.slides)


@dataclass(frozen=True)
class Tangent:
    """Derivatives of a cycle by the rest state before it and by its setting, m = n_y + n_w columns in this order.

    end (n_y, m): rest state after it; stick, slip (m,) durations; distance (m,) slid; onset_load, arrest_load (m,):
    force the load cell sees.
    """

    end: Array
    stick: Array
    slip: Array
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
    """The return map of one model under one normal force [N].

    A rest state is written y (n_y,): the states of the model without the sliding speed.
    """

    def __init__(self, model: Model, normal_force: float, p: Array, rtol: float = ACCURATE) -> None:
        self.model, self.normal_force, self.p = model, float(normal_force), np.asarray(p, float)
        self.rtol = rtol
        self.names = (*model.parameter_names, "normal_force", "drive_speed")
        self._typical = scales(model, self.p, normal_force)
        self.time, self.speed = self._typical.time, float(self._typical.state[SPEED])
        self.scale = np.delete(self._typical.state, SPEED)  # typical size of y

    @staticmethod
    def of(model: Model, w: Array) -> CycleMap:
        """The map at a setting w (n_w,), of whatever drive speed."""
        return CycleMap(model, float(w[-2]), w[:-2])

    @cached_property
    def half_period(self) -> float:
        """Half a natural period [s], of the mass on rig and series element together."""
        return float(np.pi * self.time * _softened(self.model, self.p))

    @cached_property
    def _bounds(self) -> Array:
        """Lowest and highest value of each state at rest, shape (2, n_y)."""
        ends = [
            (-np.inf if s.lower is None else s.lower, np.inf if s.upper is None else s.upper) for s in self.model.states
        ]
        return np.delete(np.array(ends), SPEED, 0).T

    @cached_property
    def _drag(self) -> float:
        return _drag(self.model, self.p)

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
        w, x, step = self.setting(drive_speed), np.insert(self.rested(), SPEED, 0.0), float(self.scale[ELONGATION])
        x[self.model.clamped] = RENEWED
        margin, slack = self._margin(x, w)
        x[ELONGATION] = step
        stretched = self._margin(x, w)[1]
        x[ELONGATION] = ALMOST * step * margin / (stretched - slack)
        return rest_state(x)

    def setting(self, drive_speed: float) -> Array:
        """w (n_w,), as `names`: parameters, normal force [N], drive speed [m/s]."""
        return np.append(self.p, [self.normal_force, drive_speed])

    def run(self, y: Array, drive_speed: float, patience: float = SLIDES_AFTER) -> Cycle | None:
        """The cycle that starts at rest in y; None when the mass does not come to rest within `patience` half periods
        (longer under heavy damping).

        Args:
            y: rest state (n_y,), of which a state beyond its bounds starts there. drive_speed: [m/s], positive.
        """
        y = np.clip(y, *self._bounds)
        cycle, rests = self._run(y, self.setting(drive_speed), patience * self.half_period * self._drag, stops=True)
        return cycle if rests and cycle.slip >= CREEP * self.half_period else None

    def flow(self, y: Array, w: Array, duration: float) -> Flow:
        """The stick from rest state y and `duration` [s] of the slip after it, through an arrest if there is one.

        Args:
            w: setting (n_w,), which need not be that of the map: only tolerances are the map's own.
        """
        return self._linearised(self._run(y, w, duration, stops=False)[0])

    def tangent(self, cycle: Cycle) -> Tangent:
        """How a cycle moves with its start and its setting."""
        return self._linearised(cycle).tangent

    def _run(self, y: Array, w: Array, limit: float, *, stops: bool) -> tuple[Cycle, bool]:
        """The stick from rest state y and at most `limit` [s] of the slip after it, and whether it comes to rest; where
        it never stops the onset is a smooth function of y."""
        machine = Machine(self.model, w[:-2], self._typical, Plan(self.rtol, (HIGH,)), stops=stops)
        try:
            start = np.insert(y, SPEED, 0.0)
            stick, onset, force = _rested(machine, start, w, through_zero=not stops)
            slides, x, t, rests = list[Slide](), onset, 0.0, False
            mode: ModeName = "slip"
            for _ in range(MOST_TURNS):
                part = machine.slide(mode, x, situated_at(w, -1.0 if force < 0.0 else 1.0, t), limit - t)
                slides.append(part)
                x, t = part.end, part.start + part.duration
                if part.ended_by is None:
                    break
                mode = machine.following[mode][part.ended_by]
                if mode == "stick":
                    mode = "slip"
                    margin, force = machine.rests.margin(x, situated_at(w))
                    rests = margin > 0.0
                    if rests:
                        break
            return Cycle(start, onset, x, stick, t, w, tuple(slides)), rests
        finally:
            machine.close()

    def _linearised(self, cycle: Cycle) -> Flow:
        w, last = cycle.setting, cycle.slides[-1]
        stick_slope, onset = self._stick_slopes(cycle)
        fixed = node_slopes(self.model, cycle.slides, onset)[-1][-1]
        rate = stepped(self.model, last, last.x[-1:], np.zeros(1))[1][0]
        slip_slope = -fixed[SPEED] / rate[SPEED]
        end = fixed + np.outer(rate, slip_slope)
        end[SPEED] = 0.0
        distance = w[-1] * slip_slope - (end[ELONGATION] - onset[ELONGATION])
        distance[-1] += cycle.slip
        rows = self.loads(np.stack([cycle.onset, cycle.end]), w)
        shown = [_load_slope(row, slope) for row, slope in zip(rows, (onset, end), strict=True)]
        tangent = Tangent(np.delete(end, SPEED, 0), stick_slope, slip_slope, distance, *shown)
        return Flow(rate, fixed, cycle, tangent)

    def holds(self, cycle: Cycle) -> bool:
        """Whether the mass, at rest at the end of the cycle, stays there."""
        return self._margin(cycle.end, cycle.setting)[0] > 0.0

    def _margin(self, x: Array, w: Array) -> tuple[float, float]:
        """By how much a mass at rest in x withstands the drive, and the force of the drive [N]."""
        rests = borrowed(self.model)
        try:
            return rests.margin(x, situated_at(w))
        finally:
            give_back(rests)

    def load(self, x: Array, w: Array) -> float:
        """Force the load cell sees in state x [N]."""
        return float(self.loads(x[None, :], w)[0, 0])

    def loads(self, x: Array, w: Array) -> Array:
        """Force the load cell sees in states x (n, n_x) [N], and its derivatives by state and setting:
        (n, 1 + n_x + n_w)."""
        return _load(self.model)([x, np.repeat(w[None], x.shape[0], 0)])[0]

    def load_slope(self, x: Array, w: Array, moved: Array) -> Array:
        """Derivatives (m,) of the force in a state whose derivatives are `moved` (n_x, m), the setting last."""
        return _load_slope(self.loads(x[None, :], w)[0], moved)

    def onset_slopes(self, cycle: Cycle) -> Array:
        """How the state at the onset (n_x,) moves with the rest state and the setting: (n_x, m)."""
        return self._stick_slopes(cycle)[1]

    def _stick_slopes(self, cycle: Cycle) -> tuple[Array, Array]:
        """Derivatives of the stick's duration (m,) and of the onset state (n_x, m) by rest state and setting."""
        n, w = cycle.start.size, cycle.setting
        given = [cycle.start[None, :], w[None, :], np.array([cycle.stick])]
        slope = _rest_slopes(self.model)(given)[0].reshape(n + 1, n + w.size + 1)
        free = np.delete(slope[:, :-1], SPEED, 1)
        stick_slope = -free[0] / slope[0, -1] if cycle.stick else np.zeros(free.shape[1])
        return stick_slope, free[1:] + np.outer(slope[1:, -1], stick_slope)


def _load_slope(row: Array, moved: Array) -> Array:
    """Derivatives (m,) of the force of one row of `loads`, in a state whose derivatives are `moved` (n_x, m)."""
    n = moved.shape[0]
    out: Array = row[1 : n + 1] @ moved
    out[n + 1 - row.size :] += row[n + 1 :]
    return out


def _rested(machine: Machine, start: Array, w: Array, *, through_zero: bool = False) -> tuple[float, Array, float]:
    """How long a stick from state `start` lasts [s], the state at its end (n_x,), the force of the drive there [N];
    through_zero as of `Resting.until`."""
    k, load, speed = w[machine.model.parameter_names.index("stiffness")], w[-2], w[-1]
    # Longer than any stick: by then the spring alone pulls with more than a limit that is as strong as mu_s says.
    longest = 2.0 * (float(np.max(w[:2])) * load + k * abs(start[ELONGATION])) / (k * speed)
    for _ in range(DOUBLINGS):
        onset, x, force = machine.rests.until(start, situated_at(w), longest, through_zero=through_zero)
        if onset is not None:
            return onset, x, force
        longest *= 2.0
    return longest, x, force


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


def rest_state(x: Array) -> Array:
    """y of a state at rest."""
    return np.delete(x, SPEED)


def loads(map_: CycleMap, cycle: Cycle) -> tuple[float, float]:
    """Force the load cell sees at the onset of slip and at the arrest [N]."""
    return map_.load(cycle.onset, cycle.setting), map_.load(cycle.end, cycle.setting)
