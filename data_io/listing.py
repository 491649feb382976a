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
