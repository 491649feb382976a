"""The spectrum of a stretch of a log about its trend, and the lines in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
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


# Stick-slip that looks like steady sliding: a level force that swings as fast as a stick loads, too few samples in each
# cycle for the cycles to be seen, so that the swing counts as noise.
#
# The mean force of stick-slip is not that of steady sliding. While the mass slides the spring loads more slowly than in
# a stick, dF/dt < k v_0; a swing that reaches that rate comes to rest.

BY_CHANCE = 1e-6  # probability of so high a line in white noise
LEAST_PERIODS = 8  # periods
MOST_OF_IT = 0.4  # share of the power that lies in the line: less moves the level less than noise does
LOADS, TOO_FAST = 0.5, 4.0  # times k v_0: how fast a swing of stick-slip loads; a saw-tooth's first harmonic does by 2
FASTER = 1.2  # times the natural frequency of the rig: no stick-slip is faster
FROM_LOAD = 0.2  # of the swing: with so much in the normal force it may come from there
ENOUGH = 25  # samples of a period in which its slip is seen
ALIASES = 3  # times the sampling rate up to which a swing may really be


@dataclass(frozen=True)
class Swing:
    """A swing: how many samples see one period, its frequency [Hz] if it is no faster than it looks, and its range
    [N]."""

    samples: float
    frequency: float
    range: float

    def __str__(self) -> str:
        """What the log does, to follow its name."""
        return (
            f"swings by {self.range:.2g} N, {self.frequency:.3g} times a second as far as "
            f"{self.samples:.2g} samples per period tell, as stick-slip does: sample it at "
            f"{ENOUGH * self.frequency:.2g} Hz or more"
        )


def hidden_rhythm(
    time: Array,
    force: Array,
    load: Array | None,
    *,
    stiffness: float,
    drive_speed: float,
    half_period: float,
    least: float = MOST_OF_IT,
) -> Swing | None:
    """The swing of what looks like steady sliding, where it is that of stick-slip; None where there is none.

    Args:
        time, force, load: (n,) [s], [N], [N]; NaN where nothing counts. load: None where the force is without what the
            load does to it.
        stiffness [N/m], drive_speed [m/s], half_period [s] of the rig; 0 where it is not known.
        least: share of the power that the swing holds.
    """
    if not (stiffness > 0.0 and drive_speed > 0.0 and half_period > 0.0):
        return None
    swing = Spectrum.of(time, force)
    if swing is None or swing.periods < LEAST_PERIODS or swing.chance > BY_CHANCE or swing.share(swing.peak) < least:
        return None
    seen, rate, height = swing.peak, 1.0 / swing.interval, swing.amplitude(swing.peak)
    if load is not None:
        pressed = Spectrum.of(time, load)
        coefficient = abs(float(np.nanmean(force) / np.nanmean(load)))
        if pressed is None or coefficient * pressed.amplitude(seen) > FROM_LOAD * height:
            return None
    candidates = np.array([seen, *(n * rate + sign * seen for n in range(1, ALIASES + 1) for sign in (-1.0, 1.0))])
    candidates = candidates[candidates <= FASTER * 0.5 / half_period]
    loads = 2.0 * np.pi * candidates * height / (stiffness * drive_speed)
    if not np.any((loads >= LOADS) & (loads <= TOO_FAST)):
        return None
    return Swing(swing.samples, seen, 2.0 * height)


# Rhythms of a record as sums of harmonics, known from what was measured: their course, and how sure it is when.
#
# The spectrum of a record repeats it backwards beyond its ends, where a rhythm does no such thing: a course made of the
# lines of that spectrum is off near the ends by several times what it is off elsewhere. Harmonics with sine and cosine,
# each with the variance that the spectrum shows at its frequency, run on as they come; what the samples say of them
# follows from Bayes, and so does its error, which grows towards the ends.


@dataclass(frozen=True)
class Harmonics:
    """What n samples, `step` [s] apart, say of rhythms: line (m,), of k half periods in the record each; amplitudes
    cosine, sine (m,); factor (2 m, 2 m), a square root of their covariance, cosines first."""

    count: int
    step: float
    line: NDArray[np.int64]
    cosine: Array
    sine: Array
    factor: Array

    def course(self, finer: int) -> tuple[Array, Array]:
        """Times [s] from the first sample, `finer` times as many as samples and half of their distance inside, and the
        rhythms there."""
        size = finer * self.count
        lines, sines = np.zeros(size), np.zeros(size)
        lines[self.line], sines[self.line - 1] = self.cosine, self.sine
        scale = np.sqrt(0.5 * size)
        wave = scale * (scipy.fft.idct(lines, norm="ortho") + scipy.fft.idst(sines, norm="ortho"))
        return self.step * ((np.arange(size) + 0.5) / finer - 0.5), wave

    def variance(self, time: Array, first: int = 0) -> Array:
        """Variance of the rhythms at times (k,) [s] from the first sample; of those of `first` half periods or more."""
        counted = self.line >= first
        phase = np.pi * np.outer(time / self.step + 0.5, self.line) / self.count
        waves = np.concatenate([np.cos(phase) * counted, np.sin(phase) * counted], axis=1)
        return np.asarray(np.sum((waves @ self.factor) ** 2, axis=1))


def harmonics(values: Array, step: float, share: Array, noise: float) -> Harmonics:
    """The rhythms of evenly sampled values.

    Args:
        values: (n,) at times step * (0, 1, ...); share (n,) of the power of every line of their cosine spectrum that is
            no noise, 0 where there is no rhythm, below 1; noise: variance of the white noise of one value.
    """
    n = values.size
    line = np.flatnonzero(share > 0.0)
    line = line[line > 0]
    prior = noise * share[line] / (1.0 - share[line]) / n  # variance of either amplitude
    own = 0.5 * n / noise + 1.0 / prior
    # Cosines among themselves, and sines, are orthogonal over the samples; the one with the other where k + l is odd.
    sums, differences = (np.add.outer(sign * line, line) for sign in (1, -1))
    odd = sums % 2 == 1
    across = np.zeros(sums.shape)
    across[odd] = 0.5 / np.sin(0.5 * np.pi * sums[odd] / n) + 0.5 / np.sin(0.5 * np.pi * differences[odd] / n)
    across /= noise
    told = np.sqrt(0.5 * n) / noise
    right = told * np.concatenate(
        [scipy.fft.dct(values, norm="ortho")[line], scipy.fft.dst(values, norm="ortho")[line - 1]]
    )
    size = line.size
    precision = np.zeros((2 * size, 2 * size))
    index = np.arange(2 * size)
    precision[index, index] = np.tile(own, 2)
    precision[:size, size:], precision[size:, :size] = across, across.T
    lower = scipy.linalg.cholesky(precision, lower=True)
    amplitudes = scipy.linalg.cho_solve((lower, True), right)
    factor = scipy.linalg.solve_triangular(lower, np.eye(2 * size), lower=True).T
    return Harmonics(n, step, line, amplitudes[:size], amplitudes[size:], factor)
