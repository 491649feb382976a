"""Starts for what is explicit in time: vibrations of the drive and motions of a live finger, from the stick phases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.logs.prepare import Prepared
from identify.logs.rhythms import SpectralLine, rhythms
from identify.logs.unknowns import Unknowns

Array = NDArray[np.float64]

LOBE = 0.5  # periods more or less over the longest log: farther from a rhythm that was found is another one


@dataclass(frozen=True)
class _Wave:
    """Where a harmonic of the model stands among the parameters."""

    amplitude: int
    frequency: int
    phase: int


def quieted(unknowns: Unknowns) -> Unknowns:
    """The same search with everything that is explicit in time held as good as absent: settled cycles are alike."""
    start, free, quiet = unknowns.start.copy(), unknowns.free.copy(), dict(unknowns.model.quiet)
    for i, name in enumerate(unknowns.names):
        if name in quiet:
            start[i], free[i] = start[i] if np.isnan(quiet[name]) else quiet[name], False
    for wave in _waves(unknowns):
        free[[wave.frequency, wave.phase]] = False
    return replace(unknowns, start=start, free=free)


def rhythmic(unknowns: Unknowns) -> NDArray[np.bool_]:
    """Which parameters belong to harmonics (n_p,)."""
    out = np.zeros(len(unknowns.names), bool)
    for wave in _waves(unknowns):
        out[[wave.amplitude, wave.frequency, wave.phase]] = True
    return out


def tuned(prepared: Sequence[Prepared], unknowns: Unknowns) -> tuple[list[Prepared], Unknowns]:
    """Start values for what is explicit in time: rhythms found in the sticks, else as good as absent.

    A harmonic of the model that no rhythm calls for, and of which the scene says nothing, is held at rest.
    """
    logs = list(prepared)
    start, free = unknowns.start.copy(), unknowns.free.copy()
    lower, upper = unknowns.lower.copy(), unknowns.upper.copy()
    names, waves, quiet = unknowns.names, _waves(unknowns), dict(unknowns.model.quiet)
    for i, name in enumerate(names):
        if not np.isnan(quiet.get(name, np.nan)) and not unknowns.told[i] and free[i]:
            start[i] = quiet[name]
    searched = [w for w in waves if free[w.amplitude] and not unknowns.told[w.amplitude]]
    if searched:
        found, left = rhythms(logs, most=len(searched))
        lines, longest = list(found), max(float(np.ptp(log.data.time)) for log in logs)
        own = np.full((len(logs), len(names)), np.nan)
        lobe = LOBE / longest
        for wave in sorted(searched, key=lambda w: np.ptp(_band(w, unknowns, lobe))):
            low, high = _band(wave, unknowns, lobe)
            line = next((r for r in lines if low < np.log(r.frequency) < high), None)
            if line is None:
                free[[wave.amplitude, wave.frequency, wave.phase]] = False
                continue
            lines.remove(line)
            _set(line, wave, logs, unknowns, start, own)
            if free[wave.frequency]:
                lower[wave.frequency] = max(low, np.log(line.frequency - lobe))
                upper[wave.frequency] = min(high, np.log(line.frequency + lobe))
        if len(lines) < len(found):
            logs = [_corrected(log, row, share) for log, row, share in zip(logs, own, left, strict=True)]
    return logs, replace(unknowns, start=start, free=free, lower=lower, upper=upper)


def _waves(unknowns: Unknowns) -> list[_Wave]:
    names = unknowns.names
    stems = [name.removesuffix("_amplitude") for name in names if name.endswith("_amplitude")]
    return [
        _Wave(*(names.index(f"{stem}_{what}") for what in ("amplitude", "frequency", "phase")))
        for stem in stems
        if f"{stem}_frequency" in names and f"{stem}_phase" in names
    ]


def _band(wave: _Wave, unknowns: Unknowns, lobe: float) -> tuple[float, float]:
    """Between which logarithms of a frequency a rhythm may be this harmonic; lobe [Hz]: how near it must come to one
    that the scene fixes."""
    i = wave.frequency
    if unknowns.free[i]:
        return float(unknowns.lower[i]), float(unknowns.upper[i])
    known = float(np.exp(unknowns.start[i]))
    return float(np.log(max(known - lobe, 0.5 * known))), float(np.log(known + lobe))


def _set(line: SpectralLine, wave: _Wave, logs: list[Prepared], unknowns: Unknowns, start: Array, own: Array) -> None:
    """Write a rhythm into the start, but for what the scene fixes: spring and damper carry the motion."""
    omega = 2 * np.pi * line.frequency
    amplitudes, phases = [], []
    for log, amplitude, phase in zip(logs, line.amplitude, line.phase, strict=True):
        k, m, h = log.rig.stiffness, log.rig.mass, log.rig.damping
        response = k + 1j * omega * h * np.sqrt(m / k)
        amplitudes.append(amplitude / abs(response))
        phases.append(float(phase - np.angle(response)))
    shown = np.isfinite(amplitudes)
    start[wave.amplitude] = float(np.mean(np.array(amplitudes)[shown]))
    if unknowns.free[wave.frequency]:
        start[wave.frequency] = np.log(line.frequency)
    if unknowns.free[wave.phase]:
        start[wave.phase] = phases[int(np.argmax(shown))]
        own[:, wave.phase] = np.where(shown, phases, 0.0)


def _corrected(log: Prepared, own: Array, left: float) -> Prepared:
    """The log with its own phases; an estimated noise that counted the rhythms in is rid of them."""
    weight = log.data.weight / min(left, 1.0) if log.noise_estimated else log.data.weight
    mine = own if np.any(np.isfinite(own)) else log.data.own
    return replace(log, data=replace(log.data, own=mine, weight=weight))
