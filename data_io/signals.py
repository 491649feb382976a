"""What the force signals look like: dead, clipped, coarse, repeated; the load; the drive at rest at both ends."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.arrays import grid_step, kept, longest_run, thinned, thinned_steps
from data_io.record import Record
from data_io.thresholds import Thresholds, percent
from data_io.values import Finding, FloatArray

# The friction signal itself: dead, clipped, coarse, repeated; each as a number and a sentence.

_CLIPPED_RUN: Final = 10
"""Rows in a row at the very same extreme value before a sensor is said to stand at its end."""
_CLIPPED_EXCESS: Final = 5.0
"""A sensor at its end shows the last value this many times more often than the values before it."""
_BIG_STEP: Final = 3.0
"""Steps of the quantisation by which a held signal moves on; a coarse one moves by one or two."""


_HELD_EVENLY: Final = 0.9
"""Share of the values that are held as long as the usual one, give or take a row, by a logger ahead of its sensor."""


@dataclass(frozen=True)
class Signal:
    """clipped: rows at an end of the sensor. resolution [N]: step of the grid on which the values lie, 0 where they
    show none. repeated: share of the rows that repeat the row before."""

    clipped: int
    resolution: float
    repeated: float


def look_at_friction(record: Record, used: npt.NDArray[np.bool_], limits: Thresholds) -> tuple[Signal, list[Finding]]:
    """Measure the friction force of the rows that count, used (n,), and say what lies beyond the thresholds."""
    friction = kept(record.friction_force, used)
    span = float(np.ptp(friction))
    if span == 0:
        text = f"the friction force is exactly {friction[0]:g} N in every row; a living signal was expected; check it"
        return Signal(0, 0.0, 0.0), [Finding("friction_constant", "reject", text)]
    clipped, notes = clipping("friction force", friction, limits)
    resolution = grid_step(friction)
    if severity := limits.severity("quantisation", resolution / span):
        text = (
            f"the friction force comes in steps of {resolution:.3g} N, coarse against its range of {span:.3g} N; use a "
            "smaller measuring range of the sensor, or export more digits"
        )
        notes.append(Finding("friction_coarse", severity, text))
    repeated, evenly = _repeated(record, used, resolution)
    if severity := limits.severity("repeated_rows", repeated):
        cause = (
            "they are held for equally many rows each: the logger ran faster than the sensor; log at the sensor's own "
            "rate"
            if evenly
            else "they stand still now and then, for unlike times: a display that was read too slowly, or a link that "
            "was lost for a while; check how the values come to the logger, and leave such stretches out"
        )
        text = f"{100 * repeated:.0f} % of the rows repeat the measured values of the row before; {cause}"
        notes.append(Finding("repeated_rows", severity, text))
    return Signal(clipped, resolution, repeated), notes


def clipping(name: str, force: FloatArray, limits: Thresholds) -> tuple[int, list[Finding]]:
    """Return how many rows stand at an end of the sensor, and a finding for each end."""
    notes, total = [], 0
    for end, level in (("highest", float(force.max())), ("lowest", float(force.min()))):
        rows = _clipped_rows(force, level)
        total += rows
        if severity := limits.severity("clipped_rows", rows / force.size):
            text = (
                f"the {name} stays at its {end} value {level:.4g} N in {rows} rows: the sensor was at its end; use a "
                "larger measuring range"
            )
            notes.append(Finding(f"{name.split()[0]}_clipped", severity, text))
    return total, notes


def _clipped_rows(values: FloatArray, level: float) -> int:
    """Return how many rows stand at the level, an extreme value, if that looks like a sensor at its end, else 0."""
    at_end = values == level
    count = int(np.count_nonzero(at_end))
    if count < _CLIPPED_RUN or longest_run(at_end) < _CLIPPED_RUN:
        return 0
    off = np.abs(values - level)
    before, counts = np.unique(off[(off > 0.0) & (off < 0.1 * np.ptp(values))], return_counts=True)
    if before.size < 2:
        before, counts = np.unique(off[~at_end], return_counts=True)
    if before.size < 2:
        return 0
    usual = max(float(np.mean(counts[:5])), 1.0)
    return count if count > _CLIPPED_EXCESS * usual else 0


def _repeated(record: Record, used: npt.NDArray[np.bool_], step: float) -> tuple[float, bool]:
    """Return the share of rows that repeat the row before in every measured column and move on by leaps afterwards, and
    whether values are held for equally many rows each. As many as move on by one step of the grid, up or down, repeat
    by chance, and do not count."""
    pair = used[1:] & used[:-1]
    change = np.abs(np.diff(record.friction_force))
    same = pair & (change == 0.0)
    if not same.any():
        return 0.0, False
    moved = change[pair & ~same]
    if moved.size == 0 or float(np.median(moved)) <= _BIG_STEP * step:
        return 0.0, False
    beside = pair & ~same & (change < 1.5 * step)
    if np.ptp(record.normal_force[used]) > 0:
        still = np.diff(record.normal_force) == 0
        same, beside = same & still, beside & still
    held = np.diff(np.flatnonzero(np.concatenate(([True], ~same, [True]))))
    usual = float(np.median(held))
    evenly = usual > 1 and bool(np.mean(np.abs(held - usual) <= 1.0) >= _HELD_EVENLY)
    held_rows = int(np.count_nonzero(same)) - 0.5 * int(np.count_nonzero(beside))
    return max(held_rows, 0.0) / max(int(np.count_nonzero(pair)), 1), evenly


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


def look_at_load(record: Record, used: npt.NDArray[np.bool_], limits: Thresholds) -> tuple[Load, list[Finding]]:
    """Measure the normal force of the rows that count, and say what lies beyond the thresholds."""
    time, normal = kept(record.time, used), kept(record.normal_force, used)
    level = typical_load(normal)
    if level <= 0:
        text = "the normal force is zero or pulls; a pressing load was expected; check its column, unit and zero point"
        return Load(level, mean_and_drift(normal)[0], 0.0, 0.0, 1.0), [Finding("no_load", "reject", text)]
    ripple = _ripple(thinned(time), thinned(normal), level)
    load = Load(level, *mean_and_drift(normal), ripple, np.count_nonzero(normal < UNLOADED * level) / normal.size)
    notes = []
    if np.ptp(normal) > 0:
        # Rows without a load lie at the lowest value of a sound sensor.
        notes += clipping("normal force", normal[normal >= UNLOADED * level], limits)[1]
    elif not str(record.metadata.get("normal_force_source", "")).startswith("constant"):
        text = f"the normal force is exactly {level:g} N in every row; it was set, not measured"
        notes.append(Finding("normal_force_not_measured", "info", text))
    return load, [*notes, *_findings(load, limits)]


def typical_load(normal: FloatArray) -> float:
    """Return the median normal force of the loaded rows [N], 0 where nothing presses; (n,) may hold NaN."""
    # In this order: every so many-th row may be the one without a load.
    finite = thinned(kept(normal, np.isfinite(normal)))
    size = np.abs(finite)
    if size.size == 0 or not size.any():
        return 0.0
    level = abs(float(np.median(finite[size >= 0.5 * np.quantile(size, 0.99)])))
    return float(np.median(finite[size >= _LOADED * level]))


def presses(normal: FloatArray) -> npt.NDArray[np.bool_]:
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


def _ripple(time: FloatArray, normal: FloatArray, level: float) -> float:
    """Return the ripple of the loaded rows as share of the load."""
    loaded = normal > _LOADED * level
    if np.count_nonzero(loaded) < 3:
        return 0.0
    t, force = time[loaded], normal[loaded]
    centred = (t - t.mean()) / (t[-1] - t[0])
    slope = float(centred @ (force - force.mean()) / (centred @ centred))
    return float(np.std(force - force.mean() - slope * centred)) / level


def _findings(load: Load, limits: Thresholds) -> list[Finding]:
    notes, level = [], f"{load.level:.3g} N"
    if severity := limits.severity("unloaded_rows", load.unloaded):
        share = f"{100 * load.unloaded:.1f} % of the rows press with less than {100 * UNLOADED:.0f} % of the load"
        text = f"{share} ({level}); leave them out with window or choose the loaded step"
        notes.append(Finding("unloaded_rows", severity, text))
    if severity := limits.severity("load_drift", abs(load.drift)):
        word = "rises" if load.drift > 0 else "falls"
        text = (
            f"the normal force {word} by {percent(abs(load.drift), of=level)} from the first to the "
            "last tenth; a fit follows it with the effect varying_normal_force, and else takes the mean"
        )
        notes.append(Finding("load_drift", severity, text))
    if severity := limits.severity("load_ripple", load.ripple):
        text = (
            f"the normal force ripples by {percent(load.ripple, of=level)} (standard deviation); check "
            "the load control and the flatness of the track"
        )
        notes.append(Finding("load_ripple", severity, text))
    return notes


# Where a log shows the drive at rest: before it starts and after it has stopped, and what the sensor shows there.

FEWEST: Final = 20
"""Rows of a rest that is worth a word."""
_SLOW: Final = 0.05
"""Share of the usual speed of the drive below which it rests."""
_PORTION: Final = 1 << 14
"""Rows that are smoothed at once."""
_BAND: Final = 4.0
"""Standard deviations of the noise that a force at rest may span to either side."""
_LOW: Final = 0.5
"""Share of the sliding force below which a flat beginning is rest and not sliding."""
_LIVELY: Final = 5.0
_SWINGS: Final = 4
"""Sticks and slips that a force must have shown before its rest is taken for a stop, and not for steady sliding."""
_LEAST: Final = 0.05
"""Share of the rows that a stop seen in the force alone must hold: within a stick the force hardly moves either."""
_SHARE: Final = 0.9
"""Part of a flat stretch that is measured: its end already moves by what the band allows."""


@dataclass(frozen=True)
class Rest:
    """A stretch at rest: rows [start, stop), mean friction force there [N], and whether the drive's own column says so
    ("told") or only the force looks like it."""

    start: int
    stop: int
    force: float
    told: bool

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.stop - self.start


@dataclass(frozen=True)
class Rests:
    """Rest before the drive starts and after it has stopped; None where there is none."""

    before: Rest | None
    after: Rest | None


def find_rests(record: Record, friction: FloatArray, speed: FloatArray | None = None) -> Rests:
    """Find the rests at both ends of a record.

    friction (n,) [N]: the friction force, NaN where it does not count. speed (n,) [m/s]: of a column that is known to
    be the drive, believed first; without one, a force that stays within its noise below half of the sliding force is
    rest before the start, and one that stays within its noise after stick-slip may be a stop.
    """
    if speed is None and isinstance(record.drive_speed, np.ndarray):
        speed = np.abs(record.drive_speed)
    if speed is not None:
        moving = np.flatnonzero(speed > _SLOW * np.quantile(speed, 0.9))
        if moving.size and speed.max() > 0:
            first, last = int(moving[0]), int(moving[-1]) + 1
            return Rests(_told(friction, 0, first), _told(friction, last, friction.size))
    finite = np.isfinite(friction)
    force = kept(friction, finite)
    if force.size < 3 * FEWEST:
        return Rests(None, None)
    noise = noise_of(force)
    band = max(_BAND * noise, 1e-9 * float(max(force.max(), -force.min())))
    head, tail = _flat(force, band), _flat(force[::-1], band)
    before = after = None
    if FEWEST <= head < _SHARE * force.size:
        level = float(np.mean(force[: int(_SHARE * head)]))
        if abs(level) < _LOW * float(np.median(np.abs(thinned(force[head:])))):
            before = Rest(0, int(np.flatnonzero(finite)[head - 1]) + 1, level, told=False)
    if (
        max(5 * FEWEST, _LEAST * force.size) <= tail < _SHARE * force.size
        and head + tail < force.size
        and np.std(force[head : force.size - tail]) > _LIVELY * noise
    ):
        lively = force[head : force.size - tail]
        if _swings(lively) < _SWINGS or np.ptp(lively[-lively.size // 4 :]) < 0.5 * np.ptp(lively):  # or they decay
            return Rests(before, None)
        level = float(np.mean(force[force.size - int(_SHARE * tail) :]))
        after = Rest(int(np.flatnonzero(finite)[force.size - tail]), friction.size, level, told=False)
    return Rests(before, after)


def _told(friction: FloatArray, start: int, stop: int) -> Rest | None:
    values = friction[start:stop]
    values = values[np.isfinite(values)]
    return Rest(start, stop, float(np.mean(values)), told=True) if values.size >= FEWEST else None


def noise_of(force: FloatArray) -> float:
    """Return the standard deviation of the noise [N], from the steps between samples; at least their quantisation."""
    steps = np.abs(thinned_steps(force))
    robust = 1.4826 * float(np.median(steps)) / np.sqrt(2.0)
    if _smallest(steps) > np.sqrt(12.0) * robust:  # the smallest of all may be smaller still
        robust = max(robust, _smallest(np.abs(np.diff(force))) / np.sqrt(12.0))
    return robust if robust < np.inf else 0.0


def _smallest(steps: FloatArray) -> float:
    """Return the smallest of the steps that are any, infinity without one."""
    return float(np.min(steps, where=steps > 0, initial=np.inf))


def _swings(force: FloatArray) -> int:
    """Return how often the force goes up and down by at least half of its range."""
    low, high = (float(q) for q in np.quantile(force, [0.05, 0.95]))
    side = np.where(force > low + 0.75 * (high - low), 1, np.where(force < low + 0.25 * (high - low), -1, 0))
    side = side[side != 0]
    return int(np.count_nonzero(np.diff(side))) // 2


def _flat(force: FloatArray, band: float) -> int:
    """Return how many rows from the start stay level within a band [N]; 0 where they rise instead."""
    level = float(np.median(force[: FEWEST // 2]))
    width = FEWEST // 4
    rows = force.size
    for first in range(0, force.size - width + 1, _PORTION):  # it leaves its level soon, as a rule
        smooth = np.convolve(force[first : first + _PORTION + width - 1], np.ones(width) / width, mode="valid")
        out = np.flatnonzero(np.abs(smooth - level) > band)
        if out.size:
            rows = first + int(out[0]) + width // 2
            break
    if rows < FEWEST:
        return 0
    inside = force[: int(_SHARE * rows)]
    slope = np.polyfit(np.arange(inside.size), inside, 1)[0]
    return rows if abs(slope) * inside.size < 0.5 * band else 0
