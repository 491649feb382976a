"""Open a log of any known format."""

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from data_io.assemble import assemble
from data_io.errors import LogError, UnitError
from data_io.frozen import COLUMN_ROLES
from data_io.readers import READERS
from data_io.record import Record, within
from data_io.source import Request, load, no_progress
from data_io.units import parse_quantity

ROLES: Final = (*COLUMN_ROLES, "position")
"""What a column can be named for."""


def read_log(
    path: str | Path,
    step: int | None = None,
    units: Mapping[str, str] | None = None,
    columns: Mapping[str, str] | None = None,
    normal_force: float | str | None = None,
    run: int | None = None,
    channels: Sequence[str] | None = None,
    progress: Callable[[float], None] = no_progress,
    window: tuple[float, float] | None = None,
) -> Record:
    """Read a log as one record in SI.

    step: the number of a step; None joins all steps of the run on one clock. run: which run, where there are several.
    units: unit by role (time, normal_force, friction_force) or column name, e.g. {"friction_force": "N"}; overrides
    the file. columns: column (or HDF5 dataset) by role, e.g. {"time": "T"}; `drive_speed` and `position` are roles too.
    normal_force: a constant load [N] or "3 N", instead of a column. channels: names of the other columns to keep; None
    keeps all. window: the (start, stop) [s] to keep, in the clock of the file; of an HDF5 file nothing else is read.
    progress: called with the share read so far. Raises `LogError`, one sentence that says what was
    found, what was expected and what to do.
    """
    path = Path(path)
    _check_roles(path, columns or {})
    request = Request(
        step,
        run,
        dict(units or {}),
        dict(columns or {}),
        _load_force(path, normal_force),
        None if channels is None else tuple(channels),
        progress,
        None if window is None else _checked_window(path, window),
    )
    source = load(path)
    for reader in READERS:
        if reader.can_read(source.head):
            return within(assemble(source, request, reader.read(source, request)), request.window)
    names = ", ".join(reader.name for reader in READERS)
    raise source.error(
        f"the file begins with {source.head[:12]!r}, which no reader knows ({names}); a text or HDF5 log was expected; "
        "export it as text"
    )


def _checked_window(path: Path, window: tuple[float, float]) -> tuple[float, float]:
    start, stop = (float(time) for time in window)
    if not start < stop:
        raise LogError(f"{path}: the window runs from {start:g} to {stop:g} s; a start before its stop was expected")
    return start, stop


def _check_roles(path: Path, columns: Mapping[str, str]) -> None:
    for role in columns:
        if role not in ROLES:
            near = difflib.get_close_matches(role, ROLES, n=1)
            hint = f"did you mean {near[0]}?" if near else "use one of these"
            raise LogError(f"{path}: a column was named for {role!r}; {', '.join(ROLES)} were expected; {hint}")


def _load_force(path: Path, given: float | str | None) -> float | None:
    if given is None:
        return None
    try:
        force = parse_quantity(given, "N")
    except UnitError as error:
        raise LogError(f"{path}: the normal force given: {error}") from error
    if not (math.isfinite(force) and force > 0):
        raise LogError(f"{path}: a normal force of {given} was given; a load above 0 N was expected; correct it")
    return force
