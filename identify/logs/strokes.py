"""Parts of a record that a tribologist tabulates apart: steps of the test, strokes and speeds of the drive."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import thinned
from data_io.derived_columns import StatedVelocity, stated_velocity
from data_io.quality import pauses
from data_io.speed_steps import steps_of
from identify.base.wording import speed_text
from identify.logs.noise import bridged, white_noise
from identify.logs.segment import segment
from identify.logs.zigzag import smooth

Array = NDArray[np.float64]
Drive = float | Sequence[tuple[float, float]] | Array | None

FEWEST = 20  # samples in which a change of sign is looked for
LEAST_SHARE = 0.1  # of the samples: a sign of the force that holds for fewer is no stroke of its own
CLEAR = 0.3  # of the typical force: what counts as a sign
ALIKE = 1.5  # times: strokes rub to both sides by about as much; a force that swings through zero does not
FEW, ALIKE_FEW = 8, 3.0  # changes of sign up to which no oscillation makes them, and strokes may differ by running-in
QUIET = 0.1  # of the typical force: noise that is left where signs are told
WIDEST = 20  # part of a record over which it is smoothed at most
LEVEL_SHARE = 0.65  # of the rows of strokes, in which the force is more than half of the highest of its stroke
HELD = 0.8  # of the level of a stroke, that its force has until the drive turns
STEADY = 0.05  # of the median speed: a drive that varies more has no one speed


@dataclass(frozen=True)
class Stroke:
    """Rows [start, stop) of one step in which the drive goes one way; direction is +1 or -1 in the file's sign of
    the friction force; speed [m/s] > 0, None where it is unknown or not constant."""

    run: int
    step: int
    number: int
    start: int
    stop: int
    direction: int
    speed: float | None


def strokes(record: Record, drive_speed: Drive) -> tuple[Stroke, ...]:
    """The strokes of every step of a record.

    Args:
        record: the log; without steps it is one step.
        drive_speed: [m/s], a programme ((start [s], speed), ...), one value per row, or None where unknown. A drive
            that changes its speed by a programme, or its sign, begins a new stroke, and standstill is none; without
            it a lasting change of the sign of the force does.
    """
    steps = [(s.run, s.number, s.start, s.stop) for s in record.steps] or [(1, 1, 0, record.time.size)]
    speed = _per_row(record, drive_speed)
    found = []
    for run, step, start, stop in steps:
        if stop <= start:
            continue
        edges = _between_pauses(record, None if speed is None else speed[start:stop], start, stop)
        moving = [rows for rows in edges if speed is None or np.any(speed[start + rows[0] : start + rows[1]])]
        for number, (first, last, way) in enumerate(moving or edges, start=1):
            rows = slice(start + first, start + last)
            direction = way or _direction(record.friction_force[rows])
            constant = _one(drive_speed) if speed is None else _constant(speed[rows])
            found.append(Stroke(run, step, number, rows.start, rows.stop, direction, constant))
    return tuple(found)


def _between_pauses(record: Record, speed: Array | None, start: int, stop: int) -> list[tuple[int, int, int]]:
    """First row, end and direction of every stroke of a step, counted from its first row; a pause of the recording ends
    one."""
    force = record.friction_force[start:stop]
    ends = pauses(record.time[start:stop], force)
    found = []
    for first, last in pairwise([0, *(ends + 1).tolist(), stop - start]):
        own = None if speed is None else speed[first:last]
        found += [(first + a, first + b, way) for a, b, way in _edges(force[first:last], own)]
    return found


def _one(drive_speed: Drive) -> float | None:
    """The size of a speed that is one number, None where there is none."""
    size = abs(float(drive_speed)) if isinstance(drive_speed, int | float) else 0.0
    return size if 0.0 < size < np.inf else None


def _per_row(record: Record, drive_speed: Drive) -> Array | None:
    """One speed per row [m/s], None where it is one number or unknown."""
    if drive_speed is None or isinstance(drive_speed, int | float):
        return None
    table = np.asarray(drive_speed, dtype=np.float64)
    if table.ndim == 2:
        piece = np.clip(np.searchsorted(table[:, 0], record.time, side="right") - 1, 0, None)
        values: Array = table[piece, 1]
        return values
    if table.shape != record.time.shape:
        raise ValueError(f"drive speed has {table.size} values, the record {record.time.size} rows")
    return table


def _edges(force: Array, speed: Array | None) -> list[tuple[int, int, int]]:
    """First row, end and direction of every stroke; direction 0 where the force of the whole stroke has to tell it."""
    if speed is not None and np.unique(speed[np.isfinite(speed)]).size > 1:
        levels = np.unique(speed)
        key = speed if levels.size <= 20 else np.sign(speed)
        changes = (np.flatnonzero(key[1:] != key[:-1]) + 1).tolist()
        return [(a, b, 0) for a, b in pairwise([0, *changes, force.size])]
    return turns_of_sign(force)


def turns_of_sign(force: Array) -> list[tuple[int, int, int]]:
    """First row, end and sign of every stretch in which a force (n,) keeps its sign, cut where it leaves its level.

    A force that changes its sign and rubs to both sides by about as much is that of a drive to and fro. How much it is
    smoothed goes by its noise, never by the length of the record. One stretch of sign 0 where it keeps its sign.
    """
    whole = [(0, force.size, 0)]
    finite = np.isfinite(force)
    if np.count_nonzero(finite) < FEWEST:
        return whole
    filled = bridged(force, ~finite)
    typical = float(np.quantile(np.abs(thinned(filled)), 0.9))
    clear = CLEAR * typical
    up, down = (side[side > clear] for side in (filled, -filled))
    if min(up.size, down.size) < LEAST_SHARE * filled.size:
        return whole
    width = int(np.clip((white_noise(filled) / (QUIET * typical)) ** 2, 1, max(force.size // WIDEST, 1))) | 1
    slow = smooth(filled, width)
    decided = np.flatnonzero(np.abs(slow) > clear)
    sign = np.sign(slow[decided]).astype(int)
    changes = np.flatnonzero(sign[1:] != sign[:-1])
    ratio, alike = float(np.median(up)) / float(np.median(down)), ALIKE if changes.size > FEW else ALIKE_FEW
    if not changes.size or not 1.0 / alike < ratio < alike:
        return whole
    starts = [0]
    for i in changes.tolist():
        last, way = int(decided[i]), sign[i]
        own = way * slow[(starts[-1] + last) // 2 : last + 1]
        held = np.flatnonzero(own >= HELD * float(np.median(own)))
        starts.append(last + 1 - own.size + int(held[-1]) + 1 if held.size else last + 1)
    sizes = [np.abs(slow[a:b]) for a, b in pairwise([*starts, force.size]) if b > a]
    if sum(np.count_nonzero(size > 0.5 * np.quantile(size, 0.9)) for size in sizes) < LEVEL_SHARE * force.size:
        return whole  # a force that crosses zero on its way up and down rubs at no level to either side
    ways = [int(sign[0]), *(int(sign[i + 1]) for i in changes)]
    return [(a, b, way) for (a, b), way in zip(pairwise([*starts, force.size]), ways, strict=True) if b > a]


def _direction(force: Array) -> int:
    negative = np.count_nonzero(force < 0)  # most of them: the median is negative, which takes longer to find
    return -1 if negative > LEVEL_SHARE * np.count_nonzero(np.isfinite(force)) else 1  # about zero: as in the file


def _constant(speed: Array) -> float | None:
    middle = float(np.median(np.abs(speed)))
    if not np.isfinite(middle) or middle == 0.0:
        return None
    return middle if float(np.mean(np.abs(np.abs(speed) - middle) > STEADY * middle)) < LEAST_SHARE else None


# Whether a column moves along the friction: only such a one is the drive; others are carriages, radii or wear.
#
# Three things tell it: the velocity that the head of the log states, strokes in which the friction changes its sign as
# the column turns, and sticks that load in proportion to its speed.

AGREES = 0.1  # share by which a column and a stated velocity may differ
MOVES = 0.05  # of its usual speed: slower, a drive stands
TURNS = 0.8  # share of the strokes in which a column goes the way that the friction tells
PROPORTIONAL = 0.2  # share by which the stiffness that sticks tell may differ from speed to speed


@dataclass(frozen=True)
class ColumnDirection:
    """is_drive: whether a column moves along the friction, None where nothing tells; because: in words, to follow the
    name of the column or "since"."""

    is_drive: bool | None
    because: str


def column_speed(record: Record, name: str, wider: int = 1) -> Array:
    """The speed that a column means, row by row (n,) [m/s], signed; of a position over so many times the usual rows."""
    values = record.channels[name]
    if record.channel_units[name] == "m/s":
        return values
    reach = wider * max(len(record) // 1000, 2)
    index = np.arange(len(record))
    low, high = np.maximum(index - reach, 0), np.minimum(index + reach, len(record) - 1)
    return np.asarray((values[high] - values[low]) / (record.time[high] - record.time[low]))


def _usual(speed: Array) -> float:
    """Median size [m/s] of a speed where it moves, 0 where it stands."""
    size = np.abs(speed)
    moving = size > MOVES * float(np.quantile(size, 0.9))
    return float(np.median(size[moving])) if moving.any() else 0.0


def moves_along(record: Record, name: str, stiffness: float = 0.0) -> ColumnDirection:
    """Hold a column in m or m/s, without gaps, against what tells the motion along the friction.

    Args:
        stiffness: of the rig [N/m], 0 where it is not known.
    """
    speed = column_speed(record, name)
    stated = velocity_in_head(record)
    if stated is not None:
        meant = (*stated.speeds.values(), 1e-3 * abs(stated.value))  # a column shows it where the head is in mm/s
        # A speed is the same over twice as many rows; the differences of noise are half as fast.
        usual = [_usual(own) for own in (speed, column_speed(record, name, 2))]
        if any(all(abs(one / own - 1.0) < AGREES for one in usual) for own in meant):
            return ColumnDirection(True, "moves as fast as the head of the log says")
        return ColumnDirection(False, f"it moves at {speed_text(usual[1])}, not as fast as the head of the log says")
    turns = _turns_with_friction(record, speed)
    if turns is not None:
        words = "turns as the friction does" if turns else "it does not turn as the friction does"
        return ColumnDirection(turns, words)
    loads = _loads_in_proportion(record, speed, stiffness)
    if loads is not None:
        return ColumnDirection(
            loads, "is what the sticks load by" if loads else "the sticks do not load in proportion to it"
        )
    return ColumnDirection(None, "nothing in the log says that it moves along the friction")


def velocity_in_head(record: Record) -> StatedVelocity | None:
    """The velocity that the steps of a record state, where all state one."""
    told = [stated_velocity(step.parameters, record.metadata, record.channel_units) for step in record.steps]
    moving = [own for own in told if own is not None]  # a step that states 0 stands
    return moving[0] if len({own.value for own in moving}) == 1 else None


def rests_by_head(record: Record) -> bool:
    """Whether the head of every step of a record states a velocity of 0."""
    stated = [str(step.parameters.get("Velocity", "")).strip() for step in record.steps]
    return bool(stated) and all(re.fullmatch(r"[+-]?0+(\.0*)?", text) for text in stated)


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
