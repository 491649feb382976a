"""Open a log of any known format: the table of readers, and what is done with what a reader finds."""

import difflib
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from data_io import delimited, excel, hdf5, labview, matlab, parquet
from data_io.assemble import assemble
from data_io.clock import on_one_clock, with_clock_of_rate, with_sound_clocks
from data_io.contents import Contents, is_series, joined_contents, logs_at
from data_io.derived_columns import with_derived_columns, with_drive_of_rotation
from data_io.record import Record, within
from data_io.source import Request, Source, load, no_progress, sha256_of_several, sha256_unchanged
from data_io.spelling import spelled
from data_io.text import looks_like_text
from data_io.units import parse_quantity
from data_io.values import COLUMN_ROLES, LogError, LogTooLargeError, UnitError
from data_io.write import CSV_MARK


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
    Reader("matlab", lambda head: head.startswith(b"MATLAB 5.0 MAT-file"), matlab.read),
    Reader("excel", excel.can_read, excel.read),
    Reader("parquet", lambda head: head.startswith(b"PAR1"), parquet.read),
    Reader("tdms", lambda head: head.startswith(b"TDSm"), labview.read_tdms),
    Reader("stickslip-csv", lambda head: head.startswith(CSV_MARK.encode()), delimited.read_ours),
    Reader("labview-lvm", labview.is_lvm, labview.read_lvm),
    Reader("bruker-csv", delimited.is_bruker, delimited.read_steps),
    Reader("cetr-text", delimited.is_cetr, delimited.read_steps),
    Reader("rtec-csv", delimited.is_rtec, delimited.read_rtec),
    Reader("ni-channels", labview.is_ni_channels, labview.read_ni_channels),
    Reader("stamped-lines", delimited.is_stamped, delimited.read_stamped),
    Reader("delimited", looks_like_text, delimited.read_delimited),
)
"""One line per format, asked in this order; the most particular first."""

ROLES: Final = (*COLUMN_ROLES, "position")
"""What a column can be named for."""


REFUSED: Final = (
    (re.compile(rb"\xd0\xcf\x11\xe0"), "an old Excel workbook (.xls); .xlsx or text was expected; save it as one"),
    (re.compile(rb"#\d+# "), "a native CETR .tst; its text was expected; export it with CETR Data Viewer"),
    (re.compile(rb"(?s).{0,200}<(?:\w+:)?tdm\b"), "a TDM of National Instruments, whose numbers stand in the .tdx; "
     "TDMS or text was expected; save it as one in DIAdem or LabVIEW"),
    (re.compile(rb"(?is)\W{0,3}\s*<(?:!doctype html|html|head|body|table)"), "a web page (HTML); text or .xlsx was "
     "expected; open it in a spreadsheet and save it as one"),
    (re.compile(rb"\W{0,3}\s*<\?xml"), "XML; text or .xlsx was expected; save it so in the program that wrote it"),
    (re.compile(rb"\W{0,3}\s*(?:\{\s*[\"}]|\[\s*[\[{])"), "JSON; a table of text was expected; write one, as with "
     "pandas: pd.read_json(...).to_csv('log.csv', index=False)"),
    (re.compile(rb"(?s)(?:\s|#[^\n]*\n|\w+\s*=[^\n]*\n)*+\[\[?(?:rig|logs|parameters|contact|fit)\b"),
     "a scene (TOML); a log was expected; give one of those that it names"),
)  # fmt: skip
"""Files that laboratories have and no reader reads: how they begin, what to do."""


@spelled
@np.errstate(over="ignore", invalid="ignore")  # what is no finite number in the end is refused by name
def read_log(
    path: str | Path,
    step: int | None = None,
    units: Mapping[str, str] | None = None,
    columns: Mapping[str, str] | None = None,
    normal_force: float | str | None = None,
    run: int | None = None,
    channels: Sequence[str] | None = None,
    progress: Callable[[float], None] = no_progress,
    window: tuple[float, float] | None = None,
    exclude: Sequence[tuple[float, float]] = (),
    rate: float | str | None = None,
    arm: float | str | None = None,
    area: float | str | None = None,
) -> Record:
    """Read a log as one record in SI.

    step: the number of a step; None joins all steps of the run on one clock. run: which run, where there are several.
    units: unit by role (time, normal_force, friction_force) or column name, e.g. {"friction_force": "N"}; overrides
    the file. columns: column (or HDF5 dataset) by role, e.g. {"time": "T"}; `drive_speed` and `position` are roles too.
    normal_force: a constant load [N] or "3 N", instead of a column. channels: names of the other columns to keep; None
    keeps all. rate: the sampling rate [Hz] or "4 Hz" of a log whose rows follow each other evenly: it makes the clock,
    whatever the file has for one. arm [m] or "25 mm": at which a column of torque acts; area [m^2] or "2 cm^2": on
    which a column of stress does. window: the (start, stop) [s] to keep, counted from the first row of what is read
    (the step, or the run) as in a scene, whatever the clock of the file shows there.
    exclude: stretches [s] that nobody uses, counted likewise: what holds no force there is left out, the rest stays.
    progress: called with the share read so far. Raises `LogError`, one sentence that says what was
    found, what was expected and what to do.
    A folder or a pattern (`stroke_*.txt`) is read as one test whose strokes or steps were exported to files of their
    own; `logs.zip/slow.txt` is a file in an archive.
    """
    path = Path(path)
    for role in columns or {}:
        if role not in ROLES:
            near = difflib.get_close_matches(role, ROLES, n=1)
            hint = f"did you mean {near[0]}?" if near else "use one of these"
            raise LogError(f"{path}: a column was named for {role!r}; {', '.join(ROLES)} were expected; {hint}")
    if window is not None:
        start, stop = window = (float(window[0]), float(window[1]))
        if not start < stop:
            raise LogError(f"{path}: the window runs from {start:g} to {stop:g} s; a start before its stop is needed")
    request = Request(
        step=step,
        run=run,
        units=dict(units or {}),
        columns=dict(columns or {}),
        normal_force=_above_zero(path, normal_force, "N", "normal force"),
        rate=_above_zero(path, rate, "Hz", "sampling rate"),
        arm=_above_zero(path, arm, "m", "arm"),
        area=_above_zero(path, area, "m^2", "area"),
        channels=None if channels is None else tuple(channels),
        progress=progress,
        window=window,
        exclude=tuple((float(start), float(stop)) for start, stop in exclude),
    )
    try:
        return _read(path, request)
    except MemoryError as error:
        raise LogTooLargeError(
            f"{path}: the columns asked for do not fit into memory; read one step with --step or fewer columns with "
            "--channels none, or write a part of its rows to a file of its own"
        ) from error


def _read(path: Path, request: Request) -> Record:
    """Read one log, or the files of a folder or pattern as one."""
    if not is_series(path):
        source = load(path)
        try:
            return within(assemble(source, request, contents_of(source, request)), request.window)
        except LogError:
            _refuse_by_name(source)
            raise
    paths, read = logs_at(path), []
    for i, p in enumerate(paths):
        share = partial(lambda i, part: request.progress((i + part) / len(paths)), i)
        own = replace(request, step=None, run=None, window=None, exclude=(), progress=share)
        read.append((p, contents_of(load(p), own)))
    record = within(assemble(load(paths[0]), request, joined_contents(path, read)), request.window)
    about = {"path": str(path), "sha256": sha256_of_several(sha256_unchanged(p, load(p).size) for p in paths)}
    return replace(record, metadata={**record.metadata, **about})


def contents_of(source: Source, request: Request) -> Contents:
    """Return what the first reader that knows a log finds in it. Raises `LogError`."""
    for reader in READERS:
        if reader.can_read(source.head):
            contents = replace(reader.read(source, request), form=reader.name)
            contents = with_sound_clocks(request, with_clock_of_rate(source, request, contents))
            contents = on_one_clock(source, request, with_derived_columns(request, contents))
            return with_drive_of_rotation(request, contents)
    _refuse_by_name(source)
    zeros = re.search(rb"\x00+", source.head)
    if zeros is not None and zeros.start() >= 32 and looks_like_text(source.head[: zeros.start()]):
        raise source.error(
            f"from byte {zeros.start()} on (below line {source.head.count(10, 0, zeros.start())}) {len(zeros[0])} zero "
            "bytes stand in the text, as after a crash while it was written; rows of numbers were expected; take them "
            "out in an editor, or copy it again"
        )
    names = ", ".join(reader.name for reader in READERS)
    raise source.error(
        f"the file begins with {source.head[:12]!r}, which no reader knows ({names}); a text or HDF5 log was expected; "
        "export it as text"
    )


def _refuse_by_name(source: Source) -> None:
    """Raises the source's `LogError` where a log that cannot be read is of a format that is known."""
    for mark, words in REFUSED:
        if mark.match(source.head):
            raise source.error(f"the file is {words}")


def _above_zero(path: Path, given: float | str | None, unit: str, name: str) -> float | None:
    """Return a load or a rate that the user gave in SI; None where none was given."""
    if given is None:
        return None
    try:
        value = parse_quantity(given, unit)
    except UnitError as error:
        raise LogError(f"{path}: the {name} given: {error}") from error
    if not (math.isfinite(value) and value > 0):
        raise LogError(f"{path}: a {name} of {given} was given; one above 0 {unit} was expected; correct it")
    return value
