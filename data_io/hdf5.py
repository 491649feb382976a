"""HDF5 logs: the project's layout, or any file whose datasets the user names."""

import io
import re
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from data_io.account import Account, read_account
from data_io.columns import Header, Name, role_indices
from data_io.errors import UnitError
from data_io.frozen import COLUMN_ROLES, FloatArray
from data_io.part import Contents, Part
from data_io.source import Request, Source
from data_io.units import to_si
from data_io.write import ABOUT, FORMAT, FORMAT_VERSION

NAME: Final = "hdf5"

_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"
_UNIT_NAMES: Final = ("units", "unit", "Units", "Unit")
_SHOWN: Final = 12


def can_read(head: bytes) -> bool:
    """Tell HDF5 by its signature, at the start or behind a user block."""
    return any(head[offset : offset + 8] == _SIGNATURE for offset in (0, 512, 1024, 2048, 4096, 8192, 16384, 32768))


def read(source: Source, request: Request) -> Contents:
    """Read a step or a whole run of the project's layout, or the datasets in `columns`. Raises `LogError`."""
    import h5py

    try:
        with h5py.File(io.BytesIO(source.data), "r") as file:
            if any("/" in path for path in request.columns.values()):
                return _read_named(source, request, file)
            if _text(file.attrs.get("format")) == FORMAT or _groups(file, "run"):
                return _read_layout(source, request, file)
            raise source.error(_unknown(file))
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, EOFError) as error:
        reason = str(error).strip("'\"").split("\n")[0]
        raise source.error(
            f"the HDF5 file is damaged ({reason:.120}); an intact one is needed; copy it again"
        ) from error


def _read_layout(source: Source, request: Request, file: Any) -> Contents:
    version = file.attrs.get("format_version", FORMAT_VERSION)
    if version != FORMAT_VERSION:
        raise source.error(f"layout version {version} was found; {FORMAT_VERSION} was expected; update this tool")
    account = _account(source, file)
    parts = [
        _part(source, request, file[run_name][step_name], run, step)
        for run, run_name in _groups(file, "run")
        for step, step_name in _groups(file[run_name], "step")
    ]
    if not parts:
        raise source.error("no group /run_1/step_1 was found; the layout's groups were expected; convert the log again")
    ours = _text(file.attrs.get("format")) == FORMAT
    return Contents(NAME, parts, account.metadata, account.findings, ours, _drive_speed(source, file))


def _read_named(source: Source, request: Request, file: Any) -> Contents:
    names: list[Name] = []
    columns: list[FloatArray] = []
    for role, path in request.columns.items():
        dataset = file.get(path)
        if not _is_dataset(dataset):
            raise source.error(
                f"no dataset {path!r} was found for {role.replace('_', ' ')}; {_datasets(file)}; name one"
            )
        names.append(Name(path, path, _unit(dataset)))
        columns.append(_values(source, dataset))
    roles = {role: index for index, role in enumerate(request.columns) if role in COLUMN_ROLES}
    _check_lengths(source, names, columns)
    part = Part(1, 1, Header(tuple(names), roles), dict(enumerate(columns)))
    return Contents(NAME, [part])


def _part(source: Source, request: Request, group: Any, run: int, number: int) -> Part:
    names: list[Name] = []
    columns: list[FloatArray] = []
    for link, dataset in group.items():
        if not _is_dataset(dataset):
            continue
        name = _text(dataset.attrs.get("name")) or link
        names.append(Name(name, name, _unit(dataset)))
        columns.append(_values(source, dataset))
    _check_lengths(source, names, columns)
    header = Header(tuple(names), role_indices(names, request.columns))
    parameters = {key: _text(value) for key, value in group.attrs.items()}
    return Part(run, number, header, dict(enumerate(columns)), parameters)


def _groups(parent: Any, word: str) -> list[tuple[int, str]]:
    """Return number and name of the groups `run_1`, `run_2`, ... in the order of their numbers."""
    found = [(match, name) for name in parent if (match := re.fullmatch(rf"{word}_(\d+)", name))]
    return sorted((int(match[1]), name) for match, name in found if not _is_dataset(parent.get(name)))


def _is_dataset(item: Any) -> bool:
    import h5py

    return isinstance(item, h5py.Dataset)


def _values(source: Source, dataset: Any) -> FloatArray:
    shape = dataset.shape or ()
    if dataset.dtype.kind not in "fiu" or sum(size != 1 for size in shape) > 1 or not shape:
        raise source.error(
            f"dataset {dataset.name!r} holds {dataset.dtype} of shape {shape}; a column of numbers was expected; "
            "name another one with --columns"
        )
    return np.asarray(dataset[()], dtype=np.float64).reshape(-1)


def _check_lengths(source: Source, names: Sequence[Name], columns: Sequence[FloatArray]) -> None:
    sizes = {values.size for values in columns}
    if len(sizes) > 1:
        shown = ", ".join(f"{name.name} {values.size}" for name, values in zip(names, columns, strict=True))
        raise source.error(f"the datasets differ in length ({shown:.200}); equal lengths were expected; export again")


def _unit(dataset: Any) -> str | None:
    return next((_text(dataset.attrs[name]).strip() for name in _UNIT_NAMES if name in dataset.attrs), None)


def _text(value: Any) -> str:
    """Return an attribute as text, "" where there is none."""
    if value is None:
        return ""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    return value.decode("utf-8", errors="replace") if isinstance(value, bytes) else str(value)


def _account(source: Source, file: Any) -> Account:
    item = file.get(ABOUT)
    if not _is_dataset(item):
        return Account({key: _text(file.attrs[key]) for key in ("source_file", "source_sha256") if key in file.attrs})
    try:
        return read_account(_text(item[()]))
    except ValueError as error:
        text = f"the dataset /{ABOUT} does not hold our JSON account; remove it or convert the log again"
        raise source.error(text) from error


def _drive_speed(source: Source, file: Any) -> float | None:
    if "drive_speed" not in file.attrs:
        return None
    try:
        return to_si(float(file.attrs["drive_speed"]), _text(file.attrs.get("drive_speed_units")), "speed")
    except (UnitError, ValueError, TypeError) as error:
        raise source.error(f"the attribute drive_speed: {error}; correct it and drive_speed_units") from error


def _datasets(file: Any) -> str:
    found: list[str] = []
    file.visititems(lambda name, item: found.append("/" + name) if _is_dataset(item) else None)
    more = ", ..." if len(found) > _SHOWN else ""
    return f"the datasets are {', '.join(found[:_SHOWN])}{more}" if found else "it holds no datasets"


def _unknown(file: Any) -> str:
    return (
        f"the HDF5 file is not in our layout (/run_1/step_1/time ...); {_datasets(file)}; "
        "name them, as in --columns time=/a,friction_force=/b,normal_force=/c"
    )
