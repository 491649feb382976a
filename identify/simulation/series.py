"""Closed form where the law is linear: the exponential of the motion, summed to the last digit (eq. 13)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from identify.simulation.interface import Expression, Method, Scale, largest

TERMS = 30
LAST_DIGIT = 1e-17


@dataclass(frozen=True)
class Exponential(Method):
    """x(h) = x + h phi(h A) (A x + b) for dx/dt = A x + b: eq. (13) and its overdamped forms without their cases.

    The series ends where its next term is below the last digit of the state: no truncation error is left, and
    the tolerance asked for plays no part.
    """

    name: str = "closed_form"
    order: int = TERMS
    measured: int = TERMS
    says: str = "linear laws, summed to the last digit"
    source: str = "eq. (13)"
    reach: float = 1.0

    def takes(self, rate: ca.Function) -> bool:
        """Only a motion that is linear in the state, with coefficients that stand still."""
        x, constants, t = (ca.SX.sym(name, rate.numel_in(i)) for i, name in enumerate(("x", "c", "t")))
        motion = rate(x, constants, t)
        return bool(ca.is_linear(motion, x)) and not ca.depends_on(motion, t)

    def step(
        self, rate: ca.Function, x: Expression, constants: Expression, t: Expression, h: Expression, scale: Scale
    ) -> tuple[Expression, Expression]:
        """The sum; the last term against the last digit measures whether h is short enough."""
        state, fixed = ca.SX.sym("x", x.numel()), ca.SX.sym("c", constants.numel())
        # Linear: the state at which the slope is taken plays no part, even where it still appears in the expression.
        slope = ca.Function("slope", [state, fixed], [ca.jacobian(rate(state, fixed, 0), state)])(x, constants)
        term = h * rate(x, constants, t)
        after = x + term
        for number in range(2, TERMS + 1):
            term = h * (slope @ term) / number
            after = after + term
        size = ca.fmax(ca.fabs(x), ca.fabs(after)) + LAST_DIGIT * scale(after)
        return after, largest(term, LAST_DIGIT * size)
