"""The table of readers: one line per format, asked in this order; the most particular first."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from data_io import delimited, excel, hdf5, labview, matlab, parquet, stamped_lines, stickslip_csv, umt_text
from data_io.contents import Contents
from data_io.source import Request, Source
from data_io.text import looks_like_text


@dataclass(frozen=True)
class Reader:
    """One format: its name, what tells a file of it by its first bytes, and what reads it (raises `LogError`).

    A reader may leave out what the request does not ask for.
    """

    name: str
    can_read: Callable[[bytes], bool]
    read: Callable[[Source, Request], Contents]


READERS: Final = (
    Reader("hdf5", hdf5.can_read, hdf5.read),
    Reader("matlab", matlab.can_read, matlab.read),
    Reader("excel", excel.can_read, excel.read),
    Reader("parquet", parquet.can_read, parquet.read),
    Reader("tdms", labview.is_tdms, labview.read_tdms),
    Reader("stickslip-csv", stickslip_csv.can_read, stickslip_csv.read),
    Reader("labview-lvm", labview.is_lvm, labview.read_lvm),
    Reader("bruker-csv", umt_text.is_bruker, umt_text.read_steps),
    Reader("cetr-text", umt_text.is_cetr, umt_text.read_steps),
    Reader("rtec-csv", delimited.is_rtec, delimited.read_rtec),
    Reader("ni-channels", labview.is_ni_channels, labview.read_ni_channels),
    Reader("interval-text", labview.is_interval_text, labview.read_interval_text),
    Reader("stamped-lines", stamped_lines.is_stamped, stamped_lines.read_stamped),
    Reader("delimited", looks_like_text, delimited.read_delimited),
)
