"""Clocks: as loggers leave them, rounded stamps of even ones, gaps and repeated stamps, steps that restart."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.arrays import longest_run, same, thinned, thinned_steps, true_runs
from data_io.columns import Header, Name, match_names, role_of, shown
from data_io.contents import Contents, Part, with_column
from data_io.record import rises, step_range
from data_io.source import Request, Source
from data_io.text import read_date
from data_io.units import factor
from data_io.values import COLUMN_ROLES, LONGEST_GAP, Finding, FloatArray, UnitError, listed

# Clocks as loggers leave them.

_COUNTS: Final = tuple(2.0**bits * part for part in (1.0, 1e-3, 1e-6) for bits in (16, 24, 32))
"""What a counter of so many bits holds, in its own counts, thousands and millions of them."""


def with_sound_clocks(request: Request, contents: Contents) -> Contents:
    """Return contents in which the clock of each part goes on from row to row as far as the logger's way is known.

    Rows of which the newest stands first are turned over; rows that were never written (zeros in all columns at the
    begin, zeros of the clock behind it) are left out; a counter of 16, 24 or 32 bits that begins anew is counted on.
    """
    if contents.settled or request.rate is not None:
        return contents
    parts, findings = [], list(contents.findings)
    for part in contents.parts:
        clock = -1 if part.clocks else part.header.roles.get("time", -1)
        if clock not in part.columns or part.rows < 3 or rises(part.columns[clock]):
            parts.append(part)
            continue
        columns, time = dict(part.columns), part.columns[clock]
        if np.isfinite(time).all() and (np.diff(time) <= 0.0).all() and time[0] != time[-1]:
            columns = {index: values[::-1].copy() for index, values in columns.items()}
            text = "the newest row stands first in the file; the rows were turned over"
            findings.append(Finding("newest_first", "info", text))
        time = columns[clock]
        start, never = int(np.argmax(time != 0.0)), np.zeros(time.size, dtype=bool)
        if start > 1:  # one row of zeros may be the begin of a log
            blank = np.all([np.nan_to_num(values[:start]) == 0.0 for values in columns.values()], axis=0)
            never[:start] = blank & (blank.sum() > 1)
        for first, last in true_runs(time[start:] <= 0.0) + start if time[start] > 0.0 else ():
            never[first:last] = last - first > 1 or last == time.size
        if never.any():
            columns = {index: values[~never] for index, values in columns.items()}
            text = f"{np.count_nonzero(never)} rows that were never written (zeros) were left out"
            findings.append(Finding("never_written", "info", text))
        change = np.diff(time := columns[clock])
        falls, steps = np.flatnonzero(change < 0.0), change[change > 0.0]
        usual = float(np.median(thinned(steps))) if 0 < falls.size < steps.size else np.inf
        for most in _COUNTS:
            over = change[falls] + most
            if usual < 1e-3 * most and (over > 0.0).all() and (over < (LONGEST_GAP + 1.5) * usual).all():
                columns[clock] = time + most * np.concatenate(([0.0], np.cumsum(change < 0.0)))
                text = f"the clock is a counter that restarts at {most:.10g}, {falls.size} time(s); it was counted on"
                findings.append(Finding("counter_begins_anew", "info", text))
                break
        parts.append(replace(part, columns=columns))
    return replace(contents, parts=parts, findings=findings)


# Stamps of an even clock on a grid: decimals, ticks of a timer, single precision.

_FEWEST: Final = 50  # rows from which an even clock and a few odd steps differ
_MATTERS: Final = 0.05  # of an interval: a coarser rounding moves samples noticeably
_NEAR: Final = 0.05  # of the grid by which intervals may miss its multiples: its decimals are rounded too
_WITHIN: Final = 1.25  # steps of the grid that the line through an even clock may miss its stamps by, from end to end


def evened(time: FloatArray, of_step: str = "") -> tuple[FloatArray, list[Finding]]:
    """Return a clock (n,) [s] that does not fall, even where its stamps are those of an even one that was rounded, and
    what to say.

    A clock of 800 Hz that is written in milliseconds has steps of 1 and 2 ms, and moves samples by up to half of one.
    No stamp of an even clock is further than half a rounding step from where it belongs, and no two of its intervals
    differ by more than a step; a clock that jitters more, or has gaps, is left as it is. Rows may share a stamp where
    the step is longer than the interval.
    """
    if time.size < _FEWEST:
        return time, []
    interval = float(time[-1] - time[0]) / (time.size - 1)
    change = np.diff(time)
    step = _grid(time)
    if not 2.0 * _MATTERS * interval < step <= max(2.0, time.size / 20) * interval:  # 20 stamps show the line
        return time, []
    if np.count_nonzero(np.abs(change - np.median(change)) > _MATTERS * interval) < 3:  # rows lost or repeated
        return time, []
    places = np.arange(time.size)
    slope, begin = np.polyfit(places, time - time[0], 1)
    even = time[0] + begin + slope * places
    if np.ptp(time - even) > _WITHIN * step or np.ptp(change) > 1.5 * step:
        return time, []
    text = (
        f"the time stamps{of_step} are rounded to {step:.4g} s; they are those of an even clock of {1.0 / slope:.5g} Hz"
    )
    return even, [Finding("clock_rounded", "info", f"{text}, which is used")]


def _grid(time: FloatArray) -> float:
    """Return the largest time [s] whose multiples all the intervals are, 0 where there is none."""
    late = time[np.searchsorted(time, 10.0 ** np.floor(np.log10(max(float(time[-1]), 1e-12)))) :]
    change = np.diff(late if late.size >= _FEWEST else time)
    apart = _NEAR * float(np.mean(change))
    few = np.sort(thinned(change))
    levels = [float(group.mean()) for group in np.split(few, np.flatnonzero(np.diff(few) > apart) + 1)]
    if len(levels) > 12:  # it jitters
        return 0.0
    grid = min([*np.diff(levels).tolist(), *(level for level in levels if level > apart)], default=0.0)
    counts = change / grid if grid > 0 else np.array([0.5])
    return grid if float(np.max(np.abs(counts - np.round(counts)))) < _NEAR else 0.0


# One rising clock from the clocks of the steps: gaps in a clock, repeated stamps, restarts, starting times.

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
    least, most = step_range(clock.time)
    if least > 0.0 and most < np.inf:
        interval = float(clock.time[-1] - clock.time[0]) / (clock.time.size - 1)
        even, findings = (clock.time, findings) if most - least <= _MATTERS * interval else evened(clock.time, of_step)
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
    change = np.diff(time, prepend=-np.inf)
    if (change < 0).any():
        row, falls = int(np.argmax(change < 0)), int(np.count_nonzero(change < 0))
        if 1 < falls <= np.count_nonzero(change > 0):
            raise source.error(
                f"the clock{of_step} restarts {falls} times in {time.size} rows, first in row {row + 1} of the numbers "
                f"({time[row - 1]:.9g} s, then {time[row]:.9g} s); one rising clock was expected; if the rows follow "
                'each other evenly, give their rate, as in --rate "100 Hz", else export again with a clock that goes on'
            )
        raise source.error(
            f"the clock{of_step} falls from {time[row - 1]:.9g} s to {time[row]:.9g} s in row {row + 1} of the "
            "numbers; a rising clock was expected, restarting only below a step header; cut or repair the log there"
        )
    repeated = int(np.count_nonzero(change == 0))
    if repeated > max(LONGEST_GAP, 0.01 * time.size):
        raise source.error(
            f"the clock{of_step} repeats itself in {100 * repeated / time.size:.0f} % of the rows; a rising one was "
            "expected; export the time with more digits, or, if the rows follow each other evenly, give their rate, as "
            f'in --rate "{(time.size - 1) / max(float(time[-1] - time[0]), 1e-9):.4g} Hz"'
        )
    if repeated:
        text = f"{repeated} row(s){of_step} repeat the time of the row before; they were left out"
        findings.append(Finding("repeated_time", "warning", text))
    return time[change > 0], rows[change > 0], findings


def joined(clocks: Sequence[StepClock]) -> tuple[list[float], list[Finding]]:
    """Return what to add to each step's (usable, non-empty) clock for one rising clock, and what was noticed.

    A step that goes on where the last one ended keeps its clock. Where the clock restarts, the starting times give the
    gap; without them, or where they would overlap, the step is put one sampling interval behind, with a finding.
    """
    offsets = [0.0]
    overlapping: list[str] = []
    unstated: list[str] = []
    anchor = 0
    for i in range(1, len(clocks)):
        last, here = clocks[i - 1], clocks[i]
        end = offsets[-1] + float(last.time[-1])
        if here.time[0] > last.time[-1]:
            offsets.append(offsets[-1])
            continue
        before, now = clocks[anchor].started, here.started
        begin = None
        if before is not None and now is not None:
            pause = (now - before).total_seconds()
            # without a date both stand on the same day: past midnight the clock of the day restarts
            begin = offsets[anchor] + pause + (86400.0 if pause < 0 and before.year == 2000 == now.year else 0.0)
        if begin is not None and begin + here.time[0] > end:
            offsets.append(begin)
        else:
            (unstated if begin is None else overlapping).append(here.label)
            steps = next((np.diff(time) for time in (last.time, here.time) if time.size > 1), np.ones(1))
            offsets.append(end + float(np.median(steps)) - float(here.time[0]))
        anchor = i
    findings = []
    if overlapping:
        text = f"by the starting times {listed(overlapping, most=3)} began before the step above ended; put behind it"
        findings.append(Finding("step_overlap", "warning", text))
    if unstated:
        text = f"the pause before {listed(unstated, most=3)} is not stated; one sampling interval was assumed"
        findings.append(Finding("step_gap_unknown", "warning", text))
    return offsets, findings


# Even clocks for logs without a time column: the interval stands above the rows, or the user gave the rate.

CLOCK: Final = "X_Value"
"""Name of a clock that stands in no column."""


def with_even_clock(part: Part, start: float, interval: float, name: str) -> Part:
    """Return a step with a time column [s]: start + interval * row; it takes the place of an empty time column."""
    rows = max((values.size for values in part.columns.values()), default=0)
    time = start + interval * np.arange(rows, dtype=np.float64)
    index = part.header.roles.get("time")
    if index is None:
        return with_column(part, "time", Name(name, name, "s"), time)
    return replace(part, columns={**part.columns, index: time})


def with_clocks_of_channels(part: Part, starts: Sequence[float], intervals: Sequence[float]) -> Part:
    """Return a step in which every column has an even clock [s] of its own.

    starts, intervals [s]: one for each column in the order of their indices; the last one stands for the rest.
    """
    columns, clocks = part.columns, dict(part.clocks)
    for place, channel in enumerate(sorted(columns)):
        start, interval = (given[min(place, len(given) - 1)] if given else 0.0 for given in (starts, intervals))
        clock = len(part.header.names)
        time = start + interval * np.arange(columns[channel].size, dtype=np.float64)
        part = with_column(part, "time", Name(CLOCK, CLOCK, "s"), time)
        clocks |= {channel: clock, clock: clock}
    roles = {**part.header.roles, "time": clocks[min(columns)]} if columns else part.header.roles
    return replace(part, header=replace(part.header, roles=roles), clocks=clocks)


def with_clock_of_rate(source: Source, request: Request, contents: Contents) -> Contents:
    """Return contents whose clock the user made by the sampling rate; a time column of the file becomes a channel."""
    if request.rate is None:
        return contents
    if "time" in request.columns:
        raise source.error(
            "a time column and a sampling rate were given; one clock was expected; leave one of them out"
        )
    interval = 1.0 / request.rate
    parts = []
    for part in contents.parts:
        passed = {role: others for role, others in part.header.passed_over.items() if role != "time"}
        part = replace(part, header=replace(part.header, passed_over=passed), clocks={})
        time = interval * np.arange(part.rows, dtype=np.float64)
        parts.append(with_column(part, "time", Name("rate", "given rate", "s"), time))
    text = f"the clock was made from the rate of {request.rate:g} Hz that was given"
    findings = [*contents.findings, Finding("clock_from_rate", "info", text)]
    return replace(contents, parts=parts, findings=findings)


# Loggers write a time column beside every channel (NI, LabVIEW with `X_Columns Multi`, spreadsheets pasted together).
# Row by row such channels do not belong together; by time they do.


def on_one_clock(source: Source, request: Request, contents: Contents) -> Contents:
    """Return contents whose parts have one clock each: channels paired by time, tables side by side as runs.

    The clock is that of the friction force. Other columns are interpolated to it, no further than `LONGEST_GAP` of
    their rows apart; rows for which the clock of the normal force does not tell it are cut off with a finding.
    Raises the source's `LogError` where clocks do not meet or do not rise.
    """
    if contents.settled:
        return contents
    one = "time" in request.columns or request.rate is not None
    apart = [[part] if one else _side_by_side(part) for part in contents.parts]
    findings = list(contents.findings)
    runs = max((part.run for part in contents.parts), default=1)
    parts = [replace(table, run=table.run + i * runs) for tables in apart for i, table in enumerate(tables)]
    if (most := max(map(len, apart), default=1)) > 1:
        names = next(shown((n.raw for n in tables[1].header.names), most=4) for tables in apart if len(tables) > 1)
        text = f"{most} tables stand side by side ({names} again); each is a run of its own: choose one with --run"
        findings.append(Finding("tables_side_by_side", "warning", text))
    paired = []
    for part in parts:
        own = {} if one else part.clocks or clocks_by_place(part.header, part.columns)
        part = replace(part, clocks=own) if own else _with_clocks_of_slow_columns(request, part)
        part, notes = _paired(source, request, part)
        paired.append(part)
        findings += notes
    return replace(contents, parts=paired, findings=findings)


def clocks_by_place(header: Header, columns: Mapping[int, FloatArray]) -> dict[int, int]:
    """Return for every column the index of the time column that stands before it; empty where one clock serves all.

    Clocks are the columns of one name for the time (`Time [s]`, `Time [s]`, or `X_Value`, `X_Value.1`), each followed
    by columns of another kind; time columns of different names (`Time`, `Test time`) tell the time of the same rows.
    """
    first = header.roles.get("time")
    if first is None or "time" not in header.passed_over:
        return {}
    key = header.names[first].key
    starts = [i for i in sorted((first, *header.passed_over["time"])) if header.names[i].key == key and i in columns]
    ends = [*starts[1:], len(header.names)]
    filled = [i for i in columns if i not in starts and role_of(header.names[i].name) != "time"]
    starts = [a for a, b in zip(starts, ends, strict=True) if any(a < i < b for i in filled)]
    if len(starts) < 2:
        return {}
    own = {i: max((a for a in starts if a <= i), default=starts[0]) for i in columns}
    return own if len({id(columns[a]) for a in starts}) > 1 else {}


def _side_by_side(part: Part) -> list[Part]:
    """Return the tables of a part that holds several beside each other, each with all its columns; else the part."""
    own = {} if part.clocks else clocks_by_place(part.header, part.columns)
    friction = part.header.roles.get("friction_force")
    if not own or friction is None:
        return [part]
    key = part.header.names[friction].key
    twins = [i for i, name in enumerate(part.header.names) if name.key == key and i in own]
    starts = sorted({own[i] for i in twins})
    if len(starts) < 2 or all(same(part.columns[twins[0]], part.columns[i]) for i in twins[1:]):
        return [part]
    tables = []
    for a, b in pairwise([0, *starts[1:], len(part.header.names)]):
        kept = [i for i, values in part.columns.items() if a <= i < b and np.isfinite(values).any()]
        names = tuple(part.header.names[i] for i in kept)
        columns = {place: part.columns[i] for place, i in enumerate(kept)}
        known = np.any([np.isfinite(values) for values in columns.values()], axis=0)
        rows = int(np.flatnonzero(known)[-1]) + 1 if known.any() else 0
        columns = {place: values[:rows].copy() for place, values in columns.items()}
        place = {"table": f"columns {kept[0] + 1} to {kept[-1] + 1}"}
        header = match_names(names, {})
        tables.append(replace(part, header=header, columns=columns, clocks={}, run_items={**part.run_items, **place}))
    return tables


def _with_clocks_of_slow_columns(request: Request, part: Part) -> Part:
    """Return a part in which columns with numbers in every so many-th row only have these rows for their clock."""
    clock = part.header.roles.get("time")
    if clock is None or clock not in part.columns:
        return part
    clocks: dict[int, int] = {}
    columns, names = dict(part.columns), part.header.names
    for role in COLUMN_ROLES[1:]:
        index = part.header.roles.get(role)
        if index is None or index not in part.columns or (role == "normal_force" and request.normal_force is not None):
            continue
        clocks[index] = clock
        if np.isfinite(np.sum(part.columns[index])):  # the common case, without a copy
            continue
        known = np.isfinite(part.columns[index])
        rows = np.flatnonzero(known)
        if rows.size >= 10 and np.median(np.diff(rows)) >= 2:
            clocks |= {index: len(names), len(names): len(names)}
            columns[len(names)] = np.where(known, part.columns[clock], np.nan)
            names = (*names, names[clock])
    if len(names) == len(part.header.names):
        return part
    return replace(part, header=replace(part.header, names=names), columns=columns, clocks=clocks)


def _paired(source: Source, request: Request, part: Part) -> tuple[Part, list[Finding]]:
    """Return a part with every column on the clock of its friction force, and what was done."""
    roles, own, names = part.header.roles, part.clocks, part.header.names
    if roles.get("friction_force") not in own:
        return part, []
    clock = own[roles["friction_force"]]
    others = sorted({own[i] for i in own} - {clock})
    others = [i for i in others if not same(part.columns[i], part.columns[clock])]
    if not others:
        return replace(part, clocks={}), []
    times = {i: _like(source, part, i, clock) for i in (clock, *others)}
    rows = np.flatnonzero(np.isfinite(times[clock]))
    time = times[clock][rows]
    columns, missed = {}, 0
    moved = [i for i in part.columns if own.get(i, clock) in others and i not in others]
    for i, values in part.columns.items():
        if i in moved:
            columns[i], between = _at(time, times[own[i]], values)
            missed = max(missed, between)
        elif i not in others:
            columns[i] = values[rows]
    inside = np.ones(time.size, bool)
    for role in ("normal_force", "drive_speed"):
        index = roles.get(role, -1)
        if index not in moved or (role == "normal_force" and request.normal_force is not None):
            continue
        known = np.flatnonzero(np.isfinite(columns[index]))
        if known.size < 2:
            (a, b), (c, d) = ((np.nanmin(times[i]), np.nanmax(times[i])) for i in (clock, own[index]))
            raise source.error(
                f"the clock of {names[roles['friction_force']].raw!r} runs from {a:.6g} to {b:.6g}, that of "
                f"{names[index].raw!r} from {c:.6g} to {d:.6g}; clocks that overlap were expected; export the channels "
                "together, or give a constant load with --normal-force"
            )
        inside[: known[0]] = inside[known[-1] + 1 :] = False
    text = (
        f"{shown((names[i].raw for i in moved), most=6)} {'has' if len(moved) == 1 else 'have'} a clock apart from "
        f"that of {names[roles['friction_force']].raw!r}; paired by time, between the samples by straight lines"
    )
    notes = [Finding("own_clocks", "info", text)]
    if missed:
        text = f"{missed} rows lie in gaps of a clock that they were paired with, and hold what is between its ends"
        notes.append(Finding("paired_over_gaps", "warning", text))
    if not inside.all():
        columns = {i: values[inside] for i, values in columns.items()}
        lost = np.count_nonzero(~inside)
        text = f"{lost} rows of the friction force lie outside the time of the normal force; left out"
        notes.append(Finding("rows_without_partner", "warning", text))
    passed = {r: tuple(i for i in left if i not in others) for r, left in part.header.passed_over.items()}
    header = replace(part.header, roles={**roles, "time": clock}, passed_over={r: i for r, i in passed.items() if i})
    return replace(part, header=header, columns=columns, clocks={}), notes


def _like(source: Source, part: Part, index: int, other: int) -> FloatArray:
    """Return a clock in the unit of another one; NaN rows at its end stay. Raises where it does not rise."""
    unit, name = part.header.names[other].unit, part.header.names[index]
    values = part.columns[index]
    try:
        if name.unit and unit and name.unit != unit:
            values = values * factor(name.unit, "s") / factor(unit, "s")
    except UnitError as error:
        raise source.error(f"column {shown([name.raw])}: {error}") from error
    finite = values[np.isfinite(values)]
    if finite.size < 2 or not (np.diff(finite) >= 0).all():
        raise source.error(
            f"column {index + 1} ({shown([name.raw])}) is one of several clocks, and it does not rise; rising clocks "
            "were expected, so that the columns can be paired by time; repair it, or export the channels on one clock"
        )
    return values


def _at(time: FloatArray, clock: FloatArray, values: FloatArray) -> tuple[FloatArray, int]:
    """Return values (n,) at other times (m,), NaN outside and in long gaps, and how many of the times lie in gaps."""
    known = np.flatnonzero(np.isfinite(clock) & np.isfinite(values))
    if known.size < 2:
        return np.full(time.size, np.nan), 0
    stamps = clock[known]
    found = np.interp(time, stamps, values[known], left=np.nan, right=np.nan)
    place = np.clip(np.searchsorted(stamps, time), 1, stamps.size - 1)
    usual = float(np.median(thinned_steps(clock[np.isfinite(clock)])))
    apart = stamps[place] - stamps[place - 1]
    between = (apart > 1.5 * usual) & (time != stamps[place]) & (time != stamps[place - 1]) & np.isfinite(found)
    return np.where(apart > (LONGEST_GAP + 1.5) * usual, np.nan, found), int(np.count_nonzero(between))
