"""The project's own CSV, as `write.write_csv` makes it: everything a record holds, bit for bit."""

from data_io.columns import Header, Name, role_indices
from data_io.contents import Contents, Part
from data_io.layout import Head, line_at
from data_io.source import Request, Source
from data_io.table import read_below
from data_io.text import as_utf8, split
from data_io.values import Step
from data_io.write import CSV_MARK, FORMAT_VERSION, read_account


def can_read(head: bytes) -> bool:
    """Tell a CSV of ours by its first line."""
    return head.startswith(CSV_MARK.encode())


def read(source: Source, request: Request) -> Contents:
    """Read the chosen step, or all of them. Raises `LogError`."""
    data = as_utf8(source.read())
    first, position = line_at(data, 0)
    version = first[len(CSV_MARK) :].strip()
    if version != str(FORMAT_VERSION):
        raise source.error(f"version {version!r} of our CSV was found; {FORMAT_VERSION} was expected; convert it again")
    line, position = line_at(data, position)
    try:
        account = read_account(line.removeprefix("#"))
    except ValueError as error:
        raise source.error(
            "line 2 does not hold the JSON account that a CSV of ours has there; "
            "restore it, or remove the first two lines to have it read as plain CSV"
        ) from error
    line, position = line_at(data, position)
    names = split(line, ",")
    line, position = line_at(data, position)
    units = split(line, ",")
    if len(units) != len(names) or len(names) < 2:
        raise source.error(
            f"line 4 holds {len(units)} units for {len(names)} columns; one for each was expected; "
            "repair it, or remove the first two lines to have it read as plain CSV"
        )
    columns = tuple(Name(name, name, unit) for name, unit in zip(names, units, strict=True))
    header = Header(columns, role_indices(columns, request.columns))
    table = read_below(source, request, data, Head(header, position, ",", len(names)))
    noted = account.steps and account.steps[-1].stop == table.rows  # else rows were added or taken away since
    steps = account.steps if noted else [Step(1, 1, 0, table.rows)]
    parts = [
        Part(s.run, s.number, header, {i: v[s.start : s.stop] for i, v in table.columns.items()}, s.parameters)
        for s in steps
    ]
    return Contents(parts, account.metadata, [*table.remarks, *account.findings], True, account.drive_speed)
