"""The records of a scene: every log read as the scene states it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_io import LogError, LogTooLargeError, Record, read_log
from data_io.arrays import kept, thinned, thinned_steps
from data_io.correct import Corrections, correct
from data_io.motion import check_drive
from data_io.record import WINDOW_START
from data_io.speed_steps import Programme
from data_io.values import Finding
from identify.base.errors import FitError
from identify.base.wording import programme_text
from identify.logs.recorded_drive import RecordedDrive, drive_position, held_against_column, recorded_drive
from identify.logs.zigzag import running_means
from identify.scene import Scene
from identify.scene.values import DriveSpeed, LogEntry

# Samples that two logs of a scene share: each would count twice, and the intervals would be too narrow.

Array = NDArray[np.float64]

FEW = 8  # samples that two logs may share: windows that meet share those on their edge
LOOKED_AT = 1000  # samples that are compared first: logs that differ, differ there already
SAME_TIME = 1e-3  # of a step: what rounding makes of the clock of a copy
SAME_NOISE = 0.4  # correlation of the noise of one measurement: a resampled copy holds half of it
SAME_LEVEL = 0.02  # of the range of a force, by which its quantiles may differ in a copy
SHORTEST, LONGEST_SOUGHT = 64, 4096  # samples whose noise is looked for
PHASES = 8  # of a step, by which the rows of a copy may lie beside those of the other
NEIGHBOURS = 3  # rows: differences of neighbours are alike
OUTLYING = 4.0  # standard deviations


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
        agree, shift = noise_agreement(one.time, one.force, other.time, other.force)
        if agree > SAME_NOISE:
            raise FitError(
                f"log {i + 1} ({entries[i].path.name}) and log {j + 1} ({entries[j].path.name}) are one measurement, "
                f"exported twice: the noise of their forces is the same (correlation {agree:.2f}, clocks {shift:.6g} s "
                "apart), so that it would count twice; expected every measurement once: remove one of the two logs"
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


def noise_agreement(time: Array, force: Array, other_time: Array, other_force: Array) -> tuple[float, float]:
    """By how much the noise of two records agrees at the one shift of their clocks where it agrees best.

    A measurement that was exported again, rounded, on another clock, in another unit, thinned or resampled, has the
    same noise; a repeat of a test has not, alike as its course may be. Fourth differences hold noise and hardly any
    course; what is left of a course that repeats agrees a cycle earlier and later as well.

    Args:
        time, force, other_time, other_force: (n,) [s], [N] and (m,) [s], [N], times rising.

    Returns:
        the correlation of the noise less that at any other shift, 0 where the forces differ anyway; and how much later
        the clock of the other record is [s].
    """
    shares = (0.1, 0.3, 0.5, 0.7, 0.9)
    levels = [np.quantile(thinned(np.abs(values)), shares) for values in (force, other_force)]
    if min(force.size, other_force.size) < 2 * SHORTEST or np.any(
        np.abs(levels[0] - levels[1]) > SAME_LEVEL * np.ptp(levels)
    ):
        return 0.0, 0.0
    if np.median(thinned_steps(other_time)) < np.median(thinned_steps(time)):
        agree, shift = noise_agreement(other_time, other_force, time, force)
        return agree, -shift
    step = float(np.median(thinned_steps(other_time)))  # the coarser clock: the other record is looked for in this one
    length = min(LONGEST_SOUGHT, other_force.size // 2, int((time[-1] - time[0]) / step) // 2)
    if length < SHORTEST:
        return 0.0, 0.0
    first = (other_force.size - length) // 2
    grid = other_time[first] + step * np.arange(length)
    sought = _noise_alone(np.interp(grid, other_time, other_force))
    best, shift, others = 0.0, 0.0, 0.0
    for phase in np.arange(PHASES) / PHASES:
        begin = time[0] + phase * step
        evenly = np.interp(np.arange(begin, time[-1], step), time, force)
        noise = _noise_alone(evenly)
        size = np.sqrt(running_means(noise**2, sought.size) * sought.size * float(sought @ sought))
        padded = 2 * noise.size
        product = np.fft.irfft(np.fft.rfft(noise, padded) * np.conj(np.fft.rfft(sought, padded)), padded)
        correlation = np.abs(product[: size.size]) / np.maximum(size, 1e-12)
        at = int(np.argmax(correlation))
        if correlation[at] > best:
            best, shift = float(correlation[at]), float(grid[0] - (begin + step * at))
            correlation[max(at - NEIGHBOURS, 0) : at + NEIGHBOURS + 1] = 0.0
            others = float(np.max(correlation, initial=0.0))
    return best - others, shift


def _noise_alone(force: Array) -> Array:
    """Fourth differences of an even force in standard deviations, without those of slips and spikes."""
    bends = np.diff(force, 4)
    sd = 1.4826 * float(np.median(np.abs(bends)))
    return np.asarray(np.where(np.abs(bends) < OUTLYING * sd, bends / max(sd, 1e-300), 0.0))


# A log larger than memory: of its file only what the scene uses is read, and the times of its entry follow.

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

    def shifted(span: object) -> Any:
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


# The drive of a log whose scene says nothing of it: the programme of its own column.


def with_drives(scene: Scene, records: Sequence[Record] | None = None) -> tuple[Scene, list[str]]:
    """The scene in which every log has a drive speed, and a sentence for each that its own column told.

    Args:
        records: of the logs, in their order; None reads those whose drive the scene leaves out.

    Raises:
        FitError: a log without a drive speed whose columns do not tell it. LogError: one that cannot be read.
    """
    logs, said = list(scene.logs), []
    for i, entry in enumerate(scene.logs):
        if scene.rig_for(entry).drive_speed is not None:
            continue
        whole, record = (entry, records[i]) if records is not None and i < len(records) else read_entry(scene, i)
        if whole != entry:
            raise FitError(
                f"{entry.path.name} has no drive speed and is larger than memory, so that its columns are not searched "
                'for it; give drive_speed = "… mm/s" in its [[logs]] or under [rig]'
            )
        told = recorded_drive(record, scene.rig_for(entry).stiffness, entry.window)
        programme = _sure(told, entry)
        speed = programme if len(programme) > 1 else programme[0][1]
        logs[i] = replace(entry, drive_speed=speed)
        said.append(f"{entry.path.name}: the drive speed was taken from {told.place}: {programme_text(programme)}.")
    return (replace(scene, logs=tuple(logs)) if said else scene), said


def _sure(told: RecordedDrive, entry: LogEntry) -> Programme:
    remedy = 'give drive_speed = "… mm/s" in its [[logs]] or under [rig]'
    if told.programme is None:
        raise FitError(f"{entry.path.name} has no drive speed, and {told.trouble}; {remedy}")
    if not told.named:
        raise FitError(
            f"{entry.path.name} has no drive speed; {told.source} it would be {programme_text(told.programme)}, but no "
            f"name says that this is the drive; {remedy}"
        )
    return told.programme
