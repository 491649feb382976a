"""What happens at operating points, from the composed nonlinear model: stick-slip, steady sliding, or both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identify.prediction.cycle import CycleMap
from identify.prediction.orbit import Orbit, SettledMotion, close, long_enough, settle
from identify.prediction.path import expected
from identify.prediction.windows import (
    Outcome,
    Windows,
    outcome_of,
    speed_windows,
)
from identify.simulation.sliding import Sliding, slidings

ALIKE = 1.03  # ratio of normal forces up to which the same windows, their ends moved by derivatives, serve both


@dataclass(frozen=True)
class SolutionSet:
    """The answer of the nonlinear model at one drive speed [m/s].

    orbit: periodic stick-slip there, None without one; steady: steady sliding there; windows: what happens at every
    other drive speed, the same whatever speed is asked for.
    """

    outcome: Outcome
    orbit: Orbit | None
    steady: Sliding
    windows: Windows

    @property
    def end(self) -> float | None:
        """Drive speed above which there is no stick-slip [m/s]; None without stick-slip, or where it goes on."""
        return None if self.windows.end is None else self.windows.end.speed


def solution_set(map_: CycleMap, drive_speed: float) -> SolutionSet:
    """The answer at drive speed [m/s], positive, and at all others.

    Raises:
        SimulationError: the motion cannot be integrated, or there is no steady sliding.
    """
    return solution_sets([map_], [drive_speed])[0]


def solution_sets(maps: Sequence[CycleMap], drive_speeds: Sequence[float]) -> list[SolutionSet]:
    """The answers of one model at several drive speeds [m/s], positive, each under its own map.

    Where pair and rig are the same and the normal forces differ by a few percent at most, the windows of one serve
    all, their ends carried to the other forces by derivatives.

    Raises:
        SimulationError: the motion cannot be integrated, or there is no steady sliding.
    """
    steady = slidings(maps[0].model, np.stack([m.setting(v) for m, v in zip(maps, drive_speeds, strict=True)]))
    known: list[tuple[CycleMap, Windows]] = []
    out = []
    for map_, state in zip(maps, steady, strict=True):
        shared = next((windows.under(map_) for other, windows in known if _serves(other, windows, map_)), None)
        here, windows = _at(map_, state, shared)
        if shared is None:
            known.append((map_, windows))
        out.append(SolutionSet(outcome_of(here.orbit, here.sticks, state.stable), here.orbit, state, windows))
    return out


def _serves(other: CycleMap, windows: Windows, map_: CycleMap) -> bool:
    """Whether the windows of one map can be carried to another."""
    ratio = map_.normal_force / other.normal_force
    if not np.array_equal(map_.p, other.p) or not 1 / ALIKE <= ratio <= ALIKE:
        return False
    limits = [limit for part in windows.sticking for limit in (part.low, part.high) if limit is not None]
    return ratio == 1.0 or all(np.isfinite(limit.slopes[-2]) for limit in limits)


def _at(map_: CycleMap, steady: Sliding, shared: Windows | None) -> tuple[SettledMotion, Windows]:
    """What the motion at a drive speed settles on, and windows that agree with it.

    Where they do not (a window narrower than the grid, or a speed at its very edge), the windows are searched again
    with this drive speed as one of the nodes.
    """
    speed, wait = steady.drive_speed, long_enough(steady.growth * map_.half_period)
    windows = speed_windows(map_) if shared is None else shared
    low, high = windows.searched
    here = _settled(map_, speed, wait, windows)
    if here.sticks != windows.sticks(speed) or not low <= speed <= high:
        windows = speed_windows(map_, (speed,))
        here = _settled(map_, speed, wait, windows)
    return here, windows


def _settled(map_: CycleMap, speed: float, wait: float, windows: Windows) -> SettledMotion:
    """What the motion settles on from a rested contact, else from the nearest stick-slip of the windows."""
    here = settle(map_, speed, patience=wait)
    near = windows.near(speed)
    if here.sticks or near is None:
        return here
    state, orbit = near
    if orbit is not None:
        there = close(map_, expected(orbit, map_.scale, map_, map_.setting(speed)), speed, patience=wait)
        if there is not None and there.stable:
            return SettledMotion(there, True, there.y)
    return settle(map_, speed, state, patience=wait)
