"""Explicit Runge-Kutta formulas as plain numbers, each with its stated order; stepping is one function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

# ----------------------------------------------------------------------------------------------------------------------
# Coefficients of the explicit Runge-Kutta pair of order 8 by Dormand and Prince, DOP853.
#
# Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I (2nd ed., 1993), section II.5 and the code
# dop853. The local error is estimated by two embedded formulas, of orders 5 and 3.
# ----------------------------------------------------------------------------------------------------------------------

# fmt: off
NODES = (
    0.0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726, 0.3333333333333333,
    0.25, 0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0,
)
STAGES: tuple[tuple[float, ...], ...] = (
    (),
    (
        0.05260015195876773,
    ),
    (
        0.0197250569845379, 0.0591751709536137,
    ),
    (
        0.02958758547680685, 0.0, 0.08876275643042054,
    ),
    (
        0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792,
    ),
    (
        0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242,
    ),
    (
        0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125,
    ),
    (
        0.03709200011850479, 0.0, 0.0, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402,
        0.008273789163814023,
    ),
    (
        0.6241109587160757, 0.0, 0.0, -3.3608926294469414, -0.868219346841726, 27.59209969944671,
        20.154067550477894, -43.48988418106996,
    ),
    (
        0.47766253643826434, 0.0, 0.0, -2.4881146199716677, -0.590290826836843, 21.230051448181193,
        15.279233632882423, -33.28821096898486, -0.020331201708508627,
    ),
    (
        -0.9371424300859873, 0.0, 0.0, 5.186372428844064, 1.0914373489967295, -8.149787010746927,
        -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196,
    ),
    (
        2.273310147516538, 0.0, 0.0, -10.53449546673725, -2.0008720582248625, -17.9589318631188,
        27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303, 0.6433927460157636,
    ),
)
WEIGHTS = (
    0.054293734116568765, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
    0.3111643669578199, -0.1521609496625161, 0.20136540080403034, 0.04471061572777259,
)
ERROR_5 = (
    0.01312004499419488, 0.0, 0.0, 0.0, 0.0, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864,
    -0.35032884874997366, 0.3341791187130175, 0.08192320648511571, -0.022355307863886294,
)
ERROR_3 = (
    -0.18980075407240762, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
    -0.4226823213237919, -0.1521609496625161, 0.20136540080403034, 0.02265179219836082,
)
# fmt: on


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

DOP853 = Tableau(
    name="dop853",
    order=8,
    c=NODES,
    a=STAGES,
    b=WEIGHTS,
    error=ERROR_5,
    coarse=ERROR_3,
)


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
