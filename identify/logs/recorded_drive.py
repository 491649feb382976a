"""What a log shows of its drive: a speed or a programme of speeds, from which column, or why none."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import true_runs
from data_io.columns import DISTANCES
from data_io.derived_columns import StatedVelocity, stated_velocity
from data_io.drive import MOST, SAME, Motion, Programme, SpeedSteps, evened, motion_of, steps_of
from data_io.record import WINDOW_START, within
from data_io.values import Finding
from identify.base.wording import speed_text
from identify.logs.strokes import DriveCourse
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
DISAGREES = "drive_speed_disagrees"  # the code of the finding
EVEN, HALF = 0.05, 20  # share by which the halves of an even stretch may differ, and their rows at least
ROUNDED = 1e-9  # of its values: a position that varies by less stands still
AGREES = 0.1  # share by which a column and a stated velocity may differ
APART = 0.02  # share of the larger by which a stated and a recorded speed contradict each other
STEPS_APART = (10, 0.1)  # rows, and share of the shortest piece, by which their steps may be apart


@dataclass(frozen=True)
class RecordedDrive:
    """programme: ((start [s], speed [m/s]), ...), one pair where it is one speed, which then is positive; None where
    the log shows none. source: where it stands, in words; trouble: where it is None, why, in words; named: the name of
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
        """The one speed [m/s]; None where it changes or is not known."""
        return self.programme[0][1] if self.programme is not None and len(self.programme) == 1 else None


def recorded_drive(record: Record, window: tuple[float, float] | None = None) -> RecordedDrive:
    """What a record shows of its drive.

    A drive speed of the record counts first, then a column with a unit of speed or of length whose name says that it
    is the drive; where there is none, any other that moves as fast as the head of the log states.

    Args:
        window: the part [s] that is used, None for all of it.
    """
    if window is not None:
        first, last = np.searchsorted(record.time, window[0]), np.searchsorted(record.time, window[1], side="right")
        if last - first < 2:
            return recorded_drive(record)  # such a window is refused elsewhere
        begin, start = float(record.metadata.get(WINDOW_START, 0.0)), float(record.time[first])
        drive = recorded_drive(within(record, (window[0] + begin, window[1] + begin)))
        pairs = None if drive.programme is None else tuple((t + start if t else 0.0, v) for t, v in drive.programme)
        return replace(drive, programme=pairs)
    if isinstance(record.drive_speed, np.ndarray):
        return _of_steps(steps_of(record.time, record.drive_speed), "drive_speed", "as the log says")
    if record.drive_speed is not None:
        speed = abs(float(record.drive_speed))
        pairs = ((0.0, speed),) if speed else None
        return RecordedDrive(pairs, "as the log says", "it is 0 in the log", True, not speed)
    speeds, positions = _named(record, "m/s", SPEED_NAMES), _named(record, "m", POSITION_NAMES)
    tried = [*(_of_speed(record, name) for name in speeds), *(_of_position(record, name) for name in positions)]
    if tried:
        fallback = RecordedDrive(
            None, trouble="; ".join(d.trouble for d in tried), stands=bool(speeds) and all(d.stands for d in tried)
        )
        return next((drive for drive in tried if drive.programme is not None), fallback)
    head = velocity_in_head(record)
    for name, unit in sorted(_moving(record), key=lambda pair: pair[1] != "m/s"):
        if head is not None and _as_fast_as_the_head(record, name, head):
            drive = _of_speed(record, name) if unit == "m/s" else _of_position(record, name)
            return replace(drive, source=f"{drive.source}, which moves as fast as the head of the log says")
    stated = [str(step.parameters.get("Velocity", "")).strip() for step in record.steps]
    if stated and all(re.fullmatch(r"[+-]?0+(\.0*)?", text) for text in stated):
        return RecordedDrive(None, trouble="the head of the log says Velocity = 0", stands=True)
    return RecordedDrive(None, trouble=_unused(record))


def drive_of(record: Record, drive: RecordedDrive) -> DriveCourse:
    """The drive that the strokes of a record are cut by: what a column of it surely says; None where none does."""
    if record.drive_speed is not None and not isinstance(record.drive_speed, np.ndarray):
        return record.drive_speed
    if drive.programme is None or not drive.named:
        return None
    speeds = [speed for _, speed in drive.programme]
    if min(speeds) < 0.0 < max(speeds):  # its rests are part of a stroke, and the force turns later than the drive
        return float(np.median(np.abs([speed for speed in speeds if speed])))
    return drive.speed if drive.speed is not None else drive.programme


def drive_position(record: Record) -> str | None:
    """The column in metres that is the position of the drive: by its name, or as the head of the log states; None where
    none is known to be."""
    named, head = _named(record, "m", POSITION_NAMES), velocity_in_head(record)
    if named or head is None:
        return named[0] if named else None
    moving = (name for name, unit in _moving(record) if unit == "m")
    return next((name for name in moving if _as_fast_as_the_head(record, name, head)), None)


def speed_of(record: Record) -> Array | None:
    """How fast the drive moves in every row [m/s], (n,), from a column that is known to be the drive; None where none
    is."""
    if isinstance(record.drive_speed, np.ndarray):
        return np.abs(record.drive_speed)
    for name in _named(record, "m/s", SPEED_NAMES):
        if np.isfinite(record.channels[name]).all() and np.any(record.channels[name]):
            return np.abs(record.channels[name])
    position = drive_position(record)
    return None if position is None or not _travels(record.channels[position]) else np.abs(_speed(record, position))


# Columns by their names.


def _shown(name: str) -> str:
    """A column as the file calls it: one that has the name of a role was numbered when it was read."""
    return re.sub(r"^(drive_speed) \(\d+\)$", r"\1", name)


def _key(name: str) -> str:
    return re.sub(r"[\W_]+", "", _shown(name).casefold())


def _named(record: Record, unit: str, names: Sequence[str]) -> list[str]:
    """The channels of a unit whose names say that they are the drive, the clearest first."""
    matching = [name for name, own in record.channel_units.items() if own == unit and _key(name) in names]
    return sorted(matching, key=lambda name: names.index(_key(name)))


def _unused(record: Record) -> str:
    """Why the columns that are in the log show no drive: what they would need."""
    for name, unit in record.channel_units.items():
        if unit not in ("m/s", "m") and _key(name) in (*SPEED_NAMES, *AXES):
            return (
                f"column {_shown(name)} is there and unused, because no unit of speed stands beside it; if it is the "
                f'drive: --columns "drive_speed={_shown(name)}" --units drive_speed=mm/s'
            )
    for name, unit in sorted(_moving(record), key=lambda pair: pair[1] != "m/s"):
        role = "drive_speed" if unit == "m/s" else "position"
        return (
            f"column {_shown(name)} is not taken for the drive, because neither its name nor the head of the log says "
            f'so; if it is: --columns "{role}={_shown(name)}"'
        )
    return UNTOLD


# A speed or a position as a programme.


def _of_speed(record: Record, name: str) -> RecordedDrive:
    return _of_steps(steps_of(record.time, record.channels[name]), _shown(name), f"from column {_shown(name)}")


def _of_steps(steps: SpeedSteps, name: str, source: str) -> RecordedDrive:
    if steps.programme is None:
        return RecordedDrive(None, trouble=f"column {name} {steps.trouble}", named=True, stands=steps.stands)
    return RecordedDrive(_one_way(steps.programme), source, named=True)


def _one_way(programme: Programme) -> Programme:
    """A programme that never goes forth is one that never goes back: the sign of a column is a choice."""
    if max(speed for _, speed in programme) > 0.0:
        return programme
    return tuple((start, abs(speed)) for start, speed in programme)


def _of_position(record: Record, name: str) -> RecordedDrive:
    """What a position shows: pieces of even speed."""
    values, source = record.channels[name], f"from the slope of column {name}"
    motion = motion_of(record, name) if _travels(values) else None
    if not np.isfinite(values).all():
        return RecordedDrive(None, trouble=f"column {name} has gaps", named=True)
    if motion is None:
        return RecordedDrive(None, trouble=f"column {name} stands still", named=True, stands=True)
    if len(motion.pieces) > MOST:
        trouble = f"column {name} has {len(motion.pieces)} pieces, more than {MOST}"
        return RecordedDrive(None, trouble=trouble, named=True)
    if _even(record.time, values, motion):
        speeds = evened([piece.speed for piece in motion.pieces])
        pairs = [(piece.time, speed) for piece, speed in zip(motion.pieces, speeds, strict=True)]
        pairs = [(0.0, pairs[0][1]), *(b for a, b in pairwise(pairs) if a[1] != b[1])]
        return RecordedDrive(_one_way(tuple(pairs)), source, named=True)
    rate, start = np.polyfit(record.time, values, 1)
    if np.std(values - (start + rate * record.time)) < 0.02 * np.std(values):
        return RecordedDrive(((0.0, abs(float(rate))),), source, named=True)
    return RecordedDrive(None, trouble=f"column {name} does not move evenly between its turns and rests", named=True)


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


# Columns by their motion, and the velocity that the head of a log states.


def _moving(record: Record) -> Iterator[tuple[str, str]]:
    """Name and unit of the columns in m or m/s, without gaps, that move at all."""
    for name, unit in record.channel_units.items():
        values = record.channels[name]
        if (unit == "m" and _travels(values)) or (unit == "m/s" and np.isfinite(values).all() and np.any(values)):
            yield name, unit


def _speed(record: Record, name: str, wider: int = 1) -> Array:
    """The speed that a column means, row by row (n,) [m/s], signed; of a position over so many times the usual rows."""
    values = record.channels[name]
    if record.channel_units[name] == "m/s":
        return values
    reach = wider * max(len(record) // 1000, 2)
    index = np.arange(len(record))
    low, high = np.maximum(index - reach, 0), np.minimum(index + reach, len(record) - 1)
    return np.asarray((values[high] - values[low]) / (record.time[high] - record.time[low]))


def _as_fast_as_the_head(record: Record, name: str, head: StatedVelocity) -> bool:
    """Whether a column moves as fast as the head of the log states: only such a one, or one by its name, is the drive;
    others are carriages, radii or wear."""
    meant = (*head.speeds.values(), 1e-3 * abs(head.value))  # a column shows it where the head is in mm/s
    # A speed is the same over twice as many rows; the differences of noise are half as fast.
    usual = [_usual(_speed(record, name, wider)) for wider in (1, 2)]
    return any(all(abs(one / own - 1.0) < AGREES for one in usual) for own in meant)


def _usual(speed: Array) -> float:
    """Median size [m/s] of a speed where it moves, 0 where it stands."""
    size = np.abs(speed)
    moving = size > 0.05 * float(np.quantile(size, 0.9))
    return float(np.median(size[moving])) if moving.any() else 0.0


def velocity_in_head(record: Record) -> StatedVelocity | None:
    """The velocity that the steps of a record state, where all state one; a step that states 0 stands."""
    stated = [stated_velocity(step.parameters, record.metadata, record.channel_units) for step in record.steps]
    moving = [own for own in stated if own is not None]
    return moving[0] if len({own.value for own in moving}) == 1 else None


def velocity_text(stated: StatedVelocity) -> str:
    """A stated velocity and what it would mean, in words."""
    meant = {"linear": "mm/min", "rotary": "rpm"}
    known = {module: own for module, own in stated.speeds.items() if stated.module in (None, module)} or stated.speeds
    words = " or ".join(f"{speed_text(own)} if in {meant[module]}" for module, own in known.items())
    return f"Velocity = {stated.value:g} without a unit: {words}"


# What the column of a log says against the drive that the scene states: a warning.


def with_drive_checked(scene: Scene, entry: LogEntry, record: Record) -> Record:
    """A record, with a warning where the drive of the scene and that of its column, or the head of its file, contradict
    each other. What the scene states is doubted, never overruled."""
    rig = scene.rig_for(entry)
    stated = rig.drive_speed
    if stated is None or record.time.size < 2 or any(finding.code == DISAGREES for finding in record.findings):
        return record
    drive = recorded_drive(record, entry.window)
    if drive.named and drive.programme is not None:
        text = _differs(entry, stated, record, drive)
    else:
        head, text = velocity_in_head(record), None
        if head is not None and not isinstance(stated, tuple) and not _agrees(stated, head):
            text = (
                f"the scene has a drive speed of {speed_text(stated)}, but the head of the log says "
                f"{velocity_text(head)}; check drive_speed"
            )
    return record if text is None else replace(record, findings=(*record.findings, Finding(DISAGREES, "warning", text)))


def _agrees(speed: float, head: StatedVelocity) -> bool:
    return any(abs(abs(speed) / own - 1.0) < AGREES for own in head.speeds.values())


def _differs(entry: LogEntry, stated: DriveSpeed, record: Record, recorded: RecordedDrive) -> str | None:
    """Where a stated drive and that of the column differ for longer than steps may be apart, in a sentence."""
    time = record.time
    used = np.ones(time.size, dtype=bool)
    for first, last in [entry.window] if entry.window else []:
        used &= (time >= first) & (time <= last)
    for first, last in entry.exclude:
        used &= (time < first) | (time > last)
    time = time[used]
    if not time.size:
        return None
    drives = [Drive.of(stated), Drive.of(recorded.programme or stated)]
    pieces = [np.clip(np.searchsorted(drive.starts, time, side="right") - 1, 0, None) for drive in drives]
    meant, seen = (np.abs(np.array(drive.speeds))[piece] for drive, piece in zip(drives, pieces, strict=True))
    larger = np.maximum(meant, seen)
    wrong = np.abs(meant - seen) > APART * np.maximum(larger, SAME * larger.max())
    moves = np.flatnonzero(seen)
    if drives[0].constant and moves.size:  # one speed says nothing of rests before and after, or between strokes
        turns = min(drives[1].speeds) < 0.0 < max(drives[1].speeds)
        wrong &= (seen > 0.0) if turns else (time >= time[moves[0]]) & (time <= time[moves[-1]])
    first, stop = max(true_runs(wrong).tolist(), key=lambda run: run[1] - run[0], default=(0, 0))
    shortest = min(int(np.min(np.unique(piece, return_counts=True)[1])) for piece in pieces)
    if stop - first <= max(STEPS_APART[0], STEPS_APART[1] * shortest):
        return None
    return (
        f"the scene has a drive speed of {speed_text(float(meant[first]))} at {time[first]:.4g} s, but "
        f"{recorded.place} says {speed_text(float(seen[first]))} there, and they differ for "
        f"{time[stop - 1] - time[first]:.3g} s; correct drive_speed, leave it out to take "
        "that of the log, or give a window"
    )
