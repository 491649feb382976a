"""How a log is followed (cycle by cycle, continuously, as steady sliding), and the part of it that the fit takes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from data_io.arrays import kept, thinned, thinned_steps
from identify.logs.noise import line_slope, running_means, slope_error
from identify.logs.regime import Spectrum
from identify.logs.segment import SLIDING, STICK, Segmentation
from identify.simulation.drive import Drive

Array = NDArray[np.float64]
Name = Literal["cycles", "continuous", "sliding"]

SEEN_RISE = 5  # samples of a first rise from which on it is one
LOOSE = 5.0  # standard deviations of the scatter within a bin beyond which a force is not level
BIN, LEAST_SETTLED = 8, 20  # samples of a bin, and of steady sliding, at least
STUCK = 3.0  # standard errors by which a level force must rise more slowly than a stick to count as sliding
LEVEL = 0.5  # of the middle force: a record that starts above slides from its start
RISE = (0.4, 0.9)  # of the first rise: the stretch its straight line is taken from
SHORT_RISE, SHORT_LOADING = 40, 2.0  # samples, and half periods: no line is drawn through a shorter first rise,
LOW = 0.15  # but the fit begins at the last sample below this part of it
CLEAR = 0.1  # of the loading line after the bend that is left out
ONSET_MARGIN = 6.0  # standard deviations by which a record must leave its first loading line
LOADS = (0.5, 4.0)  # times k v_0: how fast a swing of stick-slip loads; a saw-tooth's first harmonic does by 2
FASTER = 1.2  # times the natural frequency of the rig: no stick-slip is faster
FROM_LOAD = 0.2  # of the swing: with so much in the normal force it may come from there
ENOUGH = 25  # samples of a period in which its slip is seen
ALIASES = 3  # times the sampling rate up to which a swing may really be


@dataclass(frozen=True)
class Swing:
    """A swing: how many samples see one period, its frequency [Hz] if it is no faster than it looks, and its range
    [N]."""

    samples: float
    frequency: float
    range: float

    def __str__(self) -> str:
        """What the log does, to follow its name."""
        return (
            f"swings by {self.range:.2g} N, {self.frequency:.3g} times a second as far as "
            f"{self.samples:.2g} samples per period tell, as stick-slip does: sample it at "
            f"{ENOUGH * self.frequency:.2g} Hz or more"
        )


@dataclass(frozen=True)
class FitMode:
    """The name; steady_since: since when the last stretch slides steadily [s], None where it does not; begins_sliding;
    low_snr: the noise hides so much of the cycles that many of them were missed; rhythm: of what only looks steady."""

    name: Name
    steady_since: float | None
    begins_sliding: bool
    low_snr: bool = False
    rhythm: Swing | None = None


@dataclass(frozen=True)
class ForceRecord:
    """What a log moves by: time [s], force [N] and load [N], (n,) each, NaN where a sample does not count; noise: its
    standard deviation [N]; half_period: half the natural period of the rig [s], 0 where it is not known; the drive."""

    time: Array
    force: Array
    load: Array
    noise: float
    half_period: float
    drive: Drive


def fit_mode_of(record: ForceRecord, found: Segmentation, falls: Array, stiffness: float) -> FitMode:
    """How a log is followed.

    Args:
        found: its phases; falls: of its cycles [s]; stiffness: of the rig [N/m]; 0, as the half period of the record,
            where it is not known, or something else makes the mass swing.
    """
    time, force, noise, drive = record.time, record.force, record.noise, record.drive
    settled = steady_since(time, force, noise, record.half_period)
    if settled is not None and drive.constant and found.stick_slope is not None:
        # A slip near the end of a slow log leaves a stick too short to be seen to rise.
        late = np.isfinite(force) & (time >= settled)
        rises = line_slope(time[late], force[late], noise)
        if rises >= found.stick_slope[0] - STUCK * slope_error(time[late], noise):
            settled = None
    begins = bool(found.phase.size and found.phase[0] == SLIDING) and _starts_loaded(time, force, noise, drive)
    fit_mode = FitMode("continuous", settled, begins)
    if drive.constant and not found.slides_on(falls.size):
        return FitMode("cycles", None, False, found.low_snr and falls.size > 0)
    if drive.constant and falls.size == 0:
        rise = int(np.argmax(found.phase != STICK)) if found.phase.size and found.phase[0] == STICK else 0
        fit_mode = FitMode("sliding", settled, begins) if begins or rise < SEEN_RISE else fit_mode
    if settled is None:
        return fit_mode
    late = time >= settled
    rhythm = hidden_rhythm(
        time[late],
        force[late],
        record.load[late],
        stiffness=stiffness,
        drive_speed=drive.at(float(time[-1])),
        half_period=record.half_period,
    )
    return fit_mode if rhythm is None else replace(fit_mode, steady_since=None, rhythm=rhythm)


def hidden_rhythm(
    time: Array,
    force: Array,
    load: Array | None,
    *,
    stiffness: float,
    drive_speed: float,
    half_period: float,
    least: float = 0.4,
) -> Swing | None:
    """The swing of what looks like steady sliding, where it is that of stick-slip; None where there is none.

    The mean force of stick-slip is not that of steady sliding. While the mass slides the spring loads more slowly than
    in a stick, dF/dt < k v_0; a swing that reaches that rate comes to rest, however few samples see each cycle.

    Args:
        time, force, load: (n,) [s], [N], [N]; NaN where nothing counts. load: None where the force is without what the
            load does to it.
        stiffness [N/m], drive_speed [m/s], half_period [s] of the rig; 0 where it is not known.
        least: share of the power that the swing holds.
    """
    if not (stiffness > 0.0 and drive_speed > 0.0 and half_period > 0.0):
        return None
    swing = Spectrum.of(time, force)
    if swing is None or not swing.stands_out(least):
        return None
    seen, rate, height = swing.peak, 1.0 / swing.interval, swing.amplitude(swing.peak)
    if load is not None:
        pressed = Spectrum.of(time, load)
        coefficient = abs(float(np.nanmean(force) / np.nanmean(load)))
        if pressed is None or coefficient * pressed.amplitude(seen) > FROM_LOAD * height:
            return None
    candidates = np.array([seen, *(n * rate + sign * seen for n in range(1, ALIASES + 1) for sign in (-1.0, 1.0))])
    candidates = candidates[candidates <= FASTER * 0.5 / half_period]
    loads = 2.0 * np.pi * candidates * height / (stiffness * drive_speed)
    if not np.any((loads >= LOADS[0]) & (loads <= LOADS[1])):
        return None
    return Swing(swing.samples, seen, 2.0 * height)


def steady_since(time: Array, force: Array, noise: float, half_period: float) -> float | None:
    """Since when a force is level within its noise up to the end [s]; None where it is not for long enough."""
    good = np.isfinite(force)
    if np.count_nonzero(good) < LEAST_SETTLED:
        return None
    t, f = kept(time, good), kept(force, good)
    width = max(round(2.0 * half_period / float(np.median(thinned_steps(t)))), BIN)
    count = t.size // width
    if count < 2 or not _level(f[t.size - width :][None], noise)[0]:  # most logs end in a stick or a slip
        return None
    # Bins are counted from the end, so that the last one is whole.
    restless = np.flatnonzero(~_level(f[t.size - count * width :].reshape(count, width), noise))
    first = int(restless[-1]) + 1 if restless.size else 0
    start = t.size - (count - first) * width
    return float(t[start]) if t.size - start >= LEAST_SETTLED else None


def _level(rows: Array, noise: float) -> NDArray[np.bool_]:
    """Which stretches (b, width) of a force stay level within its noise, shape (b,)."""
    width = rows.shape[1]
    local = np.linspace(-1.0, 1.0, width)
    mean, slope = rows.mean(axis=1), rows @ local / float(local @ local)
    left = rows - mean[:, None] - slope[:, None] * local
    allowed = noise**2 * (1.0 + LOOSE * np.sqrt(2.0 / width))
    # A swing that fades hides in a bin of one period as little as a slope does.
    tilted = np.abs(slope) > LOOSE * noise / np.sqrt(float(local @ local)) + 0.02 * np.abs(mean)
    return np.asarray((np.sum(left**2, axis=1) / (width - 2) <= allowed) & ~tilted)


def moving_pieces(drive: Drive, begin: float, end: float) -> list[tuple[float, float, float]]:
    """(start [s], stop [s], speed [m/s]) of the stretches of a window in which the drive moves."""
    edges = pairwise([begin, *drive.changes(begin, end), end])
    return [(a, b, drive.at(0.5 * (a + b))) for a, b in edges if drive.at(0.5 * (a + b)) > 0.0]


def _starts_loaded(time: Array, force: Array, noise: float, drive: Drive) -> bool:
    """Whether a force begins near the level that it has while the drive moves; through a first rise and the swing after
    it a fast drive is in a few samples, which lie below that."""
    good = np.isfinite(force)
    if not np.any(good):
        return False
    t, f = kept(time, good), kept(force, good)
    moves = np.zeros(t.size, bool)
    for begin, end, _ in moving_pieces(drive, float(t[0]), float(t[-1])):
        moves |= (t >= begin) & (t <= end)
    loaded = LEVEL * float(np.median(thinned(f[moves] if np.any(moves) else f)))
    return bool(np.median(f[: max(f.size // 100, 3)]) > loaded and np.min(f[:SEEN_RISE]) > loaded - STUCK * noise)


# The part of a record that the fit takes: from where its first loading is a straight line on.


def cycles_window(record: ForceRecord, found: Segmentation, skip: int = 0) -> tuple[float, float]:
    """The part of a record of cycles: from the first stick that is a straight line on.

    A record may start before the drive does, or in the middle of a slip; both are cut off. After `skip`
    cycles (running-in) it starts in the stick that follows them.

    Returns:
        begin and end [s].
    """
    time, force, cycles = record.time, record.force, found.cycles
    begin, end = float(time[0]), float(time[-1])
    if cycles.count == 0:
        return begin, end
    if skip and skip < cycles.count:
        return float(cycles.arrest[skip - 1] + 0.3 * (cycles.onset[skip] - cycles.arrest[skip - 1])), end
    onset = float(cycles.onset[0])
    if found.begins_in_slip:
        resting = np.flatnonzero((found.phase == STICK) & (time < onset))
        begin = float(time[resting[0]]) if resting.size else begin
        begin += 0.3 * (onset - begin)
    straight = _line_start(time, force, begin, onset, record.noise)
    if straight > begin and onset - begin < SHORT_LOADING * record.half_period:
        # The mass slips long before so quick a rise ends: its upper part is none of the stick.
        rising = np.flatnonzero((time >= begin) & (time <= onset) & np.isfinite(force))
        straight = min(straight, _low(time, force, rising))
    return max(begin, straight), end


def continuous_window(record: ForceRecord, found: Segmentation, fit_mode: FitMode) -> tuple[float, float]:
    """The part of a record without a train of cycles: begin and end [s]."""
    time, force = record.time, record.force
    begin, end = float(time[0]), float(time[-1])
    if fit_mode.name == "sliding":
        return (begin if fit_mode.steady_since is None else fit_mode.steady_since), end
    if fit_mode.begins_sliding:
        return begin, end
    resting = found.phase == STICK
    first = float(time[int(np.argmin(resting))]) if not np.all(resting) else end
    first = min([first, *found.cycles.onset[:1].tolist()])
    rising = np.flatnonzero((time <= first) & np.isfinite(force))
    rising = rising[: int(np.argmax(force[rising])) + 1] if rising.size else rising
    brief = rising.size and time[rising[-1]] - time[rising[0]] < SHORT_LOADING * record.half_period
    if 0 < rising.size < SHORT_RISE or brief:
        return _low(time, force, rising), end
    # While the drive stands, or starts anew, a force that only rises is no straight line.
    moving = max((a for a, _, _ in moving_pieces(record.drive, begin, end) if a < first), default=begin)
    return (_line_start(time, force, begin, first, record.noise) if moving == begin else begin), end


def _low(time: Array, force: Array, rising: NDArray[np.int64]) -> float:
    """The time of the last sample in the lower part of a rise, given by its samples."""
    low, high = float(np.min(force[rising])), float(force[rising[-1]])
    return float(time[rising[np.flatnonzero(force[rising] <= low + LOW * (high - low))[-1]]])


def _line_start(time: Array, force: Array, begin: float, onset: float, noise: float) -> float:
    """Where the straight loading line of the first stick begins: earlier samples do not lie on it."""
    first, last = np.searchsorted(time, [begin, onset])
    good = np.isfinite(force[first:last])
    t, f = kept(time[first:last], good), kept(force[first:last], good)
    if t.size < 12:
        return begin
    # The upper part of the rise, by force and not by time: however long the machine waited before it.
    width = max(min(t.size // 10, 25), 1)
    flat = running_means(f, width)
    low, high = float(np.min(flat)), float(np.max(flat))
    lower, upper = (int(np.flatnonzero(flat <= low + share * (high - low))[-1]) + width // 2 for share in RISE)
    late = slice(lower, max(upper, lower + 3))
    middle, height = float(np.mean(t[late])), float(np.mean(f[late]))
    slope = float((t[late] - middle) @ (f[late] - height)) / max(float(np.sum((t[late] - middle) ** 2)), 1e-300)
    centre = t[width // 2 : lower]  # of the windows before the late stretch
    if centre.size == 0:
        return begin
    early = slice(0, centre.size + width - 1)
    off = running_means(f[early] - height - slope * (t[early] - middle), width)
    # The line itself is uncertain where it is extrapolated: twice the late stretch away, about three times as much.
    reach = (middle - centre) / max(float(np.std(t[late])), 1e-300)
    sd = noise * np.sqrt(1.0 / width + (1.0 + reach**2) / max(late.stop - late.start, 3))
    wrong = np.flatnonzero(np.abs(off) > ONSET_MARGIN * sd)
    if wrong.size == 0:
        return begin
    # Where the difference was last seen it had become small, not nought: a little of the line is left out as well.
    bend = float(centre[wrong[-1]] + width * np.median(thinned_steps(t)))
    return bend + CLEAR * max(float(t[late][0]) - bend, 0.0)
