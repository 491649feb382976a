"""Clocks that stand in no column, and columns that bring a clock of their own."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from data_io.arrays import same, thinned_steps
from data_io.columns import Header, Name, match_names, role_of, shown
from data_io.contents import Contents, Part, with_column
from data_io.source import Request, Source
from data_io.units import factor
from data_io.values import COLUMN_ROLES, LONGEST_GAP, Finding, FloatArray, UnitError

# Even clocks for logs without a time column: the interval stands above the rows, or the user gave the rate.

_FEWEST: Final = 10
"""Values from which on a column with blanks between them is one that is sampled slower."""
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
        start, interval = (told[min(place, len(told) - 1)] if told else 0.0 for told in (starts, intervals))
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
    by
    columns of another kind; time columns of different names (`Time`, `Test time`) tell the time of the same rows.
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
        told = np.any([np.isfinite(values) for values in columns.values()], axis=0)
        rows = int(np.flatnonzero(told)[-1]) + 1 if told.any() else 0
        columns = {place: values[:rows].copy() for place, values in columns.items()}
        place = {"table": f"columns {kept[0] + 1} to {kept[-1] + 1}"}
        header = match_names(names, {})
        tables.append(replace(part, header=header, columns=columns, clocks={}, run_items={**part.run_items, **place}))
    return tables


def _with_clocks_of_slow_columns(request: Request, part: Part) -> Part:
    """Return a part in which forces and drive that stand in every so many-th row only have these rows for their clock.

    Loggers write a channel that is sampled slower with blanks between its values, or two channels row by row by turns.
    """
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
        known = np.isfinite(part.columns[index])
        rows = np.flatnonzero(known) if not known.all() else np.empty(0)
        if rows.size >= _FEWEST and np.median(np.diff(rows)) >= 2:
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
    """Return the values (n,) sampled at `clock` (n,) at other times (m,), and how many of these lie in gaps.

    NaN outside, and in gaps of more than `LONGEST_GAP` rows.
    """
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
