"""Logs that no single motion one way describes, in parts: strokes to and fro, and what excluded stretches part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from data_io import Record
from data_io.arrays import thinned_steps
from data_io.drive import motion_of
from data_io.quality import MOST_PAUSES
from identify.logs.recorded_drive import drive_position
from identify.scene import Scene
from identify.scene.values import LogEntry
from identify.simulation.drive import Drive

STROKE, PART = "stroke", "part"  # the labels of parts: a scene may have parameters of their own for them
LEAST = 16  # samples of a part
LOST = 0.1  # share of a stroke that may be left out at its begin
BESIDE = 5  # samples beside a gap that show the force there
SURE, SHARE = 6.0, 0.15  # standard deviations, or share of the rise of a stick, by which the force misses it
LOST_SAMPLES, HIDES = 5.0, 0.5  # sample intervals, and half natural periods, in which a slip may be lost


def parted(scene: Scene, records: Sequence[Record]) -> tuple[Scene, list[Record]]:
    """The scene with its logs in parts, and the records to go with them; what is in one part comes back as it is."""
    return gaps_apart(*strokes_apart(scene, records))


def _apart(
    scene: Scene, records: Sequence[Record], parts_of: Callable[[Scene, LogEntry, Record], list[LogEntry]]
) -> tuple[Scene, list[Record]]:
    """The scene with the parts of its logs, each the log itself where it is whole, and the records to go with them."""
    pairs = [
        (part, record)
        for entry, record in zip(scene.logs, records, strict=True)
        for part in parts_of(scene, entry, record)
    ]
    if len(pairs) == len(scene.logs):
        return scene, list(records)
    return replace(scene, logs=tuple(entry for entry, _ in pairs)), [record for _, record in pairs]


def strokes_apart(scene: Scene, records: Sequence[Record]) -> tuple[Scene, list[Record]]:
    """The scene with one log per stroke where a drive turns, and the records to go with its logs.

    A drive turns by its programme, or, where one speed is stated, by the position column of the log; what the drive
    rests between two strokes is left out, and half a natural period after a turn without a rest: a slip that the drive
    turns in goes on the old way meanwhile. A scene without such a log comes back as it is.
    """
    return _apart(scene, records, _strokes)


def _strokes(scene: Scene, entry: LogEntry, record: Record) -> list[LogEntry]:
    drive = _turning(scene, entry, record)
    if drive is None or record.time.size == 0:
        return [entry]
    start, stop = entry.window or (0.0, float(record.time[-1]))
    spans: list[tuple[float, float, float]] = []  # sign, start, stop
    for first, last in pairwise([start, *drive.changes(start, stop), stop]):
        sign = float(np.sign(drive.at(0.5 * (first + last))))
        if spans and spans[-1][0] == sign:
            spans[-1] = (sign, spans[-1][1], last)  # a hold within a stroke belongs to it
        elif sign:
            spans.append((sign, first, last))
    if len({sign for sign, _, _ in spans}) < 2:
        return [entry]
    rig = scene.rig_for(entry)
    slip = float(np.pi * np.sqrt(rig.mass / rig.stiffness)) if rig.stiffness > 0.0 else 0.0
    out = []
    for number, (sign, first, last) in enumerate(spans, 1):
        rows = np.searchsorted(record.time, [first, last])
        if rows[1] - rows[0] < LEAST:
            continue
        turns = number > 1 and spans[number - 2][2] == first  # without a rest
        out.append(
            replace(
                entry,
                window=(first + min(slip, LOST * (last - first)) if turns else first, last),
                drive_speed=tuple(zip(drive.starts, drive.speeds, strict=True)),
                flip_sign=not entry.flip_sign if entry.flip_sign is not None and sign < 0 else entry.flip_sign,
                labels={STROKE: f"{number} {'forth' if sign > 0 else 'back'}"} | dict(entry.labels),
            )
        )
    return out or [entry]


def _turning(scene: Scene, entry: LogEntry, record: Record) -> Drive | None:
    """The drive of a log where it turns: its programme, else the stated speed along the position column."""
    rig = scene.rig_for(entry)
    speed = rig.drive_speed
    if isinstance(speed, tuple):
        drive = Drive.of(speed)
        return drive if min(drive.speeds) < 0.0 < max(drive.speeds) else None
    if speed is None or rig.stiffness <= 0.0 or (name := drive_position(record)) is None:
        return None
    motion = motion_of(record, name)
    if motion is None or not min(p.speed for p in motion.pieces) < 0.0 < max(p.speed for p in motion.pieces):
        return None
    pairs: list[tuple[float, float]] = []
    for piece in motion.pieces:
        signed = float(np.sign(piece.speed)) * abs(speed)
        if not pairs or pairs[-1][1] != signed:
            pairs.append((piece.time if pairs else 0.0, signed))
    return Drive.of(tuple(pairs))


def gaps_apart(scene: Scene, records: Sequence[Record]) -> tuple[Scene, list[Record]]:
    """The scene with one log before and one after each stretch that no stick bridges, excluded or without a sample, and
    the records to go with its logs: nobody knows what happened in between, and a fit that carried the motion through
    would invent it. A scene without such a log comes back as it is."""
    return _apart(scene, records, _parts)


def _parts(scene: Scene, entry: LogEntry, record: Record) -> list[LogEntry]:
    rig = scene.rig_for(entry)
    if rig.drive_speed is None or record.time.size < LEAST:
        return [entry]
    start, stop = entry.window or (0.0, float(record.time[-1]))
    unrecorded = [hole for hole in _unrecorded(record, rig.mass, rig.stiffness) if start < hole[0] and hole[1] < stop]
    holes = sorted({*entry.exclude, *(unrecorded if len(unrecorded) <= MOST_PAUSES else ())})
    drive, edges = Drive.of(rig.drive_speed), [start]
    for first, last in holes:
        if start < first and last < stop and not _bridged(entry, record, drive, rig.stiffness, first, last):
            edges += [first, last]
    spans = list(zip(edges[::2], [*edges[1::2], stop], strict=True))
    spans = [(a, b) for a, b in spans if np.count_nonzero((record.time >= a) & (record.time <= b)) >= LEAST]
    if len(spans) < 2:
        return [entry]
    return [
        replace(
            entry,
            window=(a, b),
            exclude=tuple(gap for gap in entry.exclude if gap[0] > a and gap[1] < b),
            skip_cycles=entry.skip_cycles if number == 1 else 0,
            labels={PART: f"{number} of {len(spans)}"} | dict(entry.labels),
        )
        for number, (a, b) in enumerate(spans, 1)
    ]


def _unrecorded(record: Record, mass: float, stiffness: float) -> list[tuple[float, float]]:
    """Stretches without a sample of the friction force that are long enough for a slip."""
    time, interval = record.time, float(np.median(thinned_steps(record.time)))
    slip = HIDES * float(np.pi * np.sqrt(mass / stiffness)) if stiffness > 0.0 else 0.0
    time = time[np.isfinite(record.friction_force)]
    long = np.flatnonzero(np.diff(time) > max(LOST_SAMPLES * interval, slip))
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
    begin, end = float(t[before].mean()), float(t[after].mean())
    times = [begin, *(c for c in drive.starts if begin < c < end), end]
    expected = abs(stiffness * sum((b - a) * drive.at(0.5 * (a + b)) for a, b in pairwise(times)))
    noise = float(np.median(np.abs(np.diff(f[finite])))) / (0.6745 * np.sqrt(2.0))
    rise = abs(float(f[after].mean() - f[before].mean()))
    return bool(abs(rise - expected) <= max(SURE * noise * np.sqrt(2.0 / BESIDE), SHARE * expected))


def name_of(entry: LogEntry) -> str:
    """Short name of a log in sentences, with the part of it that it is."""
    return ", ".join([entry.path.name, *(f"{w} {entry.labels[w]}" for w in (STROKE, PART) if w in entry.labels)])


def parts_of(scene: Scene, entries: Sequence[LogEntry]) -> list[int | None]:
    """For each log of a parted scene the number (from 1) of the log of `scene` it is a part of, None where it is whole.

    Times of a whole log that was read in part have moved, so that it is not the entry of the scene any more.
    """
    if len(entries) == len(scene.logs):
        return [None] * len(entries)

    def read_as(entry: LogEntry) -> tuple[object, ...]:
        return entry.path, entry.step, entry.run, entry.columns, entry.units

    out: list[int | None] = []
    for entry in entries:
        same = [(i, whole.window) for i, whole in enumerate(scene.logs, 1) if read_as(whole) == read_as(entry)]
        own = entry.window
        inside = [i for i, w in same if w is None or (own is not None and w[0] <= own[0] and own[1] <= w[1])]
        out.append(None if entry in scene.logs else next(iter([*inside, *(i for i, _ in same)]), None))
    return out
