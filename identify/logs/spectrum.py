"""The spectrum of a stretch of a log about its trend, and the lines in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEWEST = 32  # samples of a spectrum
BAND = 0.08  # relative half width of a line
SLOWEST = 3.0  # periods in the stretch: what is slower is trend


@dataclass(frozen=True)
class Spectrum:
    """frequency (m,) [Hz]; power (m,) of the windowed values, 0 where they are trend; variance of the values about it;
    interval of the samples [s]."""

    frequency: Array
    power: Array
    variance: float
    interval: float

    @classmethod
    def of(cls, time: Array, values: Array) -> Spectrum | None:
        """Of values (n,) at times (n,) [s], what is not finite left out; None where there are too few."""
        good = np.isfinite(values)
        if np.count_nonzero(good) < FEWEST:
            return None
        t, f = time[good], values[good]
        interval = float(np.median(np.diff(t)))
        f = f - np.polyval(np.polyfit(t - t[0], f, 2), t - t[0])
        power = np.abs(np.fft.rfft(f * np.hanning(f.size))) ** 2
        frequency = np.fft.rfftfreq(f.size, interval)
        power[frequency < SLOWEST / (f.size * interval)] = 0.0
        return cls(np.asarray(frequency, np.float64), power, float(np.var(f)), interval)

    @property
    def peak(self) -> float:
        """Where the power is highest [Hz]."""
        return float(self.frequency[int(np.argmax(self.power))])

    @property
    def samples(self) -> float:
        """In a period of the peak."""
        return 1.0 / (self.peak * self.interval) if self.peak > 0.0 else float("inf")

    @property
    def chance(self) -> float:
        """Probability that the highest power of noise, which is white within an octave on each side, is so high (R. A.
        Fisher, Proc. R. Soc. A 125 (1929) 54, its first term)."""
        power = self.power[(self.frequency >= 0.5 * self.peak) & (self.frequency <= 2.0 * self.peak)]
        whole, count = float(np.sum(power)), np.count_nonzero(power)
        return float(count * (1.0 - np.max(power) / whole) ** (count - 1)) if whole > 0.0 else 1.0

    @property
    def periods(self) -> float:
        """Of the peak, in the stretch."""
        return self.peak / float(self.frequency[1])

    def share(self, frequency: float) -> float:
        """Which part of the power a line there holds."""
        near = np.abs(self.frequency - frequency) <= max(BAND * frequency, 2.0 * self.frequency[1])
        return float(np.sum(self.power[near]) / max(np.sum(self.power), 1e-300))

    def amplitude(self, frequency: float) -> float:
        """Of the sine that holds as much of the variance as a line there."""
        return float(np.sqrt(2.0 * self.share(frequency) * self.variance))
