"""Time stamps that were written with too few digits: an even clock, rounded."""

from typing import Final

import numpy as np

from data_io.frozen import Finding, FloatArray

_FEWEST: Final = 50  # rows from which an even clock is told from a few odd steps
_DIGITS: Final = 6  # decimals of the finest rounding that matters to any logger
_MATTERS: Final = 0.05  # of an interval: a coarser rounding moves samples noticeably
_EXACT: Final = 1e-3  # of the rounding step by which stamps may miss its multiples
_WITHIN: Final = 1.25  # rounding steps that the line through an even clock may miss its stamps by, from end to end


def evened(time: FloatArray, of_step: str = "") -> tuple[FloatArray, list[Finding]]:
    """Return a rising clock (n,) [s], even where its stamps are those of an even one that was rounded, and what to say.

    A clock of 800 Hz that is written in milliseconds has steps of 1 and 2 ms, and moves samples by up to half of one.
    No stamp of an even clock is further than half a rounding step from where it belongs; a clock that jitters more, or
    has gaps, is left as it is.
    """
    if time.size < _FEWEST:
        return time, []
    interval = float(time[-1] - time[0]) / (time.size - 1)
    if np.ptp(np.diff(time)) <= _MATTERS * interval:
        return time, []
    step = next((10.0**-digits for digits in range(_DIGITS + 1) if _multiples(time, 10.0**-digits)), 0.0)
    if not 2.0 * _MATTERS * interval < step <= 2.0 * interval:
        return time, []
    places = np.arange(time.size)
    slope, begin = np.polyfit(places, time, 1)
    even = begin + slope * places
    if np.ptp(time - even) > _WITHIN * step:
        return time, []
    text = (
        f"the time stamps{of_step} are rounded to {step:g} s; they are those of an even clock of {1.0 / slope:.5g} Hz"
    )
    return even, [Finding("clock_rounded", "info", f"{text}, which is used")]


def _multiples(time: FloatArray, step: float) -> bool:
    """Whether all stamps are whole multiples of a step."""
    counts = time / step
    return bool(np.max(np.abs(counts - np.round(counts))) < _EXACT)
