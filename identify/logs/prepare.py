"""From a scene and its records to what the estimator takes: logs cut, corrected, segmented, with load and window."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from data_io import LogError, Record
from data_io.arrays import kept, shown, thinned
from data_io.correct import Change, Corrected, Corrections, Cut, correct
from data_io.quality import mean_and_drift
from data_io.record import zero_of_times
from identify.base.errors import FitError
from identify.logs.fit_mode import FitMode, ForceRecord, continuous_window, cycles_window, fit_mode_of, moving_pieces
from identify.logs.judgement import ENDS_LOADING, RECORD_LONGER, Judgement, RecordPart, judge
from identify.logs.loads import LoadSpline, as_modelled, without_unresolved_jitter
from identify.logs.log_data import LogData, StickLoading
from identify.logs.parting import name_of
from identify.logs.regime import SURE, Known, Regime, Verdict, classify, of_strokes
from identify.logs.segment import FEW_SLIPS, SLIDING, STICK, Segmentation, segment
from identify.logs.strokes import changes_speed, turns_of_sign
from identify.logs.unknowns import Unknowns
from identify.scene import Scene
from identify.scene.values import EACH_LOG, LogEntry, Rig
from identify.simulation.drive import Drive, NormalForce

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

FEWEST = 8  # samples of a log that can be looked at at all
GAP = 2.0  # rows of a record without the rests of the drive, as long as which a rest counts at most
NOISELESS, ASSUMED = 1e-6, 1e-4  # of the force: less is no noise of a measurement, and what is assumed there
LEAST_SHARE = 0.2  # of a record, from which on the level of its steady end is one of it
SETTLED_ENOUGH = 0.5  # of a record: an end that is longer stands for all of it
FEWEST_SLIDING = 20  # samples that slide before a steady end
NEARLY_ALL = 0.9  # of a record: an answer that rests on more of it rests on all of it
LAST_STICK = 0.5  # of a typical stick: how much of the last one is used, so that no slip has begun in it
REPEATABLE = 1e-4  # of the load: no contact repeats a slip better; a fit that believes it does has many false optima
JITTERS = 0.3  # times that: error of the load in fast rhythms from which on a slip has one of its own
LONGER = 1.5  # half periods that a slip takes, its slow beginning included
UNEQUAL = 0.06  # scatter of the drop from cycle to cycle above which cycles are not alike
FED = 2.0  # times what the load does to the force at an onset: a slip that comes early finds a fresher contact


# A log cut, corrected and segmented: its force the right way up, the samples that count, its phases and noise.


@dataclass(frozen=True)
class RecordEdits:
    """What was cut and corrected, line by line, and the stretches of the record that this left out; raw: the record as
    it was read."""

    changes: tuple[Change, ...]
    cuts: tuple[Cut, ...]
    raw: Record


@dataclass(frozen=True)
class Segmented:
    """One log, cut, corrected and segmented.

    entry; rig of this log; drive while the record counts; corrected: its record; sign applied to the friction force;
    force (n,) [N], sliding positive, tare taken off; used (n,) samples that may count; counted (n,): of these, those
    that are no spikes; time, measured (k,) [s], [N] from the first of the used samples to the last, NaN where one does
    not count; found: what was segmented; noise [N]; verdict: on its regime.
    """

    entry: LogEntry
    rig: Rig
    drive: Drive
    corrected: Corrected
    sign: int
    force: Array
    used: Bools
    counted: Bools
    time: Array
    measured: Array
    found: Segmentation
    noise: float
    verdict: Verdict

    @property
    def name(self) -> str:
        """Short name of the log in sentences."""
        return name_of(self.entry)

    @property
    def record(self) -> Record:
        """The record as the scene wants it."""
        return self.corrected.record

    @property
    def speed(self) -> float:
        """Highest drive speed [m/s]."""
        return max(self.drive.speeds)

    @property
    def load(self) -> Array:
        """The measured normal force at `time` (k,) [N]."""
        begin = int(np.searchsorted(self.record.time, self.time[0]))
        return np.asarray(self.record.normal_force[begin : begin + self.time.size])

    @property
    def falls(self) -> Array:
        """Of the cycles that the scene does not skip (c,) [s]."""
        return self.found.cycles.fall[self.entry.skip_cycles :]


def segmented(entry: LogEntry, record: Record, rig: Rig, *, elastic: bool = True) -> Segmented:
    """Cut, correct and segment one log.

    Args:
        elastic: False where something else than the stated spring may load the sticks, or swing the mass.

    Raises:
        FitError: no drive speed, a drive that turns, or a log of which nothing is left.
    """
    name = name_of(entry)
    drive = _drive(rig, entry, record, name)
    corrected = cut_and_correct(entry, record)
    record = corrected.record
    force = np.asarray(record.friction_force, float)
    used = corrected.used & np.isfinite(force) & np.isfinite(record.normal_force)
    refuse_too_few(entry, record, used, name)
    sign = -1 if entry.flip_sign else 1
    if entry.flip_sign is None:
        # A slip may swing the spring past its rest, and a hold keeps it there: it pulls the other way meanwhile.
        driven = used & _moves(drive, record.time)
        sign = -1 if float(np.nanmedian(thinned(kept(force, driven if np.any(driven) else used)))) < 0.0 else 1
    force = -force if sign < 0 else force
    inner = slice(int(np.argmax(used)), used.size - int(np.argmax(used[::-1])))
    time, measured = record.time[inner], shown(force, used)[inner]
    verdict = _verdict(time, measured, rig, drive, elastic)
    phases = _followed(time, measured, verdict, rig.half_period, rig.noise)
    counted = used.copy()
    counted[inner] &= ~phases.spikes
    return Segmented(
        entry=entry,
        rig=rig,
        drive=drive,
        corrected=corrected,
        sign=sign,
        force=force,
        used=used,
        counted=counted,
        time=time,
        measured=measured,
        found=phases,
        noise=rig.noise or phases.noise,
        verdict=verdict,
    )


def cut_and_correct(entry: LogEntry, record: Record) -> Corrected:
    """The record as the scene wants it.

    Raises:
        FitError: an interval without samples, or strokes that the record does not have.
    """
    wanted = Corrections(entry.tare, entry.normal_tare, entry.crosstalk, entry.tilt, entry.window, entry.exclude)
    try:
        return correct(record, wanted)
    except LogError as error:
        raise FitError(str(error)) from None


def refuse_too_few(entry: LogEntry, record: Record, used: Bools, name: str) -> None:
    """Refuse a log of which hardly a sample is left; what took them away decides the remedy.

    Args:
        used: (n,) the samples that may count. name: of the log, in sentences.

    Raises:
        FitError: a window outside the log or too narrow, too much excluded, or a log that is that short.
    """
    left = int(np.count_nonzero(used))
    if left >= FEWEST:
        return
    time, end = record.time, float(record.time[-1])
    start, stop = entry.window or (0.0, end)
    inside = int(np.count_nonzero((time >= start) & (time <= stop)))
    if inside < FEWEST <= time.size:
        remedy = "widen it" if start >= 0.0 and stop <= end else "move the window inside"
        raise FitError(
            f"{name}: the window {start:g} to {stop:g} s holds {inside} row(s); the log runs from 0 to {end:.6g} s"
            f"{zero_of_times(record)}; {remedy}"
        )
    if entry.exclude and inside >= FEWEST:
        raise FitError(f"{name}: exclude leaves {left} of {inside} samples; expected hundreds: exclude less")
    raise FitError(f"{name} has {left} usable samples; expected hundreds: record longer, or sample faster")


def _drive(rig: Rig, entry: LogEntry, record: Record, name: str) -> Drive:
    """How the drive goes while the record counts: one speed, or a programme that goes one way."""
    if rig.drive_speed is None:
        raise FitError(f'{name} has no drive speed; give drive_speed = "… mm/s" in its [[logs]] or under [rig]')
    pieces = Drive.of(rig.drive_speed).within(*(entry.window or (0.0, float(record.time[-1]))))
    speeds = [speed for _, speed in pieces]
    if all(speed == 0.0 for speed in speeds):
        raise FitError(
            f"{name} has a drive speed of 0 m/s; expected a moving drive, since a hold alone cannot be fitted: give "
            "the speed it moved at, or take its [[logs]] out"
        )
    if min(speeds) < 0.0 < max(speeds):
        raise FitError(f"{name} has a drive that turns within the part that is used; cut it into one window per stroke")
    changes = [(0.0, abs(speeds[0]))]
    changes += [(t, abs(speed)) for (_, before), (t, speed) in pairwise(pieces) if speed != before]
    return Drive.of(tuple(changes))


def _moves(drive: Drive, time: Array) -> Bools:
    """Whether the drive moves at times (n,) [s]."""
    return np.asarray(np.array(drive.speeds)[np.searchsorted(drive.starts, time, side="right") - 1] > 0.0)


def _followed(
    time: Array, force: Array, verdict: Verdict, half_period: float | None, noise: float | None
) -> Segmentation:
    """The phases that a fit follows: those of the verdict; of slips half lost in the noise those that the period of the
    rig shows, since the model has to fill in the others."""
    if not verdict.found.low_snr:
        return verdict.found
    return segment(time, force, half_period=half_period or None, noise=noise)


def _verdict(time: Array, force: Array, rig: Rig, drive: Drive, elastic: bool) -> Verdict:
    """The regime of a log; one whose drive changes its speed is a programme, whose phases are looked at as they are."""
    known = Known(rig.stiffness if elastic else 0.0, max(drive.speeds), rig.half_period or 0.0)
    if not drive.constant:
        moves = _moves(drive, time)
        phases = _slips_of_moves(time, force, moves, rig)
        if changes_speed(tuple(zip(drive.starts, drive.speeds, strict=True))):
            if phases.count and known.loading_rate and not _along_drive(time, force, moves, phases, drive, known):
                phases = segment(time, force, half_period=rig.half_period or None, noise=rig.noise, slips=False)
            return Verdict(Regime.PROGRAMME, SURE, ("the drive changes its speed",), phases)
        return replace(classify(time[moves], force[moves], known, noise=rig.noise), found=phases)
    edges = turns_of_sign(force)
    if len(edges) < 2:
        return classify(time, force, known, noise=rig.noise)
    return of_strokes(time, force, edges, known)


def _along_drive(time: Array, force: Array, moves: Bools, phases: Segmentation, drive: Drive, known: Known) -> bool:
    """Whether the falls of a drive programme are slips: by the way of the drive in place of time, in which its sticks
    rise at one slope whatever its speed."""
    steps = np.diff(time) * np.where(moves[:-1], [drive.at(t) for t in time[:-1]], 0.0) / known.drive_speed
    way, cycles = np.concatenate([[0.0], np.cumsum(steps)]), phases.cycles
    times = {name: np.interp(getattr(cycles, name), time, way) for name in ("onset", "fall", "arrest")}
    rows = np.append(steps > 0.0, True)
    short = replace(phases, cycles=replace(cycles, **times), spikes=phases.spikes[rows], phase=phases.phase[rows])
    return classify(way[rows], force[rows], known, given=short).found.count > 0


def _slips_of_moves(time: Array, force: Array, moves: Bools, rig: Rig) -> Segmentation:
    """The phases of a drive programme, with the slips of its record without the rests of the drive, in which the spring
    stays as it is: what lengths say of rises and falls is not that of holds."""
    phases = segment(time, force, half_period=rig.half_period or None, noise=rig.noise)
    if np.all(moves) or np.count_nonzero(moves) < FEWEST:
        return phases
    moved, steps = time[moves], np.diff(time[moves])
    run = np.concatenate([[0.0], np.cumsum(np.minimum(steps, GAP * float(np.median(steps))))])
    cycles = segment(run, force[moves], half_period=rig.half_period or None, noise=phases.noise).cycles

    def when(at: Array) -> Array:
        # From the row before: what ends where the drive stops ends there, and not where it starts again.
        before = np.maximum(np.searchsorted(run, at, side="left") - 1, 0)
        return np.asarray(moved[before] + at - run[before])

    times = {"onset": when(cycles.onset), "fall": when(cycles.fall), "arrest": when(cycles.arrest)}
    return replace(phases, cycles=replace(cycles, **times))


# One log, ready to be fitted or left out.


@dataclass(frozen=True)
class Prepared:
    """One log, ready to be fitted or left out.

    record; entry; rig of this log; sign applied to the friction force; force (n,) [N], sliding positive, tare
    taken off; used (n,) samples that may count; segmentation; data for the estimator; falls (c,) [s] of the
    cycles that are fitted; reason the log is left out, or None; noise_estimated: from the data, not given;
    account of what was cut and corrected, with the record as it was read; judgement: of the quality gate;
    hidden_swing: by how much the normal force varies beyond its noise where the model takes its mean (half its range,
    as a share); regime_verdict: on its regime; fit_mode: how it is followed; pieces: the stretches of constant speed
    of a log that is followed continuously.
    """

    record: Record
    entry: LogEntry
    rig: Rig
    sign: int
    force: Array
    used: Bools
    segmentation: Segmentation
    data: LogData
    falls: Array
    left_out: str | None
    noise_estimated: bool
    account: RecordEdits
    judgement: Judgement
    hidden_swing: float = 0.0
    regime_verdict: Verdict | None = None
    fit_mode: FitMode = field(default_factory=lambda: FitMode("cycles", None, False))
    pieces: tuple[Prepared, ...] = ()

    @property
    def as_continuous(self) -> Prepared:
        """The same log, to be followed by the model instead of cycle by cycle as they were seen."""
        return replace(self, fit_mode=replace(self.fit_mode, name="continuous", low_snr=False))

    @property
    def regime(self) -> Regime | None:
        """What it shows; None where no slip has come yet, or where it was not looked at."""
        return None if self.regime_verdict is None else self.regime_verdict.regime

    @property
    def typical(self) -> int:
        """Number of cycles in the stretch that shows most of them."""
        if self.fit_mode.name == "cycles":
            return int(self.falls.size)
        return max((piece.falls.size for piece in self.pieces), default=0)

    @property
    def name(self) -> str:
        """Short name of the log in sentences."""
        return name_of(self.entry)

    @property
    def segmented_from(self) -> float:
        """Time of the first sample that its phases are of [s]."""
        return float(self.record.time[int(np.argmax(self.used))])

    @property
    def used_until(self) -> float:
        """Time of the last sample that counts [s]: of a stroke, its end."""
        return float(self.record.time[int(self.used.size - 1 - np.argmax(self.used[::-1]))])

    def share_from(self, since: float) -> float:
        """Which share of what counts of the record, by time, lies from `since` [s] on."""
        return max(self.used_until - since, 0.0) / max(self.used_until - self.segmented_from, 1e-300)

    @property
    def rests_on(self) -> str:
        """Which part of the record an answer rests on, in words; "" where it is nearly all of it."""
        whole = self.used_until - self.segmented_from
        share = (self.data.end - self.data.begin) / whole if whole > 0.0 else 1.0
        if share >= NEARLY_ALL:
            return ""
        return f"{self.data.begin:.4g} to {self.data.end:.4g} s of {self.name} ({100.0 * share:.2g} % of the record)"

    @property
    def never_slips(self) -> bool:
        """Whether the log is left out because no slip is seen in it, and for nothing else."""
        sound = self.judgement.verdict != "reject" and not self.judgement.swapped
        return self.left_out is not None and sound and self.segmentation.count == 0

    @cached_property
    def mean_load(self) -> float:
        """Mean of the measured normal force of the loaded rows, of all the record [N]."""
        return mean_and_drift(self.record.normal_force)[0]

    @property
    def scatter(self) -> float:
        """How much the force drop differs from one settled cycle to the next, as a share of the mean drop, beyond
        what the noise and the course of the normal force do; 0 with fewer than four cycles. A slow drift does not
        count."""
        cycles, load = self.segmentation.cycles, self.data.normal_force
        mean = float(np.mean(load.values))
        drop = cycles.onset_force * mean / load.at(cycles.onset) - cycles.arrest_force * mean / load.at(cycles.arrest)
        drop = drop[1:]
        if drop.size < 3 or self.fit_mode.name != "cycles":
            return 0.0
        step = np.diff(drop) / np.sqrt(2.0)
        # The median of n sizes is large by chance: the standard error of 1.4826 times it is 1.17 / sqrt(n) of its mean.
        explained = max(4.0, 2.0 * (1.0 + 2.0 * 1.17 / np.sqrt(step.size)) ** 2) * self.data.noise**2
        excess = float(1.4826 * np.median(np.abs(step))) ** 2 - explained
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
        return self.scatter > UNEQUAL + FED * swing / float(np.mean(cycles.drop))


def prepare(scene: Scene, entry: LogEntry, record: Record, unknowns: Unknowns) -> Prepared:
    """Cut, correct and segment one log.

    Raises:
        FitError: no drive speed, a drive that turns, or a log of which nothing is left.
        SceneError: an effect outside its measured range.
    """
    model = unknowns.model
    soft = "stiffness" in scene.parameters or "skin_compliance" in model.effects  # what loads the sticks is not known
    log = segmented(entry, record, scene.rig_for(entry), elastic=not (soft or model.vibrates))
    expected = None if soft or not log.drive.constant else log.speed * log.rig.stiffness
    part = RecordPart(log.time, log.measured, log.found, expected, log.load)
    judgement = judge(log.record, [part], scene.thresholds, log.used)
    stiffness = 0.0 if model.vibrates else log.rig.stiffness  # else the mass swings with something else
    moving = ForceRecord(log.time, log.measured, log.load, log.noise, log.rig.half_period or 0.0, log.drive)
    fit_mode = fit_mode_of(moving, log.found, log.falls, stiffness)
    if fit_mode.name == "cycles":
        begin, end = cycles_window(moving, log.found, entry.skip_cycles)
    else:
        begin, end = continuous_window(moving, log.found, fit_mode)
    course, hidden = _load(log, (begin, end), judgement, scene, unknowns)
    prepared = Prepared(
        record=log.record,
        entry=entry,
        rig=log.rig,
        sign=log.sign,
        force=log.force,
        used=log.counted,
        segmentation=log.found,
        data=without_unresolved_jitter(_data(log, course, (begin, end), unknowns)),
        falls=log.falls,
        left_out=_left_out(fit_mode, log, judgement),
        noise_estimated=log.rig.noise is None,
        account=_account(entry, record, log, begin),
        judgement=judgement,
        hidden_swing=hidden,
        regime_verdict=log.verdict,
        fit_mode=fit_mode,
    )
    if fit_mode.name == "sliding":
        return replace(prepared, data=_as_sure_as_its_level(prepared, prepared.data))
    if fit_mode.name != "continuous":
        return prepared
    return replace(prepared, pieces=_pieces(prepared, moving, stiffness))


def _account(entry: LogEntry, raw: Record, log: Segmented, begin: float) -> RecordEdits:
    """What was cut and corrected of a log; begin: where the fit begins [s]."""
    changes, cuts, first = list(log.corrected.changes), list(log.corrected.cuts), float(log.time[0])
    if log.sign < 0:
        why = "as given" if entry.flip_sign is not None else "it slides with a negative force"
        changes.append(Change("flip_sign", f"the friction force was turned over: {why}"))
    if begin > first:
        cycles = "cycle" if entry.skip_cycles == 1 else f"{entry.skip_cycles} cycles"
        text = f"the first {cycles} left out as given: the fit begins at {begin:.4g} s"
        if not entry.skip_cycles:
            text = f"the fit begins at {begin:.4g} s, where the first straight line of a stick does"
        kind = "skip_cycles" if entry.skip_cycles else "lead"
        changes.append(Change(kind, text, begin, "s"))
        cuts.append(Cut(kind, first, begin))
    return RecordEdits(tuple(changes), tuple(cuts), raw)


def _load(
    log: Segmented, fitted: tuple[float, float], judgement: Judgement, scene: Scene, unknowns: Unknowns
) -> tuple[LoadSpline, float]:
    """The normal force as the model takes it, and the swing that its mean hides; fitted: the window [s].

    Raises:
        FitError: a normal force that is none, of a log that is not rejected.
        SceneError: an effect outside its measured range.
    """
    follows, name, cycles = unknowns.model.follows_load, log.name, log.found.count
    try:
        course, hidden = as_modelled(log.record, log.used, fitted, follows=follows, name=name, cycles=cycles)
    except FitError:
        if judgement.verdict != "reject":
            raise
        return LoadSpline(NormalForce.of(1.0)), 0.0  # the log is left out: nothing is computed with it
    programme = log.speed if log.drive.constant else tuple(zip(log.drive.starts, log.drive.speeds, strict=True))
    scene.check_ranges(log.entry, programme, (min(course.force.values), max(course.force.values)))
    return course, hidden


def _data(log: Segmented, course: LoadSpline, fitted: tuple[float, float], unknowns: Unknowns) -> LogData:
    """The log as the estimator sees it; fitted: the window [s]."""
    rig, sd_course = log.rig, course.sd_course
    repeatable = float(REPEATABLE * np.mean(course.force.values))
    labels = log.entry.labels
    counting = kept(log.force, log.used)
    size = float(max(counting.max(), -counting.min()))
    # a log without noise, as a simulation leaves it, is weighted by what the computation is surely good for
    noise = log.noise if log.noise > NOISELESS * size else ASSUMED * size
    return LogData(
        time=np.ascontiguousarray(log.record.time),
        force=np.where(np.isfinite(log.force), log.force, 0.0),
        weight=np.where(log.counted, 1.0 / max(noise, 1e-12) ** 2, 0.0),
        base=unknowns.base({"mass": rig.mass, "stiffness": rig.stiffness, "damping": rig.damping}),
        drive_speed=log.speed,
        normal_force=course.force,
        normal_force_sd=float(np.hypot(course.sd, repeatable)),
        begin=fitted[0],
        end=fitted[1],
        own=np.full(len(unknowns.names), np.nan) if np.any(unknowns.grouped) else np.empty(0),
        groups=tuple("" if by is None or by == EACH_LOG else labels[by] for by in unknowns.per),
        programme=None if log.drive.constant else log.drive,
        tremor_sd=course.tremor_sd if course.tremor_sd > JITTERS * repeatable else 0.0,
        sd_course=sd_course and NormalForce.of((sd_course.times, np.hypot(sd_course.values, repeatable))),
        pull=_loading(log, course),
    )


def _loading(log: Segmented, course: LoadSpline) -> StickLoading | None:
    """How the sticks load; None where no cycle was seen, or no mass is known."""
    phases, rig = log.found, log.rig
    if not phases.count or phases.stick_slope is None or not rig.half_period:
        return None
    rate = phases.stick_slope[0]
    coefficient = float(np.median(phases.cycles.onset_force)) / float(np.mean(course.force.values))
    if not (rate > 0.0 and coefficient > 0.0):
        return None
    # Rig and skin together are as soft as the sticks show.
    softer = float(np.sqrt(rig.stiffness * log.speed / rate))
    return StickLoading(coefficient, rate, LONGER * rig.half_period * softer)


def _pieces(log: Prepared, moving: ForceRecord, stiffness: float) -> tuple[Prepared, ...]:
    """The stretches of constant speed of a log in which cycles repeat, or the mass slides steadily, as logs of their
    own: what a start is taken from."""
    data, out, noise, half_period = log.data, [], moving.noise, moving.half_period
    for start, stop, speed in moving_pieces(data.programme or Drive((0.0,), (data.drive_speed,)), data.begin, data.end):
        rows = slice(*np.searchsorted(data.time, [start, stop]))
        time, force = data.time[rows], np.where(data.weight[rows] > 0, data.force[rows], np.nan)
        verdict = classify(time, force, Known(stiffness, speed, half_period), noise=noise)
        phases = _followed(time, force, verdict, half_period, noise)
        part = ForceRecord(time, force, log.record.normal_force[rows], noise, half_period, Drive.of(speed))
        fit_mode = fit_mode_of(part, phases, phases.cycles.fall, stiffness)
        falls = np.empty(0)
        if fit_mode.name == "cycles" and phases.count >= FEW_SLIPS:
            begin, end = cycles_window(part, phases)
            falls = phases.cycles.fall
        elif fit_mode.name != "cycles" and fit_mode.steady_since is not None:
            begin, end, fit_mode = fit_mode.steady_since, float(time[-1]), replace(fit_mode, name="sliding")
        else:
            continue
        own = replace(data, begin=begin, end=end, drive_speed=speed, programme=None)
        piece = replace(log, data=own, falls=falls, fit_mode=fit_mode, segmentation=phases, pieces=())
        out.append(replace(piece, regime_verdict=verdict))
    return tuple(out)


def _left_out(fit_mode: FitMode, log: Segmented, judgement: Judgement) -> str | None:
    """Why a log is left out, in a sentence; None where it is not."""
    name, cycles, skipped, settled = log.name, log.found.count, log.entry.skip_cycles, fit_mode.steady_since
    if judgement.swapped and judgement.verdict == "reject":
        return f"{name}: normal force and friction force look swapped"
    if judgement.verdict == "reject":
        return f"{name} is rejected by the quality gate: {judgement.reason}; a threshold can be moved under [quality]"
    reason = None
    if log.verdict.strokes > 1:
        reason = (
            f"{name} goes to and fro: its force changes its sign, in {log.verdict.strokes} strokes, which one drive "
            "speed one way does not describe; give the programme of the drive with its signs, name the position column "
            '(columns = { position = "…" }), or a window of one stroke'
        )
    elif fit_mode.name == "cycles" and log.falls.size == 0 and cycles:
        reason = f"{name}: skip_cycles = {skipped} leaves none of its {cycles} cycles; lower it"
    elif fit_mode.name == "cycles" and log.falls.size == 0:
        why = f": {ENDS_LOADING}; {RECORD_LONGER}" if judgement.ends_loading else ""
        reason = f"{name} shows no complete stick-slip cycle{why}"
    elif fit_mode.rhythm is not None and log.drive.constant:
        reason = f"{name} seems to slide, but {fit_mode.rhythm}"
    elif fit_mode.name == "sliding" and settled is None:
        reason = f"{name} slides without sticking, and its force never settles within its noise"
    elif fit_mode.name == "sliding" and settled is not None and log.drive.constant:
        lasts, whole = float(log.time[-1]) - settled, float(log.time[-1] - log.time[0])
        if lasts < LEAST_SHARE * whole:
            reason = (
                f"{name} slides without sticking, and its force settles for the last {lasts:.3g} s only, "
                f"{100 * lasts / whole:.2g} % of the record: no level of it; the classical table has that of the "
                "whole, and a window chooses a part"
            )
    return f"{name}: normal force and friction force look swapped" if reason and judgement.swapped else reason


def settled_part(prepared: Prepared) -> Prepared | None:
    """The log from where it slides steadily on, as a log of sliding; None where it does not, or for so short a part of
    the record that its level is none of it."""
    since = prepared.fit_mode.steady_since
    if since is None or prepared.fit_mode.name == "cycles":
        return None
    if prepared.data.programme is not None:
        since = max(since, prepared.data.programme.starts[-1])
    speed = prepared.data.speed_at(since)
    if speed == 0.0 or not since < prepared.data.end or prepared.share_from(since) < LEAST_SHARE:
        return None
    data = _as_sure_as_its_level(prepared, replace(prepared.data, begin=since, drive_speed=speed, programme=None))
    return replace(prepared, data=data, fit_mode=replace(prepared.fit_mode, name="sliding"), pieces=())


def beginning(prepared: Prepared, share: float) -> Prepared:
    """The log cut to this share of what comes before it slides steadily; all of it for 1."""
    data, settled = prepared.data, prepared.fit_mode.steady_since
    changing = data.end if settled is None or not data.begin < settled < data.end else settled
    end = data.begin + share * (changing - data.begin) if share < 1.0 else data.end
    return replace(prepared, data=replace(data, end=end))


def _as_sure_as_its_level(log: Prepared, data: LogData) -> LogData:
    """The data of a steady end, whose load counts as no surer than the level that it stands for: where less than half
    of what slides has settled, the rest of it slid at another."""
    share = log.share_from(data.begin)
    inside = int(np.searchsorted(log.record.time, log.segmented_from))
    phase = np.full(log.record.time.size, STICK, np.int8)
    phase[inside : inside + log.segmentation.phase.size] = log.segmentation.phase[: phase.size - inside]
    sliding = log.used & (log.record.time < data.begin) & (phase == SLIDING)
    settled = log.used & (log.record.time >= data.begin)
    if share > SETTLED_ENOUGH or np.count_nonzero(sliding) < FEWEST_SLIDING:
        return data
    load = data.normal_force.at(log.record.time)
    before, after = (float(np.mean(log.force[rows] / load[rows])) for rows in (sliding, settled))
    off = (1.0 - share) * abs(before / after - 1.0) * data.mean_normal_force if after else 0.0
    return replace(data, normal_force_sd=float(np.hypot(data.normal_force_sd, off)), sd_course=None)


def cut_in_last_stick(prepared: Prepared, arrest: float, stick: float) -> Prepared:
    """The log cut in its last stick: `arrest` [s] of the last slip, `stick` [s] a typical stick duration."""
    end = min(prepared.data.end, arrest + LAST_STICK * stick)
    return replace(prepared, data=replace(prepared.data, end=end))
