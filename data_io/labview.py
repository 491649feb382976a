"""Files of National Instruments: LabVIEW measurement files, channels in pairs, TDMS (npTDMS, optional extra `tdms`)."""

import io
import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from data_io.clock import CLOCK, seconds_apart, with_clocks_of_channels, with_even_clock
from data_io.columns import Name, match_names, parse_name, shown, with_unit
from data_io.contents import Contents, Part
from data_io.layout import Head, is_row, line_at
from data_io.source import Request, Source
from data_io.table import Table, read_below, read_tables
from data_io.text import as_utf8, looks_like_text, read_date, split, to_number
from data_io.values import Finding, FloatArray

# LabVIEW measurement files (.lvm).

_LVM: Final = b"LabVIEW Measurement"
_BREAK = re.compile(r"\*\*\*End_of_Header\*\*\*|Channels\b")
_TAG = re.compile(
    r"(?:LabVIEW Measurement|[XY]_Dimension|[XY]_Unit_Label|X0|Delta_X|Samples|Channels|Date|Test_\w*|Time[\t,]+\d)"
)


def is_lvm(head: bytes) -> bool:
    """Tell an .lvm by its first words."""
    return looks_like_text(head) and head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(_LVM)


def read_lvm(source: Source, request: Request) -> Contents:
    """Read a LabVIEW measurement file, versions 1 and 2 of the writer. Raises `LogError`.

    Layout: `key TAB value` lines, `***End_of_Header***`, per segment `Channels`, `Date`, `Time`, `X0`, `Delta_X`,
    again `***End_of_Header***`, names that begin with X_Value, rows. Each segment is a step.
    Quirks: the clock is the column X_Value, or with `X_Columns No` an empty first field and X0 + Delta_X * row; each
    channel has an X0, a Delta_X and a time of its start, and where they differ a clock of its own; `Decimal_Separator`
    may be a comma; units stand as suffix of the name (fx_N); a last column Comment, mostly empty.
    """
    tables, _ = read_tables(source, request, breaks=_BREAK, never=_TAG)
    items = _items(tables[0].preamble)
    parts = [_lvm_part(table, {**items, **_items(table.preamble)}, i) for i, table in enumerate(tables, start=1)]
    metadata = {key: values[0] for key, values in items.items() if values and values[0]}
    return Contents(parts, metadata, [remark for table in tables for remark in table.remarks])


def _lvm_part(table: Table, items: dict[str, list[str]], number: int) -> Part:
    started = read_date(f"{(items.get('Time') or [''])[0]} {(items.get('Date') or [''])[0]}")
    part = Part(1, number, table.header, table.columns, started=started)
    names = table.header.names
    starts: list[float] = []  # of each channel [s], from the first one on
    if (items.get("Time_Pref") or ["Relative"])[0] != "Absolute":  # else X counts from a date of its own
        moments = zip(filter(None, items.get("Time", ())), filter(None, items.get("Date", ())), strict=False)
        starts = seconds_apart([f"{time} {date}" for time, date in moments])
    begins, intervals = _numbers(items.get("X0", ())), _numbers(items.get("Delta_X", ()))
    if max(len(set(starts)), len(set(intervals)), len(set(begins))) > 1:
        if (items.get("X_Columns") or ["One"])[0] == "Multi":
            # X_Value columns count from the start of the first channel, not each from its own
            clocks = [i for i, name in enumerate(names) if name.key == "xvalue"]
            moved = {i: part.columns[i] + s for i, s in zip(clocks, starts, strict=False) if i in part.columns}
            part = replace(part, columns={**part.columns, **moved})
        else:
            channels = {i: v for i, v in part.columns.items() if names[i].key not in ("xvalue", "comment")}
            firsts, own = begins or [0.0], starts or [0.0]
            begins = [firsts[min(i, len(firsts) - 1)] + own[min(i, len(own) - 1)] for i in range(len(channels))]
            part = with_clocks_of_channels(replace(part, columns=channels), begins, intervals)
    index = part.header.roles.get("time")
    column = None if index is None else part.columns.get(index)
    if (column is None or not np.isfinite(column).any()) and intervals and intervals[0] > 0:
        part = with_even_clock(part, begins[0] if begins else 0.0, intervals[0], CLOCK)
    header = part.header
    if (items.get("X_Dimension") or ["Time"])[0] == "Time":
        for index in (header.roles.get("time"), *header.passed_over.get("time", ())):
            if index is not None and not header.names[index].unit:
                header = with_unit(header, index, "s")
    return replace(part, header=header)


def _items(lines: Sequence[str]) -> dict[str, list[str]]:
    """Return what `key TAB value TAB value` lines say; a comma may stand for the tab."""
    split = (re.split(r"[\t,]", line) if "\t" not in line else line.split("\t") for line in lines)
    return {fields[0].strip(): [field.strip() for field in fields[1:]] for fields in split if fields[0].strip()}


def _numbers(fields: Sequence[str]) -> list[float]:
    numbers = (to_number(field, "," if "," in field else ".") for field in fields if field)
    return [number for number in numbers if number is not None and math.isfinite(number)]


# National Instruments text with a head of pairs for each channel: `Channel name,"Force",Channel name,"Input 1"`.

_CHANNEL_NAMES: Final = re.compile(rb"(?:^|[\r\n])\"?Channel name\"?([,;\t])", re.IGNORECASE)
_KEYS: Final = ("channel name", "unit", "interval", "timestamp")
_LONGEST_HEAD: Final = 50


def is_ni_channels(head: bytes) -> bool:
    """Tell by a line of channel names in pairs with their key."""
    here = b"channel name" in head.lower()  # a thirtieth of the time that the expression takes
    return here and looks_like_text(head) and _CHANNEL_NAMES.search(head) is not None


def read_ni_channels(source: Source, request: Request) -> Contents:
    """Read the channels that NI programmes write beside each other. Raises `LogError`.

    Layout: lines `Timestamp`, `Interval`, `Channel name`, `Unit`, each key once for every channel; rows with a time
    [s] before each value, or values alone at the interval. Signals are mostly in volts, which need a scale:
    `--columns friction_force=Force --units "friction_force=2.5 N/V"`.
    """
    match = _CHANNEL_NAMES.search(source.head)
    assert match is not None
    delimiter = match[1].decode()
    data = as_utf8(source.read())
    header, place, width = _head(source, data, delimiter)
    channels = header.get("channel name", [])
    if width not in (len(channels), 2 * len(channels)):
        raise source.error(
            f"rows of {width} fields were found below {len(channels)} channel names; one field for each, or a time "
            "and a value for each, were expected; export again"
        )
    units = itertools.chain(header.get("unit", []), itertools.repeat(""))
    names = [Name(channel, channel, unit or None) for channel, unit in zip(channels, units, strict=False)]
    if width == 2 * len(channels):
        names = [name for channel in names for name in (Name("Time", "Time", "s"), channel)]
    head = Head(match_names(tuple(names), request.columns), place, delimiter, width)
    table = read_below(source, request, data, head)
    part = Part(1, 1, head.header, table.columns)
    starts = seconds_apart(header.get("timestamp", []))
    if width == 2 * len(channels):
        clocks = {2 * i: start for i, start in enumerate(starts) if start and 2 * i in part.columns}
        part = replace(part, columns={**part.columns, **{i: part.columns[i] + start for i, start in clocks.items()}})
    else:
        intervals = [to_number(field, ".") or 0.0 for field in header.get("interval", [])]
        part = with_clocks_of_channels(part, starts, intervals)
    about = {key: ", ".join(values) for key, values in header.items()}
    return Contents([part], about, table.remarks)


def _head(source: Source, data: bytes, delimiter: str) -> tuple[dict[str, list[str]], int, int]:
    """Return what stands for each channel by key, where the rows begin, and their number of fields."""
    channels: dict[str, list[str]] = {}
    position = 0
    for _ in range(_LONGEST_HEAD):
        line, after = line_at(data, position)
        fields = split(line, delimiter)
        if "channel name" in channels and is_row(fields) and fields[0].lower() not in _KEYS:
            return channels, position, len(fields)
        if fields and fields[0].strip('\ufeff"').lower() in _KEYS:
            channels[fields[0].strip('\ufeff"').lower()] = fields[1::2]
        position = after
    raise source.error(
        f"no rows of numbers were found within {_LONGEST_HEAD} lines of channel names; they were expected; export again"
    )


# LabVIEW TDMS files, read by npTDMS (optional extra `tdms`).

_SCALE_TYPE: Final = re.compile(r"NI_Scale\[\d+\]_Scale_Type")
_SCALES: Final = frozenset(
    ("Polynomial", "Linear", "RTD", "Strain", "Table", "Thermistor", "Thermocouple", "Add", "Subtract")
)
"""Scalings that npTDMS applies; others it passes over with a line in its log."""
_UNITS: Final = ("unit_string", "NI_UnitDescription", "Unit", "unit", "Units", "units")


def read_tdms(source: Source, request: Request) -> Contents:
    """Read the groups of a TDMS that hold a friction force, each as a run. Raises `LogError`.

    Layout: channels in groups, their unit in a property, their clock as start and increment (waveforms) or as a channel
    of times; channels may start apart or have other rates. Quirks: integers as the converter gave them, with several
    scalings to be applied in order: npTDMS does so, a kind that it does not know is refused, and integers without any
    have no unit but the one that --units gives.
    """
    try:
        import nptdms
        from nptdms.log import log_manager
    except ImportError as error:
        raise source.error(
            "a LabVIEW TDMS file needs the package npTDMS, which is not installed; install it with pip install npTDMS, "
            "or export the file as .lvm or text"
        ) from error
    with source.read_by_library("TDMS file", "copy it again"):
        messages = io.StringIO()  # what npTDMS writes to its log of a file that it reads as far as it can
        console = log_manager.console_handler.setStream(messages)
        try:
            with nptdms.TdmsFile.open(source.file()) as file:
                groups = [group for group in file.groups() if any(len(channel) for channel in group.channels())]
                parts = [_tdms_part(source, request, group, dict(file.properties)) for group in groups]
                about = {str(key): str(value) for key, value in file.properties.items()}
        finally:
            log_manager.console_handler.setStream(console)
    lost = [line.rpartition("] ")[2] for line in messages.getvalue().splitlines()]
    if not parts:
        why = f" ({lost[0]:.100})" if lost else ""
        raise source.error(
            f"the TDMS file holds no channel with samples{why}; forces were expected; copy it again, or record it again"
        )
    complete = [part for part in parts if "friction_force" in part.header.roles] or parts
    findings = [Finding("damaged_parts", "warning", f"parts of the file could not be read: {t:.200}") for t in lost]
    return Contents([replace(part, run=run) for run, part in enumerate(complete, start=1)], about, findings)


def _tdms_part(source: Source, request: Request, group: Any, of_file: dict[str, Any]) -> Part:
    names: list[Name] = []
    columns: dict[int, FloatArray] = {}
    starts: list[float] = []
    intervals: list[float] = []
    first: Any = None
    channels = [channel for channel in group.channels() if len(channel) and channel.dtype.kind in "fiu"]
    longest = max((len(channel) for channel in channels), default=0)
    for channel in channels:
        properties = {**of_file, **group.properties, **channel.properties}
        scales = [str(value) for key, value in properties.items() if _SCALE_TYPE.fullmatch(key)]
        if unknown := [scale for scale in scales if scale not in _SCALES]:
            raise source.error(
                f"channel {shown([channel.name])} holds numbers with a scaling of the kind {unknown[0]!r:.40}, which "
                "is not known; scaled numbers were expected; export the file as text from LabVIEW"
            )
        values = np.full(longest, np.nan)
        values[: len(channel)] = channel[:]
        name = parse_name(channel.name)
        unit = next((str(properties[key]) for key in _UNITS if properties.get(key)), None) or name.unit
        if channel.dtype.kind in "iu" and not scales:
            unit = None  # counts of a converter: they may be anything
        columns[len(names)] = values
        names.append(Name(channel.name, name.name, unit))
        start = properties.get("wf_start_time")
        first = start if first is None else first
        apart = 0.0 if start is None or first is None else (start - first) / np.timedelta64(1, "s")
        starts.append(float(apart) + float(properties.get("wf_start_offset", 0.0)))
        intervals.append(float(properties.get("wf_increment", 0.0)))
    part = Part(1, 1, match_names(tuple(names), request.columns), columns, {"group": str(group.name)})
    if "time" in part.header.roles or not intervals or min(intervals) <= 0:
        return part
    return with_clocks_of_channels(part, starts, intervals)
