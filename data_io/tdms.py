"""LabVIEW TDMS files, read by npTDMS (optional extra `tdms`)."""

import io
import logging
import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

import numpy as np

from data_io.columns import Name, match_names, parse_name, shown
from data_io.even_clock import with_clocks_of_channels
from data_io.frozen import Finding, FloatArray
from data_io.part import Contents, Part
from data_io.source import Request, Source

NAME: Final = "tdms"
_MARK: Final = b"TDSm"
_SCALE_TYPE: Final = re.compile(r"NI_Scale\[\d+\]_Scale_Type")
_SCALES: Final = frozenset(
    ("Polynomial", "Linear", "RTD", "Strain", "Table", "Thermistor", "Thermocouple", "Add", "Subtract")
)
"""Scalings that npTDMS applies; others it passes over with a line in its log."""
_UNITS: Final = ("unit_string", "NI_UnitDescription", "Unit", "unit", "Units", "units")
_OF_DAMAGE: Final = (
    ValueError, TypeError, LookupError, OSError, EOFError, ArithmeticError, AttributeError, RuntimeError,
    NotImplementedError, AssertionError, UnicodeError, struct.error,
)  # fmt: skip
"""What npTDMS raises over damaged files."""


def can_read(head: bytes) -> bool:
    """Tell a TDMS by its first bytes."""
    return head.startswith(_MARK)


def read(source: Source, request: Request) -> Contents:
    """Read the groups of a TDMS that hold a friction force, each as a run. Raises `LogError`.

    Layout: channels in groups, their unit in a property, their clock as start and increment (waveforms) or as a channel
    of times; channels may start apart or have other rates. Quirks: integers as the converter gave them, with several
    scalings to be applied in order: npTDMS does so, a kind that it does not know is refused, and integers without any
    have no unit but the one that --units gives.
    """
    try:
        import nptdms
    except ImportError as error:
        raise source.error(
            "a LabVIEW TDMS file needs the package npTDMS, which is not installed; install it with pip install "
            '"npTDMS", '
            "or export the file as .lvm or text"
        ) from error
    try:
        target: Any = str(source.path) if source.packing is None else io.BytesIO(source.data)
        with _heard() as heard, nptdms.TdmsFile.open(target) as file:
            groups = [group for group in file.groups() if any(len(channel) for channel in group.channels())]
            parts = [_part(source, request, group, dict(file.properties)) for group in groups]
            about = {str(key): str(value) for key, value in file.properties.items()}
    except MemoryError as error:
        raise source.error(
            "the channels of the TDMS file do not fit into memory; fewer were expected; export the ones that are "
            "needed, "
            "or a part of the time, from LabVIEW"
        ) from error
    except _OF_DAMAGE as error:
        reason = " ".join(str(error).split())
        raise source.error(f"the TDMS file is damaged ({reason:.100}); copy it again") from error
    if not parts:
        why = f" ({heard[0]:.100})" if heard else ""
        raise source.error(
            f"the TDMS file holds no channel with samples{why}; forces were expected; copy it again, or record it again"
        )
    told = [part for part in parts if "friction_force" in part.header.roles] or parts
    findings = [
        Finding("damaged_parts", "warning", f"parts of the file could not be read: {text:.200}") for text in heard
    ]
    return Contents(NAME, [replace(part, run=run) for run, part in enumerate(told, start=1)], about, findings)


@contextmanager
def _heard() -> Iterator[list[str]]:
    """What npTDMS writes to its log of a file that it reads as far as it can."""
    said: list[str] = []

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            said.append(record.getMessage())

    handler, above = Handler(logging.WARNING), logging.getLogger("nptdms")
    loggers = [
        above,
        *(logging.getLogger(name) for name in logging.Logger.manager.loggerDict if name.startswith("nptdms.")),
    ]
    kept = [(logger, list(logger.handlers), logger.propagate) for logger in loggers]
    for logger in loggers:
        logger.handlers, logger.propagate = [handler], False
    try:
        yield said
    finally:
        for logger, handlers, propagate in kept:
            logger.handlers, logger.propagate = handlers, propagate


def _part(source: Source, request: Request, group: Any, of_file: dict[str, Any]) -> Part:
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
                "is "
                "not known; scaled numbers were expected; export the file as text from LabVIEW"
            )
        values = np.full(longest, np.nan)
        values[: len(channel)] = channel[:]
        said = parse_name(channel.name)
        unit = next((str(properties[key]) for key in _UNITS if properties.get(key)), None) or said.unit
        if channel.dtype.kind in "iu" and not scales:
            unit = None  # counts of a converter: they may be anything
        columns[len(names)] = values
        names.append(Name(channel.name, said.name, unit))
        start = properties.get("wf_start_time")
        first = start if first is None else first
        apart = 0.0 if start is None or first is None else (start - first) / np.timedelta64(1, "s")
        starts.append(float(apart) + float(properties.get("wf_start_offset", 0.0)))
        intervals.append(float(properties.get("wf_increment", 0.0)))
    header = match_names(tuple(names), request.columns)
    clocks: dict[int, int] = {}
    if "time" not in header.roles and intervals and min(intervals) > 0:
        header, columns, clocks = with_clocks_of_channels(header, columns, starts, intervals)
    return Part(1, 1, header, columns, {"group": str(group.name)}, clocks=clocks)
