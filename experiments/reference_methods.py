"""Integration methods of lower orders, with which those of the package are compared."""

from __future__ import annotations

from identify.base.tableaus import Tableau
from identify.simulation.steppers import HIGH, STIFF, Explicit, Method

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

LOW = Explicit.of(BOGACKI_SHAMPINE)
MIDDLE = Explicit.of(DORMAND_PRINCE)

ALL: tuple[Method, ...] = (LOW, MIDDLE, HIGH, STIFF)
