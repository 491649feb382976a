"""One step in SI: which raw column is which, units, rows without a time, channels; a sentence where one is missing."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from data_io.arrays import same, thinned, thinned_steps
from data_io.clock import Rows, StepClock, usable_rows
from data_io.columns import ALIASES, EXAMPLES, KIND, find_column, shown, words
from data_io.contents import Part, unit_of
from data_io.record import rising
from data_io.source import Request, Source
from data_io.units import SI_UNIT, column_factor, factor, is_mass, kind_of, rescaled
from data_io.values import COLUMN_ROLES, LARGEST_FORCE, Finding, FloatArray, UnitError, free_name

# What the user's window and exclude leave unused may hold whatever it likes: it goes before anything is checked.

Span = tuple[float, float]
_ALWAYS: Final = float("inf")


def unused_spans(request: Request) -> list[Span]:
    """Return the stretches [s], ends included, that the user does not want, counted from the first row of the log."""
    spans = list(request.exclude)
    if request.window is not None:
        start, stop = request.window
        spans += [(-_ALWAYS, float(np.nextafter(start, -_ALWAYS))), (float(np.nextafter(stop, _ALWAYS)), _ALWAYS)]
    return spans


def without_needless(
    time: FloatArray, bad: npt.NDArray[np.bool_], spans: Sequence[Span], *, ends: bool
) -> npt.NDArray[np.bool_]:
    """Return which rows (n,) to keep: all but those `bad` ones that stand in an unused stretch.

    time: (n,) [s] from the first row of the log on, in the order of the file; it may hold NaN and fall, so that a
    stretch is the rows from the first one at its begin to the first one behind its end. ends: keep the first and last
    row of a stretch that is bad all over, so that it is still seen that there was one. The first row is always kept.
    """
    keep = np.ones(time.size, dtype=bool)
    for first, last in spans:
        start = 0 if first == -_ALWAYS else _first_row(time >= first)
        stop = start + _first_row(time[start:] > last)
        whole = bool(bad[start:stop].all())
        keep[start:stop] &= ~bad[start:stop]
        if ends and whole and stop > start:
            keep[[start, stop - 1]] = True
    keep[:1] = True
    return keep


def _first_row(true: npt.NDArray[np.bool_]) -> int:
    """Return the number of the first row that is true, the number of rows where none is."""
    return int(np.argmax(true)) if true.any() else true.size


# A role that a column got by its name alone, while another column does the job: asked, with both named.

_AXIS: Final = re.compile(r"(f|force|kraft)[xy]|[xy](force|kraft)?")
"""Keys of columns along the surface, of which one holds the friction force and the other hardly anything."""
_STILL: Final = 1.5
"""Standard deviations of its white noise up to which a column stands still."""
_MOVES: Final = 3.0
"""Standard deviations of its white noise from which a column moves."""
_FAR: Final = 5.0
"""By how much more the other column moves than the one that was taken."""
_FEWEST: Final = 50


# Marks for no value: a display over range, or a logger without a reading, writes one number far from all others.

_NO_VALUE: Final = (32767.0, 32768.0, 65535.0, 2147483647.0)
_MARK_FAR: Final = 3.0
"""Times the range of all other numbers, by which a mark lies outside it."""


def without_marks(part: Part) -> tuple[Part, list[Finding]]:
    """Return the part without the rows in which a force is a mark for no value, and what to say of it."""
    notes, rows = [], np.zeros(part.rows, dtype=bool)
    for role in COLUMN_ROLES[1:3]:
        index = part.header.roles.get(role, -1)
        values = part.columns.get(index)
        if values is None or values.size < _FEWEST or (mark := _mark_of(values)) is None:
            continue
        marked = values == mark
        rows |= marked
        text = (
            f"{np.count_nonzero(marked)} row(s) of {shown([part.header.names[index].raw])} hold {mark:g}, far from all "
            "others and again and again: a mark for no value; they were left out"
        )
        notes.append(Finding("no_value_mark", "warning", text))
    if not notes:
        return part, notes
    return replace(part, columns={index: values[~rows] for index, values in part.columns.items()}), notes


def _mark_of(values: FloatArray) -> float | None:
    """Return the mark for no value in a column (n,), None where it has none."""
    for mark in (float(np.nanmax(values)), float(np.nanmin(values))) if np.isfinite(values).any() else ():
        digits = f"{abs(mark):.10g}".replace(".", "").strip("0")
        if not (abs(mark) in _NO_VALUE or (len(digits) > 2 and set(digits) == {"9"})):
            continue
        others = values[np.isfinite(values) & (values != mark)]
        if others.size < values.size // 2 or np.count_nonzero(values == mark) < 2:
            continue
        low, high = float(np.min(others)), float(np.max(others))
        if max(mark - high, low - mark) > _MARK_FAR * (high - low):
            return mark
    return None


class _Look:
    """What a column of force looks like [N]: its ends but for few rows, median size, scatter, white noise in it."""

    def __init__(self, values: FloatArray, scale: float) -> None:
        few, steps = scale * thinned(values), scale * thinned_steps(values)
        few, steps = few[np.abs(few) <= LARGEST_FORCE], steps[np.abs(steps) <= LARGEST_FORCE]
        low, high = np.quantile(few, [0.025, 0.975]) if few.size else (0.0, 0.0)
        self.low, self.high = float(low), float(high)
        self.size = max(abs(self.low), abs(self.high))
        self.level = float(np.median(np.abs(few))) if few.size else 0.0
        self.scatter = (self.high - self.low) / 3.92
        self.noise = float(np.sqrt(np.mean(steps**2) / 2.0)) if steps.size else 0.0

    @property
    def still(self) -> bool:
        """Whether nothing but white noise is there."""
        return self.scatter <= _STILL * self.noise or self.scatter == 0.0

    @property
    def moves(self) -> bool:
        """Whether more than white noise is there."""
        return self.scatter > _MOVES * self.noise > 0.0


def refuse_doubtful_roles(source: Source, request: Request, part: Part) -> None:
    """Ask where the friction force stands still and another force along the surface moves, or the load does instead.

    What the user named is not doubted. Raises the source's `LogError` with both names.
    """
    roles = part.header.roles
    index = roles.get("friction_force")
    if index is None or "friction_force" in request.columns or part.rows < _FEWEST or index not in part.columns:
        return
    names = part.header.names
    rivals = [
        i
        for i, name in enumerate(names)
        if i != index and i in part.columns and i != roles.get("normal_force")
        and (name.key in ALIASES["friction_force"] or _AXIS.fullmatch(name.key))
    ]  # fmt: skip
    load = None if request.normal_force is not None else roles.get("normal_force")
    if not rivals and load is None:
        return
    taken = _look(request, part, index)
    if taken is None or not taken.still:
        return
    for i in rivals:
        other = _look(request, part, i)
        if other is not None and other.moves and other.scatter > _FAR * taken.scatter and other.level > 2 * taken.level:
            raise source.error(
                f"{shown([names[index].raw])} is called as the friction force and stands still at {taken.level:.3g} N, "
                f"while {shown([names[i].raw])} moves from {other.low:.3g} to {other.high:.3g} N; one friction force "
                f"was expected; say which with --columns friction_force={names[i].name} or "
                f"friction_force={names[index].name}"
            )
    normal = None if load is None else _look(request, part, load)
    if load is None or normal is None or not normal.moves or taken.size <= normal.size:
        return
    if normal.scatter * taken.level > _FAR * taken.scatter * normal.level:
        raise source.error(
            f"{shown([names[index].raw])} is called as the friction force and stands still at {taken.level:.3g} N, "
            f"while {shown([names[load].raw])}, called as the normal force, moves from {normal.low:.3g} to "
            f"{normal.high:.3g} N; the two may be swapped; say which is which with --columns "
            f"friction_force={names[load].name},normal_force={names[index].name} or the other way round"
        )


def _look(request: Request, part: Part, index: int) -> _Look | None:
    """Return what a column of force looks like; None where its unit is none of force."""
    columns = (index, part.header.roles["friction_force"])  # a column without a unit is in that of the other
    unit = next(filter(None, (unit_of(request, part.header, i) for i in columns)), "")
    try:
        return _Look(part.columns[index], factor(unit, "N"))
    except UnitError:
        return None


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
        index = part.header.roles.get("normal_force")
        aside = "" if index is None else f"; the file's column {part.header.names[index].name!r} was set aside"
        text = f"the normal force is a constant {request.normal_force:g} N given by the user{aside}"
        notes.append(Finding("normal_force_constant", "info", text))
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
        differing = [i for i in others if i in part.columns and not same(taken, part.columns[i])]
        if differing:
            named = shown(part.header.names[i].raw for i in differing)
            text = f"the {words(role)} was taken from {shown([part.header.names[index].raw])}, not from {named}"
            notes.append(Finding("column_choice", "info", text))
    return notes


def _weights(request: Request, part: Part) -> list[Finding]:
    """Say where a unit of mass was taken as the weight of it."""
    units = {role: _unit(request, part, role) for role in COLUMN_ROLES[1:3] if role in part.header.roles}
    if request.normal_force is not None:
        units.pop("normal_force", None)
    found = sorted({unit for unit in units.values() if is_mass(unit)})
    if not found:
        return []
    text = f"forces in {' and '.join(found)} were taken as weights, {found[0]} as {found[0]}-force"
    return [Finding("unit_by_context", "info", text)]


def _check_roles(source: Source, request: Request, part: Part, label: str) -> None:
    """Name a missing column, or all missing units at once."""
    needed = [role for role in COLUMN_ROLES[:3] if role != "normal_force" or request.normal_force is None]
    needed += ["drive_speed"] if "drive_speed" in part.header.roles else []
    for role in needed:
        if role not in part.header.roles or not (unit := _unit(request, part, role)):
            continue
        name = part.header.names[part.header.roles[role]]
        try:
            column_factor(unit, SI_UNIT[KIND[role]], name.unit)
        except UnitError as error:
            scale = f'the scale of its sensor, as in --units {role}="2.5 N/V"'
            way = scale if unit in _VOLTS else f"--units {role}=..."
            text = f"column {shown([name.raw])} ({words(role)}): {error}; or give it with {way}"
            raise source.error(text) from error
    missing = [role for role in needed if role not in part.header.roles]
    bare = [role for role in needed if role not in missing and not _unit(request, part, role)]
    if missing:
        raise source.error(_missing(missing, bare, part, label))
    if bare:
        which = ", ".join(f"{shown([part.header.names[part.header.roles[role]].raw])} ({words(role)})" for role in bare)
        raise source.error(
            f"no unit was found for column {which}; a unit in the header was expected; give it, as in {_in_si(bare)}"
        )


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
    scale = column_factor(_unit(request, part, role), SI_UNIT[KIND[role]], name.unit)
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
    name, unit = part.header.names[part.header.roles[role]], _unit(request, part, role)
    given = any(request.units.get(key) for key in (role, name.name, name.raw))
    return f"column {name.name} in {unit}" + (", given by the user" if given else "")


def _raw_channels(request: Request, part: Part, settled: bool) -> list[tuple[str, FloatArray, str]]:
    """Return name, values and unit of the columns that carry no role; metres, seconds and newtons where it can be."""
    own = {find_column(part.header.names, column): name for name, column in request.columns.items()}
    found: list[tuple[str, FloatArray, str]] = []
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
        found.append((name, values, unit))
    return found
