"""Following the stick-slip orbit along a course - over drive speed, or any other quantity - up to where it ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.prediction.course import Course
from identify.prediction.cycle import CycleMap, Tangent
from identify.prediction.orbit import Orbit, close
from identify.prediction.trace import End, trace

Array = NDArray[np.float64]
Patience = Callable[[CycleMap, float], float]  # by map and drive speed [m/s], see `CycleMap.run`

FINEST = 4e-4  # step of the coordinate at which an end that is no fold counts as found
WIDEST = 2.0


@dataclass(frozen=True)
class Followed:
    """Orbits along a course, at rising coordinates `places`, and the end of the branch; None where there is none up to
    the last coordinate asked for."""

    orbits: tuple[Orbit, ...]
    places: tuple[float, ...]
    ending: End | None


def advance(map_: CycleMap, done: Followed, course: Course, last: float, patience: Patience) -> Followed:
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


def moved_orbit(near: Orbit, map_: CycleMap, drive_speed: float, patience: float) -> Orbit | None:
    """The stable orbit at a drive speed [m/s] of another map, sought where the derivatives of one expect it."""
    w = near.cycle.setting
    scale = CycleMap(map_.model, float(w[-2]), w[:-2]).scale
    orbit = close(map_, expected(near, scale, map_, map_.setting(drive_speed)), drive_speed, patience=patience)
    return orbit if orbit is not None and orbit.stable else None


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


def piece(map_: CycleMap, done: Followed, course: Course, last: float, patience: Patience) -> Followed:
    """What was followed, and the branch of its last orbit up to where that ends, or up to coordinate `last`."""
    found = trace(map_.at(course.setting(done.places[-1])), done.orbits[-1], course, done.places[-1], last)
    done = Followed((*done.orbits, *found.orbits[1:]), (*done.places, *found.places[1:]), found.end)
    return advance(map_, done, course, last, patience) if found.lost else done
