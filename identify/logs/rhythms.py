"""Rhythms in the stick phases: harmonics that a vibrating drive or a live finger leaves in the loading lines.

While the mass rests the force is a straight line plus what the drive's own motion adds. Lines are found in the
spectrum of what is left of the loading lines and refined by least squares, one amplitude and phase per log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from identify.logs.prepare import Prepared

Array = NDArray[np.float64]

TRIM = 0.12  # of a stick at either end that is left out: the transients of slips
CLEAR = 1.0  # half periods of the rig at either end that are left out at least
FEWEST = 12  # samples of a stick that counts
PEAKS = 6  # of the spectra that are looked at closely
PADDING = 8  # of a spectrum, so that a line between its frequencies is not missed
SURE = 25.0  # fall of the sum of squares (in noise variances) beyond the search over frequencies
LOWEST = 1.0  # periods that the sticks of a log must hold in all


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
        count = int(self.stick[-1]) + 1
        total = np.bincount(self.stick, weights=self.w, minlength=count)

        def centred(v: Array) -> Array:
            return np.asarray(v - (np.bincount(self.stick, weights=self.w * v, minlength=count) / total)[self.stick])

        y, t = centred(y), centred(self.t)
        return np.asarray(y - t * np.sum(self.w * y * t) / np.sum(self.w * t * t))

    @property
    def variance(self) -> float:
        """Mean weighted square of the residual."""
        return float(np.mean(self.w * self.r**2))

    def harmonic(self, frequency: float) -> tuple[float, Array]:
        """Fall of the sum of squares by a harmonic, and its sine and cosine amplitudes."""
        omega = 2 * np.pi * frequency
        basis = np.stack([self.flat(np.sin(omega * self.t)), self.flat(np.cos(omega * self.t))])
        normal = (basis * self.w) @ basis.T
        right = (basis * self.w) @ self.r
        c = np.asarray(np.linalg.lstsq(normal, right, rcond=1e-9)[0], float)
        return float(right @ c), c

    def without(self, frequency: float) -> _Sticks:
        """The sticks with a harmonic taken out."""
        c, omega = self.harmonic(frequency)[1], 2 * np.pi * frequency
        left = self.r - self.flat(c[0] * np.sin(omega * self.t) + c[1] * np.cos(omega * self.t))
        return _Sticks(self.t, left, self.w, self.stick, self.span, self.interval)

    def spectrum(self, frequency: Array) -> Array:
        """About the fall of the sum of squares by a harmonic of each of these frequencies [Hz]."""
        index = np.round((self.t - self.t[0]) / self.interval).astype(int)
        grid = np.bincount(index, weights=self.w * self.r)
        size = 1 << int(np.ceil(np.log2(PADDING * grid.size)))
        power = np.abs(np.fft.rfft(grid, size)) ** 2 / (0.5 * np.sum(self.w))
        own = np.interp(frequency, np.fft.rfftfreq(size, self.interval), power, right=0.0)
        return np.where(frequency < LOWEST / self.span, 0.0, own)


def _sticks(log: Prepared) -> _Sticks | None:
    """The stick samples of one log, None where there is too little."""
    c = log.segmentation.cycles
    if c.count == 0:
        return None
    data, t, f, w, stick, number = log.data, [], [], [], [], 0
    starts, ends = np.append(data.begin, c.arrest), np.append(c.onset, data.end)
    for start, end in zip(starts, ends, strict=True):
        margin = max(TRIM * (end - start), CLEAR * log.rig.half_period)
        first, last = np.searchsorted(data.time, [max(start + margin, data.begin), min(end - margin, data.end)])
        good = np.flatnonzero(data.weight[first:last] > 0) + first
        if good.size < FEWEST or end - start < 4 * margin:
            continue
        t.append(data.time[good])
        f.append(data.force[good])
        w.append(data.weight[good])
        stick.append(np.full(good.size, number))
        number += 1
    if number == 0:
        return None
    time, force, weight, which = (np.concatenate(v) for v in (t, f, w, stick))
    made = _Sticks(time, force, weight, which, float(np.ptp(time)), float(np.median(np.diff(data.time))))
    return _Sticks(time, made.flat(force), weight, which, made.span, made.interval)


def rhythms(logs: Sequence[Prepared], most: int = 3) -> tuple[tuple[SpectralLine, ...], Array]:
    """The harmonics that stand out of the stick phases of these logs, strongest first.

    Returns:
        the harmonics; and per log what they leave of the loading lines, in variances of the noise (1 without sticks).
    """
    sticks = [_sticks(log) for log in logs]
    known = [s for s in sticks if s is not None]
    found: list[SpectralLine] = []
    while known and len(found) < most:
        tried = _peaks(known)
        best = max((_refined(f, known) for f in tried), key=lambda f: _together(f, known))
        looks = 2 * np.log(max(s.span / s.interval for s in known))
        if _together(best, known) < SURE + looks:
            break
        amplitude, phase = np.full(len(logs), np.nan), np.zeros(len(logs))
        for i, s in enumerate(sticks):
            if s is not None:
                sine, cosine = s.harmonic(best)[1]
                amplitude[i], phase[i] = np.hypot(sine, cosine), np.arctan2(cosine, sine)
        found.append(SpectralLine(best, amplitude, phase, _together(best, known)))
        sticks = [None if s is None else s.without(best) for s in sticks]
        known = [s for s in sticks if s is not None]
    after = [1.0 if s is None else s.variance for s in sticks]
    return tuple(found), np.array(after)


def _peaks(sticks: Sequence[_Sticks]) -> list[float]:
    """Frequencies at which the spectra together are highest [Hz]."""
    longest, shortest = max(s.span for s in sticks), min(s.interval for s in sticks)
    frequency = np.arange(LOWEST / longest, 0.4 / shortest, 0.25 / longest)
    power = np.sum([s.spectrum(frequency) for s in sticks], axis=0)
    out: list[float] = []
    for _ in range(PEAKS):
        i = int(np.argmax(power))
        out.append(float(frequency[i]))
        power[np.abs(frequency - frequency[i]) < 1.0 / longest] = 0.0
    return out


def _together(frequency: float, sticks: Sequence[_Sticks]) -> float:
    return sum(s.harmonic(frequency)[0] for s in sticks)


def _refined(frequency: float, sticks: Sequence[_Sticks]) -> float:
    """The frequency near this one at which the harmonic explains most [Hz]."""
    reach = 0.6 / max(s.span for s in sticks)
    low, high = max(frequency - reach, 0.1 * frequency), frequency + reach
    found = minimize_scalar(
        lambda f: -_together(f, sticks), bounds=(low, high), method="bounded", options={"xatol": 1e-3 * reach}
    )
    return float(found.x)
