"""One step in SI: which raw column is which, units, rows without a time, channels; a sentence where one is missing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from data_io.checks import BLOCK, rising
from data_io.clock import Rows, StepClock, usable_rows
from data_io.columns import EXAMPLES, KIND, Name, find_column, shown, words
from data_io.errors import UnitError
from data_io.free_name import free_name
from data_io.frozen import COLUMN_ROLES, Finding, FloatArray
from data_io.part import Part
from data_io.role_doubts import refuse_doubtful_roles
from data_io.source import Request, Source
from data_io.units import SI_UNIT, column_factor, factor, is_mass, kind_of, rescaled
from data_io.unused import Span, unused_spans, without_needless

_VOLTS: Final = ("V", "mV", "volt", "Volt", "volts", "Volts")
_CHANNEL_KINDS: Final = ("length", "speed", "force", "time")


@dataclass(frozen=True)
class SiStep:
    """One step in SI, its unusable rows taken away: time and roles and channels (name -> values, unit)."""

    label: str
    time: FloatArray
    roles: Mapping[str, FloatArray]
    channels: Mapping[str, tuple[FloatArray, str]]


def convert(
    source: Source, request: Request, part: Part, *, several: bool, settled: bool, begin: float | None
) -> tuple[SiStep, list[Finding]]:
    """Return one step in SI and what was noticed; `settled` keeps empty columns as well. Raises `LogError`.

    begin: the time of its first row [s] in that of the user's window, None where that is not told before steps are
    joined.
    """
    label = f"step {part.number}" if several else ""
    _check_roles(source, request, part, label)
    refuse_doubtful_roles(source, request, part)
    choices = _choices(part)  # before any column is turned into SI where it stands
    raw_time = _role(source, request, part, "time")
    wanted = slice(None) if begin is None else _wanted(raw_time, begin, unused_spans(request))
    time, rows, notes = usable_rows(source, StepClock(label, _kept(raw_time, wanted)))
    if not isinstance(wanted, slice):
        rows = wanted[rows]
    notes += choices
    timeless = np.zeros(0, bool) if isinstance(rows, slice) else ~np.isfinite(raw_time[rows])
    roles = {}
    for role in COLUMN_ROLES[1:] if "drive_speed" in part.header.roles else COLUMN_ROLES[1:3]:
        values = _kept(_role(source, request, part, role), rows)
        roles[role] = np.where(timeless, np.nan, values) if timeless.any() and role != "drive_speed" else values
    notes += _weights(request, part)
    if request.normal_force is not None:
        notes.append(_constant_load(request.normal_force, part))
    channels = {name: (_kept(values, rows), unit) for name, values, unit in _raw_channels(request, part, settled)}
    return SiStep(label, time, roles, channels), notes


def _wanted(time: FloatArray, begin: float, spans: Sequence[Span]) -> Rows:
    """Return the rows of a clock without those at which it stops, fails or falls in stretches that nobody uses."""
    if not spans or not np.isfinite(time).any() or rising(time):
        return slice(None)
    highest = np.concatenate(([-np.inf], np.fmax.accumulate(time)[:-1]))
    bad = ~(time > highest)
    first = time[np.argmax(np.isfinite(time))] - begin
    return np.flatnonzero(without_needless(time - first, bad, spans, ends=False))


def _kept(values: FloatArray, rows: Rows) -> FloatArray:
    """Return the rows of a column; all of them without a view, which the record would have to copy."""
    return values if isinstance(rows, slice) else values[rows]


def _choices(part: Part) -> list[Finding]:
    """Say where another column might have been meant, unless it only repeats the one taken."""
    notes = []
    for role, others in part.header.passed_over.items():
        index = part.header.roles[role]
        taken = part.columns.get(index)
        differing = [i for i in others if i in part.columns and not _same(taken, part.columns[i])]
        if differing:
            named = shown(part.header.names[i].raw for i in differing)
            text = f"the {words(role)} was taken from {shown([part.header.names[index].raw])}, not from {named}"
            notes.append(Finding("column_choice", "info", text))
    return notes


def _weights(request: Request, part: Part) -> list[Finding]:
    """Say where a unit of mass was taken as the weight of it."""
    units = {role: _unit(request, part, role) or "" for role in COLUMN_ROLES[1:3] if role in part.header.roles}
    if request.normal_force is not None:
        units.pop("normal_force", None)
    found = sorted({unit for unit in units.values() if is_mass(unit)})
    if not found:
        return []
    text = f"forces in {' and '.join(found)} were taken as weights, {found[0]} as {found[0]}-force"
    return [Finding("unit_by_context", "info", text)]


def _same(one: FloatArray | None, other: FloatArray) -> bool:
    """Tell equal columns; block by block, because those that differ mostly do so soon."""
    if one is None or one.size != other.size:
        return False
    blocks = (slice(begin, begin + BLOCK) for begin in range(0, one.size, BLOCK))
    return all(np.array_equal(one[rows], other[rows], equal_nan=True) for rows in blocks)


def _check_roles(source: Source, request: Request, part: Part, label: str) -> None:
    """Name a missing column, or all missing units at once."""
    needed = [role for role in COLUMN_ROLES[:3] if role != "normal_force" or request.normal_force is None]
    needed += ["drive_speed"] if "drive_speed" in part.header.roles else []
    for role in needed:
        if role in part.header.roles and (unit := _unit(request, part, role)):
            _check_unit(source, part, role, unit)
    missing = [role for role in needed if role not in part.header.roles]
    bare = [role for role in needed if role not in missing and not _unit(request, part, role)]
    if missing:
        raise source.error(_missing(missing, bare, part, label))
    if bare:
        which = ", ".join(f"{shown([part.header.names[part.header.roles[role]].raw])} ({words(role)})" for role in bare)
        raise source.error(
            f"no unit was found for column {which}; a unit in the header was expected; give it, as in {_in_si(bare)}"
        )


def _check_unit(source: Source, part: Part, role: str, unit: str) -> None:
    try:
        column_factor(unit, SI_UNIT[KIND[role]], part.header.names[part.header.roles[role]].unit)
    except UnitError as error:
        where = f"column {shown([part.header.names[part.header.roles[role]].raw])} ({words(role)})"
        way = f"--units {role}=..."
        if unit in _VOLTS:
            way = f'the scale of its sensor, as in --units {role}="2.5 N/V"'
        raise source.error(f"{where}: {error}; or give it with {way}") from error


def _missing(missing: Sequence[str], bare: Sequence[str], part: Part, label: str) -> str:
    """Ask for all that is missing at once: columns, and the units that these and others will lack."""
    taken = set(part.header.roles.values())
    free = [name for i, name in enumerate(part.header.names) if i not in taken]
    unitless = [*bare, *(missing if all(name.unit is None for name in free) else ())]
    there = shown(name.name for name in part.header.names)
    examples = ", ".join(EXAMPLES.get(role, role) for role in missing)
    columns = ",".join(f"{role}=<name>" for role in missing)
    text = (
        f"no {' column and no '.join(words(role) for role in missing)} column was found among {there}"
        f"{' in ' if label else ''}{label}; a name such as {examples} was expected; say which one it is "
        f"with --columns {columns}"
    )
    text += f" and the units that the header lacks, as in {_in_si(unitless)}" if unitless else ""
    text += ', or give a constant load with --normal-force "3 N"' if "normal_force" in missing else ""
    text += ', or the sampling rate with --rate "100 Hz"' if "time" in missing else ""
    return text + (", or choose another step with --step" if label else "")


def _in_si(roles: Sequence[str]) -> str:
    return "--units " + ",".join(f"{role}={SI_UNIT[KIND[role]]}" for role in roles)


def _unit(request: Request, part: Part, role: str) -> str | None:
    name = part.header.names[part.header.roles[role]]
    return _asked_unit(request, role, name) or name.unit


def _asked_unit(request: Request, role: str, name: Name) -> str | None:
    return request.units.get(role) or request.units.get(name.name) or request.units.get(name.raw)


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
    scale = column_factor(_unit(request, part, role) or "", SI_UNIT[KIND[role]], name.unit)
    return rescaled(part.columns[index], scale)


def _filled(part: Part, index: int) -> int | None:
    """Return the index of a column; where it is empty and another of the same name and unit is not, of that one."""
    name = part.header.names[index]
    twins = (index, *(i for i, column in enumerate(part.header.names) if column == name))
    return next((other for other in twins if _any_finite(part.columns.get(other))), None)


def _any_finite(column: FloatArray | None) -> bool:
    return column is not None and bool(np.isfinite(column[:1]).any() or np.isfinite(column).any())


def origin(request: Request, part: Part, role: str) -> str:
    """Say in words where a role was taken from."""
    if role == "normal_force" and request.normal_force is not None:
        return f"constant {request.normal_force:g} N, given by the user"
    name = part.header.names[part.header.roles[role]]
    unit = _asked_unit(request, role, name)
    return f"column {name.name}" + (f" in {unit}, given by the user" if unit else f" in {name.unit}")


def _constant_load(load: float, part: Part) -> Finding:
    index = part.header.roles.get("normal_force")
    instead = f"; the file's column {part.header.names[index].name!r} was set aside" if index is not None else ""
    text = f"the normal force is a constant {load:g} N given by the user{instead}"
    return Finding("normal_force_constant", "info", text)


def _raw_channels(request: Request, part: Part, settled: bool) -> list[tuple[str, FloatArray, str]]:
    """Return name, values and unit of the columns that carry no role; metres, seconds and newtons where it can be."""
    own = {find_column(part.header.names, column): name for name, column in request.columns.items()}
    found: list[tuple[str, FloatArray, str]] = []
    taken: set[str] = set(COLUMN_ROLES)
    roles = {r: i for r, i in part.header.roles.items() if request.normal_force is None or r != "normal_force"}
    used = {*roles.values(), *(_filled(part, index) for index in roles.values())}
    for index, values in part.columns.items():
        if index in used or not (settled or _any_finite(values)):
            continue
        column = part.header.names[index]
        name = free_name(own.get(index, _clean(column, index)), taken)
        taken.add(name)
        unit = request.units.get(name) or request.units.get(column.name) or column.unit or ""
        kind = kind_of(unit) if unit else None
        if kind in _CHANNEL_KINDS:
            values, unit = rescaled(values, factor(unit, SI_UNIT[kind])), SI_UNIT[kind]
        found.append((name, values, unit))
    return found


def _clean(column: Name, index: int) -> str:
    text = "".join(letter for letter in column.name if letter.isprintable()).strip()
    return text or f"column {index + 1}"
