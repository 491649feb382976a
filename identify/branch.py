"""Following the stick-slip orbit over drive speed, up to where it ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.cycle import CycleMap
from identify.orbit import Orbit, close, settle

Array = NDArray[np.float64]

FINEST = 4e-4  # logarithmic step at which the end counts as found
WIDEST = 2.0
JUMPS = 4  # other orbits looked for beyond an end, before it is believed


@dataclass(frozen=True)
class Branch:
    """Orbits at rising drive speeds, and the speed [m/s] above which there is none.

    `end` is None when the orbit still exists at the highest speed tried, `highest`.
    """

    orbits: tuple[Orbit, ...]
    end: float | None
    highest: float

    def nearest(self, drive_speed: float) -> Orbit:
        """The orbit whose speed is nearest, by ratio."""
        return min(self.orbits, key=lambda o: abs(np.log(o.drive_speed / drive_speed)))


def _expected(orbits: list[Orbit], drive_speed: float) -> Array:
    """Rest state to start from: the straight line through the last two orbits, over ln speed, not far."""
    last = orbits[-1]
    if len(orbits) < 2:
        return last.y
    before = orbits[-2]
    span = np.log(last.drive_speed / before.drive_speed)
    ahead = min(np.log(drive_speed / last.drive_speed) / span, 1.0)
    return np.asarray(last.y + ahead * (last.y - before.y))


def _advance(
    map_: CycleMap, orbits: list[Orbit], highest: float, patience: Callable[[float], float]
) -> tuple[list[Orbit], float | None]:
    """Orbits up to the end of this piece of branch, and the speed of that end (None: beyond `highest`)."""
    step, failed = 1.0, float("inf")
    while step > FINEST:
        here = orbits[-1]
        if here.drive_speed >= highest:
            return orbits, None
        speed = min(here.drive_speed * float(np.exp(step)), highest)
        y = _expected(orbits, speed)
        orbit = close(map_, y, speed, here.jacobian, patience=patience(speed), exact=False)
        if orbit is None:
            failed, step = min(failed, speed), 0.35 * step
            continue
        orbits = [*orbits, orbit]
        failed = failed if failed > speed else float("inf")
        step = min(1.6 * step, WIDEST) if np.isinf(failed) else min(1.6 * step, 0.5 * float(np.log(failed / speed)))
    return orbits, float(np.sqrt(orbits[-1].drive_speed * min(failed, orbits[-1].drive_speed * np.exp(FINEST))))


def reach(map_: CycleMap, start: Orbit, drive_speed: float, patience: Callable[[float], float]) -> Orbit | None:
    """The orbit at a faster drive speed [m/s] on the branch of `start`; None where the branch ends before."""
    orbits, end = _advance(map_, [start], drive_speed, patience)
    return orbits[-1] if end is None else None


def follow(map_: CycleMap, start: Orbit, highest: float, patience: Callable[[float], float]) -> Branch:
    """The branch of orbits from `start` towards faster drives.

    Beyond an end the motion from the last orbit, and the one from a rested contact, are looked at: where
    they settle on an orbit again, the branch goes on from there.

    Args:
        highest: drive speed at which the search stops [m/s].
        patience: by drive speed, see `CycleMap.run`.
    """
    orbits: list[Orbit] = [start]
    end: float | None = None
    for _ in range(JUMPS):
        orbits, end = _advance(map_, orbits, highest, patience)
        if end is None:
            break
        tries = [(end * 1.05, orbits[-1].y), (end * 1.1, None)]
        found = (settle(map_, v, y, patience=patience(v), cycles=6).orbit for v, y in tries if v < highest)
        beyond = next((o for o in found if o is not None), None)
        if beyond is None:
            break
        orbits = [*orbits, beyond]
    return Branch(tuple(orbits), end, highest)
