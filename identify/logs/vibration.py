"""Starts for what is explicit in time: harmonics that a vibrating drive or a live finger leaves in the sticks.

While the mass rests the force is a straight line plus what the drive's own motion adds. Lines are found in the
spectrum of what is left of the loading lines and refined by least squares, one amplitude and phase per log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns

Array = NDArray[np.float64]

TRIM, CLEAR = 0.12, 1.0  # of a stick, and half periods of the rig, at either end, left out: the transients of slips
FEWEST = 12  # samples of a stick that counts
PEAKS = 6  # of the spectra that are looked at closely
SURE = 25.0  # fall of the sum of squares (in noise variances) beyond the search over frequencies
LOBE = 0.5  # periods more or less over the longest log: farther from a line that was found is another one


@dataclass(frozen=True)
class SpectralLine:
    """One harmonic of the force in stick: frequency [Hz]; per log amplitude [N] and phase [rad] at time 0 of
    amplitude * sin(2 pi f t + phase); statistic: fall of the sum of squares in noise variances."""

    frequency: float
    amplitude: Array
    phase: Array
    statistic: float


@dataclass(frozen=True)
class _Sticks:
    """The samples of one log's sticks: t, r (n,) residual of the loading lines, w (n,) weights, stick (n,)."""

    t: Array
    r: Array
    w: Array
    stick: NDArray[np.int64]
    span: float
    interval: float

    def flat(self, y: Array) -> Array:
        """y without a level per stick and without a slope common to all."""

        def centred(v: Array) -> Array:
            means = np.bincount(self.stick, weights=self.w * v) / np.bincount(self.stick, weights=self.w)
            return np.asarray(v - means[self.stick])

        y, t = centred(y), centred(self.t)
        return np.asarray(y - t * np.sum(self.w * y * t) / np.sum(self.w * t * t))

    def waves(self, frequency: float) -> Array:
        """Sine and cosine of a frequency [Hz] (2, n)."""
        phase = 2 * np.pi * frequency * self.t
        return np.stack([self.flat(np.sin(phase)), self.flat(np.cos(phase))])

    def harmonic(self, frequency: float) -> tuple[float, Array]:
        """Fall of the sum of squares by a harmonic, and its sine and cosine amplitudes."""
        basis = self.waves(frequency)
        right = (basis * self.w) @ self.r
        c = np.asarray(np.linalg.lstsq((basis * self.w) @ basis.T, right, rcond=1e-9)[0], float)
        return float(right @ c), c

    def without(self, frequency: float) -> _Sticks:
        """The sticks with a harmonic taken out."""
        return replace(self, r=self.r - self.harmonic(frequency)[1] @ self.waves(frequency))

    def spectrum(self, frequency: Array) -> Array:
        """About the fall of the sum of squares by a harmonic of each of these frequencies [Hz]."""
        index = np.round((self.t - self.t[0]) / self.interval).astype(int)
        grid = np.bincount(index, weights=self.w * self.r)
        size = 1 << int(np.ceil(np.log2(8 * grid.size)))  # padded, so that no line between its frequencies is missed
        power = np.abs(np.fft.rfft(grid, size)) ** 2 / (0.5 * np.sum(self.w))
        own = np.interp(frequency, np.fft.rfftfreq(size, self.interval), power, right=0.0)
        return np.where(frequency < 1.0 / self.span, 0.0, own)


def _sticks(log: Prepared) -> _Sticks | None:
    """The stick samples of one log, None where there is too little."""
    c, data, rows = log.segmentation.cycles, log.data, []
    if c.count == 0:
        return None
    for start, end in zip(np.append(data.begin, c.arrest), np.append(c.onset, data.end), strict=True):
        margin = max(TRIM * (end - start), CLEAR * log.rig.half_period)
        first, last = np.searchsorted(data.time, [max(start + margin, data.begin), min(end - margin, data.end)])
        good = np.flatnonzero(data.weight[first:last] > 0) + first
        if good.size >= FEWEST and end - start >= 4 * margin:
            rows.append(good)
    if not rows:
        return None
    which, all_rows = np.repeat(np.arange(len(rows)), [own.size for own in rows]), np.concatenate(rows)
    time, weight = data.time[all_rows], data.weight[all_rows]
    sticks = _Sticks(time, time, weight, which, float(np.ptp(time)), float(np.median(np.diff(data.time))))
    return replace(sticks, r=sticks.flat(data.force[all_rows]))


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
        waves = [np.array([np.nan, 0.0]) if s is None else s.harmonic(best)[1] for s in sticks]
        sine, cosine = np.transpose(waves)
        lines.append(
            SpectralLine(best, np.hypot(sine, cosine), np.nan_to_num(np.arctan2(cosine, sine)), explained(best))
        )
        sticks = [None if s is None else s.without(best) for s in sticks]
    return tuple(lines), np.array([1.0 if s is None else np.mean(s.w * s.r**2) for s in sticks])


# The harmonics of the model.


@dataclass(frozen=True)
class _Wave:
    """Where a harmonic of the model stands among the parameters."""

    amplitude: int
    frequency: int
    phase: int


def _waves(unknowns: Unknowns) -> list[_Wave]:
    names = unknowns.names
    stems = [name.removesuffix("_amplitude") for name in names if name.endswith("_amplitude")]
    return [
        _Wave(*(names.index(f"{stem}_{what}") for what in ("amplitude", "frequency", "phase")))
        for stem in stems
        if f"{stem}_frequency" in names and f"{stem}_phase" in names
    ]


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
    names, quiet = unknowns.names, dict(unknowns.model.quiet)
    for i, name in enumerate(names):
        if not np.isnan(quiet.get(name, np.nan)) and not unknowns.told[i] and free[i]:
            start[i] = quiet[name]
    searched = [w for w in _waves(unknowns) if free[w.amplitude] and not unknowns.told[w.amplitude]]
    if searched:
        found, left = rhythms(logs, most=len(searched))
        lines, lobe = list(found), LOBE / max(float(np.ptp(log.data.time)) for log in logs)
        own = np.full((len(logs), len(names)), np.nan)
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
    rigs = [log.rig for log in logs]
    response = np.array([r.stiffness + 1j * omega * r.damping * np.sqrt(r.mass / r.stiffness) for r in rigs])
    amplitudes, phases = line.amplitude / np.abs(response), line.phase - np.angle(response)
    seen = np.isfinite(amplitudes)
    start[wave.amplitude] = float(np.mean(amplitudes[seen]))
    if unknowns.free[wave.frequency]:
        start[wave.frequency] = np.log(line.frequency)
    if unknowns.free[wave.phase]:
        start[wave.phase] = phases[int(np.argmax(seen))]
        own[:, wave.phase] = np.where(seen, phases, 0.0)


def _corrected(log: Prepared, own: Array, left: float) -> Prepared:
    """The log with its own phases; an estimated noise that counted the rhythms in is rid of them."""
    weight = log.data.weight / min(left, 1.0) if log.noise_estimated else log.data.weight
    phases = own if np.any(np.isfinite(own)) else log.data.own
    return replace(log, data=replace(log.data, own=phases, weight=weight))
