"""CSV export of Bruker UMT and TriboLab."""

import re
from typing import Final

from data_io.part import Contents
from data_io.source import Request, Source
from data_io.umt_text import has_steps, read_steps

NAME: Final = "bruker-csv"
_MARK = re.compile(rb"bruker|tribolab", re.IGNORECASE)


def can_read(head: bytes) -> bool:
    """Tell a Bruker export by its `Step No.` line and the maker's or the machine's name above it."""
    return has_steps(head) and _MARK.search(head[: head.find(b"Step")]) is not None


def read(source: Source, request: Request) -> Contents:
    """Read a CSV of a Bruker UMT or TriboLab (the versions are not known: no file was seen). Raises `LogError`.

    Layout: as the CETR text export (see `cetr_text`), but time comes first and forces are in newtons; about 100 Hz.
    Quirks: odd bytes in the preamble; the unit of COF is empty.
    """
    return read_steps(source, request, NAME)
