"""Parquet tables, read by pyarrow (optional extra `parquet`)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from data_io.columns import Name, match_names, parse_name
from data_io.contents import Contents, Part
from data_io.hdf5 import check_promise
from data_io.source import Request, Source
from data_io.table import wanted_columns
from data_io.values import FloatArray

if TYPE_CHECKING:
    import pyarrow

_UNITS: Final = (b"unit", b"units", b"Unit", b"Units")


def read(source: Source, request: Request) -> Contents:
    """Read the columns of numbers of a Parquet file as one step. Raises `LogError`.

    Units stand in the names (`Fx [N]`) or in the metadata of a column, as `unit`. Instants and durations become
    seconds, instants from the first one on. Columns of texts, truth values, lists and structures are left out.
    """
    try:
        import pyarrow.parquet
    except ImportError as error:
        raise source.error(
            "a Parquet file needs the package pyarrow, which is not installed; install it with pip install pyarrow, "
            "or export the table as CSV"
        ) from error
    damage = source.read_by_library("Parquet file", "write it again", pyarrow.ArrowException)
    with damage, pyarrow.parquet.ParquetFile(source.file(), page_checksum_verification=True) as file:
        types = pyarrow.types
        kinds = (types.is_integer, types.is_floating, types.is_decimal, types.is_timestamp, types.is_duration)
        fields = [field for field in file.schema_arrow if any(kind(field.type) for kind in kinds)]
        header = match_names(tuple(map(_name, fields)), request.columns)
        wanted = wanted_columns(header, request)
        kept = [i for i in range(len(fields)) if wanted is None or i in wanted]
        rows = file.metadata.num_rows
        check_promise(source, "table", 8 * rows * len(kept), source.size, packed=True)
        table = file.read(columns=[fields[i].name for i in kept])
        columns = {i: _numbers(table.column(fields[i].name)) for i in kept}
    return Contents([Part(1, 1, header, columns)])


def _name(field: pyarrow.Field) -> Name:
    from pyarrow import types

    name = parse_name(field.name)
    if types.is_timestamp(field.type) or types.is_duration(field.type):
        return replace(name, unit="s")
    unit = next((field.metadata[key] for key in _UNITS if key in (field.metadata or {})), None)
    return name if unit is None else replace(name, unit=unit.decode("utf-8", errors="replace").strip())


def _numbers(column: pyarrow.ChunkedArray) -> FloatArray:
    """Return a column as float64 (n,); instants [s] from the first one on, durations [s]."""
    import pyarrow

    if not (pyarrow.types.is_timestamp(column.type) or pyarrow.types.is_duration(column.type)):
        return np.array(column.cast(pyarrow.float64(), safe=False), dtype=np.float64)
    values = column.to_numpy()
    known = values[~np.isnat(values)]
    since = known[0] if pyarrow.types.is_timestamp(column.type) and known.size else values.dtype.type(0, "ns")
    return np.asarray((values - since) / np.timedelta64(1, "s"), dtype=np.float64)
