"""Whether a column moves along the friction: only such a one is the drive; others are carriages, radii or wear.

Three things tell it: the velocity that the head of the log states, strokes in which the friction changes its sign as
the column turns, and sticks that load in proportion to its speed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.derived_columns import StatedVelocity, stated_velocity
from data_io.speed_steps import steps_of
from identify.base.wording import speed_text
from identify.logs.segment import segment
from identify.logs.strokes import turns_of_sign

Array = NDArray[np.float64]

AGREES = 0.1  # share by which a column and a stated velocity may differ
MOVES = 0.05  # of its usual speed: slower, a drive stands
TURNS = 0.8  # share of the strokes in which a column goes the way that the friction tells
PROPORTIONAL = 0.2  # share by which the stiffness that sticks tell may differ from speed to speed
FEWEST = 20  # rows of a stretch of one speed


@dataclass(frozen=True)
class Along:
    """is_drive: whether a column moves along the friction, None where nothing tells; because: in words, to follow the
    name of the column or "since"."""

    is_drive: bool | None
    because: str


def column_speed(record: Record, name: str) -> Array:
    """The speed that a column means, row by row (n,) [m/s], signed."""
    values = record.channels[name]
    if record.channel_units[name] == "m/s":
        return values
    reach = max(len(record) // 1000, 2)
    index = np.arange(len(record))
    low, high = np.maximum(index - reach, 0), np.minimum(index + reach, len(record) - 1)
    return np.asarray((values[high] - values[low]) / (record.time[high] - record.time[low]))


def moves_along(record: Record, name: str, stiffness: float = 0.0) -> Along:
    """Hold a column in m or m/s, without gaps, against what tells the motion along the friction.

    Args:
        stiffness: of the rig [N/m], 0 where it is not known.
    """
    speed = column_speed(record, name)
    size = np.abs(speed)
    moving = size > MOVES * float(np.quantile(size, 0.9))
    usual = float(np.median(size[moving])) if moving.any() else 0.0
    stated = velocity_in_head(record)
    if stated is not None:
        meant = (*stated.speeds.values(), 1e-3 * abs(stated.value))  # a column shows it where the head is in mm/s
        if any(abs(usual / own - 1.0) < AGREES for own in meant):
            return Along(True, "moves as fast as the head of the log says")
        return Along(False, f"it moves at {speed_text(usual)}, not as fast as the head of the log says")
    turns = _turns_with_friction(record, speed)
    if turns is not None:
        words = "turns as the friction does" if turns else "it does not turn as the friction does"
        return Along(turns, words)
    loads = _loads_in_proportion(record, speed, stiffness)
    if loads is not None:
        return Along(loads, "is what the sticks load by" if loads else "the sticks do not load in proportion to it")
    return Along(None, "nothing in the log says that it moves along the friction")


def velocity_in_head(record: Record) -> StatedVelocity | None:
    """The velocity that the steps of a record state, where all state one."""
    told = [stated_velocity(step.parameters, record.metadata, record.channel_units) for step in record.steps]
    moving = [own for own in told if own is not None]  # a step that states 0 stands
    return moving[0] if len({own.value for own in moving}) == 1 else None


def velocity_text(stated: StatedVelocity) -> str:
    """A stated velocity and what it would mean, in words."""
    meant = {"linear": "mm/min", "rotary": "rpm"}
    known = {module: own for module, own in stated.speeds.items() if stated.module in (None, module)} or stated.speeds
    words = " or ".join(f"{speed_text(own)} if in {meant[module]}" for module, own in known.items())
    return f"Velocity = {stated.value:g} without a unit: {words}"


def _turns_with_friction(record: Record, speed: Array) -> bool | None:
    """Whether a column turns where the friction changes its sign; None where that does not."""
    agree = count = 0
    for step in record.steps:
        strokes = turns_of_sign(record.friction_force[step.start : step.stop])
        if len(strokes) < 2:
            continue
        ways = []
        for first, stop, way in strokes:
            own = speed[step.start + first : step.start + stop]
            ways.append(way * int(np.sign(np.sum(own))))
        agree, count = agree + abs(sum(ways)), count + len(ways)
    return None if not count else agree >= TURNS * count


def _loads_in_proportion(record: Record, speed: Array, stiffness: float) -> bool | None:
    """Whether sticks load in proportion to the speed of a column, or at a known stiffness times it; None where it has
    one speed and the stiffness is not known, or nothing sticks."""
    programme = steps_of(record.time, speed).programme
    if programme is None or len({abs(own) for _, own in programme if own}) < (1 if stiffness else 2):
        return None
    edges = [*np.searchsorted(record.time, [start for start, _ in programme]).tolist(), len(record)]
    told = [stiffness] if stiffness else []
    for first, stop, own in zip(edges, edges[1:], [abs(own) for _, own in programme], strict=False):
        if own and stop - first >= FEWEST:
            force = record.friction_force[first:stop]
            found = segment(record.time[first:stop], force * (np.sign(np.nanmedian(force)) or 1.0))
            if found.count and found.stick_slopes.size:
                told.append(float(np.median(found.stick_slopes)) / own)
    if len(told) < 2:
        return None
    return bool(np.std(told) < PROPORTIONAL * abs(np.mean(told)))
