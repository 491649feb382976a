"""Axes for drawings inside a page: from numbers to places, linear or logarithmic, with ticks a person would choose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from identify.report.quantity_text import number

STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True)
class Scale:
    """From `low`..`high` to `first`..`last` (points of the drawing); logarithmic where `log`."""

    low: float
    high: float
    first: float
    last: float
    log: bool = False

    def at(self, value: float) -> float:
        """The place of a value."""
        a, b, v = (math.log(x) if self.log else x for x in (self.low, self.high, value))
        return self.first + (v - a) / (b - a) * (self.last - self.first)

    def ticks(self, most: int = 6) -> list[float]:
        """Values to mark: round numbers, or powers of ten."""
        if self.log:
            decades = range(math.ceil(math.log10(self.low) - 1e-9), math.floor(math.log10(self.high) + 1e-9) + 1)
            powers = [10.0**k for k in decades]
            return powers if len(powers) >= 2 else self._linear(most)
        return self._linear(most)

    def _linear(self, most: int) -> list[float]:
        span = self.high - self.low
        raw = span / most
        unit = 10.0 ** math.floor(math.log10(raw))
        step = next(unit * s for s in STEPS if unit * s >= raw * (1 - 1e-9))
        first = math.ceil(self.low / step - 1e-9)
        return [round(k * step, 12) for k in range(first, math.floor(self.high / step + 1e-9) + 1)]


def around(values: Sequence[float], first: float, last: float, log: bool = False, share: float = 0.06) -> Scale:
    """A scale around all finite values, with a little room."""
    kept = [v for v in values if math.isfinite(v) and (v > 0.0 or not log)]
    low, high = (min(kept), max(kept)) if kept else (1.0, 2.0)
    if log:
        room = max(share * math.log(high / low), 0.02)
        return Scale(low * math.exp(-room), high * math.exp(room), first, last, True)
    room = share * (high - low) or 0.05 * abs(high) or 0.05
    return Scale(low - room, high + room, first, last)


def tick_text(value: float) -> str:
    """A tick as text."""
    return number(0.0 if abs(value) < 1e-15 else value, 4)
