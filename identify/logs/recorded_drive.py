"""What a log tells of its drive: a speed or a programme of speeds, from which column, or why nothing."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import true_runs
from data_io.columns import DISTANCES
from data_io.motion import Motion, motion_of
from data_io.record import WINDOW_START, within
from data_io.speed_steps import MOST, SAME, Programme, SpeedSteps, evened, steps_of
from data_io.values import Finding
from identify.base.wording import programme_text, speed_text
from identify.logs.strokes import AGREES, column_speed, moves_along, rests_by_head, velocity_in_head, velocity_text
from identify.scene import Scene
from identify.scene.values import DriveSpeed, LogEntry
from identify.simulation.drive import Drive

Array = NDArray[np.float64]

SPEED_NAMES = (
    "drivespeed", "drivevelocity", "stagespeed", "stagevelocity", "slidingspeed", "slidingvelocity", "linearspeed",
    "linearvelocity", "geschwindigkeit", "gleitgeschwindigkeit", "velocity", "speed",
)  # fmt: skip
POSITION_NAMES = ("stageposition", "driveposition", "position", "pos", *DISTANCES)
AXES = ("v", "v1", "v2", "v3", "vx", "vy", "vz", "x", "y", "z")  # of carriages: any of them may be the drive, or none
UNTOLD = "the log does not tell it"
STEADY = 0.02  # relative scatter up to which a recorded speed counts as one speed
ROUNDED = 1e-9  # of its values: a position that varies by less stands still
EVEN = 0.05  # by how much the halves of a stretch of even motion may differ
HALF = 20  # rows of a half that tells its speed


@dataclass(frozen=True)
class RecordedDrive:
    """programme: ((start [s], speed [m/s]), ...), one pair where it is one speed, which then is positive; None where
    the log tells none. source: where it stands, in words; trouble: where it is None, why, in words; named: the name of
    the column says that it is the drive; stands: a column of the drive, or the head of the log, says that it does not
    move."""

    programme: Programme | None
    source: str = ""
    trouble: str = ""
    named: bool = False
    stands: bool = False

    @property
    def place(self) -> str:
        """Where it stands, as a noun."""
        return self.source.removeprefix("from ") if self.source.startswith("from ") else "the drive speed of the log"

    @property
    def speed(self) -> float | None:
        """The one speed [m/s]; None where it changes or is not told."""
        return self.programme[0][1] if self.programme is not None and len(self.programme) == 1 else None


def recorded_drive(record: Record, stiffness: float = 0.0, window: tuple[float, float] | None = None) -> RecordedDrive:
    """What a record tells of its drive.

    A drive speed of the record counts first, then a column with a unit of speed or of length whose name says that it
    is the drive; where there is none, any other that is seen to move along the friction.

    Args:
        stiffness: of the rig [N/m], 0 where it is not known.
        window: the part [s] that is used, None for all of it.
    """
    if window is not None:
        return _told_within(record, stiffness, window)
    if isinstance(record.drive_speed, np.ndarray):
        return _of_steps(steps_of(record.time, record.drive_speed), "drive_speed", "as the log says")
    if record.drive_speed is not None:
        speed = abs(float(record.drive_speed))
        return RecordedDrive(
            ((0.0, speed),) if speed else None, "as the log says", "it is 0 in the log", True, not speed
        )
    speeds, positions = _named(record, "m/s", SPEED_NAMES), _named(record, "m", POSITION_NAMES)
    tried = [
        *(_of_speed(record, name) for name in speeds),
        *(_of_position(record, name) for name in positions),
    ]
    told = next((drive for drive in tried if drive.programme is not None), None)
    doubts: list[str] = []
    if not tried:
        told, doubts = _along_friction(record, stiffness)
    if told is not None:
        return told
    if not tried and not doubts and rests_by_head(record):  # nor does any carriage move
        return RecordedDrive(None, trouble="the head of the log says Velocity = 0", stands=True)
    words = "; ".join(drive.trouble for drive in tried) or "; ".join(doubts) or _unused(record)
    return RecordedDrive(None, trouble=words, stands=bool(speeds) and all(drive.stands for drive in tried))


def drive_position(record: Record) -> str | None:
    """The column in metres that is the position of the drive: by its name, or as it moves along the friction; None
    where none is known to be."""
    if named := _named(record, "m", POSITION_NAMES):
        return named[0]
    lengths = (name for name, unit in record.channel_units.items() if unit == "m")
    return next(
        (name for name in lengths if _travels(record.channels[name]) and moves_along(record, name).is_drive), None
    )


def speed_of(record: Record) -> Array | None:
    """How fast the drive moves in every row [m/s], (n,), from a column that is known to be the drive; None where none
    is."""
    if isinstance(record.drive_speed, np.ndarray):
        return np.abs(record.drive_speed)
    for name in _named(record, "m/s", SPEED_NAMES):
        if np.isfinite(record.channels[name]).all() and np.any(record.channels[name]):
            return np.abs(record.channels[name])
    position = drive_position(record)
    if position is None or not _travels(record.channels[position]):
        return None
    return np.abs(column_speed(record, position))


def _along_friction(record: Record, stiffness: float) -> tuple[RecordedDrive | None, list[str]]:
    """The drive told by a column that no name gives away, but that moves along the friction; and why others do not."""
    doubts: list[str] = []
    for name in sorted(record.channel_units, key=lambda name: record.channel_units[name] != "m/s"):
        values, unit = record.channels[name], record.channel_units[name]
        if unit not in ("m/s", "m") or not np.isfinite(values).all():
            continue
        if not (_travels(values) if unit == "m" else np.any(values)):
            continue
        motion = moves_along(record, name, stiffness)
        if motion.is_drive:
            told = _of_speed(record, name) if unit == "m/s" else _of_position(record, name)
            return replace(told, source=f"{told.source}, which {motion.because}") if told.source else told, doubts
        role = "drive_speed" if unit == "m/s" else "position"
        remedy = f'; if it is: --columns "{role}={_shown(name)}"'
        doubts.append(f"column {_shown(name)} is not taken for the drive: {motion.because}{remedy}")
    return None, doubts


def _told_within(record: Record, stiffness: float, window: tuple[float, float]) -> RecordedDrive:
    """What the part of a record tells that is used, in the times of the whole."""
    first, last = np.searchsorted(record.time, window[0]), np.searchsorted(record.time, window[1], side="right")
    if last - first < 2:
        return recorded_drive(record, stiffness)  # such a window is refused elsewhere
    begin = float(record.metadata.get(WINDOW_START, 0.0))
    told = recorded_drive(within(record, (window[0] + begin, window[1] + begin)), stiffness)
    start = float(record.time[first])
    later = None if told.programme is None else [(at + start if at else 0.0, speed) for at, speed in told.programme]
    return replace(told, programme=None if later is None else tuple(later))


def _key(name: str) -> str:
    return re.sub(r"[\W_]+", "", _shown(name).casefold())


def _shown(name: str) -> str:
    """A column as the file calls it: one that has the name of a role was numbered when it was read."""
    return re.sub(r"^(drive_speed) \(\d+\)$", r"\1", name)


def _named(record: Record, unit: str, names: Sequence[str]) -> list[str]:
    """The channels of a unit whose names say that they are the drive, the clearest first."""
    there = [name for name, own in record.channel_units.items() if own == unit and _key(name) in names]
    return sorted(there, key=lambda name: names.index(_key(name)))


def _of_speed(record: Record, name: str) -> RecordedDrive:
    return _of_steps(steps_of(record.time, record.channels[name]), _shown(name), f"from column {_shown(name)}")


def _of_steps(found: SpeedSteps, name: str, source: str) -> RecordedDrive:
    if found.programme is None:
        return RecordedDrive(None, trouble=f"column {name} {found.trouble}", named=True, stands=found.stands)
    return RecordedDrive(_one_way(found.programme), source, named=True)


def _one_way(programme: Programme) -> Programme:
    """A programme that never goes forth is one that never goes back: the sign of a column is a choice."""
    if max(speed for _, speed in programme) > 0.0:
        return programme
    return tuple((start, abs(speed)) for start, speed in programme)


def _of_position(record: Record, name: str) -> RecordedDrive:
    """What a position tells: pieces of even speed."""
    values = record.channels[name]
    if not np.isfinite(values).all():
        return RecordedDrive(None, trouble=f"column {name} has gaps", named=True)
    motion = motion_of(record, name) if _travels(values) else None
    if motion is None:
        return RecordedDrive(None, trouble=f"column {name} stands still", named=True, stands=True)
    if len(motion.pieces) > MOST:
        return RecordedDrive(
            None, trouble=f"column {name} has {len(motion.pieces)} pieces, more than {MOST}", named=True
        )
    if not _even(record.time, values, motion):
        rate = _rate(record.time, values)
        if rate is not None:
            return RecordedDrive(((0.0, rate),), f"from the slope of column {name}", named=True)
        return RecordedDrive(
            None, trouble=f"column {name} does not move evenly between its turns and rests", named=True
        )
    speeds = evened([piece.speed for piece in motion.pieces])
    pairs = [(piece.time, speed) for piece, speed in zip(motion.pieces, speeds, strict=True)]
    kept = [(0.0, pairs[0][1])]
    kept += [b for a, b in pairwise(pairs) if a[1] != b[1]]
    return RecordedDrive(_one_way(tuple(kept)), f"from the slope of column {name}", named=True)


def _even(time: Array, position: Array, motion: Motion) -> bool:
    """Whether every stretch moves at one speed: its halves do."""
    fast = max(abs(piece.speed) for piece in motion.pieces)
    noise = float(np.median(np.abs(np.diff(position, 2)))) / 1.65
    for piece in motion.pieces:
        inset = (piece.stop - piece.start) // 10
        first, last = piece.start + inset, piece.stop - inset
        half = (last - first) // 2
        if half < HALF:
            continue
        a, b = (float(np.polyfit(time[i : i + half], position[i : i + half], 1)[0]) for i in (first, last - half))
        error = noise * float(np.sqrt(24.0 / half)) / float(time[first + half] - time[first])
        if abs(a - b) > EVEN * max(abs(piece.speed), EVEN * fast) + 4.0 * error:
            return False
    return True


def _travels(position: Array) -> bool:
    return bool(np.all(np.isfinite(position)) and np.ptp(position) > ROUNDED * np.max(np.abs(position)))


def _rate(time: Array, position: Array) -> float | None:
    """The speed [m/s] of a position that moves evenly throughout; None where it does not."""
    rate, start = np.polyfit(time, position, 1)
    return abs(float(rate)) if np.std(position - (start + rate * time)) < STEADY * np.std(position) else None


def _unused(record: Record) -> str:
    """Why the columns that are there tell no drive: what they would need."""
    for name, unit in record.channel_units.items():
        if unit not in ("m/s", "m") and _key(name) in (*SPEED_NAMES, *AXES):
            return (
                f"column {_shown(name)} is there and unused, because no unit of speed stands beside it; if it is the "
                f'drive: --columns "drive_speed={_shown(name)}" --units drive_speed=mm/s'
            )
    for name, unit in record.channel_units.items():
        if unit == "m/s":
            return (
                f"column {name} is there and unused, because its name does not say that it is the drive; if it is: "
                f'--columns "drive_speed={name}"'
            )
    return UNTOLD


# What the column of a log says against the drive that the scene states: a warning.

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
    told = recorded_drive(record, stiffness, entry.window)
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


def _changes(entry: LogEntry, stated: float, record: Record, told: RecordedDrive) -> str | None:
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


def _apart(entry: LogEntry, stated: DriveSpeed, record: Record, told: RecordedDrive) -> str | None:
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
