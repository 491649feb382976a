"""The stick-slip oscillator, composed from effects: sums the ports, checks the names, makes the functions.

m_s v' = load - s F_n e^level [mu_k(v) + (mu_s - mu_k(v)) e^strength strengthening + excess],  x_b' = v_d - v
(eqs. 1 and 5 in the elongation x_b = drive motion - x; v = x' is the sliding speed, s its sign, v_d the speed of
the drive with all its motions). The friction law is formed here and nowhere else; effects only deliver port values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca

from identify.base.errors import SceneError
from identify.effects import ALL, NAMES
from identify.effects.quantities import Effect, Expression, Parameter, State
from identify.model import chain
from identify.model.composition import (
    BASE_PARAMETERS,
    BASE_STATES,
    ELONGATION,
    FRICTION_PARAMETERS,
    INPUTS,
    RIG_PARAMETERS,
    SPEED,
    TIME,
    Composition,
    ForceSensorPlace,
)

__all__ = [
    "BASE_PARAMETERS",
    "BASE_STATES",
    "ELONGATION",
    "FRICTION_PARAMETERS",
    "INPUTS",
    "RIG_PARAMETERS",
    "SPEED",
    "TIME",
    "ForceSensorPlace",
    "Model",
    "assemble",
    "on_course",
]


@dataclass(frozen=True, eq=False)  # one object per composition: compiled functions are found by it
class Model:
    """The composed oscillator as CasADi functions (SX, so they inline when called with SX).

    Shapes: x (n_x,) in the order of `states`: elongation [m], sliding speed [m/s], then the effects'
    states; p (n_p,) in the order of `parameters`; u (4,) = drive speed [m/s], normal force [N],
    direction of sliding (+1 or -1), time since the start of the record [s].

    Without the effect inertia there is no state sliding_speed: slip, renewed, load, load_cell and sliding_cell take the
    speed along the direction of slip [m/s] as one more, last argument.
    """

    effects: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    states: tuple[State, ...]
    clamped: int | None  # index of the state with a lower bound, None without one
    slip: ca.Function  # (x, p, u) -> dx/dt, no state clamped
    renewed: ca.Function  # (x, p, u) -> dx/dt, the bounded state held at its lower bound
    rest: ca.Function  # (x, p, u at the end, t) -> x after resting for t [s], closed form
    calm_force: ca.Function  # (x, p, u at the end, t) -> driving force after resting [N], without what oscillates
    driving_force: ca.Function  # (x, p, u) -> force that tries to move a mass at rest [N], signed
    grip: ca.Function  # (x, p, u) -> force a mass at rest withstands [N]
    load: ca.Function  # (x, p, u) -> force the rig puts on the mass [N]
    load_cell: ca.Function  # (x, p, u) -> force the sensor shows while the mass rests [N]
    sliding_cell: ca.Function  # (x, p, u) -> that while it slides: load_cell itself, or under the counterface friction
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
    quiet: tuple[tuple[str, float], ...]  # parameters of what is explicit in time, absent at a value, and that value;
    # NaN: it then says nothing
    follows_load: bool  # whether the course of the normal force counts, or only its mean
    inertial: bool  # whether the mass resists acceleration; without it nothing is simulated or fitted
    force_sensor: ForceSensorPlace = "drive"  # between drive and mass, or under the counterface
    on_course: bool = False  # rest and calm_force take the acceleration of the drive [m/s^2] as one more, last argument

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of p."""
        return tuple(p.name for p in self.parameters)

    @cached_property
    def straight(self) -> bool:
        """Whether the load cell shows a straight line while the mass rests."""
        return self.decays.numel_out(0) + self.waves.numel_out(0) == 0

    @cached_property
    def vibrates(self) -> bool:
        """Whether something in the model swings in time: the drive from outside, or a finger."""
        return bool(self.waves.numel_out(0))

    def parameter(self, name: str) -> Parameter:
        """The declaration of one parameter."""
        return self.parameters[self.parameter_names.index(name)]


@lru_cache(maxsize=64)
def on_course(model: Model) -> Model:
    """The model under a drive whose speed is piecewise linear in time: while the mass rests its acceleration counts.

    At constant speed the model itself is taken, so that a course costs only where there is one.
    """
    m = Composition(_choose(model.effects), model.force_sensor == "counterface")
    acceleration = ca.SX.sym("acceleration")
    rest, calm = (
        ca.Function(name, [m.x, m.p, m.u, m.t, acceleration], [ca.densify(ca.SX(result))])
        for name, result in (("rest", chain.rested(m, acceleration)), ("calm_force", chain.calm_force(m, acceleration)))
    )
    return replace(model, rest=rest, calm_force=calm, on_course=True)


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


def _quiet(effects: Sequence[Effect], m: Composition) -> tuple[tuple[str, float], ...]:
    """Null values of the effects that are explicit in time, where these are values of a linear scale."""
    out: dict[str, float] = {}
    situation = m.situation(m.x, at_rest=False)
    for effect in effects:
        terms = effect.terms(situation)
        linear = {
            p.name: effect.null[p.name] for p in effect.parameters if p.scale == "linear" and p.name in effect.null
        }
        if terms.waves:
            out |= linear
        elif linear and ca.depends_on(ca.vertcat(ca.SX(terms.level), ca.SX(terms.clock)), situation.time):
            out |= {p.name: linear.get(p.name, float("nan")) for p in effect.parameters}
    return tuple(out.items())


def assemble(names: tuple[str, ...], force_sensor: ForceSensorPlace = "drive") -> Model:
    """The model with exactly these effects.

    Args:
        names: effect names, in any order.
        force_sensor: "drive", a load cell between drive and mass, which shows the force of the rig; or "counterface", a
            plate under the counterface, which shows the friction force: the same at rest, and less what accelerates
            the mass while it slides, so that it jumps where the mass comes to rest.

    Raises:
        SceneError: an unknown effect, or a composition that is refused, by name.
    """
    return _assembled(names, force_sensor)


@lru_cache(maxsize=256)
def _assembled(names: tuple[str, ...], force_sensor: ForceSensorPlace) -> Model:
    effects, plate = _choose(names), force_sensor == "counterface"
    m = Composition(effects, plate)
    resting = m.ports(m.situation(m.x, at_rest=True))
    pull = m.rig(m.x, 0.0)[0]
    moved = m.rig(m.x, m.speed(m.x))[0]
    slip = m.motion(held=False)
    jumped = m.jumped(lambda effect, s: effect.at_stick(s))
    grip = m.friction(resting, 1.0)
    rested = chain.rested(m)
    moving = [] if m.inertial else [m.speed_along]
    lengths = [effect.finest(m.values) for effect in effects]

    def function(name: str, more: list[ca.SX], result: Expression) -> ca.Function:
        return ca.Function(name, [m.x, m.p, m.u, *more], [ca.densify(ca.SX(result))])

    load_cell = function("load_cell", moving, m.shown(m.x, moved))
    friction = m.direction * m.friction(m.ports(m.situation(m.x, at_rest=False)), 0.0)
    return Model(
        effects=tuple(e.name for e in effects),
        parameters=m.parameters,
        states=m.states,
        clamped=m.clamped,
        slip=function("slip", moving, slip),
        renewed=function("renewed", moving, m.motion(held=True)),
        rest=function("rest", [m.t], rested),
        calm_force=function("calm_force", [m.t], chain.calm_force(m)),
        driving_force=function("driving_force", [], pull),
        grip=function("grip", [], grip),
        load=function("load", moving, moved),
        load_cell=load_cell,
        sliding_cell=function("sliding_cell", moving, m.shown(m.x, friction)) if plate else load_cell,
        at_stick=function("at_stick", [], jumped),
        at_force=ca.Function("at_force", [m.force, m.p, m.u], [ca.densify(chain.settled(m))]),
        decays=ca.Function("decays", [m.p], [ca.densify(ca.vertcat(*chain.decays(m)))]),
        waves=ca.Function("waves", [m.p], [ca.densify(ca.vertcat(*(w.omega for w in m.waves)))]),
        swings=ca.Function("swings", [m.p], [ca.densify(ca.vertcat(*chain.swings(m)))]),
        averaging=ca.Function("averaging", [m.p], [ca.densify(ca.SX(m.averaging))]),
        finest=ca.Function("finest", [m.p], [ca.densify(ca.vertcat(*(q for q in lengths if q is not None)))]),
        clocked=bool(ca.depends_on(ca.vertcat(slip, grip, pull, rested), m.time)),
        quiet=_quiet(effects, m),
        series_state="" if m.series is None else m.series.state,
        jumps=any(type(e).at_stick is not Effect.at_stick for e in effects),
        follows_load=any(e.follows_load for e in effects),
        inertial=m.inertial,
        force_sensor=force_sensor,
    )
