"""Following the stick-slip orbit along a course - over drive speed, or any other quantity - up to where it ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.prediction.course import Course, drive_course
from identify.prediction.cycle import CycleMap, Tangent
from identify.prediction.orbit import Orbit, close, settle
from identify.prediction.trace import End, trace

Array = NDArray[np.float64]
Patience = Callable[[CycleMap, float], float]  # by map and drive speed [m/s], see `CycleMap.run`

FINEST = 4e-4  # step of the coordinate at which an end that is no fold counts as found
WIDEST = 2.0
JUMPS = 4  # other orbits looked for beyond an end, before it is believed


@dataclass(frozen=True)
class Branch:
    """Orbits at rising drive speeds, and the end above which there is none.

    `ending` is None when the orbit still exists at the highest speed tried, `highest`; its place is the logarithm of
    the speed there. setting: of the first orbit.
    """

    orbits: tuple[Orbit, ...]
    ending: End | None
    highest: float

    @property
    def end(self) -> float | None:
        """Drive speed above which stick-slip ends [m/s]."""
        return None if self.ending is None else float(np.exp(self.ending.place))

    @property
    def end_slopes(self) -> Array | None:
        """Derivatives of that drive speed by parameters, normal force and drive speed (n_w,)."""
        return None if self.ending is None else np.exp(self.ending.place) * self.ending.slopes

    @property
    def normal_force(self) -> float:
        """Normal force [N] for which the branch was followed."""
        return float(self.orbits[0].cycle.setting[-2])

    def under(self, normal_force: float) -> Branch:
        """The branch as it is under a normal force [N] close by: only its end is moved, by its derivative."""
        if self.ending is None or normal_force == self.normal_force:
            return self
        power = float(self.ending.slopes[-2]) * self.normal_force
        moved = self.ending.place + power * float(np.log(normal_force / self.normal_force))
        return Branch(self.orbits, End(moved, self.ending.slopes), self.highest)


@dataclass(frozen=True)
class Followed:
    """Orbits along a course, at rising coordinates `places`, and the end of the branch; None where there is none up to
    the last coordinate asked for."""

    orbits: tuple[Orbit, ...]
    places: tuple[float, ...]
    ending: End | None


def _advance(map_: CycleMap, done: Followed, course: Course, last: float, patience: Patience) -> Followed:
    """Orbits up to the end of this piece of branch by shorter and shorter steps, and that end."""
    orbits, places = list(done.orbits), list(done.places)
    step, failed = 0.5, float("inf")
    while step > FINEST:
        if places[-1] >= last:
            return Followed(tuple(orbits), tuple(places), None)
        place = min(places[-1] + step, last)
        w = course.setting(place)
        there, speed = map_.at(w), float(w[-1])
        scale = map_.at(orbits[-1].cycle.setting).scale
        orbit = close(there, expected(orbits[-1], scale, there, w), speed, patience=patience(there, speed))
        if orbit is None:
            failed, step = min(failed, place), 0.35 * step
            continue
        orbits, places = [*orbits, orbit], [*places, place]
        failed = failed if failed > place else float("inf")
        step = min(1.6 * step, WIDEST) if np.isinf(failed) else min(1.6 * step, 0.5 * (failed - place))
    end = 0.5 * (places[-1] + min(failed, places[-1] + FINEST))
    slopes = _slopes_at(map_.at(orbits[-1].cycle.setting), orbits[-1], course, places[-1])
    return Followed(tuple(orbits), tuple(places), End(end, slopes))


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


def along(scale: Array, tangent: Tangent, jacobian: Array) -> Array:
    """How the rest state of an orbit, of typical size `scale`, moves with its setting while it stays an orbit:
    shape (n_y, n_w)."""
    n = scale.size
    sizes = scale[:, None]
    return np.asarray(np.linalg.lstsq(np.eye(n) - jacobian, tangent.end[:, n:] / sizes, rcond=None)[0] * sizes)


def _slopes_at(map_: CycleMap, orbit: Orbit, course: Course, place: float) -> Array:
    """Derivatives of the end (n_w,) from an orbit just before it: there the drop goes like the square root of what
    is left, so that the place at which it has a given value moves as the end does."""
    n, tangent = map_.scale.size, orbit.tangent
    drop = tangent.onset_load - tangent.arrest_load
    slopes = drop[n:] + drop[:n] @ along(map_.scale, tangent, orbit.jacobian)
    with np.errstate(all="ignore"):
        return np.asarray(-slopes / (slopes @ course.slope(place)))


def reach(map_: CycleMap, start: Orbit, drive_speed: float, patience: Patience) -> Orbit | None:
    """The orbit at a faster drive speed [m/s] on the branch of `start`; None where the branch ends before."""
    begun = Followed((start,), (float(np.log(start.drive_speed)),), None)
    course = drive_course(start.cycle.setting)
    found = _advance(map_, begun, course, float(np.log(drive_speed)), patience)
    return found.orbits[-1] if found.ending is None else None


def follow(map_: CycleMap, start: Orbit, highest: float, patience: Patience) -> Branch:
    """The branch of orbits from `start` towards faster drives, up to drive speed `highest` [m/s]."""
    course = drive_course(start.cycle.setting)
    found = follow_course(map_, start, course, float(np.log(start.drive_speed)), float(np.log(highest)), patience)
    return Branch(found.orbits, found.ending, highest)


def follow_course(
    map_: CycleMap, start: Orbit, course: Course, place: float, last: float, patience: Patience
) -> Followed:
    """The branch of orbits from `start`, at coordinate `place` of a course, up to coordinate `last`.

    Beyond an end the motion from the last orbit, and the one from a rested contact, are looked at: where
    they settle on an orbit again, the branch goes on from there.
    """
    done = Followed((start,), (place,), None)
    for _ in range(JUMPS):
        done = piece(map_, done, course, last, patience)
        beyond = None if done.ending is None else _beyond(map_, done, course, last, patience)
        if beyond is None:
            break
        done = Followed((*done.orbits, beyond[0]), (*done.places, beyond[1]), None)
    return done


def piece(map_: CycleMap, done: Followed, course: Course, last: float, patience: Patience) -> Followed:
    """What was followed, and the branch of its last orbit up to where that ends, or up to coordinate `last`."""
    found = trace(map_.at(course.setting(done.places[-1])), done.orbits[-1], course, done.places[-1], last)
    done = Followed((*done.orbits, *found.orbits[1:]), (*done.places, *found.places[1:]), found.end)
    return _advance(map_, done, course, last, patience) if found.lost else done


def _beyond(
    map_: CycleMap, done: Followed, course: Course, last: float, patience: Patience
) -> tuple[Orbit, float] | None:
    """An orbit just beyond the end, and its place."""
    end = last if done.ending is None else done.ending.place
    for place, y in ((end + 0.05, done.orbits[-1].y), (end + 0.1, None)):
        if place < last:
            w = course.setting(place)
            there, speed = map_.at(w), float(w[-1])
            stretched = None if y is None else y * there.scale / map_.at(done.orbits[-1].cycle.setting).scale
            orbit = settle(there, speed, stretched, patience=patience(there, speed), cycles=6).orbit
            if orbit is not None:
                return orbit, place
    return None
