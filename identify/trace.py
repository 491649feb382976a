"""A branch of orbits followed by arc length to faster drives, through the fold in which stick-slip ends.

Unknowns z = (rest state y in units of normal force / stiffness, ln slip duration, ln drive speed); equations: after
that duration the state is y again, and the speed is zero. Asking for zero speed at a given time, rather than for
the first time of zero speed, keeps the equations smooth where the slip only just comes to rest; so the end is a
fold of z whether two orbits meet there or the arrest is lost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.cycle import CycleMap, Flow
from identify.model import SPEED
from identify.orbit import Orbit, orbit_of

Array = NDArray[np.float64]

TOLERANCE = 1e-5  # of the equations, scaled
SHRINKING = 0.7  # by which a correction has to shrink the residual
CORRECTIONS = 6
POINTS = 60
SHORTEST, WIDEST = 1e-4, 2.5  # arc lengths of a step
STRAIGHT = 0.8  # cosine of the turn of the branch that one step may take
FLAT = 0.02  # share of ln drive speed in the direction of the branch at which the fold counts as found
REFINEMENTS = 12
TURN = 0.5  # of the direction, expected from one step [rad]
SURE = 3e-4  # of ln drive speed that the last parabola may add to the end


@dataclass(frozen=True)
class End:
    """The end of a branch: drive speed [m/s], its derivatives (n_w,) by parameters, drive speed and normal force."""

    speed: float
    slopes: Array


@dataclass(frozen=True)
class Trace:
    """Orbits at rising drive speeds; `end` is None when there was none up to the highest speed, or when the branch
    was lost (`lost`) before an end was seen."""

    orbits: tuple[Orbit, ...]
    end: End | None
    lost: bool


@dataclass(frozen=True)
class _Point:
    z: Array
    flow: Flow
    slope: Array  # d equations/dz (n_y + 1, n_y + 2)
    direction: Array  # unit vector along the branch
    corrections: int


def _ordered(map_: CycleMap, x: Array) -> Array:
    """Rows of a state (n_x, ...), scaled; the rest state first, the speed last."""
    n = map_.scale.size
    units = np.insert(map_.scale, SPEED, map_.speed).reshape(-1, *[1] * (x.ndim - 1))
    return np.asarray((x / units)[[*(i for i in range(n + 1) if i != SPEED), SPEED]])


def _equations(map_: CycleMap, z: Array, *, full: bool = False) -> tuple[Array, Array, Flow]:
    """Residual (n_y + 1,), its Jacobian (n_y + 1, n_y + 2), and the flow."""
    n = map_.scale.size
    y, duration, speed = z[:n] * map_.scale, float(np.exp(z[n])) * map_.time, float(np.exp(z[n + 1]))
    flow = map_.flow(y, speed, duration, full=full)
    residual = _ordered(map_, flow.cycle.end)
    residual[:n] -= z[:n]
    slope = np.empty((n + 1, n + 2))
    slope[:, :n] = flow.fixed[:, :n] * map_.scale
    slope[:, n] = flow.rate * duration
    slope[:, n + 1] = flow.fixed[:, -1] * speed
    slope = _ordered(map_, slope)
    slope[:n, :n] -= np.eye(n)
    return residual, slope, flow


def _along(slope: Array, before: Array) -> Array:
    """The direction that leaves the equations satisfied, oriented like `before`."""
    direction = np.linalg.svd(slope)[2][-1]
    return np.asarray(direction if direction @ before >= 0 else -direction)


def _solve(map_: CycleMap, z: Array, before: Array) -> _Point | None:
    """The point of the branch nearest to z; None when the corrections do not shrink."""
    last = np.inf
    for i in range(CORRECTIONS):
        residual, slope, flow = _equations(map_, z)
        size = float(np.max(np.abs(residual)))
        if not size < SHRINKING * last or not np.all(np.isfinite(slope)):
            return None
        if size < TOLERANCE:
            return _Point(z, flow, slope, _along(slope, before), i)
        step = np.linalg.lstsq(slope, -residual, rcond=None)[0]
        if np.max(np.abs(step)) > 1.0:
            return None
        last, z = size, z + step
    return None


def _orbit(map_: CycleMap, flow: Flow) -> Orbit | None:
    """The point as an orbit, None unless its slip comes to rest there for the first time, and stays at rest."""
    first = bool(np.all(flow.cycle.glide.x[1:-1, SPEED] > 0.0)) and flow.rate[SPEED] < 0.0 < flow.cycle.stick
    return orbit_of(map_, flow.cycle, flow.tangent) if first and map_.holds(flow.cycle) else None


def trace(map_: CycleMap, start: Orbit, highest: float) -> Trace:
    """The branch from `start` towards faster drives, up to its end or to drive speed `highest` [m/s]."""
    orbits = [start]
    n = map_.scale.size
    first = np.concatenate(
        [start.y / map_.scale, np.log([start.cycle.slip / map_.time, start.drive_speed])],
    )
    here = None if start.cycle.glide.turns else _solve(map_, first, np.eye(n + 2)[-1])
    length, bend = 0.7, np.zeros(n + 2)
    for _ in range(POINTS):
        if here is None or length < SHORTEST:
            return Trace(tuple(orbits), None, lost=True)
        new = _solve(map_, here.z + length * here.direction + 0.5 * length**2 * bend, here.direction)
        if new is None or new.direction @ here.direction < STRAIGHT:
            length *= 0.4
            continue
        if new.direction[-1] <= 0.0:
            end = _fold(map_, here, new)
            return Trace(tuple(orbits), end, lost=end is None)
        orbit = _orbit(map_, new.flow)
        if orbit is None:
            length *= 0.4
            continue
        orbits.append(orbit)
        if orbit.drive_speed >= highest:
            return Trace(tuple(orbits), None, lost=False)
        bend = (new.direction - here.direction) / float(np.linalg.norm(new.z - here.z))
        here, length = new, _next_length(length, new, bend)
    return Trace(tuple(orbits), None, lost=True)


def _next_length(length: float, here: _Point, bend: Array) -> float:
    """Arc length of the next step: longer where few corrections were needed, and not far beyond the coming fold."""
    length = min(WIDEST, length * (2.0 if here.corrections <= 2 else 1.0))
    turn = float(np.linalg.norm(bend))
    return min(length, TURN / turn) if turn > 0.0 else length


def _fold(map_: CycleMap, before: _Point, behind: _Point) -> End | None:
    """The fold between two points of a branch: where its direction has no part along the drive speed."""
    best = min(before, behind, key=lambda q: abs(float(q.direction[-1])))
    rise, fall = float(before.direction[-1]), float(behind.direction[-1])
    for _ in range(REFINEMENTS):
        if abs(best.direction[-1]) < FLAT:
            break
        share = float(np.clip(rise / (rise - fall), 0.05, 0.95))
        best_now = _solve(map_, before.z + share * (behind.z - before.z), before.direction)
        if best_now is None:
            break
        best, value = best_now, float(best_now.direction[-1])
        # The end that stays loses weight, or the other one alone would creep towards the fold.
        if value > 0.0:
            before, rise, fall = best, value, 0.5 * fall
        else:
            behind, fall, rise = best, value, 0.5 * rise
    return _end(map_, before, behind, best)


def _end(map_: CycleMap, before: _Point, behind: _Point, best: _Point) -> End | None:
    """The end, from the point nearest to the fold: its speed plus what the parabola through the fold adds.

    At the fold the drive speed is stationary along the branch, so how it moves with the setting while the place
    on the branch is held is how the end moves.
    """
    n = map_.scale.size
    bend = float(before.direction[-1] - behind.direction[-1]) / float(np.linalg.norm(behind.z - before.z))
    rise = float(best.direction[-1])
    rest = rise**2 / (2.0 * bend)
    if not rest < SURE:
        return None
    _, slope, flow = _equations(map_, best.z + rise / bend * best.direction, full=True)
    by_setting = _ordered(map_, flow.fixed[:, n:])
    speed = float(np.exp(best.z[-1] + rest))
    moved = np.linalg.lstsq(slope, -by_setting, rcond=None)[0][-1]
    return End(speed, speed * moved)
