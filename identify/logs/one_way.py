"""A log in which the drive turns becomes one log per stroke: the model slides one way, and each stroke has its sign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from data_io import Record
from data_io.motion import motion_of
from identify.logs.taken_apart import taken_apart
from identify.logs.told_drive import drive_position
from identify.scene import Scene
from identify.scene.values import LogEntry
from identify.simulation.drive import Drive

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
