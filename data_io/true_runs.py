"""Runs of true values in a row of flags."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt


def true_runs(flags: Sequence[bool] | np.ndarray[Any, Any]) -> npt.NDArray[np.int64]:
    """First index of each run of true values and that behind its last (r, 2), of flags (n,)."""
    padded = np.concatenate(([False], np.asarray(flags, dtype=bool), [False]))
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return edges.reshape(-1, 2).astype(np.int64)


def longest_run(flags: Sequence[bool] | np.ndarray[Any, Any]) -> int:
    """Return the length of the longest run of true values."""
    runs = true_runs(flags)
    return int(np.max(runs[:, 1] - runs[:, 0], initial=0))
