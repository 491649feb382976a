"""Which speed balances the forces: at an onset, where a branch of speeds folds, where drive or load change.

A small mass would follow m v' = load - friction at a standing place: from where the speed is, up or down, to the first
speed that balances. A jump of the speed is therefore settled; where no speed balances the place itself would jump, how
far depends on the mass that is not there, and that is refused by name.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from identify.base.errors import SimulationError
from identify.model.modes import ModeName
from identify.simulation.quasistatic_collocation import Collocator, Local
from identify.simulation.situated import Situated

Array = NDArray[np.float64]
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
