"""Steps as readers find them, and the choice among runs and steps that the user makes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

from data_io.columns import Header, find_column, shown, words
from data_io.frozen import COLUMN_ROLES, Finding, FloatArray, Scalar
from data_io.source import Request, Source


@dataclass(frozen=True)
class Part:
    """One step as its reader found it: columns by index of the header, raw, all of one length; items of its run.

    clocks: where channels bring clocks of their own, the time column of each; empty: the places of columns tell.
    """

    run: int
    number: int
    header: Header
    columns: Mapping[int, FloatArray]
    parameters: Mapping[str, str] = field(default_factory=dict)
    started: datetime | None = None
    run_items: Mapping[str, str] = field(default_factory=dict)
    clocks: Mapping[int, int] = field(default_factory=dict)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return min((column.size for column in self.columns.values()), default=0)


@dataclass(frozen=True)
class Contents:
    """What a reader found in a log: the name of the format, the steps, what the file says besides, what was noticed.

    settled: the format is ours, compression is positive and every column is kept. drive_speed [m/s]: what the file
    says outside its columns. skipped [s]: how long the log had run before the first row here, where only the window
    that was asked for was read.
    """

    form: str
    parts: Sequence[Part]
    metadata: Mapping[str, Scalar] = field(default_factory=dict)
    findings: Sequence[Finding] = ()
    settled: bool = False
    drive_speed: float | None = None
    skipped: float = 0.0


def of_run(source: Source, request: Request, parts: Sequence[Part]) -> list[Part]:
    """Return the steps of the run that was asked for, or of the only one. Raises the source's `LogError`."""
    runs = sorted({part.run for part in parts})
    if request.run is None and request.step is not None:
        runs = sorted({part.run for part in parts if part.number == request.step}) or runs
    if request.run is not None and request.run not in runs:
        raise source.error(f"run {request.run} was asked for; the log holds run {_listed(runs)}; choose one of them")
    if request.run is None and len(runs) > 1:
        places = {part.run: part.run_items["table"] for part in parts if "table" in part.run_items}
        named = [f"{run} ({places[run]})" if run in places else str(run) for run in runs]
        beside = ", tables that stand side by side" if places else ""
        raise source.error(f"the log holds the runs {_listed(named)}{beside}; one was expected; choose one with --run")
    run = [part for part in parts if part.run == (runs[0] if request.run is None else request.run)]
    if not any(part.rows for part in run):
        raise source.error("no rows of numbers were found below the header; at least two were expected; export again")
    return run


def chosen(source: Source, request: Request, run: Sequence[Part]) -> list[Part]:
    """Return the step that was asked for, or all that hold rows. Raises the source's `LogError`."""
    if request.step is None:
        return [part for part in run if part.rows]
    found = [part for part in run if part.number == request.step]
    if not found:
        steps = _listed([part.number for part in run])
        raise source.error(f"step {request.step} was asked for; the log holds step {steps}; choose one of them")
    if not found[0].rows:
        raise source.error(f"step {request.step} holds no rows; at least two were expected; choose another step")
    return found


def check_request(source: Source, request: Request, header: Header) -> None:
    """Raise the source's `LogError` where the user names a column that the header does not have."""
    there = shown(name.name for name in header.names)
    twice = [column for column in request.columns.values() if list(request.columns.values()).count(column) > 1]
    if twice:
        raise source.error(f"the column {twice[0]!r} was named for two purposes; one was expected; name another one")
    for role, column in request.columns.items():
        if find_column(header.names, column) is None:
            raise source.error(f"no column {column!r} was found for {words(role)}; there are {there}; name one of them")
    for key in request.units:
        if key not in COLUMN_ROLES and key not in request.columns and find_column(header.names, key) is None:
            raise source.error(
                f"a unit was given for {key!r}, which is no column; {', '.join(COLUMN_ROLES[:3])} or one of {there} "
                "was expected; correct the name"
            )


def _listed(numbers: Sequence[int] | Sequence[str]) -> str:
    return ", ".join(map(str, numbers[:20])) + (", ..." if len(numbers) > 20 else "")
