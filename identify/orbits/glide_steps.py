"""One step of a slip, its tangent and its guards as compiled functions of one setting w.

w (n_w,) = parameters, normal force [N], drive speed [m/s]: everything that holds during a stick and its slip.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import casadi as ca

from identify.model.model import SPEED, Model
from identify.model.modes import sliding_modes
from identify.numerics.tableaus import DORMAND_PRINCE, step

LANES = 16  # steps of which one call takes the tangents


@lru_cache(maxsize=16)
def glide_functions(model: Model) -> Mapping[str, ca.Function]:
    """Compiled by model: per sliding mode `step_`, its `tangent_`, the `rate_`; what rest needs.

    step: (x and length, w, direction, tolerances) -> x after, error norm, guards and their slopes in time, as one
    vector; the tolerances are rtol and atol (n_x,). tangent: the same of LANES steps -> d after/d (x, w).
    rate: (x, w, direction) -> dx/dt. hold: (x, w) -> force that tries to move a resting mass, force it withstands.
    """
    n_x, n_p = len(model.states), len(model.parameters)
    xh, w, direction = ca.SX.sym("xh", n_x + 1), ca.SX.sym("w", n_p + 2), ca.SX.sym("direction")
    tolerances = ca.SX.sym("tolerances", n_x + 1)
    x, h, p = xh[:n_x], xh[n_x], w[:n_p]
    u = ca.vertcat(w[n_p + 1], w[n_p], direction, 0)
    out: dict[str, ca.Function] = {}
    for name in sliding_modes(model.clamped is not None):
        field = model.saturated if name == "saturated" else model.slip

        def motion(state: ca.SX, _at: object, field: ca.Function = field) -> ca.SX:
            return field(state, p, u)

        after, error, _ = step(DORMAND_PRINCE, motion, x, h)
        norm = ca.mmax(ca.fabs(error) / (tolerances[1:] + tolerances[0] * ca.fmax(ca.fabs(x), ca.fabs(after))))
        there = ca.SX.sym("there", n_x)
        guards = [direction * there[SPEED], ca.SX(1), ca.SX(1)]
        if model.clamped is not None:
            guards[1] = there[model.clamped] - (model.states[model.clamped].lower or 0.0)
            guards[2] = -model.slip(there, p, u)[model.clamped]
        guard = ca.vertcat(*guards)
        slopes = ca.jtimes(guard, there, motion(there, 0))
        ends = ca.Function("ends", [there, w, direction], [ca.vertcat(guard, slopes)])
        row = ca.vertcat(after, norm, ends(after, w, direction))
        out[f"step_{name}"] = ca.Function(f"step_{name}", [xh, w, direction, tolerances], [row])
        slope = ca.densify(ca.jacobian(after, ca.vertcat(x, w)).T)
        one = ca.Function("tangent", [xh, w, direction], [slope])
        out[f"tangent_{name}"] = one.map(LANES, [False, True, True], [False])
        out[f"rate_{name}"] = ca.Function(f"rate_{name}", [xh, w, direction], [motion(x, 0)])
    forward = ca.vertcat(w[n_p + 1], w[n_p], 1, 0)
    hold = ca.vertcat(model.driving_force(x, p, forward), model.grip(x, p, forward))
    out["hold"] = ca.Function("hold", [x, w], [hold])
    return out
