"""Signals with a closed form: a straight line, harmonics and decays, and what first-order lags make of them.

While the mass rests the rig is a linear chain, so every force and deformation is such a signal: sticks of
minutes cost one evaluation, whatever hangs in the chain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca

from identify.effects.quantities import Expression

CLOSE = 0.1  # spread of rates times time below which a decay is a series: its differences would cancel
ORDER = 10  # of that series: CLOSE**ORDER / ORDER! is below rounding

Decay = tuple[Expression, tuple[Expression, ...]]


@dataclass(frozen=True)
class ClosedFormSignal:
    """value + slope t + bend t^2 + sum(c cos(w t) + s sin(w t)) + sum(a decay(rates)), t [s] since the rest began.

    waves: (c, s, w) each; decays: (a, rates) each, see `decay`.
    """

    value: Expression
    slope: Expression
    waves: tuple[tuple[Expression, Expression, Expression], ...] = ()
    decays: tuple[Decay, ...] = ()
    bend: Expression = 0.0

    def at(self, t: Expression) -> Expression:
        """The signal at time t [s]."""
        out = self.value + self.slope * t + self.bend * t * t
        for c, s, w in self.waves:
            out = out + c * ca.cos(w * t) + s * ca.sin(w * t)
        for a, rates in self.decays:
            out = out + a * decay(rates, t)
        return out

    def rate(self) -> ClosedFormSignal:
        """Its derivative."""
        decays = tuple((-rates[-1] * a, rates) for a, rates in self.decays)
        shorter = tuple((a, rates[:-1]) for a, rates in self.decays if len(rates) > 1)
        waves = tuple((s * w, -c * w, w) for c, s, w in self.waves)
        return ClosedFormSignal(self.slope, 2.0 * self.bend, waves, decays + shorter)

    def __add__(self, other: ClosedFormSignal) -> ClosedFormSignal:
        """The sum of two signals; what they have in common is written once."""
        waves, decays = list(self.waves), list(self.decays)
        for c, s, w in other.waves:
            same = next((i for i, own in enumerate(waves) if own[2] is w), None)
            if same is None:
                waves.append((c, s, w))
            else:
                waves[same] = (waves[same][0] + c, waves[same][1] + s, w)
        for a, rates in other.decays:
            same = next((i for i, own in enumerate(decays) if own[1] is rates), None)
            if same is None:
                decays.append((a, rates))
            else:
                decays[same] = (decays[same][0] + a, rates)
        value, slope, bend = self.value + other.value, self.slope + other.slope, self.bend + other.bend
        return ClosedFormSignal(value, slope, tuple(waves), tuple(decays), bend)

    def times(self, factor: Expression) -> ClosedFormSignal:
        """The signal times a constant."""
        return ClosedFormSignal(
            factor * self.value,
            factor * self.slope,
            tuple((factor * c, factor * s, w) for c, s, w in self.waves),
            tuple((factor * a, rates) for a, rates in self.decays),
            factor * self.bend,
        )

    def lagged(self, rate: Expression, start: Expression) -> ClosedFormSignal:
        """The solution y of y' = rate (self - y), y(0) = start; rate [1/s] positive."""
        waves = []
        for c, s, w in self.waves:
            share = rate / (rate**2 + w**2)
            waves.append((share * (rate * c - w * s), share * (rate * s + w * c), w))
        late = 2.0 * self.bend / rate  # of the slope
        steady = ClosedFormSignal(
            self.value - (self.slope - late) / rate, self.slope - late, tuple(waves), (), self.bend
        )
        decays = tuple((rate * a, (*rates, rate)) for a, rates in self.decays)
        return replace(steady, decays=(*decays, (start - steady.at(0.0), (rate,))))


def decay(rates: Sequence[Expression], t: Expression) -> Expression:
    """What is left after t [s] of an impulse that went through first-order stages of these rates [1/s].

    exp(-r t) of one rate; of more, the convolution of their exponentials: the divided difference of exp(-r t) over
    the rates (but for its sign), in whatever order they come and however close they lie.
    """
    return _sorted_decay(_sorted(rates), t)


def _sorted(rates: Sequence[Expression]) -> list[Expression]:
    out = list(rates)
    for end in range(len(out) - 1, 0, -1):
        for i in range(end):
            # One comparison decides for both, so that derivatives stay right where two rates are equal.
            swap = out[i] > out[i + 1]
            out[i], out[i + 1] = ca.if_else(swap, out[i + 1], out[i]), ca.if_else(swap, out[i], out[i + 1])
    return out


def _sorted_decay(rates: Sequence[Expression], t: Expression) -> Expression:
    count = len(rates)
    if count == 1:
        return ca.exp(-rates[0] * t)
    gap = rates[-1] - rates[0]
    close = gap * t < CLOSE
    apart = ca.if_else(close, 1.0, gap)
    difference = (_sorted_decay(rates[:-1], t) - _sorted_decay(rates[1:], t)) / apart
    distances = [ca.if_else(close, (r - rates[0]) * t, 0.0) for r in rates[1:]]
    # Complete homogeneous polynomials of the distances: h_n(d_1..d_j) = h_n(d_1..d_{j-1}) + d_j h_{n-1}(d_1..d_j).
    polynomials: list[Expression] = [1.0] + [0.0] * (ORDER - 1)
    for d in distances:
        for n in range(1, ORDER):
            polynomials[n] = polynomials[n] + d * polynomials[n - 1]
    series = sum((-1) ** n * h / math.factorial(n + count - 1) for n, h in enumerate(polynomials))
    return ca.if_else(close, t ** (count - 1) * ca.exp(-rates[0] * t) * series, difference)
