"""How a record was sampled: rate, jitter, dropouts, rate switches; step by step, pauses between steps aside."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.frozen import Finding, FloatArray
from data_io.record import Record
from data_io.thinned import kept, thinned
from data_io.thresholds import DEFAULTS, Thresholds

_EVEN: Final = 1e-3
_WINDOW: Final = 51
"""Intervals over which the local rate is the median."""
_DROPOUT: Final = 1.5
_ODD_FIRST: Final = 0.2
_NAMED: Final = 5


@dataclass(frozen=True)
class RateSwitch:
    """A change of the sampling rate: when [s], from and to [Hz]."""

    time: float
    before: float
    after: float


@dataclass(frozen=True)
class Sampling:
    """rate [Hz]: 1 / median interval. jitter: robust standard deviation of the interval as share of the interval.

    dropouts: gaps of more than one and a half intervals; missing: rows that would fill them; longest_gap [s], which
    begins at longest_at [s]; odd_first: a first interval of a step off by more than 20 %; switches: where the rate
    changes for good.
    """

    rate: float
    jitter: float
    dropouts: int
    missing: int
    longest_gap: float
    longest_at: float
    odd_first: bool
    switches: tuple[RateSwitch, ...]


def describe_sampling(
    record: Record, used: npt.NDArray[np.bool_] | None = None, thresholds: Thresholds = DEFAULTS
) -> tuple[Sampling, list[Finding]]:
    """Return the sampling of a record and what is worth saying about it.

    used: (n,) the rows that count; a stretch that was left out is no gap of the clock.
    """
    intervals, local, begins, odd = [], [], [], False
    switches: list[RateSwitch] = []
    previous: float | None = None
    for start, stop in _pieces(record, used):
        time = record.time[start:stop]
        if time.size < 2:
            continue
        change = np.diff(time)
        odd = odd or (change.size > 2 and abs(change[0] / np.median(thinned(change)) - 1) > _ODD_FIRST)
        level = _local_interval(change)
        switches += _switches(time, level, previous, thresholds["rate_switch"])
        previous = float(level[-1])
        intervals.append(change)
        local.append(level)
        begins.append(time[:-1])
    if not intervals:  # steps of one row each
        intervals = [np.diff(record.time)]
        local = [_local_interval(intervals[0])]
        begins = [record.time[:-1]]
    change, level = (parts[0] if len(parts) == 1 else np.concatenate(parts) for parts in (intervals, local))
    gaps = change > _DROPOUT * level
    ratio = change[gaps] / level[gaps]
    calm = thinned(kept(change, ~gaps)) / thinned(kept(level, ~gaps))
    sampling = Sampling(
        rate=float(1 / np.median(thinned(change))),
        jitter=float(1.4826 * np.median(np.abs(calm - np.median(calm)))) if calm.size else 0.0,
        dropouts=int(np.count_nonzero(gaps)),
        missing=int(np.sum(np.round(ratio) - 1)),
        longest_gap=float(np.max(change[gaps], initial=0.0)),
        longest_at=float(np.concatenate(begins)[gaps][np.argmax(change[gaps])]) if gaps.any() else 0.0,
        odd_first=bool(odd),
        switches=tuple(switches),
    )
    return sampling, _findings(sampling, sum(piece.size for piece in intervals) + len(intervals), thresholds)


def _pieces(record: Record, used: npt.NDArray[np.bool_] | None) -> list[tuple[int, int]]:
    """Rows [start, stop) of every unbroken stretch that counts, step by step."""
    if used is None or used.all():
        return [(step.start, step.stop) for step in record.steps]
    found = []
    for step in record.steps:
        edges = np.flatnonzero(np.diff(np.concatenate(([0], used[step.start : step.stop].astype(np.int8), [0]))))
        found += [(step.start + int(a), step.start + int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return found


def _local_interval(change: FloatArray) -> FloatArray:
    """Median interval around each interval, shape (n - 1,): a few dropouts do not move it, a switch does."""
    if change.size and np.ptp(change) <= _EVEN * change[0]:  # an even clock needs no window
        return np.broadcast_to(np.median(thinned(change)), change.shape)
    import pandas as pd  # 0.3 s: few logs need it

    window = min(_WINDOW, change.size)
    return pd.Series(change).rolling(window, center=True, min_periods=1).median().to_numpy(dtype=np.float64)


def _switches(time: FloatArray, level: FloatArray, previous: float | None, factor: float) -> list[RateSwitch]:
    """Return the places where the local interval leaves a factor about the one before, within one step."""
    found: list[RateSwitch] = []
    reference = previous if previous is not None else float(level[0])
    start = 0
    while True:
        later, low, high = level[start:], reference / factor, reference * factor
        if low <= later.min() and later.max() <= high:
            return found
        here = start + int(np.argmax((later < low) | (later > high)))
        settled = float(level[min(here + _WINDOW // 2, level.size - 1)])
        if max(settled / reference, reference / settled) > factor:
            found.append(RateSwitch(float(time[here]), 1 / reference, 1 / settled))
            reference = settled
        start = here + _WINDOW // 2 + 1
        if start >= level.size:
            return found


def _findings(sampling: Sampling, rows: int, limits: Thresholds) -> list[Finding]:
    notes: list[Finding] = []
    if sampling.odd_first:
        text = "the first sampling interval differs from the others, as CETR logs have it"
        notes.append(Finding("odd_first_interval", "info", text))
    if sampling.switches:
        shown = "; ".join(
            f"at {s.time:.6g} s from {s.before:.4g} to {s.after:.4g} Hz" for s in sampling.switches[:_NAMED]
        )
        more = f" and {len(sampling.switches) - _NAMED} more" if len(sampling.switches) > _NAMED else ""
        text = f"the sampling rate changes {shown}{more}; log at one rate, or cut one part with window"
        notes.append(Finding("rate_switch", "warning", text))
    if severity := limits.severity("missing_rows", sampling.missing / (rows + sampling.missing)):
        text = (
            f"{sampling.dropouts} gap(s) in the clock, about {sampling.missing} rows missing, "
            f"the longest gap {sampling.longest_gap:.4g} s at {sampling.longest_at:.6g} s; write to a faster disk"
        )
        notes.append(Finding("dropouts", severity, text))
    if severity := limits.severity("jitter", sampling.jitter):
        text = (
            f"the sampling interval jitters by {100 * sampling.jitter:.0f} % about {1 / sampling.rate:.4g} s; let the "
            "hardware clock the sampling"
        )
        notes.append(Finding("jitter", severity, text))
    return notes
