"""Solving again near a known answer: Newton steps with factors that are kept until they no longer serve.

For profiles and replicates, whose answers lie a few standard errors from the one known: no barrier, no line search;
what does not settle is said, and left to the solver.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from identify.base.linear import Factors, optimality_matrix
from identify.shooting.shooting import Point, Problem

Array = NDArray[np.float64]

MOST = 16  # steps
RENEWED = 8  # times the factors are made anew on the way
SLOW = 0.2  # of the step before: a step that shrinks less asks for new factors
BENT = 0.5  # of the step before: one that shrinks less with factors so new asks for the exact Hessian
LONGEST = 30.0  # standard errors of one step: farther away this is no neighbourhood
CLOSED = 1e-7  # largest row


@dataclass(frozen=True)
class Settled:
    """A point that settled: z (n,) scaled, multipliers (m,), cost, steps taken."""

    z: Array
    multipliers: Array
    cost: float
    steps: int


class Warm:
    """The neighbourhood of a solution z (n,) of a problem; `size` (f,) are standard errors of its `kept` unknowns.

    Raises:
        numpy.linalg.LinAlgError: the conditions of optimality are singular there.
    """

    def __init__(self, problem: Problem, z: Array, kept: NDArray[np.int64], size: Array) -> None:
        self.problem, self.kept, self.size = problem, kept, size / problem.layout.scale[kept]
        point = problem.evaluate(z, derivatives=True)
        factors = _factored(point)
        if factors is None:
            raise np.linalg.LinAlgError("the conditions of optimality are singular")
        assert point.gradient is not None
        self.factors = factors
        # At a solution gradient + J^T multipliers = 0: the second part of K [0, multipliers] = [-gradient, 0].
        self.multipliers = self.factors.solve(np.concatenate([-point.gradient, np.zeros(point.rows.size)]))[z.size :]
        layout = problem.layout
        self.lower, self.upper = layout.lower / layout.scale, layout.upper / layout.scale

    def settle(
        self,
        z: Array,
        *,
        problem: Problem | None = None,
        multipliers: Array | None = None,
        push: Array | None = None,
        held: tuple[int, float] | None = None,
        within: float = 0.02,
    ) -> Settled | None:
        """The solution near z (n,); None where the steps do not shrink, or end outside the bounds.

        Args:
            problem: with the same layout, other data; default the one this is the neighbourhood of.
            push: (n,) added to the gradient of the cost with respect to z.
            held: an unknown that is kept at a scaled value.
            within: standard errors of the last step.
        """
        problem = problem or self.problem
        factors, n = self.factors, z.size
        z, dual = z.copy(), (self.multipliers if multipliers is None else multipliers).copy()
        before, renewals, made_at, exact = np.inf, 0, 0, False
        for number in range(1, MOST + 1):
            point = problem.evaluate(z, derivatives=True)
            assert point.gradient is not None and point.jacobian is not None
            with np.errstate(invalid="ignore"):  # a step too far is seen below
                slope = point.gradient + point.jacobian.T @ dual + (0.0 if push is None else push)
            if held is not None:
                slope[held[0]] = 0.0  # its multiplier follows from the rest
            left = -np.concatenate([slope, point.rows])
            if not np.all(np.isfinite(left)):
                return None
            step = _step(factors, left, n, None if held is None else (held[0], held[1] - z[held[0]]))
            length = self._length(step)
            if number > 1 and not length <= SLOW * before:
                if renewals == RENEWED:
                    return None
                # Where fresh factors do not serve either the rows bend, and the exact Hessian follows them.
                exact = exact or (made_at == number - 1 and not length <= BENT * before)
                renewed = _factored(point, problem.exact_hessian(z, 1.0, dual) if exact else None)
                if renewed is None:
                    return None
                factors = renewed
                renewals, made_at = renewals + 1, number
                step = _step(factors, left, n, None if held is None else (held[0], held[1] - z[held[0]]))
                length = self._length(step)
            if not length <= LONGEST:
                return None
            z, dual, before = z + step[:n], dual + step[n:], length
            if length < within and number > 1:
                ended = problem.evaluate(z, derivatives=False)
                if np.max(np.abs(ended.rows), initial=0.0) < CLOSED:
                    inside = np.all(z >= self.lower) and np.all(z <= self.upper) and np.isfinite(ended.cost)
                    return Settled(z, dual, ended.cost, number) if inside else None
        return None

    def _length(self, step: Array) -> float:
        """The longest part of a step (n + m,) in standard errors."""
        return float(np.max(np.abs(step[self.kept]) / self.size))


def _factored(point: Point, hessian: sp.csc_matrix | None = None) -> Factors | None:
    """Factors at a point, with another Hessian than that of Gauss-Newton where one is given; None where they are
    singular."""
    assert point.hessian is not None and point.jacobian is not None
    try:
        return Factors(optimality_matrix(point.hessian if hessian is None else hessian, point.jacobian))
    except RuntimeError:  # SuperLU's only word for it
        return None


def _step(factors: Factors, left: Array, n: int, held: tuple[int, float] | None) -> Array:
    """The Newton step; with an unknown held, bordered by the row that moves it by just so much."""
    if held is None:
        return factors.solve(left)
    unit = np.zeros(left.size)
    unit[held[0]] = 1.0
    free, column = factors.solve(np.column_stack([left, unit])).T
    with np.errstate(all="ignore"):  # where the others cannot follow, what is held goes nowhere: no step to take
        return np.asarray(free + column * (held[1] - free[held[0]]) / column[held[0]])
