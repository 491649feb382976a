"""Clocks: as loggers leave them, rounded stamps of even ones, gaps and repeated stamps, steps that restart."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.arrays import longest_run, thinned, true_runs
from data_io.contents import Contents, Part
from data_io.record import BLOCK, rising
from data_io.source import Request, Source
from data_io.values import LONGEST_GAP, Finding, FloatArray

# Clocks as loggers leave them: newest row first, rows that were never written, counters that begin anew.

_COUNTS: Final = tuple(2.0**bits * part for part in (1.0, 1e-3, 1e-6) for bits in (16, 24, 32))
"""What a counter of so many bits holds, in its own counts, thousands and millions of them."""


def with_sound_clocks(request: Request, contents: Contents) -> Contents:
    """Return contents in which the clock of each part goes on from row to row as far as the logger's way is known."""
    if contents.settled or request.rate is not None:
        return contents
    parts, findings = [], list(contents.findings)
    for part in contents.parts:
        clock = -1 if part.clocks else part.header.roles.get("time", -1)
        usable = clock in part.columns and part.rows > 2
        for repair in (_oldest_first, _written, _counted_on) if usable else ():
            part, notes = repair(part, clock)
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


# Stamps of an even clock on a grid: decimals, ticks of a timer, single precision.

_FEWEST: Final = 50  # rows from which an even clock is told from a few odd steps
_MATTERS: Final = 0.05  # of an interval: a coarser rounding moves samples noticeably
_NEAR: Final = 0.05  # of the grid by which intervals may miss its multiples: its decimals are rounded too
_LEVELS: Final = 12  # different intervals that a rounded even clock has at most; one that jitters has many
_STAMPS: Final = 20  # different stamps from which the line through rows that share them tells where each belongs
_ODD: Final = 3  # intervals unlike the usual one that a rounding makes at least; fewer are rows lost or repeated
_WITHIN: Final = 1.25  # steps of the grid that the line through an even clock may miss its stamps by, from end to end


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
    if _spread(time) <= _MATTERS * interval:
        return time, []
    change = np.diff(time)
    step = _grid(time)
    if not 2.0 * _MATTERS * interval < step <= max(2.0, time.size / _STAMPS) * interval:
        return time, []
    if np.count_nonzero(np.abs(change - np.median(change)) > _MATTERS * interval) < _ODD:
        return time, []
    places = np.arange(time.size)
    slope, begin = np.polyfit(places, time - time[0], 1)
    even = time[0] + begin + slope * places
    if np.ptp(time - even) > _WITHIN * step:
        return time, []
    text = (
        f"the time stamps{of_step} are rounded to {step:.4g} s; they are those of an even clock of {1.0 / slope:.5g} Hz"
    )
    return even, [Finding("clock_rounded", "info", f"{text}, which is used")]


def _spread(time: FloatArray) -> float:
    """By how much the intervals of a clock (n,) differ at most [s]. Block by block: those of ten million rows are made
    in the cache, not in memory."""
    blocks = (np.diff(time[i : i + BLOCK + 1]) for i in range(0, time.size - 1, BLOCK))
    ends = np.array([(block.min(), block.max()) for block in blocks])
    return float(ends[:, 1].max() - ends[:, 0].min())


def _grid(time: FloatArray) -> float:
    """Return the largest time [s] whose multiples all the intervals are, 0 where there is none.

    Of six significant digits the stamps beyond a power of ten keep one decimal less: the coarser step counts.
    """
    late = time[np.searchsorted(time, 10.0 ** np.floor(np.log10(max(float(time[-1]), 1e-12)))) :]
    change = np.diff(late if late.size >= _FEWEST else time)
    apart = _NEAR * float(np.mean(change))
    few = np.sort(thinned(change))
    levels = [float(group.mean()) for group in np.split(few, np.flatnonzero(np.diff(few) > apart) + 1)]
    if len(levels) > _LEVELS:
        return 0.0
    grid = min([*np.diff(levels).tolist(), *(level for level in levels if level > apart)], default=0.0)
    counts = change / grid if grid > 0 else np.array([0.5])
    return grid if float(np.max(np.abs(counts - np.round(counts)))) < _NEAR else 0.0


# One rising clock from the clocks of the steps: gaps in a clock, repeated stamps, restarts, starting times.

_MONTHS: Final = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_TIME = re.compile(r"(\d{1,2}):(\d\d):(\d\d)(?:[.,](\d+))?")
_WORD_DATE = re.compile(r"\b(\d{1,2})[ .-]+([A-Za-z]{3})[a-z]*\.?[ ,-]+(\d{4})\b")
_ISO_DATE = re.compile(r"\b(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})\b")
_NUMBER_DATE = re.compile(r"\b(\d{1,2})/(\d{1,2})/(\d{2,4})\b")
_REPEATS_ALLOWED: Final = 0.01


Rows = npt.NDArray[np.intp] | slice
"""Which rows of a step are kept; a slice where it is all of them, which copies nothing."""


@dataclass(frozen=True)
class StepClock:
    """The clock of one step [s] as the file has it, shape (n,), with NaN where it fails; when the step was started.

    label: "step 2" where there are several steps, else "". At least one row has a time.
    """

    label: str
    time: FloatArray
    started: datetime | None = None


def read_date(text: str) -> datetime | None:
    """Read `12:21:58.029 12 May 2022`, `2022-05-12 12:21:58` or `05/12/22 14:43:46` (month first); None elsewhere."""
    clock = _TIME.search(text)
    if clock is None:
        return None
    micro = int((clock[4] or "0")[:6].ljust(6, "0"))
    day, month, year = 1, 1, 2000
    if (word := _WORD_DATE.search(text)) and word[2].lower() in _MONTHS:
        day, month, year = int(word[1]), _MONTHS.index(word[2].lower()) + 1, int(word[3])
    elif iso := _ISO_DATE.search(text):
        year, month, day = int(iso[1]), int(iso[2]), int(iso[3])
    elif number := _NUMBER_DATE.search(text):
        month, day, year = int(number[1]), int(number[2]), int(number[3])
        year += 2000 if year < 100 else 0
    try:
        return datetime(year, month, day, int(clock[1]), int(clock[2]), int(clock[3]), micro)
    except ValueError:
        return None


def seconds_apart(stamps: Sequence[str]) -> list[float]:
    """Return when each of several channels was started [s], from the first one on; 0 where no date stands."""
    dates = [read_date(stamp) for stamp in stamps]
    first = next((date for date in dates if date is not None), None)
    return [0.0 if date is None or first is None else (date - first).total_seconds() for date in dates]


def usable_rows(source: Source, clock: StepClock) -> tuple[FloatArray, Rows, list[Finding]]:
    """Return a rising time, the rows of the step it belongs to, and what was noticed.

    Up to five rows in a row without a time get one by interpolation (their forces must be blanked: NaN rows of
    `clock.time`); without a neighbour they are left out. A repeated time stamp leaves its later row out. A clock that
    falls, or repeats itself in more than 1 % of the rows, is an error, unless it is an even one that was rounded.
    """
    findings: list[Finding] = []
    of_step = f" of {clock.label}" if clock.label else ""
    if clock.time.size and rising(clock.time):
        even, findings = evened(clock.time, of_step)
        return even, slice(None), findings
    finite = np.isfinite(clock.time)
    known = np.flatnonzero(finite)
    rows = np.arange(known[0], known[-1] + 1)
    lost = clock.time.size - known.size
    if longest_run(~finite) > LONGEST_GAP:
        row = int(np.argmin(finite))
        raise source.error(
            f"the time column{of_step} holds no number in {longest_run(~finite)} rows in a row (first such row: "
            f"{row + 1}); at most {LONGEST_GAP} are accepted; cut the log there or export it again"
        )
    time = clock.time[rows]
    if lost:
        time = np.interp(rows, known, clock.time[known])
        text = f"{lost} row(s){of_step} hold no time; they get no weight"
        findings.append(Finding("missing_time", "warning", text))
    if (np.diff(time) >= 0).all():
        even, notes = evened(time, of_step)
        if notes:  # rows share a stamp that was rounded
            return even, rows, [*findings, *notes]
    fresh = _fresh_rows(source, time, of_step)
    if not fresh.all():
        text = f"{np.count_nonzero(~fresh)} row(s){of_step} repeat the time of the row before; they were left out"
        findings.append(Finding("repeated_time", "warning", text))
    return time[fresh], rows[fresh], findings


def _fresh_rows(source: Source, time: FloatArray, of_step: str) -> npt.NDArray[np.bool_]:
    """Return which rows do not repeat the time of the row before; a clock that falls or mostly stands is an error."""
    change = np.diff(time, prepend=-np.inf)
    if (change < 0).any():
        row, falls = int(np.argmax(change < 0)), int(np.count_nonzero(change < 0))
        if 1 < falls <= np.count_nonzero(change > 0):
            raise source.error(
                f"the clock{of_step} restarts {falls} times in {time.size} rows, first in row {row + 1} of the numbers "
                f"({time[row - 1]:.9g} s, then {time[row]:.9g} s); one rising clock was expected; if the rows follow "
                "each "
                'other evenly, give their rate, as in --rate "100 Hz", else export again with a clock that goes on'
            )
        raise source.error(
            f"the clock{of_step} falls from {time[row - 1]:.9g} s to {time[row]:.9g} s in row {row + 1} of the "
            "numbers; a rising clock was expected, restarting only below a step header; cut or repair the log there"
        )
    repeated = int(np.count_nonzero(change == 0))
    if repeated > max(LONGEST_GAP, _REPEATS_ALLOWED * time.size):
        raise source.error(
            f"the clock{of_step} repeats itself in {100 * repeated / time.size:.0f} % of the rows; a rising one was "
            "expected; export the time with more digits, or, if the rows follow each other evenly, give their rate, as "
            f'in --rate "{(time.size - 1) / max(float(time[-1] - time[0]), 1e-9):.4g} Hz"'
        )
    return change > 0


def joined(clocks: Sequence[StepClock]) -> tuple[list[float], list[Finding]]:
    """Return what to add to each step's (usable, non-empty) clock for one rising clock, and what was noticed.

    A step that goes on where the last one ended keeps its clock. Where the clock restarts, the starting times give the
    gap; without them, or where they would overlap, the step is put one sampling interval behind, with a finding.
    """
    offsets = [0.0]
    overlapping: list[str] = []
    untold: list[str] = []
    anchor = 0
    for i in range(1, len(clocks)):
        last, here = clocks[i - 1], clocks[i]
        end = offsets[-1] + float(last.time[-1])
        if here.time[0] > last.time[-1]:
            offsets.append(offsets[-1])
            continue
        before, now = clocks[anchor].started, here.started
        told = None if before is None or now is None else offsets[anchor] + _seconds(before, now)
        if told is not None and told + here.time[0] > end:
            offsets.append(told)
        else:
            (untold if told is None else overlapping).append(here.label)
            offsets.append(end + _typical_step(last.time, here.time) - float(here.time[0]))
        anchor = i
    findings = []
    if overlapping:
        text = f"by the starting times {_some(overlapping)} began before the step above ended; put right behind it"
        findings.append(Finding("step_overlap", "warning", text))
    if untold:
        text = f"the log does not tell the pause before {_some(untold)}; one sampling interval was assumed"
        findings.append(Finding("step_gap_unknown", "warning", text))
    return offsets, findings


def _some(labels: Sequence[str]) -> str:
    return ", ".join(labels[:3]) + (f" and {len(labels) - 3} more" if len(labels) > 3 else "")


def _typical_step(*times: FloatArray) -> float:
    steps = [float(np.median(np.diff(time))) for time in times if time.size > 1]
    return steps[0] if steps else 1.0


def _seconds(before: datetime, now: datetime) -> float:
    seconds = (now - before).total_seconds()
    # without a date both stand on the same day: past midnight the clock of the day restarts
    return seconds + 86400.0 if seconds < 0 and before.year == 2000 == now.year else seconds
