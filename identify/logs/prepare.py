"""From a record and its entry in the scene to what the estimator takes: sign, mask, window, loads, cycles."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from data_io import Record
from data_io.arrays import kept
from data_io.signals import mean_and_drift
from identify.base.errors import FitError
from identify.logs.fit_mode import FitMode, ForceRecord, continuous_window, cycles_window, fit_mode_of, moving_pieces
from identify.logs.judgement import Judgement, judge
from identify.logs.loads import LoadSpline, as_far_as_told, as_modelled
from identify.logs.log_data import LogData, StickLoading
from identify.logs.parting import name_of
from identify.logs.regime import Known, Regime, Verdict, classify
from identify.logs.segment import ENDS_LOADING, FEW_SLIPS, REMEDY, SLIDING, STICK, Segmentation
from identify.logs.segmented import RecordEdits, Segmented, account, followed, segmented
from identify.logs.slip_quality import RecordPart
from identify.logs.unknowns import Unknowns
from identify.scene import Scene
from identify.scene.values import EACH_LOG, LogEntry, Rig
from identify.simulation.drive import Drive, NormalForce

Array = NDArray[np.float64]

NOISELESS, ASSUMED = 1e-6, 1e-4  # of the force: less is no noise of a measurement, and what is assumed there
LEAST_SHARE = 0.2  # of a record, from which on the level of its steady end is one of it
SETTLED_ENOUGH = 0.5  # of a record: an end that is longer stands for all of it
FEWEST_SLIDING = 20  # samples that slide before a steady end
NEARLY_ALL = 0.9  # of a record: an answer that rests on more of it rests on all of it
LAST_STICK = 0.5  # of a typical stick: how much of the last one is used, so that no slip has begun in it
REPEATABLE = 1e-4  # of the load: no contact repeats a slip better; a fit that believes it does has many false optima
SWINGS = 0.3  # times that: error of the load in fast rhythms from which on a slip has one of its own
LONGER = 1.5  # half periods that a slip takes, its slow beginning included
UNTOLD = LoadSpline(NormalForce.of(1.0))  # [N], of a rejected log whose normal force is none
UNEQUAL = 0.06  # scatter of the drop from cycle to cycle above which cycles are not alike
CHANCE = 1.17  # standard error of 1.4826 times the median of n sizes of normal numbers, times sqrt(n), over their scale
FED = 2.0  # times what the load does to the force at an onset: a slip that comes early finds a fresher contact


@dataclass(frozen=True)
class Prepared:
    """One log, ready to be fitted or left out.

    record; entry; rig of this log; sign applied to the friction force; force (n,) [N], sliding positive, tare
    taken off; used (n,) samples that may count; segmentation; data for the estimator; falls (c,) [s] of the
    cycles that are fitted; reason the log is left out, or None; noise_estimated: from the data, not given;
    account of what was cut and corrected, with the record as it was read; judgement: of the quality gate;
    hidden_swing: by how much the normal force varies beyond its noise where the model takes its mean (half its range,
    as a share); regime_verdict: on its regime; fit_mode: how it is followed; pieces: the stretches of a course of its
    own that are logs of constant speed.
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
        good = self.used if np.any(self.used) else np.ones(self.record.time.size, bool)
        return float(self.record.time[int(np.argmax(good))])

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
        # The median of few steps is large by chance: its standard error is CHANCE / sqrt(n) of what it estimates.
        explained = max(4.0, 2.0 * (1.0 + 2.0 * CHANCE / np.sqrt(step.size)) ** 2) * self.data.noise**2
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
        return self.scatter > UNEQUAL + FED * swing / float(np.mean(cycles.onset_force - cycles.arrest_force))


def prepare(scene: Scene, entry: LogEntry, record: Record, unknowns: Unknowns) -> Prepared:
    """Cut, correct and segment one log.

    Raises:
        FitError: no drive speed, a drive that turns, or a log of which nothing is left.
        SceneError: an effect outside its measured range.
    """
    elastic = not (soft(scene, unknowns) or unknowns.model.vibrates)
    log = segmented(entry, record, scene.rig_for(entry), elastic=elastic)
    judgement = _judged(log, scene, unknowns)
    stiffness = 0.0 if unknowns.model.vibrates else log.rig.stiffness  # else the mass swings with something else
    moving = log.moving
    fit_mode = fit_mode_of(moving, log.found, log.falls, stiffness)
    if fit_mode.name == "cycles":
        begin, end = cycles_window(moving, log.found, log.entry.skip_cycles)
    else:
        begin, end = continuous_window(moving, log.found, fit_mode)
    reason = _rejected(judgement, log.name) or _reason(fit_mode, log, judgement)
    if reason is not None and judgement.swapped:
        reason = f"{log.name}: normal force and friction force look swapped"
    course, hidden = _load(log, (begin, end), judgement, scene, unknowns)
    made = Prepared(
        record=log.record,
        entry=entry,
        rig=log.rig,
        sign=log.sign,
        force=log.force,
        used=log.counted,
        segmentation=log.found,
        data=as_far_as_told(_data(log, course, (begin, end), unknowns)),
        falls=log.falls,
        left_out=reason,
        noise_estimated=log.rig.noise is None,
        account=account(entry, record, log.corrected, log.sign, float(log.time[0]), begin),
        judgement=judgement,
        hidden_swing=hidden,
        regime_verdict=log.verdict,
        fit_mode=fit_mode,
    )
    if fit_mode.name == "sliding":
        return replace(made, data=_as_sure_as_its_level(made, made.data))
    if fit_mode.name != "continuous":
        return made
    return replace(made, pieces=_pieces(made, moving, stiffness))


def soft(scene: Scene, unknowns: Unknowns) -> bool:
    """Whether the stiffness that loads the sticks is not known."""
    return "stiffness" in scene.parameters or "skin_compliance" in unknowns.model.effects


def _judged(log: Segmented, scene: Scene, unknowns: Unknowns) -> Judgement:
    """What the quality gate says of a log."""
    expected = None if soft(scene, unknowns) or not log.drive.constant else log.speed * log.rig.stiffness
    part = RecordPart(log.time, log.measured, log.found, expected, log.load)
    return judge(log.record, [part], scene.thresholds, log.used)


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
        return UNTOLD, 0.0  # the log is left out: nothing is computed with it
    programme = log.speed if log.drive.constant else tuple(zip(log.drive.starts, log.drive.speeds, strict=True))
    scene.check_ranges(log.entry, programme, (min(course.force.values), max(course.force.values)))
    return course, hidden


def _data(log: Segmented, course: LoadSpline, fitted: tuple[float, float], unknowns: Unknowns) -> LogData:
    """The log as the estimator sees it; fitted: the window [s]."""
    rig, (begin, end) = log.rig, fitted
    repeatable = float(REPEATABLE * np.mean(course.force.values))
    labels = log.entry.labels
    finite = np.isfinite(log.force)
    return LogData(
        time=np.ascontiguousarray(log.record.time),
        force=log.force if finite.all() else np.where(finite, log.force, 0.0),
        weight=_weight(log),
        base=unknowns.base({"mass": rig.mass, "stiffness": rig.stiffness, "damping": rig.damping}),
        drive_speed=log.speed,
        normal_force=course.force,
        normal_force_sd=float(np.hypot(course.sd, repeatable)),
        begin=begin,
        end=end,
        own=np.full(len(unknowns.names), np.nan) if np.any(unknowns.grouped) else np.empty(0),
        groups=tuple("" if by is None or by == EACH_LOG else labels[by] for by in unknowns.per),
        programme=None if log.drive.constant else log.drive,
        tremor_sd=course.tremor_sd if course.tremor_sd > SWINGS * repeatable else 0.0,
        sd_course=_sd_over_time(course, repeatable),
        pull=_pull(log.found, course, rig, log.speed),
    )


def _weight(log: Segmented) -> Array:
    """1/variance [1/N^2] of every sample (n,), 0 where it does not count."""
    sound = kept(log.force, log.used)
    size = float(max(sound.max(), -sound.min()))
    # a log without noise, as a simulation leaves it, is weighted by what the computation is surely good for
    noise = log.noise if log.noise > NOISELESS * size else ASSUMED * size
    return np.where(log.counted, 1.0 / max(noise, 1e-12) ** 2, 0.0)


def _sd_over_time(course: LoadSpline, repeatable: float) -> NormalForce | None:
    """The error of a course where it is not the same throughout, with what no contact repeats."""
    known = course.sd_course
    return None if known is None else NormalForce.of((known.times, np.hypot(known.values, repeatable)))


def _pull(found: Segmentation, course: LoadSpline, rig: Rig, speed: float) -> StickLoading | None:
    """How the sticks load; None where no cycle was seen, or no mass is known."""
    if not found.count or found.stick_slope is None or not rig.half_period:
        return None
    rate = found.stick_slope[0]
    coefficient = float(np.median(found.cycles.onset_force)) / float(np.mean(course.force.values))
    if not (rate > 0.0 and coefficient > 0.0):
        return None
    # Rig and skin together are as soft as the sticks show.
    return StickLoading(coefficient, rate, LONGER * rig.half_period * float(np.sqrt(rig.stiffness * speed / rate)))


def _pieces(log: Prepared, moving: ForceRecord, stiffness: float) -> tuple[Prepared, ...]:
    """The stretches of constant speed of a course in which cycles repeat, or the mass slides steadily, as logs of their
    own: what a start is taken from."""
    data, out, noise, half_period = log.data, [], moving.noise, moving.half_period
    for start, stop, speed in moving_pieces(data.programme or Drive((0.0,), (data.drive_speed,)), data.begin, data.end):
        rows = slice(*np.searchsorted(data.time, [start, stop]))
        time, force = data.time[rows], np.where(data.weight[rows] > 0, data.force[rows], np.nan)
        verdict = classify(time, force, Known(stiffness, speed, half_period), noise=noise)
        found = followed(time, force, verdict, half_period or None, noise)
        part = ForceRecord(time, force, log.record.normal_force[rows], noise, half_period, Drive.of(speed))
        fit_mode = fit_mode_of(part, found, found.cycles.fall, stiffness)
        falls = np.empty(0)
        if fit_mode.name == "cycles" and found.count >= FEW_SLIPS:
            begin, end = cycles_window(part, found)
            falls = found.cycles.fall
        elif fit_mode.name != "cycles" and fit_mode.steady_since is not None:
            begin, end, fit_mode = fit_mode.steady_since, float(time[-1]), replace(fit_mode, name="sliding")
        else:
            continue
        piece = replace(data, begin=begin, end=end, drive_speed=speed, programme=None)
        out.append(
            replace(
                log, data=piece, falls=falls, fit_mode=fit_mode, segmentation=found, regime_verdict=verdict, pieces=()
            )
        )
    return tuple(out)


def _reason(fit_mode: FitMode, log: Segmented, judgement: Judgement) -> str | None:
    """Why a log that is sound is left out."""
    name, cycles, skipped = log.name, log.found.count, log.entry.skip_cycles
    if log.verdict.strokes > 1:
        return (
            f"{name} goes to and fro: its force changes its sign, in {log.verdict.strokes} strokes, which one drive "
            "speed one way does not describe; give the programme of the drive with its signs, name the position column "
            '(columns = { position = "…" }), or a window of one stroke'
        )
    if fit_mode.name == "cycles" and log.falls.size == 0 and cycles:
        return f"{name}: skip_cycles = {skipped} leaves none of its {cycles} cycles; lower it"
    if fit_mode.name == "cycles" and log.falls.size == 0:
        told = f": {ENDS_LOADING}; {REMEDY}" if judgement.ends_loading else ""
        return f"{name} shows no complete stick-slip cycle{told}"
    if fit_mode.rhythm is not None and log.drive.constant:
        return f"{name} seems to slide, but {fit_mode.rhythm}"
    if fit_mode.name == "sliding" and fit_mode.steady_since is None:
        return f"{name} slides without sticking, and its force never settles within its noise"
    if fit_mode.name == "sliding" and fit_mode.steady_since is not None and log.drive.constant:
        lasts, whole = float(log.time[-1]) - fit_mode.steady_since, float(log.time[-1] - log.time[0])
        if lasts < LEAST_SHARE * whole:
            return (
                f"{name} slides without sticking, and its force settles for the last {lasts:.3g} s only, "
                f"{100 * lasts / whole:.2g} % of the record: no level of it; the classical table has that of the "
                "whole, and a window chooses a part"
            )
    return None


def _rejected(judgement: Judgement, name: str) -> str | None:
    if judgement.verdict != "reject":
        return None
    return f"{name} is rejected by the quality gate: {judgement.reason}; a threshold can be moved under [quality]"


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
    sliding = log.used & (log.record.time < data.begin)
    inside = np.searchsorted(log.record.time, log.segmented_from)
    phase = np.full(log.record.time.size, STICK, np.int8)
    phase[inside : inside + log.segmentation.phase.size] = log.segmentation.phase[: phase.size - inside]
    sliding &= phase == SLIDING
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
