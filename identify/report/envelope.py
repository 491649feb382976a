"""Long signals for a small picture: lowest and highest value per stretch, so that no peak is lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Envelope:
    """A signal over b stretches. All shape (b,): time [s] of the middle, lowest and highest value.

    `per_stretch` is the number of samples in a stretch; 1 means that these are the samples themselves.
    """

    time: Array
    lower: Array
    upper: Array
    per_stretch: int

    @property
    def exact(self) -> bool:
        """Whether nothing was thinned out."""
        return self.per_stretch == 1


def envelope(time: Array, values: Array, stretches: int) -> Envelope:
    """The envelope of values (n,) at time (n,) in at most `stretches` stretches of equally many samples.

    NaN is passed over; a stretch of nothing but NaN stays NaN. Up to 2 * stretches samples are kept as they are:
    an envelope of so many stretches would be no shorter.
    """
    count = len(values)
    if count <= 2 * stretches:
        return Envelope(np.asarray(time, float), np.asarray(values, float), np.asarray(values, float), 1)
    size = -(-count // stretches)
    starts = np.arange(0, count, size)
    last = np.minimum(starts + size, count) - 1
    lower, upper = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    return Envelope((time[starts] + time[last]) / 2, lower, upper, size)


def extremes(values: Array, stretches: int) -> NDArray[np.intp]:
    """Rising indices of the lowest and the highest of values (n,) in each stretch: at most 2 * stretches of them.

    All indices of finite values where there are no more than that. Points drawn at these indices keep every outlier.
    """
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) <= 2 * stretches:
        return finite
    size = -(-len(finite) // stretches)
    padded = np.concatenate([finite, np.full(-len(finite) % size, finite[-1])]).reshape(-1, size)
    rows = np.arange(len(padded))
    lowest, highest = np.argmin(values[padded], axis=1), np.argmax(values[padded], axis=1)
    return np.unique(np.concatenate([padded[rows, lowest], padded[rows, highest]]))
