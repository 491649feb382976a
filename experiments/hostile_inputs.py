"""Small inputs that ask for unbounded work, and inputs that foreign libraries stumble over: what each must end in.

Each is a file with the command that is given it. What is wrong with a log stands at a marked place of a small log of
every text format; the rest are binary files, scenes, manifests and options of the command line.
"""

from __future__ import annotations

import gzip
import io
import itertools
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import h5py
import numpy as np
import openpyxl
import scipy.io

from experiments.batch_trials import SCENE as PAIR


@dataclass(frozen=True)
class Hostile:
    """One input: what is wrong with it, its file, its bytes, the command ({file}, {scene}, {log}, {out} are replaced).

    sound: it may as well be read (exit 0): nothing in it is wrong, there is only much of it.
    """

    name: str
    file: str
    data: Callable[[], bytes]
    command: Sequence[str] = ("inspect", "{file}")
    sound: bool = False
    beside: Mapping[str, bytes] = field(default_factory=dict)


SCENE = f'{PAIR}drive_speed = "0.2 mm/s"\nnormal_force = "1 N"\n'
ROWS = [(0.0, 0.5, 3.0), (0.02, 0.52, 3.01), (0.04, 0.54, 2.99), (0.06, 0.53, 3.0)]
"""Time [s], friction and normal force [N] of the logs that something is wrong with."""


def _rows(delimiter: str, *, pattern: str = "tfn", decimal: str = ".", end: str = "") -> str:
    cells = [{"t": f"{t:.4f}", "f": f"{f:.4f}", "n": f"{n:.4f}", "0": "0"} for t, f, n in ROWS]
    lines = [delimiter.join(row[key] for key in pattern).replace(".", decimal) + end for row in cells]
    first = "@CELL@" + lines[0][lines[0].find(delimiter) :]
    return "".join(f"{line}\n" for line in (first, *lines[1:])).replace("\n", "\n@ROWS@", 1)


TEXTS: Mapping[str, str] = {
    "comma.csv": "@TOP@\n@NAME@T [s],Fx [@UNIT@],Fz [N]\n@BELOW@" + _rows(",") + "@END@",
    "semicolon.csv": "@TOP@\n@NAME@Zeit;Reibkraft;Normalkraft\ns;@UNIT@;N\n@BELOW@" + _rows(";", decimal=",") + "@END@",
    "tab.txt": "@TOP@\n@NAME@Time (s)\tFriction force (@UNIT@)\tNormal force (N)\n@BELOW@" + _rows("\t") + "@END@",
    "blanks.dat": "@TOP@\n@NAME@T Fx Fz\ns @UNIT@ N\n@BELOW@" + _rows(" ") + "@END@",
    "cetr.txt": "Created by CETR UMT ver.1.136.257 12 May 2022 12:21:50\n@TOP@\nRun # 1\nStep No. 1\n\nRadius = 3.9\n"
    "Started at: 12:21:58.029 12 May 2022\n\n@NAME@T,Fx,Fz\nsec,@UNIT@,N\n\n@BELOW@" + _rows(",") + "@END@",
    "rtec.csv": "Recipe, UpperSample, LowerSample, Type, Radius\rRotary,,,Rotary,1,\n@TOP@\n@NAME@Step, Timestamp, "
    "DAQ.Fx (@UNIT@), DAQ.Fz (N),\n@BELOW@" + _rows(",", pattern="0tfn", end=",") + "@END@TotalTime\n00:12:56.5\n",
    "anton_paar.txt": "@TOP@\n@NAME@Time [s]\tFriction Force [@UNIT@]\tNominal Load [N]\t\n@BELOW@"
    + _rows("\t", end="\t") + "@END@",
    "pair.lvm": "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\n@TOP@\n***End_of_Header***\t\n"
    "Delta_X\t@INTERVAL@\n***End_of_Header***\t\n@NAME@X_Value\tfx_@UNIT@\tfz_N\n@BELOW@" + _rows("\t") + "@END@",
    "interval.csv": "@TOP@\nInterval,@INTERVAL@\n@NAME@Fx (@UNIT@),Fz (N)\n@BELOW@"
    + _rows(",", pattern="fn") + "@END@",
}  # fmt: skip
"""A log of every text format; what stands at @…@ is put in."""
USUAL: Mapping[str, str] = {"UNIT": "N", "CELL": "0.0000", "INTERVAL": "0.02"}


def text(name: str, **places: str) -> bytes:
    """A log of a text format with these words at its places."""
    made = TEXTS[name]
    for place, words in {**USUAL, **places}.items():
        made = made.replace(f"@{place}@", words)
    for place in ("TOP", "NAME", "BELOW", "ROWS", "END"):
        made = made.replace(f"@{place}@", "")
    return made.encode()


GOOD = text("comma.csv")
BOMBS: Mapping[str, str] = {
    "tower": "N*9^9^9",
    "power": "N^999999999",
    "product of powers": "9**9999999 N",
    "brackets": "N^{((9^9)^9)^9}",
}
NUMBERS: Mapping[str, str] = {
    "hexadecimal": "0x" + "f" * 50_000,
    "10,000 digits": "7" * 10_000,
    "10,000 decimals": "abc0." + "7" * 10_000,
    "exponent": "1e" + "9" * 400,
}
LINES: Mapping[str, str] = {
    "blank lines": "\n" * 40_000,
    "CR LF": "\r\n" * 40_000,
    "lines of blanks": " \t\n" * 40_000,
    "empty cells": ",;\t,\n" * 20_000,
}


def _log(what: str, name: str, sound: bool = True, **places: str) -> Hostile:
    return Hostile(what, name, partial(text, name, **places), sound=sound)


def texts() -> Iterator[Hostile]:
    """Every text format with what asks for work at each of its places."""
    blanks = {"TOP": "Key" + " " * 50_000 + "x", "UNIT": " " * 50_000 + "N", "NAME": " " * 50_000}
    for name in TEXTS:
        yield from (_log(f"unit, {what}", name, sound=False, UNIT=unit) for what, unit in BOMBS.items())
        yield from (_log(f"number, {what}", name, CELL=number) for what, number in NUMBERS.items())
        for (what, line), place in itertools.product(LINES.items(), ("TOP", "BELOW", "ROWS", "END")):
            yield _log(f"{what}, {place.lower()}", name, **{place: line})
        for place in ("TOP", "NAME", "UNIT", "CELL", "END"):
            words = blanks.get(place, "0" + " " * 50_000 + "x")
            yield _log(f"50,000 blanks, {place.lower()}", name, **{place: words})
    for (what, number), name in itertools.product(NUMBERS.items(), ("pair.lvm", "interval.csv")):
        yield _log(f"interval, {what}", name, INTERVAL=number)


NEARLY: Mapping[str, str] = {
    "step without a number": "Step No." + " " * 50_000 + "x\n",
    "many steps without a number": "Step\n" * 10_000,
    "run of blanks": "Run #" + " \t" * 30_000 + ";\n",
    "step of many digits": f"Step No. {'9' * 10_000}\n",
    "date of many digits": f"Started at: {'1' * 10_000}:00:00 12 May 2022\n",
    "interval of blanks": "Interval" + " " * 50_000 + "0.5x\n",
    "interval lines": "\n \n" * 15_000 + "Interval,x\n",
    "brackets": "Fx " + "(" * 50_000 + "\n",
    "bracket pairs": "Fx " + "()" * 20_000 + ",T\n",
    "one name, many blanks": "Fx" + " " * 15_000 + "(N" + " " * 15_000 + "x,T\n",
    "many names": ",".join(f"Fx{i} (N)" for i in range(20_000)) + "\n",
    "quotes": '"' * 50_001 + "\n",
    "quotes in cells": '"a,' * 20_000 + "\n",
    "comments": "#" * 50_000 + "\n",
    "equals signs": "key " + "= " * 50_000 + "\n",
    "header lines": "T [s],Fx [N],Fz [N]\n" * 3000,
    "points": "1" + "." * 50_000 + "\n",
    "plus and minus": "+-" * 50_000 + "\n",
}
"""Lines that a pattern of a reader nearly fits, again and again."""


def patterns() -> Iterator[Hostile]:
    """Those lines above a log."""
    for (what, line), name in itertools.product(NEARLY.items(), ("comma.csv", "cetr.txt", "interval.csv", "pair.lvm")):
        yield _log(f"line, {what}", name, TOP=line)
    yield Hostile("file name of many digits", f"T11_{'9' * 180}N.csv", partial(text, "comma.csv"), sound=True)


def _gz(block: bytes, times: int) -> bytes:
    packer, out = zlib.compressobj(9, zlib.DEFLATED, 31), []
    out += [packer.compress(block) for _ in range(times)]
    return b"".join([*out, packer.flush()])


def _zip(names: Sequence[str], block: bytes, times: int) -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as packed:
        for name in names:
            with packed.open(name, "w") as member:
                for _ in range(times):
                    member.write(block)
    return held.getvalue()


MEGA = 1 << 20


def packed() -> Iterator[Hostile]:
    """Small archives that hold lines without end."""
    for line in (b"\n", b"\0", b" ", b"1", b"0.02,0.5,3\n", b"a note\n", b"T [s],Fx [N],Fz [N]\n", b",,\n"):
        block = line * (MEGA // len(line))
        yield Hostile(f"gz of {line!r}", "log.csv.gz", partial(_gz, block, 400))
        yield Hostile(f"zip of {line!r}", "log.zip", partial(_zip, ["log.csv"], block, 400))
        below = partial(lambda block: gzip.compress(GOOD) + _gz(block, 400), block)
        yield Hostile(f"gz of {line!r} below a table", "log.csv.gz", below, sound=True)
    yield Hostile("gz in gz", "log.csv.gz", lambda: gzip.compress(_gz(b"\0" * MEGA, 400)))
    yield Hostile("zip of 20,000 files", "logs.zip", lambda: _zip([f"log_{i}.csv" for i in range(20_000)], b"1", 1))
    yield Hostile("gz cut off", "log.csv.gz", lambda: gzip.compress(GOOD)[:-9])
    yield Hostile("HDF5 packed, of zeros", "log.h5.gz", lambda: _gz(b"\x89HDF\r\n\x1a\n" + b"\0" * MEGA, 400))
    yield Hostile("MAT packed, of zeros", "log.mat.gz", lambda: _gz(_mat_header() + b"\0" * MEGA, 400))


def _mat_header(order: str = "<") -> bytes:
    made = b"MATLAB 5.0 MAT-file, made".ljust(116) + b"\0" * 8
    return made + (b"\0\1IM" if order == "<" else b"\1\0MI")


def _element(kind: int, data: bytes, size: int | None = None, order: str = "<") -> bytes:
    return struct.pack(f"{order}II", kind, len(data) if size is None else size) + data + b"\0" * (-len(data) % 8)


def mat_matrix(dimensions: Sequence[int], *, array: int = 6, promised: int | None = None, order: str = "<") -> bytes:
    """A MATLAB file of one variable Fx whose header promises an array of these dimensions, with four numbers, 1 to 4.

    array: its class. promised: the bytes that its data element promises. order: of the bytes.
    """
    parts = _element(6, struct.pack(f"{order}II", array, 0), order=order)
    parts += _element(5, struct.pack(f"{order}{len(dimensions)}i", *dimensions), order=order)
    parts += _element(1, b"Fx", order=order)
    parts += _element(9, struct.pack(f"{order}4d", 1, 2, 3, 4), promised, order)
    return _mat_header(order) + _element(14, parts, order=order)


def _mat_of(variables: Mapping[str, object], packed: bool) -> bytes:
    held = io.BytesIO()
    scipy.io.savemat(held, dict(variables), do_compression=packed)
    return held.getvalue()


def changed(data: bytes, place: int, value: int) -> bytes:
    """The bytes with one of them replaced."""
    return data[:place] + bytes([value]) + data[place + 1 :]


def matlab() -> Iterator[Hostile]:
    """MATLAB files that promise more than they hold, and damaged ones."""
    promised = [((count, 1), 6) for count in (60_000_000, 2_000_000_000, -5)]
    promised += [((60_000_000, 1), kind) for kind in (1, 2, 4)] + [((60_000_000, 60_000_000), 5)]
    for dimensions, kind in promised:
        yield Hostile(f"MAT, {dimensions} of class {kind}", "log.mat", partial(mat_matrix, dimensions, array=kind))
    zeros = partial(lambda size: _mat_header() + _element(15, zlib.compress(_element(14, bytes(size)), 9)), 400_000_000)
    wide = partial(lambda size: _mat_of({"t": np.zeros(size, np.uint8)}, packed=True), 60_000_000)
    yield Hostile("MAT, 30 dimensions", "log.mat", partial(mat_matrix, [9] * 30))
    yield Hostile("MAT, bytes promised", "log.mat", partial(mat_matrix, (4, 1), promised=1_000_000_000))
    yield Hostile("MAT, packed zeros", "log.mat", zeros)
    yield Hostile("MAT, 60 million zeros packed", "log.mat", wide)
    whole = _mat_of({"t": np.arange(60.0), "Fx": np.arange(60.0), "Fz": np.ones(60)}, packed=False)
    for place, value in itertools.product((128, 136, 144, 145, 160, 168, 176), (0, 9, 200)):
        yield Hostile(f"MAT, byte {place} is {value}", "log.mat", partial(changed, whole, place, value), sound=True)


def _book(cell: tuple[int, int] | None = None, sheet: str = "", unit: str = "N") -> bytes:
    """A log as a workbook, with a cell far away in it or on a second sheet."""
    book = openpyxl.Workbook()
    for row in (("T [s]", f"Fx [{unit}]", "Fz [N]"), *ROWS):
        book.active.append(row)
    if cell:
        (book.create_sheet(sheet) if sheet else book.active).cell(*cell, 1.0)
    held = io.BytesIO()
    book.save(held)
    return held.getvalue()


def _sheet(inside: str, times: int = 1, top: str = "") -> bytes:
    """A workbook with another text in its sheet."""
    main = 'worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    xml = f'<?xml version="1.0"?>{top}<{main}>{inside * times}</worksheet>'
    held = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(_book())) as old, zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as new:
        for info in old.infolist():
            new.writestr(info.filename, xml if info.filename.endswith("sheet1.xml") else old.read(info))
    return held.getvalue()


def workbooks() -> Iterator[Hostile]:
    """Workbooks with little in them and much around it."""
    for cell, sheet in itertools.product(((1, 16384), (1_048_576, 1), (1_048_576, 16384)), ("", "notes")):
        yield Hostile(f"sheet, cell {cell} {sheet}", "log.xlsx", partial(_book, cell, sheet), sound=True)
    yield Hostile("sheet, unit", "log.xlsx", partial(_book, unit="N*9^9^9"))

    def rows(cells: Iterable[tuple[str, str, str]]) -> str:
        inside = "".join(f'<row r="{row}"><c r="{cell}"><v>{value}</v></c></row>' for row, cell, value in cells)
        return f"<sheetData>{inside}</sheetData>"

    entities = ((chr(98 + i), ("&" + chr(97 + i) + ";") * 10) for i in range(9))
    laughs = '<!DOCTYPE x [<!ENTITY a "ha">' + "".join(f'<!ENTITY {name} "{text}">' for name, text in entities) + "]>"
    sheets: Mapping[str, tuple[str, int, str]] = {
        "3000 far cells": (rows((f"{i}", f"XFD{i}", "1") for i in range(1, 3000)), 1, ""),
        "rows far apart": (rows((f"{i}", f"A{i}", "1") for i in range(300, 900_000, 300)), 1, ""),
        "entities": (rows([("1", "A1", "&j;")]), 1, laughs),
        "nested": ("<sheetData>", 100_000, ""),
        "100,000 digits": (rows([("1", "A1", "9" * 100_000)]), 1, ""),
        "row of 5000 digits": (rows([("9" * 5000, "A1", "1")]), 1, ""),
        "300 MB of blanks": (" ", 300_000_000, ""),
    }
    for what, given in sheets.items():
        yield Hostile(f"sheet, {what}", "log.xlsx", partial(_sheet, *given))


def _h5(fill: Callable[[h5py.File], object]) -> bytes:
    held = io.BytesIO()
    with h5py.File(held, "w") as file:
        fill(file)
    return held.getvalue()


def _steps(file: h5py.File, rows: int, chunks: tuple[int, ...] | None = None, unit: str = "N") -> None:
    """A log of ours in which so many rows are promised and none is written."""
    for name, of in (("time", "s"), ("normal_force", "N"), ("friction_force", unit)):
        data = file.create_dataset(f"run_1/step_1/{name}", shape=(rows,), dtype="f8", chunks=chunks)
        data.attrs["units"] = of
    file.attrs.update({"format": "stickslip-log", "format_version": 1})


def hdf5() -> Iterator[Hostile]:
    """HDF5 files that promise more than they hold."""
    fills: dict[str, Callable[[h5py.File], object]] = {
        f"{rows:g} rows {'promised' if chunks else 'never written'}": partial(_steps, rows=rows, chunks=chunks)
        for rows in (60_000_000, 10**10, 10**15)
        for chunks in ((1 << 16,), None)
    }
    fills["unit"] = partial(_steps, rows=8, unit="N*9^9^9")
    fills["2000 groups in each other"] = lambda file: file.create_group("/".join("g" * 2000))
    fills["20,000 groups"] = lambda file: [file.create_group(f"g{i}") for i in range(20_000)]
    for what, fill in fills.items():
        yield Hostile(f"HDF5, {what}", "log.h5", partial(_h5, fill))
    named = ["inspect", "{file}", "--columns", "time=/t,friction_force=/f,normal_force=/n"]
    shape = partial(h5py.File.create_dataset, name="t", shape=(10**9, 10**5), chunks=(1000, 1), dtype="f8")
    yield Hostile("HDF5, a matrix promised", "log.h5", partial(_h5, shape), named)


def scenes() -> Iterator[Hostile]:
    """Scenes with numbers beyond all measure; `fit` reads them before any log."""
    values = {
        "unit": '"0.2 kg*9^9^9"',
        "1e308": "1e308",
        "1e-308": "1e-308",
        "digits": "7" * 4000,
        "hexadecimal": "0x" + "f" * 40_000,
        "text of digits": f'"{"7" * 10_000} kg"',
        "binary": "0b" + "1" * 60_000,
    }
    lines = SCENE.splitlines()
    simulated = ("simulate", "--scene", "{file}", "--duration", "1", "--rate", "100", "--out", "{out}.csv")
    for (what, value), key in itertools.product(values.items(), ("mass", "stiffness", "damping", "drive_speed")):
        made = "\n".join(f"{key} = {value}" if line.startswith(key) else line for line in lines) + "\n"
        yield Hostile(f"scene, {key}, {what}", "scene.toml", made.encode, simulated, sound=what == "1e-308")
    extra = {
        "speed of 1e308 in a programme": 'drive_speed = [[0, "1e308 m/s"], [1, "0 m/s"]]',
        "many speeds": "drive_speed = [" + ",".join(f"[{i}, {1 + i % 2}e-4]" for i in range(20_000)) + "]",
        "unit in a programme": 'drive_speed = [[0, "1 mm/s*9^9^9"]]',
        "many brackets": "drive_speed = " + "[" * 20_000,
    }
    for what, line in extra.items():
        made = "\n".join(line if old.startswith("drive_speed") else old for old in lines) + "\n"
        yield Hostile(f"scene, {what}", "scene.toml", made.encode, simulated, sound=what == "many speeds")
    for what, table in {
        "start of 1e308": "[parameters]\na = { fixed = 1e308 }\n",
        "area to the power 1e308": "[contact]\narea_law = { coefficient = 1, exponent = 1e308 }\n",
        "unit of a parameter": '[parameters]\nD = { start = "40 um*9^9^9" }\n',
        "elongation of 1e308": "[initial]\nelongation = 1e308\n",
        "many keys": "[parameters]\n" + "".join(f"p{i} = 1\n" for i in range(20_000)),
        "long key": "[parameters]\n" + "p" * 500_000 + " = 1\n",
        "unit of quality": '[quality]\njitter = "1 %^9^9^9"\n',
    }.items():
        unused = "area" in what
        yield Hostile(f"scene, {what}", "scene.toml", (SCENE + table).encode, simulated, sound=unused)
    fitted = ("fit", "--scene", "{file}", "--out", "{out}")
    for what, log in {
        "a home of nobody": 'path = "~nobody_at_all/log.csv"',
        "a path of 10,000 characters": f'path = "{"a" * 10_000}"',
        "a zero byte in a path": 'path = "a\\u0000b"',
        "unit of a window": 'path = "log.csv"\nwindow = ["0 s", "1 s*9^9^9"]',
        "noise of 1e308": 'path = "log.csv"\nnoise = 1e308',
        "speed of 1e308": 'path = "log.csv"\ndrive_speed = 1e308',
        "mass of 1e308": 'path = "log.csv"\nmass = 1e308',
        "tare of 1e308": 'path = "log.csv"\ntare = 1e308',
        "window of 1e308": 'path = "log.csv"\nwindow = [-1e308, 1e308]\nskip_cycles = 9223372036854775807',
        "units with towers": 'path = "log.csv"\nunits = { friction_force = "N*9^9^9" }',
    }.items():
        beside = {"log.csv": GOOD}
        yield Hostile(f"scene, {what}", "scene.toml", f"{SCENE}[[logs]]\n{log}\n".encode, fitted, beside=beside)
    for command in ("stability", "amplitude"):
        for number, at in enumerate(
            ("drive_speed=1e308", "stiffness=1e308", "mass=1e-308", "normal_force=1 N*9^9^9"), 1
        ):
            asked = (command, "--scene", "{file}", "--at", at)
            yield Hostile(f"{command} --at, {number}", "scene.toml", SCENE.encode, asked)


def manifests() -> Iterator[Hostile]:
    """Manifests of a batch."""
    batch = ("batch", "{file}", "--scene", "{scene}", "--out", "{out}")
    log, many = "log.csv,g,0.2 mm/s", range(100_000)
    made: Mapping[str, tuple[str, str]] = {  # columns beyond path, group and speed; rows
        "100,000 rows": ("", "".join(f"log_{i}.csv,g{i},0.2 mm/s\n" for i in many)),
        "100,000 rows of one group": ("", "".join(f"log_{i}.csv,g,0.2 mm/s\n" for i in many)),
        "100,000 rows of one log": ("", f"{log}\n" * 100_000),
        "100,000 rows of one log, each its step": (",logs.step", "".join(f"{log},{i}\n" for i in many)),
        "100,000 rows without a unit": ("", "".join(f"log.csv,g{i},0.2\n" for i in many)),
        "100,000 columns": ("".join(f",c{i}" for i in many), log),
        "100,000 equal columns": (",c" * 100_000, log),
        "100,000 dotted columns": ("".join(f",rig.c{i}" for i in many), log),
        "100,000 cells in a row": ("", log + ",1" * 100_000),
        "a cell of 10 MB": ("", "log.csv," + "g" * 10_000_000 + ",0.2 mm/s"),
        "a column of 10 MB": ("," + "c" * 10_000_000, f"{log},1"),
        "a deep column": (",rig" + ".a" * 20_000, f"{log},1"),
        "400,000 blank lines": ("", "\n" * 400_000 + "nothing.csv,g,0.2 mm/s"),
        "an open quote": ("", 'log.csv,"g,0.2 mm/s\n' + "x,y,z\n" * 100_000),
        "unit in a cell": ("", f"{log}*9^9^9"),
        "unit of the mass": (",rig.mass", f"{log},0.2 kg^999999999"),
        "10,000 digits": ("", f"log.csv,g,{'7' * 10_000} mm/s"),
        "hexadecimal mass": (",rig.mass", f"{log},0x{'f' * 40_000}"),
        "speed of 1e308": ("", "log.csv,g,1e308 m/s"),
        "step of 10,000 digits": (",logs.step", f"{log},{'7' * 4000}"),
        "brackets in a cell": (",rig.mass", f"{log},{'[' * 10_000}"),
        "a home of nobody": ("", "~nobody_at_all/log.csv,g,0.2 mm/s"),
        "a path of 10,000 characters": ("", f"{'a' * 10_000}.csv,g,0.2 mm/s"),
        "a device": ("", "/dev/zero,g,0.2 mm/s"),
    }
    for what, (columns, rows) in made.items():
        words = f"path,group,drive_speed{columns}\n{rows}\n"
        sound = "columns" in what  # without a cell in them
        yield Hostile(f"manifest, {what}", "manifest.csv", words.encode, batch, sound, {"log.csv": GOOD})


def files() -> Iterator[Hostile]:
    """Paths that are no files, with the command that takes a log."""
    for path in ("/dev/zero", "/dev/tty", "/dev/stdin", "~nobody_at_all/log.csv", "a" * 5000, "*" * 300, "[" * 200):
        yield Hostile(f"path {path[:20]}", "comma.csv", lambda: GOOD, ("inspect", path))
    for name, pattern in (("any depth", "**/" * 300 + "x"), ("any depth, twelve times", "**/" * 12 + "no_such_*"),
                          ("a thousand folders", "*/" * 1000 + "x")):  # fmt: skip
        yield Hostile(f"{name}, as a pattern", "comma.csv", lambda: GOOD, ("inspect", pattern))


KINDS = (texts, patterns, packed, matlab, workbooks, hdf5, scenes, manifests, files)


def all_inputs() -> Iterator[Hostile]:
    """Every input."""
    return (hostile for kind in KINDS for hostile in kind())
