"""Logs that no single motion one way describes, in parts: strokes to and fro, and what excluded stretches part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import thinned_steps
from data_io.motion import motion_of
from data_io.quality import MOST_PAUSES
from identify.logs.recorded_drive import drive_position
from identify.scene import Scene
from identify.scene.values import LogEntry
from identify.simulation.drive import Drive

# A scene with every log replaced by the parts that some rule makes of it.


def taken_apart(
    scene: Scene, records: Sequence[Record], parts_of: Callable[[Scene, LogEntry, Record], list[LogEntry]]
) -> tuple[Scene, list[Record]]:
    """The scene with the parts of its logs, each the log itself where it is whole, and the records to go with them. A
    scene of whole logs comes back as it is."""
    entries: list[LogEntry] = []
    kept: list[Record] = []
    for entry, record in zip(scene.logs, records, strict=True):
        made = parts_of(scene, entry, record)
        entries += made
        kept += [record] * len(made)
    if len(entries) == len(scene.logs):
        return scene, list(records)
    return replace(scene, logs=tuple(entries)), kept


# A log in which the drive turns becomes one log per stroke: the model slides one way, and each stroke has its sign.

STROKE = "stroke"  # the label of each: a scene may have parameters of their own for them
LEAST = 16  # samples of a stroke
LOST = 0.1  # share of a stroke that may be left out at its begin


def strokes_apart(scene: Scene, records: Sequence[Record]) -> tuple[Scene, list[Record]]:
    """The scene with one log per stroke where a drive turns, and the records to go with its logs.

    A drive turns by its programme, or, where one speed is stated, by the position column of the log; what the drive
    rests between two strokes is left out, and half a natural period after a turn without a rest: a slip that the drive
    turns in goes on the old way meanwhile. A scene without such a log comes back as it is.
    """
    return taken_apart(scene, records, _strokes)


def _strokes(scene: Scene, entry: LogEntry, record: Record) -> list[LogEntry]:
    drive = _drive(scene, entry, record)
    if drive is None or record.time.size == 0:
        return [entry]
    start, stop = entry.window or (0.0, float(record.time[-1]))
    edges = [start, *drive.changes(start, stop), stop]
    spans: list[tuple[float, float, float]] = []  # sign, start, stop
    for first, last in pairwise(edges):
        sign = float(np.sign(drive.at(0.5 * (first + last))))
        if sign == 0.0:
            continue
        if spans and spans[-1][0] == sign:
            spans[-1] = (sign, spans[-1][1], last)  # a hold within a stroke belongs to it
        else:
            spans.append((sign, first, last))
    if len({sign for sign, _, _ in spans}) < 2:
        return [entry]
    programme = tuple(zip(drive.starts, drive.speeds, strict=True))
    rig = scene.rig_for(entry)
    slip = float(np.pi * np.sqrt(rig.mass / rig.stiffness)) if rig.stiffness > 0.0 else 0.0
    out = []
    for number, (sign, first, last) in enumerate(spans, 1):
        rows = np.searchsorted(record.time, [first, last])
        if rows[1] - rows[0] < LEAST:
            continue
        label = f"{number} {'forth' if sign > 0 else 'back'}"
        flip = entry.flip_sign
        if flip is not None and sign < 0:
            flip = not flip
        labels = {STROKE: label} | dict(entry.labels)
        turns = number > 1 and spans[number - 2][2] == first  # without a rest
        begin = first + min(slip, LOST * (last - first)) if turns else first
        out.append(replace(entry, window=(begin, last), drive_speed=programme, flip_sign=flip, labels=labels))
    return out or [entry]


def _drive(scene: Scene, entry: LogEntry, record: Record) -> Drive | None:
    """The drive of a log where it turns: its programme, else the stated speed along the position column."""
    speed = scene.rig_for(entry).drive_speed
    if isinstance(speed, tuple):
        drive = Drive.of(speed)
        return drive if min(drive.speeds) < 0.0 < max(drive.speeds) else None
    if speed is None or scene.rig_for(entry).stiffness <= 0.0:
        return None
    name = drive_position(record)
    motion = None if name is None else motion_of(record, name)
    if motion is None or not any(p.speed > 0 for p in motion.pieces) or not any(p.speed < 0 for p in motion.pieces):
        return None
    told: list[tuple[float, float]] = []
    for piece in motion.pieces:
        signed = float(np.sign(piece.speed)) * abs(speed)
        if not told or told[-1][1] != signed:
            told.append((0.0 if not told else piece.time, signed))
    return Drive.of(tuple(told))


# A log with a stretch that hides a slip, excluded or not recorded, becomes one log before it and one after it.
#
# Nobody knows what happened in between, and a fit that carried the motion through would invent it.

Array = NDArray[np.float64]

PART = "part"  # the label of each
BESIDE = 5  # samples beside a gap that tell the force there
SURE = 6.0  # standard deviations, and this share of the rise of a stick, by which the force misses it:
SHARE = 0.15
LOST_SAMPLES = 5.0  # sample intervals, and half natural periods, without a sample in which a slip may be lost:
HIDES = 0.5


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
    holes = sorted({*entry.exclude, *(unrecorded if len(unrecorded) <= MOST_PAUSES else ())})
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
    shortest = max(LOST_SAMPLES * interval, slip)
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


def parted(scene: Scene, records: Sequence[Record]) -> tuple[Scene, list[Record]]:
    """The scene with its logs in parts, and the records to go with them; what is in one part comes back as it is."""
    return gaps_apart(*strokes_apart(scene, records))


def name_of(entry: LogEntry) -> str:
    """Short name of a log in sentences, with the part of it that it is."""
    said = [f"{word} {entry.labels[word]}" for word in (STROKE, PART) if word in entry.labels]
    return ", ".join([entry.path.name, *said])


def recordings(scene: Scene) -> list[list[int]]:
    """The numbers of the logs of a parted scene, those that are parts of one log together."""
    out: list[list[int]] = []
    for number, entry in enumerate(scene.logs):
        whole = next((some for some in out if _of_one_log(scene.logs[some[0]], entry)), None)
        if whole is None:
            out.append([number])
        else:
            whole.append(number)
    return out


def name_of_recording(scene: Scene, numbers: Sequence[int]) -> str:
    """Short name in sentences of what these logs are parts of."""
    entry = scene.logs[numbers[0]]
    return name_of(entry) if len(numbers) == 1 else entry.path.name


def _of_one_log(one: LogEntry, other: LogEntry) -> bool:
    return _read_as(one) == _read_as(other) and any(w in one.labels and w in other.labels for w in (STROKE, PART))


def parts_of(scene: Scene, entries: Sequence[LogEntry]) -> list[int | None]:
    """For each log of a parted scene the number (from 1) of the log of `scene` it is a part of, None where it is whole.

    Times of a whole log that was read in part have moved, so that it is not the entry of the scene any more.
    """
    whole = len(entries) == len(scene.logs)
    return [None if whole else _part_of(scene, entry) for entry in entries]


def _part_of(scene: Scene, entry: LogEntry) -> int | None:
    if entry in scene.logs:
        return None
    same = [i for i, whole in enumerate(scene.logs, 1) if _read_as(whole) == _read_as(entry)]
    inside = [i for i in same if _within(entry, scene.logs[i - 1])]
    return next(iter(inside or same), None)


def _read_as(entry: LogEntry) -> tuple[object, ...]:
    """What tells the records of two logs of one file apart."""
    return entry.path, entry.step, entry.run, entry.columns, entry.units


def _within(entry: LogEntry, whole: LogEntry) -> bool:
    if entry.window is None or whole.window is None:
        return whole.window is None
    return whole.window[0] <= entry.window[0] and entry.window[1] <= whole.window[1]
