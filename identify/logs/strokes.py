"""Parts of a record that a tribologist tabulates apart: steps of the test, strokes and speeds of the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import thinned
from data_io.drive import SAME
from data_io.quality import pauses
from identify.logs.noise import bridged, smooth, white_noise

Array = NDArray[np.float64]
DriveCourse = float | Sequence[tuple[float, float]] | Array | None

FEWEST = 20  # samples in which a change of sign is looked for
LEAST_SHARE = 0.1  # of the samples: a sign of the force that holds for fewer is no stroke of its own
CLEAR = 0.3  # of the typical force: what counts as a sign
ALIKE = 1.5  # times: strokes rub to both sides by about as much; a force that swings through zero does not
FEW, ALIKE_FEW = 8, 3.0  # changes of sign up to which no oscillation makes them, and strokes may differ by running-in
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


def strokes(record: Record, drive: DriveCourse) -> tuple[Stroke, ...]:
    """The strokes of every step of a record.

    Args:
        record: the log; without steps it is one step.
        drive: [m/s], a programme ((start [s], speed), ...), one value per row, or None where unknown. A drive
            that changes its speed by a programme, or its sign, begins a new stroke, and standstill is none; without
            it a lasting change of the sign of the force does. A pause of the recording ends a stroke.
    """
    steps = [(s.run, s.number, s.start, s.stop) for s in record.steps] or [(1, 1, 0, record.time.size)]
    speed = _per_row(record, drive)
    out = []
    for run, step, start, stop in steps:
        if stop <= start:
            continue
        force = record.friction_force[start:stop]
        edges = []
        for first, last in pairwise([0, *(pauses(record.time[start:stop], force) + 1).tolist(), stop - start]):
            own = None if speed is None else speed[start + first : start + last]
            edges += [(start + first + a, start + first + b, way) for a, b, way in _edges(force[first:last], own)]
        moving = [rows for rows in edges if speed is None or np.any(speed[rows[0] : rows[1]])]
        for number, (first, last, way) in enumerate(moving or edges, start=1):
            negative = np.count_nonzero(record.friction_force[first:last] < 0)  # about zero: as in the file
            finite = np.count_nonzero(np.isfinite(record.friction_force[first:last]))
            direction = way or (-1 if negative > LEVEL_SHARE * finite else 1)
            size = abs(float(drive)) if isinstance(drive, int | float) else 0.0
            constant = _constant(speed[first:last]) if speed is not None else size if 0.0 < size < np.inf else None
            out.append(Stroke(run, step, number, first, last, direction, constant))
    return tuple(out)


def _per_row(record: Record, drive: DriveCourse) -> Array | None:
    """One speed per row [m/s], None where it is one number or unknown."""
    if drive is None or isinstance(drive, int | float):
        return None
    table = np.asarray(drive, dtype=np.float64)
    if table.ndim == 2:
        return np.asarray(table[np.clip(np.searchsorted(table[:, 0], record.time, side="right") - 1, 0, None), 1])
    if table.shape != record.time.shape:
        raise ValueError(f"drive speed has {table.size} values, the record {record.time.size} rows")
    return table


def _edges(force: Array, speed: Array | None) -> list[tuple[int, int, int]]:
    """First row, end and direction of every stroke; direction 0 where the force of the whole stroke has to tell it."""
    if speed is not None and np.unique(speed[np.isfinite(speed)]).size > 1:
        key = speed if np.unique(speed).size <= 20 else np.sign(speed)
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
    up, down = (side[side > CLEAR * typical] for side in (filled, -filled))
    if min(up.size, down.size) < LEAST_SHARE * filled.size:
        return whole
    # averaged until the noise is a tenth of the force
    slow = smooth(filled, int(np.clip((white_noise(filled) / (0.1 * typical)) ** 2, 1, max(force.size // 20, 1))) | 1)
    decided = np.flatnonzero(np.abs(slow) > CLEAR * typical)
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
    edges = list(pairwise([*starts, force.size]))
    sizes = [np.abs(slow[a:b]) for a, b in edges if b > a]
    if sum(np.count_nonzero(size > 0.5 * np.quantile(size, 0.9)) for size in sizes) < LEVEL_SHARE * force.size:
        return whole  # a force that crosses zero on its way up and down rubs at no level to either side
    ways = [int(sign[0]), *(int(sign[i + 1]) for i in changes)]
    return [(a, b, way) for (a, b), way in zip(edges, ways, strict=True) if b > a]


def _constant(speed: Array) -> float | None:
    middle = float(np.median(np.abs(speed)))
    if not np.isfinite(middle) or middle == 0.0:
        return None
    return middle if float(np.mean(np.abs(np.abs(speed) - middle) > STEADY * middle)) < LEAST_SHARE else None


def one_speed(speeds: Sequence[float] | Array) -> bool:
    """Whether speeds (n,) [m/s] that are not zero have one size."""
    sizes = np.abs(np.asarray(speeds, dtype=np.float64))
    return not sizes.size or bool(sizes.max() - sizes.min() <= SAME * sizes.max())


def changes_speed(drive: DriveCourse) -> bool:
    """Whether a drive has several speeds, or stands between moving one way."""
    if drive is None or isinstance(drive, int | float):
        return False
    table = np.asarray(drive, dtype=np.float64)
    speeds = table[:, 1] if table.ndim == 2 else table[np.append(True, table[1:] != table[:-1])]
    speeds = np.trim_zeros(speeds[np.isfinite(speeds)])  # what it rests before and after is no change
    if not speeds.size or (speeds.size > 0.1 * np.size(drive) and table.ndim == 1):
        return False  # noise of a column is no programme
    return not one_speed(speeds[speeds != 0.0]) or (
        bool(np.any(speeds == 0.0)) and not speeds.min() < 0.0 < speeds.max()
    )
