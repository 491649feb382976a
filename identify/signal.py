"""Signals with a closed form: a straight line, harmonics and decays, and what first-order lags make of them.

While the mass rests the rig is a linear chain, so every force and deformation is such a signal: sticks of
minutes cost one evaluation, whatever hangs in the chain.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from identify.quantities import Expression

RESONANT = 1e-7  # rates closer than that (relative) are moved apart: the limit t exp(-r t), to seven digits


@dataclass(frozen=True)
class Signal:
    """value + slope t + sum(c cos(w t) + s sin(w t)) + sum(a exp(-r t)), t [s] from the start of the rest.

    waves: (c, s, w) each; decays: (a, r) each.
    """

    value: Expression
    slope: Expression
    waves: tuple[tuple[Expression, Expression, Expression], ...] = ()
    decays: tuple[tuple[Expression, Expression], ...] = ()

    def at(self, t: Expression) -> Expression:
        """The signal at time t [s]."""
        out = self.value + self.slope * t
        for c, s, w in self.waves:
            out = out + c * ca.cos(w * t) + s * ca.sin(w * t)
        for a, r in self.decays:
            out = out + a * ca.exp(-r * t)
        return out

    def rate(self) -> Signal:
        """Its derivative."""
        return Signal(
            self.slope,
            0.0,
            tuple((s * w, -c * w, w) for c, s, w in self.waves),
            tuple((-r * a, r) for a, r in self.decays),
        )

    def __add__(self, other: Signal) -> Signal:
        """The sum of two signals."""
        return Signal(
            self.value + other.value, self.slope + other.slope, self.waves + other.waves, self.decays + other.decays
        )

    def times(self, factor: Expression) -> Signal:
        """The signal times a constant."""
        return Signal(
            factor * self.value,
            factor * self.slope,
            tuple((factor * c, factor * s, w) for c, s, w in self.waves),
            tuple((factor * a, r) for a, r in self.decays),
        )

    def lagged(self, rate: Expression, start: Expression) -> Signal:
        """The solution y of y' = rate (self - y), y(0) = start; rate [1/s] positive."""
        waves = []
        for c, s, w in self.waves:
            share = rate / (rate**2 + w**2)
            waves.append((share * (rate * c - w * s), share * (rate * s + w * c), w))
        decays = []
        for a, r in self.decays:
            gap = rate - r
            least = RESONANT * rate
            gap = ca.if_else(ca.fabs(gap) < least, least, gap)
            decays.append((rate * a / gap, r))
        forced = Signal(self.value - self.slope / rate, self.slope, tuple(waves), tuple(decays))
        return Signal(forced.value, forced.slope, forced.waves, (*forced.decays, (start - forced.at(0.0), rate)))
