"""Parts of a record that a tribologist tabulates apart: steps of the test, strokes and speeds of the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.thinned import thinned
from identify.logs.zigzag import smooth

Array = NDArray[np.float64]
Drive = float | Sequence[tuple[float, float]] | Array | None

LEAST_SHARE = 0.1  # of the samples: a sign of the force that holds for fewer is no stroke of its own
CLEAR = 0.3  # of the typical force: what counts as a sign
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
            that changes its speed by a programme, or its sign, begins a new stroke; without it a lasting change
            of the sign of the force does.
    """
    steps = [(s.run, s.number, s.start, s.stop) for s in record.steps] or [(1, 1, 0, record.time.size)]
    speed = _per_row(record, drive_speed)
    found = []
    for run, step, start, stop in steps:
        if stop <= start:
            continue
        edges = _edges(record.friction_force[start:stop], None if speed is None else speed[start:stop])
        for number, (first, last) in enumerate(pairwise(edges), start=1):
            rows = slice(start + first, start + last)
            direction = _direction(record.friction_force[rows])
            constant = _one(drive_speed) if speed is None else _constant(speed[rows])
            found.append(Stroke(run, step, number, rows.start, rows.stop, direction, constant))
    return tuple(found)


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


def _edges(force: Array, speed: Array | None) -> list[int]:
    """Where strokes begin and end, first 0 and last the number of rows."""
    if speed is not None and np.unique(speed[np.isfinite(speed)]).size > 1:
        levels = np.unique(speed)
        key = speed if levels.size <= 20 else np.sign(speed)
        changes = np.flatnonzero(key[1:] != key[:-1]) + 1
        return [0, *changes.tolist(), force.size]
    sign = _lasting_sign(force)
    return [0, *(np.flatnonzero(sign[1:] != sign[:-1]) + 1).tolist(), force.size]


def _lasting_sign(force: Array) -> NDArray[np.int64]:
    finite = np.isfinite(force)
    one = np.ones(force.size, dtype=np.int64)
    if np.count_nonzero(finite) < 20:
        return one
    filled = force if finite.all() else np.where(finite, force, np.median(force[finite]))
    clear = CLEAR * float(np.quantile(np.abs(thinned(filled)), 0.9))
    up, down = np.count_nonzero(filled > clear), np.count_nonzero(filled < -clear)
    if min(up, down) < LEAST_SHARE * filled.size:
        return one
    slow = smooth(filled, max(3, force.size // 100) | 1)
    decided = np.abs(slow) > clear
    if not decided.any():
        return one
    # an undecided sample has the sign of the last decided one, at the start of the first
    last = np.maximum.accumulate(np.where(decided, np.arange(force.size), 0))
    last[: int(np.argmax(decided))] = int(np.argmax(decided))
    return np.where(slow[last] >= 0, 1, -1)


def _direction(force: Array) -> int:
    negative = np.count_nonzero(force < 0)  # most of them: the median is negative, which takes longer to find
    return -1 if 2 * negative > np.count_nonzero(np.isfinite(force)) else 1


def _constant(speed: Array) -> float | None:
    middle = float(np.median(np.abs(speed)))
    if not np.isfinite(middle) or middle == 0.0:
        return None
    return middle if float(np.mean(np.abs(np.abs(speed) - middle) > STEADY * middle)) < LEAST_SHARE else None
