"""One integration step of a model as a compiled function, with its error estimate and its guards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.model import SPEED, Model
from identify.modes import GUARDS, GuardName, ModeName
from identify.tableaus import DORMAND_PRINCE, Tableau, step

Array = NDArray[np.float64]

LARGEST = 1e150  # of a state: beyond, squares overflow


@dataclass(frozen=True)
class Situated:
    """What stays the same during one phase: parameters p (n_p,), drive speed [m/s], direction of sliding,
    normal force at the start of the phase [N] and its slope [N/s], time at its start [s]."""

    p: Array
    drive_speed: float
    direction: float
    normal_force: float
    force_slope: float
    time: float = 0.0

    @property
    def inputs(self) -> Array:
        """The inputs of the step function, shape (5,)."""
        return np.array([self.drive_speed, self.direction, self.normal_force, self.force_slope, self.time])

    def at(self, t: float | Array, direction: float = 1.0) -> Array:
        """u of the model (4,) or (4, n) at times t [s] within the phase."""
        t = np.asarray(t, float)
        ones = np.ones_like(t)
        force = self.normal_force + self.force_slope * t
        return np.stack([self.drive_speed * ones, force, direction * ones, self.time + t])


def _inputs(model: Model, drive: ca.SX, t: ca.SX) -> ca.SX:
    """u of the model at time t within the phase."""
    return ca.vertcat(drive[0], drive[2] + drive[3] * t, drive[1], drive[4] + t)


@lru_cache(maxsize=16)
def step_functions(model: Model, tableau: Tableau) -> Mapping[ModeName, ca.Function]:
    """Per sliding mode: (x, p, drive (5,), t in phase, h, rtol, atol (n_x,)) -> x after, error norm, guards, dx/dt.

    The error norm is the largest component error relative to atol + rtol |x|: at most 1 is acceptable.
    """
    n_x, n_p = len(model.states), len(model.parameters)
    x, p, drive = ca.SX.sym("x", n_x), ca.SX.sym("p", n_p), ca.SX.sym("drive", 5)
    t, h, rtol, atol = ca.SX.sym("t"), ca.SX.sym("h"), ca.SX.sym("rtol"), ca.SX.sym("atol", n_x)
    functions: dict[ModeName, ca.Function] = {}
    fields: dict[ModeName, ca.Function] = {"slip": model.slip}
    if model.clamped is not None:
        fields["saturated"] = model.saturated
    for name, field in fields.items():

        def motion(state: ca.SX, at: ca.SX, field: ca.Function = field) -> ca.SX:
            return field(state, p, _inputs(model, drive, t + at))

        after, error, _ = step(tableau, motion, x, h)
        scale = atol + rtol * ca.fmax(ca.fabs(x), ca.fabs(after))
        # A largest value hides what is not a number: such a step is refused by an infinite norm.
        norm = ca.if_else(ca.sum1(ca.fabs(after)) < LARGEST, ca.mmax(ca.fabs(error) / scale), np.inf)
        u = _inputs(model, drive, t + h)
        guards = [drive[1] * after[SPEED], ca.SX(1), ca.SX(1)]
        if model.clamped is not None:
            guards[1] = after[model.clamped] - (model.states[model.clamped].lower or 0.0)
            guards[2] = -model.slip(after, p, u)[model.clamped]
        rate = motion(after, h)
        functions[name] = ca.Function(
            f"step_{name}", [x, p, drive, t, h, rtol, atol], [after, norm, ca.vertcat(*guards), rate]
        )
    return functions


class Stepper:
    """Steps one model with fixed tolerances; holds the buffers, so one per thread.

    Tolerances: rtol on every state; atol per state is rtol times `floor`, which the caller scales.
    """

    def __init__(self, model: Model, rtol: float, atol: Array, tableau: Tableau = DORMAND_PRINCE) -> None:
        self.model, self.tableau = model, tableau
        n_x = len(model.states)
        self._x, self._drive, self._scalars = np.empty(n_x), np.empty(5), np.array([0.0, 0.0, rtol])
        self._p = np.empty(len(model.parameters))
        self._after, self._norm, self._guards, self._rate = np.empty(n_x), np.empty(1), np.empty(3), np.empty(n_x)
        self._calls = {}
        for name, function in step_functions(model, tableau).items():
            buffer, call = function.buffer()
            arguments = [self._x, self._p, self._drive, *(self._scalars[i : i + 1] for i in range(3)), atol]
            for i, argument in enumerate(arguments):
                buffer.set_arg(i, argument.data)
            for i, result in enumerate((self._after, self._norm, self._guards, self._rate)):
                buffer.set_res(i, result.data)
            self._calls[name] = (buffer, call)
        self._atol = atol  # kept alive: the buffers point into it

    @property
    def inputs(self) -> Array:
        """What was set for the phase, see Situated.inputs."""
        return self._drive

    def situate(self, situated: Situated) -> None:
        """Set what holds during the coming phase."""
        self._p[:] = situated.p
        self._drive[:] = situated.inputs

    def advance(
        self, mode: ModeName, x: Array, t: float, h: float
    ) -> tuple[Array, float, dict[GuardName, float], Array]:
        """One step of length h [s] from x at time t [s] within the phase.

        Returns:
            state after (n_x,), error norm (<= 1 acceptable), guards by name, dx/dt after (n_x,).
        """
        self._x[:] = x
        self._scalars[0], self._scalars[1] = t, h
        self._calls[mode][1]()
        guards = dict(zip(GUARDS, self._guards.tolist(), strict=True))
        return self._after.copy(), float(self._norm[0]), guards, self._rate.copy()
