"""Following the stick-slip orbit over drive speed, up to where it ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.cycle import CycleMap, Tangent
from identify.orbit import Orbit, close, settle
from identify.trace import End, trace

Array = NDArray[np.float64]
Patience = Callable[[float], float]

FINEST = 4e-4  # logarithmic step at which an end that is no fold counts as found
WIDEST = 2.0
JUMPS = 4  # other orbits looked for beyond an end, before it is believed


@dataclass(frozen=True)
class Branch:
    """Orbits at rising drive speeds, and the end above which there is none.

    `ending` is None when the orbit still exists at the highest speed tried, `highest`. setting: of the first orbit.
    """

    orbits: tuple[Orbit, ...]
    ending: End | None
    highest: float

    @property
    def end(self) -> float | None:
        """Drive speed above which stick-slip ends [m/s]."""
        return None if self.ending is None else self.ending.speed

    @property
    def normal_force(self) -> float:
        """Normal force [N] for which the branch was followed."""
        return float(self.orbits[0].cycle.setting[-2])

    def under(self, normal_force: float) -> Branch:
        """The branch as it is under a normal force [N] close by: only its end is moved, by its derivative."""
        if self.ending is None or normal_force == self.normal_force:
            return self
        speed, slopes = self.ending.speed, self.ending.slopes
        power = float(slopes[-2]) * self.normal_force / speed
        moved = float((normal_force / self.normal_force) ** power)
        return Branch(self.orbits, End(speed * moved, slopes * moved), self.highest)


def _advance(map_: CycleMap, orbits: list[Orbit], highest: float, patience: Patience) -> tuple[list[Orbit], End | None]:
    """Orbits up to the end of this piece of branch by shorter and shorter steps, and that end."""
    step, failed = 0.5, float("inf")
    while step > FINEST:
        here = orbits[-1]
        if here.drive_speed >= highest:
            return orbits, None
        speed = min(here.drive_speed * float(np.exp(step)), highest)
        orbit = close(map_, _expected(map_, here, speed), speed, patience=patience(speed))
        if orbit is None:
            failed, step = min(failed, speed), 0.35 * step
            continue
        orbits = [*orbits, orbit]
        failed = failed if failed > speed else float("inf")
        step = min(1.6 * step, WIDEST) if np.isinf(failed) else min(1.6 * step, 0.5 * float(np.log(failed / speed)))
    last = orbits[-1]
    end = float(np.sqrt(last.drive_speed * min(failed, last.drive_speed * np.exp(FINEST))))
    return orbits, End(end, _slopes_at(map_, last))


def _expected(map_: CycleMap, here: Orbit, drive_speed: float) -> Array:
    """Rest state of the orbit at another drive speed, by its derivative, not far."""
    move = along(map_, here.tangent, here.jacobian)[:, -1] * (drive_speed - here.drive_speed) / map_.scale
    return np.asarray(here.y + move * min(1.0, 0.3 / max(float(np.max(np.abs(move))), 1e-300)) * map_.scale)


def along(map_: CycleMap, tangent: Tangent, jacobian: Array) -> Array:
    """How the rest state of an orbit moves with its setting while it stays an orbit: shape (n_y, columns)."""
    n = map_.scale.size
    scale = map_.scale[:, None]
    return np.asarray(np.linalg.lstsq(np.eye(n) - jacobian, tangent.end[:, n:] / scale, rcond=None)[0] * scale)


def _slopes_at(map_: CycleMap, orbit: Orbit) -> Array:
    """Derivatives of the end (n_w,) from an orbit just before it: there the drop goes like the square root of what
    is left, so that the speed at which it has a given value moves as the end does."""
    n, tangent = map_.scale.size, map_.tangent(orbit.cycle)
    drop = tangent.onset_load - tangent.arrest_load
    slopes = drop[n:] + drop[:n] @ along(map_, tangent, orbit.jacobian)
    with np.errstate(all="ignore"):
        return np.asarray(-slopes / slopes[-1])


def reach(map_: CycleMap, start: Orbit, drive_speed: float, patience: Patience) -> Orbit | None:
    """The orbit at a faster drive speed [m/s] on the branch of `start`; None where the branch ends before."""
    orbits, end = _advance(map_, [start], drive_speed, patience)
    return orbits[-1] if end is None else None


def follow(map_: CycleMap, start: Orbit, highest: float, patience: Patience) -> Branch:
    """The branch of orbits from `start` towards faster drives.

    Beyond an end the motion from the last orbit, and the one from a rested contact, are looked at: where
    they settle on an orbit again, the branch goes on from there.

    Args:
        highest: drive speed at which the search stops [m/s].
        patience: by drive speed, see `CycleMap.run`.
    """
    orbits: list[Orbit] = [start]
    end: End | None = None
    for _ in range(JUMPS):
        found = trace(map_, orbits[-1], highest)
        orbits, end = [*orbits, *found.orbits[1:]], found.end
        if found.lost:
            orbits, end = _advance(map_, orbits, highest, patience)
        if end is None:
            break
        tries = [(end.speed * 1.05, orbits[-1].y), (end.speed * 1.1, None)]
        settled = (settle(map_, v, y, patience=patience(v), cycles=6).orbit for v, y in tries if v < highest)
        beyond = next((o for o in settled if o is not None), None)
        if beyond is None:
            break
        orbits = [*orbits, beyond]
    return Branch(tuple(orbits), end, highest)
