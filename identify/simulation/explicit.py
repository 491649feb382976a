"""Explicit Runge-Kutta methods: any tableau with an embedded formula."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from identify.base.tableaus import Tableau, step, weighted
from identify.simulation.interface import Expression, Method, Scale, largest

NOTHING = 1e-300  # keeps 0/0 of an exact step a number


@dataclass(frozen=True)
class Explicit(Method):
    """Steps with one tableau; its embedded formulas estimate the error."""

    tableau: Tableau
    name: str
    order: int
    measured: int
    says: str
    source: str
    smooth: ClassVar[bool] = True

    @classmethod
    def of(cls, tableau: Tableau, says: str, source: str) -> Explicit:
        """The method of a tableau that has an embedded formula."""
        return cls(tableau, tableau.name, tableau.order, tableau.order, says, source)

    def step(
        self, rate: ca.Function, x: Expression, constants: Expression, t: Expression, h: Expression, scale: Scale
    ) -> tuple[Expression, Expression]:
        """One step of the tableau."""
        after, error, stages = step(self.tableau, lambda state, at: rate(state, constants, t + at), x, h)
        tolerated = scale(after)
        norm = largest(error, tolerated)
        if self.tableau.coarse:
            # Mostly the weights of the step itself: what differs is summed, and the way of the step taken off.
            other = tuple(c - b for c, b in zip(self.tableau.coarse, self.tableau.b, strict=True))
            coarse = largest((after - x) + h * weighted(other, stages), tolerated)
            norm = norm**2 / ca.sqrt(norm**2 + 0.01 * coarse**2 + NOTHING)
        return after, norm
