"""Explicit Runge-Kutta formulas as plain numbers, each with its stated order; stepping is one function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from identify.base import dop853

Field = Callable[[Any, Any], Any]  # (x, time within the step) -> dx/dt


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

# Bogacki and Shampine, Appl. Math. Lett. 2 (1989) 321-325.
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

DOP853 = Tableau(
    name="dop853",
    order=8,
    c=dop853.NODES,
    a=dop853.STAGES,
    b=dop853.WEIGHTS,
    error=dop853.ERROR_5,
    coarse=dop853.ERROR_3,
)

ALL: tuple[Tableau, ...] = (RK4, BOGACKI_SHAMPINE, DORMAND_PRINCE, DOP853)


def weighted(weights: tuple[float, ...], stages: list[Any]) -> Any:
    """Sum of the stages times their weights, without those that count nothing."""
    return sum(weight * stage for weight, stage in zip(weights, stages, strict=True) if weight)


def step(tableau: Tableau, field: Field, x: Any, h: Any) -> tuple[Any, Any, list[Any]]:
    """One step of length h from x.

    Works on anything that adds and multiplies (CasADi SX, numpy arrays).

    Returns:
        the state after the step, the local error estimate (0 without an embedded formula), the stages.
    """
    stages: list[Any] = []
    moves: list[Any] = []
    for c, row in zip(tableau.c, tableau.a, strict=True):
        stages.append(field(x + weighted(row, moves), c * h))
        moves.append(h * stages[-1])
    error: Any = weighted(tableau.error, moves) if tableau.error else 0.0
    return x + weighted(tableau.b, moves), error, stages
