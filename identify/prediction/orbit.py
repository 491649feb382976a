"""The periodic stick-slip orbit of the composed model: fixed point of the map from arrest to arrest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.model.model import ELONGATION
from identify.prediction.cycle import Cycle, CycleMap, Tangent, rest_state
from identify.simulation.sliding import growth_rates

Array = NDArray[np.float64]

TOLERANCE = 1e-7  # of the closure of a cycle, in units of normal force / stiffness
RESOLVED = 1e-2  # share of the jump to which a cycle has to close: jumps that fade away look closed before they are
FARTHEST = 0.3  # of one step towards closure, in the same units
MAX_STEPS = 12
SETTLING = 40  # plain cycles before a motion that has not settled is called irregular
TRIES = (1, 9, 24)  # cycles after which the orbit is sought by Newton's method
LONGEST, DRIFTING = 600, 10  # cycles: a motion that still drifts one way lingers, as just beyond an end
SURE = 24  # cycles after which an orbit that is found but unstable is taken for what the motion hovers around


@dataclass(frozen=True)
class Orbit:
    """A periodic orbit: its cycle, closed to `closure` (units of normal force / stiffness), and how that moves
    with its start and the drive speed.

    jacobian (n_y, n_y): of the return map, in scaled rest states.
    """

    drive_speed: float
    cycle: Cycle
    tangent: Tangent
    jacobian: Array
    closure: float

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Floquet multipliers (n_y,) of the return map, largest magnitude first: inside the unit circle the orbit is
        stable, at 1 it meets its unstable twin and ends. The trivial one, along the motion, is not among them."""
        values = np.linalg.eigvals(self.jacobian).astype(complex)
        return np.asarray(values[np.argsort(-np.abs(values), kind="stable")])

    @property
    def multiplier(self) -> float:
        """The multiplier of largest magnitude, with its sign (the real part where it is complex)."""
        return float(self.multipliers[0].real)

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out."""
        return bool(np.abs(self.multipliers[0]) < 1.0)

    @property
    def jump(self) -> float:
        """How far the spring relaxes in a slip [m]."""
        return float(abs(self.cycle.onset[ELONGATION] - self.cycle.end[ELONGATION]))

    @property
    def y(self) -> Array:
        """Rest state at the arrest, shape (n_y,)."""
        return rest_state(self.cycle.start)


def orbit_of(map_: CycleMap, cycle: Cycle, tangent: Tangent | None = None) -> Orbit:
    """A cycle that closes, as an orbit; its tangent is taken where it is not given."""
    tangent = map_.tangent(cycle) if tangent is None else tangent
    n = map_.scale.size
    residual = (rest_state(cycle.end) - rest_state(cycle.start)) / map_.scale
    slope = tangent.end[:, :n] * map_.scale / map_.scale[:, None]
    return Orbit(float(cycle.setting[-1]), cycle, tangent, slope, float(np.max(np.abs(residual))))


def close(map_: CycleMap, y: Array, drive_speed: float, growth: float | None = None) -> Orbit | None:
    """The orbit near rest state y, by Newton's method; None when it is not found there.

    Args:
        growth: see `CycleMap.run`.
    """
    step: Array | None = None
    for _ in range(MAX_STEPS):
        cycle = map_.run(y, drive_speed, growth)
        if cycle is None:
            # The mass slides from here: go back half the way.
            if step is None or np.max(np.abs(step)) < 1e-6:
                return None
            step = np.asarray(0.5 * step)
            y = y - step * map_.scale
            continue
        orbit, y = orbit_of(map_, cycle), rest_state(cycle.start)
        if orbit.closure < min(TOLERANCE, RESOLVED * orbit.jump / map_.scale[ELONGATION]):
            return orbit if np.all(np.isfinite(orbit.jacobian)) else None
        residual = (rest_state(cycle.end) - y) / map_.scale
        move = np.linalg.lstsq(np.eye(y.size) - orbit.jacobian, residual, rcond=None)[0]
        step = np.asarray(move * min(1.0, FARTHEST / float(np.max(np.abs(move)))))
        y = y + step * map_.scale
    return None


def along(scale: Array, tangent: Tangent, jacobian: Array) -> Array:
    """How the rest state of an orbit, of typical size `scale`, moves with its setting while it stays an orbit:
    shape (n_y, n_w)."""
    n = scale.size
    sizes = scale[:, None]
    return np.asarray(np.linalg.lstsq(np.eye(n) - jacobian, tangent.end[:, n:] / sizes, rcond=None)[0] * sizes)


@dataclass(frozen=True)
class SettledMotion:
    """What becomes of a motion: it settles on `orbit`; without one it `sticks` irregularly, or slides. state: the rest
    state (n_y,) it came to last."""

    orbit: Orbit | None
    sticks: bool
    state: Array


def settle(
    map_: CycleMap,
    drive_speed: float,
    y: Array | None = None,
    growth: float | None = None,
    cycles: int = SETTLING,
) -> SettledMotion:
    """What the motion from rest state y (default: spring unloaded, contact saturated) settles on.

    Plain cycles, with `close` tried now and then, until it succeeds or that many `cycles` are over; more where the
    motion still drifts one way.
    """
    y = map_.rested() if y is None else y
    growth = float(growth_rates(map_.model, map_.setting(drive_speed))[0]) if growth is None else growth
    drift, lasted = 0.0, 0
    for i in range(LONGEST):
        if i >= cycles and lasted < DRIFTING:
            break
        cycle = map_.run(y, drive_speed, growth)
        if cycle is None:
            return SettledMotion(None, False, y)
        before, y = y, rest_state(cycle.end)
        now = float(np.sign(y[ELONGATION] - before[ELONGATION]))
        drift, lasted = now, lasted + 1 if now == drift else 0
        still = float(np.max(np.abs((y - before) / map_.scale))) < TOLERANCE
        if still or i in TRIES or i == cycles - 1 or (i >= cycles and i % cycles == 0):
            orbit = close(map_, y, drive_speed, growth)
            if orbit is not None and (orbit.stable or i >= min(SURE, cycles - 1)):
                return SettledMotion(orbit, True, orbit.y)
    return SettledMotion(None, True, y)
