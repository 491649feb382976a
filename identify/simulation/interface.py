"""What an integration method is: one step of a sliding motion, with its error measured in tolerances."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import casadi as ca

Expression = Any  # a CasADi SX or MX
Scale = Callable[[Expression], Expression]  # state after a step -> tolerated error of each state (n_x,)


class Method(ABC):
    """One way to take a step. Immutable and hashable: compiled functions are kept per model and method.

    name, says, source: for tables. order: of the error that is left at a fixed time. measured: the power of the step
    length with which the error measure falls, for the step control. kind: CasADi type it is written in. smooth: its
    steps are so short that nothing decays within a small part of one. reach: longest step in natural times sqrt(m/k),
    where no error estimate would ask for a shorter one. trials: steps tried in one call.
    """

    name: str
    order: int
    measured: int
    says: str
    source: str
    kind: ClassVar[Any] = ca.SX
    smooth: ClassVar[bool] = False
    reach: float = float("inf")
    trials: int = 24

    def takes(self, rate: ca.Function) -> bool:
        """Whether it can integrate this motion, (x, constants, t) -> dx/dt."""
        return True

    @abstractmethod
    def step(
        self, rate: ca.Function, x: Expression, constants: Expression, t: Expression, h: Expression, scale: Scale
    ) -> tuple[Expression, Expression]:
        """One step of length h [s] from x (n_x,) at time t [s].

        Returns:
            the state after it (n_x,), and the size of its local error: at most 1 is acceptable.
        """

    def within(
        self,
        rate: ca.Function,
        x: Expression,
        constants: Expression,
        t: Expression,
        h: Expression,
        part: Expression,
        scale: Scale,
        after: Expression,
    ) -> Expression:
        """The state (n_x,) at time t + part [s] inside a step of length h [s] that was good, to the state `after`: a
        step of that length."""
        return self.step(rate, x, constants, t, part, scale)[0]


def largest(error: Expression, tolerated: Expression) -> Expression:
    """The largest error in units of what is tolerated."""
    return ca.mmax(ca.fabs(error) / tolerated)
