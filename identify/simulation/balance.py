"""Motion without inertia: the steps of `stepper`, the sliding speed being what balances the forces.

It is the limit of a vanishing mass with hysteresis damping h > 0 and stiffness k fixed, reached with sqrt(m). (Without
any damping a mass on an ageing contact is unstable, however small: it swings up at the rate k_D/(2 t_cr (k - k_D)),
k_D = (mu_s - mu_k) F_n/D.) A small mass would follow m v' = load - friction at a standing place: from where the speed
is, up or down, to the first speed that balances. A jump of the speed is therefore settled; where friction falls as
sliding sets in, or softens with distance faster than the spring unloads (k < k_D), no speed balances and the place
itself would jump, how far depends on the mass that is not there: that is refused by name.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from identify.base.errors import SimulationError
from identify.model.model import BASE_STATES, ELONGATION, SPEED, Model
from identify.model.modes import ModeName
from identify.simulation.phases import Machine, Phase, Slide, Stick, rested
from identify.simulation.plan import Plan, Scales
from identify.simulation.resting import swing
from identify.simulation.stepper import Situated, on_balance
from identify.simulation.steppers import Radau

Array = NDArray[np.float64]

BALANCED = 1e-9  # of the friction force: less than that is no force at all
FASTEST = 1e3  # [m/s]; a speed above that is none
_SPEEDS = np.geomspace(1e-15, FASTEST, 18 * 40 + 1)
_BESIDE = 1e-3  # relative distance at which the two sides of a fold are told apart
POLISHING = 4  # Newton steps towards a balance that is nearly met
FIRST = 1e-2  # the first step that is tried: the time in which the states change by that share of their sizes
SHORTEST = 1e-13  # of the first step: there is no shorter one
PER_PERIOD = 32  # steps in a period of the drive's vibration: an arrest between two is not passed over
MOMENT = 1e-7  # of the whole: time in which a contact that does not chatter changes its mode less than STALLED times
METHOD = Radau(name="radau in balance")


@lru_cache(maxsize=32)
def with_speed(model: Model) -> Model:
    """A model without inertia over the states of one with it: its speed has no rate of change, but a balance [N]."""
    assert model.balance is not None
    x, p, u = (ca.SX.sym(name, n) for name, n in (("x", len(model.states) + 1), ("p", len(model.parameters)), ("u", 4)))
    t, force = ca.SX.sym("t"), ca.SX.sym("force")
    own = ca.vertcat(*(q for i, q in enumerate(ca.vertsplit(x)) if i != SPEED))
    along = u[2] * x[SPEED]

    def full(states: ca.SX, speed: ca.SX | float = 0.0) -> ca.SX:
        elongation, *others = ca.vertsplit(states)
        return ca.vertcat(elongation, speed, *others)

    def function(name: str, given: list[ca.SX], result: ca.SX) -> ca.Function:
        return ca.Function(name, given, [ca.densify(result)])

    balance = model.balance(own, p, u, along)
    return replace(
        model,
        states=(model.states[ELONGATION], BASE_STATES[SPEED], *model.states[SPEED:]),
        clamped=None if model.clamped is None else model.clamped + 1,
        slip=function("slip", [x, p, u], full(model.slip(own, p, u, along), u[2] * balance)),
        worn=function("worn", [x, p, u], full(model.worn(own, p, u, along), u[2] * balance)),
        rest=function("rest", [x, p, u, t], full(model.rest(own, p, u, t))),
        calm_force=function("calm_force", [x, p, u, t], model.calm_force(own, p, u, t)),
        driving_force=function("driving_force", [x, p, u], model.driving_force(own, p, u)),
        grip=function("grip", [x, p, u], model.grip(own, p, u)),
        load=function("load", [x, p, u], model.load(own, p, u, along)),
        load_cell=function("load_cell", [x, p, u], model.load_cell(own, p, u, along)),
        at_stick=function("at_stick", [x, p, u], full(model.at_stick(own, p, u))),
        at_force=function("at_force", [force, p, u], full(model.at_force(force, p, u))),
        balance=function("balance", [x, p, u], balance),
    )


def sizes(model: Model, p: Array, normal_force: float, duration: float) -> Scales:
    """Scales of a model `with_speed`: states by their units, from a load of one normal force; moments of the whole."""
    k = float(p[model.parameter_names.index("stiffness")])
    of_unit = {"m": normal_force / k, "N": normal_force}
    state = np.array([of_unit.get(q.unit, 1.0) for q in model.states])
    return Scales(MOMENT * duration, state, swing(model, p)[0] / PER_PERIOD)


class BalancedMachine(Machine):
    """All that moves a scene without inertia; it remembers the speed between phases."""

    def __init__(self, model: Model, p: Array, scale: Scales, plan: Plan, *, locate: bool = True) -> None:
        super().__init__(model, p, scale, plan, locate=locate)
        for name, exits in self.following.items():
            exits["fold"] = name
        self._folded = False

    def _floor(self, rtol: float) -> Array:
        """The speed follows from the others: it has no error of its own."""
        floor = super()._floor(rtol)
        floor[SPEED] = np.inf
        return floor

    def rest(self, x: Array, situated: Situated, limit: float) -> Stick:
        """Rest from state x until the static limit is overcome, or for `limit` [s].

        A slip may come to rest with nothing to spare: what the first force that counts says, holds.
        """
        self._folded = False
        x = x.copy()
        x[SPEED] = 0.0
        least = BALANCED * float(np.max(situated.p[:2])) * situated.normal_force
        return rested(x, situated, situated.time, limit, self.rests.from_balance(x, situated, limit, least))

    def slide(self, mode: ModeName, x: Array, situated: Situated, limit: float) -> Slide:
        """Slide from state x in one mode until that ends, or for `limit` [s].

        Raises:
            SimulationError: a jump to another place, or too many steps.
        """
        phase = super().slide(mode, x, situated, limit)
        self._folded = phase.ended_by == "fold"
        return phase

    def _begin(self, mode: ModeName, x: Array, situated: Situated, limit: float) -> Array | None:
        speed = _Forces(self.model, mode, x, situated).settled(self._folded)
        if speed is None:
            return None
        begin = x.copy()
        begin[SPEED] = situated.direction * speed
        u = situated.at(0.0, situated.direction)
        rates = np.abs(np.array((self.model.worn if mode == "worn" else self.model.slip)(begin, self.p, u)).ravel())
        rates[SPEED] = 0.0
        h = min(limit, FIRST * float(np.min(self.scale.state / np.maximum(rates, 1e-300))))
        self.stepper.tune(self.p, self.tolerances, (self.scale.longest, SHORTEST * h, np.inf, self.locate))
        self.stepper.start(mode, begin, situated, limit, h)
        return begin

    def _unfinished(self, slide: Slide, x: Array, limit: float) -> Slide:
        """Where no step is short enough the speed ceases to exist or to be stable: it folds."""
        if len(slide.times) < self._steps:
            return replace(slide, ended_by="fold")
        raise SimulationError(
            f"the {slide.mode} phase at {slide.start:.6g} s did not end within {self._steps} steps (it reached "
            f"{slide.duration:.3g} s): without inertia its speed changes too fast; add the effect inertia"
        )

    def check_braking(self, slide: Slide) -> None:
        """The forces balance: friction brakes wherever the load pulls."""

    def counts(self, phase: Phase) -> bool:
        """Whether a phase belongs to the motion: an arrest at a step of the drive is an arrest."""
        return phase.duration > 0.0 or phase.ended_by is not None

    def chatter(self, t: float, longest: float) -> str:
        """Why time does not pass at t [s], and what to do."""
        return (
            f"the contact changes between rest and slide without time passing at {t:.6g} s (chatter): "
            "without inertia nothing holds it either way; add the effect inertia"
        )


class _Forces:
    """Load and friction at the state x (n_x,) in which a slide begins, by its speed."""

    def __init__(self, model: Model, mode: ModeName, x: Array, situated: Situated) -> None:
        self.model, self.mode, self.x, self.situated = model, mode, x, situated
        self.speed = situated.direction * float(x[SPEED])
        self.values = dict(zip(model.parameter_names, situated.p.tolist(), strict=True))
        self.least = BALANCED * max(self.values["mu_s"], self.values["mu_k0"]) * situated.normal_force

    def spare(self, speeds: Array) -> Array:
        """Load minus friction at speeds (n,) along the direction of slip [N]."""
        x = np.repeat(self.x[:, None], len(speeds), axis=1)
        x[SPEED] = self.situated.direction * speeds
        u = self.situated.at(0.0, self.situated.direction)
        assert self.model.balance is not None
        return np.array(self.model.balance(x, self.situated.p, u)).ravel()

    def settled(self, folded: bool) -> float | None:
        """The speed [m/s] at which the motion goes on; None: it rests.

        Args:
            folded: the speed has just ceased to be stable.

        Raises:
            SimulationError: no speed balances the forces: the motion would jump to another place.
        """
        v, least = self.speed, self.least
        corrected, balance, by_speed, by_way = self._says(v)
        stable = by_speed < 0.0 or (by_speed == 0.0 and by_way < 0.0)
        if abs(balance) > least:
            up = balance > 0.0
        elif stable and not folded:
            for _ in range(0 if by_speed == 0.0 else POLISHING):
                corrected = max(self._says(max(corrected, 0.0))[0], 0.0)
            if corrected < 0.0:
                return None
            if abs(self.spare(np.array([corrected]))[0]) <= least:
                return corrected
            up = True  # a law that begins to depend on speed only above some speed
        elif by_speed == 0.0:
            # Away from its own balance; where that has just been lost it may run either way.
            up = not 0.0 < v <= corrected * (1.0 + 1e-6) or folded
        else:
            up = v == 0.0 or self.spare(np.array([v * (1.0 + _BESIDE)]))[0] > 0.0
        if not up:
            return self._below(v)
        above = self._above(v)
        if above is None:
            raise SimulationError(self._sentence(balance, by_speed, by_way))
        return above

    def _says(self, v: float) -> tuple[float, float, float, float]:
        """Speed after a Newton step, load minus friction, and how that changes with speed and with distance."""
        x, s = self.x.copy(), self.situated
        x[SPEED] = s.direction * v
        speed, _, force, *slopes = np.array(on_balance(self.model, self.mode)(x, s.constants, 0.0)).ravel().tolist()
        return (s.direction * speed, s.direction * force, *slopes)

    def _above(self, v: float) -> float | None:
        """The first speed above v that balances; None: there is none."""
        speeds = np.append(v * (1.0 + _BESIDE), _SPEEDS[v * (1.0 + _BESIDE) < _SPEEDS])
        forces = self.spare(speeds)
        fallen = np.flatnonzero(forces < -self.least)
        if not fallen.size:
            return None
        last = int(fallen[0])
        before = np.flatnonzero(forces[:last] > 0.0)
        if not before.size:
            # Balanced up to a speed at which the law begins: just above it, where it holds the speed.
            return self._root(float(speeds[max(last - 1, 0)]), float(speeds[last]), self.least)
        return self._root(float(speeds[before[-1]]), float(speeds[last]))

    def _below(self, v: float) -> float | None:
        """The first speed below v that balances; None: the motion comes to rest."""
        speeds = np.append(_SPEEDS[v * (1.0 - _BESIDE) > _SPEEDS], v * (1.0 - _BESIDE))[::-1]
        forces = self.spare(speeds)
        risen = np.flatnonzero(forces > self.least)
        if not risen.size:
            return None
        first = int(risen[0])
        if first == 0 or forces[first - 1] >= 0.0:
            return float(speeds[max(first - 1, 0)])
        return self._root(float(speeds[first]), float(speeds[first - 1]))

    def _root(self, low: float, high: float, more: float = 0.0) -> float:
        """The speed between low, where the load is in excess, and high, where friction is."""
        return float(brentq(lambda v: float(self.spare(np.array([v]))[0]) + more, low, high, rtol=1e-15))

    def _sentence(self, balance: float, by_speed: float, by_way: float) -> str:
        """Why there is no speed, where, and what to do."""
        s, k = self.situated, self.values["stiffness"]
        place = (
            f"at {s.time:.6g} s (drive speed {s.drive_speed:.4g} m/s, normal force {s.normal_force:.4g} N, "
            f"elongation {self.x[ELONGATION]:.4g} m)"
        )
        end = "the motion jumps, and without inertia nothing says how far"
        if balance > self.least:
            return (
                f"{place} friction falls by {balance:.4g} N as sliding sets in and no sliding speed makes up for it: "
                f"{end}; add the effect inertia, or one that resists speed (driven_damping, direct_effect)"
            )
        if by_speed > 0.0:
            return (
                f"{place} friction falls with speed by {by_speed:.4g} N s/m and no sliding speed makes up for it: "
                f"{end}; add the effect inertia, or driven_damping of more than that"
            )
        return (
            f"{place} friction falls with sliding distance by {by_way + k:.4g} N/m, faster than the stiffness of "
            f"{k:.4g} N/m unloads: {end}; add the effect inertia, or raise the stiffness above {by_way + k:.4g} N/m"
        )
