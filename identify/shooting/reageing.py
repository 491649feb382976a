"""The last moment of a saturated slip, in which the contact ages again before the mass rests."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import casadi as ca

from identify.base.tableaus import RK4, step
from identify.model.model import SPEED, Model

Inputs = Callable[[ca.SX], ca.SX]

STEPS: Final = 2
"""RK4 steps over the speed."""
SLOWEST: Final = 1e-9
"""Deceleration [m/s^2] of a mass that comes to rest."""
LEAST_BRAKED: Final = 0.1
"""Of that deceleration while the contact ages, and"""
FASTEST: Final = 0.5
"""of the speed of a free swing that is braked so: what lies beyond is no moment, nor an answer."""


def reaged_at_rest(model: Model, start: ca.SX, p: ca.SX, inputs: Inputs) -> ca.SX:
    """Return the state (n_x,) of a mass at rest after a saturated slip, from where it would rest still saturated.

    In truth the bounded state leaves its bound at the speed where its rate (eqs. 2-3) changes sign, friction grows, and
    the mass rests a little earlier and elsewhere. Both ways are followed over the speed, of which that moment has a
    fixed span: back from rest along the one, forth along the other; then the mass rests until the moment at which the
    slip is said to end.

    start: (n_x,), speed 0. p: parameters of the model. inputs: u at a time [s] after the slip is said to end.
    """
    if model.clamped is None:
        return start
    creeping, v = ca.SX(start), ca.SX.sym("v")
    creeping[SPEED] = v
    pace = model.slip(creeping, p, inputs(ca.SX(0)))[model.clamped]
    at_rest, slope = (ca.substitute(q, v, 0.0) for q in (pace, ca.gradient(pace, v)))
    braked = ca.fmax(-model.saturated(start, p, inputs(ca.SX(0)))[SPEED], SLOWEST)
    k, m = (p[model.parameter_names.index(name)] for name in ("stiffness", "mass"))
    release = ca.fmin(-at_rest / slope, FASTEST * braked * ca.sqrt(m / k))

    def by_speed(field: ca.Function, state: ca.SX, t: ca.SX, first: ca.SX, last: ca.SX) -> tuple[ca.SX, ca.SX]:
        """State and time [s] after a change of the speed."""
        both, h = ca.vertcat(state, t), (last - first) / STEPS
        for j in range(STEPS):

            def motion(at: ca.SX, offset: ca.SX, begin: ca.SX = first + j * h) -> ca.SX:
                moving = ca.SX(at[:-1])
                moving[SPEED] = begin + offset
                rates = field(moving, p, inputs(at[-1]))
                return ca.vertcat(rates, 1.0) / ca.fmin(rates[SPEED], -LEAST_BRAKED * braked)

            both = step(RK4, motion, both, h)[0]
        return both[:-1], both[-1]

    freed, before = by_speed(model.saturated, start, ca.SX(0), ca.SX(0), release)
    arrested, after = by_speed(model.slip, freed, before, release, ca.SX(0))
    arrested[SPEED] = 0
    return ca.SX(model.rest(arrested, p, inputs(after), -after))
