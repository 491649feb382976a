"""The records of a scene: each log read as the scene states it, once, and the drive of its column where it has none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import scipy
from numpy.typing import NDArray

from data_io import LogError, LogTooLargeError, Record, read_log
from data_io.arrays import kept, thinned, thinned_steps
from data_io.correct import Corrections, correct
from data_io.drive import check_drive
from data_io.record import WINDOW_START
from data_io.values import Finding
from identify.base.errors import FitError
from identify.base.wording import programme_text
from identify.logs.noise import running_means
from identify.logs.recorded_drive import drive_position, recorded_drive, with_drive_checked
from identify.scene import Scene
from identify.scene.values import LogEntry

Array = NDArray[np.float64]
Span = tuple[float, float]

FEW = 8  # samples that two logs may share: windows that meet share those on their edge
SAME_TIME = 1e-3  # of a step: what rounding makes of the clock of a copy
SAME_NOISE = 0.4  # correlation of the noise of one measurement: a resampled copy holds half of it
SAME_LEVEL = 0.1  # of the range of a force, by which its quantiles may differ in a copy
SHORTEST, LONGEST = 64, 4096  # samples whose noise is looked for
PHASES = 8  # of a step, by which the rows of a copy may lie beside those of the other
OUTLYING = 4.0  # standard deviations of fourth differences: slips and spikes


def with_records(scene: Scene, records: Sequence[Record] | None) -> tuple[Scene, list[Record]]:
    """A scene and the records of its logs: those given, else read, of a log larger than memory only what is used.

    Raises:
        FitError: no logs, not a record for each, samples that two of them share, or one drive speed where a column
            changes it. LogError: one that cannot be read.
    """
    if not scene.logs:
        raise FitError("the scene lists no logs; name a LOG on the command line, or add [[logs]] to the scene")
    if records is None:
        pairs = [read_entry(scene, i) for i in range(len(scene.logs))]
        logs = tuple(entry for entry, _ in pairs)
        scene = scene if logs == scene.logs else replace(scene, logs=logs)
        records = [record for _, record in pairs]
    if len(records) != len(scene.logs):
        raise FitError(f"{len(records)} records were given for {len(scene.logs)} logs of the scene; give one each")
    refuse_counted_twice(scene.logs, records)
    return scene, [with_drive_checked(scene, *pair) for pair in zip(scene.logs, records, strict=True)]


def with_drives(scene: Scene, records: Sequence[Record] | None = None) -> tuple[Scene, list[str]]:
    """The scene in which every log has a drive speed, and a sentence for each whose speed its own column has.

    Args:
        records: of the logs, in their order; None reads those whose drive the scene leaves out.

    Raises:
        FitError: a log without a drive speed whose columns do not have it. LogError: one that cannot be read.
    """
    logs, sentences = list(scene.logs), []
    remedy = 'give drive_speed = "… mm/s" in its [[logs]] or under [rig]'
    for i, entry in enumerate(scene.logs):
        rig, name = scene.rig_for(entry), f"{entry.path.name} has no drive speed"
        if rig.drive_speed is not None:
            continue
        whole, record = (entry, records[i]) if records is not None and i < len(records) else read_entry(scene, i)
        if whole != entry:
            raise FitError(f"{name} and is larger than memory, so that its columns are not searched for it; {remedy}")
        drive = recorded_drive(record, entry.window)
        if drive.programme is None:
            raise FitError(f"{name}, and {drive.trouble}; {remedy}")
        if not drive.named:
            raise FitError(
                f"{name}; {drive.source} it would be {programme_text(drive.programme)}, but no name says that this is "
                f"the drive; {remedy}"
            )
        logs[i] = replace(entry, drive_speed=drive.programme if drive.speed is None else drive.speed)
        speeds = programme_text(drive.programme)
        sentences.append(f"{entry.path.name}: the drive speed was taken from {drive.place}: {speeds}.")
    return (replace(scene, logs=tuple(logs)) if sentences else scene), sentences


def read_entry(scene: Scene, index: int) -> tuple[LogEntry, Record]:
    """Read one log; the normal force of [rig] only where the log has none of its own. Of a log larger than memory what
    the entry uses is read, and its times count from the begin of that on."""
    entry = scene.logs[index]

    def read(load: float | None, window: Span | None = None) -> Record:
        return read_log(
            entry.path,
            step=entry.step,
            units=dict(entry.units) if entry.units else None,
            columns=dict(entry.columns) if entry.columns else None,
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
        except LogTooLargeError:
            if entry.window is None:
                raise
        record = read(load, _used_span(entry))
        begin = float(record.metadata.get(WINDOW_START, 0.0))
        text = (
            f"the log is larger than memory: {begin:.6g} to {begin + record.time[-1]:.6g} s of it were read; times "
            "count from there on"
        )
        return _later(entry, begin), replace(record, findings=(*record.findings, Finding("read_in_part", "info", text)))

    try:
        read_as, record = read_what_fits(entry.normal_force)
    except LogTooLargeError:
        raise
    except LogError:
        if entry.normal_force is not None or scene.rig.normal_force is None:
            raise
        read_as, record = read_what_fits(scene.rig.normal_force)
    stated = scene.rig.drive_speed if read_as.drive_speed is None else read_as.drive_speed
    position = None if stated is None else drive_position(record)
    doubts = [] if stated is None or position is None else check_drive(record, stated, position)
    return read_as, replace(record, findings=(*record.findings, *doubts)) if doubts else record


def _used_span(entry: LogEntry) -> Span:
    """From where to where an entry with a window uses its log [s], its zeros included."""
    spans = [span for span in (entry.window, entry.tare, entry.normal_tare) if isinstance(span, tuple)]
    return min(start for start, _ in spans), max(stop for _, stop in spans)


def unused(entry: LogEntry) -> tuple[Span, ...]:
    """What an entry does not use of its log [s]: what it excludes, and what lies around its window and zeros."""
    if entry.window is None:
        return entry.exclude
    first, last = _used_span(entry)
    before, behind = math.nextafter(first, -math.inf), math.nextafter(last, math.inf)
    return (*entry.exclude, (-math.inf, before), (behind, math.inf))


def _later(entry: LogEntry, begin: float) -> LogEntry:
    """An entry whose times count from `begin` [s] on."""

    def shifted(span: Span) -> Span:
        return span[0] - begin, span[1] - begin

    drive = entry.drive_speed
    if isinstance(drive, tuple):
        before = max((start for start, _ in drive if start <= begin), default=-math.inf)
        drive = tuple((max(start - begin, 0.0), speed) for start, speed in drive if start >= before)
    return replace(
        entry,
        window=shifted(entry.window) if entry.window is not None else None,
        exclude=tuple(shifted(span) for span in entry.exclude if span[1] > begin),
        tare=shifted(entry.tare) if isinstance(entry.tare, tuple) else entry.tare,
        normal_tare=shifted(entry.normal_tare) if isinstance(entry.normal_tare, tuple) else entry.normal_tare,
        drive_speed=drive,
    )


# Samples that two logs of a scene share: each would count twice, and the intervals would be too narrow.


def refuse_counted_twice(entries: Sequence[LogEntry], records: Sequence[Record]) -> None:
    """Refuse logs that share samples: one listed twice, a copy under another name, windows that overlap.

    A sample is known by the clock of its file and its friction force, so that the name of the file, its format and
    what the scene says of the log do not matter; one exported again is known by its noise.

    Raises:
        FitError: the two logs, and what to do.
    """
    used = []
    for entry, record in zip(entries, records, strict=True):
        counts = correct(record, Corrections(window=entry.window, exclude=entry.exclude)).used
        counts = counts & np.isfinite(record.friction_force)
        begin = float(record.metadata.get("file_time_start", 0.0))
        used.append((kept(record.time, counts) + begin, kept(record.friction_force, counts)))
    for (i, one), (j, other) in combinations(enumerate(used), 2):
        names = f"log {i + 1} ({entries[i].path.name}) and log {j + 1} ({entries[j].path.name})"
        times = _shared(*one, *other)
        if times.size > FEW:
            raise FitError(
                f"{names} hold the same {times.size} samples from {times[0]:.6g} to {times[-1]:.6g} s, which would "
                "count twice; expected every sample once: remove one of the two logs, or give them windows that do not "
                "overlap"
            )
        agree, shift = noise_agreement(*one, *other)
        if agree > SAME_NOISE:
            raise FitError(
                f"{names} are one measurement, exported twice: the noise of their forces is the same (correlation "
                f"{agree:.2f}, clocks {shift:.6g} s apart), so that it would count twice; expected every measurement "
                "once: remove one of the two logs"
            )


def _shared(time: Array, force: Array, other_time: Array, other_force: Array) -> Array:
    """The times [s] of the samples that two records have; none where a single one of the same time differs."""
    if min(time.size, other_time.size) <= FEW:
        return np.empty(0)
    near = SAME_TIME * float(np.median(thinned_steps(other_time)))
    rows = slice(*np.searchsorted(time, [other_time[0] - near, other_time[-1] + near]).tolist())
    time, force = time[rows], force[rows]
    after = np.clip(np.searchsorted(other_time, time), 1, other_time.size - 1)
    at = after - (time - other_time[after - 1] < other_time[after] - time)
    together = np.abs(other_time[at] - time) <= near
    return np.empty(0) if np.any(other_force[at][together] != force[together]) else time[together]


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
    levels = [np.quantile(thinned(np.abs(values)), (0.1, 0.3, 0.5, 0.7, 0.9)) for values in (force, other_force)]
    differ = np.any(np.abs(levels[0] - levels[1]) > SAME_LEVEL * np.ptp(levels))
    if min(force.size, other_force.size) < 2 * SHORTEST or differ:
        return 0.0, 0.0
    if np.median(thinned_steps(other_time)) < np.median(thinned_steps(time)):
        agree, shift = noise_agreement(other_time, other_force, time, force)
        return agree, -shift
    step = float(np.median(thinned_steps(other_time)))  # the coarser clock: the other record is looked for in this one
    length = min(LONGEST, other_force.size // 2, int((time[-1] - time[0]) / step) // 2)
    if length < SHORTEST:
        return 0.0, 0.0
    grid = other_time[(other_force.size - length) // 2] + step * np.arange(length)
    sought = _noise_alone(np.interp(grid, other_time, other_force))
    best, shift, others = 0.0, 0.0, 0.0
    for begin in time[0] + step * np.arange(PHASES) / PHASES:
        noise = _noise_alone(np.interp(np.arange(begin, time[-1], step), time, force))
        power = np.maximum(running_means(noise**2, sought.size), 0.0)  # rounding leaves less than none of a silence
        size = np.sqrt(power * sought.size * float(sought @ sought))
        correlation = np.abs(scipy.signal.correlate(noise, sought, "valid", "fft")) / np.maximum(size, 1e-12)
        at = int(np.argmax(correlation))
        if correlation[at] > best:
            best, shift = float(correlation[at]), float(grid[0] - (begin + step * at))
            correlation[max(at - 3, 0) : at + 4] = 0.0  # differences of neighbours are alike
            others = float(np.max(correlation, initial=0.0))
    return best - others, shift


def _noise_alone(force: Array) -> Array:
    """Fourth differences of an even force in standard deviations, without those of slips and spikes."""
    bends = np.diff(force, 4)
    sd = 1.4826 * float(np.median(np.abs(bends)))
    return np.asarray(np.where(np.abs(bends) < OUTLYING * sd, bends / max(sd, 1e-300), 0.0))
