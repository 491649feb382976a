"""The records of a scene: every log read as the scene states it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from data_io import LogError, LogTooLargeError, Record, read_log
from data_io.motion import check_drive
from identify.base.errors import FitError
from identify.logs.counted_twice import refuse_counted_twice
from identify.logs.drive_doubts import held_against_column
from identify.logs.partly_read import read_partly
from identify.logs.told_drive import drive_position
from identify.scene import Scene
from identify.scene.values import LogEntry


def with_records(scene: Scene, records: Sequence[Record] | None) -> tuple[Scene, list[Record]]:
    """A scene and the records of its logs: those given, else read, of a log larger than memory only what is used.

    Raises:
        FitError: no logs, not a record for each, samples that two of them share, or one drive speed where a column
            changes it. LogError: one that cannot be read.
    """
    if not scene.logs:
        raise FitError("the scene lists no logs; name a LOG on the command line, or add [[logs]] to the scene")
    if records is None:
        read = [read_entry(scene, i) for i in range(len(scene.logs))]
        logs = tuple(entry for entry, _ in read)
        refuse_counted_twice(logs, [record for _, record in read])
        made = scene if logs == scene.logs else replace(scene, logs=logs)
        return made, [held_against_column(made, entry, record) for entry, record in read]
    if len(records) != len(scene.logs):
        raise FitError(f"{len(records)} records were given for {len(scene.logs)} logs of the scene; give one each")
    refuse_counted_twice(scene.logs, records)
    return scene, [held_against_column(scene, *pair) for pair in zip(scene.logs, records, strict=True)]


def unused(entry: LogEntry) -> tuple[tuple[float, float], ...]:
    """What an entry does not use of its log [s]: what it excludes, and what lies around its window and zeros."""
    if entry.window is None:
        return entry.exclude
    used = [entry.window, *(tare for tare in (entry.tare, entry.normal_tare) if isinstance(tare, tuple))]
    first, last = min(start for start, _ in used), max(stop for _, stop in used)
    before, behind = math.nextafter(first, -math.inf), math.nextafter(last, math.inf)
    return (*entry.exclude, (-math.inf, before), (behind, math.inf))


def read_entry(scene: Scene, index: int) -> tuple[LogEntry, Record]:
    """Read one log; the normal force of [rig] only where the log has none of its own."""
    entry = scene.logs[index]
    units, columns = (dict(said) if said else None for said in (entry.units, entry.columns))

    def read(load: float | None, window: tuple[float, float] | None = None) -> Record:
        return read_log(
            entry.path,
            step=entry.step,
            units=units,
            columns=columns,
            normal_force=load,
            run=entry.run,
            rate=entry.rate,
            window=window,
            channels=None if window is None else (),
            exclude=unused(entry),
        )

    def read_what_fits(load: float | None) -> tuple[LogEntry, Record]:
        try:
            return entry, read(load)
        except LogTooLargeError as refused:
            return read_partly(entry, refused, lambda window: read(load, window))

    try:
        entry, record = read_what_fits(entry.normal_force)
    except LogTooLargeError:
        raise
    except LogError:
        if entry.normal_force is not None or scene.rig.normal_force is None:
            raise
        entry, record = read_what_fits(scene.rig.normal_force)
    stated = scene.rig.drive_speed if entry.drive_speed is None else entry.drive_speed
    position = None if stated is None else drive_position(record)
    doubts = [] if stated is None or position is None else check_drive(record, stated, position)
    return entry, replace(record, findings=(*record.findings, *doubts)) if doubts else record
