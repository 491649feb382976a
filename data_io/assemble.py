"""Raw columns of one or more steps to a `Record`: units, signs, one clock; a sentence where something is missing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Final

import numpy as np

from data_io.clock import StepClock, joined, usable_rows
from data_io.columns import EXAMPLES, KIND, Header, Name, find_column, words
from data_io.errors import UnitError
from data_io.record import COLUMN_ROLES, Finding, FloatArray, Record, Scalar, Step
from data_io.source import Request, Source
from data_io.units import SI_UNIT, kind_of, to_si

_CHANNEL_KINDS: Final = ("length", "speed", "force", "time")


@dataclass(frozen=True)
class Part:
    """One step as its reader found it: columns by index of the header, raw, all of one length."""

    run: int
    number: int
    header: Header
    columns: Mapping[int, FloatArray]
    parameters: Mapping[str, str] = field(default_factory=dict)
    started: datetime | None = None

    @property
    def rows(self) -> int:
        """Number of rows."""
        return min((column.size for column in self.columns.values()), default=0)


def assemble(
    source: Source,
    request: Request,
    parts: Sequence[Part],
    form: str,
    metadata: Mapping[str, Scalar],
    findings: Sequence[Finding] = (),
    *,
    signs_settled: bool = False,
) -> Record:
    """Build the record of the chosen step or of all steps of a run. Raises `LogError`.

    `signs_settled` says that compression is positive by definition of the format; else the sign is taken from the
    loaded rows of the whole run.
    """
    run = _of_run(source, request, parts)
    _check_request(source, request, run[0].header)
    chosen = _chosen(source, request, run)
    notes = list(findings)
    steps = [_Step.convert(source, request, part, len(run) > 1, notes) for part in chosen]
    clocks = [StepClock(step.label, step.time, part.started) for step, part in zip(steps, chosen, strict=True)]
    offsets, remarks = joined(clocks)
    notes += remarks
    start = steps[0].time[0]
    time = np.concatenate([step.time + (offset - start) if offset else step.time - start
                           for step, offset in zip(steps, offsets, strict=True)])  # fmt: skip
    normal = np.concatenate([step.roles["normal_force"] for step in steps])
    about: dict[str, Scalar] = {
        **metadata, "path": str(source.path), "sha256": source.sha256, "format": form,
    }  # fmt: skip
    about |= {f"{role}_source": _origin(request, chosen[0], role) for role in COLUMN_ROLES[:3]}
    if start != 0:
        about["file_time_start"] = float(start)
    if not signs_settled and request.normal_force is None and _pressed_negative(run):
        normal = -normal
        message = "the file has the normal force negative in compression; its sign was turned, compression is positive"
        notes.append(Finding("normal_force_flipped", "info", message))
    channels, units = _channels(steps)
    return Record(
        time=time,
        normal_force=normal,
        friction_force=np.concatenate([step.roles["friction_force"] for step in steps]),
        drive_speed=_joined_drive(steps),
        channels=channels,
        channel_units=units,
        steps=_bounds(chosen, steps),
        metadata=about,
        findings=tuple(dict.fromkeys(notes)),
    )


@dataclass(frozen=True)
class _Step:
    """One step in SI, its unusable rows taken away: time and roles and channels (name -> values, unit)."""

    label: str
    time: FloatArray
    roles: Mapping[str, FloatArray]
    channels: Mapping[str, tuple[FloatArray, str]]

    @classmethod
    def convert(cls, source: Source, request: Request, part: Part, several: bool, notes: list[Finding]) -> "_Step":
        label = f" of step {part.number}" if several else ""
        raw_time = _role(source, request, part, "time")
        time, rows, found = usable_rows(source, StepClock(label, raw_time))
        notes += found
        notes += [Finding("column_choice", "info", remark) for remark in part.header.remarks]
        timeless = ~np.isfinite(raw_time[rows])
        roles = {}
        for role in COLUMN_ROLES[1:] if "drive_speed" in part.header.roles else COLUMN_ROLES[1:3]:
            values = _role(source, request, part, role)[rows]
            roles[role] = np.where(timeless, np.nan, values) if timeless.any() else values
        if request.normal_force is not None:
            notes.append(_constant_load(request.normal_force, part))
        return cls(label, time, roles, {name: (v[rows], unit) for name, v, unit in _raw_channels(request, part)})


def _of_run(source: Source, request: Request, parts: Sequence[Part]) -> list[Part]:
    runs = sorted({part.run for part in parts})
    if request.run is None and request.step is not None:
        runs = sorted({part.run for part in parts if part.number == request.step}) or runs
    if request.run is not None and request.run not in runs:
        raise source.error(f"run {request.run} was asked for; the log holds run {_listed(runs)}; choose one of them")
    if request.run is None and len(runs) > 1:
        raise source.error(f"the log holds the runs {_listed(runs)}; one was expected; choose one with --run")
    run = [part for part in parts if part.run == (runs[0] if request.run is None else request.run)]
    if not any(part.rows for part in run):
        raise source.error("no rows of numbers were found below the header; at least two were expected; export again")
    return run


def _chosen(source: Source, request: Request, run: Sequence[Part]) -> list[Part]:
    if request.step is None:
        return [part for part in run if part.rows]
    chosen = [part for part in run if part.number == request.step]
    if not chosen:
        steps = _listed([part.number for part in run])
        raise source.error(f"step {request.step} was asked for; the log holds step {steps}; choose one of them")
    if not chosen[0].rows:
        raise source.error(f"step {request.step} holds no rows; at least two were expected; choose another step")
    return chosen


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers[:20])) + (", ..." if len(numbers) > 20 else "")


def _check_request(source: Source, request: Request, header: Header) -> None:
    shown = ", ".join(repr(name.name) for name in header.names[:40])
    for role, column in request.columns.items():
        if find_column(header.names, column) is None:
            raise source.error(f"no column {column!r} was found for {words(role)}; there are {shown}; name one of them")
    for key in request.units:
        if key not in COLUMN_ROLES and key not in request.columns and find_column(header.names, key) is None:
            raise source.error(
                f"a unit was given for {key!r}, which is no column; {', '.join(COLUMN_ROLES[:3])} or one of {shown} "
                "was expected; correct the name"
            )


def _role(source: Source, request: Request, part: Part, role: str) -> FloatArray:
    """Return one role of a part in SI, shape (rows,)."""
    if role == "normal_force" and request.normal_force is not None:
        return np.full(part.rows, request.normal_force)
    index = part.header.roles.get(role)
    if index is None:
        raise source.error(_missing(role, part))
    name = part.header.names[index]
    if index not in part.columns:
        raise source.error(f"column {name.raw!r} ({words(role)}) holds no numbers; name another one with --columns")
    unit = request.units.get(role) or request.units.get(name.name) or request.units.get(name.raw) or name.unit
    kind = KIND[role]
    if not unit:
        example = {"time": "s", "force": "N", "speed": "mm/s"}[kind]
        raise source.error(
            f"column {name.raw!r} ({words(role)}) has no unit; a unit such as {example} was expected; "
            f"give it with --units {role}={example}"
        )
    try:
        return to_si(part.columns[index], unit, kind)
    except UnitError as error:
        where = f"column {name.raw!r} ({words(role)})"
        raise source.error(f"{where}: {error}; or give it with --units {role}=...") from error


def _missing(role: str, part: Part) -> str:
    shown = ", ".join(repr(name.name) for name in part.header.names[:40])
    step = f" in step {part.number}" if part.number > 1 else ""
    text = (
        f"no {words(role)} column was found among {shown}{step}; a name such as {EXAMPLES.get(role, role)} "
        f"was expected; say which one it is with --columns {role}=<name>"
    )
    return text + (' or give a constant load with --normal-force "3 N"' if role == "normal_force" else "")


def _origin(request: Request, part: Part, role: str) -> str:
    if role == "normal_force" and request.normal_force is not None:
        return f"constant {request.normal_force:g} N, given by the user"
    name = part.header.names[part.header.roles[role]]
    unit = request.units.get(role) or request.units.get(name.name) or request.units.get(name.raw)
    return f"column {name.name}" + (f" in {unit}, given by the user" if unit else f" in {name.unit}")


def _constant_load(load: float, part: Part) -> Finding:
    index = part.header.roles.get("normal_force")
    instead = f"; the file's column {part.header.names[index].name!r} was set aside" if index is not None else ""
    text = f"the normal force is a constant {load:g} N given by the user{instead}"
    return Finding("normal_force_constant", "info", text)


def _pressed_negative(run: Sequence[Part]) -> bool:
    """Tell whether the loaded rows of a run press with a negative sign; a small offset before loading says nothing."""
    raw = np.concatenate([part.columns[part.header.roles["normal_force"]] for part in run
                          if part.rows and "normal_force" in part.header.roles])  # fmt: skip
    raw = raw[np.isfinite(raw)]
    if raw.size == 0:
        return False
    size = np.abs(raw)
    return bool(np.median(raw[size >= 0.5 * np.quantile(size, 0.99)]) < 0)


def _raw_channels(request: Request, part: Part) -> list[tuple[str, FloatArray, str]]:
    """Return name, values and unit of the columns that carry no role; metres, seconds and newtons where it can be."""
    own = {find_column(part.header.names, column): name for name, column in request.columns.items()}
    found: list[tuple[str, FloatArray, str]] = []
    taken: set[str] = set(COLUMN_ROLES)
    used = set(part.header.roles.values())
    if request.normal_force is not None:
        used -= {part.header.roles.get("normal_force", -1)}
    for index, values in part.columns.items():
        if index in used or not np.isfinite(values).any():
            continue
        column = part.header.names[index]
        name = _free_name(own.get(index, _clean(column, index)), taken)
        taken.add(name)
        unit = request.units.get(name) or request.units.get(column.name) or column.unit or ""
        kind = kind_of(unit) if unit else None
        if kind in _CHANNEL_KINDS:
            values, unit = to_si(values, unit, kind), SI_UNIT[kind]
        found.append((name, values, unit))
    return found


def _clean(column: Name, index: int) -> str:
    text = "".join(letter for letter in column.name if letter.isprintable()).strip()
    return text or f"column {index + 1}"


def _free_name(name: str, taken: set[str]) -> str:
    if name not in taken:
        return name
    return next(other for i in range(2, len(taken) + 3) if (other := f"{name} ({i})") not in taken)


def _channels(steps: Sequence[_Step]) -> tuple[dict[str, FloatArray], dict[str, str]]:
    """Join the channels of all steps; a step without a channel holds NaN there, another unit makes another channel."""
    units: dict[str, str] = {}
    for step in steps:
        for name, (_, unit) in step.channels.items():
            units.setdefault(name, unit)
    columns: dict[str, FloatArray] = {}
    for name, unit in units.items():
        pieces = []
        for step in steps:
            values, own = step.channels.get(name, (None, unit))
            pieces.append(values if values is not None and own == unit else np.full(step.time.size, np.nan))
        columns[name] = np.concatenate(pieces)
    return columns, units


def _joined_drive(steps: Sequence[_Step]) -> FloatArray | None:
    if not all("drive_speed" in step.roles for step in steps):
        return None
    return np.concatenate([step.roles["drive_speed"] for step in steps])


def _bounds(chosen: Sequence[Part], steps: Sequence[_Step]) -> tuple[Step, ...]:
    ends = np.cumsum([step.time.size for step in steps])
    return tuple(
        Step(part.run, part.number, int(end) - step.time.size, int(end), part.parameters)
        for part, step, end in zip(chosen, steps, ends, strict=True)
    )
