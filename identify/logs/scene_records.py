"""The records of a scene: each log read as the scene states it, checked, cut into parts, and prepared."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from data_io import LogError, Record, read_log
from data_io.arrays import kept, thinned, thinned_steps
from data_io.correct import Corrections, correct
from data_io.drive import motion_of
from data_io.quality import MOST_PAUSES
from identify.base.errors import FitError
from identify.base.wording import programme_text, speed_text
from identify.logs.log_data import FEWEST_OF_SPECTRUM
from identify.logs.noise import FEWEST_ROWS, SIGNIFICANT, running_means
from identify.logs.prepare import PART, STROKE, Prepared, prepare
from identify.logs.recorded_drive import drive_position, recorded_drive, with_drive_checked
from identify.logs.segment import FEWEST
from identify.logs.unknowns import Unknowns, from_scene
from identify.logs.vibration import tuned
from identify.scene import Scene
from identify.scene.tables import Course
from identify.scene.values import LogEntry
from identify.simulation.drive import FITTED_PIECES, Drive

Array = NDArray[np.float64]
Span = tuple[float, float]

READ_BY = ("path", "step", "run", "columns", "units")  # what of an entry says which rows are read
SAME_TIME = 1e-3  # of a step: what rounding makes of the clock of a copy
SAME_NOISE = 0.4  # correlation of the noise of one measurement: a resampled copy holds half of it
SAME_LEVEL = 0.1  # of the range of a force, by which its quantiles may differ in a copy
LONGEST = 4096  # samples whose noise is looked for at most
BESIDE = 5  # samples beside a gap that show the force there
SHARE = 0.15  # of the rise of a stick, by which the force may miss it after a gap


@dataclass(frozen=True)
class PreparedScene:
    """The scene with one entry per part of a log; the record of each; the logs, prepared; what is searched."""

    scene: Scene
    records: list[Record]
    logs: list[Prepared]
    unknowns: Unknowns


def prepare_scene(scene: Scene, records: Sequence[Record]) -> PreparedScene:
    """Part, cut, correct and segment all logs of a scene, and find starts for what is explicit in time.

    Raises:
        FitError: a log without drive speed, or of which nothing is left.
        SceneError: an effect outside its measured range.
    """
    scene, parts = parted(scene, records)
    unknowns = from_scene(scene)
    logs = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, parts, strict=True)]
    return PreparedScene(scene, parts, *tuned(logs, unknowns))


def with_records(scene: Scene, records: Sequence[Record] | None) -> tuple[Scene, list[Record]]:
    """A scene and the records of its logs: those given, else read.

    Raises:
        FitError: no logs, not a record for each, or samples that two of them share. LogError: one that cannot be read.
    """
    if not scene.logs:
        raise FitError("the scene lists no logs; name a LOG on the command line, or add [[logs]] to the scene")
    if records is None:
        records = [read_entry(scene, i) for i in range(len(scene.logs))]
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
        record = records[i] if records is not None and i < len(records) else read_entry(scene, i)
        drive = recorded_drive(record)
        if drive.course is not None:
            logs[i] = replace(entry, drive_speed=drive.course)
            most = speed_text(drive.course.fastest)
            sentences.append(f"{entry.path.name}: the course of the drive was taken {drive.source}, up to {most}.")
            continue
        if drive.programme is None:
            raise FitError(f"{name}, and {drive.trouble}; {remedy}")
        logs[i] = replace(entry, drive_speed=drive.programme if drive.speed is None else drive.speed)
        speeds = programme_text(drive.programme)
        sentences.append(f"{entry.path.name}: the drive speed was taken from {drive.place}: {speeds}.")
    return (replace(scene, logs=tuple(logs)) if sentences else scene), sentences


def read_entry(scene: Scene, index: int) -> Record:
    """Read one log; the normal force of [rig] only where the log has none of its own."""
    entry = scene.logs[index]
    options = reading_options(scene, entry)
    try:
        return read_log(entry.path, normal_force=entry.normal_force, exclude=unused(entry), **options)
    except LogError:
        if entry.normal_force is not None or scene.rig.normal_force is None:
            raise
        return read_log(entry.path, normal_force=scene.rig.normal_force, exclude=unused(entry), **options)


def reading_options(scene: Scene, entry: LogEntry) -> dict[str, Any]:
    """How a log of a scene is read, as `data_io.read_log` takes it; but for its load, and what it does not use."""
    options = {name: getattr(entry, name) for name in ("step", "run", "rate")}
    options |= {name: dict(getattr(entry, name) or {}) or None for name in ("columns", "units")}
    return options | {"arm": entry.arm or scene.rig.arm, "area": entry.area or scene.contact.area}


def unused(entry: LogEntry) -> tuple[Span, ...]:
    """What an entry does not use of its log [s]: what it excludes, and what lies around its window and zeros."""
    if entry.window is None:
        return entry.exclude
    spans = [span for span in (entry.window, entry.tare, entry.normal_tare) if isinstance(span, tuple)]
    before = math.nextafter(min(start for start, _ in spans), -math.inf)
    behind = math.nextafter(max(stop for _, stop in spans), math.inf)
    return (*entry.exclude, (-math.inf, before), (behind, math.inf))


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
        (time, force), (other_time, other_force), times = one, other, np.empty(0)
        if min(time.size, other_time.size) > FEWEST:  # of one time: none where a single force of them differs
            near = SAME_TIME * float(np.median(thinned_steps(other_time)))
            after = np.clip(np.searchsorted(other_time, time), 1, other_time.size - 1)
            at = after - (time - other_time[after - 1] < other_time[after] - time)
            together = np.abs(other_time[at] - time) <= near
            times = time[together & ~np.any(other_force[at][together] != force[together])]
        if times.size > FEWEST:
            raise FitError(
                f"{names} hold the same {times.size} samples from {times[0]:.6g} to {times[-1]:.6g} s, which would "
                "count twice; expected every sample once: remove one of the two logs, or give them windows that do not "
                "overlap"
            )
        agree, shift = 0.0, 0.0
        if entries[i].drive_speed == entries[j].drive_speed:  # one measurement has one speed
            agree, shift = noise_agreement(*one, *other)
        if agree > SAME_NOISE:
            raise FitError(
                f"{names} are one measurement, exported twice: the noise of their forces is the same (correlation "
                f"{agree:.2f}, clocks {shift:.6g} s apart), so that it would count twice; expected every measurement "
                "once: remove one of the two logs"
            )


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
    if min(force.size, other_force.size) < 2 * FEWEST_OF_SPECTRUM or differ:
        return 0.0, 0.0
    if np.median(thinned_steps(other_time)) < np.median(thinned_steps(time)):
        agree, shift = noise_agreement(other_time, other_force, time, force)
        return agree, -shift
    step = float(np.median(thinned_steps(other_time)))  # the coarser clock: the other record is looked for in this one
    length = min(LONGEST, other_force.size // 2, int((time[-1] - time[0]) / step) // 2)
    if length < FEWEST_OF_SPECTRUM:
        return 0.0, 0.0
    grid = other_time[(other_force.size - length) // 2] + step * np.arange(length)
    sought = _noise_alone(np.interp(grid, other_time, other_force))
    best, shift, others = 0.0, 0.0, 0.0
    for begin in time[0] + step * np.arange(8) / 8:
        noise = _noise_alone(np.interp(np.arange(begin, time[-1], step), time, force))
        power = np.maximum(running_means(noise**2, sought.size), 0.0)  # rounding leaves less than none of a silence
        size = np.sqrt(power * sought.size * float(sought @ sought))
        full = scipy.fft.next_fast_len(noise.size + sought.size, real=True)
        product = np.fft.rfft(noise, full) * np.conj(np.fft.rfft(sought, full))
        correlation = np.abs(np.fft.irfft(product, full)[: size.size]) / np.maximum(size, 1e-12)
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
    return np.asarray(np.where(np.abs(bends) < 4.0 * sd, bends / max(sd, 1e-300), 0.0))


# Logs that no single motion one way describes, in parts: strokes to and fro, and what excluded stretches part.


def parted(scene: Scene, records: Sequence[Record]) -> tuple[Scene, list[Record]]:
    """The scene with its logs in parts, and the records to go with them; what is in one part comes back as it is.

    A log whose drive turns, by its programme, or, where one speed is stated, by the position column, has one part per
    stroke: what the drive rests between two is left out, and half a natural period after a turn without a rest: a slip
    that the drive turns in goes on the old way meanwhile. Before and after a stretch that no stick bridges, excluded or
    without a sample, are two parts: nobody knows what happened in between, and a fit that carried the motion through
    would invent it.
    """
    pairs = [
        (part, record)
        for entry, record in zip(scene.logs, records, strict=True)
        for stroke in _strokes(scene, entry, record)
        for part in _without_gaps(scene, stroke, record)
    ]
    if len(pairs) == len(scene.logs):
        return scene, list(records)
    return replace(scene, logs=tuple(entry for entry, _ in pairs)), [record for _, record in pairs]


def _strokes(scene: Scene, entry: LogEntry, record: Record) -> list[LogEntry]:
    """The strokes of a log whose drive turns; the log itself where it does not."""
    rig = scene.rig_for(entry)
    pairs, speed = rig.drive_speed, rig.drive_speed
    if record.time.size == 0 or speed is None or isinstance(speed, Course):  # a course is fitted through its turns
        return [entry]
    if not isinstance(speed, tuple):
        name = drive_position(record) if rig.stiffness > 0.0 else None
        motion = None if name is None else motion_of(record, name)
        signed = [(p.time, float(np.sign(p.speed)) * abs(speed)) for p in motion.pieces] if motion else []
        pairs = tuple((t if i else 0.0, v) for i, (t, v) in enumerate(signed) if not i or v != signed[i - 1][1])
    if not isinstance(pairs, tuple) or not pairs or not min(v for _, v in pairs) < 0.0 < max(v for _, v in pairs):
        return [entry]
    drive, (start, stop) = Drive.of(pairs), entry.window or (0.0, float(record.time[-1]))
    spans: list[tuple[float, float, float]] = []  # sign, start, stop
    for first, last in pairwise([start, *drive.changes(start, stop), stop]):
        sign = float(np.sign(drive.at(0.5 * (first + last))))
        if spans and spans[-1][0] == sign:
            spans[-1] = (sign, spans[-1][1], last)  # a hold within a stroke belongs to it
        elif sign:
            spans.append((sign, first, last))
    if len({sign for sign, _, _ in spans}) < 2:
        return [entry]
    slip = float(np.pi * np.sqrt(rig.mass / rig.stiffness)) if rig.stiffness > 0.0 else 0.0
    out = []
    for number, (sign, first, last) in enumerate(spans, 1):
        if np.diff(np.searchsorted(record.time, [first, last]))[0] < FEWEST_ROWS:
            continue
        at_once = number > 1 and spans[number - 2][2] == first  # without a rest
        out.append(
            replace(
                entry,
                window=(first + min(slip, 0.1 * (last - first)) if at_once else first, last),
                drive_speed=pairs,
                flip_sign=not entry.flip_sign if entry.flip_sign is not None and sign < 0 else entry.flip_sign,
                labels={STROKE: f"{number} {'forth' if sign > 0 else 'back'}"} | dict(entry.labels),
            )
        )
    return out or [entry]


def _without_gaps(scene: Scene, entry: LogEntry, record: Record) -> list[LogEntry]:
    """What lies before, between and after the stretches of a log that no stick bridges."""
    rig, time = scene.rig_for(entry), record.time
    if rig.drive_speed is None or time.size < FEWEST_ROWS:
        return [entry]
    start, stop = entry.window or (0.0, float(time[-1]))
    # Stretches without a sample of the friction force that are long enough for a slip.
    slip = 0.5 * float(np.pi * np.sqrt(rig.mass / rig.stiffness)) if rig.stiffness > 0.0 else 0.0
    known = time[np.isfinite(record.friction_force)]
    long = np.flatnonzero(np.diff(known) > max(5.0 * float(np.median(thinned_steps(time))), slip))
    unrecorded = [(float(known[i]), float(known[i + 1])) for i in long]
    unrecorded = [hole for hole in unrecorded if start < hole[0] and hole[1] < stop]
    holes = sorted({*entry.exclude, *(unrecorded if len(unrecorded) <= MOST_PAUSES else ())})
    drive, edges = Drive.of(rig.drive_speed, float(time[-1]), FITTED_PIECES), [start]
    for first, last in holes:
        if start < first and last < stop and not _bridged(entry, record, drive, rig.stiffness, first, last):
            edges += [first, last]
    spans = list(zip(edges[::2], [*edges[1::2], stop], strict=True))
    spans = [(a, b) for a, b in spans if np.count_nonzero((time >= a) & (time <= b)) >= FEWEST_ROWS]
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
    expected = abs(stiffness * float(np.diff(drive.motion([begin, end])[0])[0]))
    noise = float(np.median(np.abs(np.diff(f[finite])))) / (0.6745 * np.sqrt(2.0))
    rise = abs(float(f[after].mean() - f[before].mean()))
    return bool(abs(rise - expected) <= max(SIGNIFICANT * noise * np.sqrt(2.0 / BESIDE), SHARE * expected))


def parts_of(scene: Scene, entries: Sequence[LogEntry]) -> list[int | None]:
    """For each log of a parted scene the number (from 1) of the log of `scene` it is a part of; None where whole."""

    def holds(whole: LogEntry, part: LogEntry) -> bool:
        own, window = part.window, whole.window
        inside = window is None or (own is not None and window[0] <= own[0] and own[1] <= window[1])
        return inside and all(getattr(whole, name) == getattr(part, name) for name in READ_BY)

    numbers = [next((i for i, whole in enumerate(scene.logs, 1) if holds(whole, part)), None) for part in entries]
    return [None if part in scene.logs else number for part, number in zip(entries, numbers, strict=True)]
