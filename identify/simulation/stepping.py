"""One trial step of a model as a compiled function: the state after it, its error, and the guards of its mode."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.model.model import SPEED, Model
from identify.model.modes import GUARDS, ModeName, sliding_modes
from identify.simulation.interface import Expression, Scale
from identify.simulation.methods import Method

Array = NDArray[np.float64]

N_GUARDS = len(GUARDS)
ROUNDING = 1e-15  # of the forces: a few last digits
ABOVE = 1e-3  # of its reach: by so much a bounded state may err beyond its upper bound
LARGEST = 1e150  # of a state: beyond, squares overflow


def rate(model: Model, mode: ModeName, steady: bool = False) -> ca.Function:
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
    return method.takes(rate(model, mode, steady))


@lru_cache(maxsize=64)
def ends(model: Model, mode: ModeName, steady: bool = False) -> ca.Function:
    """(x, constants, t) -> guards and their slopes in time (2 N_GUARDS,); 1 where one does not end the mode."""
    moving, free = rate(model, mode, steady), rate(model, "slip", steady)
    x, t, c = ca.SX.sym("x", len(model.states)), ca.SX.sym("t"), ca.SX.sym("c", len(model.parameters) + 5)
    exits = dict(sliding_modes(model.clamped is not None)[mode].exits)
    guards = [c[-4] * x[SPEED], ca.SX(1), ca.SX(1)]
    if model.clamped is not None and "clearance" in exits:
        guards[1] = x[model.clamped] - (model.states[model.clamped].lower or 0.0)
    if model.clamped is not None and "release" in exits:
        guards[2] = -free(x, c, t)[model.clamped]
    guard = ca.vertcat(*guards)
    slopes = ca.jtimes(guard, x, moving(x, c, t)) + ca.jacobian(guard, t)
    return ca.Function("ends", [x, c, t], [ca.densify(ca.vertcat(guard, slopes))])


def _pull(model: Model, steady: bool) -> ca.Function:
    """(x, constants, t) -> size of the force of the rig over the mass [m/s^2]."""
    x, t, c = ca.SX.sym("x", len(model.states)), ca.SX.sym("t"), ca.SX.sym("c", len(model.parameters) + 5)
    p, drive = c[:-5], c[-5:]
    force = drive[2] if steady else drive[2] + drive[3] * t
    load = model.load(x, p, ca.vertcat(drive[0], force, drive[1], drive[4] + t))
    return ca.Function("pull", [x, c, t], [ca.densify(ca.fabs(load) / p[model.parameter_names.index("mass")])])


@lru_cache(maxsize=64)
def trial(model: Model, method: Method, mode: ModeName, steady: bool = False) -> ca.Function:
    """(x and t and h, constants, tolerances) -> x after, error norm (<= 1 acceptable), guards and their slopes.

    One vector; constants: p, then the inputs of `Situated`; tolerances: rtol, atol (n_x,). steady: for a normal force
    that has no slope.
    """
    kind, n = method.kind, len(model.states)
    z = kind.sym("z", n + 2)
    c, tolerances = kind.sym("c", len(model.parameters) + 5), kind.sym("tolerances", n + 1)
    x, t, h = z[:n], z[n], z[n + 1]
    tolerated = _scale(model, mode, x, c, t, h, tolerances, steady)
    after, norm = method.step(rate(model, mode, steady), x, c, t, h, tolerated)
    # A largest value hides what is not a number: such a step is refused.
    norm = ca.if_else(ca.sum1(ca.fabs(after)) < LARGEST, norm, ca.inf)
    # So is one to where no motion leads: the equations of an implicit step have other solutions, too.
    for i, state in enumerate(model.states):
        if state.lower is not None and state.upper is not None:
            reach = state.upper - state.lower
            inside = ca.logic_and(after[i] < state.upper + ABOVE * reach, after[i] > state.lower - reach)
            norm = ca.if_else(inside, norm, ca.inf)
    row = ca.vertcat(after, norm, ends(model, mode, steady)(after, c, t + h))
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
    scale = _scale(model, mode, x, c, t, h, tolerances)
    inside = method.within(rate(model, mode), x, c, t, h, part, scale, z[n + 3 :])
    return ca.Function(f"within_{mode}", [z, c, tolerances], [ca.cse(ca.densify(inside))])


def _scale(
    model: Model,
    mode: ModeName,
    x: Expression,
    c: Expression,
    t: Expression,
    h: Expression,
    tolerances: Expression,
    steady: bool = False,
) -> Scale:
    """What a step of length h from x at time t is tolerated to be wrong by."""
    # What a state moves by in the step counts as its size: a speed that falls through zero is not chased to zero.
    size = ca.fabs(x) + h * ca.fabs(rate(model, mode, steady)(x, c, t))

    # Forces have so many digits: what their rounding makes of the speed is no error of the step.
    blur = type(x).zeros(len(model.states))
    blur[SPEED] = h * ROUNDING * _pull(model, steady)(x, c, t)

    return lambda after: tolerances[1:] + blur + tolerances[0] * ca.fmax(size, ca.fabs(after))


@lru_cache(maxsize=64)
def coefficient(model: Model, mode: ModeName) -> ca.Function:
    """(x, constants, t) -> friction coefficient, positive where friction brakes."""
    x, t, c = ca.SX.sym("x", len(model.states)), ca.SX.sym("t"), ca.SX.sym("c", len(model.parameters) + 5)
    p, drive = c[:-5], c[-5:]
    force = drive[2] + drive[3] * t
    load = model.load(x, p, ca.vertcat(drive[0], force, drive[1], drive[4] + t))
    net = p[model.parameter_names.index("mass")] * rate(model, mode)(x, c, t)[SPEED]
    return ca.Function("coefficient", [x, c, t], [ca.densify(drive[1] * (load - net) / force)])
