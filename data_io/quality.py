"""The quality gate: what a record's clock and force channels look like, in numbers and in sentences.

Knows sampling and sensors only; whether a slip holds enough samples is for those who know slips.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from data_io.arrays import grid_step, kept, longest_run, shown, thinned, thinned_steps, true_runs
from data_io.columns import COEFFICIENTS, parse_name
from data_io.record import Record
from data_io.thresholds import DEFAULTS, Thresholds, percent
from data_io.values import LONGEST_GAP, Finding, FloatArray

Rows = npt.NDArray[np.bool_]

# The friction signal itself: dead, clipped, coarse, repeated.

_CLIPPED_RUN: Final = 10  # rows in a row at the very same extreme value before a sensor is at its end
_CLIPPED_EXCESS: Final = 5.0  # times that its end is shown more often than the values before it
_HELD_EVENLY: Final = 0.9  # share of values held as long as the usual one, by a logger ahead of its sensor
_BIG_STEP: Final = 3.0
"""Steps of the quantisation by which a repeated signal moves on; a coarse one moves by one or two."""


@dataclass(frozen=True)
class Signal:
    """clipped: rows at an end of the sensor. resolution [N]: step of the grid on which the values lie, 0 where they
    show none. repeated: share of the rows that repeat the row before."""

    clipped: int
    resolution: float
    repeated: float


def _look_at_friction(record: Record, used: Rows, limits: Thresholds) -> tuple[Signal, list[Finding]]:
    """Measure the friction force of the rows that count, used (n,)."""
    friction = kept(record.friction_force, used)
    span = float(np.ptp(friction))
    if span == 0:
        text = f"the friction force is exactly {friction[0]:g} N in every row; a living signal was expected; check it"
        return Signal(0, 0.0, 0.0), [Finding("friction_constant", "reject", text)]
    clipped, notes = _clipping("friction force", friction, limits)
    resolution = grid_step(friction)
    notes += limits.finding(
        "friction_coarse", "quantisation", resolution / span,
        f"the friction force comes in steps of {resolution:.3g} N, coarse against its range of {span:.3g} N; use a "
        "smaller measuring range of the sensor, or export more digits",
    )  # fmt: skip
    repeated, evenly = _repeated(record, used, resolution)
    cause = (
        "they are held for equally many rows each: the logger ran faster than the sensor; log at the sensor's own rate"
        if evenly
        else "they stand still now and then, for unlike times: a display that was read too slowly, or a link that was "
        "lost for a while; check how the values come to the logger, and leave such stretches out"
    )
    text = f"{100 * repeated:.0f} % of the rows repeat the measured values of the row before; {cause}"
    notes += limits.finding("repeated_rows", "repeated_rows", repeated, text)
    return Signal(clipped, resolution, repeated), notes


def _clipping(name: str, force: FloatArray, limits: Thresholds) -> tuple[int, list[Finding]]:
    """Return how many rows stand at an end of the sensor, in a row and far more often than beside it."""
    notes, total = list[Finding](), 0
    for end, level in (("highest", float(force.max())), ("lowest", float(force.min()))):
        at_end = force == level
        rows = int(np.count_nonzero(at_end))
        if rows < _CLIPPED_RUN or longest_run(at_end) < _CLIPPED_RUN:
            continue
        off = np.abs(force[~at_end] - level)
        near = off[off < 0.1 * np.ptp(force)]
        counts = np.unique(near if np.unique(near).size > 1 else off, return_counts=True)[1]
        if counts.size > 1 and rows > _CLIPPED_EXCESS * float(counts[:5].mean()):
            total += rows
            text = f"the {name} stays at its {end} value {level:.4g} N in {rows} rows: the sensor was at its end; use "
            code = f"{name.split()[0]}_clipped"
            notes += limits.finding(code, "clipped_rows", rows / force.size, f"{text}a larger measuring range")
    return total, notes


def _repeated(record: Record, used: Rows, step: float) -> tuple[float, bool]:
    """Return the share of rows that repeat the row before, not by chance, and whether they do so evenly."""
    pair = used[1:] & used[:-1]
    change = np.abs(np.diff(record.friction_force))
    same = pair & (change == 0.0)
    moved = change[pair & ~same] if same.any() else np.empty(0)
    if moved.size == 0 or float(np.median(moved)) <= _BIG_STEP * step:
        return 0.0, False
    beside = pair & ~same & (change < 1.5 * step)
    if np.ptp(record.normal_force[used]) > 0:
        still = np.diff(record.normal_force) == 0
        same, beside = same & still, beside & still
    held = np.diff(np.flatnonzero(np.concatenate(([True], ~same, [True]))))
    usual = float(np.median(held))
    evenly = usual > 1 and bool(np.mean(np.abs(held - usual) <= 1.0) >= _HELD_EVENLY)
    by_chance = 0.5 * int(np.count_nonzero(beside))
    return max(int(np.count_nonzero(same)) - by_chance, 0.0) / max(int(np.count_nonzero(pair)), 1), evenly


# The normal force: its level, drift and ripple, rows without load, a sensor at its end.

UNLOADED: Final = 0.1
"""Share of the typical load below which a row counts as not loaded."""
_LOADED: Final = 0.3
"""Share of the load above which a row counts as loaded: a load that ripples is loaded in its troughs as well."""


@dataclass(frozen=True)
class Load:
    """level, mean [N]: median and mean of the loaded rows. drift, ripple: change from the first to the last tenth, and
    standard deviation about a straight line, both as share of the level. unloaded: share of the rows."""

    level: float
    mean: float
    drift: float
    ripple: float
    unloaded: float


def _look_at_load(record: Record, used: Rows, limits: Thresholds) -> tuple[Load, list[Finding]]:
    """Measure the normal force of the rows that count."""
    normal = kept(record.normal_force, used)
    level, (mean, drift) = typical_load(normal), mean_and_drift(normal)
    if level <= 0:
        text = "the normal force is zero or pulls; a pressing load was expected; check its column, unit and zero point"
        return Load(level, mean, 0.0, 0.0, 1.0), [Finding("no_load", "reject", text)]
    few = thinned(normal)
    loaded = few > _LOADED * level
    ripple = 0.0
    if np.count_nonzero(loaded) > 2:
        time = thinned(kept(record.time, used))[loaded]
        line = np.polyval(np.polyfit(time - time[0], few[loaded], 1), time - time[0])
        ripple = float(np.std(few[loaded] - line)) / level
    load = Load(level, mean, drift, ripple, np.count_nonzero(normal < UNLOADED * level) / normal.size)
    notes, size = list[Finding](), f"{level:.3g} N"
    if np.ptp(normal) > 0:  # rows without a load lie at the lowest value of a sound sensor
        notes += _clipping("normal force", normal[normal >= UNLOADED * level], limits)[1]
    elif not str(record.metadata.get("normal_force_source", "")).startswith("constant"):
        text = f"the normal force is exactly {level:g} N in every row; it was set, not measured"
        notes.append(Finding("normal_force_not_measured", "info", text))
    notes += limits.finding(
        "unloaded_rows", "unloaded_rows", load.unloaded,
        f"{100 * load.unloaded:.1f} % of the rows press with less than {100 * UNLOADED:.0f} % of the load ({size}); "
        "leave them out with window or choose the loaded step",
    )  # fmt: skip
    notes += limits.finding(
        "load_drift", "load_drift", abs(drift),
        f"the normal force {'rises' if drift > 0 else 'falls'} by {percent(abs(drift), of=size)} from the first to the "
        "last tenth; a fit follows it with the effect varying_normal_force, and else takes the mean",
    )  # fmt: skip
    notes += limits.finding(
        "load_ripple", "load_ripple", ripple,
        f"the normal force ripples by {percent(ripple, of=size)} (standard deviation); check the load control and the "
        "flatness of the track",
    )  # fmt: skip
    return load, notes


def typical_load(normal: FloatArray) -> float:
    """Return the median normal force of the loaded rows [N], 0 where nothing presses; (n,) may hold NaN."""
    # In this order: every so many-th row may be the one without a load.
    finite = thinned(kept(normal, np.isfinite(normal)))
    size = np.abs(finite)
    if size.size == 0 or not size.any():
        return 0.0
    level = abs(float(np.median(finite[size >= 0.5 * np.quantile(size, 0.99)])))
    return float(np.median(finite[size >= _LOADED * level]))


def presses(normal: FloatArray) -> Rows:
    """Return which rows (n,) press with more than a tenth of the typical load: only these take part in a ratio."""
    return np.asarray(normal > UNLOADED * typical_load(normal))


def mean_and_drift(normal: FloatArray) -> tuple[float, float]:
    """Return the mean of the loaded rows [N], and the change of their median from the first to the last tenth as share
    of the typical load; (n,) may hold NaN. Where nothing presses, all rows count and the change is 0."""
    level = typical_load(normal)
    if level <= 0:
        return float(np.mean(normal[np.isfinite(normal)])) if np.isfinite(normal).any() else 0.0, 0.0
    force = kept(normal, normal > _LOADED * level)
    few = thinned(force)
    tenth = max(few.size // 10, 1)
    return float(np.mean(force)), float(np.median(few[-tenth:]) - np.median(few[:tenth])) / level


# Where a log shows the drive at rest: before it starts and after it has stopped, and what the sensor shows there.

_FEWEST: Final = 20  # rows of a rest that is worth a word
_SLOW: Final = 0.05  # share of the usual speed of the drive below which it rests
_BAND: Final = 4.0  # standard deviations of the noise that a force at rest may span to either side
_LOW: Final = 0.5  # share of the sliding force below which a flat beginning is rest and not sliding
_SHARE: Final = 0.9  # part of a flat stretch that is measured: its end already moves by what the band allows


@dataclass(frozen=True)
class Rest:
    """A stretch at rest: rows [start, stop) and mean friction force there [N]."""

    start: int
    stop: int
    force: float


@dataclass(frozen=True)
class Rests:
    """Rest before the drive starts and after it has stopped; None where there is none."""

    before: Rest | None = None
    after: Rest | None = None


def find_rests(record: Record, friction: FloatArray, speed: FloatArray | None = None) -> Rests:
    """Find the rests at both ends of a record.

    friction (n,) [N]: the friction force, NaN where it does not count. speed (n,) [m/s]: of a column that is known to
    be the drive; without one, a force that stays within its noise below half of the sliding force is rest before the
    start, and nothing tells of a stop.
    """
    if speed is None and isinstance(record.drive_speed, np.ndarray):
        speed = np.abs(record.drive_speed)
    finite = np.isfinite(friction)
    if speed is not None and speed.max() > 0:
        moving = np.flatnonzero(speed > _SLOW * np.quantile(speed, 0.9))
        rests = []
        for start, stop in ((0, int(moving[0])), (int(moving[-1]) + 1, friction.size)):
            inside = friction[start:stop][finite[start:stop]]
            rests.append(Rest(start, stop, float(inside.mean())) if inside.size >= _FEWEST else None)
        return Rests(*rests)
    force = kept(friction, finite)
    if force.size < 3 * _FEWEST:
        return Rests()
    level, width = float(np.median(force[: _FEWEST // 2])), _FEWEST // 4
    band = max(_BAND * noise_of(force), 1e-9 * float(np.abs(force).max()))
    smooth = np.convolve(force, np.ones(width) / width, mode="valid")
    outside = np.flatnonzero(np.abs(smooth - level) > band)
    rows = int(outside[0]) + width // 2 if outside.size else force.size
    inside = force[: int(_SHARE * rows)]
    if not _FEWEST <= rows < _SHARE * force.size:
        return Rests()
    rises = abs(np.polyfit(np.arange(inside.size), inside, 1)[0]) * inside.size >= 0.5 * band
    level = float(np.mean(inside))
    if rises or abs(level) >= _LOW * float(np.median(np.abs(thinned(force[rows:])))):
        return Rests()
    return Rests(Rest(0, int(np.flatnonzero(finite)[rows - 1]) + 1, level))


def noise_of(force: FloatArray) -> float:
    """Return the standard deviation of the noise [N], from the steps between samples; at least their quantisation."""
    steps = np.abs(thinned_steps(force))
    robust = 1.4826 * float(np.median(steps)) / np.sqrt(2.0)
    smallest = float(np.min(steps, where=steps > 0, initial=np.inf))
    if smallest > np.sqrt(12.0) * robust:  # the smallest of all may be smaller still
        steps = np.abs(np.diff(force))
        robust = max(robust, float(np.min(steps, where=steps > 0, initial=np.inf)) / np.sqrt(12.0))
    return robust if robust < np.inf else 0.0


# Gaps of the clock: pauses of the recording, packets of rows that were stamped when they were read, and rows lost.

MOST_PAUSES: Final = 20
"""Gaps of a log that is taken in parts, each longer than one over this number of the rows; one with more lost rows."""
_FEWEST_PACKETS: Final = 4
_STRAIGHT: Final = 0.5  # of a gap: by how much the begin of a packet may miss the line through all begins
_AS_INSIDE: Final = 0.9
"""Quantile of the steps of the force from row to row, which the median step over a gap stays below in packets."""


def _long_gaps(time: FloatArray) -> npt.NDArray[np.intp]:
    """Return the rows before each gap of a clock (n,) that more than `LONGEST_GAP` rows would fill."""
    if time.size < 3:
        return np.empty(0, dtype=np.intp)
    change = np.diff(time)
    return np.flatnonzero(change > (LONGEST_GAP + 1.5) * float(np.median(thinned(change))))


def packets(time: FloatArray, force: FloatArray) -> float | None:
    """Return the rate [Hz] of rows (n,) that come in packets, stamped when they were read; None where they do not.

    Packets begin as evenly as their rows are counted, and the force goes on from one to the next as from row to row.
    """
    gaps = _long_gaps(time)
    if gaps.size < _FEWEST_PACKETS:
        return None
    begins, ends = time[gaps[:-1] + 1], gaps[1:]  # a packet is read when its last row is there
    interval, first = np.polyfit(ends, begins, 1)
    pause = float(np.median(time[gaps + 1] - time[gaps]))
    if np.max(np.abs(begins - first - interval * ends)) > _STRAIGHT * pause:
        return None
    step = np.abs(np.diff(force))
    goes_on = np.nanmedian(step[gaps]) <= np.nanquantile(np.delete(step, gaps), _AS_INSIDE)
    return float(1.0 / interval) if goes_on else None


def pauses(time: FloatArray, force: FloatArray) -> npt.NDArray[np.intp]:
    """Return the rows (k,) before each pause of a recording: a gap of the clock (n,) that a twentieth of its rows would
    not fill; none where rows come in packets."""
    gaps = _long_gaps(time)
    if not gaps.size:
        return gaps
    recorded = time.size * float(np.median(thinned(np.diff(time))))
    gaps = gaps[time[gaps + 1] - time[gaps] > recorded / MOST_PAUSES]
    return gaps if gaps.size <= MOST_PAUSES and packets(time, force) is None else gaps[:0]


# How a record was sampled: rate, jitter, dropouts, rate switches; step by step, pauses between steps aside.

_EVEN: Final = 1e-3
_WINDOW: Final = 51  # intervals over which the local rate is the median
_DROPOUT: Final = 1.5
_ODD_FIRST: Final = 0.2
_NAMED: Final = 5


@dataclass(frozen=True)
class RateSwitch:
    """A change of the sampling rate: when [s], from and to [Hz]."""

    time: float
    before: float
    after: float


@dataclass(frozen=True)
class Sampling:
    """rate [Hz]: 1 / mean interval, dropouts aside; where it changes for good 1 / median interval. jitter: robust
    standard deviation of the interval as share of the interval.

    dropouts: gaps of more than one and a half intervals; missing: rows that would fill them; longest_gap [s], which
    begins at longest_at [s]; odd_first: a first interval of a step off by more than 20 %; switches: where the rate
    changes for good.
    """

    rate: float
    jitter: float
    dropouts: int
    missing: int
    longest_gap: float
    longest_at: float
    odd_first: bool
    switches: tuple[RateSwitch, ...]


def describe_sampling(
    record: Record, used: Rows | None = None, thresholds: Thresholds = DEFAULTS
) -> tuple[Sampling, list[Finding]]:
    """Return the sampling of a record and what is worth saying about it.

    used: (n,) the rows that count; a stretch that was left out is no gap of the clock.
    """
    whole = [(step.start, step.stop) for step in record.steps]
    if used is not None and not used.all():
        whole = [(start + int(a), start + int(b)) for start, stop in whole for a, b in true_runs(used[start:stop])]
    stretches, notes = _without_pauses(record, whole, thresholds)
    clocks = [time for start, stop in stretches if (time := record.time[start:stop]).size > 1]
    clocks = clocks or [record.time]  # steps of one row each
    odd, switches, levels = False, list[RateSwitch](), list[FloatArray]()
    for time in clocks:
        change = np.diff(time)
        odd = odd or (change.size > 2 and abs(change[0] / np.median(thinned(change)) - 1) > _ODD_FIRST)
        level = _local_interval(change)
        switches += _switches(time, level, float(levels[-1][-1]) if levels else None, thresholds["rate_switch"])
        levels.append(level)
    change, level = np.concatenate([np.diff(time) for time in clocks]), np.concatenate(levels)
    gaps = change > _DROPOUT * level
    steady = thinned(kept(change, ~gaps))
    even = steady / thinned(kept(level, ~gaps))
    # A clock of whole milliseconds alternates: its median is one of two steps.
    usual = np.median(thinned(change)) if switches or steady.size < 3 else np.mean(steady[1:])
    begins = np.concatenate([time[:-1] for time in clocks])[gaps]
    longest = int(np.argmax(change[gaps])) if gaps.any() else 0
    sampling = Sampling(
        rate=float(1 / usual),
        jitter=float(1.4826 * np.median(np.abs(even - np.median(even)))) if even.size else 0.0,
        dropouts=int(np.count_nonzero(gaps)),
        missing=int(np.sum(np.round(change[gaps] / level[gaps]) - 1)),
        longest_gap=float(change[gaps][longest]) if gaps.any() else 0.0,
        longest_at=float(begins[longest]) if gaps.any() else 0.0,
        odd_first=bool(odd),
        switches=tuple(switches),
    )
    rate = packets(record.time, record.friction_force)
    if rate is not None:
        text = (
            "the rows come in packets with gaps between their stamps, and the force goes on from one packet to the "
            "next: they were stamped when they were read, not when they were measured; if they follow each other "
            f'evenly, give their rate, as in --rate "{rate:.4g} Hz" (in a scene: rate = "{rate:.4g} Hz")'
        )
        return sampling, [Finding("packets", "reject", text)]
    if odd:
        text = "the first sampling interval differs from the others, as CETR logs have it"
        notes.append(Finding("odd_first_interval", "info", text))
    if switches:
        named = [f"at {s.time:.6g} s from {s.before:.4g} to {s.after:.4g} Hz" for s in switches]
        more = f" and {len(named) - _NAMED} more" if len(named) > _NAMED else ""
        text = f"the sampling rate changes {'; '.join(named[:_NAMED])}{more}; log at one rate, or cut one part with "
        notes.append(Finding("rate_switch", "warning", f"{text}window"))
    notes += thresholds.finding(
        "dropouts", "missing_rows", sampling.missing / (change.size + len(clocks) + sampling.missing),
        f"{sampling.dropouts} gap(s) in the clock, about {sampling.missing} rows missing, the longest gap "
        f"{sampling.longest_gap:.4g} s at {sampling.longest_at:.6g} s; write to a faster disk",
    )  # fmt: skip
    notes += thresholds.finding(
        "jitter", "jitter", sampling.jitter,
        f"the sampling interval jitters by {100 * sampling.jitter:.0f} % about {1 / sampling.rate:.4g} s; let the "
        "hardware clock the sampling",
    )  # fmt: skip
    return sampling, notes


def _without_pauses(
    record: Record, pieces: Sequence[tuple[int, int]], limits: Thresholds
) -> tuple[list[tuple[int, int]], list[Finding]]:
    """Return stretches of rows [start, stop) cut at the pauses of the recording, and what to say of these."""
    parts, lasting = [], []
    for start, stop in pieces:
        time = record.time[start:stop]
        ends = pauses(time, record.friction_force[start:stop])
        lasting += [(float(time[i + 1] - time[i]), float(time[i])) for i in ends]
        parts += list(pairwise([start, *(start + ends + 1).tolist(), stop]))
    if not limits.beyond("missing_rows", sum(gap for gap, _ in lasting) / float(record.time[-1])):
        return parts, []
    longest, at = max(lasting)
    text = (
        f"the recording pauses {len(lasting)} time(s), longest for {longest:.4g} s at {at:.6g} s; what lies before and "
        "after a pause is looked at apart"
    )
    return parts, [Finding("pauses", "warning", text)]


def _local_interval(change: FloatArray) -> FloatArray:
    """Median interval around each interval, shape (n - 1,): a few dropouts do not move it, a switch does."""
    if change.size and np.ptp(change) <= _EVEN * change[0]:  # an even clock needs no window
        return np.broadcast_to(np.median(thinned(change)), change.shape)
    import pandas as pd  # 0.3 s: few logs need it

    window = min(_WINDOW, change.size)
    return pd.Series(change).rolling(window, center=True, min_periods=1).median().to_numpy(dtype=np.float64)


def _switches(time: FloatArray, level: FloatArray, previous: float | None, factor: float) -> list[RateSwitch]:
    """Return the places where the local interval leaves a factor about the one before, within one step."""
    switches: list[RateSwitch] = []
    reference, start = previous if previous is not None else float(level[0]), 0
    while start < level.size:
        outside = np.flatnonzero((level[start:] < reference / factor) | (level[start:] > reference * factor))
        if not outside.size:
            break
        place = start + int(outside[0])
        settled = float(level[min(place + _WINDOW // 2, level.size - 1)])
        if max(settled / reference, reference / settled) > factor:
            switches.append(RateSwitch(float(time[place]), 1 / reference, 1 / settled))
            reference = settled
        start = place + _WINDOW // 2 + 1
    return switches


# The gate as a whole.

Verdict = Literal["accept", "accept with warnings", "reject"]


@dataclass(frozen=True)
class Quality:
    """What the gate measured. Findings hold the record's own first, then those of the gate.

    sampling, signal, load: see `Sampling`, `Signal`, `Load`. rests: the drive at rest at both ends of the log.
    residual [N]: friction force before the drive moves or while nothing presses, None where the log does not show it.
    coefficient_error: median share by which the file's own coefficient differs from friction / normal force, None
    where the file has none.
    """

    sampling: Sampling
    signal: Signal
    load: Load
    rests: Rests
    residual: float | None
    coefficient_error: float | None
    findings: tuple[Finding, ...]

    @property
    def verdict(self) -> Verdict:
        """The worst finding decides."""
        return verdict_of(self.findings)

    @property
    def figures(self) -> dict[str, tuple[float | None, str]]:
        """Every number of the gate by name, with its unit."""
        sampling, signal, load = self.sampling, self.signal, self.load
        locked = self.rests.after
        return {
            "sampling_rate": (sampling.rate, "Hz"),
            "jitter": (sampling.jitter, ""),
            "missing_rows": (sampling.missing, ""),
            "repeated_rows": (signal.repeated, ""),
            "resolution": (signal.resolution, "N"),
            "clipped_rows": (signal.clipped, ""),
            "residual_force": (self.residual, "N"),
            "force_after_stop": (None if locked is None else locked.force, "N"),
            "normal_force": (load.mean, "N"),
            "normal_force_drift": (load.drift, ""),
            "normal_force_ripple": (load.ripple, ""),
            "unloaded_rows": (load.unloaded, ""),
            "coefficient_error": (self.coefficient_error, ""),
        }


def verdict_of(findings: Sequence[Finding]) -> Verdict:
    """Return the verdict that findings amount to."""
    severities = {finding.severity for finding in findings}
    return "reject" if "reject" in severities else "accept with warnings" if "warning" in severities else "accept"


def assess(
    record: Record,
    used: Rows | None = None,
    thresholds: Thresholds = DEFAULTS,
    speed: FloatArray | None = None,
) -> Quality:
    """Look at a record's clock and forces; never changes it and never fails on a valid record.

    used: (n,) the rows that count (None: all), as the scene cuts them. thresholds: see `data_io.thresholds`.
    speed (n,) [m/s]: how fast the drive moves, where a column is known to be it.
    """
    used = np.ones(len(record), dtype=bool) if used is None else used
    sampling, notes = describe_sampling(record, used, thresholds)
    sound = used & np.isfinite(record.friction_force) & np.isfinite(record.normal_force)
    if np.count_nonzero(sound) < 2:
        text = "fewer than two rows count; widen window, exclude less, or take a longer log"
        findings = (*record.findings, *notes, Finding("no_rows", "reject", text))
        return Quality(sampling, Signal(0, 0.0, 0.0), Load(0.0, 0.0, 0.0, 0.0, 0.0), Rests(), None, None, findings)
    load, about_load = _look_at_load(record, sound, thresholds)
    rests = find_rests(record, shown(record.friction_force, sound), speed)
    signal, about_friction = _look_at_friction(record, sound, thresholds)
    residual, about_rest = _at_rest(record, sound, load, rests, thresholds)
    error = _coefficient_error(record, sound, load.level)
    about_coefficient = thresholds.finding(
        "coefficient_disagrees", "coefficient", error or 0.0,
        f"the file's own coefficient differs from friction force / normal force by {percent(error or 0.0)} (median); "
        "check zero points and columns",
    )  # fmt: skip
    findings = (*record.findings, *notes, *about_friction, *about_load, *about_rest, *about_coefficient)
    return Quality(sampling, signal, load, rests, residual, error, findings)


def _at_rest(
    record: Record, sound: Rows, load: Load, rests: Rests, limits: Thresholds
) -> tuple[float | None, list[Finding]]:
    """Return the residual force [N] and what is to say of it and of a stop."""
    moving, stop = sound.copy(), rests.after
    for rest in filter(None, (rests.before, stop)):
        moving[rest.start : rest.stop] = False
    moving = moving if np.count_nonzero(moving) > 1 else sound
    sliding = float(np.median(np.abs(thinned(kept(record.friction_force, moving)))))
    unpressed = sound & (record.normal_force < UNLOADED * load.level)
    residual, when, remedy = None, "", ""
    if np.count_nonzero(unpressed) >= _FEWEST:
        residual = float(np.median(record.friction_force[unpressed]))
        when, remedy = "while nothing presses", f'tare = "{residual:.3g} N"'
    elif rests.before is not None:
        end = record.time[max(int(0.9 * rests.before.stop), 1)]
        residual = rests.before.force
        when, remedy = f"before the drive moves (to {end:.4g} s)", f'tare = ["0 s", "{end:.4g} s"]'
    share = abs(residual or 0.0) / sliding if sliding else 0.0
    notes = limits.finding(
        "residual_force", "residual_force", share,
        f"the friction force shows {residual or 0.0:.3g} N {when}, {percent(share, of='the sliding force')}; zero the "
        f"sensor or take it off with {remedy}",
    )  # fmt: skip
    if stop is not None:
        since = float(record.time[stop.start])
        text = f"the drive stops at {since:.4g} s, and {stop.force:.3g} N stay locked in; leave it out with window = "
        share = (stop.stop - stop.start) / len(record)
        notes += limits.finding("stopped", "stopped_rows", share, f'{text}["0 s", "{since:.4g} s"]')
    return residual, notes


def _coefficient_error(record: Record, sound: Rows, load: float) -> float | None:
    name = next((name for name in record.channels if parse_name(name).key in COEFFICIENTS), None)
    if name is None or record.channel_units[name] not in ("", "-", "1"):
        return None
    stated, friction = np.abs(record.channels[name]), np.abs(record.friction_force)
    usable = sound & np.isfinite(stated) & (record.normal_force > 0.5 * load) & (friction > 0.1 * friction[sound].max())
    if load <= 0 or not usable.any():
        return None
    own = friction[usable] / record.normal_force[usable]
    return float(np.median(np.abs(stated[usable] - own) / own))
