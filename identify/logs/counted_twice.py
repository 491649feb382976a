"""Samples that two logs of a scene share: each would count twice, and the intervals would be too narrow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import kept, thinned_steps
from data_io.correct import Corrections, correct
from identify.base.errors import FitError
from identify.scene.values import LogEntry

Array = NDArray[np.float64]

FEW = 8  # samples that two logs may share: windows that meet share those on their edge
LOOKED_AT = 1000  # samples that are compared first: logs that differ, differ there already
SAME_TIME = 1e-3  # of a step: what rounding makes of the clock of a copy


def refuse_counted_twice(entries: Sequence[LogEntry], records: Sequence[Record]) -> None:
    """Refuse logs that share samples: one listed twice, a copy under another name, windows that overlap.

    A sample is known by the clock of its file and its friction force, so that the name of the file, its format and
    what the scene says of the log do not matter.

    Raises:
        FitError: the two logs, and what to do.
    """
    used = [_Used.of(entry, record) for entry, record in zip(entries, records, strict=True)]
    for (i, one), (j, other) in combinations(enumerate(used), 2):
        times = _shared(one, other)
        if times.size > FEW:
            raise FitError(
                f"log {i + 1} ({entries[i].path.name}) and log {j + 1} ({entries[j].path.name}) hold the same "
                f"{times.size} samples from {times[0]:.6g} to {times[-1]:.6g} s, which would count twice; expected "
                "every sample once: remove one of the two logs, or give them windows that do not overlap"
            )


@dataclass(frozen=True)
class _Used:
    """What counts of a log: time [s] by the clock of its file and friction force [N], each (n,)."""

    time: Array
    force: Array

    @staticmethod
    def of(entry: LogEntry, record: Record) -> _Used:
        used = correct(record, Corrections(window=entry.window, exclude=entry.exclude)).used
        used = used & np.isfinite(record.friction_force)
        begin = float(record.metadata.get("file_time_start", 0.0))
        time = kept(record.time, used)
        return _Used(time + begin if begin else time, kept(record.friction_force, used))


def _shared(one: _Used, other: _Used) -> Array:
    """The times [s] of the samples that both have; none where a single one of the same time differs."""
    if min(one.time.size, other.time.size) <= FEW:
        return np.empty(0)
    near = SAME_TIME * float(np.median(thinned_steps(other.time)))
    first, last = np.searchsorted(one.time, [other.time[0] - near, other.time[-1] + near])
    for rows in (slice(first, last, max((last - first) // LOOKED_AT, 1)), slice(first, last)):
        time, force = one.time[rows], one.force[rows]
        after = np.clip(np.searchsorted(other.time, time), 1, other.time.size - 1)
        at = after - (time - other.time[after - 1] < other.time[after] - time)
        together = np.abs(other.time[at] - time) <= near
        if np.any(other.force[at][together] != force[together]):
            return np.empty(0)
    return time[together]
