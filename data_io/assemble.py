"""Steps to a `Record` in SI: which raw column is which, units, one clock, one sign of the normal force, channels, and
the account of where everything came from; a sentence where something is missing."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Final, cast

import numpy as np
import numpy.typing as npt

from data_io.arrays import same, thinned, thinned_steps
from data_io.clock import Rows, StepClock, joined, usable_rows
from data_io.columns import ALIASES, EXAMPLES, KIND, find_column, shown, words
from data_io.contents import Contents, Part, check_request, chosen, of_run, unit_of
from data_io.record import WINDOW_START, Record, rises
from data_io.source import Request, Source, sha256_unchanged
from data_io.units import SI_UNIT, column_factor, factor, is_mass, kind_of, lever_of, rescaled
from data_io.values import COLUMN_ROLES, LARGEST_FORCE, Finding, FloatArray, Scalar, UnitError, free_name

_ALWAYS: Final = float("inf")
_VOLTS: Final = ("V", "mV", "volt", "Volt", "volts", "Volts")
_CHANNEL_KINDS: Final = ("length", "speed", "force", "time")
_FEWEST: Final = 50  # rows from which a column is looked at for marks, or for standing still
_NO_VALUE: Final = (32767.0, 32768.0, 65535.0, 2147483647.0)
"""Marks for no value besides those of nines only: what a converter shows over range."""
_AXIS: Final = re.compile(r"(f|force|kraft)[xy]|[xy](force|kraft)?")
"""Keys of columns along the surface, of which one holds the friction force and the other hardly anything."""
_STILL: Final = 1.5
"""Standard deviations of its white noise up to which a column stands still; from twice as many on it moves."""
_ENOUGH: Final = 1 << 12  # of its values that show how a column looks
_FAR: Final = 5.0  # by how much more the other column moves than the one that was taken

_LEVERS: Final = {"N*m": ("a torque", "its arm", "25 mm", "arm"), "Pa": ("a stress", "its area", "2 cm^2", "area")}
"""Of what is no force but makes one: what it is, what it needs, an example, and the option."""

Span = tuple[float, float]


@dataclass(frozen=True)
class _SiStep:
    """One step in SI, its unusable rows taken away: time and roles and channels (name -> values, unit)."""

    label: str
    time: FloatArray
    roles: dict[str, FloatArray]
    channels: dict[str, tuple[FloatArray, str]]


def assemble(source: Source, request: Request, contents: Contents) -> Record:
    """Build the record of the chosen step or of all steps of a run. Raises `LogError`.

    Unless the format is ours, the sign of the normal force is taken from the loaded rows of the whole run, and empty
    columns are left out.
    """
    settled = contents.settled
    run = of_run(source, request, contents.parts)
    check_request(source, request, run[0].header)
    cleaned = [(part, []) if settled else _without_marks(part) for part in run]
    run = [part for part, _ in cleaned]
    picked = chosen(source, request, run)
    notes = [*contents.findings, *(note for part, messages in cleaned if part in picked for note in messages)]
    pulls = not settled and request.normal_force is None and _pressed_negative(run)
    alone = len(picked) == 1
    steps = []
    for part in picked:
        label = f"step {part.number}" if len(run) > 1 else ""
        step, remarks = _in_si(source, request, part, label, settled, alone)
        steps.append(step)
        notes += remarks
    offsets, remarks = joined(
        [StepClock(step.label, step.time, part.started) for step, part in zip(steps, picked, strict=True)]
    )
    notes += remarks
    start = float(steps[0].time[0])
    times = []  # moved in place where nobody else holds them
    for step, shift in zip(steps, np.subtract(offsets, start).tolist(), strict=True):
        own = step.time if step.time.flags.writeable else None
        times.append(np.add(step.time, shift, out=own) if shift else step.time)
    if pulls:
        message = "the file has the normal force negative in compression; its sign was turned, compression is positive"
        notes.append(Finding("normal_force_flipped", "info", message))
    columns = {"time": _one(times)}
    along = all("drive_speed" in step.roles for step in steps)
    for role in COLUMN_ROLES[1:] if along else COLUMN_ROLES[1:3]:
        sign = -1.0 if pulls and role == "normal_force" else 1.0
        columns[role] = _one([rescaled(step.roles[role], sign) for step in steps])
    channels, units = _channels(steps)
    columns |= channels
    bounds = np.cumsum([0, *(step.time.size for step in steps)])
    bad = np.zeros(0, bool)
    if spans := _unused_spans(request):
        bad = ~(np.isfinite(columns["normal_force"]) & np.isfinite(columns["friction_force"]))
    if bad.any():  # rows that hold no force in stretches that nobody uses
        keep = _without_needless(columns["time"], bad, spans, ends=True)
        columns = {name: values[keep] for name, values in columns.items()}
        bounds = np.concatenate(([0], np.cumsum(keep)))[bounds]
    rows = zip(picked, pairwise(bounds.tolist()), strict=True)
    about = {
        "drive_speed": contents.drive_speed,
        "channel_units": units,
        "steps": [
            (part.run, part.number, first, stop, part.parameters) for part, (first, stop) in rows if stop > first
        ],
        "metadata": _account(source, request, picked[0], contents, start),
        "findings": [(note.code, note.severity, note.message) for note in dict.fromkeys(notes)],
    }
    return Record.from_columns(columns, about)


def _in_si(
    source: Source, request: Request, part: Part, label: str, settled: bool, alone: bool
) -> tuple[_SiStep, list[Finding]]:
    """Return one step in SI and what was noticed; alone: the window counts from its first row."""
    _check_roles(source, request, part, label)
    if not settled:  # else the columns have the names of their roles
        _refuse_doubtful_roles(source, request, part)
    notes = _choices(request, part)  # before any column is turned into SI where it stands
    raw_time = _role(source, request, part, "time")
    wanted: Rows = slice(None)
    spans = _unused_spans(request)
    if alone and spans and np.isfinite(raw_time).any() and not rises(raw_time):
        falls = ~(raw_time > np.concatenate(([-np.inf], np.fmax.accumulate(raw_time)[:-1])))
        since = raw_time - raw_time[np.argmax(np.isfinite(raw_time))]
        wanted = np.flatnonzero(_without_needless(since, falls, spans, ends=False))
    time, rows, remarks = usable_rows(source, StepClock(label, _kept(raw_time, wanted)))
    rows = rows if isinstance(wanted, slice) else wanted[rows]
    timeless = np.zeros(0, bool) if isinstance(rows, slice) else ~np.isfinite(raw_time[rows])
    roles = {}
    for role in COLUMN_ROLES[1:] if "drive_speed" in part.header.roles else COLUMN_ROLES[1:3]:
        values = _kept(_role(source, request, part, role), rows)
        roles[role] = np.where(timeless, np.nan, values) if timeless.any() and role != "drive_speed" else values
    channels = {name: (_kept(values, rows), unit) for name, values, unit in _raw_channels(request, part, settled)}
    return _SiStep(label, time, roles, channels), [*remarks, *notes]


# What the user's window and exclude leave unused may hold whatever it likes: it goes before anything is checked.


def _unused_spans(request: Request) -> list[Span]:
    """Return the stretches [s], ends included, that the user does not want, counted from the first row of the log."""
    spans = list(request.exclude)
    if request.window is not None:
        start, stop = request.window
        spans += [(-_ALWAYS, float(np.nextafter(start, -_ALWAYS))), (float(np.nextafter(stop, _ALWAYS)), _ALWAYS)]
    return spans


def _without_needless(
    time: FloatArray, bad: npt.NDArray[np.bool_], spans: Sequence[Span], *, ends: bool
) -> npt.NDArray[np.bool_]:
    """Return which rows (n,) to keep: no bad ones of unused stretches; ends: but the ends of one all bad."""
    keep = np.ones(time.size, dtype=bool)
    for first, last in spans:
        start = 0 if first == -_ALWAYS else int(np.argmax(np.append(time >= first, True)))
        stop = start + int(np.argmax(np.append(time[start:] > last, True)))
        whole = bool(bad[start:stop].all())
        keep[start:stop] &= ~bad[start:stop]
        if ends and whole and stop > start:
            keep[[start, stop - 1]] = True
    keep[:1] = True
    return keep


# Marks for no value: a display over range, or a logger without a reading, writes one number far from all others.


def _without_marks(part: Part) -> tuple[Part, list[Finding]]:
    """Return the part without the rows in which a force is a mark for no value, and what to say of it."""
    notes, rows = [], np.zeros(part.rows, dtype=bool)
    for index in (part.header.roles.get(role, -1) for role in COLUMN_ROLES[1:3]):
        values = part.columns.get(index)
        if values is None or values.size < _FEWEST:
            continue
        ends = np.array([values.max(), values.min()])
        if not np.isfinite(ends).all() and np.isfinite(values).any():
            ends = np.array([np.nanmax(values), np.nanmin(values)])
        for mark in map(float, ends[np.isfinite(ends)]):
            digits = f"{abs(mark):.10g}".replace(".", "").strip("0")
            if not (abs(mark) in _NO_VALUE or (len(digits) > 2 and set(digits) == {"9"})):
                continue
            marked = values == mark
            others = values[np.isfinite(values) & ~marked]
            if others.size < values.size // 2 or np.count_nonzero(marked) < 2:
                continue
            low, high = float(np.min(others)), float(np.max(others))
            if max(mark - high, low - mark) > 3.0 * (high - low):
                rows |= marked
                text = (
                    f"{np.count_nonzero(marked)} row(s) of {shown([part.header.names[index].raw])} hold {mark:g}, far "
                    "from all others and again and again: a mark for no value; they were left out"
                )
                notes.append(Finding("no_value_mark", "warning", text))
                break
    return (replace(part, columns={i: values[~rows] for i, values in part.columns.items()}) if notes else part), notes


# A role that a column got by its name alone, while another column does the job: asked, with both named.


@dataclass(frozen=True)
class _Look:
    """What a column of force looks like [N]: its ends but for few rows, median size, scatter, white noise in it."""

    low: float
    high: float
    level: float
    scatter: float
    noise: float

    @classmethod
    def of(cls, request: Request, part: Part, index: int, friction: int) -> "_Look | None":
        """That of a column, None where it holds no force; one without a unit is in that of the friction force."""
        unit = unit_of(request, part.header, index) or unit_of(request, part.header, friction) or ""
        if kind_of(unit) != "force" or index not in part.columns:
            return None
        scale, values = factor(unit, "N"), part.columns[index]
        few, steps = (scale * thinned(v, _ENOUGH) for v in (values, thinned_steps(values)))
        few, steps = few[np.abs(few) <= LARGEST_FORCE], steps[np.abs(steps) <= LARGEST_FORCE]
        low, high = map(float, np.quantile(few, [0.025, 0.975])) if few.size else (0.0, 0.0)
        level = float(np.median(np.abs(few))) if few.size else 0.0
        noise = float(np.sqrt(np.mean(steps**2) / 2.0)) if steps.size else 0.0
        return cls(low, high, level, (high - low) / 3.92, noise)

    @property
    def moves(self) -> bool:
        return self.scatter > 2.0 * _STILL * self.noise > 0.0


def _refuse_doubtful_roles(source: Source, request: Request, part: Part) -> None:
    """Ask where the friction force stands still and another force along the surface moves, or the load does instead."""
    roles, names = part.header.roles, part.header.names
    index, load = roles.get("friction_force"), roles.get("normal_force")
    if index is None or "friction_force" in request.columns or part.rows < _FEWEST:
        return
    taken = _Look.of(request, part, index, index)
    if taken is None or taken.scatter > _STILL * taken.noise:
        return
    standing = f"{shown([names[index].raw])} is called as the friction force and stands still at {taken.level:.3g} N"
    for i, name in enumerate(names):
        if i in (index, load) or not (name.key in ALIASES["friction_force"] or _AXIS.fullmatch(name.key)):
            continue
        other = _Look.of(request, part, i, index)
        if other is not None and other.moves and other.scatter > _FAR * taken.scatter and other.level > 2 * taken.level:
            raise source.error(
                f"{standing}, while {shown([name.raw])} moves from {other.low:.3g} to {other.high:.3g} N; one friction "
                f"force was expected; say which with --columns friction_force={name.name} or "
                f"friction_force={names[index].name}"
            )
    normal = None if load is None or request.normal_force is not None else _Look.of(request, part, load, index)
    if load is None or normal is None or not normal.moves:
        return
    larger = max(abs(taken.low), abs(taken.high)) > max(abs(normal.low), abs(normal.high))
    if larger and normal.scatter * taken.level > _FAR * taken.scatter * normal.level:
        raise source.error(
            f"{standing}, while {shown([names[load].raw])}, called as the normal force, moves from {normal.low:.3g} to "
            f"{normal.high:.3g} N; the two may be swapped; say which is which with --columns "
            f"friction_force={names[load].name},normal_force={names[index].name} or the other way round"
        )


# Roles and units.


def _check_roles(source: Source, request: Request, part: Part, label: str) -> None:
    """Name a column whose unit is none of its role, or all missing columns and units at once."""
    header = part.header
    needed = [role for role in COLUMN_ROLES[:3] if role != "normal_force" or request.normal_force is None]
    needed += ["drive_speed"] if "drive_speed" in header.roles else []
    for role in needed:
        if role not in header.roles or not (unit := _unit(request, part, role)):
            continue
        name = header.names[header.roles[role]]
        try:
            _factor(request, unit, role, name.unit)
        except UnitError as error:
            scale = f'the scale of its sensor, as in --units {role}="2.5 N/V"'
            option = scale if unit in _VOLTS else f"--units {role}=..."
            text = f"column {shown([name.raw])} ({words(role)}): {error}"
            raise source.error(text if lever_of(unit) else f"{text}; or give it with {option}") from error
    missing = [role for role in needed if role not in header.roles]
    bare = [role for role in needed if role not in missing and not _unit(request, part, role)]
    if missing:
        free = [name for i, name in enumerate(header.names) if i not in header.roles.values()]
        unitless = [*bare, *(missing if all(name.unit is None for name in free) else ())]
        units = f" and the units that the header lacks, as in {_si_units(unitless)}" if unitless else ""
        load = ', or give a constant load with --normal-force "3 N"' if "normal_force" in missing else ""
        rate = ', or the sampling rate with --rate "100 Hz"' if "time" in missing else ""
        raise source.error(
            f"no {' column and no '.join(words(role) for role in missing)} column was found among "
            f"{shown(name.name for name in header.names)}{' in ' if label else ''}{label}; a name such as "
            f"{', '.join(EXAMPLES.get(role, role) for role in missing)} was expected; say which one it is with "
            f"--columns {','.join(f'{role}=<name>' for role in missing)}{units}{load}{rate}"
            + (", or choose another step with --step" if label else "")
        )
    if bare:
        which = ", ".join(f"{shown([header.names[header.roles[role]].raw])} ({words(role)})" for role in bare)
        raise source.error(
            f"no unit was found for column {which}; a unit in the header was expected; give it, as in {_si_units(bare)}"
        )


def _si_units(roles: Sequence[str]) -> str:
    return "--units " + ",".join(f"{role}={SI_UNIT[KIND[role]]}" for role in roles)


def _unit(request: Request, part: Part, role: str) -> str:
    return unit_of(request, part.header, part.header.roles[role]) or ""


def _role(source: Source, request: Request, part: Part, role: str) -> FloatArray:
    """Return one role of a part in SI, shape (rows,)."""
    if role == "normal_force" and request.normal_force is not None:
        return np.full(part.rows, request.normal_force)
    name = part.header.names[part.header.roles[role]]
    index = _filled(part, part.header.roles[role])
    if index is None:
        raise source.error(
            f"column {shown([name.raw])} ({words(role)}) holds no numbers; a column of numbers was expected; "
            f"name another one with --columns {role}=<name>"
        )
    scale = _factor(request, _unit(request, part, role), role, name.unit)
    return rescaled(part.columns[index], scale)


def _factor(request: Request, unit: str, role: str, file_unit: str | None) -> float:
    """Return the number that turns a role into SI; a torque acts at an arm, a stress on an area. Raises `UnitError`."""
    lever = lever_of(unit) if KIND[role] == "force" else None
    if lever is None:
        return column_factor(unit, SI_UNIT[KIND[role]], file_unit)
    what, given, length, name = _LEVERS[lever]
    size = getattr(request, name)
    if size is None:
        raise UnitError(
            f'{unit!r} is {what} where a force was expected; give {given} with --{name} "{length}", or as {name} in a '
            "scene"
        )
    return factor(unit, lever) / size if lever == "N*m" else factor(unit, lever) * size


def _filled(part: Part, index: int) -> int | None:
    """Return the index of a column; where it is empty and another of the same name and unit is not, of that one."""
    name = part.header.names[index]
    twins = (index, *(i for i, column in enumerate(part.header.names) if column == name))
    return next((other for other in twins if _any_finite(part.columns.get(other))), None)


def _any_finite(column: FloatArray | None) -> bool:
    return column is not None and bool(np.isfinite(column[:1]).any() or np.isfinite(column).any())


def _kept(values: FloatArray, rows: Rows) -> FloatArray:
    """Return the rows of a column; all of them without a view, which the record would have to copy."""
    return values if isinstance(rows, slice) else values[rows]


def _choices(request: Request, part: Part) -> list[Finding]:
    """Say where another column might have been meant, where a mass was taken as its weight, and what the user gave."""
    notes = []
    for role, others in part.header.passed_over.items():
        index = part.header.roles[role]
        taken = part.columns.get(index)
        differing = [i for i in others if i in part.columns and not same(taken, part.columns[i])]
        if differing:
            named = shown(part.header.names[i].raw for i in differing)
            text = f"the {words(role)} was taken from {shown([part.header.names[index].raw])}, not from {named}"
            notes.append(Finding("column_choice", "info", text))
    forces = COLUMN_ROLES[1:3] if request.normal_force is None else COLUMN_ROLES[2:3]
    masses = sorted({unit for role in forces if is_mass(unit := _unit(request, part, role))})
    if masses:
        text = f"forces in {' and '.join(masses)} were taken as weights, {masses[0]} as {masses[0]}-force"
        notes.append(Finding("unit_by_context", "info", text))
    for role in forces:
        if (unit := _unit(request, part, role)) and (lever := lever_of(unit)):
            name = shown([part.header.names[part.header.roles[role]].raw])
            how = f"over the arm of {request.arm:g} m" if lever == "N*m" else f"times the area of {request.area:g} m^2"
            notes.append(Finding("force_from_torque", "info", f"the {words(role)} is {name} {how} that was given"))
    if request.normal_force is not None:
        index = part.header.roles.get("normal_force", -1)
        aside = "" if index < 0 else f"; the file's column {part.header.names[index].name!r} was set aside"
        text = f"the normal force is a constant {request.normal_force:g} N given by the user{aside}"
        notes.append(Finding("normal_force_constant", "info", text))
    return notes


# The columns of all steps put together, and where they came from.


def _one(pieces: Sequence[FloatArray]) -> FloatArray:
    """Join columns that nobody else holds, and freeze them, so that the record need not copy them."""
    joined = pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
    base: object = joined
    while isinstance(base, np.ndarray):
        base.flags.writeable = False
        base = base.base
    return joined


def _account(source: Source, request: Request, part: Part, contents: Contents, start: float) -> dict[str, Scalar]:
    """Say where a record came from: each role, the file, the zero of its clock."""
    about: dict[str, Scalar] = {}
    for role in COLUMN_ROLES[:3]:
        if role == "normal_force" and request.normal_force is not None:
            about[f"{role}_source"] = f"constant {request.normal_force:g} N, given by the user"
            continue
        name = part.header.names[part.header.roles[role]]
        given = any(request.units.get(key) for key in (role, name.name, name.raw))
        text = f"column {name.name} in {_unit(request, part, role)}{', given by the user' if given else ''}"
        about[f"{role}_source"] = text
    path, size = source.path, source.size  # and nothing else of the source is kept
    digest = cast(str, partial(sha256_unchanged, path, size))
    about |= {**contents.metadata, **part.run_items, "path": str(path), "sha256": digest, "format": contents.form}
    about.pop(WINDOW_START, None)  # of the log that the file was made from
    if start != 0:
        about["file_time_start"] = start + float(contents.metadata.get("file_time_start", 0.0))
    return about


def _pressed_negative(run: Sequence[Part]) -> bool:
    """Tell whether the loaded rows of a run press with a negative sign; a small offset before loading says nothing."""
    pieces = [part.columns[part.header.roles["normal_force"]] for part in run
              if part.rows and part.header.roles.get("normal_force") in part.columns]  # fmt: skip
    raw = thinned(pieces[0] if len(pieces) == 1 else np.concatenate(pieces or [np.empty(0)]))
    raw = raw[np.isfinite(raw)]
    if np.min(raw, initial=0.0) >= 0:
        return False
    size = np.abs(raw)
    return bool(np.median(raw[size >= 0.5 * np.quantile(size, 0.99)]) < 0)


def _raw_channels(request: Request, part: Part, settled: bool) -> list[tuple[str, FloatArray, str]]:
    """Return name, values and unit of the columns that carry no role; metres, seconds and newtons where it can be."""
    own = {find_column(part.header.names, column): name for name, column in request.columns.items()}
    raw: list[tuple[str, FloatArray, str]] = []
    taken: set[str] = set(COLUMN_ROLES)
    roles = {r: i for r, i in part.header.roles.items() if request.normal_force is None or r != "normal_force"}
    used = {*roles.values(), *(_filled(part, index) for index in roles.values())}
    plain = replace(part.header, roles={})  # the unit of a role is not that of a column that a constant took it from
    for index, values in part.columns.items():
        if index in used or not (settled or _any_finite(values)):
            continue
        column = part.header.names[index]
        plain_name = "".join(letter for letter in column.name if letter.isprintable()).strip()
        name = free_name(own.get(index, plain_name or f"column {index + 1}"), taken)
        taken.add(name)
        unit = request.units.get(name) or unit_of(request, plain, index) or ""
        kind = kind_of(unit) if unit else None
        if kind in _CHANNEL_KINDS:
            values, unit = rescaled(values, factor(unit, SI_UNIT[kind])), SI_UNIT[kind]
        raw.append((name, values, unit))
    return raw


def _channels(steps: Sequence[_SiStep]) -> tuple[dict[str, FloatArray], dict[str, str]]:
    """Join the channels of all steps; a step without a channel holds NaN there, another unit makes another channel."""
    units = {name: unit for step in reversed(steps) for name, (_, unit) in reversed(step.channels.items())}
    columns: dict[str, FloatArray] = {}
    for name in list(dict.fromkeys(name for step in steps for name in step.channels)):
        pieces = [step.channels.get(name, (None, "")) for step in steps]
        columns[name] = _one(
            [
                np.full(step.time.size, np.nan) if values is None or unit != units[name] else values
                for step, (values, unit) in zip(steps, pieces, strict=True)
            ]
        )
    return columns, {name: units[name] for name in columns}
