"""Fewer of many values: what a median or a quantile of a long log needs, and no copy of what is whole."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.frozen import FloatArray

ENOUGH: Final = 1 << 14  # a median of so many is as good as one of all: its error is 1 % of their spread


def thinned(values: FloatArray, enough: int = ENOUGH) -> FloatArray:
    """Every so many-th of the values (n,): at least `enough` of them, at most three times as many.

    Fewer values stay as they are. The stride is odd: what alternates from value to value is seen both ways.
    """
    every = values.size // enough
    return values if every < 2 else values[:: every - 1 + every % 2]


def thinned_steps(values: FloatArray) -> FloatArray:
    """Every so many-th step from one value to the next, as `thinned` would choose from all of them."""
    return thinned(values[1:]) - thinned(values[:-1])


def kept(values: FloatArray, which: npt.NDArray[np.bool_]) -> FloatArray:
    """The values (n,) that are marked; the very array where all are."""
    return values if which.all() else values[which]


def shown(values: FloatArray, which: npt.NDArray[np.bool_]) -> FloatArray:
    """The values (n,) where they are marked, NaN elsewhere; the very array where all are."""
    return values if which.all() else np.where(which, values, np.nan)
