"""What the user's window and exclude leave unused may hold whatever it likes: it goes before anything is checked."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.frozen import FloatArray
from data_io.source import Request

Span = tuple[float, float]
_ALWAYS: Final = float("inf")


def unused_spans(request: Request) -> list[Span]:
    """Return the stretches [s], ends included, that the user does not want, counted from the first row of the log."""
    spans = list(request.exclude)
    if request.window is not None:
        start, stop = request.window
        spans += [(-_ALWAYS, float(np.nextafter(start, -_ALWAYS))), (float(np.nextafter(stop, _ALWAYS)), _ALWAYS)]
    return spans


def without_needless(
    time: FloatArray, bad: npt.NDArray[np.bool_], spans: Sequence[Span], *, ends: bool
) -> npt.NDArray[np.bool_]:
    """Return which rows (n,) to keep: all but those `bad` ones that stand in an unused stretch.

    time: (n,) [s] from the first row of the log on, in the order of the file; it may hold NaN and fall, so that a
    stretch is the rows from the first one at its begin to the first one behind its end. ends: keep the first and last
    row of a stretch that is bad all over, so that it is still seen that there was one. The first row is always kept.
    """
    keep = np.ones(time.size, dtype=bool)
    for first, last in spans:
        start = 0 if first == -_ALWAYS else _first_row(time >= first)
        stop = start + _first_row(time[start:] > last)
        whole = bool(bad[start:stop].all())
        keep[start:stop] &= ~bad[start:stop]
        if ends and whole and stop > start:
            keep[[start, stop - 1]] = True
    keep[:1] = True
    return keep


def _first_row(true: npt.NDArray[np.bool_]) -> int:
    """Return the number of the first row that is true, the number of rows where none is."""
    return int(np.argmax(true)) if true.any() else true.size
