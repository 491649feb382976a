"""A log larger than memory: of its file only what the scene uses is read, and the times of its entry follow."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from data_io import LogTooLargeError, Record
from data_io.record import WINDOW_START
from data_io.values import Finding
from identify.scene.values import DriveSpeed, LogEntry

Span = tuple[float, float]


def read_partly(entry: LogEntry, refused: LogTooLargeError, read: Callable[[Span], Record]) -> tuple[LogEntry, Record]:
    """The record of what an entry uses of its log, and the entry with its times from the begin of that record on.

    Args:
        refused: what was raised when the whole log was read.
        read: reads the rows within (start, stop) [s] from the first row of the log on.

    Raises:
        LogTooLargeError: the entry has no window, or its part is too large as well.
    """
    if entry.window is None:
        raise refused
    used = [entry.window, *(tare for tare in (entry.tare, entry.normal_tare) if isinstance(tare, tuple))]
    first, last = min(start for start, _ in used), max(stop for _, stop in used)
    record = read((first, last))
    begin = float(record.metadata.get(WINDOW_START, 0.0))
    told = Finding(
        "read_in_part",
        "info",
        f"the log is larger than memory: {begin:.6g} to {begin + record.time[-1]:.6g} s of it were read; times count "
        "from there on",
    )
    return _later(entry, begin), replace(record, findings=(*record.findings, told))


def _later(entry: LogEntry, begin: float) -> LogEntry:
    """An entry whose times count from `begin` [s] on."""

    def shifted(span: Any) -> Any:
        return (span[0] - begin, span[1] - begin) if isinstance(span, tuple) else span

    return replace(
        entry,
        window=shifted(entry.window),
        exclude=tuple(shifted(span) for span in entry.exclude if span[1] > begin),
        tare=shifted(entry.tare),
        normal_tare=shifted(entry.normal_tare),
        drive_speed=_drive_from(entry.drive_speed, begin),
    )


def _drive_from(drive: DriveSpeed | None, begin: float) -> DriveSpeed | None:
    if not isinstance(drive, tuple):
        return drive
    before = max((start for start, _ in drive if start <= begin), default=-math.inf)
    return tuple((max(start - begin, 0.0), speed) for start, speed in drive if start >= before)
