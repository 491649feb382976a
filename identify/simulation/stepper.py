"""Steps of a sliding mass: one trial as a compiled function, many of them in one call, switches located on the step.

A burst takes `method.trials` trials in a row: the step length follows the error estimate, and where an event function
has fallen to zero within a step the trials go on from the same node, with lengths by Newton's method, until it is
zero. So switch times are as accurate as the integration, not as its interpolation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Compiled, Mapped
from identify.model.model import SPEED, Model
from identify.simulation.steppers import Method, StepProblem

Array = NDArray[np.float64]

# The modes of a sliding mass as data: which motion holds, what ends it, and what comes next.

ModeName = Literal["stick", "slip", "renewed"]
GuardName = Literal["speed", "clearance", "release"]

# Guards, positive while a mode holds (in the order the step function returns them):
# speed      sliding speed along the direction of slip; zero: the mass comes to rest
# clearance  bounded state minus its lower bound; zero: the contact is fresh, the state is clamped
# release    minus the free rate of the bounded state; zero: it leaves its bound again
GUARDS: tuple[GuardName, ...] = ("speed", "clearance", "release")


EXITS: Mapping[ModeName, Mapping[GuardName, ModeName]] = {
    "slip": {"speed": "stick", "clearance": "renewed"},
    "renewed": {"speed": "stick", "release": "slip"},
}  # by sliding mode: the guard that falls through zero, and the mode that follows


def sliding_modes(has_clamped_state: bool) -> Mapping[ModeName, Mapping[GuardName, ModeName]]:
    """The sliding modes of a model with their exits; without a clamped state there is one."""
    return EXITS if has_clamped_state else {"slip": {"speed": "stick"}}


N_GUARDS = len(GUARDS)
ROUNDING = 1e-15  # of the forces: a few last digits

# What stays the same during one phase of motion.


@dataclass(frozen=True)
class Situated:
    """Parameters p (n_p,), drive speed at the start of the phase [m/s], direction of sliding (+1 or -1), normal force
    then [N] and its slope [N/s], time at its start [s]; acceleration of the drive [m/s^2], which a model on a course
    takes."""

    p: Array
    drive_speed: float
    direction: float
    normal_force: float
    force_slope: float
    time: float = 0.0
    acceleration: float = 0.0

    def numbers(self, model: Model) -> tuple[float, ...]:
        """What the step functions of a model read behind the parameters (n_u,)."""
        known = (self.drive_speed, self.direction, self.normal_force, self.force_slope, self.time)
        return (*known, self.acceleration) if model.on_course else known

    def at(self, t: float, direction: float = 1.0) -> Array:
        """u (4,) of the model at time t [s] within the phase."""
        speed = self.drive_speed + self.acceleration * t
        return np.array([speed, self.normal_force + self.force_slope * t, direction, self.time + t])


def numbers_of(model: Model) -> int:
    """How many `Situated.numbers` there are (n_u)."""
    return 6 if model.on_course else 5


def inputs(drive: ca.SX, t: ca.SX) -> ca.SX:
    """u (4,) of the model at time t of a phase, from `Situated.numbers` (n_u,)."""
    speed = drive[0] + drive[5] * t if drive.numel() > 5 else drive[0]
    return ca.vertcat(speed, drive[2] + drive[3] * t, drive[1], drive[4] + t)


def rested(model: Model, x: ca.SX, p: ca.SX, drive: ca.SX, t: ca.SX) -> tuple[ca.SX, ca.SX]:
    """x after a rest of t [s] from x, and the force of the drive then without what oscillates [N]; drive (n_u,)."""
    given = [x, p, inputs(drive, t), t, *([drive[5]] if model.on_course else [])]
    return model.rest(*given), model.calm_force(*given)


def symbols(model: Model) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
    """State x, constants (n_p + n_u,) and time t in a phase, and in terms of these parameters p and inputs u."""
    n_p = len(model.parameters)
    x, t, c = ca.SX.sym("x", len(model.states)), ca.SX.sym("t"), ca.SX.sym("c", n_p + numbers_of(model))
    return x, c, t, c[:n_p], inputs(c[n_p:], t)


# One trial step of a model: the state after it, its error, and the event functions of its mode.


@lru_cache(maxsize=64)
def rate(model: Model, mode: ModeName) -> ca.Function:
    """(x, constants (n_p + n_u,), t in phase) -> dx/dt."""
    x, c, t, p, u = symbols(model)
    field = model.renewed if mode == "renewed" else model.slip
    return ca.Function("rate", [x, c, t], [ca.densify(field(x, p, u))])


@lru_cache(maxsize=64)
def event_functions(model: Model, mode: ModeName) -> ca.Function:
    """(x, constants, t) -> event functions in the order of GUARDS and their slopes in time (2 N_GUARDS,); 1 where one
    does not end the mode."""
    moving, free = rate(model, mode), rate(model, "slip")
    x, c, t, _p, u = symbols(model)
    exits = sliding_modes(model.clamped is not None)[mode]
    guards = [u[2] * x[SPEED], ca.SX(1), ca.SX(1)]
    if model.clamped is not None and "clearance" in exits:
        guards[1] = x[model.clamped] - (model.states[model.clamped].lower or 0.0)
    if model.clamped is not None and "release" in exits:
        guards[2] = -free(x, c, t)[model.clamped]
    guard, motion = ca.vertcat(*guards), moving(x, c, t)
    slopes = ca.jtimes(guard, x, motion) + ca.jacobian(guard, t)
    return ca.Function("event_functions", [x, c, t], [ca.densify(ca.vertcat(guard, slopes))])


@lru_cache(maxsize=64)
def trial(model: Model, method: Method, mode: ModeName) -> ca.Function:
    """(x and t and h, constants, tolerances) -> x after, error norm (<= 1 acceptable), event functions, their slopes.

    One vector; constants: p, then the numbers of `Situated`; tolerances: rtol, atol (n_x,).
    """
    n = len(model.states)
    z = ca.SX.sym("z", n + 2)
    c, tolerances = ca.SX.sym("c", len(model.parameters) + numbers_of(model)), ca.SX.sym("tolerances", n + 1)
    x, t, h = z[:n], z[n], z[n + 1]
    after, norm = method.step(_problem(model, method, mode, z, c, tolerances), x, t, h)
    # A largest value hides what is not a number: such a step is refused.
    good = ca.sum1(ca.fabs(after)) < 1e150  # of a state: beyond, squares overflow
    # So is one to where no motion leads: the equations of an implicit step have other solutions, too.
    for i, state in enumerate(model.states):
        if state.lower is not None and state.upper is not None:
            reach = state.upper - state.lower
            inside = ca.logic_and(after[i] < state.upper + 1e-3 * reach, after[i] > state.lower - reach)
            good = ca.logic_and(good, inside)
    norm = ca.if_else(good, norm, ca.inf)
    row = ca.vertcat(after, norm, event_functions(model, mode)(after, c, t + h))
    return ca.Function(f"trial_{mode}", [z, c, tolerances], [ca.cse(ca.densify(row))])


@lru_cache(maxsize=64)
def within(model: Model, method: Method, mode: ModeName) -> ca.Function:
    """(x and t and h and part and x after, constants, tolerances) -> x at t + part [s], inside a step of length h [s]
    from t."""
    n = len(model.states)
    z = ca.SX.sym("z", 2 * n + 3)
    c, tolerances = ca.SX.sym("c", len(model.parameters) + numbers_of(model)), ca.SX.sym("tolerances", n + 1)
    x, t, h, part = z[:n], z[n], z[n + 1], z[n + 2]
    inside = method.within(_problem(model, method, mode, z, c, tolerances), x, t, h, part, z[n + 3 :])
    return ca.Function(f"within_{mode}", [z, c, tolerances], [ca.cse(ca.densify(inside))])


def _problem(model: Model, method: Method, mode: ModeName, xth: ca.SX, c: ca.SX, tolerances: ca.SX) -> StepProblem:
    """A step of a mode from state, time and length xth, with what it is tolerated to be wrong by."""
    n, moving = len(model.states), rate(model, mode)
    x, t, h = xth[:n], xth[n], xth[n + 1]
    # What a state moves by in the step counts as its size: a speed that falls through zero is not chased to zero.
    size = ca.fabs(x) + h * ca.fabs(moving(x, c, t))
    blur = ca.SX.zeros(n)
    # Forces have so many digits: what their rounding makes of the speed, until it decays, is no error of the step.
    decay = 0.0 if method.smooth else ca.jacobian(moving(x, c, t)[SPEED], x[SPEED])
    lasts = h / (1.0 + h * ca.fabs(decay))
    blur[SPEED] = lasts * ROUNDING * ca.fabs(_load(model)(x, c, t)) / c[model.parameter_names.index("mass")]
    return StepProblem(moving, c, lambda after: tolerances[1:] + blur + tolerances[0] * ca.fmax(size, ca.fabs(after)))


def _load(model: Model) -> ca.Function:
    """(x, constants, t) -> force of the rig on the mass [N]."""
    x, c, t, p, u = symbols(model)
    return ca.Function("load", [x, c, t], [ca.densify(model.load(x, p, u))])


@lru_cache(maxsize=64)
def coefficient(model: Model, mode: ModeName) -> ca.Function:
    """(x, constants, t) -> friction coefficient, positive where friction brakes."""
    x, c, t, _p, u = symbols(model)
    inertia = c[model.parameter_names.index("mass")] * rate(model, mode)(x, c, t)[SPEED]
    return ca.Function("coefficient", [x, c, t], [ca.densify(u[2] * (_load(model)(x, c, t) - inertia) / u[1])])


# Many trials in one call.

MODES: tuple[ModeName, ...] = ("slip", "renewed")  # numbered so in a burst
SHORTEST = 1e-14  # of the natural time: a step shorter than that is no step
GROWTH, SHRINKING, SAFETY = 10.0, 0.2, 0.9  # of the step length from one trial to the next
BEYOND = 2.0  # times the time in which an event function would fall to zero as it falls: no step is longer
DIPS = 3  # times in a row that a dip is sought more closely


class Stop(IntEnum):
    """Why a burst stopped."""

    NOT_YET = 0
    LOCATED = 1  # the last node is a switch
    EVENT = 2  # the trial from the last node meets an event, and is decided outside
    TIME_IS_UP = 3
    STUCK = 4  # no step is short enough


class BurstState:
    """The places in the vector z that says where a burst stands: the node x (n_x,), its time t, `Stop`, the control.

    Control: h, length of the next trial. error, step: root of the error and length of the last step taken (0: none).
    low, high: lengths between which a switch is being located (high 0: none is). final: the coming trial ends at the
    switch. watch: how often a dip may still be sought. Event functions and their slopes at the node. Last, which trial
    comes: twice the place of the mode in `MODES`, one more where a switch is being located; -1 none.
    """

    def __init__(self, n: int) -> None:
        """n: of states."""
        self.n, self.t, self.stop, self.h = n, n, n + 1, n + 2
        self.control, self.ends = slice(n + 2, n + 9), slice(n + 9, n + 9 + 2 * N_GUARDS)
        self.which = n + 9 + 2 * N_GUARDS
        self.size = self.which + 1


@lru_cache(maxsize=64)
def burst(model: Model, method: Method) -> Mapped:
    """`method.trials` trials in a row: (z, bounds, constants, tolerances) -> z after each of them, one after the other.

    z as in `BurstState`; bounds: time limit, longest and shortest step [s], whether switches are located, farthest way
    of a step [m]. A trial that is refused repeats the node with another length.
    """
    at, modes = BurstState(len(model.states)), MODES[: len(sliding_modes(model.clamped is not None))]
    each = [paced(model, method, mode, locating) for mode in modes for locating in (False, True)]
    given = [ca.MX.sym(name, each[0].numel_in(i)) for i, name in enumerate("zbct")]
    z = ca.MX.sym("z", at.size)
    by_kind = ca.Function.conditional("by_kind", each, ca.Function("idle", [z, *given[1:]], [z]))
    nodes = [given[0]]
    for _ in range(method.trials):
        last = nodes[-1]
        nodes.append(by_kind(last[at.which], last, *given[1:]))  # a stopped burst repeats its last node
    return Mapped(ca.Function("burst", given, [ca.vertcat(*nodes[1:])]), within=sum(f.n_instructions() for f in each))


def paced(model: Model, method: Method, mode: ModeName, locating: bool) -> ca.Function:
    """One trial in one mode, walking on or locating a switch: (z, bounds, constants, tolerances) -> z after it."""
    at = BurstState(len(model.states))
    z, bounds = ca.SX.sym("z", at.size), ca.SX.sym("bounds", 5)
    c, tolerances = ca.SX.sym("c", len(model.parameters) + numbers_of(model)), ca.SX.sym("tolerances", at.n + 1)
    x, t, ends, control = z[: at.n], z[at.t], z[at.ends], z[at.control]
    exits = [GUARDS.index(name) for name in sliding_modes(model.clamped is not None)[mode]]
    h = z[at.h] if locating else _length(model, at, z, exits, bounds)
    row = trial(model, method, mode)(ca.vertcat(x, t, h), c, tolerances)
    after, after_ends = row[: at.n], row[at.n + 1 :]
    if locating:
        moved, *control_after, stop = _locating(control, h, after_ends, exits, tolerances[0])
    else:
        moved, *control_after, stop = _walking(at, z, h, row[at.n :], exits, bounds, method)
    new = ca.vertcat(
        ca.if_else(moved, after, x),
        t + ca.if_else(moved, h, 0),
        stop,
        *control_after,
        ca.if_else(moved, after_ends, ends),
        ca.if_else(stop < 0.5, 2 * MODES.index(mode) + (control_after[4] > 0.0), -1),
    )
    return ca.Function("paced", [z, bounds, c, tolerances], [ca.cse(ca.densify(new))])


def _length(model: Model, at: BurstState, z: ca.SX, exits: list[int], bounds: ca.SX) -> ca.SX:
    """Length of the next step: what the error suggests, within its bounds."""
    ends, h = z[at.ends], ca.fmin(ca.fmin(z[at.h], bounds[1]), bounds[0] - z[at.t])
    for i in exits:
        # Not far beyond a switch that is near: it is sought from both ends of the step.
        value, slope = ends[i], ends[N_GUARDS + i]
        near = ca.logic_and(value > 0.0, slope * h < -BEYOND * value)
        h = ca.if_else(near, -BEYOND * value / slope, h)
    if model.finest.numel_out(0):
        h = ca.fmin(h, bounds[4] / ca.fmax(ca.fabs(z[SPEED]), 1e-300))
    return h


def _walking(
    at: BurstState,
    z: ca.SX,
    h: ca.SX,
    trial_end: ca.SX,
    exits: list[int],
    bounds: ca.SX,
    method: Method,
) -> tuple[ca.SX, ...]:
    """Whether a trial of length h towards the next node is taken, and the control after it."""
    t, before, control, ends = z[at.t], z[at.ends], z[at.control], trial_end[1:]
    error, step, watch = control[1], control[2], control[6]
    norm = ca.if_else(trial_end[0] <= 1e30, ca.fmax(trial_end[0], 1e-10), 1e30)
    good, fallen, risen, crossing, dip = norm <= 1.0, 0.0, 0.0, h, h
    # The step after it: as the error says, and as its trend says where it grows (Gustafsson's predictive control).
    root = _root(norm, method.measured)
    slower = root / SAFETY
    trend = slower * step / h * root / ca.fmax(error, 1e-10)
    slower = ca.if_else(ca.logic_and(good, step > 0.0), ca.fmax(slower, trend), slower)
    following = h * ca.fmax(SHRINKING, ca.fmin(GROWTH, 1.0 / slower))
    for i in exits:
        down = ca.logic_or(ends[i] < 0.0, ca.logic_and(ends[i] <= 0.0, t > 0.0))
        fallen = ca.logic_or(fallen, down)
        risen = ca.logic_or(risen, ca.logic_and(down, before[i] <= 0.0))
        crossing = ca.fmin(crossing, ca.if_else(down, _first_guess(h, before, ends, i), h))
        dip = ca.fmin(dip, _dip(h, before, ends, i))
    met, dips = ca.logic_and(good, fallen), ca.logic_and(ca.logic_and(good, watch > 0.5), dip < h)
    taken = ca.logic_and(good, ca.logic_not(ca.logic_or(fallen, dips)))
    # Event functions that were not positive at the start, and switches that are not to be located: decided outside.
    outside = ca.logic_and(met, ca.logic_or(risen, bounds[3] < 0.5))
    over = ca.logic_and(taken, t + h >= bounds[0] * (1.0 - 1e-15))
    stuck = ca.logic_and(norm > 1.0, following < bounds[2])
    next_h = ca.if_else(met, ca.if_else(outside, h, crossing), ca.if_else(dips, dip, following))
    next_watch = ca.if_else(dips, watch - 1, ca.if_else(dip < h, watch, DIPS))
    stop = Stop.EVENT * outside + Stop.TIME_IS_UP * over + Stop.STUCK * stuck
    last = ca.if_else(taken, root, error), ca.if_else(taken, h, step)
    return taken, next_h, *last, 0, ca.if_else(met, h, 0), 0, next_watch, stop


def _root(value: ca.SX, degree: int) -> ca.SX:
    """value^(1/degree), by square roots where they do."""
    if degree == 1:
        return value
    return ca.sqrt(_root(value, degree // 2)) if degree % 2 == 0 else value ** (1.0 / degree)


def _first_guess(h: ca.SX, before: ca.SX, ends: ca.SX, i: int) -> ca.SX:
    """Where within a step event function i falls to zero: Hermite's cubic for time by its value, else the chord."""
    v0, s0, v1, s1 = before[i], before[N_GUARDS + i], ends[i], ends[N_GUARDS + i]
    share, falls = v0 / (v0 - v1), ca.logic_and(s0 < 0.0, s1 < 0.0)
    a, b = (v1 - v0) / (ca.if_else(falls, s0, 1.0) * h), (v1 - v0) / (ca.if_else(falls, s1, 1.0) * h)
    cubic = share * share * (3.0 - 2.0 * share) + share * (1.0 - share) * ((1.0 - share) * a - share * b)
    inside = ca.logic_and(falls, ca.logic_and(cubic > 0.0, cubic < 1.0))
    return h * ca.if_else(inside, cubic, share)


def _dip(h: ca.SX, before: ca.SX, ends: ca.SX, i: int) -> ca.SX:
    """Where within a step of length h event function i has a minimum near zero, by Hermite's cubic; h if none."""
    v0, s0, v1, s1 = before[i], h * before[N_GUARDS + i], ends[i], h * ends[N_GUARDS + i]
    turning = ca.logic_and(v0 > 0.0, ca.logic_and(s0 < 0.0, s1 > 0.0))
    a, b = 3.0 * (s0 + s1 - 2.0 * (v1 - v0)), 3.0 * (v1 - v0) - 2.0 * s0 - s1
    root = b + ca.sqrt(ca.fmax(b * b - a * s0, 0.0))
    share = ca.if_else(ca.logic_and(turning, root > 0.0), -s0 / ca.if_else(root > 0.0, root, 1.0), 1.0)
    lowest = v0 + share * (s0 + share * (b + share * a / 3.0))
    near = ca.logic_and(lowest < 0.25 * ca.fmin(v0, v1), ca.logic_and(share > 0.0, share < 1.0))
    return ca.if_else(ca.logic_and(turning, near), share * h, h)


def _locating(control: ca.SX, h: ca.SX, ends: ca.SX, exits: list[int], rtol: ca.SX) -> tuple[ca.SX, ...]:
    """Whether a trial of length h ends at the switch looked for, and the control after it: Newton within a bracket."""
    newton, hit, fallen = ca.inf, 0.0, 0.0
    for i in exits:
        value, slope = ends[i], ends[N_GUARDS + i]
        newton = ca.fmin(newton, ca.if_else(slope < 0.0, h - value / ca.if_else(slope < 0.0, slope, 1.0), ca.inf))
        hit, fallen = ca.logic_or(hit, value == 0.0), ca.logic_or(fallen, value <= 0.0)
    low, high = ca.if_else(fallen, control[3], h), ca.if_else(fallen, h, control[4])
    inside = ca.logic_and(newton > low, newton < high)
    following = ca.if_else(inside, newton, 0.5 * (low + high))
    move, length = ca.fabs(newton - h), ca.sqrt(rtol) * control[4]
    done = ca.logic_or(ca.logic_or(hit, control[5] > 0.5), ca.logic_or(move <= 1e-15 * h, high - low <= 1e-15 * high))
    # One more step of Newton's method is then as exact as the step itself.
    near = ca.logic_and(inside, move <= 0.1 * length)
    return done, following, control[1], control[2], low, high, near, 0, Stop.LOCATED * done


# Steps of one scene with one method: the compiled trials and bursts with their buffers.


class Stepper:
    """Steps one model with one method; holds buffers, so one per thread."""

    def __init__(self, model: Model, method: Method) -> None:
        self.model, self.method = model, method
        self.places = BurstState(len(model.states))
        n = self.places.n
        self._z, self._xth = np.zeros(self.places.size), np.zeros(n + 2)
        self._bounds, self._constants = np.zeros(5), np.zeros(len(model.parameters) + numbers_of(model))
        self._tolerances = np.zeros(n + 1)
        x, t = self._xth[:-2], self._xth[-2:-1]
        self._trials, self._ends, self._coefficients = (dict[ModeName, Compiled]() for _ in range(3))
        for mode in sliding_modes(model.clamped is not None):
            for calls, function, given in (
                (self._trials, trial(model, method, mode), [self._xth, self._constants, self._tolerances]),
                (self._ends, event_functions(model, mode), [self._z[:n], self._constants, np.zeros(1)]),
                (self._coefficients, coefficient(model, mode), [x, self._constants, t]),
            ):
                calls[mode] = Compiled(function)
                calls[mode].bind(given)
        self._burst = burst(model, method)

    def tune(self, p: Array, tolerances: Array, bounds: tuple[float, float, float, bool]) -> None:
        """Set parameters p (n_p,), tolerances of a step (rtol, then atol (n_x,)), and its bounds: longest and shortest
        [s], farthest way [m], whether switches are located (else a burst stops at the step that passes one).
        """
        self._constants[: p.size] = p
        self._tolerances[:] = tolerances
        longest, shortest, farthest, locate = bounds
        self._bounds[1:5] = longest, shortest, float(locate), farthest

    def start(self, mode: ModeName, x: Array | list[float], situated: Situated, limit: float, h: float) -> None:
        """Begin to slide in a mode from x (n_x,) with a step of length h [s]; it may last `limit` [s]."""
        self._constants[situated.p.size :] = situated.numbers(self.model)
        self._bounds[0] = limit
        z, n = self._z, self.places.n
        z[:n] = x
        ends = self._ends[mode]().tolist()
        z[n:] = [0.0, 0.0, h, 0.0, 0.0, 0.0, 0.0, 0.0, DIPS, *ends, 2 * MODES.index(mode)]

    @property
    def speeding(self) -> float:
        """How fast the speed along the direction of slip rises at the last node [m/s^2]."""
        return self.ends[N_GUARDS + GUARDS.index("speed")]

    @property
    def pace(self) -> float:
        """Length of the last step that was taken whole [s]."""
        return float(self._z[self.places.control][2])

    def go_on(self) -> list[list[float]]:
        """Several trials from where the last call stopped: rows of state, time, stop and h as in `BurstState`; those
        after a stop repeat it."""
        given = (self._z, self._bounds, self._constants, self._tolerances)
        rows = self._burst([each[None] for each in given])[0].reshape(self.method.trials, -1)
        self._z[:] = rows[-1]
        return rows[:, : self.places.h + 1].tolist()

    @property
    def ends(self) -> list[float]:
        """Event functions and their slopes at the last node."""
        return self._z[self.places.ends].tolist()

    def trial(self, mode: ModeName, x: list[float], t: float, h: float) -> list[float]:
        """A step of length h [s] from x at time t [s]: state after, error norm, event functions, their slopes."""
        n = self.places.n
        self._xth[:n], self._xth[n], self._xth[n + 1] = x, t, h
        return self._trials[mode]().tolist()

    def coefficient(self, mode: ModeName, x: Sequence[float] | Array, t: float) -> float:
        """Friction coefficient in state x at time t [s] of this slide, positive where friction brakes."""
        self._xth[:-2], self._xth[-2] = x, t
        return float(self._coefficients[mode]()[0])
