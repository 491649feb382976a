"""Time stamps that were written on a grid (decimals, ticks of a timer, single precision): an even clock, rounded."""

from typing import Final

import numpy as np

from data_io.frozen import Finding, FloatArray
from data_io.thinned import thinned

_FEWEST: Final = 50  # rows from which an even clock is told from a few odd steps
_DIGITS: Final = 6  # decimals of the finest rounding that matters to any logger
_MATTERS: Final = 0.05  # of an interval: a coarser rounding moves samples noticeably
_EXACT: Final = 1e-3  # of the rounding step by which stamps may miss its multiples
_NEAR: Final = 0.05  # of a tick by which differences of stamps may miss its multiples: its decimals are rounded too
_LEVELS: Final = 12  # different intervals that a rounded even clock has at most; one that jitters has many
_STAMPS: Final = 20  # different stamps from which the line through rows that share them tells where each belongs
_WITHIN: Final = 1.25  # rounding steps that the line through an even clock may miss its stamps by, from end to end


def evened(time: FloatArray, of_step: str = "") -> tuple[FloatArray, list[Finding]]:
    """Return a clock (n,) [s] that does not fall, even where its stamps are those of an even one that was rounded, and
    what to say.

    A clock of 800 Hz that is written in milliseconds has steps of 1 and 2 ms, and moves samples by up to half of one.
    No stamp of an even clock is further than half a rounding step from where it belongs; a clock that jitters more, or
    has gaps, is left as it is. Rows may share a stamp where the step is longer than the interval.
    """
    if time.size < _FEWEST:
        return time, []
    interval = float(time[-1] - time[0]) / (time.size - 1)
    change = np.diff(time)
    if np.ptp(change) <= _MATTERS * interval:
        return time, []
    step, kind = _rounding(time, change)
    if not 2.0 * _MATTERS * interval < step <= max(2.0, time.size / _STAMPS) * interval:
        return time, []
    places = np.arange(time.size)
    slope, begin = np.polyfit(places, time - time[0], 1)
    even = time[0] + begin + slope * places
    if np.ptp(time - even) > _WITHIN * step:
        return time, []
    text = f"the time stamps{of_step} are {kind}; they are those of an even clock of {1.0 / slope:.5g} Hz"
    return even, [Finding("clock_rounded", "info", f"{text}, which is used")]


def _rounding(time: FloatArray, change: FloatArray) -> tuple[float, str]:
    """Return the coarsest step [s] to which stamps were rounded, 0 where they lie on no grid, and words for it."""
    decimal = next((10.0**-digits for digits in range(_DIGITS + 1) if _multiples(time, 10.0**-digits)), 0.0)
    tick = _tick(change)
    single = 0.0
    if np.array_equal(time, time.astype(np.float32)):
        single = float(np.spacing(np.float32(np.max(np.abs(time)))))
    if single >= max(decimal, tick * (1.0 - _NEAR)):
        return single, f"numbers of single precision, {single:.3g} s apart"
    if decimal >= tick * (1.0 - _NEAR):
        return decimal, f"rounded to {decimal:g} s"
    return tick, f"ticks of {tick:.4g} s"


def _multiples(time: FloatArray, step: float) -> bool:
    """Whether all stamps are whole multiples of a step."""
    counts = time / step
    return bool(np.max(np.abs(counts - np.round(counts))) < _EXACT)


def _tick(change: FloatArray) -> float:
    """Return the largest time [s] whose multiples all the intervals are, 0 where there is none."""
    few = np.sort(thinned(change))
    apart = _NEAR * float(np.mean(change))
    levels = [float(group.mean()) for group in np.split(few, np.flatnonzero(np.diff(few) > apart) + 1)]
    if len(levels) > _LEVELS:
        return 0.0
    gaps = [*np.diff(levels).tolist(), *(level for level in levels if level > apart)]
    tick = min(gaps, default=0.0)
    counts = change / tick if tick > 0 else np.array([0.5])
    return tick if float(np.max(np.abs(counts - np.round(counts)))) < _NEAR else 0.0
