"""The quality gate: what a record's clock and force channels look like, in numbers and in sentences.

Knows sampling and sensors only; whether a slip holds enough samples is for those who know slips.
"""

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from data_io.arrays import grid_step, kept, longest_run, shown, thinned, thinned_steps, true_runs
from data_io.record import Record
from data_io.values import LONGEST_GAP, Finding, FloatArray, Frozen, LogError, Severity

Rows = npt.NDArray[np.bool_]
Verdict = Literal["accept", "accept with warnings", "reject"]
Figures = dict[str, tuple[float | None, str]]

# The thresholds: one visible table, each number documented and open to override.

REJECT: Final = 10.0
"""Times a threshold, beyond which the log is rejected, where the table says that it is."""


@dataclass(frozen=True)
class Limit:
    """One threshold: a warning lies beyond `value`, a rejection beyond ten times it where it `rejects`."""

    name: str
    value: float
    unit: str
    meaning: str
    rejects: bool = False
    beyond: Literal["above", "below"] = "above"


LIMITS: Final = (
    Limit("residual_force", 0.05, "of the sliding force",
          "friction force shown before the drive moves, or while nothing presses"),
    Limit("friction_drift", 0.10, "of the friction force",
          "change of the friction force over the load from the first to the last third of the slips"),
    Limit("load_drift", 0.10, "of the load", "change of the normal force from first to last tenth"),
    Limit("load_ripple", 0.03, "of the load", "standard deviation of the normal force", rejects=True),
    Limit("clipped_rows", 0.005, "of the rows", "rows in which a force sensor stands at its end", rejects=True),
    Limit("quantisation", 0.02, "of the range of the friction force",
          "step of the grid on which the values of the friction force lie", rejects=True),
    Limit("missing_rows", 0.02, "of the rows", "rows missing in gaps of the clock", rejects=True),
    Limit("jitter", 0.03, "of the sampling interval", "robust standard deviation of the sampling interval",
          rejects=True),
    Limit("repeated_rows", 0.06, "of the rows",
          "rows that repeat every measured value of the row before, quantisation apart", rejects=True),
    Limit("spikes", 0.002, "of the rows", "samples far from their neighbours", rejects=True),
    Limit("cycles", 3, "cycles", "stick-slip cycles found, where there are any", beyond="below"),
    Limit("samples_per_slip", 10, "samples", "samples from force peak to valley: what a and delta_mu_k need",
          beyond="below"),
    Limit("stick_slope", 0.10, "of k times v_0",
          "difference between the slope of the sticks and stiffness times drive speed"),
)  # fmt: skip
"""Every threshold with its default; `Thresholds` overrides them by name."""

_DEFAULT: Final = {limit.name: limit for limit in LIMITS}
_NAMES: Final = (*_DEFAULT, *(f"{limit.name}_reject" for limit in LIMITS if limit.rejects))


@dataclass(frozen=True)
class Thresholds:
    """The defaults of `LIMITS` with the user's own numbers in place of some of them, by name; `<name>_reject` is a
    number of its own from where on a log is rejected.

    Raises `LogError` for a name that is not in the table, or a number that is none.
    """

    own: Mapping[str, float] = field(default_factory=Frozen)

    def __post_init__(self) -> None:
        for name, value in self.own.items():
            if name not in _NAMES:
                near = difflib.get_close_matches(name, _NAMES, n=1, cutoff=0.0)[0]
                raise LogError(
                    f"the threshold {name!r} is not known; did you mean {near!r}? Known are {', '.join(_NAMES)}"
                )
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not value >= 0:
                raise LogError(f"the threshold {name} is {value!r}; a number from 0 on was expected (inf: never)")
        object.__setattr__(self, "own", Frozen(dict(self.own)))

    def __getitem__(self, name: str) -> float:
        return float(self.own.get(name, _DEFAULT[name].value))

    def severity(self, name: str, measured: float) -> Severity | None:
        """Return "reject", "warning" or None of a measured number; one that is no number is never beyond."""
        limit, value = _DEFAULT[name], self[name]
        reject = float(self.own.get(f"{name}_reject", REJECT * value or math.inf))
        if not math.isfinite(measured) or not (measured > value if limit.beyond == "above" else measured < value):
            return None
        return "reject" if limit.rejects and measured > reject else "warning"

    def finding(self, code: str, name: str, measured: float, text: str) -> list[Finding]:
        """Return what is to say of a measured number that lies beyond a threshold: one finding, or none."""
        severity = self.severity(name, measured)
        return [] if severity is None else [Finding(code, severity, text)]


DEFAULTS: Final = Thresholds()


def percent(share: float, digits: int = 0, *, signed: bool = False, of: str = "") -> str:
    """Return a share as "12 %" or "12 % of 3 N"; never as "-0 %", and many times the whole as "2000 times 3 N"."""
    if abs(share) > 10.0:
        size = f"{share:+.3g}" if signed else f"{share:.3g}"
        times = "many times" if "e" in size or "inf" in size else f"{size} times"
        return f"{times} {of}".rstrip()
    return f"{100 * share:{'+' if signed else ''}z.{digits}f} %" + (f" of {of}" if of else "")


# The friction force: dead, clipped, coarse, repeated.

_CLIPPED_RUN: Final = 10  # rows in a row at the very same extreme value before a sensor is at its end
_CLIPPED_EXCESS: Final = 5.0  # times that its end is shown more often than the values before it
_BIG_STEP: Final = 3.0  # steps of the quantisation by which a repeated signal moves on; a coarse one by one or two


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
            severity = limits.severity("clipped_rows", rows / force.size) or "info"
            text = (
                f"the {name} stays at its {end} value {level:.4g} N in {rows} rows: the sensor was at its end; use a "
                "larger measuring range"
            )
            notes.append(Finding(f"{name.split()[0]}_clipped", severity, text))
    return total, notes


def _repeated(record: Record, used: Rows, step: float) -> float:
    """Return the share of rows that repeat the row before, not by chance."""
    pair = used[1:] & used[:-1]
    change = np.abs(np.diff(record.friction_force))
    same = pair & (change == 0.0)
    moved = change[pair & ~same] if same.any() else np.empty(0)
    if moved.size == 0 or float(np.median(moved)) <= _BIG_STEP * step:
        return 0.0
    beside = pair & ~same & (change < 1.5 * step)
    if np.ptp(record.normal_force[used]) > 0:
        still = np.diff(record.normal_force) == 0
        same, beside = same & still, beside & still
    rows = int(np.count_nonzero(same)) - 0.5 * int(np.count_nonzero(beside))
    return max(rows, 0.0) / max(int(np.count_nonzero(pair)), 1)


def noise_of(force: FloatArray) -> float:
    """Return the standard deviation of the noise [N], from the steps between samples; at least their quantisation."""
    steps = np.abs(thinned_steps(force))
    robust = 1.4826 * float(np.median(steps)) / np.sqrt(2.0)
    smallest = float(np.min(steps, where=steps > 0, initial=np.inf))
    if smallest > np.sqrt(12.0) * robust:  # the smallest of all may be smaller still
        steps = np.abs(np.diff(force))
        robust = max(robust, float(np.min(steps, where=steps > 0, initial=np.inf)) / np.sqrt(12.0))
    return robust if robust < np.inf else 0.0


# The normal force: its level, drift and ripple, rows without load.

UNLOADED: Final = 0.1
"""Share of the typical load below which a row counts as not loaded."""
_LOADED: Final = 0.3  # share of it above which a row is loaded: a load that ripples is so in its troughs as well


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


def _look_at_load(record: Record, used: Rows, limits: Thresholds) -> tuple[float, Figures, list[Finding]]:
    """Return the level of the normal force of the rows that count [N], its figures and what is to say of them."""
    normal = kept(record.normal_force, used)
    level, (mean, drift), ripple, unloaded = typical_load(normal), mean_and_drift(normal), 0.0, 1.0
    notes, size = list[Finding](), f"{level:.3g} N"
    if level <= 0:
        text = "the normal force is zero or pulls; a pressing load was expected; check its column, unit and zero point"
        notes.append(Finding("no_load", "reject", text))
    else:
        few, time = thinned(normal), thinned(kept(record.time, used))
        loaded, unloaded = few > _LOADED * level, np.count_nonzero(normal < UNLOADED * level) / normal.size
        if np.count_nonzero(loaded) > 2:
            line = np.polynomial.Polynomial.fit(time[loaded], few[loaded], 1)
            ripple = float(np.std(few[loaded] - line(time[loaded]))) / level
        if np.ptp(normal) > 0:  # rows without a load lie at the lowest value of a sound sensor
            notes += _clipping("normal force", normal[normal >= UNLOADED * level], limits)[1]
        elif not str(record.metadata.get("normal_force_source", "")).startswith("constant"):
            text = f"the normal force is exactly {level:g} N in every row; it was set, not measured"
            notes.append(Finding("normal_force_not_measured", "info", text))
        if unloaded:
            text = (
                f"{100 * unloaded:.1f} % of the rows press with less than a tenth of the load ({size}); leave them out "
                "with window or choose the loaded step"
            )
            notes.append(Finding("unloaded_rows", "warning", text))
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
    figures = {"normal_force": (mean, "N"), "normal_force_drift": (drift, ""), "normal_force_ripple": (ripple, "")}
    return level, {**figures, "unloaded_rows": (unloaded, "")}, notes


# Where a log shows the drive at rest: before it starts and after it has stopped, and what the sensor shows there.

_FEWEST: Final = 20  # rows of a rest that is worth a word
_SLOW: Final = 0.05  # share of the usual speed of the drive below which it rests
_BAND: Final = 4.0  # standard deviations of the noise that a force at rest may span to either side


def _rests(friction: FloatArray, speed: FloatArray | None) -> tuple[int, int]:
    """Return how many rows lie before the drive moves, and from which row on it has stopped.

    Without a column of the drive, a force (n,) [N] that stays within its noise below half of the sliding force is rest
    before the start, and nothing tells of a stop.
    """
    whole = (0, friction.size)
    if speed is not None and speed.max() > 0:
        moving = np.flatnonzero(speed > _SLOW * np.quantile(speed, 0.9))
        return int(moving[0]), int(moving[-1]) + 1
    finite = np.isfinite(friction)
    force, width = kept(friction, finite), _FEWEST // 4
    if force.size < 3 * _FEWEST:
        return whole
    band = max(_BAND * noise_of(force), 1e-9 * float(np.abs(force).max()))
    smooth = np.convolve(force, np.ones(width) / width, mode="valid")
    outside = np.flatnonzero(np.abs(smooth - np.median(force[: _FEWEST // 2])) > band)
    rows = int(outside[0]) + width // 2 if outside.size else force.size
    inside = force[: int(0.9 * rows)]  # its end already moves by what the band allows
    if not _FEWEST <= rows < 0.9 * force.size:
        return whole
    rises = abs(np.polyfit(np.arange(inside.size), inside, 1)[0]) * inside.size >= 0.5 * band
    if rises or abs(np.mean(inside)) >= 0.5 * float(np.median(np.abs(thinned(force[rows:])))):
        return whole
    return int(np.flatnonzero(finite)[rows - 1]) + 1, friction.size


def _at_rest(
    record: Record, sound: Rows, load: float, speed: FloatArray | None, limits: Thresholds
) -> tuple[float | None, list[Finding]]:
    """Return the residual force [N], None where the log does not show it, and what is to say of it and of a stop."""
    friction = shown(record.friction_force, sound)
    begin, stop = _rests(friction, speed)
    moving = sound.copy()
    moving[:begin] = moving[stop:] = False
    sliding = float(np.median(np.abs(thinned(friction[moving if np.count_nonzero(moving) > 1 else sound]))))
    unpressed, residual, notes = sound & (record.normal_force < UNLOADED * load), None, list[Finding]()
    if np.count_nonzero(unpressed) >= _FEWEST:
        residual = float(np.median(friction[unpressed]))
        when, remedy = "while nothing presses", f'tare = "{residual:.3g} N"'
    elif np.count_nonzero(sound[:begin]) >= _FEWEST:
        end, residual = record.time[max(int(0.9 * begin), 1)], float(np.nanmean(friction[: int(0.9 * begin)]))
        when, remedy = f"before the drive moves (to {end:.4g} s)", f'tare = ["0 s", "{end:.4g} s"]'
    if residual is not None and sliding:
        share = abs(residual) / sliding
        notes = limits.finding(
            "residual_force", "residual_force", share,
            f"the friction force shows {residual:.3g} N {when}, {percent(share, of='the sliding force')}; zero the "
            f"sensor or take it off with {remedy}",
        )  # fmt: skip
    if np.count_nonzero(sound[stop:]) >= _FEWEST:
        since, locked = float(record.time[stop]), float(np.nanmean(friction[stop:]))
        text = (
            f"the drive stops at {since:.4g} s, and {locked:.3g} N stay locked in; leave it out with window = "
            f'["0 s", "{since:.4g} s"]'
        )
        notes.append(Finding("stopped", "warning", text))
    return residual, notes


# Gaps of the clock: pauses of the recording, packets of rows that were stamped when they were read, and rows lost.

MOST_PAUSES: Final = 20
"""Gaps of a log that is taken in parts, each longer than one over this number of the rows; one with more lost rows."""
_FEWEST_PACKETS: Final = 4
_AS_INSIDE: Final = 0.9  # quantile of the steps of the force from row to row: those over gaps of packets are below


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
    if np.max(np.abs(begins - first - interval * ends)) > 0.5 * pause:
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


# How a record was sampled: rate, jitter, rows lost; step by step, pauses between steps aside.

_WINDOW: Final = 51  # intervals over which the local interval is the median: dropouts do not move it
_SWITCH: Final = 1.5  # times, by which the local interval changes where the rate does, or an interval of a dropout


@dataclass(frozen=True)
class Sampling:
    """rate [Hz]: 1 / mean interval, dropouts aside; where it changes in mid-log 1 / median interval. jitter: robust
    standard deviation of the interval as share of the interval. dropouts: gaps of more than one and a half intervals;
    missing: rows that would fill them; longest_gap [s], which begins at longest_at [s]."""

    rate: float
    jitter: float
    dropouts: int
    missing: int
    longest_gap: float
    longest_at: float


def describe_sampling(
    record: Record, used: Rows | None = None, thresholds: Thresholds = DEFAULTS
) -> tuple[Sampling, list[Finding]]:
    """Return the sampling of a record and what is worth saying about it.

    used: (n,) the rows that count; a stretch that was left out is no gap of the clock.
    """
    stretches = [(step.start, step.stop) for step in record.steps]
    if used is not None and not used.all():
        stretches = [(a + int(i), a + int(j)) for a, b in stretches for i, j in true_runs(used[a:b])]
    parts, lasting, notes = list[tuple[int, int]](), list[tuple[float, float]](), list[Finding]()
    for start, stop in stretches:
        time = record.time[start:stop]
        ends = pauses(time, record.friction_force[start:stop])
        lasting += [(float(time[i + 1] - time[i]), float(time[i])) for i in ends]
        parts += pairwise([start, *(start + ends + 1).tolist(), stop])
    clocks = [record.time[a:b] for a, b in parts if b - a > 1] or [record.time]  # steps of one row each
    change, level = (np.concatenate(each) for each in zip(*map(_intervals, clocks), strict=True))
    gaps = change > _SWITCH * level
    steady, lost = thinned(kept(change, ~gaps)), change[gaps]
    even = steady / thinned(kept(level, ~gaps))
    begins = np.concatenate([time[:-1] for time in clocks])
    switched = float(level.max()) > _SWITCH * float(level.min())
    # A clock of whole milliseconds alternates: its median is one of two steps.
    usual = np.median(thinned(change)) if switched or steady.size < 3 else np.mean(steady[1:])
    sampling = Sampling(
        rate=float(1 / usual),
        jitter=float(1.4826 * np.median(np.abs(even - np.median(even)))) if even.size else 0.0,
        dropouts=lost.size,
        missing=int(np.sum(np.round(lost / level[gaps]) - 1)),
        longest_gap=float(np.max(lost, initial=0.0)),
        longest_at=float(begins[gaps][np.argmax(lost)]) if lost.size else 0.0,
    )
    rate = packets(record.time, record.friction_force)
    if rate is not None:
        text = (
            "the rows come in packets with gaps between their stamps, and the force goes on from one packet to the "
            "next: they were stamped when they were read, not when they were measured; if they follow each other "
            f'evenly, give their rate, as in --rate "{rate:.4g} Hz" (in a scene: rate = "{rate:.4g} Hz")'
        )
        return sampling, [Finding("packets", "reject", text)]
    if lasting:
        longest, at = max(lasting)
        text = (
            f"the recording pauses {len(lasting)} time(s), longest for {longest:.4g} s at {at:.6g} s; what lies before "
            "and after a pause is looked at apart"
        )
        notes.append(Finding("pauses", "warning", text))
    if switched:
        at = float(begins[1:][np.argmax(np.abs(np.diff(np.log(level))))])
        text = (
            f"the sampling rate changes between {1 / level.max():.4g} and {1 / level.min():.4g} Hz, as at {at:.6g} s; "
            "log at one rate, or cut one part with window"
        )
        notes.append(Finding("rate_switch", "warning", text))
    if sampling.missing:
        severity = thresholds.severity("missing_rows", sampling.missing / (change.size + sampling.missing)) or "info"
        marked = any(finding.code == "no_value_mark" for finding in record.findings)
        remedy = "rows without a value were left out" if marked else "write to a faster disk"
        text = (
            f"{sampling.dropouts} gap(s) in the clock, about {sampling.missing} rows missing, the longest gap "
            f"{sampling.longest_gap:.4g} s at {sampling.longest_at:.6g} s; {remedy}"
        )
        notes.append(Finding("dropouts", severity, text))
    notes += thresholds.finding(
        "jitter", "jitter", sampling.jitter,
        f"the sampling interval jitters by {100 * sampling.jitter:.0f} % about {1 / sampling.rate:.4g} s; let the "
        "hardware clock the sampling",
    )  # fmt: skip
    return sampling, notes


def _intervals(time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the intervals of a clock (n,) and the median interval around each, (n - 1,)."""
    change = np.diff(time)
    if np.ptp(change) <= 1e-3 * change[0]:  # an even clock needs no window
        return change, np.broadcast_to(np.median(thinned(change)), change.shape)
    import scipy  # few logs need it

    return change, scipy.ndimage.median_filter(change, min(_WINDOW, change.size), mode="mirror")


# The gate as a whole.


@dataclass(frozen=True)
class Quality:
    """What the gate measured: sampling, every number by its name with its unit; findings, those of the record first."""

    sampling: Sampling
    figures: Figures
    findings: tuple[Finding, ...]


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

    used: (n,) the rows that count (None: all), as the scene cuts them. speed (n,) [m/s]: how fast the drive moves,
    where a column is known to be it.
    """
    used = np.ones(len(record), dtype=bool) if used is None else used
    sampling, notes = describe_sampling(record, used, thresholds)
    sound = used & np.isfinite(record.friction_force) & np.isfinite(record.normal_force)
    friction = kept(record.friction_force, sound)
    figures: Figures = {
        "sampling_rate": (sampling.rate, "Hz"),
        "jitter": (sampling.jitter, ""),
        "missing_rows": (sampling.missing, ""),
        "repeated_rows": (0.0, ""),
        "resolution": (0.0, "N"),
        "clipped_rows": (0, ""),
        "residual_force": (None, "N"),
        "normal_force": (0.0, "N"),
        "normal_force_drift": (0.0, ""),
        "normal_force_ripple": (0.0, ""),
        "unloaded_rows": (0.0, ""),
    }
    if friction.size < 2:
        text = "fewer than two rows count; widen window, exclude less, or take a longer log"
        notes.append(Finding("no_rows", "reject", text))
    else:
        span = float(np.ptp(friction))
        if span == 0.0:
            text = f"the friction force is exactly {friction[0]:g} N in every row; a living signal was expected"
            notes.append(Finding("friction_constant", "reject", f"{text}; check it"))
        else:
            clipped, about = _clipping("friction force", friction, thresholds)
            resolution = grid_step(friction)
            repeated = _repeated(record, sound, resolution)
            notes += about
            notes += thresholds.finding(
                "friction_coarse", "quantisation", resolution / span,
                f"the friction force comes in steps of {resolution:.3g} N, coarse against its range of {span:.3g} N; "
                "use a smaller measuring range of the sensor, or export more digits",
            )  # fmt: skip
            notes += thresholds.finding(
                "repeated_rows", "repeated_rows", repeated,
                f"{100 * repeated:.0f} % of the rows repeat the measured values of the row before: the logger is "
                "faster than the sensor, or loses it now and then; log at the rate of the sensor, and leave such "
                "stretches out",
            )  # fmt: skip
            figures |= {"clipped_rows": (clipped, ""), "resolution": (resolution, "N"), "repeated_rows": (repeated, "")}
        load, own, about = _look_at_load(record, sound, thresholds)
        residual, at_rest = _at_rest(record, sound, load, speed, thresholds)
        figures |= {**own, "residual_force": (residual, "N")}
        notes += [*about, *at_rest]
    return Quality(sampling, figures, (*record.findings, *notes))
