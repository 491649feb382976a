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
    """Return how many rows stand at an end of the sensor, and a finding for each end.

    A sensor at its end shows it in many rows in a row, and far more often than the values before it.
    """
    notes, total = [], 0
    for end, level in (("highest", float(force.max())), ("lowest", float(force.min()))):
        at_end = force == level
        off = np.abs(force[~at_end] - level)
        near = off[off < 0.1 * np.ptp(force)]
        counts = np.unique(near if np.unique(near).size > 1 else off, return_counts=True)[1]
        rows = int(np.count_nonzero(at_end))
        if longest_run(at_end) < _CLIPPED_RUN or counts.size < 2 or rows <= _CLIPPED_EXCESS * float(counts[:5].mean()):
            continue
        total += rows
        if severity := limits.severity("clipped_rows", rows / force.size):
            text = (
                f"the {name} stays at its {end} value {level:.4g} N in {rows} rows: the sensor was at its end; use a "
                "larger measuring range"
            )
            notes.append(Finding(f"{name.split()[0]}_clipped", severity, text))
    return total, notes


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
    unloaded = np.count_nonzero(normal < UNLOADED * level) / normal.size
    load = Load(level, *mean_and_drift(normal), _ripple(thinned(time), thinned(normal), level), unloaded)
    notes, size = [], f"{level:.3g} N"
    if np.ptp(normal) > 0:  # rows without a load lie at the lowest value of a sound sensor
        notes += clipping("normal force", normal[normal >= UNLOADED * level], limits)[1]
    elif not str(record.metadata.get("normal_force_source", "")).startswith("constant"):
        text = f"the normal force is exactly {level:g} N in every row; it was set, not measured"
        notes.append(Finding("normal_force_not_measured", "info", text))
    if severity := limits.severity("unloaded_rows", unloaded):
        share = f"{100 * unloaded:.1f} % of the rows press with less than {100 * UNLOADED:.0f} % of the load ({size})"
        text = f"{share}; leave them out with window or choose the loaded step"
        notes.append(Finding("unloaded_rows", severity, text))
    if severity := limits.severity("load_drift", abs(load.drift)):
        change = f"{'rises' if load.drift > 0 else 'falls'} by {percent(abs(load.drift), of=size)}"
        text = f"the normal force {change} from the first to the last tenth; a fit follows it with the effect "
        notes.append(Finding("load_drift", severity, f"{text}varying_normal_force, and else takes the mean"))
    if severity := limits.severity("load_ripple", load.ripple):
        text = (
            f"the normal force ripples by {percent(load.ripple, of=size)} (standard deviation); check the load control"
        )
        notes.append(Finding("load_ripple", severity, f"{text} and the flatness of the track"))
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
    t, force = time[loaded] - time[loaded][0], normal[loaded]
    return float(np.std(force - np.polyval(np.polyfit(t, force, 1), t))) / level


# Where a log shows the drive at rest: before it starts and after it has stopped, and what the sensor shows there.

FEWEST: Final = 20
"""Rows of a rest that is worth a word."""
_SLOW: Final = 0.05
"""Share of the usual speed of the drive below which it rests."""
_BAND: Final = 4.0
"""Standard deviations of the noise that a force at rest may span to either side."""
_LOW: Final = 0.5
"""Share of the sliding force below which a flat beginning is rest and not sliding."""
_SHARE: Final = 0.9
"""Part of a flat stretch that is measured: its end already moves by what the band allows."""


@dataclass(frozen=True)
class Rest:
    """A stretch at rest: rows [start, stop) and mean friction force there [N]."""

    start: int
    stop: int
    force: float


@dataclass(frozen=True)
class Rests:
    """Rest before the drive starts and after it has stopped; None where there is none."""

    before: Rest | None
    after: Rest | None


def find_rests(record: Record, friction: FloatArray, speed: FloatArray | None = None) -> Rests:
    """Find the rests at both ends of a record.

    friction (n,) [N]: the friction force, NaN where it does not count. speed (n,) [m/s]: of a column that is known to
    be the drive; without one, a force that stays within its noise below half of the sliding force is rest before the
    start, and nothing tells of a stop.
    """
    if speed is None and isinstance(record.drive_speed, np.ndarray):
        speed = np.abs(record.drive_speed)
    if speed is not None:
        moving = np.flatnonzero(speed > _SLOW * np.quantile(speed, 0.9))
        if moving.size and speed.max() > 0:
            ends = (0, int(moving[0])), (int(moving[-1]) + 1, friction.size)
            counted = [friction[a:b][np.isfinite(friction[a:b])] for a, b in ends]
            return Rests(
                *(
                    Rest(*end, float(values.mean())) if values.size >= FEWEST else None
                    for end, values in zip(ends, counted, strict=True)
                )
            )
    finite = np.isfinite(friction)
    force = kept(friction, finite)
    if force.size < 3 * FEWEST:
        return Rests(None, None)
    rows = _flat(force, max(_BAND * noise_of(force), 1e-9 * float(np.abs(force).max())))
    if not FEWEST <= rows < _SHARE * force.size:
        return Rests(None, None)
    level = float(np.mean(force[: int(_SHARE * rows)]))
    if abs(level) >= _LOW * float(np.median(np.abs(thinned(force[rows:])))):
        return Rests(None, None)
    return Rests(Rest(0, int(np.flatnonzero(finite)[rows - 1]) + 1, level), None)


def noise_of(force: FloatArray) -> float:
    """Return the standard deviation of the noise [N], from the steps between samples; at least their quantisation."""
    steps = np.abs(thinned_steps(force))
    robust = 1.4826 * float(np.median(steps)) / np.sqrt(2.0)
    smallest = float(np.min(steps, where=steps > 0, initial=np.inf))
    if smallest > np.sqrt(12.0) * robust:  # the smallest of all may be smaller still
        steps = np.abs(np.diff(force))
        robust = max(robust, float(np.min(steps, where=steps > 0, initial=np.inf)) / np.sqrt(12.0))
    return robust if robust < np.inf else 0.0


def _flat(force: FloatArray, band: float) -> int:
    """Return how many rows from the start stay level within a band [N]; 0 where they rise instead."""
    level, width = float(np.median(force[: FEWEST // 2])), FEWEST // 4
    smooth = np.convolve(force, np.ones(width) / width, mode="valid")
    out = np.flatnonzero(np.abs(smooth - level) > band)
    rows = int(out[0]) + width // 2 if out.size else force.size
    if rows < FEWEST:
        return 0
    inside = force[: int(_SHARE * rows)]
    slope = np.polyfit(np.arange(inside.size), inside, 1)[0]
    return rows if abs(slope) * inside.size < 0.5 * band else 0
