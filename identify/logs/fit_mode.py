"""How a log moves (in cycles, steadily, in a course of its own), and the part of it that the estimator takes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from data_io.arrays import kept, thinned, thinned_steps
from identify.logs.segment import SLIDING, STICK, Segmentation
from identify.logs.slips import line_slope, slope_error
from identify.logs.spectrum import Swing, hidden_rhythm
from identify.logs.zigzag import running_means
from identify.simulation.drive import Drive

Array = NDArray[np.float64]
Name = Literal["cycles", "continuous", "sliding"]

SEEN_RISE = 5  # samples of a first rise from which on it is one
LOOSE = 5.0  # standard deviations of the scatter within a bin beyond which a force is not level
BIN = 8  # samples at least
LEAST_SETTLED = 20  # samples of steady sliding
STUCK = 3.0  # standard errors by which a level force must rise more slowly than a stick to count as sliding
LEVEL = 0.5  # of the middle force: a record that starts above slides from its start


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
    """Tell how a log moves.

    Args:
        found: its phases; falls: of its cycles [s]; stiffness: of the rig [N/m]; 0, as the half period of the record,
            where it is not known, or something else makes the mass swing.
    """
    fit_mode = _as_it_looks(record, found, falls)
    if fit_mode.steady_since is None:
        return fit_mode
    late = record.time >= fit_mode.steady_since
    rhythm = hidden_rhythm(
        record.time[late],
        record.force[late],
        record.load[late],
        stiffness=stiffness,
        drive_speed=record.drive.at(float(record.time[-1])),
        half_period=record.half_period,
    )
    return fit_mode if rhythm is None else replace(fit_mode, steady_since=None, rhythm=rhythm)


def _as_it_looks(record: ForceRecord, found: Segmentation, falls: Array) -> FitMode:
    time, force, noise, drive = record.time, record.force, record.noise, record.drive
    settled = steady_since(time, force, noise, record.half_period)
    if settled is not None and drive.constant and found.stick_slope is not None:
        # A slip near the end of a slow log leaves a stick too short to be seen to rise.
        settled = settled if _slides(time, force, settled, noise, found.stick_slope[0]) else None
    begins = bool(found.phase.size and found.phase[0] == SLIDING) and _starts_loaded(time, force, noise, drive)
    if not drive.constant:
        return FitMode("continuous", settled, begins)
    slides = found.slides_on(falls.size)
    if falls.size and not slides:
        return FitMode("cycles", None, False, found.low_snr)
    if falls.size == 0 and not slides:
        return FitMode("cycles", None, False)
    rise = int(np.argmax(found.phase != STICK)) if found.phase.size and found.phase[0] == STICK else 0
    if falls.size == 0 and (begins or rise < SEEN_RISE):
        return FitMode("sliding", settled, begins)
    return FitMode("continuous", settled, begins)


def steady_since(time: Array, force: Array, noise: float, half_period: float) -> float | None:
    """Since when a force is level within its noise up to the end [s]; None where it is not for long enough."""
    good = np.isfinite(force)
    if np.count_nonzero(good) < LEAST_SETTLED:
        return None
    t, f = kept(time, good), kept(force, good)
    interval = float(np.median(thinned_steps(t)))
    width = max(round(2.0 * half_period / interval), BIN) if half_period else BIN
    count = t.size // width
    if count < 2:
        return None
    if not _level(f[t.size - width :][None], noise)[0]:  # most logs end in a stick or a slip
        return None
    # Bins are counted from the end, so that the last one is whole.
    restless = np.flatnonzero(~_level(f[t.size - count * width :].reshape(count, width), noise))
    first = int(restless[-1]) + 1 if restless.size else 0
    start = t.size - (count - first) * width
    return float(t[start]) if count > first and t.size - start >= LEAST_SETTLED else None


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


def _slides(time: Array, force: Array, since: float, noise: float, stick_slope: float) -> bool:
    """Whether a level force rises so much more slowly than a stick [N/s] that it cannot be one."""
    good = np.isfinite(force) & (time >= since)
    t = time[good]
    return line_slope(t, force[good], noise) < stick_slope - STUCK * slope_error(t, noise)


def moving_pieces(drive: Drive, begin: float, end: float) -> list[tuple[float, float, float]]:
    """(start [s], stop [s], speed [m/s]) of the stretches of a window in which the drive moves."""
    edges = [begin, *drive.changes(begin, end), end]
    return [(a, b, drive.at(0.5 * (a + b))) for a, b in pairwise(edges) if drive.at(0.5 * (a + b)) > 0.0]


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


# The part of a record that the estimator takes: from where its first loading is a straight line on.

Indices = NDArray[np.int64]

RISE = (0.4, 0.9)  # of the first rise: the stretch its straight line is taken from
SHORT_RISE = 40  # samples: of a shorter first rise no line is drawn,
SHORT_LOADING = 2.0  # half periods: nor of one that may end in a swing
LOW = 0.15  # of such a rise: the fit begins at the last sample below
CLEAR = 0.1  # of the loading line after the bend that is left out
ONSET_MARGIN = 6.0  # standard deviations by which a record must leave its first loading line


def cycles_window(record: ForceRecord, found: Segmentation, skip: int = 0) -> tuple[float, float]:
    """The part of a record of cycles: from the first stick that is a straight line on.

    A record may start before the drive does, or in the middle of a slip; both are cut off. After `skip`
    cycles (running-in) it starts in the stick that follows them.

    Returns:
        begin and end [s].
    """
    time, force = record.time, record.force
    cycles = found.cycles
    begin, end = float(time[0]), float(time[-1])
    if cycles.count == 0:
        return begin, end
    if skip and skip < cycles.count:
        begin = float(cycles.arrest[skip - 1] + 0.3 * (cycles.onset[skip] - cycles.arrest[skip - 1]))
        return begin, end
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


def _low(time: Array, force: Array, rising: Indices) -> float:
    """The time of the last sample in the lower part of a rise, given by its samples."""
    low, high = float(np.min(force[rising])), float(force[rising[-1]])
    return float(time[rising[np.flatnonzero(force[rising] <= low + LOW * (high - low))[-1]]])


def _line_start(time: Array, force: Array, begin: float, onset: float, noise: float) -> float:
    """Where the straight loading line of the first stick begins: earlier samples do not lie on it."""
    first, last = np.searchsorted(time, [begin, onset])
    t, f = time[first:last], force[first:last]
    good = np.isfinite(f)
    t, f = kept(t, good), kept(f, good)
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
    n = max(late.stop - late.start, 3)
    reach = (middle - centre) / max(float(np.std(t[late])), 1e-300)
    sd = noise * np.sqrt(1.0 / width + (1.0 + reach**2) / n)
    wrong = np.flatnonzero(np.abs(off) > ONSET_MARGIN * sd)
    if wrong.size == 0:
        return begin
    # Where the difference was last seen it had become small, not nought: a little of the line is left out as well.
    bend = float(centre[wrong[-1]] + width * np.median(thinned_steps(t)))
    return bend + CLEAR * max(float(t[late][0]) - bend, 0.0)


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
