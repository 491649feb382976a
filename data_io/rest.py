"""Where a log shows the drive at rest: before it starts and after it has stopped, and what the sensor shows there."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from data_io.frozen import FloatArray
from data_io.record import Record
from data_io.thinned import kept, thinned, thinned_steps

FEWEST: Final = 20
"""Rows of a rest that is worth a word."""
_SLOW: Final = 0.05
"""Share of the usual speed of the drive below which it rests."""
_PORTION: Final = 1 << 14
"""Rows that are smoothed at once."""
_BAND: Final = 4.0
"""Standard deviations of the noise that a force at rest may span to either side."""
_LOW: Final = 0.5
"""Share of the sliding force below which a flat beginning is rest and not sliding."""
_LIVELY: Final = 5.0
_SWINGS: Final = 4
"""Sticks and slips that a force must have shown before its rest is taken for a stop, and not for steady sliding."""
_LEAST: Final = 0.05
"""Share of the rows that a stop seen in the force alone must hold: within a stick the force hardly moves either."""
_SHARE: Final = 0.9
"""Part of a flat stretch that is measured: its end already moves by what the band allows."""


@dataclass(frozen=True)
class Rest:
    """A stretch at rest: rows [start, stop), mean friction force there [N], and whether the drive's own column says so
    ("told") or only the force looks like it."""

    start: int
    stop: int
    force: float
    told: bool

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.stop - self.start


@dataclass(frozen=True)
class Rests:
    """Rest before the drive starts and after it has stopped; None where there is none."""

    before: Rest | None
    after: Rest | None


def find_rests(record: Record, friction: FloatArray, speed: FloatArray | None = None) -> Rests:
    """Find the rests at both ends of a record.

    friction (n,) [N]: the friction force, NaN where it does not count. speed (n,) [m/s]: of a column that is known to
    be the drive, believed first; without one, a force that stays within its noise below half of the sliding force is
    rest before the start, and one that stays within its noise after stick-slip may be a stop.
    """
    if speed is None and isinstance(record.drive_speed, np.ndarray):
        speed = np.abs(record.drive_speed)
    if speed is not None:
        moving = np.flatnonzero(speed > _SLOW * np.quantile(speed, 0.9))
        if moving.size and speed.max() > 0:
            first, last = int(moving[0]), int(moving[-1]) + 1
            return Rests(_told(friction, 0, first), _told(friction, last, friction.size))
    finite = np.isfinite(friction)
    force = kept(friction, finite)
    if force.size < 3 * FEWEST:
        return Rests(None, None)
    noise = _noise(force)
    band = max(_BAND * noise, 1e-9 * float(max(force.max(), -force.min())))
    head, tail = _flat(force, band), _flat(force[::-1], band)
    before = after = None
    if FEWEST <= head < _SHARE * force.size:
        level = float(np.mean(force[: int(_SHARE * head)]))
        if abs(level) < _LOW * float(np.median(np.abs(thinned(force[head:])))):
            before = Rest(0, int(np.flatnonzero(finite)[head - 1]) + 1, level, told=False)
    if (
        max(5 * FEWEST, _LEAST * force.size) <= tail < _SHARE * force.size
        and head + tail < force.size
        and np.std(force[head : force.size - tail]) > _LIVELY * noise
    ):
        lively = force[head : force.size - tail]
        if _swings(lively) < _SWINGS or np.ptp(lively[-lively.size // 4 :]) < 0.5 * np.ptp(lively):  # or they decay
            return Rests(before, None)
        level = float(np.mean(force[force.size - int(_SHARE * tail) :]))
        after = Rest(int(np.flatnonzero(finite)[force.size - tail]), friction.size, level, told=False)
    return Rests(before, after)


def _told(friction: FloatArray, start: int, stop: int) -> Rest | None:
    values = friction[start:stop]
    values = values[np.isfinite(values)]
    return Rest(start, stop, float(np.mean(values)), told=True) if values.size >= FEWEST else None


def _noise(force: FloatArray) -> float:
    """Return the standard deviation of the noise [N], from the steps between samples; at least their quantisation."""
    steps = np.abs(thinned_steps(force))
    robust = 1.4826 * float(np.median(steps)) / np.sqrt(2.0)
    if _smallest(steps) > np.sqrt(12.0) * robust:  # the smallest of all may be smaller still
        robust = max(robust, _smallest(np.abs(np.diff(force))) / np.sqrt(12.0))
    return robust if robust < np.inf else 0.0


def _smallest(steps: FloatArray) -> float:
    """Return the smallest of the steps that are any, infinity without one."""
    return float(np.min(steps, where=steps > 0, initial=np.inf))


def _swings(force: FloatArray) -> int:
    """Return how often the force goes up and down by at least half of its range."""
    low, high = (float(q) for q in np.quantile(force, [0.05, 0.95]))
    side = np.where(force > low + 0.75 * (high - low), 1, np.where(force < low + 0.25 * (high - low), -1, 0))
    side = side[side != 0]
    return int(np.count_nonzero(np.diff(side))) // 2


def _flat(force: FloatArray, band: float) -> int:
    """Return how many rows from the start stay level within a band [N]; 0 where they rise instead."""
    level = float(np.median(force[: FEWEST // 2]))
    width = FEWEST // 4
    rows = force.size
    for first in range(0, force.size - width + 1, _PORTION):  # it leaves its level soon, as a rule
        smooth = np.convolve(force[first : first + _PORTION + width - 1], np.ones(width) / width, mode="valid")
        out = np.flatnonzero(np.abs(smooth - level) > band)
        if out.size:
            rows = first + int(out[0]) + width // 2
            break
    if rows < FEWEST:
        return 0
    inside = force[: int(_SHARE * rows)]
    slope = np.polyfit(np.arange(inside.size), inside, 1)[0]
    return rows if abs(slope) * inside.size < 0.5 * band else 0
