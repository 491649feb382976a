"""Several trial steps in one call: the step length follows the error, switches are located, modes follow each other.

A burst stops where the mass comes to rest, where its time is up, or where something has to be decided outside.
"""

from __future__ import annotations

from enum import IntEnum
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.model.model import SPEED, Model
from identify.model.modes import GUARDS, ModeName, sliding_modes
from identify.simulation.steppers import Expression, Method, StepProblem

# ----------------------------------------------------------------------------------------------------------------------
# One trial step of a model as a compiled function: the state after it, its error, and the guards of its mode.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

N_GUARDS = len(GUARDS)
ROUNDING = 1e-15  # of the forces: a few last digits
ABOVE = 1e-3  # of its reach: by so much a bounded state may err beyond its upper bound
LARGEST = 1e150  # of a state: beyond, squares overflow


def inputs(drive: Expression, t: Expression) -> Expression:
    """u (4,) of the model at time t of a phase, from what it is situated in: `Situated.numbers` (5,)."""
    return ca.vertcat(drive[0], drive[2] + drive[3] * t, drive[1], drive[4] + t)


def symbols(model: Model) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
    """State x, constants (n_p + 5,) and time t in a phase, and in terms of these parameters p and inputs u."""
    x, t, c = ca.SX.sym("x", len(model.states)), ca.SX.sym("t"), ca.SX.sym("c", len(model.parameters) + 5)
    return x, c, t, c[:-5], inputs(c[-5:], t)


def rate(model: Model, mode: ModeName) -> ca.Function:
    """(x, constants (n_p + 5,), t in phase) -> dx/dt."""
    x, c, t, p, u = symbols(model)
    field = model.worn if mode == "worn" else model.slip
    return ca.Function("rate", [x, c, t], [ca.densify(field(x, p, u))])


@lru_cache(maxsize=64)
def ends(model: Model, mode: ModeName) -> ca.Function:
    """(x, constants, t) -> guards and their slopes in time (2 N_GUARDS,); 1 where one does not end the mode."""
    moving, free = rate(model, mode), rate(model, "slip")
    x, c, t, _p, _u = symbols(model)
    exits = dict(sliding_modes(model.clamped is not None)[mode].exits)
    guards = [c[-4] * x[SPEED], ca.SX(1), ca.SX(1)]
    if model.clamped is not None and "clearance" in exits:
        guards[1] = x[model.clamped] - (model.states[model.clamped].lower or 0.0)
    if model.clamped is not None and "release" in exits:
        guards[2] = -free(x, c, t)[model.clamped]
    guard = ca.vertcat(*guards)
    slopes = ca.jtimes(guard, x, moving(x, c, t)) + ca.jacobian(guard, t)
    return ca.Function("ends", [x, c, t], [ca.densify(ca.vertcat(guard, slopes))])


def _load_size(model: Model) -> ca.Function:
    """(x, constants, t) -> size of the force of the rig over the mass [m/s^2]."""
    x, c, t, p, u = symbols(model)
    load = model.load(x, p, u)
    return ca.Function("load_size", [x, c, t], [ca.densify(ca.fabs(load) / p[model.parameter_names.index("mass")])])


@lru_cache(maxsize=64)
def trial(model: Model, method: Method, mode: ModeName, stops: bool = True) -> ca.Function:
    """(x and t and h, constants, tolerances) -> x after, error norm (<= 1 acceptable), guards and their slopes.

    One vector; constants: p, then the inputs of `Situated`; tolerances: rtol, atol (n_x,). stops as of `burst`: a
    motion that goes on through rest may leave the bounds of a state.
    """
    kind, n = method.kind, len(model.states)
    z = kind.sym("z", n + 2)
    c, tolerances = kind.sym("c", len(model.parameters) + 5), kind.sym("tolerances", n + 1)
    x, t, h = z[:n], z[n], z[n + 1]
    after, norm = method.step(_problem(model, mode, z, c, tolerances), x, t, h)
    # A largest value hides what is not a number: such a step is refused.
    norm = ca.if_else(ca.sum1(ca.fabs(after)) < LARGEST, norm, ca.inf)
    # So is one to where no motion leads: the equations of an implicit step have other solutions, too.
    for i, state in enumerate(model.states if stops else ()):
        if state.lower is not None and state.upper is not None:
            reach = state.upper - state.lower
            inside = ca.logic_and(after[i] < state.upper + ABOVE * reach, after[i] > state.lower - reach)
            norm = ca.if_else(inside, norm, ca.inf)
    row = ca.vertcat(after, norm, ends(model, mode)(after, c, t + h))
    return ca.Function(f"trial_{mode}", [z, c, tolerances], [ca.cse(ca.densify(row))])


@lru_cache(maxsize=64)
def within(model: Model, method: Method, mode: ModeName) -> ca.Function:
    """(x and t and h and part and x after, constants, tolerances) -> x at t + part [s], inside a step of length h [s]
    from t.
    """
    kind, n = method.kind, len(model.states)
    z = kind.sym("z", 2 * n + 3)
    c, tolerances = kind.sym("c", len(model.parameters) + 5), kind.sym("tolerances", n + 1)
    x, t, h, part = z[:n], z[n], z[n + 1], z[n + 2]
    inside = method.within(_problem(model, mode, z, c, tolerances), x, t, h, part, z[n + 3 :])
    return ca.Function(f"within_{mode}", [z, c, tolerances], [ca.cse(ca.densify(inside))])


def _problem(model: Model, mode: ModeName, xth: Expression, c: Expression, tolerances: Expression) -> StepProblem:
    """A step of a mode from state, time and length xth, with what it is tolerated to be wrong by."""
    n, moving = len(model.states), rate(model, mode)
    x, t, h = xth[:n], xth[n], xth[n + 1]
    # What a state moves by in the step counts as its size: a speed that falls through zero is not chased to zero.
    size = ca.fabs(x) + h * ca.fabs(moving(x, c, t))

    # Forces have so many digits: what their rounding makes of the speed is no error of the step.
    blur = type(x).zeros(n)
    blur[SPEED] = h * ROUNDING * _load_size(model)(x, c, t)

    return StepProblem(moving, c, lambda after: tolerances[1:] + blur + tolerances[0] * ca.fmax(size, ca.fabs(after)))


@lru_cache(maxsize=64)
def coefficient(model: Model, mode: ModeName) -> ca.Function:
    """(x, constants, t) -> friction coefficient, positive where friction brakes."""
    x, c, t, p, u = symbols(model)
    net = p[model.parameter_names.index("mass")] * rate(model, mode)(x, c, t)[SPEED]
    return ca.Function("coefficient", [x, c, t], [ca.densify(u[2] * (model.load(x, p, u) - net) / u[1])])


MODES: tuple[ModeName, ...] = ("slip", "worn")  # numbered so in a burst
SHORTEST = 1e-14  # of the natural time: a step shorter than that is no step
GROWTH, SHRINKING, SAFETY = 10.0, 0.2, 0.9  # of the step length from one trial to the next
WRONG = 1e30  # an error as large as this, or none at all, shrinks the step as far as it goes
LAST = 1e-15  # moves of Newton's method, of a step: nothing follows
NEAR = 0.1  # the same, of the root of the tolerance: one more is as exact as the step itself
ROUGHLY, STRAIGHT = 0.5, 0.01  # where the motion of a step is smooth: one more is; a straight line from its end is
BEYOND = 2.0  # times the time in which a guard would fall to zero as it falls: no step is longer
CLOSE = 0.25  # of the guard before it: a minimum as low as this within a step is looked at
DIPS = 3  # times in a row that a dip is sought more closely


class Stop(IntEnum):
    """Why a burst stopped."""

    NOT_YET = 0
    LOCATED = 1  # the last node is a switch
    EVENT = 2  # the trial from the last node meets a guard, and is decided outside
    TIME_IS_UP = 3
    STUCK = 4  # no step is short enough


class BurstState:
    """The places in the vector that says where a burst stands: the node x (n_x,), its time t, the mode (place in
    `MODES`), `Stop`, and then the control.

    Control: h, length of the next trial. error, step: root of the error and length of the last step taken (0: none).
    low, high: lengths between which a switch is being located (high 0: none is). final: the coming trial ends at the
    switch. watch: how often a dip may still be sought. Guards and their slopes at the node. Last, which trial comes:
    twice the mode, one more where a switch is being located; -1 none.
    """

    def __init__(self, n: int) -> None:
        """n: of states."""
        self.n, self.t, self.mode, self.stop, self.h = n, n, n + 1, n + 2, n + 3
        self.control, self.ends = slice(n + 3, n + 10), slice(n + 10, n + 10 + 2 * N_GUARDS)
        self.which = n + 10 + 2 * N_GUARDS
        self.size = self.which + 1


@lru_cache(maxsize=64)
def burst(model: Model, method: Method, stops: bool) -> ca.Function:
    """`method.trials` trials in a row: (z, bounds, constants, tolerances) -> z after each of them, column by column.

    z as in `BurstState`; bounds: time limit, longest and shortest step [s], whether switches are located, farthest way
    of a step [m]. The step length follows the error; where a guard
    has fallen the trials go on from the same node, with lengths by Newton's method, until the guard is zero. A trial
    that is refused repeats the node with another length. Without `stops` the mass goes on through rest, by the motion
    forwards.
    """
    at, modes = BurstState(len(model.states)), MODES[: len(sliding_modes(model.clamped is not None))]
    paced = [_paced(model, method, mode, locating, stops) for mode in modes for locating in (False, True)]
    given = [ca.MX.sym(name, paced[0].numel_in(i)) for i, name in enumerate("zbct")]
    z = ca.MX.sym("z", at.size)
    by_mode = ca.Function.conditional("by_mode", paced, ca.Function("idle", [z, *given[1:]], [z]))
    nodes = [given[0]]
    for _ in range(method.trials):
        last = nodes[-1]
        nodes.append(by_mode(last[at.which], last, *given[1:]))  # a stopped burst repeats its last node
    return ca.Function("burst", given, [ca.horzcat(*nodes[1:])])


def _paced(model: Model, method: Method, mode: ModeName, locating: bool, stops: bool) -> ca.Function:
    """One trial in one mode, walking on or locating a switch: (z, bounds, constants, tolerances) -> z after it."""
    kind, at = method.kind, BurstState(len(model.states))
    z, bounds = kind.sym("z", at.size), kind.sym("bounds", 5)
    c, tolerances = kind.sym("c", len(model.parameters) + 5), kind.sym("tolerances", at.n + 1)
    x, t, ends, control = z[: at.n], z[at.t], z[at.ends], z[at.control]
    watched = [GUARDS.index(name) for name, _ in sliding_modes(model.clamped is not None)[mode].exits]
    exits = [i for i in watched if stops or GUARDS[i] != "speed"]
    h = z[at.h] if locating else _length(model, at, z, exits, bounds)
    row = trial(model, method, mode, stops)(ca.vertcat(x, t, h), c, tolerances)
    there, there_ends = row[: at.n], row[at.n + 1 :]
    mode_after: Expression = MODES.index(mode)
    if locating:
        (moved, *control_after, stop), through, more = _locating(
            control, h, there_ends, exits, tolerances[0], method.smooth
        )
        there, h = there + more * rate(model, mode)(there, c, t + h), h + more
        if model.clamped is not None:
            there, there_ends = _through(model, there, there_ends, through)
            mode_after = ca.if_else(through, 1 - mode_after, mode_after)
    else:
        moved, *control_after, stop = _walking(at, z, h, row[at.n :], (exits, watched), bounds, method)
    new = ca.vertcat(
        ca.if_else(moved, there, x),
        t + ca.if_else(moved, h, 0),
        mode_after,
        stop,
        *control_after,
        ca.if_else(moved, there_ends, ends),
        ca.if_else(stop < 0.5, 2 * mode_after + (control_after[4] > 0.0), -1),
    )
    return ca.Function("paced", [z, bounds, c, tolerances], [ca.cse(ca.densify(new))])


def _length(model: Model, at: BurstState, z: Expression, exits: list[int], bounds: Expression) -> Expression:
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


def _through(model: Model, x: Expression, ends: Expression, through: Expression) -> tuple[Expression, Expression]:
    """State and guards at a switch to the other mode of sliding: the bounded state exactly at its bound, and the guard
    that counts there positive until the next node tells."""
    assert model.clamped is not None
    lower, speed = model.states[model.clamped].lower or 0.0, GUARDS.index("speed")
    bound = ca.if_else(through, lower, x[model.clamped])
    after = [ca.if_else(through, float(i < N_GUARDS), ends[i]) for i in range(2 * N_GUARDS)]
    after[speed], after[N_GUARDS + speed] = ends[speed], ends[N_GUARDS + speed]
    return ca.vertcat(x[: model.clamped], bound, x[model.clamped + 1 :]), ca.vertcat(*after)


def _walking(
    at: BurstState,
    z: Expression,
    h: Expression,
    trial_end: Expression,
    guards: tuple[list[int], list[int]],
    bounds: Expression,
    method: Method,
) -> tuple[Expression, ...]:
    """Whether a trial of length h towards the next node is taken, and the control after it; guards: those that end the
    mode, and those of which a minimum near zero is to be a node."""
    exits, watched = guards
    t, before, control, ends = z[at.t], z[at.ends], z[at.control], trial_end[1:]
    error, step, watch = control[1], control[2], control[6]
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
    for i in watched:
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
    """Where within a step of length h guard i has a minimum that comes close to zero, by Hermite's cubic; h if none."""
    v0, s0, v1, s1 = before[i], h * before[N_GUARDS + i], ends[i], h * ends[N_GUARDS + i]
    turning = ca.logic_and(v0 > 0.0, ca.logic_and(s0 < 0.0, s1 > 0.0))
    a, b = 3.0 * (s0 + s1 - 2.0 * (v1 - v0)), 3.0 * (v1 - v0) - 2.0 * s0 - s1
    root = b + ca.sqrt(ca.fmax(b * b - a * s0, 0.0))
    share = ca.if_else(ca.logic_and(turning, root > 0.0), -s0 / ca.if_else(root > 0.0, root, 1.0), 1.0)
    lowest = v0 + share * (s0 + share * (b + share * a / 3.0))
    near = ca.logic_and(lowest < CLOSE * ca.fmin(v0, v1), ca.logic_and(share > 0.0, share < 1.0))
    return ca.if_else(ca.logic_and(turning, near), share * h, h)


def _locating(
    control: Expression,
    h: Expression,
    ends: Expression,
    exits: list[int],
    rtol: Expression,
    smooth: bool,
) -> tuple[tuple[Expression, ...], Expression, Expression]:
    """Whether a trial of length h ends at the switch looked for, and the control after it: Newton within a bracket;
    whether it is a switch to the other mode of sliding, through which the trials go on; and how much longer than the
    trial it is to the switch [s], along a straight line."""
    newton, hit, fallen, to_rest, to_other = ca.inf, 0.0, 0.0, ca.inf, ca.inf
    for i in exits:
        value, slope = ends[i], ends[N_GUARDS + i]
        away = ca.fabs(value) / ca.fmax(ca.fabs(slope), 1e-300)
        newton = ca.fmin(newton, ca.if_else(slope < 0.0, h - value / ca.if_else(slope < 0.0, slope, 1.0), ca.inf))
        hit, fallen = ca.logic_or(hit, value == 0.0), ca.logic_or(fallen, value <= 0.0)
        if GUARDS[i] == "speed":
            to_rest = away
        else:
            to_other = away
    low, high = ca.if_else(fallen, control[3], h), ca.if_else(fallen, h, control[4])
    inside = ca.logic_and(newton > low, newton < high)
    following = ca.if_else(inside, newton, 0.5 * (low + high))
    move = ca.fabs(newton - h)
    done = ca.logic_or(ca.logic_or(hit, control[5] > 0.5), ca.logic_or(move <= LAST * h, high - low <= LAST * high))
    length = ca.sqrt(rtol) * control[4]
    near = ca.logic_and(inside, move <= (ROUGHLY if smooth else NEAR) * length)
    more: Expression = 0.0
    if smooth:
        straight = ca.logic_and(ca.logic_and(inside, move <= STRAIGHT * length), ca.logic_not(hit))
        more, done = ca.if_else(straight, newton - h, 0.0), ca.logic_or(done, straight)
    passes = ca.logic_and(done, to_other < to_rest)
    # Beyond a switch the steps go on as long as they were; what the error did before says nothing there.
    next_h = ca.if_else(passes, ca.fmax(control[2], h), following)
    kept = ca.if_else(passes, 0, 1)
    stop = Stop.LOCATED * ca.logic_and(done, ca.logic_not(passes))
    same = (kept * control[1], kept * control[2], kept * low, kept * high, kept * near)
    return (done, next_h, *same, ca.if_else(passes, DIPS, 0), stop), passes, more
