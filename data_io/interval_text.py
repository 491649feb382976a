"""Text that states its sampling interval above the rows instead of holding a time column, as NI exports do."""

import re
from typing import Final

from data_io.even_clock import with_even_clock
from data_io.frozen import Finding
from data_io.part import Contents, Part
from data_io.source import Request, Source
from data_io.table import read_tables
from data_io.text import looks_like_text

NAME: Final = "interval-text"
_NUMBER: Final = r"((?:[0-9]++(?:[.,][0-9]++)?|[.,][0-9]++)(?:[eE][+-]?[0-9]++)?)"
_NAME: Final = r"\"?(?:sample |sampling )?interval(?: ?[(\[]s(?:ec)?[)\]])?\"?"
_LINE: Final = rf"[ \t]*+{_NAME}(?=[ \t,;:=])[ \t]*+[,;:=]?[ \t]*+{_NUMBER}[ \t,;]*+$"
_SIGN = re.compile(rb"(?:^|[\r\n])" + _LINE.replace("$", r"(?:[\r\n]|$)").encode(), re.IGNORECASE)
_INTERVAL = re.compile(_LINE, re.IGNORECASE)


def can_read(head: bytes) -> bool:
    """Tell by a line such as `Interval,0.0005`."""
    return looks_like_text(head) and _SIGN.search(head) is not None


def read(source: Source, request: Request) -> Contents:
    """Read delimited text with a line `Interval,0.0005` [s] above the names (National Instruments). Raises `LogError`.

    Quirks: no time column, so the clock is interval * row; signals in volts, which need a scale:
    `--units "friction_force=2.5 N/V"`. Where there is a time column it is used, not the interval.
    """
    tables, footer = read_tables(source, request)
    findings = [remark for table in tables for remark in table.remarks]
    parts = []
    for number, table in enumerate(tables, start=1):
        told = [match for line in (*tables[0].preamble, *table.preamble) if (match := _INTERVAL.match(line))]
        interval = float(told[-1][1].replace(",", ".")) if told else 0.0
        if "time" not in table.header.roles and interval > 0:
            table = with_even_clock(table, 0.0, interval, "Interval")
            text = f"the clock was made from the interval of {interval:g} s that the file states"
            findings.append(Finding("clock_from_interval", "info", text))
        parts.append(Part(1, number, table.header, table.columns))
    metadata = {"preamble": "\n".join(tables[0].preamble)} | ({"footer": "\n".join(footer)} if footer else {})
    return Contents(NAME, parts, metadata, list(dict.fromkeys(findings)))
