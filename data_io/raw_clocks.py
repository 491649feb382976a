"""Clocks as loggers leave them: newest row first, rows that were never written, counters that begin anew."""

from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.arrays import thinned, true_runs
from data_io.contents import Contents, Part
from data_io.source import Request
from data_io.values import LONGEST_GAP, Finding, FloatArray

_COUNTS: Final = tuple(2.0**bits * part for part in (1.0, 1e-3, 1e-6) for bits in (16, 24, 32))
"""What a counter of so many bits holds, in its own counts, thousands and millions of them."""
_FEWEST: Final = 3

Rows = npt.NDArray[np.intp]


def with_sound_clocks(request: Request, contents: Contents) -> Contents:
    """Return contents in which the clock of each part goes on from row to row as far as the logger's way is known."""
    if contents.settled or request.rate is not None:
        return contents
    parts, findings = [], list(contents.findings)
    for part in contents.parts:
        clock = -1 if part.clocks else part.header.roles.get("time", -1)
        told = clock in part.columns and part.rows >= _FEWEST
        for mend in (_oldest_first, _written, _counted_on) if told else ():
            part, notes = mend(part, clock)
            findings += notes
        parts.append(part)
    return replace(contents, parts=parts, findings=findings)


def _oldest_first(part: Part, clock: int) -> tuple[Part, list[Finding]]:
    """Turn a part over whose clock falls in every row: the newest row stands first."""
    time = part.columns[clock]
    if not np.isfinite(time).all() or not (np.diff(time) <= 0.0).all() or time[0] == time[-1]:
        return part, []
    columns = {index: values[::-1].copy() for index, values in part.columns.items()}
    text = "the newest row stands first in the file; the rows were turned over"
    return replace(part, columns=columns), [Finding("newest_first", "info", text)]


def _written(part: Part, clock: int) -> tuple[Part, list[Finding]]:
    """Leave out rows that were never written: zeros in all columns at the begin, and zeros of the clock behind it."""
    time = part.columns[clock]
    start = int(np.argmax(time != 0.0))
    if not (start > 1 or (time[start] > 0.0 and (time[start:] <= 0.0).any())):
        return part, []
    blank = np.all([np.nan_to_num(values[:start]) == 0.0 for values in part.columns.values()], axis=0)
    never = np.zeros(time.size, dtype=bool)
    if blank.sum() > 1:  # one may be the begin of a log
        never[:start] = blank
    for first, last in true_runs(time[start:] <= 0.0) + start if time[start] > 0.0 else ():
        never[first:last] = last - first > 1 or last == time.size
    if not never.any():
        return part, []
    columns = {index: values[~never] for index, values in part.columns.items()}
    text = f"{np.count_nonzero(never)} rows that were never written (zeros) were left out"
    return replace(part, columns=columns), [Finding("never_written", "info", text)]


def _counted_on(part: Part, clock: int) -> tuple[Part, list[Finding]]:
    """Let a clock go on that counts in 16, 24 or 32 bits and begins anew."""
    time = part.columns[clock]
    change = np.diff(time)
    falls = np.flatnonzero(change < 0.0)
    if not falls.size or falls.size >= np.count_nonzero(change > 0.0):
        return part, []
    usual = float(np.median(thinned(change[change > 0.0])))
    for most in _COUNTS:
        over = change[falls] + most
        if (over > 0.0).all() and (over < (LONGEST_GAP + 1.5) * usual).all() and usual < 1e-3 * most:
            later: FloatArray = time + most * np.concatenate(([0.0], np.cumsum(change < 0.0)))
            text = f"the clock is a counter that begins anew at {most:.10g}, {falls.size} time(s); it was counted on"
            columns = {**part.columns, clock: later}
            return replace(part, columns=columns), [Finding("counter_begins_anew", "info", text)]
    return part, []
