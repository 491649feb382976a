"""Sticks and slips of a record one by one: stick lines, first and last sample of every slip, in units of the load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.logs.prepare import Prepared
from identify.logs.segment import DetectedCycles

Array = NDArray[np.float64]

CLEAR = 4.0  # deviations of the smoothed noise by which a sample is clearly off a line
LEAST = 0.03  # of the drop: nearer to a line than that is no slip, whatever the noise
NEAR = 3.0  # lengths of the slip: so far before an onset, or after an arrest, goes the line of a stick
LINE = 0.6  # of a stick: no further than that
BENT = 2.0  # of the rate of all sticks: by how much a stick's end differs from it, as it creeps
ENOUGH = 25  # samples for the level of a line
SMOOTHED = 3  # samples about an end of a slip whose mean is compared with a line
NOISE = 1.15  # of the sticks' noise: that of a slip, whose samples are also jittered in time
FINEST = 0.2  # of the slips' pace between two samples: denser ones are averaged, so that a slip costs the same
LEAST_SAMPLES = 6  # of a slip that is followed sample by sample
UNSEEN = 1e-5  # of a slip that is not followed: fallen at its onset
QUARTERS = 3.0 / np.pi  # of the time from a quarter to three quarters of a drop: sqrt(m/k), on half a cosine
SURE_OF_SPRING = 0.02  # of a stiffness, beside what its sticks scatter and how far they are from the stated one
LOST = 3.0  # times the typical stick: a longer one hides a cycle that was not seen


@dataclass(frozen=True)
class RigConstants:
    """What a record itself shows of its rig, over the load.

    Attributes:
        stiffness: rate of the sticks over the drive speed [1/m]; rate: of the sticks [1/s]; load [N].
        stated: the stiffness of the scene [1/m], or that of the sticks where something soft is in series with it.
        error: relative standard error of the stiffness: how sticks scatter, and how far they are from what is stated.
        pace: sqrt(m/k) as the course of the falls has it [s].
    """

    stiffness: float
    rate: float
    load: float = 1.0
    stated: float = 0.0
    error: float = SURE_OF_SPRING
    pace: float = 0.0

    @property
    def drive_speed(self) -> float:
        """Speed at which the spring is loaded [m/s]."""
        return self.rate / self.stiffness

    def over_load(self, noise: float) -> tuple[float, ...]:
        """As functions of a slip take it, as `slip_functions.RIG` has it; noise: sd of a sample [1]."""
        return self.stiffness, self.rate, noise, self.load


@dataclass(frozen=True)
class Sticks:
    """What is seen of every cycle (c,), forces over the load [1].

    number: of the cycle in the record, from 1; follows: the cycle before is the one in the row before; anchor: time
    of the first sample off the stick line [s]; line: the stick line there; fallen: below it; rest: time from the arrest
    before to the anchor [s], NaN where that arrest was not seen; last: time of the last sample above the line of the
    next stick [s]; above: by how much; arrest: the next line at the arrest; end: fallen below the stick line there;
    time, force, counts (c, n): the samples of a slip from the anchor to the last one, padded at the end, from the
    anchor [s]; samples (c,): how many; noise: sd of a sample [1]; usual_rest: the rest after which the strength is told
    [s], the same for all records of a fit.
    """

    number: NDArray[np.int64]
    follows: NDArray[np.bool_]
    anchor: Array
    line: Array
    fallen: Array
    rest: Array
    last: Array
    above: Array
    arrest: Array
    end: Array
    time: Array
    force: Array
    counts: NDArray[np.bool_]
    samples: NDArray[np.int64]
    noise: float
    rig: RigConstants
    usual_rest: float

    @property
    def count(self) -> int:
        """Number of cycles."""
        return int(self.number.size)

    @property
    def resolved(self) -> bool:
        """Whether slips were followed; where they were not, only onset and arrest of each are seen."""
        return bool(np.any(self.samples > 1))

    @property
    def drop(self) -> Array:
        """From the stick line at the onset to that of the next stick at the arrest (c,)."""
        return self.line - self.arrest

    def part(self, rows: NDArray[np.int64]) -> Sticks:
        """Some of the cycles, in the order given; a cycle whose predecessor is left out starts anew."""
        kept = {name: getattr(self, name)[rows] for name in _PER_CYCLE}
        kept["follows"] = kept["follows"] & np.append(False, np.diff(rows) == 1)
        return replace(self, **kept)


_PER_CYCLE = tuple(name for name in Sticks.__annotations__ if name not in ("noise", "rig", "usual_rest"))


def sticks_of(log: Prepared, in_series: bool = False) -> Sticks:
    """The cycles of a prepared log, as the estimator of uneven records takes them. Cycles of which stick lines or the
    slip cannot be made out are left out: `follows` says where the chain is broken. in_series: something soft is in
    series with the rig, so that its stiffness is that which the sticks show at the drive speed, not the one stated."""
    data, cycles = log.data, log.segmentation.cycles
    mean = data.mean_normal_force
    load = data.normal_force.at(data.time)
    slope = log.segmentation.stick_slope
    speed, scatter = data.drive_speed, slope[1] / np.sqrt(max(cycles.count, 1)) if slope is not None else 0.0
    rate = (slope[0] if slope is not None else log.rig.stiffness * speed) / mean
    stated = rate / speed if in_series else log.rig.stiffness / mean
    force, used = data.force / load, data.weight > 0.0
    pace = _pace(data.time[used], force[used], cycles)
    error = float(np.linalg.norm([SURE_OF_SPRING, scatter, np.log(rate / speed / stated)]))
    rig = RigConstants(rate / speed, rate, mean, stated, error, pace)
    resolved = log.segmentation.samples_per_slip >= LEAST_SAMPLES
    trace = _Trace(data.time, force, used, data.noise / mean, rig, resolved)
    first = log.entry.skip_cycles
    rows: list[_Row] = []
    for j in range(first, cycles.count):
        before = cycles.arrest[j - 1] if j else None
        after = cycles.onset[j + 1] if j + 1 < cycles.count else data.time[-1]
        row = trace.row(j + 1, before, (cycles.onset[j], cycles.fall[j], cycles.arrest[j]), after)
        if row is not None:
            rows.append(row)
    return _assembled(rows, trace.noise, rig)


def of_one_body(records: Sequence[Sticks], tolerance: float | None = None) -> list[Sticks]:
    """Records of one pair and slider: with the strength told after the same rest, the median of all (faster records
    rest for shorter, and are weaker for that), and with one stiffness where one is stated: the mean of what their
    sticks show, and where the scene states a tolerance (relative) of its own one, of both by their errors."""
    rests = np.concatenate([sticks.rest[np.isfinite(sticks.rest)] for sticks in records])
    usual = float(np.median(rests)) if rests.size else records[0].usual_rest
    ratios = np.log([sticks.rig.stiffness / sticks.rig.stated for sticks in records])
    error = float(np.sqrt(np.mean([sticks.rig.error**2 for sticks in records]) + np.var(ratios)))
    shown = np.mean(ratios)
    if tolerance:
        weight = error**-2 / (error**-2 + tolerance**-2)
        shown, error = weight * shown, weight**0.5 * error
    rigs = [replace(sticks.rig, stiffness=float(np.exp(shown)) * sticks.rig.stated, error=error) for sticks in records]
    return [replace(sticks, usual_rest=usual, rig=rig) for sticks, rig in zip(records, rigs, strict=True)]


def _pace(time: Array, force: Array, cycles: DetectedCycles) -> float:
    """Median of sqrt(m/k) over the cycles, by the time in which the force falls from a quarter to three quarters."""
    paces = []
    for start, stop in zip(cycles.onset, cycles.arrest, strict=True):
        low, high = np.searchsorted(time, [start, stop])
        if high - low < 2:
            continue
        t, fall = time[low : high + 1], np.maximum.accumulate(-force[low : high + 1])
        quarters = fall[0] + (fall[-1] - fall[0]) * np.array([0.25, 0.75])
        first, last = np.interp(quarters, fall, t)
        paces.append(QUARTERS * (last - first))
    rough = float(np.median(cycles.arrest - cycles.onset)) / np.pi if cycles.count else 1.0
    return float(np.median(paces)) if paces and np.median(paces) > 0.0 else rough


@dataclass(frozen=True)
class _Row:
    """One cycle as `Sticks` holds them."""

    number: int
    anchor: float
    line: float
    fallen: float
    last: float
    above: float
    arrest: float
    stopped: float
    end: float
    time: Array
    force: Array


@dataclass(frozen=True)
class _Trace:
    """Force over load of a record, which of its samples count, and their noise."""

    time: Array
    force: Array
    counts: NDArray[np.bool_]
    noise: float
    rig: RigConstants
    resolved: bool

    def row(self, number: int, before: float | None, slip: tuple[float, float, float], after: float) -> _Row | None:
        """Lines and ends of one cycle; before, slip, after: arrest before it, its onset, fall and arrest, and the
        onset after it, as segmented [s]. None where a line or the slip is not seen."""
        onset, fall, arrest = slip
        lasting = arrest - onset
        start = before if before is not None else max(onset - 4.0 * lasting, float(self.time[0]))
        # Near the ends of the slip only: sticks bend as they creep, and a line through all of one misses its end.
        near, stick, rest = max(NEAR * lasting, self._enough()), onset - start, after - arrest
        clear_of_it = min(0.25 * lasting, 0.2 * stick)
        rising = self._line(onset - clear_of_it - min(near, LINE * stick), onset - clear_of_it)
        clear_of_it = min(0.25 * lasting, 0.2 * rest)
        settled = self._line(arrest + clear_of_it, arrest + clear_of_it + min(near, LINE * rest))
        if rising is None or settled is None:
            return None
        if not self.resolved:
            return self._ends(number, fall, rising, settled)
        low, high = np.searchsorted(self.time, [max(start, onset - 2.0 * lasting), min(arrest + lasting, after)])
        rows = np.flatnonzero(self.counts[low:high]) + low
        middle = int(np.searchsorted(self.time[rows], fall))
        if middle < SMOOTHED or rows.size - middle < SMOOTHED:
            return None
        time, force = self.time[rows], self.force[rows]
        smooth = np.convolve(np.pad(force, SMOOTHED // 2, mode="edge"), np.full(SMOOTHED, 1.0 / SMOOTHED), "valid")
        drop = rising(fall) - settled(fall)
        clear = max(CLEAR * self.noise / np.sqrt(SMOOTHED), LEAST * drop)
        off = rising(time) - smooth
        on_line = np.flatnonzero(off[:middle] < clear)
        down = np.flatnonzero(smooth[middle:] - settled(time[middle:]) < clear)
        if drop <= 2.0 * clear or on_line.size == 0 or down.size == 0:
            return None
        first, last = int(on_line[-1]) + 1, middle + int(down[0]) - 1
        if last - first < 1:
            return None
        above = float(smooth[last] - settled(time[last]))
        if above <= 0.0:
            return None
        # The rest of the way to the arrest, decelerated as an undamped slip of that drop is.
        left = self.rig.pace * float(np.sqrt(4.0 * above / drop))
        stopped = min(float(time[last]) + left, arrest + lasting)
        onset, stopped_at = float(rising(time[first])), float(settled(stopped))
        end = onset + self.rig.rate * (stopped - float(time[first])) - stopped_at
        if not end > off[first] > 0.0 or onset <= stopped_at:
            return None
        return _Row(
            number,
            float(time[first]),
            onset,
            float(off[first]),
            float(time[last]),
            above,
            stopped_at,
            stopped,
            end,
            time[first : last + 1] - time[first],
            force[first : last + 1],
        )

    def _ends(self, number: int, fall: float, rising: StickLine, settled: StickLine) -> _Row | None:
        """A cycle of which only the ends of the slip are seen, half a half period before and after its middle."""
        half = 0.5 * np.pi * self.rig.pace
        begin, stop = fall - half, fall + half
        onset, arrest = float(rising(begin)), float(settled(stop))
        end = onset + self.rig.rate * (stop - begin) - arrest
        if onset - arrest < CLEAR * self.noise:
            return None
        seen = np.array([0.0]), np.array([onset])
        return _Row(number, begin, onset, UNSEEN * end, begin, 0.0, arrest, stop, end, *seen)

    def _line(self, start: float, stop: float) -> StickLine | None:
        """A line through the samples from start to stop that spikes do not draw away; its slope near the rate of all
        sticks."""
        low, high = np.searchsorted(self.time, [start, stop])
        rows = np.flatnonzero(self.counts[low:high]) + low
        if rows.size < 2:
            return None
        at, force = 0.5 * (start + stop), self.force[rows]
        time = self.time[rows] - at
        noise, slope = max(self.noise, 1e-12), self.rig.rate
        level = float(np.median(force - slope * time))
        firm = (noise / (BENT * self.rig.rate)) ** 2
        for _ in range(4):
            weight = 1.0 / np.maximum(np.abs(force - level - slope * time) / (2.0 * noise), 1.0)
            centre, middle = np.average(time, weights=weight), np.average(force, weights=weight)
            moved = time - centre
            slope = float(weight @ (moved * (force - middle)) + firm * self.rig.rate) / float(weight @ moved**2 + firm)
            level = float(middle - slope * centre)
        return StickLine(at, level, slope)

    def _enough(self) -> float:
        """Time that enough samples take [s]."""
        return ENOUGH * float(self.time[-1] - self.time[0]) / max(self.time.size - 1, 1)


@dataclass(frozen=True)
class StickLine:
    """The straight line of a stick near a slip: its level at a time [s], and slope."""

    at: float
    level: float
    slope: float

    def __call__(self, time: Array | float) -> Array:
        """Force over the load at times [s]."""
        return np.asarray(self.level + self.slope * (np.asarray(time) - self.at))


def _assembled(rows: list[_Row], noise: float, rig: RigConstants) -> Sticks:
    """Rows side by side; samples much denser than the motion are averaged."""
    thin = [_averaged(row.time, row.force, FINEST * rig.pace) for row in rows]
    longest = max((time.size for time, _, _ in thin), default=0)
    time, force = np.zeros((len(rows), longest)), np.zeros((len(rows), longest))
    counts = np.zeros((len(rows), longest), bool)
    for j, (t, f, _) in enumerate(thin):
        time[j, : t.size], force[j, : t.size], counts[j, : t.size] = t, f, True
        time[j, t.size :] = t[-1]
    number = np.array([row.number for row in rows], dtype=np.int64)
    follows = np.append(False, np.diff(number) == 1)[: number.size]
    rest = np.full(number.size, np.nan)
    for j in np.flatnonzero(follows).tolist():
        rest[j] = rows[j].anchor - rows[j - 1].stopped
    typical = float(np.nanmedian(rest)) if np.isfinite(rest).any() else np.nan
    lost = rest > LOST * typical
    rest[lost | (rest <= 0.0)], follows = np.nan, follows & ~lost & ~(rest <= 0.0)
    averaged = float(np.median([many for _, _, many in thin])) if thin else 1.0
    column = {name: np.array([getattr(row, name) for row in rows]) for name in _COLUMNS}
    return Sticks(
        number=number,
        follows=follows,
        rest=rest,
        time=time,
        force=force,
        counts=counts,
        samples=np.array([t.size for t, _, _ in thin], dtype=np.int64),
        noise=NOISE * noise / np.sqrt(averaged),
        rig=rig,
        usual_rest=float(np.nanmedian(rest)) if np.isfinite(rest).any() else 1.0,
        **column,
    )


_COLUMNS = ("anchor", "line", "fallen", "last", "above", "arrest", "end")


def _averaged(time: Array, force: Array, step: float) -> tuple[Array, Array, float]:
    """Means of so many samples that these lie a step apart, but the first and the last sample by themselves; and how
    many a mean is of."""
    interval = float(np.median(np.diff(time))) if time.size > 1 else step
    many = max(1, int(step / interval))
    inner = (time.size - 2) // many
    if many == 1 or inner < LEAST_SAMPLES:
        return time, force, 1.0
    until = 1 + inner * many
    middle = [values[1:until].reshape(inner, many).mean(axis=1) for values in (time, force)]
    return (
        np.append(np.append(time[0], middle[0]), time[-1]),
        np.append(np.append(force[0], middle[1]), force[-1]),
        many,
    )
