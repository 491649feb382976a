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
REFINEMENTS = 12
TURN = 0.5  # of the direction, expected from one step [rad]
CLOSE, SURE = 2e-4, 2e-3  # of ln drive speed, of doubt in the end before a cubic closes in: wanted, accepted


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


def _doubt(before: _Point, behind: _Point) -> float:
    """What the branch may still rise, of ln drive speed, above the better of two points around its fold."""
    flattest = min(abs(float(before.direction[-1])), abs(float(behind.direction[-1])))
    return flattest * float(np.linalg.norm(behind.z - before.z))


def _crest(before: _Point, behind: _Point) -> Array:
    """Where the cubic through two points around the fold, along their directions, has its highest drive speed."""
    span = behind.z - before.z
    length = float(np.linalg.norm(span))
    start, end = length * before.direction, length * behind.direction
    square, cube = 3.0 * span - 2.0 * start - end, start + end - 2.0 * span
    # Where the slope start + 2 square s + 3 cube s^2 of ln drive speed falls through zero.
    root = np.sqrt(max(float(square[-1] ** 2 - 3.0 * cube[-1] * start[-1]), 0.0))
    share = float(np.clip(start[-1] / (root - square[-1]), 0.02, 0.98)) if root > square[-1] else 0.5
    return np.asarray(before.z + start * share + square * share**2 + cube * share**3)


def _fold(map_: CycleMap, before: _Point, behind: _Point) -> End | None:
    """The end between two points of a branch, before and behind the fold; None where it cannot be closed in on.

    At the fold the drive speed is stationary along the branch, so how it moves with the setting while the place
    on the branch is held is how the end moves.
    """
    n, side, halve = map_.scale.size, 0.0, False
    for _ in range(REFINEMENTS):
        if _doubt(before, behind) < CLOSE:
            break
        guess = 0.5 * (before.z + behind.z) if halve else _crest(before, behind)
        middle = _solve(map_, guess, before.direction)
        if middle is None:
            break
        now = float(np.sign(middle.direction[-1]))
        before, behind = (middle, behind) if now > 0.0 else (before, middle)
        side, halve = now, now == side and not halve  # twice on one side: the other must come closer
    if not _doubt(before, behind) < SURE:
        return None
    crest = _crest(before, behind)
    _, slope, flow = _equations(map_, crest, full=True)
    by_setting = _ordered(map_, flow.fixed[:, n:])
    speed = float(np.exp(crest[-1]))
    return End(speed, speed * np.linalg.lstsq(slope, -by_setting, rcond=None)[0][-1])
