"""Integration methods that those of the package are compared with: lower orders, SUNDIALS from outside, eq. (13)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca

from identify.base.tableaus import Tableau
from identify.simulation.steppers import HIGH, STIFF, Explicit, Expression, Method, StepProblem, largest

BOGACKI_SHAMPINE = Tableau(
    name="bogacki_shampine",
    order=3,
    c=(0.0, 1 / 2, 3 / 4, 1.0),
    a=((), (1 / 2,), (0.0, 3 / 4), (2 / 9, 1 / 3, 4 / 9)),
    b=(2 / 9, 1 / 3, 4 / 9, 0.0),
    error=(2 / 9 - 7 / 24, 1 / 3 - 1 / 4, 4 / 9 - 1 / 3, -1 / 8),
)

# Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19-26.
DORMAND_PRINCE = Tableau(
    name="dormand_prince",
    order=5,
    c=(0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0),
    a=(
        (),
        (1 / 5,),
        (3 / 40, 9 / 40),
        (44 / 45, -56 / 15, 32 / 9),
        (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
        (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
        (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
    ),
    b=(35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84, 0.0),
    error=(
        35 / 384 - 5179 / 57600,
        0.0,
        500 / 1113 - 7571 / 16695,
        125 / 192 - 393 / 640,
        -2187 / 6784 + 92097 / 339200,
        11 / 84 - 187 / 2100,
        -1 / 40,
    ),
)

ABSOLUTE = 1e-3  # of what is tolerated in a step


@dataclass(frozen=True)
class Cvodes(Method):
    """Backward differentiation formulas of variable order, started anew with every step of ours: slow and foreign.

    Its own relative tolerance holds; the absolute one is a small share of the tolerance asked for.
    """

    tolerance: float = 1e-12
    name: str = "cvodes"
    order: int = 5
    measured: int = 1
    says: str = "SUNDIALS, outside reference"
    source: str = "Hindmarsh et al., ACM TOMS 31 (2005) 363, through CasADi"
    kind: ClassVar[Any] = ca.MX
    reach: float = 0.5
    trials: int = 4

    def step(self, problem: StepProblem, x: Expression, t: Expression, h: Expression) -> tuple[Expression, Expression]:
        """Integrate over the step; no error is measured."""
        n, rate, constants = x.numel(), problem.rate, problem.constants
        # States in units of what they are tolerated to be wrong by, once the step has made something of them.
        ahead = x + h * rate(x + h * rate(x, constants, t), constants, t + h)
        measure = problem.scale(ahead)
        share, unit = ca.SX.sym("share"), ca.SX.sym("unit", n)
        scaled, fixed, at, length = (
            ca.SX.sym("scaled", n),
            ca.SX.sym("c", constants.numel()),
            ca.SX.sym("t"),
            ca.SX.sym("h"),
        )
        motion = {
            "x": scaled,
            "t": share,
            "p": ca.vertcat(fixed, at, length, unit),
            "ode": length * rate(unit * scaled, fixed, at + share * length) / unit,
        }
        options = {"reltol": self.tolerance, "abstol": ABSOLUTE, "max_num_steps": 100_000}
        whole = ca.integrator("whole", "cvodes", motion, 0.0, 1.0, options)
        after = measure * whole(x0=x / measure, p=ca.vertcat(constants, t, h, measure))["xf"]
        return after, ca.MX(0.5)


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

    def step(self, problem: StepProblem, x: Expression, t: Expression, h: Expression) -> tuple[Expression, Expression]:
        """The sum; the last term against the last digit measures whether h is short enough."""
        state, fixed = ca.SX.sym("x", x.numel()), ca.SX.sym("c", problem.constants.numel())
        # Linear: the state at which the slope is taken plays no part, even where it still appears in the expression.
        rates = ca.jacobian(problem.rate(state, fixed, 0), state)
        slope = ca.Function("slope", [state, fixed], [rates])(x, problem.constants)
        term = h * problem(x, t)
        after = x + term
        for number in range(2, TERMS + 1):
            term = h * (slope @ term) / number
            after = after + term
        size = ca.fmax(ca.fabs(x), ca.fabs(after)) + LAST_DIGIT * problem.scale(after)
        return after, largest(term, LAST_DIGIT * size)


LOW = Explicit.of(BOGACKI_SHAMPINE, "explicit, low order", "Bogacki and Shampine 1989")
MIDDLE = Explicit.of(DORMAND_PRINCE, "explicit, middle order", "Dormand and Prince 1980")
OUTSIDE = Cvodes()
LINEAR = Exponential()

ALL: tuple[Method, ...] = (LOW, MIDDLE, HIGH, STIFF, LINEAR, OUTSIDE)
