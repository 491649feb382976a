"""Explicit Runge-Kutta formulas as plain numbers, each with its stated order; stepping is one function."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import scipy

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
