"""The part of the quality gate that knows slips: spikes, samples per slip, sensor lag, slope of the sticks, drift."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_io.thresholds import Thresholds, percent
from data_io.values import Finding
from identify.logs.segment import Segmentation
from identify.logs.sharpness import Sharpness, harmonic_share, sharpness
from identify.logs.still_loading import ENDS_LOADING, REMEDY, still_loading

Array = NDArray[np.float64]

NAMED = 4  # times of spikes that are listed
FOR_DRIFT = 6  # cycles from which on a drift can be told
FOR_SCATTER = 4


@dataclass(frozen=True)
class Part:
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


def look_at_slips(part: Part, limits: Thresholds) -> SlipQuality:
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
            f"the friction force over the load {word} by {percent(abs(drift))} from the first to the last third of "
            "the slips: running-in, wear or a drifting zero? Cut it with skip_cycles or window"
        )
        notes.append(Finding("friction_drift", severity, text))
    scatter = _scatter(found)
    if scatter is not None and (severity := limits.severity("uneven_cycles", scatter)):
        text = (
            f"the slips differ: their drop scatters by {percent(scatter)} from one to the next, while the model "
            "takes all cycles as alike; look for an uneven track, and judge by the classical table"
        )
        notes.append(Finding("uneven_cycles", severity, text))
    if severity := limits.severity("harmonic", harmonic or 0.0):
        text = (
            "the force swings almost like a sine: it slides nearly all the time, and what depends on rest, mu_s, t_cr "
            "and D, is hardly told; record slower as well"
        )
        notes.append(Finding("near_harmonic", severity, text))
    return SlipQuality(
        _spike_count(part),
        lag,
        slope,
        drift,
        harmonic,
        scatter,
        loading,
        tuple(note for note in notes if note is not None),
    )


def _spike_count(part: Part) -> int:
    return int(np.count_nonzero(part.found.spikes & np.isfinite(part.force)))


def _spikes(part: Part, limits: Thresholds) -> Finding | None:
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


def _samples(found: Segmentation, limits: Thresholds) -> list[Finding]:
    notes = []
    if found.count and (severity := limits.severity("samples_per_slip", found.samples_per_slip)):
        text = (
            f"a slip holds {found.samples_per_slip:.2g} samples: what depends on fast sliding, a and delta_mu_k, is "
            f"hardly told; sample {limits['samples_per_slip'] / max(found.samples_per_slip, 0.1):.2g} times as fast"
        )
        notes.append(Finding("samples_per_slip", severity, text))
    if found.count > 1 and (severity := limits.severity("samples_per_cycle", found.samples_per_cycle)):
        text = (
            f"a cycle of stick and slip holds {found.samples_per_cycle:.2g} samples; sample "
            f"{limits['samples_per_cycle'] / max(found.samples_per_cycle, 0.1):.2g} times as fast"
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


def _slope_error(part: Part) -> float | None:
    slope = part.found.stick_slope
    if slope is None or not part.expected_slope or part.found.count == 0:
        return None
    return slope[0] / part.expected_slope - 1.0


def _scatter(found: Segmentation) -> float | None:
    drop = found.cycles.drop[1:]
    if drop.size < FOR_SCATTER:
        return None
    return float(1.4826 * np.median(np.abs(np.diff(drop))) / np.sqrt(2.0) / np.mean(drop))


def _load_at(part: Part, times: Array) -> Array:
    """The load at some times (m,), over its median; ones where it counts as steady or is no load."""
    steady = np.ones(times.size)
    if part.load is None or not np.isfinite(part.load).any():
        return steady
    known = np.isfinite(part.load)
    load = np.interp(times, part.time[known], part.load[known])
    return load / np.median(load) if np.all(load > 0.0) else steady


def _drift(part: Part) -> float | None:
    """Middles between peak and valley over the load, last third against first; the loading from rest does not count."""
    cycles = part.found.cycles
    if cycles.count < FOR_DRIFT:
        return None
    middle = (cycles.middle / _load_at(part, cycles.fall))[1:]
    third = max(middle.size // 3, 1)
    # about zero force the middles say nothing of how large the force is
    level = max(abs(float(np.median(middle))), 0.5 * abs(float(np.median(cycles.drop))))
    return float(np.median(middle[-third:]) - np.median(middle[:third])) / level if level else None
