"""From a scene and its records to what the estimator takes: logs cut, corrected, segmented, with load and window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from data_io import LogError, Record
from data_io.arrays import kept, shown, thinned, thinned_steps, true_runs
from data_io.correct import Change, Corrected, Corrections, correct
from data_io.quality import mean_and_drift
from data_io.record import zero_of_times
from identify.base.errors import FitError
from identify.base.result import LogCurves
from identify.logs.judgement import ENDS_LOADING, RECORD_LONGER, Judgement, RecordPart, judge
from identify.logs.log_data import LoadSpline, LogData, level, smooth, swing
from identify.logs.noise import FEWEST_ROWS, SIGNIFICANT, bridged, line_slope, running_means, slope_error, white_noise
from identify.logs.recorded_drive import changes_speed, turns_of_sign
from identify.logs.regime import (
    SURE,
    ForceOscillation,
    Known,
    Regime,
    Verdict,
    classify,
    drop_scatter,
    hidden_rhythm,
    of_strokes,
)
from identify.logs.segment import (
    FEW_SLIPS,
    FEWEST,
    SLIDING,
    STICK,
    DetectedCycles,
    Segmentation,
    drive_force,
    jumps,
    segment,
)
from identify.logs.unknowns import Unknowns
from identify.scene import Scene
from identify.scene.values import EACH_LOG, LogEntry, Rig
from identify.simulation.drive import FITTED_PIECES, Drive, NormalForce

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

STROKE, PART = "stroke", "part"  # the labels of parts: a scene may have parameters of their own for them
SKIPPED = 0.1  # of a stroke, at most, after a turn
AT_TURNS = 0.02  # of the highest speed of a drive on a course: as fast goes its clock at least
EVENTS = ("onset", "fall", "arrest")  # the times of cycles
ROUNDING = 1e-9  # of the highest speed of a drive: less is none
GAP = 2.0  # rows of a record without the rests of the drive, as long as which a rest counts at most
NOISELESS = 1e-6  # of the force: less is no noise of a measurement
LEAST_SHARE = 0.2  # of a record, from which on the level of its steady end is one of it
NEARLY_ALL = 0.9  # of a record: an answer that rests on more of it rests on all of it
LAST_STICK = 0.5  # of a typical stick: how much of the last one is used, so that no slip has begun in it
REPEATABLE = 1e-4  # of a force: no contact repeats a slip better; a fit that believes it does has many false optima
UNEQUAL = 0.06  # scatter of the drop from cycle to cycle above which cycles are not alike
FED = 2.0  # times what the load does to the force at an onset: a slip that comes early finds a fresher contact
SHORT_RISE, SHORT_LOADING = 40, 2.0  # samples, and half periods: no line is drawn through a shorter first rise
RISE = (0.15, 0.4, 0.9)  # of the first rise: where a short one is cut, and the stretch a straight line is taken from


def name_of(entry: LogEntry) -> str:
    """Short name of a log in sentences, with the part of it that it is."""
    return ", ".join([entry.path.name, *(f"{w} {entry.labels[w]}" for w in (STROKE, PART) if w in entry.labels)])


# A log cut, corrected and segmented: its force the right way up, the samples that count, its phases and noise.


@dataclass(frozen=True)
class DriveClock:
    """A clock that goes as the drive does, on a course at its mean speed [m/s]: sticks are straight lines by it.

    time (n,) [s] of samples, shown (n,) [s] what the clock shows then.
    """

    drive: Drive
    time: Array
    shown: Array
    speed: float

    @staticmethod
    def of(drive: Drive, time: Array) -> DriveClock:
        """The clock of a drive at rising times (n,) [s]; at its turns it goes on slowly."""
        speeds = np.abs(drive.motion(time)[1])
        way = np.cumsum(np.maximum(0.5 * (speeds[1:] + speeds[:-1]), AT_TURNS * np.max(speeds)) * np.diff(time))
        speed = float(way[-1] / (time[-1] - time[0]))
        return DriveClock(drive, time, time[0] + np.concatenate([[0.0], way / speed]), speed)

    def back(self, shown: Array) -> Array:
        """Times [s] at which it shows these."""
        return np.interp(shown, self.shown, self.time)

    def in_time(self, phases: Segmentation) -> Segmentation:
        """Phases that were seen by it."""

        def moved(cycles: DetectedCycles) -> DetectedCycles:
            return replace(cycles, **{name: self.back(getattr(cycles, name)) for name in EVENTS})

        at_drive = None if phases.at_drive is None else moved(phases.at_drive)
        return replace(phases, cycles=moved(phases.cycles), at_drive=at_drive)


@dataclass(frozen=True)
class Segmented:
    """One log, cut, corrected and segmented.

    entry; rig of this log; drive while the record counts; corrected: its record; sign applied to the friction force;
    force (n,) [N], sliding positive, tare taken off; used (n,) samples that may count; counted (n,): of these, those
    that are no spikes; time, measured (k,) [s], [N] from the first of the used samples to the last, NaN where one does
    not count; phases: what was segmented; noise [N]; verdict: on its regime. Along a course of the drive `time`, drive
    and phases are those by its clock.
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
    phases: Segmentation
    noise: float
    verdict: Verdict
    clock: DriveClock | None = None

    def in_time(self, fit_mode: FitMode, window: tuple[float, float]) -> tuple[Segmented, FitMode, tuple[float, float]]:
        """The log, how it is followed and its window, all in time again where they were seen along a course."""
        clock = self.clock
        if clock is None:
            return self, fit_mode, window
        phases, settled = clock.in_time(self.phases), fit_mode.steady_since
        log = replace(
            self, time=clock.time, drive=clock.drive, phases=phases, verdict=replace(self.verdict, phases=phases)
        )
        settled = None if settled is None else float(clock.back(np.array(settled)))
        begin, end = clock.back(np.array(window)).tolist()
        return log, replace(fit_mode, steady_since=settled), (begin, end)

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


def segmented(entry: LogEntry, record: Record, rig: Rig, *, elastic: bool = True) -> Segmented:
    """Cut, correct and segment one log.

    Args:
        elastic: False where something else than the stated spring may load the sticks, or swing the mass.

    Raises:
        FitError: no drive speed, a drive that turns, an interval without samples, or a log of which nothing is left.
    """
    drive = _drive(rig, entry, record)
    wanted = Corrections(entry.tare, entry.normal_tare, entry.crosstalk, entry.tilt, entry.window, entry.exclude)
    try:
        corrected = correct(record, wanted)
    except LogError as error:
        raise FitError(str(error)) from None
    record = corrected.record
    force = np.asarray(record.friction_force, float)
    used = corrected.used & np.isfinite(force) & np.isfinite(record.normal_force)
    _refuse_too_few(entry, record, used)
    sign = -1 if entry.flip_sign else 1
    if entry.flip_sign is None:
        # A slip may swing the spring past its rest, and a hold keeps it there: it pulls the other way meanwhile.
        driven = used & _moves(drive, record.time)
        along = force * np.sign(drive.motion(record.time)[1]) if drive.turns else force
        sign = -1 if float(np.nanmedian(thinned(kept(along, driven if np.any(driven) else used)))) < 0.0 else 1
    force = -force if sign < 0 else force
    inner = slice(int(np.argmax(used)), used.size - int(np.argmax(used[::-1])))
    time, measured = record.time[inner], shown(force, used)[inner]
    clock, turns = DriveClock.of(drive, time) if drive.accelerates else None, strokes_of(drive, time, rig)
    known, seen = Known(rig.stiffness if elastic else 0.0, 0.0, rig.half_period or 0.0, rig.plate), measured
    if clock is not None:  # by that clock nothing swings as it does in time
        known, seen = replace(known, plate=None), _at_drive(time, bridged(measured, ~np.isfinite(measured)), drive, rig)
        time, drive = clock.shown, Drive.of(clock.speed)
    known = replace(known, drive_speed=max(drive.speeds))
    if not drive.constant:
        verdict = _verdict_on_programme(time, measured, rig, drive, known)
    else:
        turns = turns_of_sign(measured) if clock is None else turns
        verdict = of_strokes(time, seen, turns, known, rig.noise)
    phases = verdict.phases
    if phases.low_snr:  # half lost in the noise: those that the period of the rig shows; the model fills in the others
        phases = segment(time, seen, half_period=rig.half_period or None, noise=rig.noise, plate=known.plate)
    counted = used.copy()
    counted[inner] &= ~phases.spikes
    noise = rig.noise or phases.noise
    if rig.noise is None and clock is not None and (len(turns) > 1 or rig.plate is not None):
        # Strokes that slide throughout bend like noise, and at the drive there is less of it than on a plate.
        noise = min(noise if rig.plate is None else np.inf, white_noise(bridged(measured, ~np.isfinite(measured))))
    return Segmented(
        entry, rig, drive, corrected, sign, force, used, counted, time, measured, phases, noise, verdict, clock
    )


def _drive(rig: Rig, entry: LogEntry, record: Record) -> Drive:
    """How the drive goes while the record counts: one speed, or a programme that goes one way."""
    name = name_of(entry)
    if rig.drive_speed is None:
        raise FitError(f'{name} has no drive speed; give drive_speed = "… mm/s" in its [[logs]] or under [rig]')
    window, end = entry.window or (0.0, float(record.time[-1])), float(record.time[-1])
    drive = Drive.of(rig.drive_speed, end, FITTED_PIECES)
    along = drive.between(*window) if drive.accelerates else None
    pieces = drive.within(*window) if along is None else list(zip(along.starts, along.speeds, strict=True))
    speeds = [speed for _, speed in pieces]
    speeds = [speed if abs(speed) > ROUNDING * max(map(abs, speeds)) else 0.0 for speed in speeds]
    if not any(speeds):
        raise FitError(
            f"{name} has a drive speed of 0 m/s; expected a moving drive, since a hold alone cannot be fitted: give "
            "the speed it moved at, or take its [[logs]] out"
        )
    if min(speeds) < 0.0 < max(speeds) and along is None:
        raise FitError(f"{name} has a drive that turns within the part that is used; cut it into one window per stroke")
    if along is not None:
        return drive.between(*window, sign=-1.0 if max(speeds) <= 0.0 else 1.0)
    changes = ((t, abs(speed)) for (_, before), (t, speed) in pairwise(pieces) if speed != before)
    return Drive.of(((0.0, abs(speeds[0])), *changes))


def strokes_of(drive: Drive, time: Array, rig: Rig) -> list[tuple[int, int, int]]:
    """First row, end and direction of every stroke of a drive on a course, of the rows at times (n,) [s]; but for half
    a natural period after a turn: a slip that the drive turns in goes on the old way meanwhile."""
    if not drive.turns:
        return [(0, time.size, 1)]
    ways, out = np.sign(drive.motion(time)[1]).astype(int), list[tuple[int, int, int]]()
    for way in (1, -1):
        for first, last in true_runs(ways == way):
            skipped = min(rig.half_period or 0.0, SKIPPED * float(time[last - 1] - time[first])) if first else 0.0
            begun = int(np.searchsorted(time, time[first] + skipped))
            if last - begun >= FEWEST_ROWS:
                out.append((begun, last, way))
    return sorted(out)


def _refuse_too_few(entry: LogEntry, record: Record, used: Bools) -> None:
    """Refuse a log of which hardly a sample (n,) is left; what took them away decides the remedy."""
    name, left = name_of(entry), int(np.count_nonzero(used))
    time, (start, stop), end = record.time, entry.window or (0.0, np.inf), float(record.time[-1])
    inside = int(np.count_nonzero((time >= start) & (time <= stop)))
    if inside < FEWEST <= time.size:
        remedy = "widen it" if start >= 0.0 and stop <= end else "move the window inside"
        raise FitError(
            f"{name}: the window {start:g} to {stop:g} s holds {inside} row(s); the log runs from 0 to {end:.6g} s"
            f"{zero_of_times(record)}; {remedy}"
        )
    if left < FEWEST:
        remedy = "exclude less" if entry.exclude and inside >= FEWEST else "record longer, or sample faster"
        raise FitError(f"{name} has {left} usable samples of {inside}; expected hundreds: {remedy}")


def _moves(drive: Drive, time: Array) -> Bools:
    """Whether the drive moves at times (n,) [s]."""
    return np.asarray(np.array(drive.speeds)[np.searchsorted(drive.starts, time, side="right") - 1] > 0.0)


def _verdict_on_programme(time: Array, force: Array, rig: Rig, drive: Drive, known: Known) -> Verdict:
    """The regime where the drive changes its speed or stands: slips are found without its rests, along its way."""
    half_period, moves = rig.half_period or None, _moves(drive, time)
    phases = segment(time, force, half_period=half_period, noise=rig.noise, plate=rig.plate)
    if not np.all(moves) and np.count_nonzero(moves) >= FEWEST:
        moved, steps = time[moves], np.diff(time[moves])
        run = np.concatenate([[0.0], np.cumsum(np.minimum(steps, GAP * float(np.median(steps))))])
        cycles = segment(run, force[moves], half_period=half_period, noise=phases.noise, plate=rig.plate).cycles
        # From the row before: what ends where the drive stops ends there, and not where it starts again.
        before = {name: np.maximum(np.searchsorted(run, getattr(cycles, name)) - 1, 0) for name in EVENTS}
        times = {name: moved[row] + getattr(cycles, name) - run[row] for name, row in before.items()}
        phases = replace(phases, cycles=replace(cycles, **times))
    if not changes_speed(tuple(zip(drive.starts, drive.speeds, strict=True))):
        return replace(classify(time[moves], force[moves], known, noise=rig.noise), phases=phases)
    if phases.count and known.loading_rate:
        steps = np.diff(time) * np.where(moves[:-1], [drive.at(t) for t in time[:-1]], 0.0) / known.drive_speed
        travel, rows = np.concatenate([[0.0], np.cumsum(steps)]), np.append(steps > 0.0, True)
        times = {name: np.interp(getattr(phases.cycles, name), time, travel) for name in EVENTS}
        cycles = replace(phases.cycles, **times)
        along = replace(phases, cycles=cycles, at_drive=None, spikes=phases.spikes[rows], phase=phases.phase[rows])
        if not classify(travel[rows], force[rows], known, given=along).phases.count:
            phases = segment(time, force, half_period=half_period, noise=rig.noise, slips=False, plate=rig.plate)
    return Verdict(Regime.PROGRAMME, SURE, ("the drive changes its speed",), phases)


# How a log is followed, and the part of it that a fit takes.


@dataclass(frozen=True)
class FitMode:
    """name: cycle by cycle, continuously, or as steady sliding; steady_since: since when the last stretch slides
    steadily [s], None where it does not; begins_sliding; low_snr: the noise hides so much of the cycles that many of
    them were missed; rhythm: of what only looks steady."""

    name: Literal["cycles", "continuous", "sliding"]
    steady_since: float | None = None
    begins_sliding: bool = False
    low_snr: bool = False
    rhythm: ForceOscillation | None = None


def fit_mode_of(log: Segmented, phases: Segmentation, slip_times: Array, stiffness: float) -> FitMode:
    """How a log is followed, or a stretch of it with its own phases; slip_times: of its cycles (c,) [s];
    stiffness [N/m], 0 where something else makes the mass swing."""
    time, force, noise, drive, half_period = log.time, log.measured, log.noise, log.drive, log.rig.half_period or 0.0
    if drive.constant and not phases.slides_on(slip_times.size):
        return FitMode("cycles", low_snr=phases.low_snr and slip_times.size > 0)
    settled = steady_since(time, force, noise, half_period)
    if settled is not None and drive.constant and phases.stick_slope is not None:
        # A slip near the end of a slow log leaves a stick too short to be seen to rise.
        late = np.isfinite(force) & (time >= settled)
        rises = line_slope(time[late], force[late], noise)
        if rises >= phases.stick_slope[0] - SIGNIFICANT * slope_error(time[late], noise):
            settled = None
    begins, good = bool(phases.phase.size and phases.phase[0] == SLIDING), np.isfinite(force)
    if begins and good.any():  # near the level that it has while the drive moves, and not with a first rise
        f, moves = kept(force, good), _moves(drive, kept(time, good))
        loaded = 0.5 * float(np.median(thinned(f[moves] if np.any(moves) else f)))
        begins = bool(np.median(f[: max(f.size // 100, 3)]) > loaded and np.min(f[:5]) > loaded - SIGNIFICANT * noise)
    fit_mode = FitMode("continuous", settled, begins)
    if drive.constant and slip_times.size == 0:
        rise = int(np.argmax(phases.phase != STICK)) if phases.phase.size and phases.phase[0] == STICK else 0
        fit_mode = FitMode("sliding", settled, begins) if begins or rise < 5 else fit_mode
    if settled is None:
        return fit_mode
    late, known = time >= settled, Known(stiffness, drive.at(float(time[-1])), half_period)
    rhythm = hidden_rhythm(time[late], force[late], log.load[late], known)
    return fit_mode if rhythm is None else replace(fit_mode, steady_since=None, rhythm=rhythm)


def steady_since(time: Array, force: Array, noise: float, half_period: float) -> float | None:
    """Since when a force is level within its noise up to the end [s]; None where it is not for long enough."""
    good = np.isfinite(force)
    if np.count_nonzero(good) < FEWEST_ROWS:
        return None
    t, f = kept(time, good), kept(force, good)
    width = max(round(2.0 * half_period / float(np.median(thinned_steps(t)))), 8)
    count = t.size // width
    if count < 2:
        return None
    # Bins are counted from the end, so that the last one is whole.
    rows, local = f[t.size - count * width :].reshape(count, width), np.linspace(-1.0, 1.0, width)
    mean, slope = rows.mean(axis=1), rows @ local / float(local @ local)
    left = np.sum((rows - mean[:, None] - slope[:, None] * local) ** 2, axis=1) / (width - 2)
    # A swing that fades hides in a bin of one period as little as a slope does.
    restless = (left > noise**2 * (1.0 + SIGNIFICANT * np.sqrt(2.0 / width))) | (
        np.abs(slope) > SIGNIFICANT * noise / np.sqrt(float(local @ local)) + 0.02 * np.abs(mean)
    )
    first = int(np.flatnonzero(restless)[-1]) + 1 if restless.any() else 0
    start = t.size - (count - first) * width
    return float(t[start]) if first < count and t.size - start >= FEWEST_ROWS else None


def moving_pieces(drive: Drive, begin: float, end: float) -> list[tuple[float, float, float]]:
    """(start [s], stop [s], speed [m/s]) of the stretches of a window in which the drive moves; a course in thirds."""
    if drive.accelerates:
        times = np.linspace(begin, end, 4)
        means = np.diff(drive.motion(times)[0]) / np.diff(times)
        fast = means > 0.5 * np.max(means)  # else it may still turn the force
        return [
            (a, b, v) for (a, b), v, kept in zip(pairwise(times.tolist()), means.tolist(), fast, strict=True) if kept
        ]
    edges = pairwise([begin, *drive.changes(begin, end), end])
    return [(a, b, drive.at(0.5 * (a + b))) for a, b in edges if drive.at(0.5 * (a + b)) > 0.0]


def fitted_window(log: Segmented, phases: Segmentation, fit_mode: FitMode, skip: int = 0) -> tuple[float, float]:
    """The part of a record that a fit takes: begin and end [s].

    A record may start before the drive does, or in the middle of a slip; both are cut off. After `skip` cycles
    (running-in) it starts in the stick that follows them; what slides is taken from where it is steady on.
    """
    cycles, begin, end = phases.cycles, float(log.time[0]), float(log.time[-1])
    if fit_mode.name == "sliding" and fit_mode.steady_since is not None:
        return fit_mode.steady_since, end
    if fit_mode.name == "sliding" or fit_mode.begins_sliding or (fit_mode.name == "cycles" and not cycles.count):
        return begin, end
    resting = phases.phase == STICK
    if fit_mode.name == "cycles":
        if 0 < skip < cycles.count:
            arrest, onset = float(cycles.arrest[skip - 1]), float(cycles.onset[skip])
            return arrest + 0.3 * (onset - arrest), end
        first = float(cycles.onset[0])
        if phases.begins_in_slip:
            begin = float(log.time[np.flatnonzero(resting & (log.time < first))[:1]].sum()) or begin
            begin += 0.3 * (first - begin)
    else:
        first = end if np.all(resting) else float(log.time[int(np.argmin(resting))])
        first = min([first, *cycles.onset[:1].tolist()])
        # While the drive stands, or starts anew, a force that only rises is no straight line.
        if max((a for a, _, _ in moving_pieces(log.drive, begin, end) if a < first), default=begin) > begin:
            return begin, end
    return max(begin, _loading_start(log, begin, first)), end


def _loading_start(log: Segmented, begin: float, onset: float) -> float:
    """Where the straight loading line of the first stick begins: earlier samples do not lie on it."""
    rows = np.isfinite(log.measured) & (log.time >= begin) & (log.time <= onset)
    t, f = log.time[rows], log.measured[rows]
    if not t.size:
        return begin
    width = max(min(t.size // 10, 25), 1)
    flat = running_means(f, width)
    low, high = float(np.min(flat)), float(np.max(flat))
    lowest, lower, upper = (int(np.flatnonzero(flat <= low + share * (high - low))[-1]) + width // 2 for share in RISE)
    # Before an onset that ends a short rise the mass slips long since: only the lower end of it is of the stick.
    if t.size < SHORT_RISE or onset - begin < SHORT_LOADING * (log.rig.half_period or 0.0):
        return float(t[lowest])
    late = slice(lower, max(upper, lower + 3))  # by force and not by time: however long the machine waited before it
    early = slice(0, lower)
    centre = t[early][width // 2 : lower - width + 1 + width // 2]
    if centre.size == 0:
        return begin
    middle = float(np.mean(t[late]))
    (slope, height), unscaled = np.polyfit(t[late] - middle, f[late], 1, cov="unscaled")
    off = running_means(f[early] - height - slope * (t[early] - middle), width)
    # The line itself is uncertain where it is extrapolated.
    sd = log.noise * np.sqrt(1.0 / width + unscaled[1, 1] + unscaled[0, 0] * (centre - middle) ** 2)
    wrong = np.flatnonzero(np.abs(off) > (SIGNIFICANT + 1.0) * sd)
    if wrong.size == 0:
        return begin
    # Where the difference was last seen it had become small, not nought: a little of the line is left out as well.
    bend = float(centre[wrong[-1]] + width * np.median(thinned_steps(t)))
    return bend + 0.1 * max(float(t[late][0]) - bend, 0.0)


# One log, ready to be fitted or left out.


@dataclass(frozen=True)
class RecordEdits:
    """What was cut and corrected, line by line; raw: the record as it was read."""

    changes: tuple[Change, ...]
    raw: Record


@dataclass(frozen=True)
class Prepared:
    """One log, ready to be fitted or left out.

    record; entry; rig of this log; sign applied to the friction force; force (n,) [N], sliding positive, tare
    taken off; used (n,) samples that count; segmentation; data for the estimator; slip_times (c,) [s] of the
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
    slip_times: Array
    left_out: str | None
    noise_estimated: bool
    account: RecordEdits
    judgement: Judgement
    hidden_swing: float
    regime_verdict: Verdict
    fit_mode: FitMode
    pieces: tuple[Prepared, ...] = ()

    @property
    def as_continuous(self) -> Prepared:
        """The same log, to be followed by the model instead of cycle by cycle as they were seen."""
        return replace(self, fit_mode=replace(self.fit_mode, name="continuous", low_snr=False))

    @property
    def one_way(self) -> tuple[Prepared, ...]:
        """The log, or its strokes where its drive goes on a course."""
        return self.pieces if self.data.on_course and self.pieces else (self,)

    @property
    def regime(self) -> Regime | None:
        """What it shows; None where no slip has come yet."""
        return self.regime_verdict.regime

    @property
    def typical(self) -> int:
        """Number of cycles in the stretch that shows most of them."""
        if self.fit_mode.name == "cycles":
            return int(self.slip_times.size)
        return max((piece.slip_times.size for piece in self.pieces), default=0)

    @property
    def curves(self) -> LogCurves:
        """What is drawn of it, with its detected cycles; nothing is fitted."""
        c, raw = self.segmentation.cycles, self.account.raw.friction_force
        return LogCurves(
            name=self.name,
            time=self.record.time,
            normal_force=self.record.normal_force,
            friction_force=self.force,
            fitted_force=np.full(self.record.time.size, np.nan),
            used=self.used,
            noise=float(self.segmentation.noise),
            drive_speed=self.data.drive_speed,
            cycles=np.column_stack([c.onset, c.arrest, c.onset_force, c.arrest_force, np.full(c.onset.size, np.nan)]),
            raw_force=None if raw is self.record.friction_force else self.sign * raw,
        )

    @property
    def name(self) -> str:
        """Short name of the log in sentences."""
        return name_of(self.entry)

    @cached_property
    def span(self) -> tuple[float, float]:
        """Times of the first and the last sample that count [s]."""
        first, last = np.flatnonzero(self.used)[[0, -1]].tolist()
        return float(self.record.time[first]), float(self.record.time[last])

    def share_from(self, since: float) -> float:
        """Which share of what counts of the record, by time, lies from `since` [s] on."""
        first, last = self.span
        return max(last - since, 0.0) / max(last - first, 1e-300)

    @property
    def rests_on(self) -> str:
        """Which part of the record an answer rests on, in words; "" where it is nearly all of it."""
        first, last = self.span
        share = (self.data.end - self.data.begin) / max(last - first, 1e-300)
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

    @cached_property
    def jumps(self) -> tuple[int, int]:
        """How many drops of its force are jumps, and how many drops there are; see `segment.jumps`."""
        inside = slice(*np.searchsorted(self.record.time, self.span))
        force, noisy = shown(self.force, self.used)[inside], replace(self.segmentation, noise=self.data.noise)
        drive = self.data.programme if self.data.on_course else None
        signs = None if drive is None else np.where(drive.motion(self.record.time[inside])[1] < 0.0, -1.0, 1.0)
        slip = self.rig.half_period / self.data.interval
        return jumps(force, replace(noisy, spikes=~self.used[inside]), slip, signs)

    @property
    def scatter(self) -> float:
        """How much the force drop differs from one settled cycle to the next, as a share of the mean drop, beyond
        what the noise and the normal force do; 0 with fewer than four cycles. A slow drift does not count."""
        cycles, load = self.segmentation.cycles, self.data.normal_force
        if self.fit_mode.name != "cycles" or cycles.count < 4 or self.data.on_course:  # there each rest has its length
            return 0.0
        mean = float(np.mean(load.values))
        drop = cycles.onset_force * mean / load.at(cycles.onset) - cycles.arrest_force * mean / load.at(cycles.arrest)
        # The median of n sizes is large by chance: the standard error of 1.4826 times it is 1.17 / sqrt(n) of its mean.
        by_chance = 2.0 * (1.0 + 2.0 * 1.17 / np.sqrt(cycles.count - 2)) ** 2
        return drop_scatter(drop[1:], max(4.0, by_chance) * self.data.noise**2)

    @property
    def unlike(self) -> bool:
        """Whether cycles differ so among themselves that no model of equal friction describes them: more than a normal
        force that the model follows makes them differ."""
        if not self.scatter > UNEQUAL:
            return False
        cycles = self.segmentation.cycles
        load = self.data.normal_force.at(cycles.onset) / self.data.mean_normal_force
        moved = float(np.sqrt(np.mean(np.diff(load) ** 2) / 2.0) * np.mean(cycles.onset_force))
        return self.scatter > UNEQUAL + FED * moved / float(np.mean(cycles.drop))


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
    part = RecordPart(log.time, log.measured, log.phases, expected, log.load)
    judgement = judge(log.record, [part], scene.thresholds, log.used)
    stiffness = 0.0 if model.vibrates else log.rig.stiffness  # else the mass swings with something else
    slip_times = log.phases.cycles.fall[entry.skip_cycles :]
    fit_mode = fit_mode_of(log, log.phases, slip_times, stiffness)
    window = fitted_window(log, log.phases, fit_mode, entry.skip_cycles)
    if log.clock is not None:
        fit_mode = FitMode("continuous")
        window = (float(log.time[0]), float(log.time[-1])) if log.clock.drive.turns else window
    log, fit_mode, window = log.in_time(fit_mode, window)
    slip_times = log.phases.cycles.fall[entry.skip_cycles :]
    load, hidden = _load(log, window, judgement, scene, follows=model.follows_load)
    prepared = Prepared(
        record=log.record,
        entry=entry,
        rig=log.rig,
        sign=log.sign,
        force=log.force,
        used=log.counted,
        segmentation=log.phases,
        data=_data(log, load, window, unknowns),
        slip_times=slip_times,
        left_out=_left_out(fit_mode, log, judgement),
        noise_estimated=log.rig.noise is None,
        account=_account(record, log, window[0]),
        judgement=judgement,
        hidden_swing=hidden,
        regime_verdict=log.verdict,
        fit_mode=fit_mode,
    )
    if fit_mode.name == "sliding":
        return replace(prepared, data=_as_sure_as_its_level(prepared, prepared.data))
    if log.clock is not None:
        return replace(prepared, pieces=_strokes(prepared, strokes_of(log.drive, log.time, log.rig)))
    return replace(prepared, pieces=_pieces(prepared, log, stiffness)) if fit_mode.name == "continuous" else prepared


def _account(raw: Record, log: Segmented, begin: float) -> RecordEdits:
    """What was cut and corrected of a log; begin: where the fit begins [s]."""
    changes = list(log.corrected.changes)
    if log.sign < 0:
        why = "as given" if log.entry.flip_sign is not None else "it slides with a negative force"
        changes.append(Change("flip_sign", f"the friction force was turned over: {why}"))
    if begin > float(log.time[0]):
        skip = log.entry.skip_cycles
        kind, text = "lead", f"the fit begins at {begin:.4g} s, where the first straight line of a stick does"
        if skip:
            cycles = "cycle" if skip == 1 else f"{skip} cycles"
            kind, text = "skip_cycles", f"the first {cycles} left out as given: the fit begins at {begin:.4g} s"
        changes.append(Change(kind, text, begin, "s"))
    return RecordEdits(tuple(changes), raw)


def _load(
    log: Segmented, window: tuple[float, float], judgement: Judgement, scene: Scene, *, follows: bool
) -> tuple[LoadSpline, float]:
    """The normal force as the model takes it: over time, else its mean, and the swing that this hides."""
    time, force, cycles, hidden = log.record.time, log.record.normal_force, log.phases.count, 0.0
    try:
        load = smooth(kept(time, log.used), kept(force, log.used), name_of(log.entry), cycles)
        if not follows:
            hidden = swing(load.force, *window)
            hidden = hidden if hidden > SIGNIFICANT * load.sd / float(np.mean(load.force.values)) else 0.0
            inside = log.used & (time >= window[0]) & (time <= window[1])
            load = level(time[inside], force[inside], name_of(log.entry), cycles)
    except FitError:
        if judgement.verdict != "reject":
            raise
        return LoadSpline(NormalForce.of(1.0)), 0.0  # the log is left out: nothing is computed with it
    programme = log.speed if log.drive.constant else log.drive.paces
    scene.check_ranges(log.entry, programme, (min(load.force.values), max(load.force.values)))
    return load, hidden


def _data(log: Segmented, load: LoadSpline, window: tuple[float, float], unknowns: Unknowns) -> LogData:
    """The log as the estimator sees it."""
    rig, mean = log.rig, float(np.mean(load.force.values))
    size = float(np.max(np.abs(kept(log.force, log.used))))
    # a log without noise, as a simulation leaves it, is weighted by what the computation is surely good for
    noise = log.noise if log.noise > NOISELESS * size else REPEATABLE * size
    return LogData(
        time=np.ascontiguousarray(log.record.time),
        force=np.where(np.isfinite(log.force), log.force, 0.0),
        weight=np.where(log.counted, 1.0 / max(noise, 1e-12) ** 2, 0.0),
        base=unknowns.base({"mass": rig.mass, "stiffness": rig.stiffness, "damping": rig.damping}),
        drive_speed=log.speed if log.clock is None else log.clock.speed,
        normal_force=load.force,
        normal_force_sd=float(np.hypot(load.sd, REPEATABLE * mean)),
        begin=window[0],
        end=window[1],
        own=np.full(len(unknowns.names), np.nan) if np.any(unknowns.grouped) else np.empty(0),
        groups=tuple("" if by is None or by == EACH_LOG else log.entry.labels[by] for by in unknowns.per),
        programme=None if log.drive.constant else log.drive,
        jitter_sd=load.jitter_sd if load.jitter_sd > 0.3 * REPEATABLE * mean else 0.0,
    )


def _pieces(log: Prepared, whole: Segmented, stiffness: float) -> tuple[Prepared, ...]:
    """The stretches of one speed in which cycles repeat, or the mass slides steadily: what a start is taken from."""
    data, half_period, out = log.data, whole.rig.half_period or 0.0, []
    for start, stop, speed in moving_pieces(data.programme or Drive((0.0,), (data.drive_speed,)), data.begin, data.end):
        rows = slice(*np.searchsorted(data.time, [start, stop]))
        time, force = data.time[rows], np.where(data.weight[rows] > 0, data.force[rows], np.nan)
        known = Known(stiffness, speed, half_period, whole.rig.plate)
        verdict = classify(time, force, known, noise=whole.noise)
        phases = verdict.phases
        if phases.low_snr:
            phases = segment(time, force, half_period=half_period or None, noise=whole.noise, plate=known.plate)
        part = replace(whole, time=time, measured=force, drive=Drive.of(speed))
        fit_mode, slip_times = fit_mode_of(part, phases, phases.cycles.fall, stiffness), np.empty(0)
        if fit_mode.name == "cycles" and phases.count >= FEW_SLIPS:
            slip_times = phases.cycles.fall
        elif fit_mode.name != "cycles" and fit_mode.steady_since is not None:
            fit_mode = replace(fit_mode, name="sliding")
        else:
            continue
        begin, end = fitted_window(part, phases, fit_mode)
        own = replace(data, begin=begin, end=end, drive_speed=speed, programme=None)
        piece = replace(log, data=own, slip_times=slip_times, fit_mode=fit_mode, segmentation=phases, pieces=())
        out.append(replace(piece, regime_verdict=verdict))
    return tuple(out)


def _strokes(log: Prepared, strokes: Sequence[tuple[int, int, int]]) -> tuple[Prepared, ...]:
    """The strokes of a log whose drive turns on a course, each the right way up: what a start is taken from."""
    out, data, drive = [], log.data, log.data.programme
    inside = data.time[np.searchsorted(data.time, data.begin) :]
    for first, last, way in strokes:
        begin, end = float(inside[first]), float(inside[last - 1])
        falls = log.slip_times[(log.slip_times > begin) & (log.slip_times < end)]
        along = None if drive is None else drive.between(begin, end, sign=float(way))
        own = replace(data, force=way * data.force, begin=begin, end=end, programme=along)
        out.append(replace(log, data=own, slip_times=falls, fit_mode=FitMode("cycles"), pieces=()))
    return tuple(out)


def _left_out(fit_mode: FitMode, log: Segmented, judgement: Judgement) -> str | None:
    """Why a log is left out, in a sentence; None where it is not."""
    name, cycles, skipped, settled = name_of(log.entry), log.phases.count, log.entry.skip_cycles, fit_mode.steady_since
    if judgement.verdict == "reject" and not judgement.swapped:
        return f"{name} is rejected by the quality gate: {judgement.reason}; a threshold can be moved under [quality]"
    reason = None
    if log.verdict.strokes > 1 and log.clock is None:
        reason = (
            f"{name} goes to and fro: its force changes its sign in {log.verdict.strokes} strokes; give the programme "
            'of the drive with its signs, its position column (columns = { position = "…" }), or a window of one stroke'
        )
    elif fit_mode.name == "cycles" and 0 < cycles <= skipped:
        reason = f"{name}: skip_cycles = {skipped} leaves none of its {cycles} cycles; lower it"
    elif fit_mode.name == "cycles" and not cycles:
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
                f"{100 * lasts / whole:.2g} % of the record: no level of it; choose a part with a window"
            )
    if judgement.swapped and (reason or judgement.verdict == "reject"):
        return f"{name}: normal force and friction force look swapped"
    return reason


# Parts of a prepared log.


def at_drive(log: Prepared) -> LogData:
    """The data of a log with the force that a load cell at the drive shows; where it was measured there, its own."""
    data, drive = log.data, log.data.programme if log.data.on_course else None
    if log.rig.plate is None:
        return data
    return replace(data, force=_at_drive(data.time, bridged(data.force, data.weight == 0.0), drive, log.rig))


def _at_drive(time: Array, force: Array, drive: Drive | None, rig: Rig) -> Array:
    """A force (n,) as a load cell at the drive shows it, also where a drive accelerates its mass."""
    if rig.plate is None:
        return force
    pushed = 0.0 if drive is None else (rig.mass or 0.0) * np.gradient(drive.motion(time)[1], time)
    return drive_force(time, force + pushed, *rig.plate)


def settled_part(prepared: Prepared) -> Prepared | None:
    """The log from where it slides steadily on, as a log of sliding; None where it does not, or for so short a part of
    the record that its level is none of it."""
    since = prepared.fit_mode.steady_since
    if since is None or prepared.fit_mode.name == "cycles":
        return None
    if prepared.data.on_course:
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
    """The data of a steady end; where most of what slides slid at another level, its load counts as that unsure."""
    share, time = log.share_from(data.begin), log.record.time
    inside = int(np.searchsorted(time, log.span[0]))
    phase = np.full(time.size, STICK, np.int8)
    phase[inside : inside + log.segmentation.phase.size] = log.segmentation.phase[: phase.size - inside]
    sliding, settled = log.used & (time < data.begin) & (phase == SLIDING), log.used & (time >= data.begin)
    if share > 0.5 or np.count_nonzero(sliding) < FEWEST_ROWS:
        return data
    before, after = (float(np.mean(log.force[rows] / data.normal_force.at(time[rows]))) for rows in (sliding, settled))
    off = (1.0 - share) * abs(before / after - 1.0) * data.mean_normal_force if after else 0.0
    return replace(data, normal_force_sd=float(np.hypot(data.normal_force_sd, off)))


def cut_in_last_stick(prepared: Prepared, arrest: float, stick: float) -> Prepared:
    """The log cut in its last stick: `arrest` [s] of the last slip, `stick` [s] a typical stick duration."""
    end = min(prepared.data.end, arrest + LAST_STICK * stick)
    return replace(prepared, data=replace(prepared.data, end=end))
