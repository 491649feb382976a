"""The part of the quality gate that knows slips: spikes, samples per slip, sensor lag, slope of the sticks, drift."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from data_io.arrays import kept, thinned
from data_io.thresholds import Thresholds, percent
from data_io.values import Finding
from identify.logs.segment import ENDS_LOADING, REMEDY, SLIDING, Segmentation, still_loading

# How sharp the slips of a log are: the lag that a sensor has put on them, and how near the swing is to a sine.

Array = NDArray[np.float64]

FEWEST_SLIPS = 4
FEWEST_SAMPLES = 5.0  # per slip: with fewer, its shape is not seen
BEFORE, AFTER = 1.0, 2.0  # of a slip, that are looked at about its middle
OF_STICK = 0.6  # of a stick, that may follow the slip
SLOWEST = 1.0  # interval of samples [s]: of stick-slip, a slower one may be that of a wrong unit
PER_SAMPLE = 2  # points of the mean slip
MOST_CYCLES = 60  # that are compared with a sine
MOST_SAMPLES = 1000  # of each of them
START = 0.15  # of a slip: the lag from which the search starts
MOVED = 1e-6  # of the scales of the search, for its slopes
SETTLED = 1e-4  # relative: a lag is told to two digits
MOST_POINTS = 160  # of the mean slip


@dataclass(frozen=True)
class Sharpness:
    """lag: time constant of a first-order lag [s]; duration: of the slip in front of it [s]; slips averaged."""

    lag: float
    duration: float
    slips: int

    @property
    def share(self) -> float:
        """The lag as share of the slip."""
        return self.lag / self.duration


def sharpness(time: Array, force: Array, found: Segmentation) -> Sharpness | None:
    """The lag of the sensor, as far as the mean slip tells it; None with too few slips or samples.

    A mass on a spring slips along half a cosine, alike at its beginning and at its end; a sensor that lags draws its
    end out into an exponential tail. Half a cosine behind a first-order lag is fitted to the mean slip. Damping and
    friction that weakens with speed draw the end out too, by about 5 % of a slip: less than that says nothing.

    Args:
        time, force: (n,) [s], [N], sliding positive; force may hold NaN.
        found: its phases.
    """
    slip = found.cycles.arrest - found.cycles.onset
    if found.count < FEWEST_SLIPS or found.samples_per_slip < FEWEST_SAMPLES:
        return None
    seen = _mean_slip(time, force, found, float(np.median(slip)))
    return None if seen is None else _fitted(*seen, float(np.median(slip)), found.sample_interval)


def harmonic_share(time: Array, force: Array, found: Segmentation) -> float | None:
    """Which part of the swing is its first harmonic, 0.61 for a saw-tooth, 1 for a sine; None with too few slips.

    The median over cycles, the noise taken off; arguments as `sharpness`.
    """
    fall = found.cycles.fall
    shares = []
    for i in range(0, fall.size - 1, max(fall.size // MOST_CYCLES, 1)):
        first, last = np.searchsorted(time, [fall[i], fall[i + 1]]).tolist()
        rows = slice(first, last, max((last - first) // MOST_SAMPLES, 1))
        good = np.isfinite(force[rows]) & ~found.spikes[rows]
        t, swing = time[rows][good], force[rows][good]
        if swing.size < 2 * FEWEST_SAMPLES:
            continue
        phase = 2 * math.pi * (t - fall[i]) / (fall[i + 1] - fall[i])
        sine = np.column_stack([np.ones_like(phase), np.cos(phase), np.sin(phase)])
        left = swing - sine @ np.linalg.lstsq(sine, swing, rcond=None)[0]
        noise = swing.size * found.noise**2
        whole = float(np.sum((swing - np.mean(swing)) ** 2)) - noise
        shares.append(1.0 - max(float(np.sum(left**2)) - noise, 0.0) / whole if whole > 0 else 0.0)
    return float(np.median(shares)) if len(shares) >= FEWEST_SLIPS - 1 else None


BAND = 6.0  # of the noise: samples of a cycle so near below its highest one are its top
TOP_ROWS = 10  # of a top, at least
SLOWER = 4.0  # times: how long a level top lasts at least against a stick that rises through the band, and its tilt
BENT = 1.0  # of the noise, by which the middle of a level top may stand above both its ends; a rounded one has 2.7
ALIKE = 3.0  # standard errors by which the levels of tops may scatter
MOST_OF = 0.8  # of the cycles: those with a level top


@dataclass(frozen=True)
class LevelTops:
    """level [N] at which the force stands before it falls, for how long [s] (median), in how many cycles."""

    level: float
    duration: float
    cycles: int


def level_tops(time: Array, force: Array, found: Segmentation) -> LevelTops | None:
    """Where nearly every stick ends on one and the same level, as behind a sensor at its end with noise on top; None
    where they do not. Strength differs from stick to stick on real surfaces, and a swing or a slow slip is round.

    Arguments as `sharpness`.
    """
    fall, noise, slope = found.cycles.fall, found.noise, found.stick_slope
    if found.count < FEWEST_SLIPS or slope is None or not (slope[0] > 0.0 and noise > 0.0):
        return None
    durations, levels, errors = [], [], []
    looked = range(0, fall.size - 1, max(fall.size // MOST_CYCLES, 1))
    for i in looked:
        rows = slice(*np.searchsorted(time, fall[i : i + 2]).tolist())
        good = np.isfinite(force[rows]) & ~found.spikes[rows]
        t, top = time[rows][good], force[rows][good]
        near = np.flatnonzero(top > np.max(top, initial=-np.inf) - BAND * noise)
        if near.size < TOP_ROWS:
            continue
        t, top, third = t[near[0] : near[-1] + 1], top[near[0] : near[-1] + 1], near.size // 3
        middle = float(np.mean(top[third:-third]))
        bent = middle - float(np.mean(np.concatenate([top[:third], top[-third:]])))
        lasts, tilt = float(t[-1] - t[0]), float(np.polyfit(t - t[0], top, 1)[0])
        if lasts * slope[0] > SLOWER * BAND * noise and bent < BENT * noise and abs(tilt) * SLOWER < slope[0]:
            durations.append(lasts)
            levels.append(middle)
            errors.append(noise / math.sqrt(third))
    if len(levels) < max(MOST_OF * len(looked), FEWEST_SLIPS - 1) or np.std(levels) > ALIKE * np.mean(errors):
        return None
    return LevelTops(float(np.mean(levels)), float(np.median(durations)), len(levels))


def _mean_slip(time: Array, force: Array, found: Segmentation, slip: float) -> tuple[Array, Array, int] | None:
    """Time about the middle of the fall, mean force there without the stick slope, and how many slips."""
    cycles = found.cycles
    step = max(found.sample_interval / PER_SAMPLE, (BEFORE + AFTER) * slip / MOST_POINTS)
    stick = float(np.median(cycles.onset[1:] - cycles.arrest[:-1]))
    grid = np.arange(-BEFORE * slip, min(AFTER * slip, 0.5 * slip + OF_STICK * stick), step)
    good = np.isfinite(force) & ~found.spikes
    sound, there = kept(time, good), kept(force, good)
    falls = [t for t in cycles.fall[1:] if t + grid[0] >= time[0] and t + grid[-1] <= time[-1]]
    if len(falls) < FEWEST_SLIPS - 1:
        return None
    slope = found.stick_slope[0] if found.stick_slope else 0.0
    about = np.searchsorted(sound, np.add.outer(falls, [grid[0], grid[-1]])).tolist()
    near = [slice(max(first - 1, 0), last + 1) for first, last in about]  # np.interp reads all that it is given
    mean = np.mean([np.interp(t + grid, sound[i], there[i]) for t, i in zip(falls, near, strict=True)], axis=0)
    return grid, mean - slope * grid, len(falls)


def _fitted(grid: Array, force: Array, slips: int, slip: float, interval: float) -> Sharpness:
    line = np.linalg.qr(np.column_stack([np.ones_like(grid), grid]))[0]
    off_line = _off(force / float(np.ptp(force)), line)  # the search stops by absolute numbers

    def residuals(p: Array) -> Array:
        """Of several sets of parameters (k, 3), shape (k, n)."""
        step = _off(_lagged_fall(grid, p[:, :1], np.exp(p[:, 1:2]), np.exp(p[:, 2:])), line)
        size = np.sum(step**2, axis=1, keepdims=True)
        share = np.divide(step @ off_line[:, None], size, out=np.zeros_like(size), where=size > 0.0)
        return np.asarray(off_line - share * step)

    def slopes(p: Array) -> Array:
        moved = residuals(p + np.vstack([np.zeros(3), np.diag(moves)]))
        return np.asarray((moved[1:] - moved[0]).T / moves)

    lower = [2 * grid[0], math.log(0.5 * interval), math.log(1e-3 * slip)]
    upper = [grid[-1], math.log(4 * slip), math.log(3 * slip)]
    start = [-0.5 * slip, math.log(slip * (1 - START)), math.log(START * slip)]
    scale = np.array([0.1 * slip, 0.1, 0.3])
    moves = MOVED * scale
    best = least_squares(
        lambda p: residuals(p[None])[0],
        start,
        jac=slopes,
        bounds=(lower, upper),
        x_scale=scale,
        ftol=SETTLED,
        xtol=SETTLED,
    )
    return Sharpness(math.exp(best.x[2]), math.exp(best.x[1]), slips)


def _off(curve: Array, line: Array) -> Array:
    """Curves (..., n) without what of them lies along some orthonormal columns (n, k)."""
    return np.asarray(curve - (curve @ line) @ line.T)


def _lagged_fall(time: Array, begin: Array, duration: Array, lag: Array) -> Array:
    """Half a cosine from 0 to 1 behind a first-order lag: the solution of lag y' + y = x from rest, shape (k, n); the
    arguments but the time (n,) are of shape (k, 1)."""
    omega = math.pi / duration
    share = (omega * lag) ** 2
    inside = np.clip(time - begin, 0.0, duration)
    swing = (np.cos(omega * inside) + omega * lag * np.sin(omega * inside)) / (1 + share)
    rising = 0.5 * (1 - swing - share / (1 + share) * np.exp(-inside / lag))
    end = 0.5 * (1 + 1 / (1 + share) - share / (1 + share) * np.exp(-duration / lag))
    settling = 1 - (1 - end) * np.exp(-np.clip(time - begin - duration, 0.0, None) / lag)
    return np.where(time - begin > duration, settling, rising)


NAMED = 4  # times of spikes that are listed
ENOUGH = 1 << 12  # samples that tell a level
BLOCKS, TREND_SD = 12, 5.0  # blocks of what slides, and standard deviations of their scatter that a trend exceeds
FOR_DRIFT = 6  # cycles from which on a drift can be told
FOR_SCATTER = 4


@dataclass(frozen=True)
class RecordPart:
    """One step of a log, or what the scene leaves of it: time [s], force [N] (n,) with sliding positive, its phases;
    expected_slope: stiffness times drive speed [N/s], None where either is unknown; load [N] (n,): normal force, None
    where it counts as steady."""

    time: Array
    force: Array
    found: Segmentation
    expected_slope: float | None = None
    load: Array | None = None


@dataclass(frozen=True)
class SlipQuality:
    """spikes: samples that are no neighbour's; lag: see `Sharpness`, None where it cannot be told; slope: of the sticks
    over stiffness times drive speed, less 1; drift: of the friction force, as share of it; harmonic: part of the swing
    that is one sine; scatter: of the drop from one slip to the next, as share of it; loading: no slip came, and the
    first stick still loads at the end; findings."""

    spikes: int
    lag: Sharpness | None
    slope: float | None
    drift: float | None
    harmonic: float | None
    scatter: float | None
    loading: bool
    findings: tuple[Finding, ...]


def look_at_slips(part: RecordPart, limits: Thresholds) -> SlipQuality:
    """Measure the slips of one part and say what lies beyond the thresholds."""
    found = part.found
    lag = sharpness(part.time, part.force, found)
    slope = _slope_error(part)
    drift = _drift(part)
    harmonic = harmonic_share(part.time, part.force, found)
    loading = still_loading(part.time, part.force, found, part.expected_slope)
    notes = [_spikes(part, limits), *_samples(found, limits), _few(found, limits)]
    if loading:
        notes.append(Finding("still_loading", "warning", f"no slip was found: {ENDS_LOADING}; {REMEDY}"))
    if (tops := level_tops(part.time, part.force, found)) is not None:
        text = (
            f"in {tops.cycles} cycles the force stands at {tops.level:.4g} N for {tops.duration:.3g} s before it "
            "falls: the sensor or its amplifier was at its end, with noise on top; use a larger measuring range"
        )
        notes.append(Finding("level_tops", "warning", text))
    if lag is not None and (severity := limits.severity("sensor_lag", lag.share)):
        text = (
            f"the slips end in a tail, as behind a sensor or filter with a lag of {1e3 * lag.lag:.2g} ms "
            f"({100 * lag.share:.0f} % of a slip): open the filter, or add the effect sensor_lag"
        )
        notes.append(Finding("sensor_lag", severity, text))
    if slope is not None and part.expected_slope and (severity := limits.severity("stick_slope", abs(slope))):
        text = (
            f"in stick the force rises at {(1 + slope) * part.expected_slope:.4g} N/s, where stiffness times drive "
            f"speed is {part.expected_slope:.4g} N/s ({percent(slope, signed=True)}): check both, and the drive"
        )
        notes.append(Finding("stick_slope", severity, text))
    if drift is not None and (severity := limits.severity("friction_drift", abs(drift))):
        word = "rises" if drift > 0 else "falls"
        text = (
            f"the friction force over the load {word} by {percent(abs(drift))} from the first to the last third: "
            "running-in, wear or a drifting zero? Cut it with skip_cycles or window"
        )
        notes.append(Finding("friction_drift", severity, text))
    scatter = _scatter(found)
    if scatter is not None and (severity := limits.severity("uneven_cycles", scatter)):
        text = (
            f"the slips differ: their drop scatters by {percent(scatter)} from one to the next, while the model "
            "takes all cycles as alike; look for an uneven track. A fit tries a strength of each stick, then describes "
            "the cycles one by one"
        )
        notes.append(Finding("uneven_cycles", severity, text))
    if severity := limits.severity("harmonic", harmonic or 0.0):
        text = (
            "the force swings almost like a sine: it slides nearly all the time, and what depends on rest, mu_s, t_cr "
            "and D, is hardly told; record slower as well"
        )
        notes.append(Finding("near_harmonic", severity, text))
    return SlipQuality(
        int(np.count_nonzero(part.found.spikes & np.isfinite(part.force))),
        lag,
        slope,
        drift,
        harmonic,
        scatter,
        loading,
        tuple(note for note in notes if note is not None),
    )


def _spikes(part: RecordPart, limits: Thresholds) -> Finding | None:
    """Spikes are left out of the fit: a few are no reason to complain."""
    where = np.flatnonzero(part.found.spikes & np.isfinite(part.force))
    if where.size == 0:
        return None
    word = "1 sample jumps" if where.size == 1 else f"{where.size} samples jump"
    times = ", ".join(f"{t:.5g}" for t in part.time[where[:NAMED]]) + (", …" if where.size > NAMED else "")
    text = (
        f"{word} far from the neighbours (spikes, at {times} s); {'it is' if where.size == 1 else 'they are'} left out"
    )
    severity = limits.severity("spikes", where.size / part.time.size)
    advice = "; look for electric disturbance" if severity else ""
    return Finding("spikes", severity or "info", text + advice)


def _faster(wanted: float, held: float) -> str:
    return f"{max(wanted / max(held, 0.1), 1.1):.2g} times as fast"


def _samples(found: Segmentation, limits: Thresholds) -> list[Finding]:
    notes = []
    if found.count and (severity := limits.severity("samples_per_slip", found.samples_per_slip)):
        text = (
            f"a slip holds {found.samples_per_slip:.2g} samples: what depends on fast sliding, a and delta_mu_k, is "
            f"hardly told; sample {_faster(limits['samples_per_slip'], found.samples_per_slip)}"
        )
        if found.sample_interval > SLOWEST:
            text += f", or check the unit of the time: rows are {found.sample_interval:.3g} s apart"
        notes.append(Finding("samples_per_slip", severity, text))
    if found.count > 1 and (severity := limits.severity("samples_per_cycle", found.samples_per_cycle)):
        text = (
            f"a cycle of stick and slip holds {found.samples_per_cycle:.2g} samples; sample "
            f"{_faster(limits['samples_per_cycle'], found.samples_per_cycle)}"
        )
        notes.append(Finding("samples_per_cycle", severity, text))
    return notes


def _few(found: Segmentation, limits: Thresholds) -> Finding | None:
    severity = limits.severity("cycles", found.count) if found.count else None
    if severity is None:
        return None
    word = "one slip was" if found.count == 1 else f"{found.count} slips were"
    remedy = "it slides on: drive more slowly" if found.ends_sliding else "record longer"
    text = f"only {word} found; {limits['cycles']:g} or more are needed to tell cycles apart: {remedy}"
    return Finding("few_cycles", severity, text)


def _slope_error(part: RecordPart) -> float | None:
    slope = part.found.stick_slope
    if slope is None or not part.expected_slope or part.found.count == 0:
        return None
    return slope[0] / part.expected_slope - 1.0


def _scatter(found: Segmentation) -> float | None:
    drop = found.cycles.drop[1:]
    if drop.size < FOR_SCATTER:
        return None
    return float(1.4826 * np.median(np.abs(np.diff(drop))) / np.sqrt(2.0) / np.mean(drop))


def _load_at(part: RecordPart, times: Array) -> Array:
    """The load at some times (m,), over its median; ones where it counts as steady or is no load."""
    steady = np.ones(times.size)
    if part.load is None or not np.isfinite(part.load).any():
        return steady
    known = np.isfinite(part.load)
    load = np.interp(times, part.time[known], part.load[known])
    return load / np.median(load) if np.all(load > 0.0) else steady


def _has_trend(values: Array) -> bool:
    """Whether values (n,) change along a line by clearly more than blocks of them scatter about it."""
    blocks = np.array([float(np.mean(block)) for block in np.array_split(values, BLOCKS)])
    place = np.linspace(-0.5, 0.5, BLOCKS)
    change = float(place @ (blocks - blocks.mean()) / (place @ place))
    return abs(change) > TREND_SD * float(np.std(blocks - blocks.mean() - change * place))


def _drift(part: RecordPart) -> float | None:
    """Middles between peak and valley over the load, of what slides all of it, last third against first; the loading
    from rest does not count."""
    cycles = part.found.cycles
    if cycles.count == 0:
        slides = (part.found.phase == SLIDING) & np.isfinite(part.force) & ~part.found.spikes
        middle = thinned(part.force[slides] / _load_at(part, part.time[slides]), ENOUGH)
    else:
        middle = (cycles.middle / _load_at(part, cycles.fall))[1:]
    if middle.size < (FOR_DRIFT if cycles.count else BLOCKS) or (cycles.count == 0 and not _has_trend(middle)):
        return None
    third = max(middle.size // 3, 1)
    # about zero force the middles say nothing of how large the force is
    drop = float(np.median(cycles.drop)) if cycles.count else 0.0
    level = max(abs(float(np.median(middle))), 0.5 * abs(drop), 5.0 * part.found.noise)
    return float(np.median(middle[-third:]) - np.median(middle[:third])) / level if level else None
