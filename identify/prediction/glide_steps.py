"""One step of a slip, its tangent and its guards as compiled functions of one setting w.

w (n_w,) = parameters, normal force [N], drive speed [m/s]: everything that holds during a stick and its slip.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from identify.base.compiled import Mapped
from identify.base.tableaus import DORMAND_PRINCE, step
from identify.model.model import SPEED, Model
from identify.model.modes import ModeName, sliding_modes


@dataclass(frozen=True)
class _Symbols:
    """What steps are functions of: state and length of a step, setting, direction; parameters and inputs in these."""

    xh: ca.SX
    w: ca.SX
    direction: ca.SX
    p: ca.SX
    u: ca.SX

    @staticmethod
    def of(model: Model) -> _Symbols:
        """Those of a model."""
        n_p = len(model.parameters)
        xh, w, direction = ca.SX.sym("xh", len(model.states) + 1), ca.SX.sym("w", n_p + 2), ca.SX.sym("direction")
        return _Symbols(xh, w, direction, w[:n_p], ca.vertcat(w[n_p + 1], w[n_p], direction, 0))

    def motion(self, model: Model, mode: ModeName) -> Callable[[ca.SX, object], ca.SX]:
        """dx/dt while it slides in a mode."""
        field = model.saturated if mode == "saturated" else model.slip
        return lambda state, _at: field(state, self.p, self.u)


@lru_cache(maxsize=16)
def glide_tangents(model: Model) -> Mapping[ModeName, Mapped]:
    """Compiled by model, per sliding mode: steps (x and length, w, direction) -> d after/d (x, w)."""
    s, n_x, out = _Symbols.of(model), len(model.states), dict[ModeName, Mapped]()
    for name in sliding_modes(model.clamped is not None):
        after, _, _ = step(DORMAND_PRINCE, s.motion(model, name), s.xh[:n_x], s.xh[n_x])
        slope = ca.densify(ca.jacobian(after, ca.vertcat(s.xh[:n_x], s.w)).T)
        out[name] = Mapped(ca.Function(f"tangent_{name}", [s.xh, s.w, s.direction], [slope]))
    return out


@lru_cache(maxsize=16)
def glide_functions(model: Model) -> Mapping[str, ca.Function]:
    """Compiled by model: per sliding mode `step_`, the `rate_`; what rest needs.

    step: (x and length, w, direction, tolerances) -> x after, error norm, guards and their slopes in time, as one
    vector; the tolerances are rtol and atol (n_x,). rate: (x, w, direction) -> dx/dt. hold: (x, w) -> force that tries
    to move a resting mass, force it withstands.
    """
    n_x, s = len(model.states), _Symbols.of(model)
    xh, w, direction, p, u = s.xh, s.w, s.direction, s.p, s.u
    tolerances = ca.SX.sym("tolerances", n_x + 1)
    x, h = xh[:n_x], xh[n_x]
    out: dict[str, ca.Function] = {}
    for name in sliding_modes(model.clamped is not None):
        motion = s.motion(model, name)
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
        out[f"rate_{name}"] = ca.Function(f"rate_{name}", [xh, w, direction], [motion(x, 0)])
    forward = ca.vertcat(u[:2], 1, 0)
    hold = ca.vertcat(model.driving_force(x, p, forward), model.grip(x, p, forward))
    out["hold"] = ca.Function("hold", [x, w], [hold])
    return out
