"""Integration methods: Runge-Kutta formulas as numbers, and one step of sliding with its error in tolerances."""

from __future__ import annotations

import runpy
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import scipy

# Explicit Runge-Kutta formulas as plain numbers, each with its stated order.

State = Any  # anything that adds and multiplies: CasADi SX, numpy arrays, floats
Field = Callable[[State, State], State]  # (x, time within the step) -> dx/dt


@dataclass(frozen=True)
class Tableau:
    """An explicit Runge-Kutta formula: nodes c, rows a, weights b; `error` = b minus the weights of the
    embedded formula (empty: none), so that h * sum(error * stage) estimates the local error.

    `coarse`: the same of a second embedded formula, of lower order; with it the estimate is
    error^2 / sqrt(error^2 + 0.01 coarse^2) (Hairer, Norsett and Wanner, II.10), else `error` as it is.
    """

    name: str
    order: int
    c: tuple[float, ...]
    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    error: tuple[float, ...] = ()
    coarse: tuple[float, ...] = ()


RK4 = Tableau(
    name="rk4",
    order=4,
    c=(0.0, 0.5, 0.5, 1.0),
    a=((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
    b=(1 / 6, 1 / 3, 1 / 3, 1 / 6),
)
# Dormand and Prince; Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I (2nd ed., 1993), II.5 and
# the code dop853. scipy's last stage, the derivative after the step, counts nothing in either error. Of scipy.integrate
# only this file is read: the package takes a fifth of a second to import.
_SCIPYS = runpy.run_path(str(Path(scipy.__file__).parent / "integrate" / "_ivp" / "dop853_coefficients.py"))
_STAGES = len(_SCIPYS["B"])
DOP853 = Tableau(
    name="dop853",
    order=8,
    c=tuple(_SCIPYS["C"][:_STAGES].tolist()),
    a=tuple(tuple(row[:i]) for i, row in enumerate(_SCIPYS["A"][:_STAGES].tolist())),
    b=tuple(_SCIPYS["B"].tolist()),
    error=tuple(_SCIPYS["E5"][:-1].tolist()),
    coarse=tuple(_SCIPYS["E3"][:-1].tolist()),
)


def weighted(weights: tuple[float, ...], stages: list[State]) -> State:
    """Sum of the stages times their weights, without those that count nothing."""
    return sum(weight * stage for weight, stage in zip(weights, stages, strict=True) if weight)


def step(tableau: Tableau, field: Field, x: State, h: State) -> tuple[State, State, list[State]]:
    """One step of length h from x.

    Returns:
        the state after the step, the local error estimate (0 without an embedded formula), the stages.
    """
    stages: list[State] = []
    moves: list[State] = []
    for c, row in zip(tableau.c, tableau.a, strict=True):
        stages.append(field(x + weighted(row, moves), c * h))
        moves.append(h * stages[-1])
    error: State = weighted(tableau.error, moves) if tableau.error else 0.0
    return x + weighted(tableau.b, moves), error, stages


@dataclass(frozen=True)
class StepProblem:
    """What a step is taken of.

    rate: (x (n_x,), constants, t [s]) -> dx/dt. scale: from the state after a step to the tolerated error of each state
    (n_x,). States at the start of a step are symbols.
    """

    rate: ca.Function
    constants: ca.SX
    scale: Callable[[ca.SX], ca.SX]

    def __call__(self, x: ca.SX, t: ca.SX) -> ca.SX:
        """dx/dt (n_x,) in state x at time t [s]."""
        return self.rate(x, self.constants, t)


class Method(ABC):
    """One way to take a step. Immutable and hashable: compiled functions are kept per model and method.

    order: of the error that is left at a fixed time. measured: the power of the step length with which the error
    measure falls, for the step control. smooth: its steps are so short that nothing decays within a small part of one.
    reach: longest step in natural times sqrt(m/k), where no error estimate would ask for a shorter one. trials: steps
    tried in one call.
    """

    name: str
    order: int
    measured: int
    smooth: ClassVar[bool] = False
    reach: float = float("inf")
    trials: int = 20

    @abstractmethod
    def step(self, problem: StepProblem, x: ca.SX, t: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX]:
        """One step of length h [s] from x (n_x,) at time t [s].

        Returns:
            the state after it (n_x,), and the size of its local error: at most 1 is acceptable.
        """

    def within(self, problem: StepProblem, x: ca.SX, t: ca.SX, h: ca.SX, part: ca.SX, after: ca.SX) -> ca.SX:
        """The state (n_x,) at time t + part [s] inside a step of length h [s] that was good, to the state `after`: a
        step of that length."""
        return self.step(problem, x, t, part)[0]


def largest(error: ca.SX, tolerated: ca.SX) -> ca.SX:
    """The largest error in units of what is tolerated."""
    return ca.mmax(ca.fabs(error) / tolerated)


# Radau IIA collocation with three stages: implicit, order 5, stiffly accurate, for motions with fast decays.

# Hairer and Wanner, Solving Ordinary Differential Equations II (2nd ed., 1996), section IV.8.
S6 = 6**0.5
NODES = np.array([(4 - S6) / 10, (4 + S6) / 10, 1.0])
REAL = 3 + 3 ** (2 / 3) - 3 ** (1 / 3)  # the eigenvalues of the inverse coefficient matrix: one real, one pair
PAIR = 3 + 0.5 * (3 ** (1 / 3) - 3 ** (2 / 3)), -0.5 * (3 ** (5 / 6) + 3 ** (7 / 6))
FORWARD = np.array(
    [
        [0.09443876248897524, -0.14125529502095421, 0.03002919410514742],
        [0.25021312296533332, 0.20412935229379994, -0.38294211275726192],
        [1.0, 1.0, 0.0],
    ]
)
BACK = np.array(
    [
        [4.17871859155190428, 0.32768282076106237, 0.52337644549944951],
        [-4.17871859155190428, -0.32768282076106237, 0.47662355450055044],
        [0.50287263494578682, -2.57192694985560522, 0.59603920482822492],
    ]
)
ERROR = np.array([-13 - 7 * S6, -13 + 7 * S6, -1.0]) / 3
# Row i: coefficients of share, share^2, share^3 of the polynomial that is one at node i, zero at 0 and the others.
LAGRANGE = np.linalg.inv(NODES[:, None] ** np.arange(1, 4)).T
INSIDE = 0.4  # of a step, between two nodes: where its polynomial is farthest from the motion, nearly
SOLVED = 0.1  # a stage may be wrong by that share of what the step may be


@dataclass(frozen=True)
class Radau(Method):
    """Three collocation points, the last at the end of the step.

    The stage equations are solved by a fixed number of simplified Newton steps with the exact Jacobian at the start;
    a step whose last correction is not small against the tolerance is refused like one with a large error.
    """

    name: str = "radau"
    order: int = 5
    measured: int = 4
    trials: int = 8

    def step(self, problem: StepProblem, x: ca.SX, t: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX]:
        """One step; the error is filtered through the real factor, so that fast decays do not inflate it.

        What follows the drive at once has no such error at the end of a step, but inside it: there the polynomial is
        held against the motion, so that samples are as good as nodes.
        """
        z, move, real_inverse = self._stages(problem, x, t, h)
        after = x + z[:, 2]
        tolerated = problem.scale(after)
        error = real_inverse @ (problem(x, t) + z @ (ERROR / h))
        inside = x + z @ (LAGRANGE @ INSIDE ** np.arange(1, 4))
        slope = z @ (LAGRANGE @ (np.arange(1, 4) * INSIDE ** np.arange(3)) / h)
        defect = real_inverse @ (problem(inside, t + INSIDE * h) - slope)
        norm = ca.fmax(largest(error, tolerated), largest(defect, tolerated))
        return after, ca.fmax(norm, largest(move[:, 2], SOLVED * tolerated))

    def within(self, problem: StepProblem, x: ca.SX, t: ca.SX, h: ca.SX, part: ca.SX, after: ca.SX) -> ca.SX:
        """The collocation polynomial of the whole step: a part of an implicit step need not be good, for it may
        show what the whole one has damped away.

        Newton's steps may find their way in the step itself and, a last digit apart, not find it again: then it is the
        cubic through both ends, with the rates there.
        """
        z, share = self._stages(problem, x, t, h)[0], part / h
        curve = x + z @ ca.vertcat(*(share * (a + share * (b + share * c)) for a, b, c in LAGRANGE.tolist()))
        first, last = h * problem(x, t), h * problem(after, t + h)
        bent = (first + last - 2 * (after - x)) * share
        cubic = x + share * (first + share * (3 * (after - x) - 2 * first - last + bent))
        return ca.if_else(largest(x + z[:, 2] - after, problem.scale(after)) <= 1, curve, cubic)

    @staticmethod
    def _stages(problem: StepProblem, x: ca.SX, t: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Moves from x to the three stages (n_x, 3), of the last Newton step, and the inverse of the real factor."""
        n, one = x.numel(), ca.DM.eye(x.numel())
        # In equations times h: inverses without pivoting lose no digits.
        scaled = h * ca.densify(ca.jacobian(problem(x, t), x))
        mixed = ca.blockcat([[PAIR[0] * one - scaled, -PAIR[1] * one], [PAIR[1] * one, PAIR[0] * one - scaled]])
        real_inverse, mixed_inverse = h * ca.inv(REAL * one - scaled), h * ca.inv(mixed)
        z = ca.SX.zeros(n, 3)
        move = z
        for _ in range(8):
            rates = [problem(x + z[:, i], t + NODES[i] * h) for i in range(3)]
            turned, w = ca.horzcat(*rates) @ BACK.T, z @ BACK.T
            first = turned[:, 0] - REAL / h * w[:, 0]
            second = turned[:, 1] - (PAIR[0] * w[:, 1] - PAIR[1] * w[:, 2]) / h
            third = turned[:, 2] - (PAIR[1] * w[:, 1] + PAIR[0] * w[:, 2]) / h
            pair = mixed_inverse @ ca.vertcat(second, third)
            move = ca.horzcat(real_inverse @ first, pair[:n], pair[n:]) @ FORWARD.T
            z = z + move
        return z, move, real_inverse


# Explicit Runge-Kutta methods: any tableau with an embedded formula.


@dataclass(frozen=True)
class Explicit(Method):
    """Steps with one tableau; its embedded formulas estimate the error."""

    tableau: Tableau
    name: str
    order: int
    measured: int
    smooth: ClassVar[bool] = True

    @classmethod
    def of(cls, tableau: Tableau) -> Explicit:
        """The method of a tableau that has an embedded formula."""
        return cls(tableau, tableau.name, tableau.order, tableau.order)

    def step(self, problem: StepProblem, x: ca.SX, t: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX]:
        """One step of the tableau."""
        after, error, stages = step(self.tableau, lambda state, at: problem(state, t + at), x, h)
        tolerated = problem.scale(after)
        norm = largest(error, tolerated)
        if self.tableau.coarse:
            # Mostly the weights of the step itself: what differs is summed, and the way of the step taken off.
            other = tuple(c - b for c, b in zip(self.tableau.coarse, self.tableau.b, strict=True))
            coarse = largest((after - x) + h * weighted(other, stages), tolerated)
            norm = norm**2 / ca.sqrt(norm**2 + 0.01 * coarse**2 + 1e-300)  # keeps 0/0 of an exact step a number
        return after, norm


# The integration methods that a plan chooses among; those it is compared with stand in `experiments`.

HIGH = Explicit.of(DOP853)  # Hairer, Norsett and Wanner I, II.10
STIFF = Radau()
