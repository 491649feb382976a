"""What steps a log holds, before anybody chooses: numbers, rows, durations, parameters, columns."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Final

import numpy as np

from data_io.errors import LogError, UnitError
from data_io.part import Contents, Part
from data_io.source import Request
from data_io.units import to_si

MOST_NAMED: Final = 8
"""Steps that a message names."""


@dataclass(frozen=True)
class StepSummary:
    """One step of a log: its run and number, rows, duration [s] (None: not told), when it was started, columns.

    restarts: how often its clock falls back, which then tells no duration.
    columns: name by name the unit, None where the file does not say one. parameters: as the file has them, as text.
    """

    run: int
    number: int
    rows: int
    duration: float | None
    started: datetime | None
    columns: Mapping[str, str | None]
    parameters: Mapping[str, str]
    restarts: int = 0


def summaries(contents: Contents, request: Request) -> tuple[StepSummary, ...]:
    """Return every step that a reader found, empty ones included."""
    found = []
    for part in contents.parts:
        duration, restarts = _duration(part, request)
        columns = {name.name: name.unit for name in part.header.names}
        parameters = dict(part.parameters)
        found.append(
            StepSummary(part.run, part.number, part.rows, duration, part.started, columns, parameters, restarts)
        )
    return tuple(found)


def chosen_steps(
    path: Path, steps: tuple[StepSummary, ...], step: int | None, run: int | None
) -> tuple[StepSummary, ...]:
    """Return the steps with these numbers; None is any. Raises `LogError` where there is none."""
    found = tuple(each for each in steps if step in (None, each.number) and run in (None, each.run))
    if found or (step is None and run is None):
        return found
    asked = " of ".join(f"{kind} {number}" for kind, number in (("step", step), ("run", run)) if number is not None)
    held = ", ".join(f"step {each.number} of run {each.run}" for each in steps[:MOST_NAMED]) or "none"
    more = f" and {len(steps) - MOST_NAMED} more" if len(steps) > MOST_NAMED else ""
    raise LogError(f"{path}: {asked} was asked for; the log holds {held}{more}; choose one of them")


def _duration(part: Part, request: Request) -> tuple[float | None, int]:
    """Return how long a step lasts [s], None where nothing tells, and how often its clock falls back."""
    if request.rate is not None:
        return max(part.rows - 1, 0) / request.rate, 0
    index = part.header.roles.get("time")
    values = part.columns.get(-1 if index is None else index)
    if index is None or values is None:
        return None, 0
    finite = values[np.isfinite(values)]
    restarts = int(np.count_nonzero(np.diff(finite) < 0))
    unit = request.units.get("time") or part.header.names[index].unit
    if not unit or finite.size < 2 or restarts:
        return None, restarts
    try:
        return to_si(float(finite[-1] - finite[0]), unit, "time"), 0
    except UnitError:
        return None, 0
