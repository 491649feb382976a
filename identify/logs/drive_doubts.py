"""What the column of a log says against the drive that the scene states: a warning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import true_runs
from data_io.motion import motion_of
from data_io.speed_steps import SAME
from data_io.values import Finding
from identify.base.wording import programme_text, speed_text
from identify.logs.along_friction import AGREES, velocity_in_head, velocity_text
from identify.logs.told_drive import ToldDrive, drive_position, told_drive
from identify.scene import Scene
from identify.scene.values import DriveSpeed, LogEntry
from identify.simulation.drive import Drive

Array = NDArray[np.float64]

DISAGREES = "drive_speed_disagrees"  # the code of the finding
APART = 0.02  # share of the larger by which a stated and a told speed contradict each other
LEAST = 10  # rows, and this share of the shortest piece, by which two steps may be apart
SHARE = 0.1


def held_against_column(scene: Scene, entry: LogEntry, record: Record) -> Record:
    """A record, with a warning where the drive of the scene and that of its column, or the head of its file, contradict
    each other. What the scene states is doubted, never overruled."""
    stated = scene.rig_for(entry).drive_speed
    if stated is None or any(finding.code == DISAGREES for finding in record.findings):
        return record
    text = _contradiction(entry, stated, record, scene.rig_for(entry).stiffness)
    return record if text is None else replace(record, findings=(*record.findings, Finding(DISAGREES, "warning", text)))


def _contradiction(entry: LogEntry, stated: DriveSpeed, record: Record, stiffness: float) -> str | None:
    """What a column says against the stated drive, in a sentence; None where they agree or no column tells."""
    if record.time.size < 2:
        return None
    told = told_drive(record, stiffness, entry.window)
    if not told.named or told.programme is None:
        head = velocity_in_head(record)
        if head is None or isinstance(stated, tuple):
            return None
        if any(abs(abs(stated) / own - 1.0) < AGREES for own in head.speeds.values()):
            return None
        return (
            f"the scene has a drive speed of {speed_text(stated)}, but the head of the log says {velocity_text(head)}; "
            "check drive_speed"
        )
    changes = None if isinstance(stated, tuple) else _changes(entry, stated, record, told)
    return changes or _apart(entry, stated, record, told)


def _changes(entry: LogEntry, stated: float, record: Record, told: ToldDrive) -> str | None:
    """That a column has several speeds where the scene has one, rests in between, or turns where no position tells the
    strokes."""
    start, stop = entry.window or (0.0, float(record.time[-1]))
    drive = Drive.of(told.programme or stated)
    inside = [speed for _, speed in drive.within(start, stop)]
    moving = [i for i, speed in enumerate(inside) if speed]
    if not moving:
        return None
    inside = inside[moving[0] : moving[-1] + 1]  # what it rests before and after is no change
    sizes = [abs(speed) for speed in inside if speed]
    several = max(sizes) - min(sizes) > SAME * max(sizes)
    turns = len({float(np.sign(speed)) for speed in inside}) > 1
    if not several and (not turns or _strokes(record)):
        return None
    return (
        f"{entry.path.name} has one drive speed in the scene, {speed_text(stated)}, but {told.place} changes: "
        f"{programme_text(told.programme or ())}; leave drive_speed out to take that, or give the programme or a "
        "window"
    )


def _strokes(record: Record) -> bool:
    """Whether a position tells strokes to and fro, which one speed goes with."""
    name = drive_position(record)
    motion = None if name is None else motion_of(record, name)
    speeds = [piece.speed for piece in motion.pieces] if motion is not None else [0.0]
    return min(speeds) < 0.0 < max(speeds)


def _apart(entry: LogEntry, stated: DriveSpeed, record: Record, told: ToldDrive) -> str | None:
    """Where a stated drive and that of the column differ for longer than steps may be apart."""
    used = np.ones(record.time.size, dtype=bool)
    for first, last in [entry.window] if entry.window else []:
        used &= (record.time >= first) & (record.time <= last)
    for first, last in entry.exclude:
        used &= (record.time < first) | (record.time > last)
    time = record.time[used]
    if not time.size:
        return None
    drives = [Drive.of(stated), Drive.of(told.programme or stated)]
    meant, seen = (np.abs(np.array(drive.speeds))[_piece(drive, time)] for drive in drives)
    larger = np.maximum(meant, seen)
    wrong = np.abs(meant - seen) > APART * np.maximum(larger, SAME * larger.max())
    if drives[0].constant:
        wrong &= seen > 0.0  # one speed says nothing of rests
    first, stop = max(true_runs(wrong).tolist(), key=lambda run: run[1] - run[0], default=(0, 0))
    rows = stop - first
    shortest = min(int(np.min(np.unique(_piece(drive, time), return_counts=True)[1])) for drive in drives)
    if rows <= max(LEAST, SHARE * shortest):
        return None
    lasts = float(time[first + rows - 1] - time[first])
    return (
        f"the scene has a drive speed of {speed_text(float(meant[first]))} at {time[first]:.4g} s, but {told.place} "
        f"says {speed_text(float(seen[first]))} there, and they differ for {lasts:.3g} s; "
        "correct drive_speed, or leave it out to take that"
    )


def _piece(drive: Drive, time: Array) -> NDArray[np.int64]:
    """Which piece of a drive holds at each time (n,)."""
    return np.clip(np.searchsorted(drive.starts, time, side="right") - 1, 0, None)
