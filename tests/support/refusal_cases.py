"""Input a bit beyond what is taken, and input that is not: one pair for every sentence in which the readers refuse.

Each of the two is a function of an empty folder and of pytest's `monkeypatch`, which stands for what a test cannot
have: a full disk, a workbook of gigabytes.
"""

import gzip
import io
import os
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import openpyxl
import pandas as pd
import pyarrow.parquet
import pytest
import scipy.io

from data_io import (
    Record,
    Step,
    excel,
    hdf5_open,
    hdf5_values,
    list_steps,
    read_log,
    rows,
    source,
    write,
    write_archive,
    write_csv,
    write_hdf5,
)
from data_io.correct import Corrections, correct
from data_io.motion import motion_of, strokes_as_steps
from data_io.thresholds import Thresholds
from data_io.units import parse_quantity
from tests.support.finding_cases import GOOD, MOVING, ROWS, step, umt

Act = Callable[[Path, pytest.MonkeyPatch], object]
Pair = tuple[Act, Act]


PACKED = gzip.compress(GOOD.encode())


def file(content: str | bytes, name: str = "log.csv", /, **options: Any) -> Act:
    """A file is read."""

    def act(folder: Path, _patch: pytest.MonkeyPatch) -> object:
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_log(folder / name, **options)

    return act


def clocks(late: float, *, falls: bool = False, again: str = "Fz") -> Act:
    """Two forces, each with a clock of its own, the second one beginning so late [s]."""
    ways = [(i / 10, late + (i - 2 * (i == 9) * falls) / 10, i % 7) for i in range(40)]
    return file(f"T [s],Fx [N],T [s],{again} [N]\n" + "".join(f"{a},{f}.5,{b:.2f},3.0\n" for a, b, f in ways))


def formulas(kept: bool) -> Act:
    """A workbook whose friction force is a formula without a result, or a number."""

    def act(folder: Path, _patch: pytest.MonkeyPatch) -> object:
        book = openpyxl.Workbook()
        book.active.append(["Time [s]", "Fz [N]", "Fx [N]"])
        for i in range(9):
            book.active.append([i / 10, 3.0, f"=B{i + 2}*0.2" if kept else 0.6])
        book.save(folder / "a.xlsx")
        return read_log(folder / "a.xlsx")

    return act


def channels(rows: str) -> Act:
    """NI channels in pairs above such rows."""
    head = "Interval,1,Interval,1\nChannel name,Fx,Channel name,Fz\nUnit,N,Unit,N\n"
    return file(head + rows)


def tdms(rows: int = 20, scale: str = "") -> Act:
    """A TDMS of two forces, one of them scaled."""

    def act(folder: Path, _patch: pytest.MonkeyPatch) -> object:
        scaling = {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": scale, "NI_Scale[0]_Linear_Slope": 1e-3,
                   "NI_Scale[0]_Linear_Y_Intercept": 0.0, "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
                   "NI_Scaling_Status": "unscaled"} if scale else {}  # fmt: skip
        about = {"wf_increment": 0.1, "wf_start_offset": 0.0, "unit_string": "N"}
        with nptdms.TdmsWriter(folder / "a.tdms") as writer:
            forces = [
                nptdms.ChannelObject("test", name, np.arange(rows) % 7 + 1.0, {**about, **properties})
                for name, properties in (("Fx", scaling), ("Fz", {}))
            ]
            writer.write_segment(forces)
        return read_log(folder / "a.tdms")

    return act


def tdms_that(fails: type[Exception]) -> Act:
    """A TDMS over which its reader fails."""

    def refused(*_: object) -> object:
        raise fails

    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        patch.setattr(nptdms.TdmsFile, "open", refused)
        (folder / "a.tdms").write_bytes(b"TDSm" + bytes(99))
        return read_log(folder / "a.tdms")

    return act


def without_tdms(folder: Path, patch: pytest.MonkeyPatch) -> object:
    """npTDMS is not installed."""
    patch.setitem(sys.modules, "nptdms", None)
    (folder / "a.tdms").write_bytes(b"TDSm" + bytes(99))
    return read_log(folder / "a.tdms")


def parquet(rows: int = 20) -> Act:
    """A Parquet file of so many rows that are all alike."""

    def act(folder: Path, _patch: pytest.MonkeyPatch) -> object:
        columns = {name: np.zeros(rows) for name in ("Time [s]", "Fx [N]", "Fz [N]")}
        columns["Time [s]"][:20] = np.arange(20)[:rows]
        pyarrow.parquet.write_table(pyarrow.table(columns), folder / "a.parquet", compression="zstd")
        return read_log(folder / "a.parquet")

    return act


def parquet_that(patched: Callable[[pytest.MonkeyPatch], object], data: bytes = b"PAR1") -> Act:
    """A Parquet file of these bytes on a machine that is changed so."""

    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        patched(patch)
        (folder / "a.parquet").write_bytes(data)
        return read_log(folder / "a.parquet")

    return act


def beyond_memory(name: str) -> Act:
    """A Parquet file of which half would fit into the memory that is free."""

    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        patch.setattr(hdf5_values, "_SMALL", 0)
        patch.setattr(hdf5_values, "free_memory", lambda: 8 * 20 * 3 if name == "free" else 1 << 30)
        return parquet()(folder, patch)

    return act


def axes(other: float | None, level: float = 0.1) -> Act:
    """Forces along two axes, the one called as friction with white noise or more; other: what it moves by [N]."""
    noise = np.random.default_rng(1).normal(0.0, 1e-3, 400)
    moving = np.arange(400) % 80 / 160 + 0.5
    still = level + noise + (moving if other else 0.0)
    columns = (np.arange(400) / 100, still, moving, np.ones(400) if other is not None else moving)
    rows = "\n".join(",".join(f"{value:.5f}" for value in row) for row in zip(*columns, strict=True))
    return file(f"T [s],Fx [N],{'Fy [N]' if other is not None else 'Q'},Fz [N]\n{rows}\n")


def asked(beyond: dict[str, Any], within: dict[str, Any], content: str = GOOD) -> Pair:
    """The same file is read with two requests."""
    return file(content, **beyond), file(content, **within)


def plain(work: Callable[[], object]) -> Act:
    """Something that needs no file."""
    return lambda _folder, _patch: work()


def ramp(n: int = 20, **changes: Any) -> Act:
    """A record is built."""
    values = {"time": np.arange(n) * 0.1, "normal_force": np.full(n, 3.0), "friction_force": np.linspace(0, 1, n)}
    return plain(lambda: Record(**{**values, **changes}))


def gap(rows: int, n: int = 40) -> np.ndarray:
    force = np.linspace(0, 1, n)
    force[10 : 10 + rows] = np.nan
    return force


def timeless(rows: int) -> str:
    """So many rows in a row without a time."""
    return GOOD + "".join("nan,1.5,3.0\n" for _ in range(rows)) + "9,1.5,3.0\n"


def repeated(rows: int) -> str:
    """So many of 800 rows repeat the time of the one before."""
    times = np.repeat(np.arange(800), np.where(np.arange(800) < rows, 2, 1))[:800]
    return "T,Fx,Fz\ns,N,N\n" + "".join(f"{t},1.{i % 10},3\n" for i, t in enumerate(times))


def united(names: str, other: str = "N") -> str:
    return f"T [s],{names}\n" + "".join(f"{i},1,3,{('mN', other)[i % 2]}\n" for i in range(20))


def worded(rows: int) -> str:
    """So many rows in a row with a word in place of the force."""
    return "T,Fx,Fz\ns,N,N\n" + "".join(f"{i},{'OVER' if 9 < i <= 9 + rows else 1.5},3\n" for i in range(40))


def refused_by_pandas(always: bool) -> Act:
    """Rows that pandas cannot split, whatever it is told of them."""

    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        def failing(*_: object, **__: object) -> None:
            raise ValueError("Error tokenizing data")

        if always:
            patch.setattr(rows, "_pandas", failing)
        return file(GOOD.replace("0.20,", "OVER,"))(folder, patch)

    return act


def book(rows: list[list[Any]], **limits: Any) -> Act:
    """A workbook is read."""

    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        for name, value in limits.items():
            patch.setattr(excel, name, value)
        made = openpyxl.Workbook()
        for cells in rows:
            made.active.append(cells)
        made.save(folder / "log.xlsx")
        return read_log(folder / "log.xlsx")

    return act


def far_cells(rows: int) -> list[list[Any]]:
    """Rows with one cell each, far from the table."""
    return [[None] * 300 + [1.0] for _ in range(rows)]


def failing_with(error: Exception | None) -> Act:
    """The HDF5 library opens a file, or says why it does not."""

    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        h5(layout())(folder, patch)

        def failing(*_: object, **__: object) -> None:
            raise error or AssertionError

        if error is not None:
            patch.setattr(h5py, "File", failing)
        return read_log(folder / "log.h5")

    return act


def not_allowed(forbidden: bool) -> Act:
    """The system does not let a file be read."""

    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        (folder / "log.csv").write_text(GOOD)

        def refusing(*_: object, **__: object) -> None:
            raise PermissionError(13, "Permission denied")

        if forbidden:
            patch.setattr(Path, "open", refusing)
        return read_log(folder / "log.csv")

    return act


SHEET = [["T", "Fx", "Fz"], ["s", "N", "N"], [0.0, 1.0, 3.0], [1.0, 2.0, 3.0]]


def workbook(cut: int | None) -> Act:
    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        book(SHEET)(folder, patch)
        path = folder / "log.xlsx"
        path.write_bytes(path.read_bytes()[:cut] + (b"" if cut is None else b"[Content_Types].xml"))
        return read_log(path)

    return act


def h5(fill: Callable[[Any], object], /, **options: Any) -> Act:
    """An HDF5 file is read."""

    def act(folder: Path, _patch: pytest.MonkeyPatch) -> object:
        with h5py.File(folder / "log.h5", "w") as made:
            fill(made)
        return read_log(folder / "log.h5", **options)

    return act


UNITS = {"time": "s", "normal_force": "N", "friction_force": "N"}
NAMED = {"time": "/daq/t", "normal_force": "/daq/Fz", "friction_force": "/daq/Fx"}


def layout(version: int = 1, run: str = "run_1", speed: str | None = None, **sizes: int) -> Callable[[Any], None]:
    """Our layout as others would write it."""

    def fill(made: Any) -> None:
        made.attrs.update({"format": "stickslip-log", "format_version": version})
        for name, unit in UNITS.items():
            made[f"{run}/step_1/{name}"] = 1.0 + np.arange(sizes.get(name, 9))
            made[f"{run}/step_1/{name}"].attrs["units"] = unit
        if speed is not None:
            made.attrs.update({"drive_speed": 1.0, "drive_speed_units": speed})

    return fill


def promising(rows: int) -> Callable[[Any], None]:
    """Columns of which nothing was ever written but a rising clock's first block."""

    def fill(made: Any) -> None:
        made.attrs.update({"format": "stickslip-log", "format_version": 1})
        for name, unit in UNITS.items():
            data = made.create_dataset(f"run_1/step_1/{name}", (rows,), "f8", chunks=(1000,))
            data[:1000] = 1.0 + np.arange(1000)
            data.attrs["units"] = unit

    return fill


def accounted(text: str) -> Callable[[Any], None]:
    def fill(made: Any) -> None:
        layout()(made)
        made["about"] = text

    return fill


def daq(**items: Any) -> Callable[[Any], None]:
    """Datasets of another programme."""

    def fill(made: Any) -> None:
        for name, unit in (("t", "s"), ("Fz", "N"), ("Fx", "N")):
            made[f"daq/{name}"] = items.get(name, 1.0 + np.arange(9))
            if name not in items or isinstance(items[name], np.ndarray):
                made[f"daq/{name}"].attrs["units"] = unit

    return fill


def virtual(elsewhere: bool) -> Callable[[Any], None]:
    def fill(made: Any) -> None:
        daq()(made)
        if elsewhere:
            del made["daq/Fx"]
            made.create_virtual_dataset("daq/Fx", h5py.VirtualLayout((9,), dtype="f8"))
            made["daq/Fx"].attrs["units"] = "N"

    return fill


def ended(status: int | None) -> Act:
    """The process that looks through the file first ended like that."""

    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        patch.setattr(hdf5_open, "_forked", lambda *_: status)
        patch.setattr(hdf5_open, "_spawned", lambda *_: status)
        return h5(layout())(folder, patch)

    return act


def with_memory(free: int) -> Act:
    """So many bytes are free for a log of 3 x 9 numbers."""

    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        patch.setattr(hdf5_values, "_SMALL", 0)
        patch.setattr(hdf5_values, "free_memory", lambda: free)
        return h5(layout())(folder, patch)

    return act


def mat(variables: dict[str, Any], cut: int | None = None) -> Act:
    held = io.BytesIO()
    scipy.io.savemat(held, variables)
    return file(held.getvalue()[:cut], "log.mat")


T = np.arange(9.0)


def mat_object() -> bytes:
    """A .mat with an object alone, as MATLAB saves a timeseries."""
    words = b"".join(
        b"\x01\0\0\0" + len(word).to_bytes(4, "little") + word.ljust(-(-len(word) // 8) * 8, b"\0")
        for word in (b"log", b"MCOS", b"timeseries")
    )
    flags = b"\x06\0\0\0\x08\0\0\0" + (17).to_bytes(4, "little") + bytes(4)
    body = flags + words
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    return head + b"\x0e\0\0\0" + len(body).to_bytes(4, "little") + body


def zipped(names: dict[str, str], read: str = "", cut: int | None = None) -> Act:
    def act(folder: Path, _patch: pytest.MonkeyPatch) -> object:
        with zipfile.ZipFile(folder / "logs.zip", "w") as packed:
            for name, text in names.items():
                packed.writestr(name, text)
        path = folder / "logs.zip"
        path.write_bytes(path.read_bytes()[:cut])
        return list_steps(path / read if read else path)

    return act


def listed(damaged: bool) -> Act:
    """The files of an archive whose list of contents is damaged."""

    def act(folder: Path, _patch: pytest.MonkeyPatch) -> object:
        path = folder / "logs.zip"
        with zipfile.ZipFile(path, "w") as packed:
            packed.writestr("log.csv", GOOD)
        data = bytearray(path.read_bytes())
        if damaged:
            data[data.rindex(b"PK\x01\x02") + 1] = 0
        path.write_bytes(data)
        return read_log(path)

    return act


def folder_of(**texts: str) -> Act:
    """A folder of logs is read as one test."""

    def act(folder: Path, _patch: pytest.MonkeyPatch) -> object:
        for name, text in texts.items():
            (folder / f"{name}.txt").write_text(text)
        return read_log(folder)

    return act


def path_of(name: str, there: bool = True) -> Act:
    """A path is read; what lies there is a good log."""

    def act(folder: Path, _patch: pytest.MonkeyPatch) -> object:
        if there:
            (folder / "log.csv").write_text(GOOD)
        return read_log(folder / name)

    return act


def packed_limit(most: int) -> Act:
    """At most so many bytes of a packed HDF5 file may be taken into memory."""

    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        patch.setattr(source, "LARGEST_WHOLE", most)
        h5(layout())(folder, patch)
        (folder / "log.h5.gz").write_bytes(gzip.compress((folder / "log.h5").read_bytes()))
        return read_log(folder / "log.h5.gz")

    return act


def hashed(change: Callable[[Path], object]) -> Act:
    """A file is read, then something happens to it, then somebody asks for its checksum."""

    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        record = h5(layout())(folder, patch)
        change(folder / "log.h5")
        return record.metadata["sha256"]  # type: ignore[attr-defined]

    return act


def written(work: Callable[[Path], object]) -> Act:
    return lambda folder, _patch: work(folder)


def misread(share: bool) -> Act:
    """An archive whose numbers are others when it is read back."""

    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        if share:
            patch.setattr(write, "_content_of", lambda _: "other")
        return write_hdf5(sample(), folder / "log.h5")

    return act


def sample() -> Record:
    return Record(np.arange(9.0), np.ones(9), np.arange(9.0))


def checksums(ours: bool) -> Act:
    def act(folder: Path, patch: pytest.MonkeyPatch) -> object:
        if ours:
            write_hdf5(sample(), folder / "log.h5")
        else:
            h5(layout())(folder, patch)
        return write.changed_runs(folder / "log.h5")

    return act


def ours(line: int, new: str) -> Act:
    """A CSV of ours in which one line, from 1, is another ("" leaves it)."""

    def act(folder: Path, _patch: pytest.MonkeyPatch) -> object:
        write_csv(sample(), folder / "log.csv")
        lines = (folder / "log.csv").read_text().split("\n")
        lines[line - 1] = new or lines[line - 1]
        (folder / "log.csv").write_text("\n".join(lines))
        return read_log(folder / "log.csv")

    return act


def to_and_fro(strokes: int, load_at_rest: float = 0.0) -> Record:
    """Strokes of 5 s behind 4 s of rest."""
    time = np.arange((4 + 5 * strokes) * 100) / 100.0
    way = np.where(((time - 4.0) // 5.0) % 2 == 0, 1.0, -1.0)
    friction = np.where(time < 4.0, 0.0, 0.6 * way) + 1e-3 * np.sin(37.0 * time)
    return Record(time, np.where(time < 4.0, load_at_rest, 2.0), friction)


def corrected(record: Record, **given: Any) -> Act:
    return plain(lambda: correct(record, Corrections(**given)))


def moved(travel: float) -> Record:
    time = np.arange(2000) / 100.0
    place = travel * np.abs((time % 10.0) - 5.0)
    return Record(time, np.ones(2000), np.sin(time), channels={"X": place}, channel_units={"X": "m"})


def holed(zeros: int) -> bytes:
    """Zero bytes among the rows, and rows below them."""
    return GOOD.encode() + bytes(zeros) + b"\n" + b"0.50,1.5,3.0\n" * 30_000


def tables(count: int) -> str:
    return "T,Fx,Fz\ns,N,N\n" * (count - 1) + GOOD


def a_pipe(folder: Path, _: object) -> object:
    os.mkfifo(folder / "pipe.csv")
    try:
        return source.load(folder / "pipe.csv")
    finally:
        (folder / "pipe.csv").unlink()


def clock_of(step: float) -> Act:
    """A record of ten rows, so far apart [s]."""
    return lambda *_: Record(step * np.arange(10.0), np.ones(10), np.ones(10))


# name: (what is refused, what just is not)
CASES: dict[str, Pair] = {
    # the path
    "no such file": (path_of("log.csv", there=False), path_of("log.csv")),
    "a folder named as a member": (zipped({"a.csv": GOOD}, "b.csv"), zipped({"a.csv": GOOD}, "a.csv")),
    "no file of that name": (path_of("a\0b"), path_of("log.csv")),
    "an empty file": (file(""), file(GOOD)),
    "nothing packed": (file(gzip.compress(b"")), file(PACKED)),
    "a folder": (lambda folder, _: source.load(folder), path_of("log.csv")),
    "a pipe": (a_pipe, path_of("log.csv")),
    "a clock in a wrong unit": (clock_of(1e10), clock_of(1e-3)),
    "an empty folder": (folder_of(), folder_of(one=GOOD)),
    "no file fits": (path_of("x*.csv"), path_of("l*.csv")),
    "a pattern of no path": (path_of("**x/*.csv"), path_of("*.csv")),
    "files that do not count up": (folder_of(a1=GOOD, a3=GOOD), folder_of(a1=GOOD, a2=GOOD)),
    "files of two formats": (folder_of(a1=GOOD, a2=umt(step(1))), folder_of(a1=GOOD, a2=GOOD)),
    "several runs in a file of a series": (
        folder_of(a1=umt(step(1)), a2=umt(step(1)) + umt(step(1)).replace("# 1", "# 2")),
        folder_of(a1=umt(step(1)), a2=umt(step(1))),
    ),
    # packed files
    "cut gz": (file(PACKED[:-10]), file(PACKED)),
    "two files packed": (zipped({"a.csv": GOOD, "b.csv": GOOD}), zipped({"a.csv": GOOD})),
    "damaged zip": (listed(True), listed(False)),
    "a gz that holds too much": (
        file(gzip.compress(b"T,Fx,Fz\ns,N,N\n") + gzip.compress(b"0,1,2\n" * (1 << 20), 6) * 7),
        file(gzip.compress(b"T,Fx,Fz\ns,N,N\n" + b"".join(b"%d,1,2\n" % i for i in range(99)))),
    ),
    "no line within a MiB of what is packed": (file(gzip.compress(bytes(1 << 21))), file(PACKED)),
    "too much packed for memory": (packed_limit(100), packed_limit(1 << 20)),
    "changed since": (hashed(lambda p: p.write_bytes(p.read_bytes() + b"\0")), hashed(lambda p: None)),
    "gone since": (hashed(lambda p: p.unlink()), hashed(lambda p: None)),
    # what no reader knows
    "binary": (file(bytes(range(1, 256)) * 40), file(GOOD)),
    "old Excel": (file(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600)), book(SHEET)),
    "damaged TDMS": (tdms_that(ValueError), tdms()),
    "TDMS without its reader": (without_tdms, tdms()),
    "TDMS beyond memory": (tdms_that(MemoryError), tdms()),
    "TDMS without samples": (tdms(rows=0), tdms()),
    "a scaling of another kind": (tdms(scale="Magic"), tdms(scale="Linear")),
    "damaged Parquet": (parquet_that(lambda _: None), parquet()),
    "Parquet without its reader": (parquet_that(lambda patch: patch.setitem(sys.modules, "pyarrow", None)), parquet()),
    "Parquet beyond memory": (beyond_memory("free"), beyond_memory("plenty")),
    "native CETR": (file(b"#1# Name$pair$\x00\x01\x02" + bytes(50)), file(umt(step(1)))),
    # text without a table
    "no numbers": (file("T,Fx,Fz\ns,N,N\n"), file("T,Fx,Fz\ns,N,N\n0,1,3\n1,1,3\n")),
    "no known column": (file(GOOD.replace("T,Fx,Fz", "A,B,C")), file(GOOD)),
    "no header": (file("\n".join(ROWS)), file("T (s),Fx (N),Fz (N)\n" + "\n".join(ROWS) + "\n")),
    "columns of other names": (
        file(GOOD.replace("T,Fx,Fz", "A,B,C"), columns={"time": "Q"}),
        file(GOOD.replace("T,Fx,Fz", "A,B,C"), columns={"time": "A", "friction_force": "B", "normal_force": "C"}),
    ),
    "a clock that restarts": (
        file("T [s],Fx [N],Fz [N]\n" + "".join(f"{i % 4 / 10},{i % 7}.5,3.0\n" for i in range(40))),
        file("T [s],Fx [N],Fz [N]\n" + "".join(f"{i / 10},{i % 7}.5,3.0\n" for i in range(40))),
    ),
    "units for a column": (
        file("0.0 s 0.5 N\n0.1 s 0.6 N\n" * 9, columns={"time": "1", "friction_force": "2"}, normal_force=3.0),
        file("".join(f"{i / 10} s 0.{i} N\n" for i in range(9)), columns={"time": "1", "friction_force": "3"},
             normal_force=3.0),
    ),
    "formulas without results": (formulas(True), formulas(False)),
    "zero bytes amid the text": (
        file(GOOD[:60] + "\0" * 9 + GOOD[60:] + "\n" * 100),
        file(GOOD),
    ),
    "channels without rows": (channels(""), channels("0,0.5,0,3\n1,0.6,1,3\n")),
    "channels that misfit": (channels("0,0.5,0\n1,0.6,1\n"), channels("0.5,3\n0.6,3\n")),
    "no rate": asked({"rate": "4 m"}, {"rate": "4 Hz"}),
    "a rate of nothing": asked({"rate": "0 Hz"}, {"rate": "0.1 Hz"}),
    "two clocks": asked({"rate": "4 Hz", "columns": {"time": "T"}}, {"rate": "4 Hz"}),
    "clocks that do not meet": (clocks(4.0), clocks(3.7)),
    "one of several clocks that falls": (clocks(0.0, falls=True), clocks(0.0)),
    "tables side by side": (clocks(0.0, again="Fx"), clocks(0.0)),
    "another force that moves": (axes(0.0), axes(0.01)),
    "swapped forces": (axes(None, level=2.0), axes(None, level=0.5)),
    "words without end": (file("a word\n" * 20_001 + GOOD), file("a word\n" * 19_990 + GOOD)),
    "headers without end": (file(tables(5010)), file(tables(5000))),
    "a line without end": (file(GOOD + "7" * (1 << 22)), file(GOOD + "7" * (1 << 18))),
    "zero bytes": (file(holed(1 << 19)), file(holed(0).replace(b"0.50,1.5,3.0\n", b"") + b"0.50,1.5,3.0\n")),
    # header and rows
    "two units": (file("T,Fx (N),Fz\ns,mN,N\n0,1,3\n1,1,3\n"), file("T,Fx (N),Fz\ns,N,N\n0,1,3\n1,1,3\n")),
    "fields that misfit": (file(GOOD.replace("T,", "T,Z,").replace("s,", "s,mm,")), file(GOOD)),
    "commas for both": (file("T (s),Fx (N),Fz (N)\n" + "0,01,1,5,3,0\n" * 3), file(GOOD)),
    "prose": (file("Dear lab, please find attached the log.\n" * 9), file(GOOD)),
    "a number behind the last column": (
        file("T,Fx,Fz\ns,N,N\n0,1,3,\n1,1,3,\n2,1,3,7\n"),
        file("T,Fx,Fz\ns,N,N\n0,1,3,\n1,1,3,\n2,1,3,\n"),
    ),
    "rows that pandas refuses": (refused_by_pandas(True), refused_by_pandas(False)),
    "a row too long": (file(GOOD + "0.5,1,3,4\n"), file(GOOD + "0.5,1,3,\n")),
    "thousands": (
        file("T [ms]\tFx [mN]\tFz [mN]\n0\t999\t2,000\n1\t1,001\t2,000\n"),
        file("T [ms]\tFx [mN]\tFz [mN]\n0\t0,999\t2,000\n1\t1,001\t2,000\n"),
    ),
    "units of nobody": (file(united("Fx,Fz,Unit")), file(united("Fx,Fz [N],Unit"))),
    "one unit for several": (
        file(united("Fx,Fz [N],Unit"), units={"friction_force": "N"}),
        file(united("Fx,Fz [N],Unit", "mN"), units={"friction_force": "N"}),
    ),
    "words for numbers": (file(worded(30)), file(worded(5))),
    "words in a row": (file(worded(6)), file(worded(5))),
    # columns, units, choices
    "no time": (file(GOOD.replace("T,", "Q,")), file(GOOD)),
    "no friction force": (file(GOOD.replace("Fx", "Q")), file(GOOD)),
    "no normal force": (file(GOOD.replace("Fz", "Q")), file(GOOD.replace("Fz", "Q"), normal_force=3.0)),
    "no unit": (file(GOOD.replace("s,N,N\n", "")), file(GOOD.replace("s,N,N\n", ""), units=UNITS)),
    "unknown unit": (file(GOOD.replace("s,N,N", "s,apples,N")), file(GOOD.replace("s,N,N", "s,mN,N"))),
    "a scale that does not fit": (
        file(GOOD.replace("s,N,N", "s,V,N"), units={"friction_force": "2 mm/V"}),
        file(GOOD.replace("s,N,N", "s,V,N"), units={"friction_force": "2 N/V"}),
    ),
    "a column without numbers": (
        file("T,Fx,Fz\ns,N,N\n" + "0,,3\n1,,3\n2,,3\n"),
        file("T,Fx,Fz\ns,N,N\n" + "0,1,3\n1,2,3\n2,,3\n"),
    ),
    "a role that is none": asked({"columns": {"friction": "Fx"}}, {"columns": {"friction_force": "Fx"}}),
    "a column that is not there": asked({"columns": {"time": "Q"}}, {"columns": {"time": "T"}}),
    "a column for two purposes": asked(
        {"columns": {"friction_force": "Fx", "normal_force": "Fx"}},
        {"columns": {"friction_force": "Fx", "normal_force": "Fz"}},
    ),
    "a unit of no column": asked({"units": {"force": "N"}}, {"units": {"friction_force": "N"}}),
    "a load of no force": asked({"normal_force": "3 mm"}, {"normal_force": "3 N"}),
    "a load of zero": asked({"normal_force": 0}, {"normal_force": 1e-9}),
    "a window that ends before it starts": asked({"window": (0.2, 0.2)}, {"window": (0.1, 0.2)}),
    "a window outside": asked({"window": (0.39, 9.0)}, {"window": (0.38, 9.0)}),
    "no such run": asked({"run": 2}, {"run": 1}),
    "several runs": (
        file(umt(step(1)) + umt(step(1)).replace("# 1", "# 2")),
        file(umt(step(1)) + umt(step(1)).replace("# 1", "# 2"), run=2),
    ),
    "no such step": asked({"step": 3}, {"step": 1}),
    "an empty step": (
        file(umt(step(1), step(2, 0), step(3)), step=2),
        file(umt(step(1), step(2, 2), step(3)), step=2),
    ),
    "no such stroke": asked({"stroke": 2}, {"stroke": 1}, MOVING),
    "strokes without a position": (
        plain(lambda: strokes_as_steps(moved(0.0))),
        plain(lambda: strokes_as_steps(moved(1e-3))),
    ),
    "a position that is none": (plain(lambda: motion_of(moved(1.0), "Y")), plain(lambda: motion_of(moved(1.0), "X"))),
    # the clock
    "no time at all": (file("T,Fx,Fz\ns,N,N\nnan,1,3\nnan,1,3\n"), file("T,Fx,Fz\ns,N,N\n0,1,3\n1,1,3\n")),
    "no time for long": (file(timeless(6)), file(timeless(5))),
    "a clock that falls": (file(GOOD + "0.38,1.5,3.0\n"), file(GOOD + "0.395,1.5,3.0\n")),
    "a clock that stands": (file(repeated(9)), file(repeated(8))),
    # the record
    "one row": (ramp(1), ramp(2)),
    "no numbers in a record": (ramp(friction_force=["a"] * 20), ramp(friction_force=["1"] * 20)),
    "a column of another length": (ramp(friction_force=np.ones(19)), ramp(friction_force=np.ones(20))),
    "a time that is none": (ramp(3, time=[0.0, np.nan, 2.0]), ramp(3, time=[0.0, 1.0, 2.0])),
    "a time that starts late": (ramp(2, time=[1e-9, 1.0]), ramp(2, time=[0.0, 1.0])),
    "a time that stands": (ramp(3, time=[0.0, 1.0, 1.0]), ramp(3, time=[0.0, 1.0, np.nextafter(1.0, 2.0)])),
    "numbers beyond all forces": (
        ramp(normal_force=np.r_[np.full(11, 2e9), np.ones(9)]),
        ramp(normal_force=np.r_[np.full(5, 2e9), np.ones(15)]),
    ),
    "six rows without a force": (ramp(40, friction_force=gap(6)), ramp(40, friction_force=gap(5))),
    "one row with a force": (ramp(3, friction_force=[1, np.nan, np.nan]), ramp(3, friction_force=[1, np.nan, 1])),
    "a channel called like a role": (ramp(channels={"time": np.ones(20)}), ramp(channels={"times": np.ones(20)})),
    "a unit of two lines": (
        ramp(channels={"Z": np.ones(20)}, channel_units={"Z": "m\n"}),
        ramp(channels={"Z": np.ones(20)}, channel_units={"Z": "m"}),
    ),
    "a drive speed that is none": (ramp(drive_speed=np.inf), ramp(drive_speed=0.0)),
    "steps that leave rows out": (ramp(steps=(Step(1, 1, 0, 19),)), ramp(steps=(Step(1, 1, 0, 20),))),
    "steps of one number": (
        ramp(steps=(Step(1, 1, 0, 10), Step(1, 1, 10, 20))),
        ramp(steps=(Step(1, 1, 0, 10), Step(1, 2, 10, 20))),
    ),
    "a frame without a column": (
        plain(lambda: Record.from_frame(pd.DataFrame({"time": [0, 1], "normal_force": [1, 1]}))),
        plain(lambda: Record.from_frame(pd.DataFrame({"time": [0, 1], "normal_force": 1, "friction_force": 1}))),
    ),
    "a frame with words": (
        plain(lambda: Record.from_frame(pd.DataFrame({"time": [0, 1], "normal_force": 1, "friction_force": "a"}))),
        plain(lambda: Record.from_frame(pd.DataFrame({"time": [0, 1], "normal_force": 1, "friction_force": "1"}))),
    ),
    # cut and correct
    "both angles from the strokes": (
        corrected(to_and_fro(4), crosstalk="strokes", tilt="strokes"),
        corrected(to_and_fro(4), crosstalk="strokes", tilt=0.01),
    ),
    "one way only": (corrected(to_and_fro(1), tilt="strokes"), corrected(to_and_fro(2), tilt="strokes")),
    "a zero under load": (
        corrected(to_and_fro(4, 0.3), tare=(0.0, 3.5), crosstalk="strokes"),
        corrected(to_and_fro(4, 0.1), tare=(0.0, 3.5), crosstalk="strokes"),
    ),
    "a tare without rows": (corrected(to_and_fro(1), tare=(9.0, 12.0)), corrected(to_and_fro(1), tare=(8.9, 12.0))),
    # Excel and MATLAB
    "an empty workbook": (book([]), book(SHEET)),
    "a damaged workbook": (workbook(700), workbook(None)),
    "a workbook that unpacks to much": (book(SHEET, _LARGEST=100), book(SHEET, _LARGEST=1 << 20)),
    "a .mat without columns": (mat({"a": 1.0}), mat({"t_s": T, "Fx_N": T, "Fz_N": T + 1})),
    "an object in a .mat": (file(mat_object(), "log.mat"), mat({"t_s": T, "Fx_N": T, "Fz_N": T + 1})),
    "a cut .mat": (
        mat({"t_s": T, "Fx_N": T, "Fz_N": T + 1}, 300),
        mat({"t_s": T, "Fx_N": T, "Fz_N": T + 1}),
    ),
    # HDF5
    "a later layout": (h5(layout(version=2)), h5(layout())),
    "no runs": (h5(layout(run="runs")), h5(layout())),
    "no layout": (h5(lambda made: made.update({"a": T})), h5(daq())),
    "no such step in HDF5": (h5(layout(), step=2), h5(layout(), step=1)),
    "a window outside of HDF5": (h5(layout(), window=(7.5, 20.0)), h5(layout(), window=(6.5, 20.0))),
    "no column": (h5(daq(Fx=np.ones((9, 2))), columns=NAMED), h5(daq(Fx=np.ones((9, 1))), columns=NAMED)),
    "lengths that differ": (h5(layout(time=8)), h5(layout(time=9))),
    "no such dataset": (h5(daq(), columns={**NAMED, "time": "/daq/q"}), h5(daq(), columns=NAMED)),
    "an account that is none": (h5(accounted("{}")), h5(accounted('{"metadata": {}, "findings": []}'))),
    "a speed in newtons": (h5(layout(speed="N")), h5(layout(speed="mm/s"))),
    "damaged HDF5": (file(b"\x89HDF\r\n\x1a\n" + bytes(300), "log.h5"), h5(layout())),
    "numbers elsewhere": (h5(virtual(True), columns=NAMED), h5(virtual(False), columns=NAMED)),
    "a link elsewhere": (
        h5(daq(Fx=h5py.ExternalLink("other.h5", "/Fx")), columns=NAMED),
        h5(daq(), columns=NAMED),
    ),
    "HDF5 that hangs": (ended(None), ended(0)),
    "HDF5 that crashes": (ended(-11), ended(1)),
    "cells far apart": (book([*SHEET, *far_cells(100)], _CELLS=1), book([*SHEET, *far_cells(3)], _CELLS=1)),
    "a file held open": (failing_with(OSError("unable to lock file")), failing_with(None)),
    "a file that may not be read": (not_allowed(True), not_allowed(False)),
    "bytes that were never written": (h5(promising(10_000_000)), h5(promising(1000))),
    "more than memory": (with_memory(2 * 8 * 27 - 1), with_memory(2 * 8 * 27)),
    # our own files
    "our CSV of a later version": (ours(1, "# stickslip-log 2"), ours(1, "")),
    "our CSV without account": (ours(2, "# {}"), ours(2, "")),
    "our CSV with a unit lost": (ours(4, "s,N"), ours(4, "s,N,N")),
    "an archive of nothing": (
        written(lambda folder: write_archive([], folder / "a.h5")),
        written(lambda folder: write_archive([sample()], folder / "a.h5")),
    ),
    "an archive that reads back otherwise": (misread(True), misread(False)),
    "no checksum of ours": (checksums(False), checksums(True)),
    "a folder that is not there": (
        written(lambda folder: write_csv(sample(), folder / "none" / "a.csv")),
        written(lambda folder: write_csv(sample(), folder / "a.csv")),
    ),
    # quantities and thresholds
    "a threshold of another name": (plain(lambda: Thresholds({"jiter": 1})), plain(lambda: Thresholds({"jitter": 1}))),
    "a threshold below zero": (plain(lambda: Thresholds({"jitter": -1})), plain(lambda: Thresholds({"jitter": 0}))),
    "no quantity": (plain(lambda: parse_quantity(None, "N")), plain(lambda: parse_quantity(1, "N"))),
    "no finite quantity": (plain(lambda: parse_quantity(np.inf, "N")), plain(lambda: parse_quantity(1e300, "N"))),
    "no number in a quantity": (plain(lambda: parse_quantity("much", "N")), plain(lambda: parse_quantity("1", "N"))),
    "a comma in a quantity": (plain(lambda: parse_quantity("1,5 N", "N")), plain(lambda: parse_quantity("1.5 N", "N"))),
    "a quantity of another kind": (
        plain(lambda: parse_quantity("1 mm", "N")),
        plain(lambda: parse_quantity("1 mN", "N")),
    ),
}  # fmt: skip
