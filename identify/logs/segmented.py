"""A log cut, corrected and segmented: its force the right way up, the samples that count, its phases and noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data_io import LogError, Record
from data_io.arrays import kept, shown, thinned
from data_io.correct import Change, Corrected, Corrections, Cut, correct
from data_io.record import zero_of_times
from identify.base.errors import FitError
from identify.logs.fit_mode import ForceRecord
from identify.logs.log_regime import changes_speed, of_strokes
from identify.logs.parting import name_of
from identify.logs.regime import SURE, Known, Regime, Verdict, classify
from identify.logs.segment import Segmentation, segment
from identify.logs.strokes import turns_of_sign
from identify.scene.values import LogEntry, Rig
from identify.simulation.drive import Drive

# What a scene cuts and corrects of one log, and the account of it.

FEWEST = 8  # samples of a log that can be looked at at all
GAP = 2.0  # rows of a record without the rests of the drive, as long as which a rest is counted at most


@dataclass(frozen=True)
class RecordEdits:
    """What was cut and corrected, line by line, and the stretches of the record that this left out; raw: the record as
    it was read."""

    changes: tuple[Change, ...]
    cuts: tuple[Cut, ...]
    raw: Record


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


def refuse_too_few(entry: LogEntry, record: Record, used: NDArray[np.bool_], name: str) -> None:
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


def account(entry: LogEntry, raw: Record, corrected: Corrected, sign: int, first: float, begin: float) -> RecordEdits:
    """The account of a log, with what `prepare` found itself.

    Args:
        sign: applied to the friction force.
        first: time of the first sample that counts; begin: where the fit begins [s].
    """
    changes, cuts = list(corrected.changes), list(corrected.cuts)
    if sign < 0:
        why = "as given" if entry.flip_sign is not None else "it slides with a negative force"
        changes.append(Change("flip_sign", f"the friction force was turned over: {why}"))
    if begin > first:
        cycles = "cycle" if entry.skip_cycles == 1 else f"{entry.skip_cycles} cycles"
        text = f"the first {cycles} left out as given: the fit begins at {begin:.4g} s"
        if not entry.skip_cycles:
            text = f"the fit begins at {begin:.4g} s, where the first straight line of a stick does"
        changes.append(Change("skip_cycles" if entry.skip_cycles else "lead", text, begin, "s"))
        cuts.append(Cut("skip_cycles" if entry.skip_cycles else "lead", first, begin))
    return RecordEdits(tuple(changes), tuple(cuts), raw)


Array = NDArray[np.float64]


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
    used: NDArray[np.bool_]
    counted: NDArray[np.bool_]
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
    def moving(self) -> ForceRecord:
        """What it moves by, from the first of the used samples to the last."""
        half_period = self.rig.half_period or 0.0
        return ForceRecord(self.time, self.measured, self.load, self.noise, half_period, self.drive)

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
    # A slip may swing the spring past its rest, and a hold keeps it there: it pulls the other way while nothing slides.
    driven = used & _moves(drive, record.time)
    sign = _sign(entry, kept(force, driven if np.any(driven) else used))
    force = -force if sign < 0 else force
    inner = slice(int(np.argmax(used)), used.size - int(np.argmax(used[::-1])))
    time, measured = record.time[inner], shown(force, used)[inner]
    verdict = _verdict(time, measured, rig, drive, elastic)
    found = followed(time, measured, verdict, rig.half_period or None, rig.noise)
    spikes = np.ones(record.time.size, bool)
    spikes[inner] = found.spikes
    return Segmented(
        entry=entry,
        rig=rig,
        drive=drive,
        corrected=corrected,
        sign=sign,
        force=force,
        used=used,
        counted=used & ~spikes,
        time=time,
        measured=measured,
        found=found,
        noise=rig.noise or found.noise,
        verdict=verdict,
    )


def followed(
    time: Array, force: Array, verdict: Verdict, half_period: float | None, noise: float | None
) -> Segmentation:
    """The phases that a fit follows: those of the verdict; of slips half lost in the noise those that the period of the
    rig shows, since it is the model that has to tell the others."""
    return segment(time, force, half_period=half_period, noise=noise) if verdict.found.low_snr else verdict.found


def _verdict(time: Array, force: Array, rig: Rig, drive: Drive, elastic: bool) -> Verdict:
    """The regime of a log; one whose drive changes its speed is a programme, whose phases are looked at as they are."""
    known = Known(rig.stiffness if elastic else 0.0, max(drive.speeds), rig.half_period or 0.0)
    if not drive.constant:
        found = _slips_of_moves(time, force, _moves(drive, time), rig)
        if changes_speed(tuple(zip(drive.starts, drive.speeds, strict=True))):
            return Verdict(Regime.PROGRAMME, SURE, ("the drive changes its speed",), found)
        moves = _moves(drive, time)
        return replace(classify(time[moves], force[moves], known, noise=rig.noise), found=found)
    strokes = turns_of_sign(force)
    if len(strokes) < 2:
        return classify(time, force, known, noise=rig.noise)
    return of_strokes(time, force, strokes, known)


def _slips_of_moves(time: Array, force: Array, moves: NDArray[np.bool_], rig: Rig) -> Segmentation:
    """The phases of a drive programme, with the slips of its record without the rests of the drive, in which the spring
    stays as it is: what is told of rises and falls by their lengths is not that of holds."""
    found = segment(time, force, half_period=rig.half_period or None, noise=rig.noise)
    if np.all(moves) or np.count_nonzero(moves) < FEWEST:
        return found
    moved, steps = time[moves], np.diff(time[moves])
    run = np.concatenate([[0.0], np.cumsum(np.minimum(steps, GAP * float(np.median(steps))))])
    cycles = segment(run, force[moves], half_period=rig.half_period or None, noise=found.noise).cycles

    def when(at: Array) -> Array:
        # From the row before: what ends where the drive stops ends there, and not where it starts again.
        before = np.maximum(np.searchsorted(run, at, side="left") - 1, 0)
        return np.asarray(moved[before] + at - run[before])

    return replace(
        found, cycles=replace(cycles, onset=when(cycles.onset), fall=when(cycles.fall), arrest=when(cycles.arrest))
    )


def _drive(rig: Rig, entry: LogEntry, record: Record, name: str) -> Drive:
    """How the drive goes while the record counts: one speed, or a programme that goes one way."""
    if rig.drive_speed is None:
        raise FitError(f'{name} has no drive speed; give drive_speed = "… mm/s" in its [[logs]] or under [rig]')
    whole = Drive.of(rig.drive_speed)
    start, stop = entry.window or (0.0, float(record.time[-1]))
    pieces = whole.within(start, stop)
    speeds = [speed for _, speed in pieces]
    if all(speed == 0.0 for speed in speeds):
        raise FitError(
            f"{name} has a drive speed of 0 m/s; expected a moving drive, since a hold alone cannot be fitted: give "
            "the speed it moved at, or take its [[logs]] out"
        )
    if min(speeds) < 0.0 < max(speeds):
        raise FitError(f"{name} has a drive that turns within the part that is used; cut it into one window per stroke")
    kept = [(0.0, abs(speeds[0]))]
    for t, speed in pieces[1:]:
        if abs(speed) != kept[-1][1]:
            kept.append((t, abs(speed)))
    return Drive.of(tuple(kept))


def _moves(drive: Drive, time: Array) -> NDArray[np.bool_]:
    """Whether the drive moves at times (n,) [s]."""
    return np.asarray(np.array(drive.speeds)[np.searchsorted(drive.starts, time, side="right") - 1] > 0.0)


def _sign(entry: LogEntry, force: Array) -> int:
    """1 or -1, by which the friction force is to be multiplied: `force` (n,) [N] is that while the drive moves."""
    if entry.flip_sign is not None:
        return -1 if entry.flip_sign else 1
    return -1 if float(np.nanmedian(thinned(force))) < 0.0 else 1
