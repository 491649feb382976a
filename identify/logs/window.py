"""The part of a record that the estimator takes: from where its first loading is a straight line on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_io.arrays import kept, thinned_steps
from identify.logs.manner import Manner, moving_pieces
from identify.logs.segment import STICK, Segmentation
from identify.logs.zigzag import running_means
from identify.simulation.drive import Drive

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

RISE = (0.4, 0.9)  # of the first rise: the stretch its straight line is taken from
SHORT_RISE = 40  # samples: of a shorter first rise no line is drawn,
SHORT_LOADING = 2.0  # half periods: nor of one that may end in a swing
LOW = 0.15  # of such a rise: the fit begins at the last sample below
CLEAR = 0.1  # of the loading line after the bend that is left out
ONSET_MARGIN = 6.0  # standard deviations by which a record must leave its first loading line


def of_cycles(
    time: Array, force: Array, found: Segmentation, noise: float, skip: int, half_period: float
) -> tuple[float, float]:
    """The part of a record of cycles: from the first stick that is a straight line on.

    A record may start before the drive does, or in the middle of a slip; both are cut off. After `skip`
    cycles (running-in) it starts in the stick that follows them.

    Args:
        time, force: (n,) [s], [N]; NaN where a sample does not count. noise: its standard deviation [N];
        half_period: half the natural period [s], 0 where it is not known.

    Returns:
        begin and end [s].
    """
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
    straight = _line_start(time, force, begin, onset, noise)
    if straight > begin and onset - begin < SHORT_LOADING * half_period:
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


def of_a_course(
    time: Array, force: Array, found: Segmentation, noise: float, manner: Manner, drive: Drive, half_period: float
) -> tuple[float, float]:
    """The part of a record without a train of cycles.

    Args:
        time, force: (n,) [s], [N]; NaN where a sample does not count. noise: its standard deviation [N];
        half_period: half the natural period [s].

    Returns:
        begin and end [s].
    """
    begin, end = float(time[0]), float(time[-1])
    if manner.name == "sliding":
        return (begin if manner.settled is None else manner.settled), end
    if manner.begins_sliding:
        return begin, end
    resting = found.phase == STICK
    first = float(time[int(np.argmin(resting))]) if not np.all(resting) else end
    first = min([first, *found.cycles.onset[:1].tolist()])
    rising = np.flatnonzero((time <= first) & np.isfinite(force))
    rising = rising[: int(np.argmax(force[rising])) + 1] if rising.size else rising
    brief = rising.size and time[rising[-1]] - time[rising[0]] < SHORT_LOADING * half_period
    if 0 < rising.size < SHORT_RISE or brief:
        return _low(time, force, rising), end
    # While the drive stands, or starts anew, a force that only rises is no straight line.
    moving = max((a for a, _, _ in moving_pieces(drive, begin, end) if a < first), default=begin)
    return (_line_start(time, force, begin, first, noise) if moving == begin else begin), end
