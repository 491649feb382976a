"""Starts for what is explicit in time: harmonics that a vibrating drive or a live finger leaves in the sticks.

While the mass rests the force is a straight line plus what the drive's own motion adds. Lines are found in the
spectrum of what is left of the loading lines and refined by least squares, one amplitude and phase per log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns

Array = NDArray[np.float64]

TRIM = 0.12  # of a stick at either end, and half a period of the rig at least, left out: the transients of slips
FEWEST = 12  # samples of a stick that counts
PEAKS = 6  # of the spectra that are looked at closely
SURE = 25.0  # fall of the sum of squares (in noise variances) beyond the search over frequencies
LOBE = 0.5  # periods more or less over the longest log: farther from a line that was found is another one


@dataclass(frozen=True)
class SpectralLine:
    """One harmonic of the force in stick: frequency [Hz]; per log amplitude [N] and phase [rad] at time 0 of
    amplitude * sin(2 pi f t + phase)."""

    frequency: float
    amplitude: Array
    phase: Array


@dataclass(frozen=True)
class _Sticks:
    """The samples of one log's sticks: t, r (n,) residual of the loading lines, w (n,) weights, stick (n,)."""

    t: Array
    r: Array
    w: Array
    stick: NDArray[np.int64]
    interval: float

    @property
    def span(self) -> float:
        return float(np.ptp(self.t))

    def flat(self, y: Array) -> Array:
        """y without a level per stick and without a slope common to all."""
        weights = np.bincount(self.stick, weights=self.w)
        y, t = (v - (np.bincount(self.stick, weights=self.w * v) / weights)[self.stick] for v in (y, self.t))
        return np.asarray(y - t * np.sum(self.w * y * t) / np.sum(self.w * t * t))

    def harmonic(self, frequency: float) -> tuple[float, Array, Array]:
        """Fall of the sum of squares by a harmonic [Hz], its sine and cosine amplitudes, and its samples (n,)."""
        phase = 2 * np.pi * frequency * self.t
        basis = np.stack([self.flat(np.sin(phase)), self.flat(np.cos(phase))])
        right = (basis * self.w) @ self.r
        c = np.asarray(np.linalg.lstsq((basis * self.w) @ basis.T, right, rcond=1e-9)[0], float)
        return float(right @ c), c, c @ basis

    def spectrum(self, frequency: Array) -> Array:
        """About the fall of the sum of squares by a harmonic of each of these frequencies [Hz]."""
        grid = np.bincount(np.round((self.t - self.t[0]) / self.interval).astype(int), weights=self.w * self.r)
        size = 1 << int(np.ceil(np.log2(8 * grid.size)))  # padded, so that no line between its frequencies is missed
        power = np.abs(np.fft.rfft(grid, size)) ** 2 / (0.5 * np.sum(self.w))
        own = np.interp(frequency, np.fft.rfftfreq(size, self.interval), power, right=0.0)
        return np.where(frequency < 1.0 / self.span, 0.0, own)


def _sticks(log: Prepared) -> _Sticks | None:
    """The stick samples of one log, None where there is too little."""
    c, data, rows = log.segmentation.cycles, log.data, []
    if c.count == 0:
        return None
    # What comes after the last slip may slide.
    for start, end in zip(np.append(data.begin, c.arrest[:-1]), c.onset, strict=True):
        margin = max(TRIM * (end - start), log.rig.half_period)
        first, last = np.searchsorted(data.time, [max(start + margin, data.begin), min(end - margin, data.end)])
        good = np.flatnonzero(data.weight[first:last] > 0) + first
        if good.size >= FEWEST and end - start >= 4 * margin:
            rows.append(good)
    if not rows:
        return None
    which, every = np.repeat(np.arange(len(rows)), [own.size for own in rows]), np.concatenate(rows)
    time, interval = data.time[every], float(np.median(np.diff(data.time)))
    sticks = _Sticks(time, time, data.weight[every], which, interval)
    return replace(sticks, r=sticks.flat(data.force[every]))


def rhythms(logs: Sequence[Prepared], most: int = 3) -> tuple[tuple[SpectralLine, ...], Array]:
    """The harmonics that stand out of the stick phases of these logs, strongest first.

    Returns:
        the harmonics; and per log what they leave of the loading lines, in variances of the noise (1 without sticks).
    """
    sticks = [_sticks(log) for log in logs]
    lines: list[SpectralLine] = []
    while len(lines) < most and (known := [s for s in sticks if s is not None]):

        def explained(f: float, known: Sequence[_Sticks] = known) -> float:
            return sum(s.harmonic(f)[0] for s in known)

        longest, shortest = max(s.span for s in known), min(s.interval for s in known)
        frequency = np.arange(1.0 / longest, 0.4 / shortest, 0.25 / longest)
        power = np.sum([s.spectrum(frequency) for s in known], axis=0)
        refined = []
        for _ in range(PEAKS):
            peak = float(frequency[int(np.argmax(power))])
            power[np.abs(frequency - peak) < 1.0 / longest] = 0.0
            bounds, far = (max(peak - 0.6 / longest, 0.1 * peak), peak + 0.6 / longest), 6e-4 / longest
            refined.append(
                scipy.optimize.minimize_scalar(lambda f: -explained(f), bounds=bounds, options={"xatol": far}).x
            )
        best = float(max(refined, key=explained))
        if explained(best) < SURE + 2 * np.log(max(s.span / s.interval for s in known)):
            break
        fits = [None if s is None else s.harmonic(best) for s in sticks]
        sine, cosine = np.transpose([[np.nan, 0.0] if fit is None else fit[1] for fit in fits])
        phase = np.nan_to_num(np.arctan2(cosine, sine))
        lines.append(SpectralLine(best, np.hypot(sine, cosine), phase))
        sticks = [s and fit and replace(s, r=s.r - fit[2]) for s, fit in zip(sticks, fits, strict=True)]
    return tuple(lines), np.array([1.0 if s is None else np.mean(s.w * s.r**2) for s in sticks])


# The harmonics of the model.


class _Wave(NamedTuple):
    """Where a harmonic of the model stands among the parameters."""

    amplitude: int
    frequency: int
    phase: int


def _waves(unknowns: Unknowns) -> list[_Wave]:
    names = unknowns.names
    triples = [[f"{name.removesuffix('amplitude')}{what}" for what in _Wave._fields] for name in names]
    return [_Wave(*map(names.index, triple)) for triple in triples if triple[0] in names and set(triple) <= set(names)]


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
    return np.isin(np.arange(len(unknowns.names)), [i for wave in _waves(unknowns) for i in wave])


def tuned(prepared: Sequence[Prepared], unknowns: Unknowns) -> tuple[list[Prepared], Unknowns]:
    """Start values for what is explicit in time: rhythms found in the sticks, else as good as absent.

    A harmonic of the model that no rhythm calls for, and of which the scene says nothing, is held at rest.
    """
    logs = list(prepared)
    start, free = unknowns.start.copy(), unknowns.free.copy()
    lower, upper = unknowns.lower.copy(), unknowns.upper.copy()
    for i, name in enumerate(unknowns.names):
        quiet = dict(unknowns.model.quiet).get(name, np.nan)
        if not np.isnan(quiet) and not unknowns.stated[i] and free[i]:
            start[i] = quiet
    searched = [w for w in _waves(unknowns) if free[w.amplitude] and not unknowns.stated[w.amplitude]]
    if searched:
        waves, left = rhythms(logs, most=len(searched))
        lines, lobe = list(waves), LOBE / max(float(np.ptp(log.data.time)) for log in logs)
        own, rigs = np.full((len(logs), len(unknowns.names)), np.nan), [log.rig for log in logs]

        def band(wave: _Wave) -> tuple[float, float]:
            """Between which logarithms of a frequency a rhythm may be a harmonic; near one that the scene fixes."""
            if unknowns.free[wave.frequency]:
                return float(unknowns.lower[wave.frequency]), float(unknowns.upper[wave.frequency])
            fixed = float(np.exp(unknowns.start[wave.frequency]))
            return float(np.log(max(fixed - lobe, 0.5 * fixed))), float(np.log(fixed + lobe))

        for wave in sorted(searched, key=lambda w: float(np.ptp(band(w)))):
            at, (low, high) = wave.frequency, band(wave)
            line = next((r for r in lines if low < np.log(r.frequency) < high), None)
            if line is None:
                free[list(wave)] = False
                continue
            lines.remove(line)
            # Spring and damper carry the motion of the drive.
            omega = 2 * np.pi * line.frequency
            carried = [r.stiffness + 1j * omega * r.damping * np.sqrt(r.mass / r.stiffness) for r in rigs]
            amplitudes, phases = line.amplitude / np.abs(carried), line.phase - np.angle(carried)
            seen = np.isfinite(amplitudes)
            start[wave.amplitude] = float(np.mean(amplitudes[seen]))
            if unknowns.free[wave.phase]:
                start[wave.phase] = phases[int(np.argmax(seen))]
                own[:, wave.phase] = np.where(seen, phases, 0.0)
            if free[at]:
                start[at] = np.log(line.frequency)
                lower[at] = max(low, np.log(line.frequency - lobe))
                upper[at] = min(high, np.log(line.frequency + lobe))
        if len(lines) < len(waves):
            for i, (log, phases) in enumerate(zip(logs, own, strict=True)):
                # An estimated noise that counted the rhythms in is rid of them.
                weight = log.data.weight / min(float(left[i]), 1.0) if log.noise_estimated else log.data.weight
                phases = phases if np.any(np.isfinite(phases)) else log.data.own
                logs[i] = replace(log, data=replace(log.data, own=phases, weight=weight))
    return logs, replace(unknowns, start=start, free=free, lower=lower, upper=upper)
