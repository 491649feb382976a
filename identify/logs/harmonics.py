"""Rhythms of a record as sums of harmonics, known from what was measured: their course, and how sure it is when.

The spectrum of a record repeats it backwards beyond its ends, where a rhythm does no such thing: a course made of the
lines of that spectrum is off near the ends by several times what it is off elsewhere. Harmonics with sine and cosine,
each with the variance that the spectrum shows at its frequency, run on as they come; what the samples say of them
follows from Bayes, and so does its error, which grows towards the ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
