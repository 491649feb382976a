"""The equations of one composition of effects, in symbols: the sums of what the effects deliver to their ports."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Literal

import casadi as ca

from identify.base.errors import SceneError
from identify.effects.quantities import Effect, Expression, Lag, Parameter, Series, Situation, State, Terms, Wave

# What every model has: the spring of the rig and Coulomb friction.
BASE_PARAMETERS = (
    Parameter("mu_s", "", 1e-3, 20.0, 0.6, "μs", "static friction coefficient of a saturated contact", "linear", 0.1),
    Parameter("mu_k0", "", 1e-4, 20.0, 0.45, "μk0", "kinetic friction coefficient at slow sliding", "linear", 0.1),
    Parameter(
        "stiffness", "N/m", 1e-2, 1e9, 1470.0, "k", "stiffness of the rig along the drive", spread=0.05, kind="rig"
    ),
)
BASE_STATES = (State("elongation", "m", 0.0), State("sliding_speed", "m/s", 0.0))
RIG_PARAMETERS = ("mass", "stiffness", "damping")
FRICTION_PARAMETERS = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
INPUTS = ("drive_speed", "normal_force", "direction", "time")
ELONGATION, SPEED = 0, 1  # among the states
TIME = 3  # among the inputs
ForceSensorPlace = Literal["drive", "counterface"]
FORCE_SENSORS: tuple[ForceSensorPlace, ...] = ("drive", "counterface")


def inertial(effects: Sequence[Effect]) -> bool:
    """Whether the mass has inertia, and with it a speed of its own."""
    return any(e.name == "inertia" for e in effects)


def declared(effects: Sequence[Effect]) -> tuple[tuple[Parameter, ...], tuple[State, ...]]:
    """All parameters and states of a model with these effects, none twice."""
    parameters = BASE_PARAMETERS + tuple(p for e in effects for p in e.parameters)
    base = BASE_STATES if inertial(effects) else BASE_STATES[:SPEED]
    states = base + tuple(s for e in effects for s in e.states)
    for kind, names in (("parameter", [p.name for p in parameters]), ("state", [s.name for s in states])):
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise SceneError(f"two effects claim the {kind} {twice[0]!r}; rename one, or drop an effect")
    if sum(s.lower is not None for s in states) > 1:
        raise SceneError("two effects bring a clamped state; only one can be switched at a time: drop an effect")
    return parameters, states


def absent(value: Expression) -> bool:
    """Whether nothing was delivered to a port that adds up."""
    return isinstance(value, (int, float)) and value == 0.0


def _times_exp(value: Expression, log_factor: Expression) -> Expression:
    return value if absent(log_factor) else value * ca.exp(log_factor)


class Composition:
    """The symbols of one model and the sums of its ports; thrown away when the functions are made."""

    def __init__(self, effects: Sequence[Effect], counterface: bool = False) -> None:
        """counterface: the force is measured under the counterface, else between drive and mass."""
        self.effects, self.counterface = effects, counterface
        self.parameters, self.states = declared(effects)
        self.names = [s.name for s in self.states]
        self.inertial, self.speed_along = inertial(effects), ca.SX.sym("v")
        self.x = ca.SX.sym("x", len(self.states))
        self.p = ca.SX.sym("p", len(self.parameters))
        self.u = ca.SX.sym("u", len(INPUTS))
        self.t, self.force = ca.SX.sym("t"), ca.SX.sym("force")
        self.drive_speed, self.normal_force, self.direction, self.time = ca.vertsplit(self.u)
        self.values = SimpleNamespace(**{q.name: self.p[i] for i, q in enumerate(self.parameters)})
        self.clamped = next((i for i, s in enumerate(self.states) if s.lower is not None), None)
        ports = self.ports(self.situation(self.x, at_rest=False))
        self.series: Series | None = self._one("series", [q.series for q in ports if q.series is not None])
        self.lags: tuple[Lag, ...] = tuple(q.lag for q in ports if q.lag is not None)
        self.waves: tuple[Wave, ...] = tuple(w for q in ports for w in q.waves)
        self.drift: Expression = sum(q.drift for q in ports)
        self.damping: Expression = sum(q.damping for q in ports)
        self.offset: Expression = sum(q.offset for q in ports)
        self.averaging: Expression = sum(q.averaging for q in ports)
        self.gain: Expression = 1.0
        for q in ports:
            self.gain = self.gain * q.gain

    @staticmethod
    def _one(what: str, series: list[Series]) -> Series | None:
        if len(series) > 1:
            raise SceneError(f"two effects put a {what} element between rig and contact; drop one of them")
        return series[0] if series else None

    def clock(self) -> Expression:
        """Ageing time gained by the time of the inputs [s]."""
        return sum(e.terms(self._situation(self.x, True, 1.0)).clock for e in self.effects)

    def situation(self, state: ca.SX, at_rest: bool) -> Situation:
        """What an effect may look at, in a state of the model."""
        clock = self.clock()
        pace = 1.0 if absent(clock) else 1.0 + ca.jacobian(clock, self.time)
        return self._situation(state, at_rest, pace)

    def _situation(self, state: ca.SX, at_rest: bool, pace: Expression) -> Situation:
        inner = SimpleNamespace(**{s.name: state[i] for i, s in enumerate(self.states)})
        v = ca.SX(0) if at_rest else self.direction * self.speed(state)
        return Situation(
            self.values,
            inner,
            v,
            state[ELONGATION],
            self.drive_speed,
            self.normal_force,
            self.direction,
            self.time,
            pace,
        )

    def speed(self, x: ca.SX) -> ca.SX:
        """Sliding speed, signed [m/s]: a state, or without inertia an argument of its own."""
        return x[SPEED] if self.inertial else self.direction * self.speed_along

    def ports(self, s: Situation) -> list[Terms]:
        """What every effect delivers."""
        return [effect.terms(s) for effect in self.effects]

    def state(self, x: ca.SX, name: str) -> ca.SX:
        """One of the states, by name."""
        return x[self.names.index(name)]

    def drive(self) -> Expression:
        """Speed of the drive with all its motions [m/s]."""
        waves = sum(w.amplitude * w.omega * ca.cos(w.omega * self.time + w.phase) for w in self.waves)
        return self.drive_speed + self.drift + waves

    def rig(self, x: ca.SX, speed: Expression) -> tuple[Expression, Expression]:
        """Force of the rig on the mass [N], and rate of the deformation of the series element [m/s] (0 without)."""
        k, c = self.values.stiffness, self.damping
        stretching = self.drive() - speed
        if self.series is None:
            return k * x[ELONGATION] + c * stretching, 0.0
        y = self.state(x, self.series.state)
        rate = (k * (x[ELONGATION] - y) + c * stretching - self.series.stiffness * y) / (c + self.series.damping)
        return k * (x[ELONGATION] - y) + c * (stretching - rate), rate

    def friction(self, terms: Sequence[Terms], without_ageing: float) -> Expression:
        """Friction force along the direction of slip [N]."""
        shares = [term.strengthening for term in terms if term.strengthening is not None]
        strengthening = sum(shares) if shares else without_ageing
        strengthening = _times_exp(strengthening, sum(term.strength for term in terms))
        kinetic = self.values.mu_k0 + sum(term.kinetic for term in terms)
        excess = sum(term.excess for term in terms)
        coefficient = kinetic + (self.values.mu_s - kinetic) * strengthening + excess
        return self.normal_force * _times_exp(coefficient, sum(term.level for term in terms))

    def motion(self, held: bool) -> ca.SX:
        """dx/dt while sliding."""
        state = ca.SX(self.x)
        if held and self.clamped is not None:
            state[self.clamped] = self.states[self.clamped].lower
        s = self.situation(state, at_rest=False)
        terms = self.ports(s)
        rates = {name: rate for term in terms for name, rate in term.rates.items()}
        if held and self.clamped is not None:
            rates[self.states[self.clamped].name] = 0.0
        load, give = self.rig(state, self.speed(state))
        if self.series is not None:
            rates[self.series.state] = give
        friction = self.direction * self.friction(terms, 0.0)
        followed = friction if self.counterface else load
        for lag in self.lags:
            rates[lag.state] = (followed - self.state(state, lag.state)) / lag.time
            followed = self.state(state, lag.state)
        rates["elongation"] = self.drive() - self.speed(self.x)
        if self.inertial:
            inertia = sum(term.inertia for term in terms)
            rates["sliding_speed"] = (load - friction) / inertia
        return ca.vertcat(*(rates.get(name, 0.0) for name in self.names))

    def shown(self, x: ca.SX, load: Expression) -> Expression:
        """What the load cell shows of a load [N]."""
        followed = self.state(x, self.lags[-1].state) if self.lags else load
        return self.gain * followed + self.offset

    def jumped(self, jump: Callable[[Effect, Situation], Mapping[str, Expression]]) -> ca.SX:
        """x at rest after what `jump` does to the effects' states."""
        s = self.situation(self.x, at_rest=True)
        after: dict[str, Expression] = {"sliding_speed": 0.0}
        for effect in self.effects:
            after |= jump(effect, s)
        return ca.vertcat(*(after.get(name, self.x[i]) for i, name in enumerate(self.names)))
