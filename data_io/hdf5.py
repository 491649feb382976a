"""HDF5 logs: the project's layout, groups that each hold a test, or any file whose datasets the user names.

Instrument: none; acquisition programmes (MATLAB, LabVIEW, h5py) and this project write HDF5. Layout of ours:
`/run_1/step_1/{time,normal_force,friction_force,...}`, see `data_io.write`; several runs are the logs of an archive.
Elsewhere every group that holds a time and a friction force is a run, units in the attribute `units`. Quirks: column
vectors of shape (n, 1), integers and single precision, chunks and compression, names with blanks and umlauts, columns
of a matrix (`/data:1`) or of a compound (`/table:Fx`). Only what is asked for is read, so that a file may be larger
than memory. Files are opened so that they can do no harm: read-only, nothing outside followed, none that hangs.
"""

from __future__ import annotations

import contextlib
import functools
import io
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from data_io.columns import Header, Name, coefficient_column, match_header, role_indices, words
from data_io.contents import Contents, Part
from data_io.source import LEAST_SUSPECT, OF_DAMAGE, Request, Source
from data_io.units import factor, scaled
from data_io.values import COLUMN_ROLES, FloatArray, LogError, UnitError, listed
from data_io.write import ABOUT, FORMAT, FORMAT_VERSION, Account, read_account

if TYPE_CHECKING:
    import h5py

    _Table = tuple[Part, list[h5py.Dataset]]

_UNITS: Final = ("units", "unit", "Units", "Unit", "column_units")
_NAMES: Final = ("columns", "column_names", "names", "labels", "channels", "channel_names", "fields", "header")
"""Attributes in which programmes keep the names of the columns of a matrix."""
_MOST_GROUPS: Final = 2000
_PATIENCE: Final = 1
"""Seconds of computing after which a file whose structure is not walked through is given up; a sound one takes
milliseconds."""
_HELD: Final = ("unable to lock file", "already open for write")
"""What the library says of a file that is sound, but not free."""

# Files opened so that they can do no harm.


def can_read(head: bytes) -> bool:
    """Tell HDF5 by its signature, at the start or behind a user block."""
    return any(head[place : place + 8] == b"\x89HDF\r\n\x1a\n" for place in (0, *(512 << i for i in range(7))))


@contextmanager
def opened(source: Source) -> Iterator[h5py.File]:
    """Open the file read-only. Raises the source's `LogError` for a damaged one.

    A damaged file can send the HDF5 library round in circles, where nothing stops it: its heaps of texts carry no
    checksum in any version. Another process therefore walks through it first, and is stopped after some seconds.
    """
    import h5py

    target = source.file()
    damaged = "the HDF5 file is damaged ({:.120}); an intact one is needed; copy it again"
    if hasattr(os, "fork"):  # Windows has no way to limit the computing of a process
        if isinstance(target, str):
            status = Path(target).stat()
            ended = _walked(os.path.realpath(target), status.st_ino, status.st_size, status.st_mtime_ns)
        else:
            ended = _forked(target, _PATIENCE)
        if ended < 0:  # by a signal
            wrong = "the library hangs on it" if ended == -signal.SIGXCPU else "the library crashes on it"
            raise source.error(damaged.format(wrong))
    try:
        with h5py.File(target, "r", **({"locking": "best-effort"} if source.held is None else {})) as file:
            yield file
    except LogError:
        raise
    except OF_DAMAGE as error:
        reason = str(error).strip("'\"").split("\n")[0]
        if any(words in reason for words in _HELD):
            raise source.error(
                "another program has the HDF5 file open for writing, or ended without closing it; a closed file was "
                "expected; close it there, or after a crash run: h5clear -s FILE"
            ) from error
        raise source.error(damaged.format(reason)) from error


@functools.lru_cache(maxsize=256)
def _walked(path: str, _inode: int, size: int, _changed: int) -> int:
    """How another process ends that walks through a file as it is now (negative: by that signal)."""
    patience = _PATIENCE + int(size / 2e9)  # bytes a second
    # a copy of this process would inherit the locks of its other threads
    if sys.platform == "linux" and threading.active_count() == 1:
        return _forked(path, patience)
    work = f"from data_io.hdf5 import limited_walk; limited_walk({path!r}, {patience})"
    where = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    quiet = subprocess.DEVNULL
    try:
        command = [sys.executable, "-P", "-c", work]
        return subprocess.run(command, env=where, stdin=quiet, stdout=quiet, stderr=quiet, check=False).returncode
    except OSError:  # no process can be started here: better an unguarded look than none
        return 0


def _forked(target: str | io.BytesIO, patience: int) -> int:
    """Walk in a copy of this process; return how it ended."""
    import h5py  # noqa: F401  in the parent, so that every child has it

    child = os.fork()
    if child == 0:
        with contextlib.suppress(BaseException):
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            limited_walk(target, patience)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def limited_walk(target: str | io.BytesIO, patience: int) -> None:
    """Touch every group, attribute and chunk index of a file once, without its numbers; the system ends this process
    when that takes more seconds of computing than `patience`.

    An error ends the look at one item only: behind a damaged dataset may stand one that hangs.
    """
    import resource

    import h5py

    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(used.ru_utime + used.ru_stime) + patience + (1 if used.ru_utime + used.ru_stime > 0.2 else 0)
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    resource.setrlimit(resource.RLIMIT_CPU, (limit, hard))
    signal.signal(signal.SIGXCPU, signal.SIG_DFL)
    with h5py.File(target, "r") as file:
        seen, stack = {h5py.h5o.get_info(file["/"].id).addr}, [file["/"]]
        while stack and len(seen) < 100_000:
            item, names = stack.pop(), list[str]()
            _touch(item)
            with contextlib.suppress(*OF_DAMAGE):
                names.extend(item if isinstance(item, h5py.Group) else ())
            for name in names:
                with contextlib.suppress(*OF_DAMAGE):
                    if not isinstance(item.get(name, getlink=True), h5py.HardLink):
                        continue
                    child = item[name]
                    address = h5py.h5o.get_info(child.id).addr
                    if address not in seen:
                        seen.add(address)
                        stack.append(child)


def _touch(item: h5py.HLObject) -> None:
    import h5py

    names = ["units", "unit", "Units", "Unit", "name"]  # which readers ask for, even where the list is damaged
    with contextlib.suppress(*OF_DAMAGE):
        names.extend(item.attrs)
    for name in dict.fromkeys(names):
        with contextlib.suppress(*OF_DAMAGE):
            item.attrs[name]
    if not isinstance(item, h5py.Dataset):
        return
    with contextlib.suppress(*OF_DAMAGE):
        if item.is_virtual or item.external:
            return
        if item.chunks is not None:
            item.id.chunk_iter(lambda _: None)
        if item.size is not None and item.size * item.dtype.itemsize <= (1 << 20):
            item[()]


def _member(source: Source, file: h5py.File, path: str) -> h5py.Group | h5py.Dataset | None:
    """Return the group or dataset at a path, None where there is none; a link into another file is refused."""
    import h5py

    place, parts, links = file["/"], [part for part in path.split("/") if part], 0
    while parts:
        name = parts.pop(0)
        link = place.get(name, getlink=True) if isinstance(place, h5py.Group) else None
        if isinstance(link, h5py.ExternalLink):
            raise source.error(
                f"{path!r} is a link into another file ({link.filename!r}), which is not followed; copy the data into "
                "one file"
            )
        if isinstance(link, h5py.SoftLink):
            links += 1
            if links > 16:
                return None
            parts = [part for part in link.path.split("/") if part] + parts
            place = file["/"] if link.path.startswith("/") else place
        elif link is None:
            return None
        else:
            place = place[name]
    return place


def _children(group: h5py.Group) -> Iterator[tuple[str, h5py.HLObject]]:
    """Yield name and object of everything that lies in a group itself; links to elsewhere are passed over."""
    import h5py

    for name in group:
        if isinstance(group.get(name, getlink=True), h5py.HardLink):
            yield name, group[name]


def check_promise(source: Source, name: str, promised: int, stored: int, packed: bool) -> None:
    """Refuse a column that promises so many bytes and holds next to none: no memory is taken for them.

    packed: whether its bytes are compressed. Raises the source's `LogError`.
    """
    # deflation packs what is all alike 1,100 times; a logger may ask for ten times the room that it comes to use
    if promised > max(LEAST_SUSPECT, (1100 if packed else 10) * stored):
        raise source.error(
            f"the dataset {name!r} promises {promised / 1e6:.4g} MB and holds {stored / 1e6:.3g} MB; was it never "
            "written to its end? Copy or export it again"
        )


# Columns that lie within one dataset: of a matrix by number (`/data:1`), of a compound by name (`/table:Fx`).


@dataclass(frozen=True)
class _ColumnWithin:
    """A column (n,) of a dataset, read as a dataset is; of a matrix the longer side runs along the rows."""

    dataset: h5py.Dataset
    key: int | str
    label: str
    attrs: dict[str, Any]

    @property
    def name(self) -> str:
        return f"{self.dataset.name}:{self.key + 1 if isinstance(self.key, int) else self.key}"

    @property
    def size(self) -> int:
        return int(max(self.dataset.shape))

    @property
    def shape(self) -> tuple[int]:
        return (self.size,)

    @property
    def dtype(self) -> np.dtype[Any]:
        own: np.dtype[Any] = self.dataset.dtype
        return own[self.key] if isinstance(self.key, str) else own

    def __getattr__(self, name: str) -> Any:
        return getattr(self.dataset, name)

    def __getitem__(self, _all: tuple[()]) -> Any:
        if isinstance(self.key, str):
            return np.ravel(self.dataset[self.key])
        upright = self.dataset.shape[0] >= self.dataset.shape[1]
        return self.dataset[:, self.key] if upright else self.dataset[self.key, :]


def _columns_within(dataset: h5py.Dataset) -> list[_ColumnWithin]:
    """Return the columns of a compound or of a matrix of numbers; none of anything else."""
    shape: tuple[int, ...] = tuple(dataset.shape or ())
    keys: Sequence[int | str] = ()
    labels: Sequence[str] = ()
    if dataset.dtype.names and len([size for size in shape if size != 1]) <= 1:
        kinds = {name: dataset.dtype[name] for name in dataset.dtype.names}
        keys = labels = [name for name, kind in kinds.items() if kind.kind in "fiu" and not kind.shape]
    elif len(shape) == 2 and dataset.dtype.kind in "fiu" and shape[0] != shape[1] and 1 < min(shape) <= 256:
        keys = range(min(shape))
        named = (_texts(dataset.attrs.get(key)) for key in _NAMES)
        base = dataset.name.rpartition("/")[2]
        labels = next((n for n in named if len(n) == len(keys)), [f"{base}:{i + 1}" for i in keys])
    units = next((u for key in _UNITS if len(u := _texts(dataset.attrs.get(key))) == len(keys)), None)
    about = [{} if units is None else {"units": units[place]} for place in range(len(keys))]
    return [_ColumnWithin(dataset, *column) for column in zip(keys, labels, about, strict=True)]


def _texts(value: Any) -> Sequence[str]:
    """Return an attribute as texts; of one text the words between its commas, of none nothing."""
    texts = [] if value is None else np.ravel(np.asarray(value, dtype=object)).tolist()
    listed = [part.decode("utf-8", errors="replace") if isinstance(part, bytes) else str(part) for part in texts]
    return listed if len(listed) != 1 else [part.strip() for part in listed[0].split(",")]


# What a file holds, and the part of it that was asked for.


def _unread(datasets: Sequence[h5py.Dataset]) -> dict[int, FloatArray]:
    """Return columns of which only the lengths are known."""
    return {i: np.broadcast_to(np.float64(np.nan), int(data.size or 0)) for i, data in enumerate(datasets)}


def read(source: Source, request: Request) -> Contents:
    """Read a step or a whole run of the project's layout, or the datasets in `columns`. Raises `LogError`."""
    with opened(source) as file:
        runs = _groups(file, "run")
        by_path = any("/" in path for path in request.columns.values())
        ours = not by_path and _text(file.attrs.get("format")) == FORMAT
        layout = not by_path and (ours or bool(runs))
        if by_path:
            datasets = [_dataset_at(source, file, path) for path in request.columns.values()]
            for (role, path), dataset in zip(request.columns.items(), datasets, strict=True):
                if dataset is None:
                    raise source.error(f"no dataset {path!r} was found for {words(role)}; {_datasets(file)}; name one")
            names = tuple(
                Name(path, path, _unit(d)) for path, d in zip(request.columns.values(), datasets, strict=True)
            )
            roles = {role: index for index, role in enumerate(request.columns) if role in COLUMN_ROLES}
            tables = [(Part(1, 1, Header(names, roles), _unread(datasets)), datasets)]
        elif layout:
            tables = _of_layout(source, request, file, runs)
        else:
            tables = _tests(source, request, file)
        run = request.run
        if run is None:  # and where it is open which, nothing need be read
            numbers = {part.run for part, _ in tables if request.step in (None, part.number)}
            run = numbers.pop() if len(numbers) == 1 else None
        account, speed = Account({}), None
        if layout:
            of_run = dict(runs).get(run or 0)  # of an archive every run has an account of its own
            place = file if of_run is None or ABOUT not in of_run else of_run
            account = _account(source, place)
            if "drive_speed" in place.attrs:
                try:
                    value, unit = float(place.attrs["drive_speed"]), _text(place.attrs.get("drive_speed_units"))
                    speed = scaled(value, factor(unit, "m/s"))
                except (UnitError, ValueError, TypeError) as error:
                    text = f"the attribute drive_speed: {error}; correct it and drive_speed_units"
                    raise source.error(text) from error
        wanted = [part.run == run and request.step in (None, part.number) for part, _ in tables]
        parts = [
            replace(part, columns=_columns(source, request, part.header, datasets)) if read else part
            for (part, datasets), read in zip(tables, wanted, strict=True)
        ]
        return Contents(parts, account.metadata, account.findings, ours, speed)


def _of_layout(
    source: Source, request: Request, file: h5py.File, runs: Sequence[tuple[int, h5py.Group]]
) -> list[_Table]:
    """Return the steps of the project's layout."""
    version = file.attrs.get("format_version", FORMAT_VERSION)
    if version != FORMAT_VERSION:
        raise source.error(f"layout version {version} was found; {FORMAT_VERSION} was expected; update this tool")
    wanted = [run for run in runs if run[0] == request.run] or runs  # the other logs of an archive need not be opened
    tables: list[_Table] = []
    for run, run_group in wanted:
        for step, group in _groups(run_group, "step"):
            members = [(link, item) for link, item in _children(group) if _is_dataset(item)]
            names = tuple(Name(name, name, unit) for name, unit in map(_named_column, members))
            header, datasets = Header(names, role_indices(names, request.columns)), [item for _, item in members]
            parameters = {key: _text(value) for key, value in group.attrs.items()}
            tables.append((Part(run, step, header, _unread(datasets), parameters), datasets))
    if not tables:
        raise source.error("no group /run_1/step_1 was found; the layout's groups were expected; convert the log again")
    return tables


def _tests(source: Source, request: Request, file: h5py.File) -> list[_Table]:
    """Return every group that holds what a log needs, each a run of one step."""
    tables: list[_Table] = []
    for group in _all_groups(file):
        members: list[tuple[str, h5py.Dataset]] = []
        for link, item in ((link, item) for link, item in _children(group) if _is_dataset(item)):
            named = bool(item.dtype.names) or any(key in item.attrs for key in _NAMES)
            named = named or any(name.startswith(f"{link}:") for name in request.columns.values())
            within = () if _is_column(item) or not named else _columns_within(item)
            members += [(link, item)] if _is_column(item) else [(column.label, column) for column in within]
        columns = [_named_column(column) for column in members]
        header = match_header([name for name, _ in columns], request.columns)
        units = zip(header.names, columns, strict=True)
        header = replace(header, names=tuple(n if unit is None else replace(n, unit=unit) for n, (_, unit) in units))
        needed = {"time"} if request.rate is None else set()
        needed |= {"friction_force"} if coefficient_column(header) is None else set()
        needed |= {"normal_force"} if request.normal_force is None else set()
        if needed <= set(header.roles):
            datasets = [item for _, item in members]
            items = {"group": str(group.name)}
            tables.append((Part(len(tables) + 1, 1, header, _unread(datasets), run_items=items), datasets))
    if not tables:
        raise source.error(
            f"the HDF5 file is not in our layout (/run_1/step_1/time ...); {_datasets(file)}; "
            "name them, as in --columns time=/a,friction_force=/b,normal_force=/c"
        )
    return tables


def _dataset_at(source: Source, file: h5py.File, path: str) -> h5py.Dataset | None:
    """Return the dataset at a path, or a column within one (`/data:1`, `/table:Fx`, `/table/Fx`); None for neither."""
    member = _member(source, file, path)
    if _is_dataset(member):
        return member
    for mark in (":", "/"):
        outer, _, key = path.rpartition(mark)
        dataset = _member(source, file, outer) if outer else None
        for column in _columns_within(dataset) if _is_dataset(dataset) else ():
            if key in (column.label, column.name.rpartition(":")[2]):
                return column
    return None


def _named_column(column: tuple[str, h5py.Dataset]) -> tuple[str, str | None]:
    """Return the name of a column, by its attribute or its link, and its unit."""
    link, item = column
    return _text(item.attrs.get("name")) or link, _unit(item)


def _columns(
    source: Source, request: Request, header: Header, datasets: Sequence[h5py.Dataset]
) -> dict[int, FloatArray]:
    """Read the columns with a role, and the channels that were asked for."""
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
        if data.is_virtual or data.external:
            raise source.error(
                f"the numbers of {data.name!r} lie in other files, which are not followed; copy them into one file"
            )
        stored, packed = data.id.get_storage_size(), data.compression is not None
        check_promise(source, str(data.name), data.size * data.dtype.itemsize, stored, packed)
    if len({datasets[index].size for index in wanted}) > 1:
        sizes = ", ".join(f"{header.names[index].name} {datasets[index].size}" for index in wanted)
        raise source.error(f"the datasets differ in length ({sizes:.200}); equal lengths were expected; export again")
    if not header.names:
        return {}
    columns = {}
    for count, index in enumerate(wanted, start=1):  # without a selection the library is a third faster
        columns[index] = np.asarray(datasets[index][()], dtype=np.float64).reshape(-1)
        request.progress(count / len(wanted))
    return columns


def _groups(parent: h5py.Group, word: str) -> list[tuple[int, h5py.Group]]:
    """Return number and group of `run_1`, `run_2`, ... in the order of their numbers."""
    matches = [(re.fullmatch(rf"{word}_(\d{{1,9}})", name), item) for name, item in _children(parent)]
    return sorted(
        ((int(match[1]), item) for match, item in matches if match and not _is_dataset(item)), key=lambda pair: pair[0]
    )


def _all_groups(file: h5py.File) -> list[h5py.Group]:
    """The root and every group below it, in the order of the file, to a sensible depth and number."""
    import h5py

    groups, level = [file["/"]], [file["/"]]
    for _ in range(6):
        level = [item for group in level for _, item in _children(group) if isinstance(item, h5py.Group)]
        groups += level
        if len(groups) > _MOST_GROUPS:
            break
    return groups[:_MOST_GROUPS]


def _is_dataset(item: h5py.HLObject | None) -> bool:
    import h5py

    return isinstance(item, h5py.Dataset)


def _is_column(dataset: h5py.Dataset) -> bool:
    shape = dataset.shape or ()
    return bool(shape) and dataset.dtype.kind in "fiu" and sum(size != 1 for size in shape) <= 1


def _unit(dataset: h5py.Dataset) -> str | None:
    return next((_text(dataset.attrs[name]).strip() for name in _UNITS if name in dataset.attrs), None)


def _text(value: Any) -> str:
    """Return an attribute as text, "" where there is none."""
    if value is None:
        return ""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    return value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)


def _account(source: Source, place: h5py.Group) -> Account:
    item = _member(source, place, f"{place.name}/{ABOUT}") if ABOUT in place else None
    if item is None or not _is_dataset(item):
        keys = ("source_file", "source_sha256")
        return Account({key: _text(place.attrs[key]) for key in keys if key in place.attrs})
    try:
        return read_account(_text(item[()]))
    except ValueError as error:
        text = f"the dataset {item.name} does not hold our JSON account; remove it or convert the log again"
        raise source.error(text) from error


def _datasets(file: h5py.File) -> str:
    datasets = [item for group in _all_groups(file) for _, item in _children(group) if _is_dataset(item)]
    within = {item.name: [c.name for c in _columns_within(item)] for item in datasets if not _is_column(item)}
    names = [name for item in datasets for name in within.get(item.name, []) or [item.name]]
    return f"the datasets are {listed(names)}" if names else "it holds no datasets"
