"""Steps of sliding without inertia: Radau collocation of x' = f(x, v), 0 = load - friction, v the sliding speed.

Where the balance depends on v the system has index 1 and v is its root; where it does not (Coulomb friction, contact
ageing) it has index 2 and v is what keeps the balance, linear in v. One formula serves both, and whatever lies
between: of order 5 in x either way (Hairer and Wanner, Solving Ordinary Differential Equations II, VI.1 and VII.4).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from identify.base.compiled import Compiled, compiled
from identify.base.errors import SimulationError
from identify.model.model import Model
from identify.model.modes import ModeName
from identify.simulation.bursts import inputs
from identify.simulation.stepper import Situated
from identify.simulation.steppers import ERROR, NODES, REAL

Array = NDArray[np.float64]

# Row i: integrals, up to each node, of the polynomials that are one at a node and zero at the others.
WEIGHTS = (NODES[:, None] ** np.arange(1, 4) / np.arange(1, 4)) @ np.linalg.inv(NODES[:, None] ** np.arange(3))
ESTIMATE_ORDER = 3  # of the embedded error estimate

NEWTON_STEPS = 12
PATIENCE = 4  # corrections of the speed that grow after so many of them come to no end
CLOSE = 1e-8  # of the states: a correction that small leaves an error of its square
CLOSE_SPEED = 1e-6


@dataclass(frozen=True)
class Local:
    """What the balance says at one point: dx/dt (n,), the balance [N], its slopes.

    jacobian (n+1, n+1) of (dx/dt, balance) in (x, v); drift [N/s]: rate of the balance along the motion;
    speed [m/s]: v corrected; free: rate of the bounded state were it free.
    """

    rate: Array
    balance: float
    jacobian: Array
    drift: float
    speed: float
    free: float

    @property
    def by_speed(self) -> float:
        """Change of the balance with speed [N s/m]; negative: the speed is stable; 0: it does not depend on it."""
        return float(self.jacobian[-1, -1])

    @property
    def by_way(self) -> float:
        """Change of the balance with sliding distance [N/m]: softening of friction minus stiffness."""
        return float(self.jacobian[-1, :-1] @ self.jacobian[:-1, -1])

    @property
    def stable(self) -> bool:
        """Whether a small mass would follow this speed."""
        return self.by_speed < 0.0 or (self.by_speed == 0.0 and self.by_way < 0.0)


def _moving(model: Model, mode: ModeName, x: ca.SX, v: ca.SX, p: ca.SX, drive: ca.SX, t: ca.SX) -> tuple[ca.SX, ca.SX]:
    assert model.balance is not None
    u = inputs(drive, t)
    field = model.worn if mode == "worn" else model.slip
    return field(x, p, u, v), model.balance(x, p, u, v)


def _symbols(model: Model) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
    n, n_p = len(model.states), len(model.parameters)
    return ca.SX.sym("x", n), ca.SX.sym("v"), ca.SX.sym("p", n_p), ca.SX.sym("drive", 5), ca.SX.sym("t")


@lru_cache(maxsize=64)
def local_function(model: Model, mode: ModeName) -> ca.Function:
    """(x, v, p, drive (5,), t) -> dx/dt, balance, jacobian column by column, drift, corrected speed, free rate."""
    x, v, p, drive, t = _symbols(model)
    rate, balance = _moving(model, mode, x, v, p, drive, t)
    slopes = ca.jacobian(balance, x)
    drift = slopes @ rate + ca.jacobian(balance, t)
    by_speed, by_way = ca.jacobian(balance, v), slopes @ ca.jacobian(rate, v)
    speed = v - ca.if_else(by_speed == 0, drift / by_way, balance / by_speed)
    free = _moving(model, "slip", x, v, p, drive, t)[0][model.clamped] if model.clamped is not None else ca.SX(0)
    jacobian = ca.jacobian(ca.vertcat(rate, balance), ca.vertcat(x, v))
    result = ca.vertcat(rate, balance, ca.vec(ca.densify(jacobian)), drift, speed, free)
    return ca.Function("local", [x, v, p, drive, t], [ca.densify(result)])


@lru_cache(maxsize=64)
def stage_function(model: Model, mode: ModeName) -> ca.Function:
    """(stages (3(n+1),), x, p, drive (5,), t, h) -> residuals of the stages, their jacobian column by column.

    A stage is (x, v); the last one is the state after the step.
    """
    x, _, p, drive, t = _symbols(model)
    n, h = len(model.states), ca.SX.sym("h")
    stages = ca.SX.sym("stages", 3 * (n + 1))
    parts = [stages[i * (n + 1) : (i + 1) * (n + 1)] for i in range(3)]
    motions = [_moving(model, mode, z[:n], z[n], p, drive, t + c * h) for z, c in zip(parts, NODES, strict=True)]
    rows = []
    for z, row, (_, balance) in zip(parts, WEIGHTS, motions, strict=True):
        moved = sum(weight * rate for weight, (rate, _) in zip(row, motions, strict=True))
        rows += [z[:n] - x - h * moved, balance]
    residual = ca.vertcat(*rows)
    result = ca.vertcat(residual, ca.vec(ca.densify(ca.jacobian(residual, stages))))
    return ca.Function("stages", [stages, x, p, drive, t, h], [ca.densify(result)])


class Collocator:
    """Steps one model without inertia within a tolerance; holds the buffers, so one per thread.

    Args:
        tolerance: of one step, relative to what the step formula delivers; the embedded estimate is two orders
            lower and is compared with 0.1 tolerance^(2/3) (as radau5 of the authors above does).
        scale: sizes of the states (n_x,), for absolute tolerances.
    """

    def __init__(self, model: Model, tolerance: float, scale: Array) -> None:
        self.model, self.scale = model, scale
        self.allowed = 0.1 * tolerance ** (2 / 3)
        n = len(model.states)
        self._stages, self._x, self._v = np.zeros(3 * (n + 1)), np.zeros(n), np.zeros(1)
        self._p, self._drive, self._t, self._h = np.zeros(len(model.parameters)), np.zeros(5), np.zeros(1), np.zeros(1)
        self._calls: dict[tuple[str, ModeName], Compiled] = {}

    def situate(self, situated: Situated) -> None:
        """Set what holds during the coming phase."""
        self._p[:] = situated.p
        self._drive[:] = situated.inputs

    def _call(self, what: str, mode: ModeName) -> Array:
        key = (what, mode)
        if key not in self._calls:
            bound = compiled((stage_function if what == "stages" else local_function)(self.model, mode))
            common = [self._p, self._drive, self._t]
            stages = [self._stages, self._x, *common, self._h]
            bound.bind(stages if what == "stages" else [self._x, self._v, *common])
            self._calls[key] = bound
        return self._calls[key]()

    def local(self, mode: ModeName, x: Array, v: float, t: float) -> Local:
        """What the balance says at state x and speed v, at t [s] within the phase."""
        self._x[:], self._v[0], self._t[0] = x, v, t
        n = x.size
        out = self._call("local", mode).copy()
        size = (n + 1) ** 2
        jacobian = out[n + 1 : n + 1 + size].reshape(n + 1, n + 1).T
        drift, speed, free = out[n + 1 + size :].tolist()
        return Local(out[:n], float(out[n]), jacobian, drift, speed, free)

    def step(self, mode: ModeName, x: Array, v: float, here: Local, t: float, h: float) -> tuple[Array, float] | None:
        """The three stages (3, n+1) of a step from x, v and the error norm (at most 1 acceptable); None: no solution.

        Args:
            here: what the balance says at x, v.
        """
        n = x.size
        # The speed as its slope says, where a balance that depends on it gives one.
        faster = -here.drift / here.by_speed if here.by_speed < 0.0 else 0.0
        stages = np.append(x, v) + NODES[:, None] * h * np.append(here.rate, faster)
        self._x[:], self._t[0], self._h[0] = x, t, h
        size, before = 3 * (n + 1), np.inf
        for i in range(NEWTON_STEPS):
            self._stages[:] = stages.ravel()
            out = self._call("stages", mode)
            try:
                change = np.linalg.solve(out[size:].reshape(size, size).T, out[:size]).reshape(3, n + 1)
            except np.linalg.LinAlgError:
                return None
            stages = stages - change
            length = float(np.abs(change[:, -1]).max())
            if not np.isfinite(length) or (i > PATIENCE and length > before):
                return None
            before = length
            if self._closed(stages, np.asarray(change), h):
                return stages, self._error(here, x, stages, h)
        return None

    def _closed(self, stages: Array, change: Array, h: float) -> bool:
        moved = np.abs(change)
        speed = CLOSE_SPEED * float(np.abs(stages[:, -1]).max()) + CLOSE**1.25 * float(self.scale[0]) / h
        if not moved[:, -1].max() <= speed:
            return False
        return bool((moved[:, :-1] <= CLOSE * (self.scale + np.abs(stages[:, :-1]))).all())

    def _error(self, here: Local, x: Array, stages: Array, h: float) -> float:
        """Embedded estimate, filtered so that fast decays do not spoil it (the authors' eq. IV.8.20)."""
        n = x.size
        matrix = -here.jacobian
        matrix[:n, :n] += REAL / h * np.eye(n)
        right = np.append(here.rate + ERROR @ (stages[:, :n] - x) / h, here.balance)
        try:
            error = np.linalg.solve(matrix, right)[:n]
        except np.linalg.LinAlgError:
            return np.inf
        size = 1e-3 * self.scale + np.maximum(np.abs(x), np.abs(stages[-1, :n]))
        norm = float(np.max(np.abs(error) / size)) / self.allowed
        return norm if np.isfinite(norm) else np.inf


# ----------------------------------------------------------------------------------------------------------------------
# Which speed balances the forces: at an onset, where a branch of speeds folds, where drive or load change.
#
# A small mass would follow m v' = load - friction at a standing place: from where the speed is, up or down, to the
# first speed that balances. A jump of the speed is therefore settled; where no speed balances the place itself would
# jump, how far depends on the mass that is not there, and that is refused by name.
# ----------------------------------------------------------------------------------------------------------------------

Spare = Callable[[Array], Array]  # speeds (n,) [m/s] -> load minus friction (n,) [N]

BALANCED = 1e-9  # of the friction force: less than that is no force at all
FASTEST = 1e3  # [m/s]; a speed above that is none
_SPEEDS = np.geomspace(1e-15, FASTEST, 18 * 40 + 1)
_BESIDE = 1e-3  # relative distance at which the two sides of a fold are told apart


def negligible(situated: Situated, mu: float) -> float:
    """A force that counts as none [N], at a friction coefficient mu."""
    return BALANCED * mu * situated.normal_force


def settle(
    machine: Collocator, mode: ModeName, x: Array, situated: Situated, v: float, *, folded: bool = False
) -> float | None:
    """The speed [m/s] at which the motion goes on from state x and speed v at the start of a phase; None: it rests.

    Args:
        folded: the speed v has just ceased to be stable.

    Raises:
        SimulationError: no speed balances the forces: the motion would jump to another place.
    """
    machine.situate(situated)
    here = machine.local(mode, x, v, 0.0)
    values = dict(zip(machine.model.parameter_names, situated.p.tolist(), strict=True))
    least = negligible(situated, max(values["mu_s"], values["mu_k0"]))

    def spare(speeds: Array) -> Array:
        """Load minus friction at these speeds (n,) [N]."""
        assert machine.model.balance is not None
        p, u = situated.p[:, None], situated.at(0.0, situated.direction)[:, None]
        return np.array(machine.model.balance(x, p, u, speeds[None, :])).ravel()

    towards = _towards(here, v, least, spare, folded)
    if towards == 0:
        speed = here.speed if here.by_speed == 0.0 else _polished(machine, mode, x, v)
        if speed < 0.0:
            return None
        if abs(spare(np.array([speed]))[0]) <= least:
            return speed
        towards = 1  # a law that begins to depend on speed only above some speed
    if towards > 0:
        found = _above(spare, v, least)
        if found is None:
            raise SimulationError(_sentence(here, situated, values, x, least))
        return found
    return _below(spare, v, least)


def _towards(here: Local, v: float, least: float, spare: Spare, folded: bool) -> int:
    """Which way the speed runs: 0 it is balanced, or +1, -1."""
    if abs(here.balance) > least:
        return 1 if here.balance > 0.0 else -1
    if here.stable and not folded:
        return 0
    if here.by_speed == 0.0:
        # Away from its own balance, here.speed; where that has just been lost it may run either way.
        return -1 if 0.0 < v <= here.speed * (1.0 + 1e-6) and not folded else 1
    if v == 0.0:
        return 1
    return 1 if spare(np.array([v * (1.0 + _BESIDE)]))[0] > 0.0 else -1


def _polished(machine: Collocator, mode: ModeName, x: Array, v: float) -> float:
    for _ in range(4):
        v = max(machine.local(mode, x, v, 0.0).speed, 0.0)
    return v


def _above(spare: Spare, v: float, least: float) -> float | None:
    """The first speed above v that balances; None: there is none."""
    speeds = np.append(v * (1.0 + _BESIDE) if v > 0.0 else 0.0, _SPEEDS[v * (1.0 + _BESIDE) < _SPEEDS])
    forces = spare(speeds)
    fallen = np.flatnonzero(forces < -least)
    if not fallen.size:
        return None
    last = int(fallen[0])
    before = np.flatnonzero(forces[:last] > 0.0)
    if not before.size:
        # Balanced up to a speed at which the law begins: just above it, where it holds the speed.
        return _root(lambda v: spare(v) + least, float(speeds[max(last - 1, 0)]), float(speeds[last]))
    return _root(spare, float(speeds[before[-1]]), float(speeds[last]))


def _below(spare: Spare, v: float, least: float) -> float | None:
    """The first speed below v that balances; None: the motion comes to rest."""
    speeds = np.append(_SPEEDS[v * (1.0 - _BESIDE) > _SPEEDS], v * (1.0 - _BESIDE))[::-1]
    forces = spare(speeds)
    risen = np.flatnonzero(forces > least)
    if not risen.size:
        return None
    first = int(risen[0])
    if first == 0 or forces[first - 1] >= 0.0:
        return float(speeds[max(first - 1, 0)])
    return _root(spare, float(speeds[first]), float(speeds[first - 1]))


def _root(spare: Spare, low: float, high: float) -> float:
    """The speed between low, where the load is in excess, and high, where friction is."""
    return float(brentq(lambda v: float(spare(np.array([v]))[0]), low, high, rtol=1e-15))


def _sentence(here: Local, situated: Situated, values: dict[str, float], x: Array, least: float) -> str:
    """Why there is no speed, where, and what to do."""
    place = (
        f"at {situated.time:.6g} s (drive speed {situated.drive_speed:.4g} m/s, normal force "
        f"{situated.normal_force:.4g} N, elongation {x[0]:.4g} m)"
    )
    end = "the motion jumps, and without inertia nothing says how far"
    if here.balance > least:
        return (
            f"{place} friction falls by {here.balance:.4g} N as sliding sets in and no sliding speed makes up for it: "
            f"{end}; add the effect inertia, or one that resists speed (driven_damping, direct_effect)"
        )
    if here.by_speed > 0.0:
        return (
            f"{place} friction falls with speed by {here.by_speed:.4g} N s/m and no sliding speed makes up for it: "
            f"{end}; add the effect inertia, or driven_damping of more than that"
        )
    softening = here.by_way + values["stiffness"]
    return (
        f"{place} friction falls with sliding distance by {softening:.4g} N/m, faster than the stiffness of "
        f"{values['stiffness']:.4g} N/m unloads: {end}; add the effect inertia, or raise the stiffness above "
        f"{softening:.4g} N/m"
    )
