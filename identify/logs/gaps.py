"""A log with a stretch that hides a slip, excluded or not recorded, becomes one log before it and one after it.

Nobody knows what happened in between, and a fit that carried the motion through would invent it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import thinned_steps
from identify.logs.taken_apart import taken_apart
from identify.scene import Scene
from identify.scene.values import LogEntry
from identify.simulation.drive import Drive

Array = NDArray[np.float64]

PART = "part"  # the label of each
BESIDE = 5  # samples beside a gap that tell the force there
SURE = 6.0  # standard deviations, and this share of the rise of a stick, by which the force misses it:
SHARE = 0.15
LEAST = 16  # samples of a part
LOST = 5.0  # sample intervals, and half natural periods, without a sample in which a slip may be lost:
HIDES = 0.5
MOST = 20  # of them: a record with more holes has no parts


def gaps_apart(scene: Scene, records: Sequence[Record]) -> tuple[Scene, list[Record]]:
    """The scene with one log before and one after each stretch that no stick bridges, excluded or without a sample, and
    the records to go with its logs. A scene without such a log comes back as it is."""
    return taken_apart(scene, records, _parts)


def _parts(scene: Scene, entry: LogEntry, record: Record) -> list[LogEntry]:
    rig = scene.rig_for(entry)
    if rig.drive_speed is None or record.time.size < LEAST:
        return [entry]
    start, stop = entry.window or (0.0, float(record.time[-1]))
    unrecorded = [hole for hole in _unrecorded(record, rig.mass, rig.stiffness) if start < hole[0] and hole[1] < stop]
    holes = sorted({*entry.exclude, *(unrecorded if len(unrecorded) <= MOST else ())})
    if not holes:
        return [entry]
    drive = Drive.of(rig.drive_speed)
    edges = [start]
    for first, last in holes:
        if start < first and last < stop and not _bridged(entry, record, drive, rig.stiffness, first, last):
            edges += [first, last]
    spans = list(zip(edges[::2], [*edges[1::2], stop], strict=True))
    spans = [(a, b) for a, b in spans if np.count_nonzero((record.time >= a) & (record.time <= b)) >= LEAST]
    if len(spans) < 2:
        return [entry]
    out = []
    for number, span in enumerate(spans, 1):
        inside = tuple(gap for gap in entry.exclude if gap[0] > span[0] and gap[1] < span[1])
        labels = {PART: f"{number} of {len(spans)}"} | dict(entry.labels)
        skip = entry.skip_cycles if number == 1 else 0
        out.append(replace(entry, window=span, exclude=inside, skip_cycles=skip, labels=labels))
    return out


def _unrecorded(record: Record, mass: float, stiffness: float) -> list[tuple[float, float]]:
    """Stretches without a sample of the friction force that are long enough for a slip."""
    time, interval = record.time, float(np.median(thinned_steps(record.time)))
    slip = HIDES * float(np.pi * np.sqrt(mass / stiffness)) if stiffness > 0.0 else 0.0
    shortest = max(LOST * interval, slip)
    # As a rule nothing is missing, and the length of the record tells so without a look at every sample.
    spare = float(time[-1] - time[0]) - (time.size - 1) * interval
    if spare < 0.5 * shortest and np.isfinite(record.friction_force.sum()):
        return []
    time = time[np.isfinite(record.friction_force)]
    long = np.flatnonzero(np.diff(time) > shortest)
    return [(float(time[i]), float(time[i + 1])) for i in long]


def _bridged(entry: LogEntry, record: Record, drive: Drive, stiffness: float, first: float, last: float) -> bool:
    """Whether a mass that rests throughout takes the force from before a gap to after it."""
    finite = np.isfinite(record.friction_force)
    outside = np.ones(record.time.size, bool)
    for a, b in entry.exclude:
        outside &= (record.time < a) | (record.time > b)
    before = np.flatnonzero(finite & outside & (record.time < first))[-BESIDE:]
    after = np.flatnonzero(finite & outside & (record.time > last))[:BESIDE]
    if before.size < BESIDE or after.size < BESIDE:
        return False
    t, f = record.time, record.friction_force
    changes = [c for c in drive.starts if t[before].mean() < c < t[after].mean()]
    times = [float(t[before].mean()), *changes, float(t[after].mean())]
    moved = sum((b - a) * drive.at(0.5 * (a + b)) for a, b in pairwise(times))
    expected = abs(stiffness * moved)
    noise = float(np.median(np.abs(np.diff(f[finite])))) / (0.6745 * np.sqrt(2.0))
    rise = abs(float(f[after].mean() - f[before].mean()))
    allowed = max(SURE * noise * np.sqrt(2.0 / BESIDE), SHARE * expected)
    return bool(abs(rise - expected) <= allowed)
