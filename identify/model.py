"""The stick-slip oscillator, composed from effects: sums the ports, checks the names, makes the functions.

m_s v' = load - s F_n e^level [mu_k(v) + (mu_s - mu_k(v)) e^strength strengthening + excess],  x_b' = v_d - v
(eqs. 1 and 5 in the elongation x_b = drive motion - x; v = x' is the sliding speed, s its sign, v_d the speed of
the drive with all its motions). The friction law is formed here and nowhere else; effects only deliver port values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace

import casadi as ca

from identify.effects import ALL, NAMES
from identify.errors import SceneError
from identify.quantities import Effect, Expression, Lag, Parameter, Series, Situation, State, Terms, Wave
from identify.signal import Signal

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


@dataclass(frozen=True, eq=False)  # one object per composition: compiled functions are found by it
class Model:
    """The composed oscillator as CasADi functions (SX, so they inline when called with SX).

    Shapes: x (n_x,) in the order of `states`: elongation [m], sliding speed [m/s], then the effects'
    states; p (n_p,) in the order of `parameters`; u (4,) = drive speed [m/s], normal force [N],
    direction of sliding (+1 or -1), time since the start of the record [s].

    Without the effect inertia there is no state sliding_speed: slip, saturated, load and load_cell take the speed
    along the direction of slip [m/s] as one more, last argument, and `balance` is zero while the contact slides.
    """

    effects: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    states: tuple[State, ...]
    clamped: int | None  # index of the state with a lower bound, None without one
    slip: ca.Function  # (x, p, u) -> dx/dt, no state clamped
    saturated: ca.Function  # (x, p, u) -> dx/dt, the bounded state held at its lower bound
    rest: ca.Function  # (x, p, u at the end, t) -> x after resting for t [s], closed form
    driving_force: ca.Function  # (x, p, u) -> force that tries to move a mass at rest [N], signed
    grip: ca.Function  # (x, p, u) -> force a mass at rest withstands [N]
    load: ca.Function  # (x, p, u) -> force the rig puts on the mass [N]
    load_cell: ca.Function  # (x, p, u) -> force the load cell shows [N]
    at_arrest: ca.Function  # (x, p, u, deceleration) -> x at rest after a saturated slip
    at_stick: ca.Function  # (x, p, u) -> x at the start of a stick that follows a slip
    at_force: ca.Function  # (force, p, u) -> x at rest in which the load cell settles at this force [N]
    decays: ca.Function  # p -> rates [1/s] of what decays while the mass rests (series element, lags)
    waves: ca.Function  # p -> angular frequencies [rad/s] of what oscillates
    swings: ca.Function  # p -> bounds of the forces that what oscillates puts on the contact [N]
    averaging: ca.Function  # p -> time [s] over which a shown force is averaged, 0 for the moment
    finest: ca.Function  # p -> shortest lengths of sliding over which friction swings to and fro [m]
    clocked: bool  # whether anything depends on time as such
    series_state: str  # the deformation of an element in series with the rig; "" without one
    jumps: bool  # whether a state jumps where a stick begins
    quiet: tuple[
        tuple[str, float], ...
    ]  # parameters of harmonics that are as good as absent at a value, and that value
    follows_load: bool  # whether the course of the normal force counts, or only its mean
    balance: ca.Function | None = None  # (x, p, u, v) -> load minus friction along the slip [N]; None with inertia

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of p."""
        return tuple(p.name for p in self.parameters)

    @property
    def straight(self) -> bool:
        """Whether the load cell shows a straight line while the mass rests."""
        return self.decays.numel_out(0) + self.waves.numel_out(0) == 0

    def parameter(self, name: str) -> Parameter:
        """The declaration of one parameter."""
        return self.parameters[self.parameter_names.index(name)]


def _choose(names: Sequence[str]) -> tuple[Effect, ...]:
    unknown = [n for n in names if n not in NAMES]
    if unknown:
        raise SceneError(f"no effect is called {unknown[0]!r}; effects are {', '.join(NAMES)}")
    effects = tuple(effect for effect in ALL if effect.name in names)
    for effect in effects:
        missing = [need for need in effect.needs if need not in names]
        if missing:
            others = [e.name for e in ALL if effect.role and e.role == effect.role and e.name != effect.name]
            instead = f"take {others[0]} in its place" if others else f"drop {effect.name}"
            raise SceneError(f"the effect {effect.name} needs the effect {missing[0]}; add it, or {instead}")
        rivals = [e.name for e in effects if effect.role and e.role == effect.role]
        if len(rivals) > 1:
            raise SceneError(f"{' and '.join(rivals)} are laws of the same thing ({effect.role}); keep one of them")
    return effects


def _inertial(effects: Sequence[Effect]) -> bool:
    return any(e.name == "inertia" for e in effects)


def _declared(effects: Sequence[Effect]) -> tuple[tuple[Parameter, ...], tuple[State, ...]]:
    parameters = BASE_PARAMETERS + tuple(p for e in effects for p in e.parameters)
    base = BASE_STATES if _inertial(effects) else BASE_STATES[:SPEED]
    states = base + tuple(s for e in effects for s in e.states)
    for kind, names in (("parameter", [p.name for p in parameters]), ("state", [s.name for s in states])):
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise SceneError(f"two effects claim the {kind} {twice[0]!r}; rename one, or drop an effect")
    if sum(s.lower is not None for s in states) > 1:
        raise SceneError("two effects bring a clamped state; only one can be switched at a time: drop an effect")
    return parameters, states


def _absent(value: Expression) -> bool:
    """Whether nothing was delivered to a port that adds up."""
    return isinstance(value, (int, float)) and value == 0.0


def _times_exp(value: Expression, log_factor: Expression) -> Expression:
    return value if _absent(log_factor) else value * ca.exp(log_factor)


class _Composition:
    """The symbols of one model and the sums of its ports; thrown away when the functions are made."""

    def __init__(self, effects: Sequence[Effect]) -> None:
        self.effects = effects
        self.parameters, self.states = _declared(effects)
        self.names = [s.name for s in self.states]
        self.inertial, self.speed_along = _inertial(effects), ca.SX.sym("v")
        self.x = ca.SX.sym("x", len(self.states))
        self.p = ca.SX.sym("p", len(self.parameters))
        self.u = ca.SX.sym("u", len(INPUTS))
        self.t, self.deceleration, self.force = ca.SX.sym("t"), ca.SX.sym("deceleration"), ca.SX.sym("force")
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
    def _one(what: str, found: list[Series]) -> Series | None:
        if len(found) > 1:
            raise SceneError(f"two effects put a {what} element between rig and contact; drop one of them")
        return found[0] if found else None

    def clock(self) -> Expression:
        """Ageing time gained by the time of the inputs [s]."""
        return sum(e.terms(self._situation(self.x, True, 1.0)).clock for e in self.effects)

    def situation(self, state: ca.SX, at_rest: bool) -> Situation:
        clock = self.clock()
        pace = 1.0 if _absent(clock) else 1.0 + ca.jacobian(clock, self.time)
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
        """Sliding speed, signed [m/s]: a state, or without inertia what the balance of forces gives."""
        return x[SPEED] if self.inertial else self.direction * self.speed_along

    def ports(self, s: Situation) -> list[Terms]:
        return [effect.terms(s) for effect in self.effects]

    def state(self, x: ca.SX, name: str) -> ca.SX:
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
        followed = load
        for lag in self.lags:
            rates[lag.state] = (followed - self.state(state, lag.state)) / lag.time
            followed = self.state(state, lag.state)
        rates["elongation"] = self.drive() - self.speed(self.x)
        if self.inertial:
            inertia = sum(term.inertia for term in terms)
            rates["sliding_speed"] = (load - self.direction * self.friction(terms, 0.0)) / inertia
        return ca.vertcat(*(rates.get(name, 0.0) for name in self.names))

    def balance(self, load: Expression) -> Expression:
        """Load minus friction along the direction of slip [N]."""
        terms = self.ports(self.situation(self.x, at_rest=False))
        return self.direction * load - self.friction(terms, 0.0)

    def shown(self, x: ca.SX, load: Expression) -> Expression:
        """What the load cell shows of a load [N]."""
        followed = self.state(x, self.lags[-1].state) if self.lags else load
        return self.gain * followed + self.offset

    def rested(self) -> ca.SX:
        """x after resting for t from x, ending at the time of the inputs."""
        s = self.situation(self.x, at_rest=True)
        terms = self.ports(s)
        loading = sum(term.loading for term in terms)
        start = self.time - self.t
        faster = 0.0 if _absent(loading) else self.drive_speed * loading
        slope = self.drive_speed + faster + self.drift
        value, waves = self.x[ELONGATION], []
        for w in self.waves:
            psi = w.omega * start + w.phase
            value = value - w.amplitude * ca.sin(psi)
            waves.append((w.amplitude * ca.sin(psi), w.amplitude * ca.cos(psi), w.omega))
        stretch = Signal(value, slope, tuple(waves))
        # The spring alone is loaded faster: the damper feels the drive as it does in slip, so no force jumps there.
        strain = stretch.rate() + Signal(-faster, 0.0)
        after = {"elongation": stretch.at(self.t), "sliding_speed": 0.0}
        k, c = self.values.stiffness, self.damping
        held, straining = stretch, strain
        if self.series is not None:
            total, damping = k + self.series.stiffness, c + self.series.damping
            pull = (stretch.times(k) + strain.times(c)).times(1 / total)
            give = pull.lagged(total / damping, self.state(self.x, self.series.state))
            after[self.series.state] = give.at(self.t)
            held, straining = stretch + give.times(-1.0), strain + give.rate().times(-1.0)
        followed = held.times(k) + straining.times(c)
        for lag in self.lags:
            followed = followed.lagged(1 / lag.time, self.state(self.x, lag.state))
            after[lag.state] = followed.at(self.t)
        clock = self.clock()
        gained = 0.0 if _absent(clock) else clock - ca.substitute(clock, self.time, start)
        for effect in self.effects:
            after |= effect.at_rest(s, self.t + gained)
        return ca.vertcat(*(after.get(name, self.x[i]) for i, name in enumerate(self.names)))

    def jumped(self, jump: Callable[[Effect, Situation], Mapping[str, Expression]]) -> ca.SX:
        """x at rest after what `jump` does to the effects' states."""
        s = self.situation(self.x, at_rest=True)
        after: dict[str, Expression] = {"sliding_speed": 0.0}
        for effect in self.effects:
            after |= jump(effect, s)
        return ca.vertcat(*(after.get(name, self.x[i]) for i, name in enumerate(self.names)))

    def decays(self) -> list[Expression]:
        """Rates of what decays while the mass rests [1/s]."""
        own = [1 / lag.time for lag in self.lags]
        if self.series is None:
            return own
        return [(self.values.stiffness + self.series.stiffness) / (self.damping + self.series.damping), *own]

    def swings(self) -> list[Expression]:
        """Force of each wave in a rig that is held: a series element only takes from it [N]."""
        k, c = self.values.stiffness, self.damping
        return [ca.fabs(w.amplitude) * ca.sqrt(k**2 + (c * w.omega) ** 2) for w in self.waves]

    def settled(self) -> ca.SX:
        """x at rest in which the load cell has settled at a force."""
        load = (self.force - self.offset) / self.gain
        x = ca.SX(ca.vertcat(*(s.start for s in self.states)))
        x[ELONGATION] = (load - self.damping * self.drive()) / self.values.stiffness
        if self.series is not None:
            y = load / self.series.stiffness
            x[ELONGATION] += y
            x[self.names.index(self.series.state)] = y
        for lag in self.lags:
            x[self.names.index(lag.state)] = load
        return x


def _quiet(effects: Sequence[Effect], m: _Composition) -> tuple[tuple[str, float], ...]:
    """Null values of the effects that bring harmonics, where these are values of a linear scale."""
    out: dict[str, float] = {}
    for effect in effects:
        if effect.terms(m.situation(m.x, at_rest=False)).waves:
            linear = {p.name for p in effect.parameters if p.scale == "linear"}
            out |= {name: value for name, value in effect.null.items() if name in linear}
    return tuple(out.items())


@lru_cache(maxsize=256)
def assemble(names: tuple[str, ...]) -> Model:
    """The model with exactly these effects.

    Args:
        names: effect names, in any order.

    Raises:
        SceneError: an unknown effect, or a composition that is refused, by name.
    """
    effects = _choose(names)
    m = _Composition(effects)
    resting = m.ports(m.situation(m.x, at_rest=True))
    pull = m.rig(m.x, 0.0)[0]
    moved = m.rig(m.x, m.speed(m.x))[0]
    slip = m.motion(held=False)
    jumped = m.jumped(lambda effect, s: effect.at_stick(s))
    arrested = m.jumped(lambda effect, s: effect.at_arrest(s, m.deceleration))
    grip = m.friction(resting, 1.0)
    rested = m.rested()
    moving = [] if m.inertial else [m.speed_along]
    lengths = [effect.finest(m.values) for effect in effects]

    def function(name: str, more: list[ca.SX], result: Expression) -> ca.Function:
        return ca.Function(name, [m.x, m.p, m.u, *more], [ca.densify(ca.SX(result))])

    return Model(
        effects=tuple(e.name for e in effects),
        parameters=m.parameters,
        states=m.states,
        clamped=m.clamped,
        slip=function("slip", moving, slip),
        saturated=function("saturated", moving, m.motion(held=True)),
        rest=function("rest", [m.t], rested),
        driving_force=function("driving_force", [], pull),
        grip=function("grip", [], grip),
        load=function("load", moving, moved),
        load_cell=function("load_cell", moving, m.shown(m.x, moved)),
        at_arrest=function("at_arrest", [m.deceleration], arrested),
        at_stick=function("at_stick", [], jumped),
        at_force=ca.Function("at_force", [m.force, m.p, m.u], [ca.densify(m.settled())]),
        decays=ca.Function("decays", [m.p], [ca.densify(ca.vertcat(*m.decays()))]),
        waves=ca.Function("waves", [m.p], [ca.densify(ca.vertcat(*(w.omega for w in m.waves)))]),
        swings=ca.Function("swings", [m.p], [ca.densify(ca.vertcat(*m.swings()))]),
        averaging=ca.Function("averaging", [m.p], [ca.densify(ca.SX(m.averaging))]),
        finest=ca.Function("finest", [m.p], [ca.densify(ca.vertcat(*(q for q in lengths if q is not None)))]),
        clocked=bool(ca.depends_on(ca.vertcat(slip, grip, pull, rested), m.time)),
        quiet=_quiet(effects, m),
        series_state="" if m.series is None else m.series.state,
        jumps=any(type(e).at_stick is not Effect.at_stick for e in effects),
        follows_load=any(e.follows_load for e in effects),
        balance=None if m.inertial else function("balance", moving, m.balance(moved)),
    )
