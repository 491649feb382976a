"""HDF5 logs: the project's layout, groups that each hold a test, or any file whose datasets the user names.

Instrument: none; acquisition programmes (MATLAB, LabVIEW, h5py) and this project write HDF5. Layout of ours:
`/run_1/step_1/{time,normal_force,friction_force,...}`, see `data_io.write`; several runs are the logs of an archive.
Elsewhere every group that holds a time and a friction force is a run, units in the attribute `units`. Quirks: column
vectors of shape (n, 1), integers and single precision, chunks and compression, names with blanks and umlauts. Only what
is asked for is read, so that a file may be larger than memory.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from data_io.columns import Header, Name, coefficient_column, match_header, role_indices, words
from data_io.contents import Contents, Part, unit_of
from data_io.hdf5_open import check_own, children, member, opened, signature_at
from data_io.hdf5_values import check_memory, check_promise, columns_within, named_within, read_values
from data_io.source import Request, Source
from data_io.units import factor, to_si
from data_io.values import COLUMN_ROLES, FloatArray, UnitError
from data_io.write import ABOUT, FORMAT, FORMAT_VERSION, Account, read_account

if TYPE_CHECKING:
    import h5py

_UNIT_NAMES: Final = ("units", "unit", "Units", "Unit")
_SHOWN: Final = 12
_DEEPEST: Final = 6
_MOST_GROUPS: Final = 2000


def can_read(head: bytes) -> bool:
    """Tell HDF5 by its signature, at the start or behind a user block."""
    return signature_at(head) is not None


@dataclass(frozen=True)
class _Table:
    """The columns of one step, not yet read: its run and number, header, datasets by index, attributes as text, and
    what is known of its run."""

    run: int
    step: int
    header: Header
    datasets: Mapping[int, h5py.Dataset]
    parameters: Mapping[str, str] = field(default_factory=dict)
    run_items: Mapping[str, str] = field(default_factory=dict)


def read(source: Source, request: Request) -> Contents:
    """Read a step or a whole run of the project's layout, or the datasets in `columns`. Raises `LogError`."""
    with opened(source) as file:
        if any("/" in path for path in request.columns.values()):
            parts, skipped = _parts(source, request, [_named(source, request, file)])
            return Contents(parts, skipped=skipped)
        runs = _groups(file, "run")
        ours = _text(file.attrs.get("format")) == FORMAT
        if ours or runs:
            return _read_layout(source, request, file, runs, ours=ours)
        parts, skipped = _parts(source, request, _tests(source, request, file))
        return Contents(parts, skipped=skipped)


def _parts(source: Source, request: Request, tables: Sequence[_Table]) -> tuple[list[Part], float]:
    """Read the steps that were asked for; of the others the names only. How long the log had run before [s]."""
    run = _the_run(source, request, tables)
    picked = {i for i, t in enumerate(tables) if t.run == run and request.step in (None, t.step)}
    request, span = _by_file_clock(request, [tables[i] for i in sorted(picked)])
    parts = [
        Part(
            table.run,
            table.step,
            table.header,
            _columns(source, request, table) if i in picked else _unread(table),
            table.parameters,
            run_items=table.run_items,
        )
        for i, table in enumerate(tables)
    ]
    return parts, _skipped(source, request, parts, span)


def _read_layout(
    source: Source, request: Request, file: h5py.File, runs: Sequence[tuple[int, h5py.Group]], *, ours: bool
) -> Contents:
    version = file.attrs.get("format_version", FORMAT_VERSION)
    if version != FORMAT_VERSION:
        raise source.error(f"layout version {version} was found; {FORMAT_VERSION} was expected; update this tool")
    wanted = [run for run in runs if run[0] == request.run] or runs  # the other logs of an archive need not be opened
    tables = []
    for run, run_group in wanted:
        for step, group in _groups(run_group, "step"):
            found = [(link, item) for link, item in children(group) if _is_dataset(item)]
            names = tuple(Name(name, name, unit) for name, unit in map(_named_column, found))
            header = Header(names, role_indices(names, request.columns))
            parameters = {key: _text(value) for key, value in group.attrs.items()}
            tables.append(_Table(run, step, header, dict(enumerate(item for _, item in found)), parameters))
    if not tables:
        raise source.error("no group /run_1/step_1 was found; the layout's groups were expected; convert the log again")
    of_run = dict(runs).get(_the_run(source, request, tables) or 0)
    place = file if of_run is None or ABOUT not in of_run else of_run
    account = _account(source, place)
    parts, skipped = _parts(source, request, tables)
    return Contents(parts, account.metadata, account.findings, ours, _drive_speed(source, place), skipped)


def _tests(source: Source, request: Request, file: h5py.File) -> list[_Table]:
    """Return every group that holds what a log needs, each a run of one step."""
    tables: list[_Table] = []
    for group in _all_groups(file):
        found = [(link, item) for link, item in children(group) if _is_dataset(item)]
        found = [column for link, item in found for column in _columns_of(link, item, request)]
        named = [_named_column(column) for column in found]
        header = match_header([name for name, _ in named], request.columns)
        units = zip(header.names, named, strict=True)
        header = replace(header, names=tuple(n if unit is None else replace(n, unit=unit) for n, (_, unit) in units))
        needed = {"time"} if request.rate is None else set()
        needed |= {"friction_force"} if coefficient_column(header) is None else set()
        needed |= {"normal_force"} if request.normal_force is None else set()
        if needed <= set(header.roles):
            datasets = dict(enumerate(item for _, item in found))
            tables.append(_Table(len(tables) + 1, 1, header, datasets, run_items={"group": str(group.name)}))
    if not tables:
        raise source.error(
            f"the HDF5 file is not in our layout (/run_1/step_1/time ...); {_datasets(file)}; "
            "name them, as in --columns time=/a,friction_force=/b,normal_force=/c"
        )
    return tables


def _named(source: Source, request: Request, file: h5py.File) -> _Table:
    """Return the datasets that the user named."""
    datasets = [_dataset_at(source, file, path) for path in request.columns.values()]
    for (role, path), dataset in zip(request.columns.items(), datasets, strict=True):
        if dataset is None:
            raise source.error(f"no dataset {path!r} was found for {words(role)}; {_datasets(file)}; name one")
    names = [Name(path, path, _unit(item)) for path, item in zip(request.columns.values(), datasets, strict=True)]
    roles = {role: index for index, role in enumerate(request.columns) if role in COLUMN_ROLES}
    return _Table(1, 1, Header(tuple(names), roles), dict(enumerate(datasets)))


def _dataset_at(source: Source, file: h5py.File, path: str) -> h5py.Dataset | None:
    """Return the dataset at a path, or a column within one (`/data:1`, `/table:Fx`, `/table/Fx`); None for neither."""
    found = member(source, file, path)
    if _is_dataset(found):
        return found
    for mark in (":", "/"):
        outer, _, key = path.rpartition(mark)
        dataset = member(source, file, outer) if outer else None
        for column in columns_within(dataset) if _is_dataset(dataset) else ():
            if key in (column.label, column.name.rpartition(":")[2]):
                return column
    return None


def _by_file_clock(request: Request, tables: Sequence[_Table]) -> tuple[Request, tuple[float, float]]:
    """Return the request with its window in the clock of the file, and where that begins and ends [s].

    Where the clocks of several steps do not go on, no window can be found in them: everything is read, and cut later.
    """
    clocks = [_clock(request, table) for table in tables if table.datasets]
    clocks = [(time, scale) for time, scale in clocks if time.size]
    if request.window is None or not clocks or any(scale is None for _, scale in clocks):
        return replace(request, window=None), (0.0, 0.0)
    ends = [(_number_at(time, 0), _number_at(time, time.size - 1)) for time, _ in clocks]
    begin, end = ends[0][0] * (clocks[0][1] or 1.0), ends[-1][1] * (clocks[-1][1] or 1.0)
    if any(later[0] <= before[1] for before, later in pairwise(ends)):
        return replace(request, window=None), (0.0, 0.0)
    start, stop = request.window
    return replace(request, window=(start + begin, stop + begin)), (begin, end)


def _skipped(source: Source, request: Request, parts: Sequence[Part], span: tuple[float, float]) -> float:
    """Return how long the log had run [s] before the first row that was read; span: as `_by_file_clock` gives it."""
    if request.window is None:
        return 0.0
    read = [part for part in parts if part.rows and np.isfinite(part.columns[part.header.roles["time"]][0])]
    rows = sum(part.rows for part in read)
    if rows < 2:
        start, stop = (time - span[0] for time in request.window)
        clock = f", counted from its first row, where the clock of the file shows {span[0]:.6g} s" if span[0] else ""
        raise source.error(
            f"the window {start:g} to {stop:g} s holds {rows} row(s); the log runs from 0 to "
            f"{span[1] - span[0]:.6g} s{clock}; move the window inside"
        )
    index = read[0].header.roles["time"]
    scale = factor(unit_of(request, read[0].header, index) or "s", "s")
    return float(read[0].columns[index][0]) * scale - span[0]


def _named_column(column: tuple[str, h5py.Dataset]) -> tuple[str, str | None]:
    """Return the name of a column, by its attribute or its link, and its unit."""
    link, item = column
    return _text(item.attrs.get("name")) or link, _unit(item)


def _columns_of(link: str, item: h5py.Dataset, request: Request) -> list[tuple[str, h5py.Dataset]]:
    """Return name and dataset of what is a column, or the columns within: where they have names or were asked for."""
    if _is_column(item):
        return [(link, item)]
    wanted = named_within(item) or any(name.startswith(f"{link}:") for name in request.columns.values())
    return [(column.label, column) for column in columns_within(item)] if wanted else []


def _the_run(source: Source, request: Request, tables: Sequence[_Table]) -> int | None:
    """Return the run that will be read; None where it is open which, and nothing need be read."""
    if request.run is not None:
        return request.run
    runs = {table.run for table in tables if request.step in (None, table.step)}
    if not runs:
        held = ", ".join(str(step) for step in sorted({table.step for table in tables})[:_SHOWN])
        raise source.error(f"step {request.step} was asked for; the log holds step {held}; choose one of them")
    return runs.pop() if len(runs) == 1 else None


def _unread(table: _Table) -> dict[int, FloatArray]:
    """Columns as long as they are, without their numbers: nobody asked for them."""
    unread = np.float64(np.nan)
    return {index: np.broadcast_to(unread, int(item.size or 0)) for index, item in table.datasets.items()}


def _columns(source: Source, request: Request, table: _Table) -> dict[int, FloatArray]:
    """Read the columns with a role, and the channels that were asked for; within the window, if there is one."""
    header, datasets = table.header, table.datasets
    wanted = [
        index
        for index, name in enumerate(header.names)
        if index in header.roles.values() or request.channels is None or name.name in request.channels
        or name.name in request.columns.values()
    ]  # fmt: skip
    for index in wanted:
        data = datasets[index]
        if not _is_column(data):
            raise source.error(
                f"dataset {data.name!r} holds {data.dtype} of shape {data.shape or ()}; a column of numbers was "
                "expected; name another one with --columns"
            )
        check_own(source, data)
        stored, packed = data.id.get_storage_size(), data.compression is not None
        check_promise(source, str(data.name), data.size * data.dtype.itemsize, stored, packed)
    if len({datasets[index].size for index in wanted}) > 1:
        sizes = ", ".join(f"{header.names[index].name} {datasets[index].size}" for index in wanted)
        raise source.error(f"the datasets differ in length ({sizes:.200}); equal lengths were expected; export again")
    if not header.names:
        return {}
    time, scale = _clock(request, table)
    rows = slice(0, int(time.size))
    if request.window is not None and scale is not None:  # by `_by_file_clock` it is in the clock of the file
        start = _bisected(time, request.window[0] / scale, after=False)
        rows = slice(start, max(_bisected(time, request.window[1] / scale, after=True), start))
    check_memory(
        source,
        rows.stop - rows.start,
        len(wanted),
        lambda row: (_number_at(time, row) - _number_at(time, 0)) * (scale or 1.0),
    )
    columns = {}
    for count, index in enumerate(wanted):

        def tell(share: float, count: int = count) -> None:
            request.progress((count + share) / len(wanted))

        columns[index] = read_values(datasets[index], rows, tell)
    return columns


def _clock(request: Request, table: _Table) -> tuple[h5py.Dataset, float | None]:
    """The clock of the file, or its first column, and the factor to seconds; None where nothing tells seconds."""
    index = table.header.roles.get("time", 0)
    time = table.datasets[index]
    if "time" not in table.header.roles or time.size == 0:
        return time, None
    try:
        return time, factor(unit_of(request, table.header, index) or "s", "s")
    except UnitError:
        return time, None


def _bisected(time: h5py.Dataset, value: float, *, after: bool) -> int:
    low, high = 0, int(time.size)
    while low < high:
        middle = (low + high) // 2
        here = _number_at(time, middle)
        if here < value or (after and here == value):
            low = middle + 1
        else:
            high = middle
    return low


def _number_at(dataset: h5py.Dataset, row: int) -> float:
    """The number in a row of a dataset that is a column, whichever way it lies."""
    lying = dataset.size > 1
    place = tuple(row if size != 1 else 0 for size in dataset.shape) if lying else (0,) * dataset.ndim
    return float(np.ravel(dataset[place])[0])


def _groups(parent: h5py.Group, word: str) -> list[tuple[int, h5py.Group]]:
    """Return number and group of `run_1`, `run_2`, ... in the order of their numbers."""
    found = [(re.fullmatch(rf"{word}_(\d{{1,9}})", name), item) for name, item in children(parent)]
    return sorted(
        ((int(match[1]), item) for match, item in found if match and not _is_dataset(item)), key=lambda pair: pair[0]
    )


def _all_groups(file: h5py.File) -> list[h5py.Group]:
    """The root and every group below it, in the order of the file, to a sensible depth and number."""
    import h5py

    found, level = [file["/"]], [file["/"]]
    for _ in range(_DEEPEST):
        level = [item for group in level for _, item in children(group) if isinstance(item, h5py.Group)]
        found += level
        if len(found) > _MOST_GROUPS:
            break
    return found[:_MOST_GROUPS]


def _is_dataset(item: h5py.HLObject | None) -> bool:
    import h5py

    return isinstance(item, h5py.Dataset)


def _is_column(dataset: h5py.Dataset) -> bool:
    shape = dataset.shape or ()
    return bool(shape) and dataset.dtype.kind in "fiu" and sum(size != 1 for size in shape) <= 1


def _unit(dataset: h5py.Dataset) -> str | None:
    return next((_text(dataset.attrs[name]).strip() for name in _UNIT_NAMES if name in dataset.attrs), None)


def _text(value: Any) -> str:
    """Return an attribute as text, "" where there is none."""
    if value is None:
        return ""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    return value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)


def _account(source: Source, place: h5py.Group) -> Account:
    item: Any = member(source, place, f"{place.name}/{ABOUT}") if ABOUT in place else None
    if not _is_dataset(item):
        keys = ("source_file", "source_sha256")
        return Account({key: _text(place.attrs[key]) for key in keys if key in place.attrs})
    try:
        return read_account(_text(item[()]))
    except ValueError as error:
        text = f"the dataset {item.name} does not hold our JSON account; remove it or convert the log again"
        raise source.error(text) from error


def _drive_speed(source: Source, place: h5py.Group) -> float | None:
    if "drive_speed" not in place.attrs:
        return None
    try:
        return to_si(float(place.attrs["drive_speed"]), _text(place.attrs.get("drive_speed_units")), "speed")
    except (UnitError, ValueError, TypeError) as error:
        raise source.error(f"the attribute drive_speed: {error}; correct it and drive_speed_units") from error


def _datasets(file: h5py.File) -> str:
    there = [item for group in _all_groups(file) for _, item in children(group) if _is_dataset(item)]
    within = {item.name: [c.name for c in columns_within(item)] for item in there if not _is_column(item)}
    found = [name for item in there for name in within.get(item.name, []) or [item.name]]
    more = ", ..." if len(found) > _SHOWN else ""
    return f"the datasets are {', '.join(found[:_SHOWN])}{more}" if found else "it holds no datasets"
