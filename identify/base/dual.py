"""Numbers that carry their exact derivatives by named variables along (forward differentiation).

A formula written with +, -, *, /, ** and the functions here takes arrays and `Dual` alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Dual:
    """A value and its derivatives by name, arrays of one shape; a name that is absent has none."""

    value: Any
    slopes: Mapping[str, Any] = field(default_factory=dict)

    __array_priority__ = 1000  # so that numpy leaves array * Dual to this class

    def _joined(self, other: Any, value: Any, mine: Any, theirs: Any) -> Dual:
        slopes = {name: slope * mine for name, slope in self.slopes.items()}
        if isinstance(other, Dual):
            for name, slope in other.slopes.items():
                slopes[name] = slopes[name] + slope * theirs if name in slopes else slope * theirs
        return Dual(value, slopes)

    def __add__(self, other: Any) -> Dual:
        return self._joined(other, self.value + plain(other), 1.0, 1.0)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Dual:
        return self._joined(other, self.value - plain(other), 1.0, -1.0)

    def __rsub__(self, other: Any) -> Dual:
        return -self + other

    def __mul__(self, other: Any) -> Dual:
        return self._joined(other, self.value * plain(other), plain(other), self.value)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Dual:
        below = plain(other)
        ratio = self.value / below
        return self._joined(other, ratio, 1.0 / below, -ratio / below)

    def __rtruediv__(self, other: Any) -> Dual:
        return Dual(plain(other)) / self

    def __neg__(self) -> Dual:
        return Dual(-self.value, {name: -slope for name, slope in self.slopes.items()})


def plain(x: Any) -> Any:
    """The value of a number, with or without derivatives."""
    return x.value if isinstance(x, Dual) else x


def variables(values: Mapping[str, Any]) -> dict[str, Dual]:
    """Named values as what is differentiated by."""
    return {name: Dual(value, {name: np.ones_like(value)}) for name, value in values.items()}


def lifted(value: Any, parts: Sequence[tuple[Any, Any]]) -> Any:
    """A value whose partial derivatives are known: parts of (argument, derivative by it)."""
    slopes: dict[str, Any] = {}
    for argument, partial in parts:
        for name, slope in argument.slopes.items() if isinstance(argument, Dual) else ():
            slopes[name] = slopes[name] + slope * partial if name in slopes else slope * partial
    return Dual(value, slopes) if any(isinstance(argument, Dual) for argument, _ in parts) else value


def _function(rule: Callable[[Any], tuple[Any, Any]]) -> Callable[[Any], Any]:
    def applied(x: Any) -> Any:
        value, slope = rule(plain(x))
        return lifted(value, [(x, slope)])

    return applied


sqrt = _function(lambda x: (np.sqrt(x), 0.5 / np.sqrt(x)))
exp = _function(lambda x: (np.exp(x), np.exp(x)))
expm1 = _function(lambda x: (np.expm1(x), np.exp(x)))
log = _function(lambda x: (np.log(x), 1.0 / x))


def where(condition: Any, yes: Any, no: Any) -> Any:
    """`yes` where the condition holds, else `no`, derivatives included."""
    value = np.where(condition, plain(yes), plain(no))
    if not isinstance(yes, Dual) and not isinstance(no, Dual):
        return value
    first, second = (x.slopes if isinstance(x, Dual) else {} for x in (yes, no))
    return Dual(
        value,
        {name: np.where(condition, first.get(name, 0.0), second.get(name, 0.0)) for name in {**first, **second}},
    )
