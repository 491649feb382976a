"""A clock for tables that state their sampling interval above the rows instead of holding a time column."""

from dataclasses import replace

import numpy as np

from data_io.columns import Header, Name
from data_io.opened_table import Table


def with_even_clock(table: Table, start: float, interval: float, name: str) -> Table:
    """Return the table with a time column [s]: start + interval * row; it takes the place of an empty time column."""
    rows = max((values.size for values in table.columns.values()), default=0)
    time = start + interval * np.arange(rows, dtype=np.float64)
    header = table.header
    index = header.roles.get("time")
    if index is None:
        index = len(header.names)
        names = (*header.names, Name(name, name, "s"))
        header = Header(names, {**header.roles, "time": index}, header.passed_over)
    return replace(table, header=header, columns={**table.columns, index: time})
