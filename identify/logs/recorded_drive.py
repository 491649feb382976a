"""The drive of a log: what its columns and its head show of it, against what is stated; and the strokes it makes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import thinned, true_runs
from data_io.columns import DISTANCES
from data_io.derived_columns import StatedVelocity, stated_velocity
from data_io.drive import MOST, SAME, Motion, Programme, even, evened, motion_of
from data_io.quality import pauses
from data_io.values import Finding
from identify.base.wording import speed_text
from identify.logs.log_data import WORTH
from identify.logs.noise import FEWEST_ROWS, bridged, smooth, white_noise
from identify.scene import Scene
from identify.scene.tables import Course
from identify.scene.values import LogEntry
from identify.simulation.drive import Drive

Array = NDArray[np.float64]
DriveCourse = float | Sequence[tuple[float, float]] | Course | None

SPEED_NAMES = (
    "drivespeed", "drivevelocity", "stagespeed", "stagevelocity", "slidingspeed", "slidingvelocity", "linearspeed",
    "linearvelocity", "geschwindigkeit", "gleitgeschwindigkeit", "velocity", "speed",
)  # fmt: skip
POSITION_NAMES = ("stageposition", "driveposition", "position", "pos", *DISTANCES)
AXES = ("v", "v1", "v2", "v3", "vx", "vy", "vz", "x", "y", "z")  # of carriages: any of them may be the drive, or none
# A speed in a file name or a comment: 0.1_mm_per_s, 5mm-s, 42 um/s. Metres are left out: 5ms is a time.
SPEED_TEXT = re.compile(
    r"(?<![\d.])(\d+(?:\.\d+)?)[ _-]*(mm|cm|[uµμ]m|nm)[ _-]*(?:/|per|p)?[ _-]*(s|min)(?![a-z])", re.IGNORECASE
)
NOT_STATED = "it is not stated in the log"
DISAGREES = "drive_speed_disagrees"  # the code of the finding
APART = 0.02  # share of the larger by which a stated and a recorded speed contradict each other
LEAST_SHARE = 0.1  # of the samples: a sign of the force that holds for fewer is no stroke of its own
CLEAR = 0.3  # of the typical force: what counts as a sign
ALIKE = 1.5  # times: strokes rub to both sides by about as much; a force that swings through zero does not
FEW, ALIKE_FEW = 8, 3.0  # changes of sign up to which no oscillation makes them, and strokes may differ by running-in
LEVEL_SHARE = 0.65  # of the rows of strokes, in which the force is more than half of the highest of its stroke
RESOLVED = 0.5  # of the rows of a column, from which on it changes in each as a rule
FLICKER = 0.1  # of the steps of a column that go back: more are noise
SLOWEST = 0.05  # of the median speed of a column: how fast it is taken for at least where it turns
FEW_PIECES, BETTER = 2, 4.0  # pieces that are no course; times the squares that a course leaves of a motion
ENOUGH = 20_000  # rows that a course is seen from
SHARES = (3.0, 2.0, 1.5, 1.25, 1.1, 1.0, 0.95)  # of the noise, to which knots are added
UNDESCRIBED = 20.0  # times its noise that a course may be off its column
HELD = 0.8  # of the level of a stroke, that its force has until the drive turns


@dataclass(frozen=True)
class RecordedDrive:
    """programme: ((start [s], speed [m/s]), ...), one pair where it is one speed, which then is positive; None where
    the log shows none. source: where it stands, in words; trouble: where it is None, why, in words; stands: a column of
    the drive, or the head of the log, says that it does not move; course: where its speed changes gradually."""

    programme: Programme | None
    source: str = ""
    trouble: str = ""
    stands: bool = False
    course: Course | None = None

    @property
    def place(self) -> str:
        """Where it stands, as a noun."""
        return self.source.removeprefix("from ") if self.source.startswith("from ") else "the drive speed of the log"

    @property
    def speed(self) -> float | None:
        """The one speed [m/s]; None where it changes or is not known."""
        return self.programme[0][1] if self.programme is not None and len(self.programme) == 1 else None


def recorded_drive(record: Record) -> RecordedDrive:
    """What a record shows of its drive: its drive speed, else a column of speed or position whose name says so, else
    one that moves as fast as the head of the log states: others are carriages, radii or wear."""
    if isinstance(record.drive_speed, np.ndarray):
        return replace(_of_column(record, "drive_speed"), source="as stated in the log")
    if record.drive_speed is not None:
        speed = abs(float(record.drive_speed))
        pairs = ((0.0, speed),) if speed else None
        return RecordedDrive(pairs, "as stated in the log", "it is 0 in the log", not speed)
    speeds = _named(record, "m/s", SPEED_NAMES)
    tried = [_of_column(record, name) for name in (*speeds, *_named(record, "m", POSITION_NAMES))]
    if tried:
        trouble, stands = "; ".join(d.trouble for d in tried), bool(speeds) and all(d.stands for d in tried)
        shown = (drive for drive in tried if drive.programme is not None or drive.course is not None)
        return next(shown, RecordedDrive(None, trouble=trouble, stands=stands))
    if (name := _as_fast_as_the_head(record, ("m/s", "m"))) is not None:
        drive = _of_column(record, name)
        return replace(drive, source=f"{drive.source}, which moves as fast as the header of the log states")
    stated = [str(step.parameters.get("Velocity", "")).strip() for step in record.steps]
    if stated and all(re.fullmatch(r"[+-]?0+(\.0*)?", text) for text in stated):
        return RecordedDrive(None, trouble="the header of the log states Velocity = 0", stands=True)
    return RecordedDrive(None, trouble=_unused(record))


def speed_in(text: str) -> str:
    """The one drive speed that a file name or a comment mentions, as in "0.1 mm/s"; "" where it mentions none or
    several."""
    found = {f"{number} {unit.lower()}/{per.lower()}" for number, unit, per in SPEED_TEXT.findall(text)}
    return found.pop() if len(found) == 1 else ""


def mentioned_speed(record: Record, name: str) -> tuple[str, str]:
    """The one drive speed that the file name of a log, else its header or comments mention, and where: "file name" or
    "comment"; two empty texts where none does."""
    comments = [record.metadata.get("preamble", ""), *(v for step in record.steps for v in step.parameters.values())]
    places = ((name, "file name"), ("; ".join(map(str, comments)), "comment"))
    return next(((speed, place) for text, place in places if (speed := speed_in(text))), ("", ""))


def drive_of(record: Record, drive: RecordedDrive) -> DriveCourse:
    """The drive that the strokes of a record are cut by; None where none is recorded."""
    if record.drive_speed is not None and not isinstance(record.drive_speed, np.ndarray):
        return record.drive_speed
    if drive.programme is None:
        return drive.course
    speeds = [speed for _, speed in drive.programme]
    if min(speeds) < 0.0 < max(speeds):  # its rests are part of a stroke, and the force turns later than the drive
        return float(np.median(np.abs([speed for speed in speeds if speed])))
    return drive.speed if drive.speed is not None else drive.programme


def drive_position(record: Record) -> str | None:
    """The column in metres that is the position of the drive, by its name, or by the head of the log; else None."""
    return next(iter(_named(record, "m", POSITION_NAMES)), None) or _as_fast_as_the_head(record, ("m",))


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
    index, reach, values = np.arange(len(record)), max(len(record) // 1000, 2), record.channels[position]
    low, high = np.maximum(index - reach, 0), np.minimum(index + reach, len(record) - 1)
    return np.abs((values[high] - values[low]) / (record.time[high] - record.time[low]))


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
    for role, unit in (("drive_speed", "m/s"), ("position", "m")):
        for name in (name for name, own in record.channel_units.items() if own == unit):
            values = record.channels[name]
            if _travels(values) or (unit == "m/s" and np.isfinite(values).all() and np.any(values)):
                return (
                    f"column {_shown(name)} is not taken for the drive, because neither its name nor the header "
                    f'of the log states so; if it is: --columns "{role}={_shown(name)}"'
                )
    return NOT_STATED


def _as_fast_as_the_head(record: Record, units: Sequence[str]) -> str | None:
    """The column of one of these units that moves as fast as the head of the log states; None where none does."""
    head = velocity_in_head(record)
    meant = () if head is None else (*head.speeds.values(), 1e-3 * abs(head.value))  # a column shows it in mm/s
    for name in (name for unit in units if meant for name, own in record.channel_units.items() if own == unit):
        motion = motion_of(record, name)
        speeds = [abs(piece.speed) for piece in motion.pieces if piece.speed] if motion and even(motion) else []
        if speeds and any(abs(float(np.median(speeds)) / own - 1.0) < 0.1 for own in meant):
            return name
    return None


# A speed or a position as a programme.


def _of_column(record: Record, name: str) -> RecordedDrive:
    """What a column of speed shows, or one of position: pieces of even speed."""
    shown, values = _shown(name), record.columns()[name]
    source = f"from {'the slope of ' if record.units()[name] == 'm' else ''}column {shown}"
    if np.count_nonzero(np.isfinite(values)) < 0.9 * values.size:
        return RecordedDrive(None, trouble=f"column {shown} has gaps")
    motion = motion_of(record, name)
    if motion is None:
        return RecordedDrive(None, trouble=f"column {shown} stands still", stands=True)
    course = None
    if len(motion.pieces) > MOST:
        trouble = f"column {shown} has {len(motion.pieces)} pieces, more than {MOST}"
    elif not even(motion):
        trouble = f"column {shown} does not move evenly between its turns and rests"
    elif (course := _smoother(record, motion, values, record.units()[name] == "m")) is not None:
        trouble = f"column {shown} changes its speed gradually"
    else:
        speeds = evened([piece.speed for piece in motion.pieces])
        pairs = [(piece.time, speed) for piece, speed in zip(motion.pieces, speeds, strict=True)]
        pairs = [(0.0, pairs[0][1]), *(b for a, b in pairwise(pairs) if a[1] != b[1])]
        if max(speeds) <= 0.0:  # never forth: the sign of a column is a choice
            pairs = [(start, abs(speed)) for start, speed in pairs]
        return RecordedDrive(tuple(pairs), source)
    rate, start = np.polyfit(record.time, motion.position, 1)
    if np.std(motion.position - (start + rate * record.time)) < 0.02 * np.std(motion.position):
        return RecordedDrive(((0.0, abs(float(rate))),), source)
    course = course or _course_of(record.time, values, record.units()[name] == "m")
    return RecordedDrive(None, source, trouble, course=course)


def _smoother(record: Record, motion: Motion, values: Array, position: bool) -> Course | None:
    """The course behind a column (n,), where it describes a motion of several pieces clearly better than these do."""
    course = _course_of(record.time, values, position) if len(motion.pieces) > FEW_PIECES else None
    if course is None:
        return None
    left = 0.0
    for piece in motion.pieces:
        t, x = (each[piece.start : piece.stop] for each in (motion.time, motion.position))
        left += float(np.sum((x - np.polyval(np.polyfit(t, x, min(t.size - 1, 1)), t)) ** 2))
    off = motion.position - Drive.of(course, float(record.time[-1])).motion(record.time)[0]
    return course if left > BETTER * float(np.sum((off - off.mean()) ** 2)) else None


def _course_of(time: Array, values: Array, position: bool) -> Course | None:
    """The course behind a column (n,) of position [m] or speed [m/s]: a speed that is straight from knot to knot, by
    least squares. Knots come where the column asks for them (P. Dierckx, Curve and Surface Fitting with Splines, 1993),
    as many as the best information criterion has. Where a column moves by steps of its resolution it is known in their
    middles, where it changes, and as exactly as the rows resolve how fast it then is. None where a spline does not
    describe it."""
    rows = np.flatnonzero(np.isfinite(values))
    t, x = time[rows], values[rows]
    changes = np.flatnonzero(np.diff(x))
    steps = np.diff(x)[changes]
    if changes.size < RESOLVED * x.size and np.mean(steps[1:] * steps[:-1] < 0.0) < FLICKER and steps.size > 1:
        interval = float(np.median(np.diff(t)))  # by which the time of a change is unsure
        t, x = 0.5 * (t[changes] + t[changes + 1]), 0.5 * (x[changes] + x[changes + 1])
        speeds = np.abs(np.gradient(x, t))
        sd = np.maximum(speeds, SLOWEST * np.median(speeds)) * interval / np.sqrt(12.0)
    else:
        sd = np.full(x.size, white_noise(x))
    if t.size < FEWEST_ROWS:
        return None
    t, x, sd = (each[:: t.size // ENOUGH + 1] for each in (t, x, np.maximum(sd, 1e-5 * float(np.ptp(x)))))
    degree, best, lowest = 2 if position else 1, None, np.inf
    for share in SHARES:
        # with its full output it returns what it has to say of a close fit, and warns nobody
        (knots, *_), *_ = scipy.interpolate.splrep(t, x, w=1.0 / sd, k=degree, s=share * t.size, full_output=1, quiet=1)
        spline = scipy.interpolate.make_lsq_spline(t, x, knots, k=degree, w=1.0 / sd)
        left = float(np.sum(((x - spline(t)) / sd) ** 2))
        if left + WORTH * knots.size < lowest:
            best, lowest = spline, left + WORTH * knots.size
    if best is None or lowest > UNDESCRIBED * t.size:
        return None
    edges = np.unique(best.t)
    speeds = best.derivative()(edges) if position else best(edges)
    pairs = [(0.0, float(speeds[0])), *zip(edges.tolist(), speeds.tolist(), strict=True)]
    return Course(ramps=tuple(pairs if edges[0] > 0.0 else pairs[1:]))


def _travels(position: Array) -> bool:
    return bool(np.all(np.isfinite(position)) and np.ptp(position) > 1e-9 * np.max(np.abs(position)))


# The velocity that the head of a log states, and the drive that the scene states: a warning where they differ.


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


def with_drive_checked(scene: Scene, entry: LogEntry, record: Record) -> Record:
    """A record, with a warning where the drive of the scene and that of its column, or the head of its file, contradict
    each other for longer than steps may be apart. What the scene states is doubted, never overruled."""
    stated, time = scene.rig_for(entry).drive_speed, record.time
    start, end = entry.window or (0.0, float(time[-1]))
    time = time[(time >= start) & (time <= end)]
    for begin, until in entry.exclude:
        time = time[(time < begin) | (time > until)]
    if (
        stated is None
        or isinstance(stated, Course)
        or time.size < 2
        or any(finding.code == DISAGREES for finding in record.findings)
    ):
        return record
    recorded, head = recorded_drive(record), velocity_in_head(record)
    if recorded.programme is not None:
        drives = [Drive.of(stated), Drive.of(recorded.programme)]
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
        if stop - first <= max(10, 0.1 * shortest):
            return record
        text = (
            f"the scene has a drive speed of {speed_text(float(meant[first]))} at {time[first]:.4g} s, but "
            f"{recorded.place} is {speed_text(float(seen[first]))} there, and they differ for "
            f"{time[stop - 1] - time[first]:.3g} s; correct drive_speed, leave it out to take "
            "that of the log, or give a window"
        )
    elif (
        head is None
        or isinstance(stated, tuple)
        or any(abs(abs(stated) / own - 1.0) < 0.1 for own in head.speeds.values())
    ):
        return record
    else:
        text = (
            f"the scene has a drive speed of {speed_text(stated)}, but the header of the log states "
            f"{velocity_text(head)}; check drive_speed"
        )
    return replace(record, findings=(*record.findings, Finding(DISAGREES, "warning", text)))


# Strokes: parts of a record that a tribologist tabulates apart.


@dataclass(frozen=True)
class Stroke:
    """Rows [start, stop) of one step in which the drive goes one way; direction is +1 or -1 in the file's sign of
    the friction force; speed [m/s] > 0, None where it is unknown or not constant."""

    run: int
    step: int
    number: int
    start: int
    stop: int
    direction: int
    speed: float | None


def strokes(record: Record, drive: DriveCourse) -> tuple[Stroke, ...]:
    """The strokes of every step of a record.

    Args:
        record: the log; without steps it is one step.
        drive: [m/s], a programme ((start [s], speed), ...), or None where unknown. A drive that changes its speed by a
            programme begins a new stroke, and standstill is none; without one a lasting change of the sign of the
            force does. A course turns where its speed changes its sign. A pause of the recording ends a stroke.
    """
    speed, starts, speeds = None, np.empty(0), np.empty(0)
    if isinstance(drive, int | float):
        speed = abs(float(drive)) if 0.0 < abs(drive) < np.inf else None
    elif isinstance(drive, Course):
        times, paces = np.array([pair for pair in drive.ramps if pair[1]], dtype=np.float64).T
        (turns,) = np.nonzero(np.diff(np.sign(paces)))
        ahead = paces[turns] / (paces[turns] - paces[turns + 1])
        starts = np.append(-np.inf, times[turns] + ahead * np.diff(times)[turns])
    elif drive is not None:
        starts, speeds = np.array(drive, dtype=np.float64).T
    out = []
    for run, step, start, stop in [(s.run, s.number, s.start, s.stop) for s in record.steps] or [
        (1, 1, 0, len(record))
    ]:
        force, edges = record.friction_force[start:stop], []
        for first, last in pairwise([0, *(pauses(record.time[start:stop], force) + 1).tolist(), stop - start]):
            rows, part = slice(start + first, start + last), force[first:last]
            changes = np.searchsorted(record.time[rows], starts[1:]).tolist()
            changes = [0, *sorted({row for row in changes if 0 < row < part.size}), part.size]
            parts = turns_of_sign(part) if len(changes) == 2 else [(a, b, 0) for a, b in pairwise(changes)]
            edges += [(rows.start + a, rows.start + b, way) for a, b, way in parts if b > a]
        at = {a: max(int(np.searchsorted(starts, record.time[a], side="right")) - 1, 0) for a, _, _ in edges}
        moving = [own for own in edges if not speeds.size or speeds[at[own[0]]]]
        for number, (first, last, way) in enumerate(moving or edges, start=1):
            negative = np.count_nonzero(record.friction_force[first:last] < 0)  # about zero: as in the file
            finite = np.count_nonzero(np.isfinite(record.friction_force[first:last]))
            direction = way or (-1 if negative > LEVEL_SHARE * finite else 1)
            own = abs(float(speeds[at[first]])) or None if speeds.size else speed
            out.append(Stroke(run, step, number, first, last, direction, own))
    return tuple(out)


def turns_of_sign(force: Array) -> list[tuple[int, int, int]]:
    """First row, end and sign of every stretch in which a force (n,) keeps its sign, cut where it leaves its level.

    A force that changes its sign and rubs to both sides by about as much is that of a drive to and fro. How much it is
    smoothed goes by its noise, never by the length of the record. One stretch of sign 0 where it keeps its sign.
    """
    whole = [(0, force.size, 0)]
    finite = np.isfinite(force)
    if np.count_nonzero(finite) < FEWEST_ROWS:
        return whole
    filled = bridged(force, ~finite)
    typical = float(np.quantile(np.abs(thinned(filled)), 0.9))
    up, down = (side[side > CLEAR * typical] for side in (filled, -filled))
    if min(up.size, down.size) < LEAST_SHARE * filled.size:
        return whole
    # averaged until the noise is a tenth of the force
    slow = smooth(filled, int(np.clip((white_noise(filled) / (0.1 * typical)) ** 2, 1, max(force.size // 20, 1))) | 1)
    decided = np.flatnonzero(np.abs(slow) > CLEAR * typical)
    sign = np.sign(slow[decided]).astype(int)
    changes = np.flatnonzero(sign[1:] != sign[:-1])
    ratio, alike = float(np.median(up)) / float(np.median(down)), ALIKE if changes.size > FEW else ALIKE_FEW
    if not changes.size or not 1.0 / alike < ratio < alike:
        return whole
    starts = [0]
    for i in changes.tolist():
        last, direction = int(decided[i]), sign[i]
        own = direction * slow[(starts[-1] + last) // 2 : last + 1]
        held = np.flatnonzero(own >= HELD * float(np.median(own)))
        starts.append(last + 1 - own.size + int(held[-1]) + 1 if held.size else last + 1)
    edges = list(pairwise([*starts, force.size]))
    sizes = [np.abs(slow[a:b]) for a, b in edges if b > a]
    if sum(np.count_nonzero(size > 0.5 * np.quantile(size, 0.9)) for size in sizes) < LEVEL_SHARE * force.size:
        return whole  # a force that crosses zero on its way up and down rubs at no level to either side
    ways = [int(sign[0]), *(int(sign[i + 1]) for i in changes)]
    return [(a, b, direction) for (a, b), direction in zip(edges, ways, strict=True) if b > a]


def one_speed(speeds: Sequence[float] | Array) -> bool:
    """Whether speeds (n,) [m/s] that are not zero have one size."""
    sizes = np.abs(np.asarray(speeds, dtype=np.float64))
    return not sizes.size or bool(np.ptp(sizes) <= SAME * sizes.max())


def changes_speed(drive: DriveCourse) -> bool:
    """Whether a drive has several speeds, or stands between moving one way."""
    if drive is None or isinstance(drive, int | float | Course):
        return False
    speeds = np.trim_zeros(np.array([speed for _, speed in drive]))  # what it rests before and after is no change
    rests = speeds.size > 0 and bool(np.any(speeds == 0.0)) and not speeds.min() < 0.0 < speeds.max()
    return rests or not one_speed(speeds[speeds != 0.0])
