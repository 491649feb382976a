"""The table of integration methods. A new one is one file here and one line in ALL."""

from identify.base import tableaus
from identify.simulation.steppers import Cvodes, Explicit, Exponential, Method, Radau

LOW = Explicit.of(tableaus.BOGACKI_SHAMPINE, "explicit, low order", "Bogacki and Shampine 1989")
MIDDLE = Explicit.of(tableaus.DORMAND_PRINCE, "explicit, middle order", "Dormand and Prince 1980")
HIGH = Explicit.of(tableaus.DOP853, "explicit, high order", "Hairer, Norsett and Wanner I, II.10")
STIFF = Radau()
LINEAR = Exponential()
OUTSIDE = Cvodes()

ALL: tuple[Method, ...] = (LOW, MIDDLE, HIGH, STIFF, LINEAR, OUTSIDE)
NAMES: tuple[str, ...] = tuple(method.name for method in ALL)

__all__ = ["ALL", "HIGH", "LINEAR", "LOW", "MIDDLE", "NAMES", "OUTSIDE", "STIFF", "Method"]
