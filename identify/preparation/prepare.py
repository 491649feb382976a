"""From a record and its entry in the scene to what the estimator takes: sign, mask, window, loads, cycles."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.thinned import kept, shown, thinned
from identify.detection.judgement import Judgement, judge
from identify.detection.segment import Segmentation, segment
from identify.detection.slip_quality import Part
from identify.errors import FitError
from identify.motion.drive import Drive, NormalForce
from identify.preparation import window
from identify.preparation.cutting import Account, account, cut_and_correct, refuse_too_few
from identify.preparation.guess import LogData, Pull
from identify.preparation.loads import Course, as_far_as_told, as_modelled
from identify.preparation.manner import FEW, Manner, manner_of, moving_pieces
from identify.preparation.parting import name_of
from identify.preparation.unknowns import Unknowns
from identify.scene import Scene
from identify.scene.values import EACH_LOG, LogEntry, Rig

Array = NDArray[np.float64]

LAST_STICK = 0.5  # of a typical stick: how much of the last one is used, so that no slip has begun in it
REPEATABLE = 1e-4  # of the load: no contact repeats a slip better; a fit that believes it does has many false optima
SWINGS = 0.3  # times that: error of the load in fast rhythms from which on a slip has one of its own
LONGER = 1.5  # half periods that a slip takes, its slow beginning included
UNTOLD = Course(NormalForce.of(1.0))  # [N], of a rejected log whose normal force is none
UNEQUAL = 0.06  # scatter of the drop from cycle to cycle above which cycles are not alike
FED = 2.0  # times what the load does to the force at an onset: a slip that comes early finds a fresher contact


@dataclass(frozen=True)
class Prepared:
    """One log, ready to be fitted or left out.

    record; entry; rig of this log; sign applied to the friction force; force (n,) [N], sliding positive, tare
    taken off; used (n,) samples that may count; segmentation; data for the estimator; falls (c,) [s] of the
    cycles that are fitted; reason the log is left out, or None; noise_estimated: from the data, not given;
    account of what was cut and corrected, with the record as it was read; judgement: of the quality gate;
    hidden_swing: by how much the normal force varies beyond its noise where the model takes its mean (half its range,
    as a share); manner: how it moves; pieces: the stretches of a course of its own that are logs of constant speed.
    """

    record: Record
    entry: LogEntry
    rig: Rig
    sign: int
    force: Array
    used: NDArray[np.bool_]
    segmentation: Segmentation
    data: LogData
    falls: Array
    left_out: str | None
    noise_estimated: bool
    account: Account
    judgement: Judgement
    hidden_swing: float = 0.0
    manner: Manner = field(default_factory=lambda: Manner("cycles", None, False))
    pieces: tuple[Prepared, ...] = ()

    @property
    def as_course(self) -> Prepared:
        """The same log, to be followed by the model instead of cycle by cycle as they were seen."""
        return replace(self, manner=replace(self.manner, name="course", faint=False))

    @property
    def typical(self) -> int:
        """Number of cycles in the stretch that shows most of them."""
        if self.manner.name == "cycles":
            return int(self.falls.size)
        return max((piece.falls.size for piece in self.pieces), default=0)

    @property
    def name(self) -> str:
        """Short name of the log in sentences."""
        return name_of(self.entry)

    @property
    def never_slips(self) -> bool:
        """Whether the log is left out because no slip is seen in it, and for nothing else."""
        return self.left_out is not None and self.judgement.verdict != "reject" and self.segmentation.count == 0

    @cached_property
    def mean_load(self) -> float:
        """Mean of the measured normal force, all of it [N]."""
        load = self.record.normal_force
        return float(np.mean(kept(load, np.isfinite(load))))

    @property
    def scatter(self) -> float:
        """How much the force drop differs from one settled cycle to the next, as a share of the mean drop, beyond
        what the noise and the course of the normal force do; 0 with fewer than four cycles. A slow drift does not
        count."""
        cycles, load = self.segmentation.cycles, self.data.normal_force
        mean = float(np.mean(load.values))
        drop = cycles.onset_force * mean / load.at(cycles.onset) - cycles.arrest_force * mean / load.at(cycles.arrest)
        drop = drop[1:]
        if drop.size < 3 or self.manner.name != "cycles":
            return 0.0
        step = np.diff(drop) / np.sqrt(2.0)
        excess = float(1.4826 * np.median(np.abs(step))) ** 2 - (2.0 * self.data.noise) ** 2
        return float(np.sqrt(max(excess, 0.0)) / max(float(np.mean(drop)), 1e-300))

    @property
    def unlike(self) -> bool:
        """Whether cycles differ so among themselves that no model of equal friction describes them: more than a normal
        force that the model follows makes them differ."""
        if not self.scatter > UNEQUAL:
            return False
        cycles = self.segmentation.cycles
        load = self.data.normal_force.at(cycles.onset) / self.data.mean_normal_force
        swing = float(np.sqrt(np.mean(np.diff(load) ** 2) / 2.0) * np.mean(cycles.onset_force))
        return self.scatter > UNEQUAL + FED * swing / float(np.mean(cycles.onset_force - cycles.arrest_force))


def prepare(scene: Scene, entry: LogEntry, record: Record, unknowns: Unknowns) -> Prepared:
    """Cut, correct and segment one log.

    Raises:
        FitError: no drive speed, a drive that turns, or a log of which nothing is left.
        SceneError: an effect outside its measured range.
    """
    rig = scene.rig_for(entry)
    name = name_of(entry)
    drive = _drive(rig, entry, record, name)
    speed = max(drive.speeds)
    corrected = cut_and_correct(entry, record)
    raw, record = record, corrected.record
    force = np.asarray(record.friction_force, float)
    used = corrected.used & np.isfinite(force) & np.isfinite(record.normal_force)
    refuse_too_few(entry, record, used, name)
    sign = _sign(entry, kept(force, used))
    force = sign * force
    measured = shown(force, used)
    inside = np.flatnonzero(used)
    first, last = int(inside[0]), int(inside[-1]) + 1
    found = segment(record.time[first:last], measured[first:last], half_period=rig.half_period or None, noise=rig.noise)
    spikes = np.ones(record.time.size, bool)
    spikes[first:last] = found.spikes
    noise = rig.noise or found.noise
    sound = kept(force, used)
    floor = 1e-6 * float(max(sound.max(), -sound.min()))
    weight = np.where(used & ~spikes, 1.0 / max(noise, floor, 1e-12) ** 2, 0.0)
    falls = found.cycles.fall[entry.skip_cycles :]
    soft = "stiffness" in scene.parameters or "skin_compliance" in unknowns.model.effects
    expected = None if soft or not drive.constant else speed * rig.stiffness
    part = Part(record.time[first:last], measured[first:last], found, expected)
    judgement = judge(record, [part], scene.thresholds, used)
    inner = slice(first, last)
    half_period = rig.half_period or 0.0
    manner = manner_of(
        found, record.time[inner], measured[inner], falls, noise=noise, half_period=half_period, drive=drive
    )
    if manner.name == "cycles":
        begin, end = window.of_cycles(record.time[inner], measured[inner], found, noise, entry.skip_cycles)
    else:
        begin, end = window.of_a_course(record.time[inner], measured[inner], found, noise, manner, drive, half_period)
    reason = _rejected(judgement, name) or _reason(manner, falls, found.count, entry, name)
    try:
        course, hidden = as_modelled(
            record, used, (begin, end), follows=unknowns.model.follows_load, name=name, cycles=found.count
        )
    except FitError:
        if judgement.verdict != "reject":
            raise
        course, hidden = UNTOLD, 0.0  # the log is left out: nothing is computed with it
    else:
        programme = speed if drive.constant else tuple(zip(drive.starts, drive.speeds, strict=True))
        scene.check_ranges(entry, programme, (min(course.force.values), max(course.force.values)))
    repeatable = float(REPEATABLE * np.mean(course.force.values))
    load_sd = float(np.hypot(course.sd, repeatable))
    data = LogData(
        np.ascontiguousarray(record.time),
        np.where(np.isfinite(force), force, 0.0),
        weight,
        unknowns.base({"mass": rig.mass, "stiffness": rig.stiffness, "damping": rig.damping}),
        speed,
        course.force,
        load_sd,
        begin,
        end,
        np.full(len(unknowns.names), np.nan) if np.any(unknowns.grouped) else np.empty(0),
        tuple("" if by is None or by == EACH_LOG else entry.labels[by] for by in unknowns.per),
        None if drive.constant else drive,
        course.tremor_sd if course.tremor_sd > SWINGS * repeatable else 0.0,
        sd_course=_sd_over_time(course, repeatable),
        pull=_pull(found, course, rig, speed),
    )
    data = as_far_as_told(data)
    told = account(entry, raw, corrected, sign, float(record.time[first]), begin)
    counted = used & ~spikes
    estimated = rig.noise is None
    made = Prepared(
        record,
        entry,
        rig,
        sign,
        force,
        counted,
        found,
        data,
        falls,
        reason,
        estimated,
        told,
        judgement,
        hidden,
        manner,
    )
    return replace(made, pieces=_pieces(made, noise, half_period)) if manner.name == "course" else made


def _sd_over_time(course: Course, repeatable: float) -> NormalForce | None:
    """The error of a course where it is not the same throughout, with what no contact repeats."""
    known = course.sd_course
    return None if known is None else NormalForce.of((known.times, np.hypot(known.values, repeatable)))


def _pull(found: Segmentation, course: Course, rig: Rig, speed: float) -> Pull | None:
    """How the sticks load; None where no cycle was seen, or no mass is known."""
    if not found.count or found.stick_slope is None or not rig.half_period:
        return None
    rate = found.stick_slope[0]
    coefficient = float(np.median(found.cycles.onset_force)) / float(np.mean(course.force.values))
    if not (rate > 0.0 and coefficient > 0.0):
        return None
    # Rig and skin together are as soft as the sticks show.
    return Pull(coefficient, rate, LONGER * rig.half_period * float(np.sqrt(rig.stiffness * speed / rate)))


def _drive(rig: Rig, entry: LogEntry, record: Record, name: str) -> Drive:
    """How the drive goes while the record counts: one speed, or a programme that goes one way."""
    if rig.drive_speed is None:
        raise FitError(f'{name} has no drive speed; give drive_speed = "… mm/s" in its [[logs]] or under [rig]')
    whole = Drive.of(rig.drive_speed)
    start, stop = entry.window or (0.0, float(record.time[-1]))
    starts = [t for t in whole.starts if start < t < stop]
    speeds = [whole.at(max(start, 0.0)), *(whole.at(t) for t in starts)]
    if all(speed == 0.0 for speed in speeds):
        raise FitError(f"{name} has a drive speed of 0 m/s; expected a moving drive: a hold alone cannot be fitted")
    if min(speeds) < 0.0 < max(speeds):
        raise FitError(f"{name} has a drive that turns within the part that is used; cut it into one window per stroke")
    kept = [(0.0, abs(speeds[0]))]
    for t, speed in zip(starts, speeds[1:], strict=True):
        if abs(speed) != kept[-1][1]:
            kept.append((t, abs(speed)))
    return Drive.of(tuple(kept))


def _sign(entry: LogEntry, force: Array) -> int:
    if entry.flip_sign is not None:
        return -1 if entry.flip_sign else 1
    return -1 if float(np.nanmedian(thinned(force))) < 0.0 else 1


def _pieces(log: Prepared, noise: float, half_period: float) -> tuple[Prepared, ...]:
    """The stretches of constant speed of a course in which cycles repeat, or the mass slides steadily, as logs of their
    own: what a start is taken from."""
    data, out = log.data, []
    for start, stop, speed in moving_pieces(data.programme or Drive((0.0,), (data.drive_speed,)), data.begin, data.end):
        rows = slice(*np.searchsorted(data.time, [start, stop]))
        time, force = data.time[rows], np.where(data.weight[rows] > 0, data.force[rows], np.nan)
        found = segment(time, force, half_period=half_period or None, noise=noise)
        drive = Drive.of(speed)
        manner = manner_of(found, time, force, found.cycles.fall, noise=noise, half_period=half_period, drive=drive)
        falls = np.empty(0)
        if manner.name == "cycles" and found.count >= FEW:
            begin, end = window.of_cycles(time, force, found, noise, 0)
            falls = found.cycles.fall
        elif manner.name != "cycles" and manner.settled is not None:
            begin, end, manner = manner.settled, float(time[-1]), replace(manner, name="sliding")
        else:
            continue
        piece = replace(data, begin=begin, end=end, drive_speed=speed, programme=None)
        out.append(replace(log, data=piece, falls=falls, manner=manner, segmentation=found, pieces=()))
    return tuple(out)


def _reason(manner: Manner, falls: Array, cycles: int, entry: LogEntry, name: str) -> str | None:
    """Why a log that is sound is left out; cycles: how many were found, those that the scene skips included."""
    if manner.name == "cycles" and falls.size == 0 and cycles:
        return f"{name}: skip_cycles = {entry.skip_cycles} leaves none of its {cycles} cycles; lower it"
    if manner.name == "cycles" and falls.size == 0:
        return f"{name} shows no complete stick-slip cycle"
    if manner.name == "sliding" and manner.settled is None:
        return f"{name} slides without sticking, and its force never settles within its noise"
    return None


def _rejected(judgement: Judgement, name: str) -> str | None:
    if judgement.verdict != "reject":
        return None
    return f"{name} is rejected by the quality gate: {judgement.reason}; a threshold can be moved under [quality]"


def settled_part(prepared: Prepared) -> Prepared | None:
    """The log from where it slides steadily on, as a log of sliding; None where it does not."""
    since = prepared.manner.settled
    if since is None or prepared.manner.name == "cycles":
        return None
    if prepared.data.programme is not None:
        since = max(since, prepared.data.programme.starts[-1])
    speed = prepared.data.speed_at(since)
    if speed == 0.0 or not since < prepared.data.end:
        return None
    data = replace(prepared.data, begin=since, drive_speed=speed, programme=None)
    return replace(prepared, data=data, manner=replace(prepared.manner, name="sliding"), pieces=())


def cut_in_last_stick(prepared: Prepared, arrest: float, stick: float) -> Prepared:
    """The log cut in its last stick: `arrest` [s] of the last slip, `stick` [s] a typical stick duration."""
    end = min(prepared.data.end, arrest + LAST_STICK * stick)
    return replace(prepared, data=replace(prepared.data, end=end))
