"""Text export of CETR UMT."""

import re
from typing import Final

from data_io.part import Contents
from data_io.source import Request, Source
from data_io.umt_text import has_steps, read_steps

NAME: Final = "cetr-text"
_MARK = re.compile(rb"Created by CETR", re.IGNORECASE)


def can_read(head: bytes) -> bool:
    """Tell a CETR text by its `Step No.` line or its first line."""
    return has_steps(head) or _MARK.match(head.lstrip(b"\xef\xbb\xbf \t\r\n")) is not None


def read(source: Source, request: Request) -> Contents:
    """Read a text export of a CETR UMT-2 or UMT-3 (seen: UMT 1.136.257, CETR Data Viewer 2.19.106). Raises `LogError`.

    Layout: preamble; per run `Run # 1`, script, date; per step `Step No. 1`, `key = value` lines, `Started at`, names,
    units, rows. Commas, CR LF, mostly 50 Hz.
    Quirks: three separators in the preamble (-, =, :) and two orders of dates (05/12/22 is month first); forces in
    gram-force, negative in compression; the unit of COF is empty or missing; T restarts with each step and its first
    interval is odd; columns differ in number and order between machines and steps; COF and Ff have lost the sign;
    with the linear drive every stroke may be a file of its own (give the folder or a pattern). `Velocity` has no unit
    and is kept as text only. A step whose rows are not as many as its Data Count is reported.
    """
    return read_steps(source, request, NAME)
