"""The table of readers: one line per format, asked in this order; the most particular first."""

from dataclasses import dataclass
from typing import Final, Protocol

from data_io import (
    anton_paar,
    bruker_csv,
    cetr_text,
    delimited,
    excel,
    hdf5,
    interval_text,
    lvm,
    matlab,
    ni_channels,
    rtec_csv,
    stickslip_csv,
    tdms,
)
from data_io.part import Contents
from data_io.source import Request, Source


class CanRead(Protocol):
    """Tells by the first bytes of a file whether a reader knows its format."""

    def __call__(self, head: bytes) -> bool:
        """Answer for these bytes."""


class Read(Protocol):
    """Reads a file of that format; raises `LogError`."""

    def __call__(self, source: Source, request: Request) -> Contents:
        """Return what the log holds; a reader may leave out what the request does not ask for."""


@dataclass(frozen=True)
class Reader:
    """One format: its name, and the two functions of its file."""

    name: str
    can_read: CanRead
    read: Read


READERS: Final = (
    Reader(hdf5.NAME, hdf5.can_read, hdf5.read),
    Reader(matlab.NAME, matlab.can_read, matlab.read),
    Reader(excel.NAME, excel.can_read, excel.read),
    Reader(tdms.NAME, tdms.can_read, tdms.read),
    Reader(stickslip_csv.NAME, stickslip_csv.can_read, stickslip_csv.read),
    Reader(lvm.NAME, lvm.can_read, lvm.read),
    Reader(bruker_csv.NAME, bruker_csv.can_read, bruker_csv.read),
    Reader(cetr_text.NAME, cetr_text.can_read, cetr_text.read),
    Reader(rtec_csv.NAME, rtec_csv.can_read, rtec_csv.read),
    Reader(anton_paar.NAME, anton_paar.can_read, anton_paar.read),
    Reader(ni_channels.NAME, ni_channels.can_read, ni_channels.read),
    Reader(interval_text.NAME, interval_text.can_read, interval_text.read),
    Reader(delimited.NAME, delimited.can_read, delimited.read),
)
