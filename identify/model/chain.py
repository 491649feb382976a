"""The resting rig as a linear chain: spring, damper, series element and load cell in closed form, with every motion
of the drive."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca

from identify.effects.quantities import Expression
from identify.model.composition import ELONGATION, Composition, absent
from identify.model.signal import ClosedFormSignal


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
