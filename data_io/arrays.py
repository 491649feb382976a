"""Long columns of numbers: fewer of many, runs of flags, the grid on which values lie."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.values import FloatArray

# Fewer of many values: what a median or a quantile of a long log needs, and no copy of what is whole.

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


def same(one: FloatArray | None, other: FloatArray) -> bool:
    """Tell equal columns; block by block, because those that differ mostly do so soon."""
    if one is None or one.size != other.size:
        return False
    blocks = (slice(begin, begin + ENOUGH) for begin in range(0, one.size, ENOUGH))
    return one is other or all(np.array_equal(one[rows], other[rows], equal_nan=True) for rows in blocks)


# Runs of true values in a row of flags.


def true_runs(flags: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """First index of each run of true values and that behind its last (r, 2), of flags (n,)."""
    padded = np.concatenate(([False], np.asarray(flags, dtype=bool), [False]))
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return edges.reshape(-1, 2).astype(np.int64)


def longest_run(flags: npt.ArrayLike) -> int:
    """Return the length of the longest run of true values."""
    runs = true_runs(flags)
    return int(np.max(runs[:, 1] - runs[:, 0], initial=0))


# The step of the grid on which all values of a sensor lie, told from the values alone.

_REPEATS: Final = 8  # values met before from which on a grid is believed: noise of many digits hardly repeats a value
_OFF_GRID: Final = 0.2  # share of a step by which a difference may miss its multiple: the number format rounds too
_ON_GRID: Final = 0.9  # share of the differences that are multiples of the step, at least
_NEAR: Final = 10  # steps up to which a difference tells the step better: over more of them its own rounding adds up


def grid_step(values: FloatArray) -> float:
    """Return the step of the grid on which the values (n,) lie; 0 where they show none.

    Many of them repeat, and their differences are multiples of the step within rounding. The difference of two
    neighbours alone is no step: in a short ramp it is what the ramp rises in one row.
    """
    few = thinned(values)
    levels = np.unique(few)
    if few.size - levels.size < _REPEATS:
        return 0.0
    steps = np.diff(levels)
    steps = steps[steps > 1e-6 * (levels[-1] - levels[0])]
    if not steps.size:
        return 0.0
    near = steps[steps < (_NEAR + 0.5) * steps.min()]
    step = float(np.sum(near) / np.sum(np.round(near / steps.min())))
    missed = np.abs(steps / step - np.round(steps / step))
    return step if np.mean(missed < _OFF_GRID) >= _ON_GRID else 0.0
