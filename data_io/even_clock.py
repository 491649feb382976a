"""Even clocks for logs without a time column: the interval stands above the rows, or the user gave the rate."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from data_io.columns import Header, Name
from data_io.frozen import Finding, FloatArray
from data_io.opened_table import Table
from data_io.part import Contents
from data_io.source import Request, Source

CLOCK: Final = "X_Value"
"""Name of a clock that stands in no column."""


def with_even_clock(table: Table, start: float, interval: float, name: str) -> Table:
    """Return the table with a time column [s]: start + interval * row; it takes the place of an empty time column."""
    rows = max((values.size for values in table.columns.values()), default=0)
    time = start + interval * np.arange(rows, dtype=np.float64)
    header = table.header
    index = header.roles.get("time")
    if index is None:
        index = len(header.names)
        names = (*header.names, Name(name, name, "s"))
        header = Header(names, {**header.roles, "time": index}, header.passed_over)
    return replace(table, header=header, columns={**table.columns, index: time})


def with_clocks_of_channels(
    header: Header, columns: Mapping[int, FloatArray], starts: Sequence[float], intervals: Sequence[float]
) -> tuple[Header, dict[int, FloatArray], dict[int, int]]:
    """Return header, columns, and which clock is whose, with an even clock [s] for every channel.

    starts, intervals [s]: one for each column in the order of their indices; the last one stands for the rest.
    """
    names, made = list(header.names), dict(columns)
    clocks: dict[int, int] = {}
    for place, channel in enumerate(sorted(columns)):
        start, interval = (told[min(place, len(told) - 1)] if told else 0.0 for told in (starts, intervals))
        clock = len(names)
        names.append(Name(CLOCK, CLOCK, "s"))
        made[clock] = start + interval * np.arange(columns[channel].size, dtype=np.float64)
        clocks |= {channel: clock, clock: clock}
    roles = {**header.roles, "time": clocks[min(columns)]} if columns else header.roles
    return replace(header, names=tuple(names), roles=roles), made, clocks


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
        index = len(part.header.names)
        names = (*part.header.names, Name("rate", "given rate", "s"))
        passed = {role: others for role, others in part.header.passed_over.items() if role != "time"}
        header = Header(names, {**part.header.roles, "time": index}, passed)
        columns = {**part.columns, index: interval * np.arange(part.rows, dtype=np.float64)}
        parts.append(replace(part, header=header, columns=columns, clocks={}))
    text = f"the clock was made from the rate of {request.rate:g} Hz that was given"
    findings = [*contents.findings, Finding("clock_from_rate", "info", text)]
    return replace(contents, parts=parts, findings=findings)
