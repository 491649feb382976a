"""Steps of a model as compiled functions: one trial step with its error and its guards, and several in one call.

A trial is what a method makes of one step length; a burst tries several, with the step length following the error,
and stops at the first step that needs a decision.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.compiled import Compiled, compiled
from identify.methods import Method
from identify.methods.interface import Expression
from identify.model import SPEED, Model
from identify.modes import GUARDS, ModeName, sliding_modes
from identify.situated import Situated

Array = NDArray[np.float64]

N_GUARDS = len(GUARDS)
SHORTEST = 1e-14  # of the natural time: a step shorter than that is no step
GROWTH, SHRINKING, SAFETY = 5.0, 0.2, 0.9  # of the step length from one trial to the next
WRONG = 1e30  # an error as large as this, or none at all, shrinks the step as far as it goes
LAST = 1e-15  # moves of Newton's method, of a step: nothing follows
NEAR = 0.1  # the same, of the root of the tolerance: one more is as exact as the step itself
CLOSE = 0.25  # of the guard before it: a minimum as low as this within a step is looked at


ROUNDING = 1e-15  # of the forces: a few last digits
LARGEST = 1e150  # of a state: beyond, squares overflow
DIPS = 3  # times in a row that a dip is sought more closely


class Stop(IntEnum):
    """Why a burst stopped."""

    NOT_YET = 0
    LOCATED = 1  # the last node is a switch
    EVENT = 2  # the trial from the last node meets a guard, and is decided outside
    TIME_IS_UP = 3
    STUCK = 4  # no step is short enough


def _rate(model: Model, mode: ModeName, steady: bool) -> ca.Function:
    """(x, constants (n_p + 5,), t in phase) -> dx/dt; `steady`: the normal force has no slope."""
    x, t, c = ca.SX.sym("x", len(model.states)), ca.SX.sym("t"), ca.SX.sym("c", len(model.parameters) + 5)
    field = model.saturated if mode == "saturated" else model.slip
    p, drive = c[:-5], c[-5:]
    force = drive[2] if steady else drive[2] + drive[3] * t
    u = ca.vertcat(drive[0], force, drive[1], drive[4] + t)
    return ca.Function("rate", [x, c, t], [ca.densify(field(x, p, u))])


@lru_cache(maxsize=64)
def takes(model: Model, method: Method, mode: ModeName, steady: bool) -> bool:
    """Whether a method can integrate a mode of the model; `steady`: under a constant normal force."""
    return method.takes(_rate(model, mode, steady))


@lru_cache(maxsize=64)
def _ends(model: Model, mode: ModeName) -> ca.Function:
    """(x, constants, t) -> guards and their slopes in time (2 N_GUARDS,); 1 where one does not end the mode."""
    rate = _rate(model, mode, steady=False)
    free = _rate(model, "slip", steady=False)
    x, t, c = ca.SX.sym("x", len(model.states)), ca.SX.sym("t"), ca.SX.sym("c", len(model.parameters) + 5)
    exits = dict(sliding_modes(model.clamped is not None)[mode].exits)
    guards = [c[-4] * x[SPEED], ca.SX(1), ca.SX(1)]
    if model.clamped is not None and "clearance" in exits:
        guards[1] = x[model.clamped] - (model.states[model.clamped].lower or 0.0)
    if model.clamped is not None and "release" in exits:
        guards[2] = -free(x, c, t)[model.clamped]
    guard = ca.vertcat(*guards)
    slopes = ca.jtimes(guard, x, rate(x, c, t)) + ca.jacobian(guard, t)
    return ca.Function("ends", [x, c, t], [ca.densify(ca.vertcat(guard, slopes))])


@lru_cache(maxsize=64)
def _pull(model: Model) -> ca.Function:
    """(x, constants, t) -> size of the force of the rig over the mass [m/s^2]."""
    x, t, c = ca.SX.sym("x", len(model.states)), ca.SX.sym("t"), ca.SX.sym("c", len(model.parameters) + 5)
    p, drive = c[:-5], c[-5:]
    load = model.load(x, p, ca.vertcat(drive[0], drive[2] + drive[3] * t, drive[1], drive[4] + t))
    return ca.Function("pull", [x, c, t], [ca.densify(ca.fabs(load) / p[model.parameter_names.index("mass")])])


@lru_cache(maxsize=64)
def trial(model: Model, method: Method, mode: ModeName) -> ca.Function:
    """(x and t and h, constants, tolerances) -> x after, error norm (<= 1 acceptable), guards and their slopes.

    One vector; constants: p, then the inputs of `Situated`; tolerances: rtol, atol (n_x,).
    """
    kind, n = method.kind, len(model.states)
    z = kind.sym("z", n + 2)
    c, tolerances = kind.sym("c", len(model.parameters) + 5), kind.sym("tolerances", n + 1)
    x, t, h = z[:n], z[n], z[n + 1]

    rate = _rate(model, mode, steady=False)
    # What a state moves by in the step counts as its size: a speed that falls through zero is not chased to zero.
    size = ca.fabs(x) + h * ca.fabs(rate(x, c, t))

    # Forces have so many digits: what their rounding makes of the speed is no error of the step.
    blur = ca.SX.zeros(n) if kind is ca.SX else ca.MX.zeros(n)
    blur[SPEED] = h * ROUNDING * _pull(model)(x, c, t)

    def scale(after: Expression) -> Expression:
        return tolerances[1:] + blur + tolerances[0] * ca.fmax(size, ca.fabs(after))

    after, norm = method.step(rate, x, c, t, h, scale)
    # A largest value hides what is not a number: such a step is refused.
    norm = ca.if_else(ca.sum1(ca.fabs(after)) < LARGEST, norm, ca.inf)
    row = ca.vertcat(after, norm, _ends(model, mode)(after, c, t + h))
    return ca.Function(f"trial_{mode}", [z, c, tolerances], [ca.cse(ca.densify(row))])


@dataclass(frozen=True)
class Pace:
    """Where a burst stands, as a vector: the node x (n_x,) and its time t, guards and their slopes there, and then

    h: length of the next trial. error, step: root of the error and length of the last step taken (0: none).
    low, high: lengths between which a switch is being located (high 0: none is). final: the coming trial ends at the
    switch. watch: how often a dip may still be sought. stop: `Stop`.
    """

    n: int  # of states

    @property
    def t(self) -> int:
        """Place of the time, behind the state."""
        return self.n

    @property
    def ends(self) -> slice:
        """Places of the guards and their slopes."""
        return slice(self.n + 1, self.n + 1 + 2 * N_GUARDS)

    @property
    def control(self) -> slice:
        """Places of the rest: h, error, step, low, high, final, watch, stop."""
        return slice(self.ends.stop, self.ends.stop + 8)

    @property
    def h(self) -> int:
        """Place of the length of the next trial."""
        return self.control.start


@lru_cache(maxsize=64)
def burst(model: Model, method: Method, mode: ModeName) -> ca.Function:
    """`method.trials` trials in a row: (z, bounds, constants, tolerances) -> z after each of them, column by column.

    z as in `Pace`; bounds: time limit, longest and shortest step [s], whether switches are located, farthest way of a
    step [m]. The step length
    follows the error; where a guard has fallen the trials go on from the same node, with lengths by Newton's method,
    until the guard is zero. A trial that is refused repeats the node with another length.
    """
    kind, at = method.kind, Pace(len(model.states))
    z, bounds = kind.sym("z", at.control.stop), kind.sym("bounds", 5)
    c, tolerances = kind.sym("c", len(model.parameters) + 5), kind.sym("tolerances", at.n + 1)
    x, t, ends = z[: at.n], z[at.t], z[at.ends]
    h, high = z[at.h], z[at.h + 4]
    locating = high > 0.0
    free = ca.fmin(ca.fmin(h, bounds[1]), bounds[0] - t)
    if model.finest.numel_out(0):
        free = ca.fmin(free, bounds[4] / ca.fmax(ca.fabs(x[SPEED]), 1e-300))
    h = ca.if_else(locating, h, free)
    row = trial(model, method, mode)(ca.vertcat(x, t, h), c, tolerances)
    exits = [GUARDS.index(name) for name, _ in sliding_modes(model.clamped is not None)[mode].exits]
    found = _locating(z[at.control], h, row[at.n + 1 :], exits, tolerances[0])
    walked = _walking(z[at.control], t, h, ends, row[at.n :], exits, bounds, method)
    moved, *control = (ca.if_else(locating, f, w) for f, w in zip(found, walked, strict=True))
    after = ca.vertcat(
        ca.if_else(moved, row[: at.n], x), t + ca.if_else(moved, h, 0), ca.if_else(moved, row[at.n + 1 :], ends)
    )
    one = ca.Function(f"paced_{mode}", [z, bounds, c, tolerances], [ca.cse(ca.densify(ca.vertcat(after, *control)))])
    return _in_a_row(one, z, bounds, c, tolerances, method.trials)


def _in_a_row(
    one: ca.Function, z: Expression, bounds: Expression, c: Expression, tol: Expression, n: int
) -> ca.Function:
    """n trials, two at a time: what comes after the stop is skipped, or repeats the stop."""
    first = one(z, bounds, c, tol)
    second = ca.if_else(first[-1] < 0.5, one(first, bounds, c, tol), first)
    pair = ca.Function("pair", [z, bounds, c, tol], [ca.cse(ca.densify(ca.horzcat(first, second)))])
    idle = ca.Function("idle", [z, bounds, c, tol], [ca.horzcat(z, z)])
    either = ca.Function.if_else("unless_stopped", pair, idle)
    given = [ca.MX.sym(name, size) for name, size in zip("zbct", map(one.numel_in, range(4)), strict=True)]
    nodes = [pair(*given)]
    for _ in range(n // 2 - 1):
        last = nodes[-1][:, 1]
        nodes.append(either(last[-1] < 0.5, last, *given[1:]))
    return ca.Function("burst", given, [ca.horzcat(*nodes)])


def _walking(
    control: Expression,
    t: Expression,
    h: Expression,
    before: Expression,
    trial_end: Expression,
    exits: list[int],
    bounds: Expression,
    method: Method,
) -> tuple[Expression, ...]:
    """Whether a trial of length h towards the next node is taken, and the control after it."""
    ends, error, step, watch = trial_end[1:], control[1], control[2], control[6]
    norm = ca.if_else(trial_end[0] <= WRONG, ca.fmax(trial_end[0], 1e-10), WRONG)
    good, fallen, risen, guess, dip = norm <= 1.0, 0.0, 0.0, h, h
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
        guess = ca.fmin(guess, ca.if_else(down, _first_guess(h, before, ends, i), h))
        dip = ca.fmin(dip, _dip(h, before, ends, i))
    met, dips = ca.logic_and(good, fallen), ca.logic_and(ca.logic_and(good, watch > 0.5), dip < h)
    taken = ca.logic_and(good, ca.logic_not(ca.logic_or(fallen, dips)))
    # Guards that were not positive at the start, and switches that are not to be located, are decided outside.
    outside = ca.logic_and(met, ca.logic_or(risen, bounds[3] < 0.5))
    over = ca.logic_and(taken, t + h >= bounds[0] * (1.0 - 1e-15))
    stuck = ca.logic_and(norm > 1.0, following < bounds[2])
    next_h = ca.if_else(met, ca.if_else(outside, h, guess), ca.if_else(dips, dip, following))
    next_watch = ca.if_else(dips, watch - 1, ca.if_else(dip < h, watch, DIPS))
    stop = Stop.EVENT * outside + Stop.TIME_IS_UP * over + Stop.STUCK * stuck
    last = ca.if_else(taken, root, error), ca.if_else(taken, h, step)
    return taken, next_h, *last, 0, ca.if_else(met, h, 0), 0, next_watch, stop


def _root(value: Expression, degree: int) -> Expression:
    """value^(1/degree), by square roots where they do."""
    if degree == 1:
        return value
    return ca.sqrt(_root(value, degree // 2)) if degree % 2 == 0 else value ** (1.0 / degree)


def _first_guess(h: Expression, before: Expression, ends: Expression, i: int) -> Expression:
    """Where within a step of length h guard i, which falls to zero in it, is zero: Hermite's cubic for time as a
    function of the guard where it falls at both ends, else the chord."""
    v0, s0, v1, s1 = before[i], before[N_GUARDS + i], ends[i], ends[N_GUARDS + i]
    share, falls = v0 / (v0 - v1), ca.logic_and(s0 < 0.0, s1 < 0.0)
    a, b = (v1 - v0) / (ca.if_else(falls, s0, 1.0) * h), (v1 - v0) / (ca.if_else(falls, s1, 1.0) * h)
    cubic = share * share * (3.0 - 2.0 * share) + share * (1.0 - share) * ((1.0 - share) * a - share * b)
    inside = ca.logic_and(falls, ca.logic_and(cubic > 0.0, cubic < 1.0))
    return h * ca.if_else(inside, cubic, share)


def _dip(h: Expression, before: Expression, ends: Expression, i: int) -> Expression:
    """Where within a step of length h guard i has a minimum that comes close to zero; h if it has none."""
    v0, s0, s1 = before[i], before[N_GUARDS + i], ends[N_GUARDS + i]
    turning = ca.logic_and(v0 > 0.0, ca.logic_and(s0 < 0.0, s1 > 0.0))
    length = h * s0 / ca.if_else(turning, s0 - s1, -1.0)
    near = v0 + 0.5 * s0 * length < CLOSE * ca.fmin(v0, ends[i])
    return ca.if_else(ca.logic_and(turning, near), length, h)


def _locating(
    control: Expression, h: Expression, ends: Expression, exits: list[int], rtol: Expression
) -> tuple[Expression, ...]:
    """Whether a trial of length h ends at the switch looked for, and the control after it: Newton within a bracket."""
    newton, hit, fallen = ca.inf, 0.0, 0.0
    for i in exits:
        value, slope = ends[i], ends[N_GUARDS + i]
        newton = ca.fmin(newton, ca.if_else(slope < 0.0, h - value / ca.if_else(slope < 0.0, slope, 1.0), ca.inf))
        hit, fallen = ca.logic_or(hit, value == 0.0), ca.logic_or(fallen, value <= 0.0)
    low, high = ca.if_else(fallen, control[3], h), ca.if_else(fallen, h, control[4])
    inside = ca.logic_and(newton > low, newton < high)
    following = ca.if_else(inside, newton, 0.5 * (low + high))
    move = ca.fabs(newton - h)
    done = ca.logic_or(ca.logic_or(hit, control[5] > 0.5), ca.logic_or(move <= LAST * h, high - low <= LAST * high))
    near = ca.logic_and(inside, move <= NEAR * ca.sqrt(rtol) * control[4])
    return done, following, control[1], control[2], low, high, near, 0, Stop.LOCATED * done


@lru_cache(maxsize=64)
def _coefficient(model: Model, mode: ModeName) -> ca.Function:
    """(x, constants, t) -> friction coefficient, positive where friction brakes."""
    x, t, c = ca.SX.sym("x", len(model.states)), ca.SX.sym("t"), ca.SX.sym("c", len(model.parameters) + 5)
    p, drive = c[:-5], c[-5:]
    force = drive[2] + drive[3] * t
    load = model.load(x, p, ca.vertcat(drive[0], force, drive[1], drive[4] + t))
    net = p[model.parameter_names.index("mass")] * _rate(model, mode, steady=False)(x, c, t)[SPEED]
    return ca.Function("coefficient", [x, c, t], [ca.densify(drive[1] * (load - net) / force)])


class Stepper:
    """Steps one mode of a model with one method and fixed tolerances; holds the buffers, so one per thread.

    Args:
        p: parameters (n_p,). rtol, atol (n_x,): relative and absolute tolerance of a step.
        shortest, longest: bounds of a step [s]; farthest: bound of its way [m].
        locate: whether switches are located; else a burst stops at the first step that passes one.
    """

    def __init__(
        self,
        model: Model,
        method: Method,
        mode: ModeName,
        p: Array,
        rtol: float,
        atol: Array,
        shortest: float,
        longest: float,
        farthest: float,
        locate: bool,
    ) -> None:
        self.model, self.method, self.mode = model, method, mode
        self.places = Pace(len(model.states))
        self._z, self._xth = np.zeros(self.places.control.stop), np.zeros(self.places.n + 2)
        self._bounds = np.array([0.0, longest, shortest, float(locate), farthest])
        self._constants = np.concatenate([p, np.zeros(5)])
        self.tolerances = np.concatenate([[rtol], atol])
        self._trial: Compiled = compiled(trial(model, method, mode))
        self._trial.bind([self._xth, self._constants, self.tolerances])
        self._ends: Compiled = compiled(_ends(model, mode))
        self._ends.bind([self._z[: self.places.n], self._constants, np.zeros(1)])
        self._coefficient: Compiled = compiled(_coefficient(model, mode))
        self._coefficient.bind([self._xth[:-2], self._constants, self._xth[-2:-1]])
        self._burst: Compiled = compiled(burst(model, method, mode))
        self._burst.bind([self._z, self._bounds, self._constants, self.tolerances])

    def start(self, x: Array | list[float], situated: Situated, limit: float, h: float) -> None:
        """Begin a phase in x (n_x,) with a step of length h [s]; it may last `limit` [s]."""
        self._constants[-5:] = situated.numbers
        self._bounds[0] = limit
        self._z[: self.places.n] = x
        self._z[self.places.ends] = self._ends()
        self._z[self.places.t] = 0.0
        self._z[self.places.control] = (h, 0.0, 0.0, 0.0, 0.0, 0.0, DIPS, 0.0)

    @property
    def speeding(self) -> float:
        """How fast the speed along the direction of slip rises at the last node [m/s^2]."""
        return float(self._z[self.places.ends][N_GUARDS + GUARDS.index("speed")])

    def go_on(self) -> list[list[float]]:
        """Several trials from where the last call stopped: rows as in `Pace`, the last one where it stopped."""
        rows = self._burst().reshape(self.method.trials, -1)
        self._z[:] = rows[-1]
        stopped = int(np.count_nonzero(rows[:, -1]))
        return rows[: len(rows) - stopped + 1].tolist()

    def trial(self, x: list[float], t: float, h: float) -> list[float]:
        """A step of length h [s] from x at time t [s] of the phase: state after, error norm, guards, their slopes."""
        n = self.places.n
        self._xth[:n], self._xth[n], self._xth[n + 1] = x, t, h
        return self._trial().tolist()

    def coefficient(self, x: list[float], t: float) -> float:
        """Friction coefficient in state x at time t [s] of the phase, positive where friction brakes."""
        self._xth[:-2], self._xth[-2] = x, t
        return float(self._coefficient()[0])


def steps(
    model: Model, method: Method, mode: ModeName, xth: Array, constants: Array, tolerances: Array
) -> tuple[Array, Array]:
    """States (n_x, m) after m steps of any lengths, and the error norm of each (m,): xth (n_x + 2, m) states, times in
    phase, lengths; constants (n_p + 5, m) and tolerances (n_x + 1, m) as in `trial`."""
    out, n = np.array(trial(model, method, mode)(xth, constants, tolerances)), len(model.states)
    return out[:n], out[n]
