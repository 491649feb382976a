"""Text export of Anton Paar (formerly CSM) tribometers: TRB3, Nano."""

import re
from typing import Final

from data_io.delimited import read_plain
from data_io.part import Contents
from data_io.source import Request, Source
from data_io.text import looks_like_text

NAME: Final = "anton-paar"
# µ is one byte in cp1252, two in UTF-8
_TIME = re.compile(rb"Time ?\[[a-z]+\][^\t\r\n]*+\t([^\r\n]*+)", re.IGNORECASE)
_OTHERS = re.compile(rb"Laps|Nominal Load|Penetration Depth|(?:\xb5|\xc2\xb5|\xce\xbc) ?(?:\t|\[)", re.IGNORECASE)


def can_read(head: bytes) -> bool:
    """Tell by a tab-separated header with Time [s] and one of Laps, Nominal Load, µ, Penetration Depth."""
    return looks_like_text(head) and any(_OTHERS.search(rest) for rest in _TIME.findall(head))


def read(source: Source, request: Request) -> Contents:
    """Read a text of TRB3 or of the Nano tribometer (software version not known: no file was seen). Raises `LogError`.

    Layout: perhaps lines of words, then names separated by tabs with their units in brackets, then rows.
    Quirks: UTF-8 with or without mark, or cp1252; decimal comma possible; tabs at the ends of rows; the TRB3 has no
    measured load, only the `Nominal Load [N]` that was set; the Nano writes forces in mN.
    """
    return read_plain(source, request, NAME)
