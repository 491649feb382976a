"""The stick-slip oscillator, composed from effects: sums the ports, checks the names, makes the functions.

m_s v' = k x_b + (rig forces) - s F_n [mu_k(v) + (mu_s - mu_k(v)) strengthening],  x_b' = v_0 - v
(eqs. 1 and 5 in the elongation x_b = v_0 t - x; v = x' is the sliding speed, s its sign). The friction
law is formed here and nowhere else; effects only deliver port values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace

import casadi as ca

from identify.effects import ALL, NAMES
from identify.errors import SceneError
from identify.quantities import Effect, Expression, Parameter, Situation, State, Terms

# What every model has: the spring of the rig and Coulomb friction.
BASE_PARAMETERS = (
    Parameter("mu_s", "", 1e-3, 20.0, 0.6, "μs", "static friction coefficient of a saturated contact", "linear", 0.1),
    Parameter("mu_k0", "", 1e-4, 20.0, 0.45, "μk0", "kinetic friction coefficient at slow sliding", "linear", 0.1),
    Parameter("stiffness", "N/m", 1e-2, 1e9, 1470.0, "k", "stiffness of the rig along the drive", spread=0.05),
)
BASE_STATES = (State("elongation", "m", 0.0), State("sliding_speed", "m/s", 0.0))
RIG_PARAMETERS = ("mass", "stiffness", "damping")
FRICTION_PARAMETERS = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
INPUTS = ("drive_speed", "normal_force", "direction")
ELONGATION, SPEED = 0, 1


@dataclass(frozen=True)
class Model:
    """The composed oscillator as CasADi functions (SX, so they inline when called with SX).

    Shapes: x (n_x,) in the order of `states`: elongation [m], sliding speed [m/s], then the effects'
    states; p (n_p,) in the order of `parameters`; u (3,) = drive speed [m/s], normal force [N],
    direction of sliding (+1 or -1).
    """

    effects: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    states: tuple[State, ...]
    clamped: int | None  # index of the state with a lower bound, None without one
    slip: ca.Function  # (x, p, u) -> dx/dt, no state clamped
    saturated: ca.Function  # (x, p, u) -> dx/dt, the bounded state held at its lower bound
    rest: ca.Function  # (x, p, u, t) -> x after resting for t [s], closed form
    driving_force: ca.Function  # (x, p, u) -> force that tries to move a mass at rest [N], signed
    grip: ca.Function  # (x, p, u) -> force a mass at rest withstands [N]
    load_cell: ca.Function  # (x, p, u) -> force the load cell sees [N]
    at_arrest: ca.Function  # (x, p, u, deceleration) -> x at rest after a saturated slip

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of p."""
        return tuple(p.name for p in self.parameters)

    def parameter(self, name: str) -> Parameter:
        """The declaration of one parameter."""
        return self.parameters[self.parameter_names.index(name)]


def _choose(names: Sequence[str]) -> tuple[Effect, ...]:
    unknown = [n for n in names if n not in NAMES]
    if unknown:
        raise SceneError(f"no effect is called {unknown[0]!r}; effects are {', '.join(NAMES)}")
    if "inertia" not in names:
        raise SceneError("the effect inertia is off: quasi-static sliding is not built yet; add 'inertia' to effects")
    return tuple(effect for effect in ALL if effect.name in names)


def _declared(effects: Sequence[Effect]) -> tuple[tuple[Parameter, ...], tuple[State, ...]]:
    parameters = BASE_PARAMETERS + tuple(p for e in effects for p in e.parameters)
    states = BASE_STATES + tuple(s for e in effects for s in e.states)
    for kind, names in (("parameter", [p.name for p in parameters]), ("state", [s.name for s in states])):
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise SceneError(f"two effects claim the {kind} {twice[0]!r}; rename one, or drop an effect")
    if sum(s.lower is not None for s in states) > 1:
        raise SceneError("two effects bring a clamped state; only one can be switched at a time: drop an effect")
    return parameters, states


@lru_cache(maxsize=32)
def assemble(names: tuple[str, ...]) -> Model:
    """The model with exactly these effects.

    Args:
        names: effect names, in any order.

    Raises:
        SceneError: an unknown effect, or a composition that is refused, by name.
    """
    effects = _choose(names)
    parameters, states = _declared(effects)
    x, p, u = ca.SX.sym("x", len(states)), ca.SX.sym("p", len(parameters)), ca.SX.sym("u", len(INPUTS))
    t, deceleration = ca.SX.sym("t"), ca.SX.sym("deceleration")
    drive_speed, normal_force, direction = ca.vertsplit(u)
    values = SimpleNamespace(**{q.name: p[i] for i, q in enumerate(parameters)})
    clamped = next((i for i, s in enumerate(states) if s.lower is not None), None)

    def situation(state: ca.SX, at_rest: bool) -> Situation:
        inner = SimpleNamespace(**{s.name: state[i] for i, s in enumerate(states)})
        v = ca.SX(0) if at_rest else direction * state[SPEED]
        return Situation(values, inner, v, state[ELONGATION], drive_speed, normal_force, direction)

    def ports(s: Situation) -> list[Terms]:
        return [effect.terms(s) for effect in effects]

    def load(s: Situation, terms: Sequence[Terms]) -> Expression:
        return values.stiffness * s.elongation + sum(term.rig_force for term in terms)

    def friction(terms: Sequence[Terms], without_ageing: float) -> Expression:
        shares = [term.strengthening for term in terms if term.strengthening is not None]
        strengthening = sum(shares) if shares else without_ageing
        kinetic = values.mu_k0 + sum(term.kinetic for term in terms)
        return normal_force * (kinetic + (values.mu_s - kinetic) * strengthening)

    def motion(held: bool) -> ca.SX:
        state = ca.SX(x)
        if held and clamped is not None:
            state[clamped] = states[clamped].lower
        s = situation(state, at_rest=False)
        terms = ports(s)
        rates = {name: rate for term in terms for name, rate in term.rates.items()}
        if held and clamped is not None:
            rates[states[clamped].name] = 0.0
        acceleration = (load(s, terms) - direction * friction(terms, 0.0)) / sum(term.inertia for term in terms)
        return ca.vertcat(drive_speed - x[SPEED], acceleration, *(rates[s.name] for s in states[2:]))

    resting = situation(x, at_rest=True)
    resting_terms = ports(resting)
    rested = {name: value for e in effects for name, value in e.at_rest(resting, t).items()}
    arrested = {name: value for e in effects for name, value in e.at_arrest(resting, deceleration).items()}
    moving = situation(x, at_rest=False)

    def function(name: str, arguments: list[ca.SX], result: Expression) -> ca.Function:
        return ca.Function(name, arguments, [result])

    return Model(
        effects=tuple(e.name for e in effects),
        parameters=parameters,
        states=states,
        clamped=clamped,
        slip=function("slip", [x, p, u], motion(held=False)),
        saturated=function("saturated", [x, p, u], motion(held=True)),
        rest=function(
            "rest", [x, p, u, t], ca.vertcat(x[0] + drive_speed * t, 0, *(rested[s.name] for s in states[2:]))
        ),
        driving_force=function("driving_force", [x, p, u], load(resting, resting_terms)),
        grip=function("grip", [x, p, u], friction(resting_terms, 1.0)),
        load_cell=function("load_cell", [x, p, u], load(moving, ports(moving))),
        at_arrest=function(
            "at_arrest", [x, p, u, deceleration], ca.vertcat(x[0], 0, *(arrested[s.name] for s in states[2:]))
        ),
    )
