"""A path of orbits through the settings of a cycle: followed by arc length through its folds, else by shorter steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.model.model import ELONGATION, SPEED
from identify.prediction.cycle import CycleMap, Flow, Tangent
from identify.prediction.orbit import Orbit, close, orbit_of, patience

# ----------------------------------------------------------------------------------------------------------------------
# A way through the settings of a cycle: what moves, and how, while a branch of orbits is followed.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SettingPath:
    """Settings w (n_w,) = parameters, normal force [N], drive speed [m/s] by one rising coordinate s, of order 1.

    setting: s -> w; slope: s -> dw/ds.
    """

    setting: Callable[[float], Array]
    slope: Callable[[float], Array]

    def reversed(self) -> SettingPath:
        """The same way the other way round: its coordinate is -s."""
        return SettingPath(lambda s: self.setting(-s), lambda s: -self.slope(-s))


def drive_speed_path(setting: Array) -> SettingPath:
    """Every drive speed, the rest as in one setting; s is the logarithm of the drive speed in m/s."""

    def at(s: float) -> Array:
        return np.append(setting[:-1], np.exp(s))

    def slope(s: float) -> Array:
        return np.append(np.zeros(setting.size - 1), np.exp(s))

    return SettingPath(at, slope)


# ----------------------------------------------------------------------------------------------------------------------
# A branch of orbits followed by arc length along a path, through the fold in which stick-slip ends.
#
# Unknowns z = (rest state y in units of normal force / stiffness, ln slip duration in units of sqrt(m/k), coordinate of
# the path); equations: after that duration the state is y again, and the speed is zero. Asking for zero speed at a
# given time, rather than for the first time of zero speed, keeps the equations smooth where the slip only just comes to
# rest; so the end is a fold of z whether two orbits meet there or the arrest is lost.
# ----------------------------------------------------------------------------------------------------------------------

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
class Crossing:
    """Where an answer changes along a path, as where a branch ends: coordinate there, its derivatives (n_w,) by
    parameters, normal force and drive speed while every other entry of the setting stays on the path, and whether it is
    the contact that wears out there."""

    place: float
    slopes: Array
    wear: bool = False


@dataclass(frozen=True)
class OrbitPath:
    """Orbits along a path at rising coordinates, `places` (n,); `end` is None when there was none up to the last
    coordinate asked for, or when the branch was lost (`lost`) before an end was seen."""

    orbits: tuple[Orbit, ...]
    places: tuple[float, ...]
    end: Crossing | None
    lost: bool = False


@dataclass(frozen=True)
class _BranchPoint:
    z: Array
    flow: Flow
    slope: Array  # d equations/dz (n_y + 1, n_y + 2)
    direction: Array  # unit vector along the branch
    corrections: int


@dataclass(frozen=True)
class _Walk:
    """What is walked: a map, whose tolerances count, and the path."""

    map_: CycleMap
    setting_path: SettingPath

    def at(self, place: float) -> _Walk:
        """The same walk with tolerances for another place."""
        return _Walk(self.map_.at(self.setting_path.setting(place)), self.setting_path)

    def scale(self, w: Array) -> tuple[Array, float]:
        """Typical sizes at a setting: of the rest state (n_y,), and of time [s]."""
        mass, stiffness = (w[self.map_.names.index(name)] for name in ("mass", "stiffness"))
        sizes = self.map_.scale.copy()
        sizes[ELONGATION] = w[-2] / stiffness
        return sizes, float(np.sqrt(mass / stiffness))

    def stretch(self, w: Array, slope: Array) -> tuple[Array, float]:
        """How the logarithms of those sizes move along the path."""
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
        w, along = self.setting_path.setting(float(z[-1])), self.setting_path.slope(float(z[-1]))
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


def _solve(walk: _Walk, z: Array, before: Array) -> _BranchPoint | None:
    """The point of the branch nearest to z; None when the corrections do not shrink."""
    last = np.inf
    for i in range(CORRECTIONS):
        residual, slope, flow = walk.equations(z)
        size = float(np.max(np.abs(residual)))
        if not size < SHRINKING * last or not np.all(np.isfinite(slope)):
            return None
        if size < TOLERANCE:
            return _BranchPoint(z, flow, slope, _along(slope, before), i)
        step = np.linalg.lstsq(slope, -residual, rcond=None)[0]
        if np.max(np.abs(step)) > 1.0:
            return None
        last, z = size, z + step
    return None


def _orbit(map_: CycleMap, flow: Flow) -> Orbit | None:
    """The point as an orbit, None unless its slip comes to rest there for the first time, and stays at rest."""
    speeds = np.concatenate([part.x[:, SPEED] for part in flow.cycle.slides])[1:-1]
    first = bool(np.all(speeds > 0.0)) and flow.rate[SPEED] < 0.0 < flow.cycle.stick
    return orbit_of(map_, flow.cycle, flow.tangent) if first and map_.holds(flow.cycle) else None


def trace(map_: CycleMap, start: Orbit, setting_path: SettingPath, place: float, last: float) -> OrbitPath:
    """The branch from `start`, at coordinate `place` of the path, up to its end or to coordinate `last`."""
    orbits, places = [start], [place]
    walk = _Walk(map_, setting_path)
    first = walk.start(start, place)
    small = start.jump < LEAST * walk.scale(start.cycle.setting)[0][ELONGATION]
    here = None if start.cycle.turns or small else _solve(walk, first, np.eye(first.size)[-1])
    length, bend = min(LENGTH, 2.0 * (last - place)), np.zeros(first.size)
    for _ in range(POINTS):
        if here is None or length < SHORTEST:
            return OrbitPath(tuple(orbits), tuple(places), None, lost=True)
        new = _solve(walk, here.z + length * here.direction + 0.5 * length**2 * bend, here.direction)
        if new is None or new.direction @ here.direction < STRAIGHT:
            length *= 0.4
            continue
        if new.direction[-1] <= 0.0:
            end = _fold(walk, here, new)
            return OrbitPath(tuple(orbits), tuple(places), end, lost=end is None)
        orbit = _orbit(map_, new.flow)
        if orbit is None:
            length *= 0.4
            continue
        if orbit.jump < LEAST * walk.scale(orbit.cycle.setting)[0][ELONGATION]:
            return OrbitPath(tuple(orbits), tuple(places), None, lost=True)
        orbits, places = [*orbits, orbit], [*places, float(new.z[-1])]
        if places[-1] >= last:
            return OrbitPath(tuple(orbits), tuple(places), None)
        bend = (new.direction - here.direction) / float(np.linalg.norm(new.z - here.z))
        here, length, walk = new, _next_length(length, new, bend), walk.at(places[-1])
    return OrbitPath(tuple(orbits), tuple(places), None, lost=True)


def _next_length(length: float, here: _BranchPoint, bend: Array) -> float:
    """Arc length of the next step: longer where few corrections were needed, and not far beyond the coming fold."""
    length = min(WIDEST, length * (2.0 if here.corrections <= 2 else 1.0))
    turn = float(np.linalg.norm(bend))
    return min(length, TURN / turn) if turn > 0.0 else length


def _doubt(before: _BranchPoint, behind: _BranchPoint) -> float:
    """What the branch may still rise, of its coordinate, above the better of two points around its fold."""
    flattest = min(abs(float(before.direction[-1])), abs(float(behind.direction[-1])))
    return flattest * float(np.linalg.norm(behind.z - before.z))


def _crest(before: _BranchPoint, behind: _BranchPoint) -> Array:
    """Where the cubic through two points around the fold, along their directions, has its highest coordinate."""
    span = behind.z - before.z
    length = float(np.linalg.norm(span))
    start, end = length * before.direction, length * behind.direction
    square, cube = 3.0 * span - 2.0 * start - end, start + end - 2.0 * span
    # Where the slope start + 2 square s + 3 cube s^2 of the coordinate falls through zero.
    root = np.sqrt(max(float(square[-1] ** 2 - 3.0 * cube[-1] * start[-1]), 0.0))
    share = float(np.clip(start[-1] / (root - square[-1]), 0.02, 0.98)) if root > square[-1] else 0.5
    return np.asarray(before.z + start * share + square * share**2 + cube * share**3)


def _fold(walk: _Walk, before: _BranchPoint, behind: _BranchPoint) -> Crossing | None:
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
    return Crossing(float(crest[-1]), np.linalg.lstsq(slope, -by_setting, rcond=None)[0][-1])


# ----------------------------------------------------------------------------------------------------------------------
# Following the stick-slip orbit along a path - over drive speed, or any other quantity - up to where it ends.
# ----------------------------------------------------------------------------------------------------------------------

FINEST = 4e-4  # step of the coordinate at which an end that is no fold counts as found
BRANCH_WIDEST = 2.0


def advance(map_: CycleMap, done: OrbitPath, setting_path: SettingPath, last: float) -> OrbitPath:
    """Orbits up to the end of this piece of branch by shorter and shorter steps, and that end."""
    orbits, places = list(done.orbits), list(done.places)
    step, failed = 0.5, float("inf")
    while step > FINEST:
        if places[-1] >= last:
            return OrbitPath(tuple(orbits), tuple(places), None)
        place = min(places[-1] + step, last)
        w = setting_path.setting(place)
        there, speed = map_.at(w), float(w[-1])
        scale = map_.at(orbits[-1].cycle.setting).scale
        orbit = close(there, expected(orbits[-1], scale, there, w), speed, patience=patience(there, speed))
        if orbit is None:
            failed, step = min(failed, place), 0.35 * step
            continue
        orbits, places = [*orbits, orbit], [*places, place]
        failed = failed if failed > place else float("inf")
        step = min(1.6 * step, BRANCH_WIDEST) if np.isinf(failed) else min(1.6 * step, 0.5 * (failed - place))
    end = 0.5 * (places[-1] + min(failed, places[-1] + FINEST))
    slopes = _slopes_at(map_.at(orbits[-1].cycle.setting), orbits[-1], setting_path, places[-1])
    return OrbitPath(tuple(orbits), tuple(places), Crossing(end, slopes))


def expected(here: Orbit, scale: Array, there: CycleMap, w: Array) -> Array:
    """Rest state of an orbit at another setting w (n_w,), by its derivative, not far.

    Args:
        scale: typical rest state where the orbit is, as that of the map `there` is where it is sought.

    In units of those scales, because a spring twice as stiff stretches half as far.
    """
    move = along(scale, here.tangent, here.jacobian) @ (w - here.cycle.setting)
    stretch = here.y * np.log(there.scale / scale)
    move = (move - stretch) / scale
    return np.asarray((here.y / scale + move * min(1.0, 0.3 / max(float(np.max(np.abs(move))), 1e-300))) * there.scale)


def moved_orbit(near: Orbit, map_: CycleMap, drive_speed: float, wait: float) -> Orbit | None:
    """The stable orbit at a drive speed [m/s] of another map, sought where the derivatives of one expect it."""
    w = near.cycle.setting
    scale = CycleMap.of(map_.model, w).scale
    orbit = close(map_, expected(near, scale, map_, map_.setting(drive_speed)), drive_speed, patience=wait)
    return orbit if orbit is not None and orbit.stable else None


def along(scale: Array, tangent: Tangent, jacobian: Array) -> Array:
    """How the rest state of an orbit, of typical size `scale`, moves with its setting while it stays an orbit:
    shape (n_y, n_w)."""
    n = scale.size
    sizes = scale[:, None]
    return np.asarray(np.linalg.lstsq(np.eye(n) - jacobian, tangent.end[:, n:] / sizes, rcond=None)[0] * sizes)


def _slopes_at(map_: CycleMap, orbit: Orbit, setting_path: SettingPath, place: float) -> Array:
    """Derivatives of the end (n_w,) from an orbit just before it: there the drop goes like the square root of what
    is left, so that the place at which it has a given value moves as the end does."""
    n, tangent = map_.scale.size, orbit.tangent
    drop = tangent.onset_load - tangent.arrest_load
    slopes = drop[n:] + drop[:n] @ along(map_.scale, tangent, orbit.jacobian)
    with np.errstate(all="ignore"):
        return np.asarray(-slopes / (slopes @ setting_path.slope(place)))


def follow(map_: CycleMap, start: Orbit, setting_path: SettingPath, place: float, last: float) -> OrbitPath:
    """The branch from `start`, at coordinate `place` of the path, up to its end or to coordinate `last`: by arc length
    through a fold, and where that loses it by shorter and shorter steps."""
    found = trace(map_, start, setting_path, place, last)
    return advance(map_, found, setting_path, last) if found.lost else found
