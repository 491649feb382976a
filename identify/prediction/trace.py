"""A branch of orbits followed by arc length along a course, through the fold in which stick-slip ends.

Unknowns z = (rest state y in units of normal force / stiffness, ln slip duration in units of sqrt(m/k), coordinate of
the course); equations: after that duration the state is y again, and the speed is zero. Asking for zero speed at a
given time, rather than for the first time of zero speed, keeps the equations smooth where the slip only just comes to
rest; so the end is a fold of z whether two orbits meet there or the arrest is lost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.model.model import ELONGATION, SPEED
from identify.prediction.course import Course
from identify.prediction.cycle import CycleMap, Flow
from identify.prediction.orbit import Orbit, orbit_of

Array = NDArray[np.float64]

TOLERANCE = 1e-5  # of the equations, scaled
LEAST = 100.0 * TOLERANCE  # jumps smaller than this, in units of normal force / stiffness, are not told from none
SHRINKING = 0.7  # by which a correction has to shrink the residual
CORRECTIONS = 6
POINTS = 60
SHORTEST, LENGTH, WIDEST = 1e-4, 0.7, 2.5  # arc lengths of a step: least, first, largest
STRAIGHT = 0.8  # cosine of the turn of the branch that one step may take
REFINEMENTS = 12
TURN = 0.5  # of the direction, expected from one step [rad]
CLOSE, SURE = 2e-4, 2e-3  # of the coordinate, of doubt in the end before a cubic closes in: wanted, accepted


@dataclass(frozen=True)
class End:
    """The end of a branch: coordinate of the course there, and its derivatives (n_w,) by parameters, normal force and
    drive speed while every other entry of the setting stays on the course."""

    place: float
    slopes: Array


@dataclass(frozen=True)
class Trace:
    """Orbits at rising coordinates, `places` (n,); `end` is None when there was none up to the last coordinate, or
    when the branch was lost (`lost`) before an end was seen."""

    orbits: tuple[Orbit, ...]
    places: tuple[float, ...]
    end: End | None
    lost: bool


@dataclass(frozen=True)
class _Point:
    z: Array
    flow: Flow
    slope: Array  # d equations/dz (n_y + 1, n_y + 2)
    direction: Array  # unit vector along the branch
    corrections: int


@dataclass(frozen=True)
class _Walk:
    """What is walked: a map, whose tolerances count, and the course."""

    map_: CycleMap
    course: Course

    def at(self, place: float) -> _Walk:
        """The same walk with tolerances for another place."""
        return _Walk(self.map_.at(self.course.setting(place)), self.course)

    def scale(self, w: Array) -> tuple[Array, float]:
        """Typical sizes at a setting: of the rest state (n_y,), and of time [s]."""
        mass, stiffness = (w[self.map_.names.index(name)] for name in ("mass", "stiffness"))
        sizes = self.map_.scale.copy()
        sizes[ELONGATION] = w[-2] / stiffness
        return sizes, float(np.sqrt(mass / stiffness))

    def stretch(self, w: Array, slope: Array) -> tuple[Array, float]:
        """How the logarithms of those sizes move along the course."""
        mass, stiffness = (slope[i] / w[i] for i in map(self.map_.names.index, ("mass", "stiffness")))
        sizes = np.zeros(self.map_.scale.size)
        sizes[ELONGATION] = slope[-2] / w[-2] - stiffness
        return sizes, float(0.5 * (mass - stiffness))

    def ordered(self, x: Array) -> Array:
        """Rows of a state (n_x, ...), scaled; the rest state first, the speed last."""
        n = self.map_.scale.size
        units = np.insert(self.map_.scale, SPEED, self.map_.speed).reshape(-1, *[1] * (x.ndim - 1))
        return np.asarray((x / units)[[*(i for i in range(n + 1) if i != SPEED), SPEED]])

    def start(self, orbit: Orbit, place: float) -> Array:
        """z of an orbit."""
        sizes, time = self.scale(orbit.cycle.setting)
        return np.concatenate([orbit.y / sizes, [np.log(orbit.cycle.slip / time), place]])

    def equations(self, z: Array) -> tuple[Array, Array, Flow]:
        """Residual (n_y + 1,), its Jacobian (n_y + 1, n_y + 2), and the flow."""
        n = self.map_.scale.size
        w, along = self.course.setting(float(z[-1])), self.course.slope(float(z[-1]))
        (sizes, time), (growing, slowing) = self.scale(w), self.stretch(w, along)
        y, duration = z[:n] * sizes, float(np.exp(z[n])) * time
        flow = self.map_.flow(y, w, duration)
        residual = flow.cycle.end.copy()
        rest = [i for i in range(n + 1) if i != SPEED]
        residual[rest] -= y
        slope = np.empty((n + 1, n + 2))
        slope[:, :n] = flow.fixed[:, :n] * sizes
        slope[rest, :n] -= np.diag(sizes)
        slope[:, n] = flow.rate * duration
        stretched = y * growing
        slope[:, n + 1] = flow.fixed[:, n:] @ along + flow.fixed[:, :n] @ stretched + flow.rate * duration * slowing
        slope[rest, n + 1] -= stretched
        return self.ordered(residual), self.ordered(slope), flow


def _along(slope: Array, before: Array) -> Array:
    """The direction that leaves the equations satisfied, oriented like `before`."""
    direction = np.linalg.svd(slope)[2][-1]
    return np.asarray(direction if direction @ before >= 0 else -direction)


def _solve(walk: _Walk, z: Array, before: Array) -> _Point | None:
    """The point of the branch nearest to z; None when the corrections do not shrink."""
    last = np.inf
    for i in range(CORRECTIONS):
        residual, slope, flow = walk.equations(z)
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


def trace(map_: CycleMap, start: Orbit, course: Course, place: float, last: float) -> Trace:
    """The branch from `start`, at coordinate `place` of the course, up to its end or to coordinate `last`."""
    orbits, places = [start], [place]
    walk = _Walk(map_, course)
    first = walk.start(start, place)
    small = start.jump < LEAST * walk.scale(start.cycle.setting)[0][ELONGATION]
    here = None if start.cycle.glide.turns or small else _solve(walk, first, np.eye(first.size)[-1])
    length, bend = min(LENGTH, 2.0 * (last - place)), np.zeros(first.size)
    for _ in range(POINTS):
        if here is None or length < SHORTEST:
            return Trace(tuple(orbits), tuple(places), None, lost=True)
        new = _solve(walk, here.z + length * here.direction + 0.5 * length**2 * bend, here.direction)
        if new is None or new.direction @ here.direction < STRAIGHT:
            length *= 0.4
            continue
        if new.direction[-1] <= 0.0:
            end = _fold(walk, here, new)
            return Trace(tuple(orbits), tuple(places), end, lost=end is None)
        orbit = _orbit(map_, new.flow)
        if orbit is None:
            length *= 0.4
            continue
        if orbit.jump < LEAST * walk.scale(orbit.cycle.setting)[0][ELONGATION]:
            return Trace(tuple(orbits), tuple(places), None, lost=True)
        orbits, places = [*orbits, orbit], [*places, float(new.z[-1])]
        if places[-1] >= last:
            return Trace(tuple(orbits), tuple(places), None, lost=False)
        bend = (new.direction - here.direction) / float(np.linalg.norm(new.z - here.z))
        here, length, walk = new, _next_length(length, new, bend), walk.at(places[-1])
    return Trace(tuple(orbits), tuple(places), None, lost=True)


def _next_length(length: float, here: _Point, bend: Array) -> float:
    """Arc length of the next step: longer where few corrections were needed, and not far beyond the coming fold."""
    length = min(WIDEST, length * (2.0 if here.corrections <= 2 else 1.0))
    turn = float(np.linalg.norm(bend))
    return min(length, TURN / turn) if turn > 0.0 else length


def _doubt(before: _Point, behind: _Point) -> float:
    """What the branch may still rise, of its coordinate, above the better of two points around its fold."""
    flattest = min(abs(float(before.direction[-1])), abs(float(behind.direction[-1])))
    return flattest * float(np.linalg.norm(behind.z - before.z))


def _crest(before: _Point, behind: _Point) -> Array:
    """Where the cubic through two points around the fold, along their directions, has its highest coordinate."""
    span = behind.z - before.z
    length = float(np.linalg.norm(span))
    start, end = length * before.direction, length * behind.direction
    square, cube = 3.0 * span - 2.0 * start - end, start + end - 2.0 * span
    # Where the slope start + 2 square s + 3 cube s^2 of the coordinate falls through zero.
    root = np.sqrt(max(float(square[-1] ** 2 - 3.0 * cube[-1] * start[-1]), 0.0))
    share = float(np.clip(start[-1] / (root - square[-1]), 0.02, 0.98)) if root > square[-1] else 0.5
    return np.asarray(before.z + start * share + square * share**2 + cube * share**3)


def _fold(walk: _Walk, before: _Point, behind: _Point) -> End | None:
    """The end between two points of a branch, before and behind the fold; None where it cannot be closed in on.

    At the fold the coordinate is stationary along the branch, so how it moves with the setting while the place
    on the branch is held is how the end moves.
    """
    n, side, halve = walk.map_.scale.size, 0.0, False
    for _ in range(REFINEMENTS):
        if _doubt(before, behind) < CLOSE:
            break
        guess = 0.5 * (before.z + behind.z) if halve else _crest(before, behind)
        middle = _solve(walk, guess, before.direction)
        if middle is None:
            break
        now = float(np.sign(middle.direction[-1]))
        before, behind = (middle, behind) if now > 0.0 else (before, middle)
        side, halve = now, now == side and not halve  # twice on one side: the other must come closer
    if not _doubt(before, behind) < SURE:
        return None
    crest = _crest(before, behind)
    _, slope, flow = walk.equations(crest)
    by_setting = walk.ordered(flow.fixed[:, n:])
    return End(float(crest[-1]), np.linalg.lstsq(slope, -by_setting, rcond=None)[0][-1])
