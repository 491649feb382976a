"""One stick, fast: when the drive overcomes the grip, and how that moves with start, parameters and rig.

The setting w (n_w,) = parameters, normal force [N], drive speed [m/s] holds during the stick, as in `glide`.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import compiled
from identify.model.model import ELONGATION, SPEED, Model
from identify.simulation.phases import stick
from identify.simulation.situated import Situated

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


class Hold:
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
