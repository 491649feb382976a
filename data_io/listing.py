"""What steps a log holds, before anybody chooses: numbers, rows, durations, parameters, columns."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from data_io.errors import UnitError
from data_io.part import Contents, Part
from data_io.source import Request
from data_io.units import to_si


@dataclass(frozen=True)
class StepSummary:
    """One step of a log: its run and number, rows, duration [s] (None: not told), when it was started, columns.

    columns: name by name the unit, None where the file does not say one. parameters: as the file has them, as text.
    """

    run: int
    number: int
    rows: int
    duration: float | None
    started: datetime | None
    columns: Mapping[str, str | None]
    parameters: Mapping[str, str]


def summaries(contents: Contents, request: Request) -> tuple[StepSummary, ...]:
    """Return every step that a reader found, empty ones included."""
    return tuple(
        StepSummary(
            part.run, part.number, part.rows, _duration(part, request), part.started,
            {name.name: name.unit for name in part.header.names}, dict(part.parameters),
        )
        for part in contents.parts
    )  # fmt: skip


def _duration(part: Part, request: Request) -> float | None:
    index = part.header.roles.get("time")
    values = part.columns.get(-1 if index is None else index)
    if index is None or values is None:
        return None
    finite = values[np.isfinite(values)]
    unit = request.units.get("time") or part.header.names[index].unit
    if not unit or finite.size < 2:
        return None
    try:
        return to_si(float(finite[-1] - finite[0]), unit, "time")
    except UnitError:
        return None
