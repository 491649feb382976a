"""The friction signal itself: dead, clipped, coarse, repeated; each as a number and a sentence."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.frozen import Finding, FloatArray
from data_io.grid_step import grid_step
from data_io.record import Record
from data_io.thinned import kept
from data_io.thresholds import Thresholds
from data_io.true_runs import longest_run

_CLIPPED_RUN: Final = 10
"""Rows in a row at the very same extreme value before a sensor is said to stand at its end."""
_CLIPPED_EXCESS: Final = 5.0
"""A sensor at its end shows the last value this many times more often than the values before it."""
_BIG_STEP: Final = 3.0
"""Steps of the quantisation by which a held signal moves on; a coarse one moves by one or two."""


_HELD_EVENLY: Final = 0.9
"""Share of the values that are held as long as the usual one, give or take a row, by a logger ahead of its sensor."""


@dataclass(frozen=True)
class Signal:
    """clipped: rows at an end of the sensor. resolution [N]: step of the grid on which the values lie, 0 where they
    show none. repeated: share of the rows that repeat the row before."""

    clipped: int
    resolution: float
    repeated: float


def look_at_friction(record: Record, used: npt.NDArray[np.bool_], limits: Thresholds) -> tuple[Signal, list[Finding]]:
    """Measure the friction force of the rows that count, used (n,), and say what lies beyond the thresholds."""
    friction = kept(record.friction_force, used)
    span = float(np.ptp(friction))
    if span == 0:
        text = f"the friction force is exactly {friction[0]:g} N in every row; a living signal was expected; check it"
        return Signal(0, 0.0, 0.0), [Finding("friction_constant", "reject", text)]
    clipped, notes = clipping("friction force", friction, limits)
    resolution = grid_step(friction)
    if severity := limits.severity("quantisation", resolution / span):
        text = (
            f"the friction force comes in steps of {resolution:.3g} N, coarse against its range of {span:.3g} N; use a "
            "smaller measuring range of the sensor, or export more digits"
        )
        notes.append(Finding("friction_coarse", severity, text))
    repeated, evenly = _repeated(record, used, resolution)
    if severity := limits.severity("repeated_rows", repeated):
        cause = (
            "they are held for equally many rows each: the logger ran faster than the sensor; log at the sensor's own "
            "rate"
            if evenly
            else "they stand still now and then, for unlike times: a display that was read too slowly, or a link that "
            "was lost for a while; check how the values come to the logger, and leave such stretches out"
        )
        text = f"{100 * repeated:.0f} % of the rows repeat the measured values of the row before; {cause}"
        notes.append(Finding("repeated_rows", severity, text))
    return Signal(clipped, resolution, repeated), notes


def clipping(name: str, force: FloatArray, limits: Thresholds) -> tuple[int, list[Finding]]:
    """Return how many rows stand at an end of the sensor, and a finding for each end."""
    notes, total = [], 0
    for end, level in (("highest", float(force.max())), ("lowest", float(force.min()))):
        rows = _clipped_rows(force, level)
        total += rows
        if severity := limits.severity("clipped_rows", rows / force.size):
            text = (
                f"the {name} stays at its {end} value {level:.4g} N in {rows} rows: the sensor was at its end; use a "
                "larger measuring range"
            )
            notes.append(Finding(f"{name.split()[0]}_clipped", severity, text))
    return total, notes


def _clipped_rows(values: FloatArray, level: float) -> int:
    """Return how many rows stand at the level, an extreme value, if that looks like a sensor at its end, else 0."""
    at_end = values == level
    count = int(np.count_nonzero(at_end))
    if count < _CLIPPED_RUN or longest_run(at_end) < _CLIPPED_RUN:
        return 0
    off = np.abs(values - level)
    before, counts = np.unique(off[(off > 0.0) & (off < 0.1 * np.ptp(values))], return_counts=True)
    if before.size < 2:
        before, counts = np.unique(off[~at_end], return_counts=True)
    if before.size < 2:
        return 0
    usual = max(float(np.mean(counts[:5])), 1.0)
    return count if count > _CLIPPED_EXCESS * usual else 0


def _repeated(record: Record, used: npt.NDArray[np.bool_], step: float) -> tuple[float, bool]:
    """Return the share of rows that repeat the row before in every measured column and move on by leaps afterwards, and
    whether values are held for equally many rows each."""
    pair = used[1:] & used[:-1]
    same = pair & (record.friction_force[1:] == record.friction_force[:-1])
    if not same.any():
        return 0.0, False
    moved = np.abs(np.diff(record.friction_force))[pair & ~same]
    if moved.size == 0 or float(np.median(moved)) <= _BIG_STEP * step:
        return 0.0, False
    if np.ptp(record.normal_force[used]) > 0:
        same &= np.diff(record.normal_force) == 0
    held = np.diff(np.flatnonzero(np.concatenate(([True], ~same, [True]))))
    usual = float(np.median(held))
    evenly = usual > 1 and bool(np.mean(np.abs(held - usual) <= 1.0) >= _HELD_EVENLY)
    return int(np.count_nonzero(same)) / max(int(np.count_nonzero(pair)), 1), evenly
