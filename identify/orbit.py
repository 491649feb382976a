"""The periodic stick-slip orbit of the composed model: fixed point of the map from arrest to arrest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.cycle import SLIDES_AFTER, Cycle, CycleMap, rest_state

Array = NDArray[np.float64]

TOLERANCE = 1e-7  # of the closure of a cycle, in units of normal force / stiffness
DIFFERENCE = 1e-5  # step of the difference quotients, in the same units
MAX_STEPS = 12
SETTLING = 40  # plain cycles before a motion that has not settled is called irregular


@dataclass(frozen=True)
class Orbit:
    """A periodic orbit: its cycle, closed to `closure` (units of normal force / stiffness).

    jacobian (n_y, n_y): of the return map, in scaled rest states; multipliers are its eigenvalues, largest
    magnitude first: inside the unit circle the orbit is stable, at 1 it meets its unstable twin and ends.
    """

    drive_speed: float
    cycle: Cycle
    jacobian: Array
    closure: float

    @property
    def multiplier(self) -> float:
        """The multiplier of largest magnitude, with its sign (the real part where it is complex)."""
        values = np.linalg.eigvals(self.jacobian)
        return float(values[np.argmax(np.abs(values))].real)

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out."""
        return bool(np.max(np.abs(np.linalg.eigvals(self.jacobian))) < 1.0)

    @property
    def y(self) -> Array:
        """Rest state at the arrest, shape (n_y,)."""
        return rest_state(self.cycle.start)


def jacobian(map_: CycleMap, y: Array, drive_speed: float, here: Cycle, patience: float) -> Array:
    """Derivative of the scaled return map at y by one-sided differences; columns the map does not reach are 0."""
    base = rest_state(here.end) / map_.scale
    out = np.zeros((y.size, y.size))
    for i in range(y.size):
        for step in (DIFFERENCE, -DIFFERENCE):
            moved = y.copy()
            moved[i] += step * map_.scale[i]
            other = map_.run(moved, drive_speed, patience=patience)
            if other is not None:
                out[:, i] = (rest_state(other.end) / map_.scale - base) / step
                break
    return out


def close(
    map_: CycleMap,
    y: Array,
    drive_speed: float,
    guess: Array | None = None,
    *,
    patience: float = SLIDES_AFTER,
    exact: bool = True,
) -> Orbit | None:
    """The orbit near rest state y, by Newton's method with Broyden's updates; None when it is not found there.

    Args:
        guess: a Jacobian from a neighbouring orbit, (n_y, n_y).
        patience: see `CycleMap.run`.
        exact: take the Jacobian of the result by differences; else the one the updates have left.
    """
    y = y.copy()
    slope, fresh = guess, False
    last_step = last_residual = None
    for _ in range(MAX_STEPS):
        cycle = map_.run(y, drive_speed, patience=patience)
        if cycle is None:
            if last_step is None or np.max(np.abs(last_step)) < 1e-6:
                return None
            last_step = 0.5 * last_step
            y, last_residual = y - last_step * map_.scale, None
            continue
        residual = rest_state(cycle.end) / map_.scale - y / map_.scale
        closure = float(np.max(np.abs(residual)))
        if closure < TOLERANCE:
            if exact or slope is None:
                slope = jacobian(map_, y, drive_speed, cycle, patience)
            return Orbit(drive_speed, cycle, slope, closure)
        if slope is None:
            slope, fresh = jacobian(map_, y, drive_speed, cycle, patience), True
        elif last_residual is not None and last_step is not None:
            bend = residual - last_residual - (slope - np.eye(y.size)) @ last_step
            slope = slope + np.outer(bend, last_step) / (last_step @ last_step)
        if last_residual is not None and closure > 0.5 * float(np.max(np.abs(last_residual))) and not fresh:
            slope, fresh = jacobian(map_, y, drive_speed, cycle, patience), True
        else:
            fresh = False
        step = np.linalg.lstsq(np.eye(y.size) - slope, residual, rcond=None)[0]
        step *= min(1.0, 0.3 / float(np.max(np.abs(step))))
        last_step, last_residual = step, residual
        y = y + step * map_.scale
    return None


@dataclass(frozen=True)
class Settled:
    """What becomes of a motion: it settles on `orbit`; without one it `sticks` irregularly, or slides."""

    orbit: Orbit | None
    sticks: bool


def settle(
    map_: CycleMap,
    drive_speed: float,
    y: Array | None = None,
    *,
    patience: float = SLIDES_AFTER,
    cycles: int = SETTLING,
) -> Settled:
    """What the motion from rest state y (default: spring unloaded, contact saturated) settles on.

    Plain cycles, with `close` tried now and then, until it succeeds or that many `cycles` are over.
    """
    y = map_.rested() if y is None else y
    for i in range(cycles):
        cycle = map_.run(y, drive_speed, patience=patience)
        if cycle is None:
            return Settled(None, sticks=False)
        before, y = y, rest_state(cycle.end)
        still = float(np.max(np.abs((y - before) / map_.scale)))
        if still < TOLERANCE or i in (2, 9, 24, cycles - 1):
            orbit = close(map_, y, drive_speed, patience=patience)
            if orbit is not None:
                return Settled(orbit, sticks=True)
    return Settled(None, sticks=True)
