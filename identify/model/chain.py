"""The resting rig as a linear chain: spring, damper, series element and load cell in closed form, with every motion
of the drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca

from identify.effects.quantities import Expression
from identify.model.composition import ELONGATION, Composition, absent

# Signals with a closed form: a straight line, harmonics and decays, and what first-order lags make of them.

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


@dataclass(frozen=True)
class Chain:
    """Signals of the time since the rest began: elongation [m] and pull on the mass [N], and the states behind them."""

    elongation: ClosedFormSignal
    pull: ClosedFormSignal
    states: tuple[tuple[str, ClosedFormSignal], ...]


def chain(m: Composition, acceleration: Expression = 0.0) -> Chain:
    """The chain that rests from x and ends at the time of the inputs; acceleration [m/s^2]: of the drive meanwhile."""
    terms = m.ports(m.situation(m.x, at_rest=True))
    loading = sum(term.loading for term in terms)
    start = m.time - m.t
    begun = m.drive_speed - acceleration * m.t
    faster, bent = (0.0, 0.0) if absent(loading) else (begun * loading, acceleration * loading)
    slope = begun + faster + m.drift
    value, waves = m.x[ELONGATION], []
    for w in m.waves:
        psi = w.omega * start + w.phase
        value = value - w.amplitude * ca.sin(psi)
        waves.append((w.amplitude * ca.sin(psi), w.amplitude * ca.cos(psi), w.omega))
    stretch = ClosedFormSignal(value, slope, tuple(waves), (), 0.5 * (acceleration + bent))
    # The spring alone is loaded faster: the damper feels the drive as it does in slip, so no force jumps there.
    strain = stretch.rate() + ClosedFormSignal(-faster, -bent)
    k, c = m.values.stiffness, m.damping
    held, straining, states = stretch, strain, []
    if m.series is not None:
        total, damping = k + m.series.stiffness, c + m.series.damping
        pull = (stretch.times(k) + strain.times(c)).times(1 / total)
        give = pull.lagged(total / damping, m.state(m.x, m.series.state))
        states.append((m.series.state, give))
        held, straining = stretch + give.times(-1.0), strain + give.rate().times(-1.0)
    followed = pulled = held.times(k) + straining.times(c)
    for lag in m.lags:
        followed = followed.lagged(1 / lag.time, m.state(m.x, lag.state))
        states.append((lag.state, followed))
    return Chain(stretch, pulled, tuple(states))


def rested(m: Composition, acceleration: Expression = 0.0) -> ca.SX:
    """x after resting for t from x, ending at the time of the inputs, under a drive of that acceleration [m/s^2]."""
    parts = chain(m, acceleration)
    after = {"elongation": parts.elongation.at(m.t), "sliding_speed": 0.0}
    after |= {name: signal.at(m.t) for name, signal in parts.states}
    clock = m.clock()
    gained = 0.0 if absent(clock) else clock - ca.substitute(clock, m.time, m.time - m.t)
    s = m.situation(m.x, at_rest=True)
    for effect in m.effects:
        after |= effect.at_rest(s, m.t + gained)
    return ca.vertcat(*(after.get(name, m.x[i]) for i, name in enumerate(m.names)))


def calm_force(m: Composition, acceleration: Expression = 0.0) -> Expression:
    """Force that tries to move the mass after resting for t [N], without the motions to and fro."""
    return replace(chain(m, acceleration).pull, waves=()).at(m.t)


def decays(m: Composition) -> list[Expression]:
    """Rates of what decays while the mass rests [1/s]."""
    own = [1 / lag.time for lag in m.lags]
    if m.series is None:
        return own
    return [(m.values.stiffness + m.series.stiffness) / (m.damping + m.series.damping), *own]


def swings(m: Composition) -> list[Expression]:
    """Force of each wave in a rig that is held: a series element only takes from it [N]."""
    k, c = m.values.stiffness, m.damping
    return [ca.fabs(w.amplitude) * ca.sqrt(k**2 + (c * w.omega) ** 2) for w in m.waves]


def settled(m: Composition) -> ca.SX:
    """x at rest in which the load cell has settled at a force."""
    load = (m.force - m.offset) / m.gain
    x = ca.SX(ca.vertcat(*(s.start for s in m.states)))
    x[ELONGATION] = (load - m.damping * m.drive()) / m.values.stiffness
    if m.series is not None:
        y = load / m.series.stiffness
        x[ELONGATION] += y
        x[m.names.index(m.series.state)] = y
    for lag in m.lags:
        x[m.names.index(lag.state)] = load
    return x
