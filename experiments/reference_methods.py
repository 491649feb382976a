"""Integration methods of lower orders, with which those of the package are compared: the formulas that scipy holds."""

from __future__ import annotations

from scipy.integrate import RK23, RK45

from identify.simulation.steppers import HIGH, STIFF, Explicit, Method, Tableau


def _of_scipy(formula: type[RK23] | type[RK45], name: str) -> Tableau:
    """The tableau with its last stage, the derivative after the step."""
    rows = [*(row[:i] for i, row in enumerate(formula.A.tolist())), formula.B.tolist()]
    return Tableau(
        name=name,
        order=formula.order,
        c=(*formula.C.tolist(), 1.0),
        a=tuple(map(tuple, rows)),
        b=(*formula.B.tolist(), 0.0),
        error=tuple(formula.E.tolist()),
    )


BOGACKI_SHAMPINE = _of_scipy(RK23, "bogacki_shampine")
DORMAND_PRINCE = _of_scipy(RK45, "dormand_prince")
LOW, MIDDLE = Explicit.of(BOGACKI_SHAMPINE), Explicit.of(DORMAND_PRINCE)
ALL: tuple[Method, ...] = (LOW, MIDDLE, HIGH, STIFF)
