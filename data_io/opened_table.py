"""A table of numbers while it is read piece by piece, and when it is whole."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from data_io.clock_times import over_midnight
from data_io.columns import Header, coefficient_column, distance_columns, find_column, with_unit
from data_io.frozen import Finding, FloatArray
from data_io.layout import Head
from data_io.rows import Above, Numbers
from data_io.source import Request

_MOST_REMARKS: Final = 20


@dataclass(frozen=True)
class Table:
    """One block of numbers: header, columns by index (n,), the text above it, the line of its first row, remarks."""

    header: Header
    columns: Mapping[int, FloatArray]
    preamble: tuple[str, ...]
    first_line: int
    remarks: tuple[Finding, ...] = ()

    @property
    def rows(self) -> int:
        """Number of rows."""
        return min((column.size for column in self.columns.values()), default=0)


@dataclass
class OpenTable:
    """A table whose rows are still being read; wanted: the columns that are kept (None: all); decimal: the mark, as far
    as its rows tell."""

    head: Head
    preamble: tuple[str, ...]
    first_line: int
    wanted: frozenset[int] | None
    decimal: str | None = None
    remarks: list[Finding] = field(default_factory=list)
    _pieces: list[dict[int, FloatArray]] = field(default_factory=list)
    _rows: list[int] = field(default_factory=list)
    _fields: int | None = None
    _days: list[Mapping[int, FloatArray | None]] = field(default_factory=list)
    _units: dict[int, str] = field(default_factory=dict)

    def add(self, numbers: Numbers) -> None:
        """Put rows below those that are there."""
        self.remarks += numbers.remarks
        self.decimal = self.decimal or numbers.decimal
        self._fields = self._fields or numbers.fields
        self._units |= numbers.units
        if numbers.rows:
            kept = numbers.columns.items()
            self._pieces.append({i: v for i, v in kept if self.wanted is None or i in self.wanted})
            self._days.append(numbers.days)
            self._rows.append(numbers.rows)

    def above(self, ending: str | None) -> Above:
        """Return what the rows so far tell of those below; `ending`: their text where the log ends soon."""
        return Above(self.decimal, self._fields, frozenset().union(*self._pieces), ending)

    def close(self) -> Table:
        """Return the whole table; rows at its end that hold nothing, as spreadsheets leave them, are taken away."""
        header = self.head.header
        columns: dict[int, FloatArray] = {}
        for index in sorted(set().union(*self._pieces)):
            pieces = [piece.pop(index, None) for piece in self._pieces]
            filled = [np.full(n, np.nan) if p is None else p for p, n in zip(pieces, self._rows, strict=True)]
            columns[index] = filled[0] if len(filled) == 1 else np.concatenate(filled)
        if not self._pieces:
            columns = {index: np.empty(0) for index in range(len(header.names))}
        end = sum(self._rows)
        if end and all(np.isnan(column[-1]) for column in columns.values()):
            full = np.flatnonzero(np.any([~np.isnan(column) for column in columns.values()], axis=0))
            end = int(full[-1]) + 1 if full.size else 0
            columns = {index: column[:end] for index, column in columns.items()}
        clocks = set().union(*self._days) & set(columns)
        for index in clocks:
            days = [piece.get(index) for piece in self._days]
            dated = [np.full(n, np.nan) if d is None else d for d, n in zip(days, self._rows, strict=True)]
            columns[index] = over_midnight(columns[index], np.concatenate(dated)[:end])
        for index, unit in self._units.items():
            if header.names[index].unit is None:
                header = with_unit(header, index, unit)
        header = _with_clock(header, columns, clocks)
        remarks = list(dict.fromkeys(self.remarks))
        if len(remarks) > _MOST_REMARKS:
            text = f"and {len(remarks) - _MOST_REMARKS} remarks more of this kind"
            remarks = [*remarks[:_MOST_REMARKS], Finding("text_in_rows", "warning", text)]
        return Table(header, columns, self.preamble, self.first_line, tuple(remarks))


def _with_clock(header: Header, columns: Mapping[int, FloatArray], clocks: Set[int]) -> Header:
    """Return a header in which times of the day are seconds, and an elapsed time beside them is the clock."""
    for index in clocks:
        header = with_unit(header, index, "s")
    taken, others = header.roles.get("time"), header.passed_over.get("time", ())
    elapsed = [i for i in others if i not in clocks and i in columns and np.isfinite(columns[i]).any()]
    if taken not in clocks or not elapsed:
        return header
    roles = {**header.roles, "time": elapsed[0]}
    passed = {**header.passed_over, "time": tuple(i for i in (taken, *others) if i is not None and i != elapsed[0])}
    return replace(header, roles=roles, passed_over=passed)


def wanted_columns(header: Header, request: Request, keep: Sequence[str] = ()) -> frozenset[int] | None:
    """Return which columns of a header are to be read: None for all, else those with a role and those asked for."""
    if request.channels is None:
        return None
    named = (find_column(header.names, name) for name in (*request.channels, *request.columns.values(), *keep))
    clocks = header.passed_over.get("time", ())
    own = {header.names[index] for index in (*header.roles.values(), *clocks)}
    if "friction_force" not in header.roles and (coefficient := coefficient_column(header)) is not None:
        own.add(header.names[coefficient])
    if "time" not in header.roles and (way := distance_columns(header)) is not None:
        own |= {header.names[index] for index in way}
    twins = {index for index, name in enumerate(header.names) if name in own}
    return frozenset(twins | {index for index in named if index is not None})
