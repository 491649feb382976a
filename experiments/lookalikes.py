"""Files that look like those of real tribometers, with numbers of our own; what they hold is known as exact fractions.

Layouts follow what was found in real files and public parsers; every number here is made up. Each maker writes its
numbers as text first, and the truth is computed from that text, so that reading can be compared to the last digit.
"""

from __future__ import annotations

import io
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from typing import Any

import h5py
import nptdms
import numpy as np
import openpyxl
import pyarrow.parquet
import scipy.io

Columns = Mapping[str, np.ndarray]
UNITS = {"t": "s", "Fz": "N", "Fx": "N"}
GRAM = Fraction("0.00980665")  # [N] of one gram-force, by definition


@dataclass(frozen=True)
class Made:
    """A file and what it holds: time [s] from 0, normal and friction force [N], as exact fractions."""

    data: bytes
    time: tuple[Fraction, ...]
    normal: tuple[Fraction, ...]
    friction: tuple[Fraction, ...]

    def columns(self) -> dict[str, np.ndarray]:
        """The truth as the floats nearest to the fractions."""
        return {
            "time": np.array([float(value - self.time[0]) for value in self.time]),
            "normal_force": np.array([float(value) for value in self.normal]),
            "friction_force": np.array([float(value) for value in self.friction]),
        }


@dataclass(frozen=True)
class LookAlike:
    """One kind of file: the format's name, a file name, how it is made, what the user has to say to have it read."""

    form: str
    file_name: str
    make: Callable[[Sequence[Row]], Made]
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Row:
    """One row: time, normal and friction force as integers (0.1 ms, 1 uN, 1 uN), and four idle channels."""

    time: int
    normal: int
    friction: int
    idle: tuple[int, int, int, int]


def rows(count: int = 60, seed: int = 1) -> list[Row]:
    """A stick-slip-like signal, time from 0, with an odd first interval."""
    draw = random.Random(seed)
    made, force, time = [], draw.randrange(400_000, 600_000), 0
    for i in range(count):
        made.append(
            Row(time, draw.randrange(1_990_000, 2_010_000), force, tuple(draw.randrange(-999, 9999) for _ in range(4)))  # type: ignore[arg-type]
        )
        time += 127 if i == 0 else 200
        force = force + draw.randrange(9_000, 21_000) if force < 1_000_000 else draw.randrange(350_000, 450_000)
    return made


def number(value: int, digits: int, decimal: str = ".") -> str:
    """An integer as a decimal number with so many digits behind the mark."""
    sign, text = "-" if value < 0 else "", str(abs(value)).rjust(digits + 1, "0")
    return sign + (text if digits == 0 else f"{text[:-digits]}{decimal}{text[-digits:]}")


def _truth(data: bytes, table: Sequence[tuple[str, str, str]], units: tuple[Any, Any, Any]) -> Made:
    exact = [[Fraction(text.replace(",", ".")) * unit for text in column]
             for column, unit in zip(zip(*table, strict=True), units, strict=True)]  # fmt: skip
    exact[1] = [abs(load) for load in exact[1]]  # compression is positive in a record
    return Made(data, tuple(exact[0]), tuple(exact[1]), tuple(exact[2]))


def _umt(rows: Sequence[Row], order: Sequence[str], units: Mapping[str, str], top: str, load_sign: int) -> Made:
    """Two steps with parameters; the second starts 7.25 s after the first, its clock at 0 again."""
    half = len(rows) // 2
    text, table = top, []
    for step, part in enumerate((rows[:half], rows[half:]), start=1):
        start = f"12:21:{58.029 + 7.25 * (step - 1):06.3f} 12 May 2022" if step == 1 else "12:22:05.279 12 May 2022"
        text += (
            f"Step No. {step}\n\nStep Type Code: 0\nRadius       = 3.9493\nVelocity     = 240\nSet Force    = -200\n"
            f"Duration     = 2.17\nData Count   = {len(part)}\nStarted at: {start}\n\n"
            f"{','.join(order)}\n{','.join(units[name] for name in order)}\n\n"
        )
        for row in part:
            cells = {
                "Fx": number(row.friction * 100, 6), "Fz": number(load_sign * row.normal * 100, 6),
                "T": number(row.time - part[0].time, 4), "Z": number(row.idle[0], 4), "Y": number(row.idle[1], 6),
                "X": number(row.idle[2], 6), "V1": number(row.idle[3], 6), "V2": "0.000000", "V3": "0.000000",
            }  # fmt: skip
            cells["Ff"] = cells["Fx"].removeprefix("-")
            cells["COF"] = f"{abs(row.friction) / row.normal:.6f}"
            text += ",".join(cells[name] for name in order) + "\n"
            table.append((number(row.time - part[0].time + 72500 * (step - 1), 4), cells["Fz"], cells["Fx"]))
        text += "\n\n"
    force = GRAM if units["Fx"] == "g" else 1
    return _truth(text.replace("\n", "\r\n").encode("cp1252"), table, (1, force, force))


CETR_TOP = """Created by CETR Data Viewer ver.2.19.106 05/12/22 14:43:46
Created by CETR UMT ver.1.136.257 12 May 2022 12:21:50
Total number of runs - 1
Total number of steps = 2
Indenter tip ID = 0
C:\\Prüfstand\\Haut\\pair.tst

Run # 1
Script file C:\\Prüfstand\\Haut\\pair.cts
Run date 12 May 2022 12:21:50
"""
CETR_UNITS = {"Fx": "g", "Fz": "g", "Z": "mm", "Y": "mm", "X": "mm", "V1": "mm/sec", "V2": "mm/sec", "V3": "mm/sec",
              "T": "sec", "Ff": "g", "COF": ""}  # fmt: skip
BRUKER_TOP = "Bruker UMT TriboLab\x01 export\x02\nOperator - NN\n\nRun # 1\nRun date 12 May 2022 12:21:50\n"


ELEVEN = ("Fx", "Fz", "Z", "Y", "X", "V1", "V2", "V3", "T", "Ff", "COF")
cetr = partial(_umt, order=ELEVEN, units=CETR_UNITS, top=CETR_TOP, load_sign=-1)
cetr_reordered = partial(_umt, order=("COF", "T", "Fz", "X", "Fx", "Ff"), units=CETR_UNITS, top=CETR_TOP, load_sign=-1)
NEWTONS = CETR_UNITS | {"Fx": "N", "Fz": "N", "Ff": "N"}
bruker = partial(_umt, order=("T", "Fx", "Fz", "Ff", "COF"), units=NEWTONS, top=BRUKER_TOP, load_sign=1)


def rtec(rows: Sequence[Row]) -> Made:
    """Rtec MFT: CR within line 1, mixed line ends, trailing commas, Timestamp restarting with Step, footer."""
    half = len(rows) // 2
    head = (
        "Recipe, UpperSample, LowerSample, OtherInfo, Averaging, LogFrequency, Type, Radius\r"
        "Rotary_3N_pair,,,,100,1000,Rotary,1,\n"
        "Step, Timestamp, RecipeStep, DAQ.Fz (N),DAQ.Fx (N),DAQ.COF (),Rotary.Velocity (rpm),"
        "XYZ.X Position (mm),\r\n"
    )
    text, table = head, []
    for i, row in enumerate(rows):
        part = rows[:half] if i < half else rows[half:]
        time, fz, fx = number(row.time - part[0].time + 1510, 4), number(row.normal, 6), number(row.friction, 6)
        cof = f"{row.friction / row.normal:.6f}"
        step = 4 if i < half else 5
        text += f"{step},{time},{step},{fz},{fx},{cof},99.26,{number(row.idle[0], 3)},\n"
        table.append((time, fz, fx))
    last, interval = Fraction(table[half - 1][0]), Fraction(2, 100)
    made = _truth((text + "TotalTime\r\n00:12:56.5661021\r\n").encode(), table, (1, 1, 1))
    first = made.time[half]  # what the pause was, the file does not tell: one sampling interval
    time = [t if i < half else t - first + last + interval for i, t in enumerate(made.time)]
    return Made(made.data, tuple(time), made.normal, made.friction)


@dataclass(frozen=True)
class Table:
    """A text of one table: what stands above the rows, how a row is written from its number and the texts of time,
    normal and friction force, their digits behind the mark, units, mark and encoding; load: where the rows have none;
    step: of the clock [0.1 ms], where it is not in the rows."""

    head: str
    line: Callable[[Row, int, str, str, str], str]
    digits: tuple[int, int, int] = (4, 6, 6)
    units: tuple[Any, Any, Any] = (1, 1, 1)
    mark: str = "."
    encoding: str = "utf-8"
    load: str = ""
    step: int = 0

    def __call__(self, rows: Sequence[Row]) -> Made:
        """The rows in this form."""
        text, table = self.head, []
        for i, row in enumerate(rows):
            values = (self.step * i if self.step else row.time, row.normal, row.friction)
            t, fz, fx = (number(value, d, self.mark) for value, d in zip(values, self.digits, strict=True))
            text += self.line(row, i, t, fz, fx)
            table.append((t, self.load or fz, fx))
        return _truth(text.encode(self.encoding), table, self.units)


def _day(row: Row) -> str:
    """Date and time of the day from 23:59:59 on."""
    of_day = (863_990_000 + row.time) % 864_000_000
    hours, rest = divmod(of_day, 36_000_000)
    minutes, rest = divmod(rest, 600_000)
    date = "2026-01-15" if hours == 23 else "2026-01-16"
    return f"{date};{hours:02}:{minutes:02}:{rest // 10_000:02}.{rest % 10_000:04}"


def _logged(row: Row, i: int, fz: str, fx: str) -> str:
    seconds, rest = divmod(row.time, 10_000)
    return f"{i + 1},2026/01/15 10:{seconds // 60:02}:{seconds % 60:02},{number(rest, 1)},+{fx},+{fz},LLLL\n"


MILLI, KGF, VOLTS = Fraction(1, 1000), 1000 * GRAM, (1, Fraction(4), Fraction(5, 2))
LVM = (
    "LabVIEW Measurement\t\r\nWriter_Version\t2\r\nReader_Version\t2\r\nSeparator\tTab\r\nDecimal_Separator\t.\r\n"
    "Multi_Headings\tNo\r\nX_Columns\t{x}\r\nTime_Pref\tAbsolute\r\nDate\t2026/01/15\r\n***End_of_Header***\t\r\n\t\r\n"
    "Channels\t2\t\t\r\nX_Dimension\tTime\tTime\t\r\nX0\t0.0\t0.0\t\r\nDelta_X\t0.002\t0.002\t\r\n"
    "***End_of_Header***\t\t\t\r\nX_Value\tfx_N\tfz_N\tComment\r\n"
)
TABLES: Mapping[str, Table] = {
    "trb3": Table(  # Anton Paar TRB3: tabs, decimal comma, nominal load only, tabs at the ends of rows
        "Time [s]\tDistance [m]\tLaps\tNominal Load [N]\tµ\tAngle [°]\tFriction Force [N]\t\r\n",
        lambda r, _i, t, _z, x: f"{t}\t{number(abs(r.idle[0]), 5, ',')}\t1\t5,000\t{number(r.idle[1], 4, ',')}\t"
        f"12,5\t{x}\t\r\n",
        mark=",", encoding="utf-8-sig", load="5,000",
    ),
    "nano": Table(  # CSM Nano tribometer: tabs, millinewtons, points, cp1252
        "Sample: Prüfling 7\r\nTime [s]\tDistance [m]\tLaps\tNormal force [mN]\tFriction force [mN]\tµ [-]\r\n",
        lambda r, _i, t, z, x: f"{t}\t{number(abs(r.idle[0]), 5)}\t1\t{z}\t{x}\t{r.friction / r.normal:.4f}\r\n",
        (4, 3, 3), (1, MILLI, MILLI), encoding="cp1252",
    ),
    "bare tab": Table(  # a .csv separated by tabs with decimal commas, no units and no load
        "Time\tDistance\t Laps\t mu\tFrictionForce\n",
        lambda r, _i, t, _z, x: f"{t}\t{number(r.idle[0], 3, ',')}\t1\t0,31\t{x}\n", mark=",", load="2,5",
    ),
    "t11": Table(  # T11: semicolons, decimal comma, load and speed only in the file name
        "Time [s];Friction force [N];Temperature [°C]\r\n",
        lambda r, _i, t, _z, x: f"{t};{x};{number(abs(r.idle[0]), 2, ',')}\r\n", mark=",", encoding="cp1252", load="10",
    ),
    "micronewton": Table(
        "Time [s]\tNormal [uN]\tPosition [mm]\tFriction [uN]\n",
        lambda r, _i, t, z, x: f"{t}\t{z}\t{number(r.idle[0], 3)}\t{x}\n",
        (4, 0, 0), (1, Fraction(1, 10**6), Fraction(1, 10**6)),
    ),
    "volts": Table(  # NI export in volts with an interval instead of a time column
        "Channels,2\nInterval,0.0005\n\nFx (V),Fz (V)\n", lambda _r, _i, _t, z, x: f"{x},{z}\n", units=VOLTS, step=5,
    ),
    "mtm": Table(  # PCS MTM: empty columns, a name twice, degree signs in latin-1
        "Time (s),,Traction Force (N),Temp (°C),Temp (°C),,Load (N),,Friction (N),\r\n",
        lambda r, _i, t, z, x: f"{t},,0.1,{number(abs(r.idle[0]), 2)},,,{z},,{x},\r\n", encoding="latin-1",
    ),
    "semicolons": Table(  # spreadsheet text: semicolons, decimal comma, a units row, mixed line ends
        "Zeit;Reibkraft;Normalkraft;Weg\r\n[ms];[mN];[N];[mm]\n",
        lambda r, i, t, z, x: f"{t};{x};{z};{number(r.idle[0], 3, ',')}" + ("\r\n", "\n", "\r")[i % 3],
        (1, 6, 3), (MILLI, 1, MILLI), mark=",",
    ),
    "blanks": Table(
        "# T (min)   Fx (kgf)   Fz (kgf)\n", lambda _r, _i, t, z, x: f"  {t}   {x}   {z}\n", units=(60, KGF, KGF)
    ),
    "ni pairs": Table(  # NI channels beside each other, each with a head of pairs and a time of its own
        "Timestamp,2026-01-15 10:00:00,Timestamp,2026-01-15 10:00:00\nInterval,0.02,Interval,0.02\n"
        'Channel name,"Fx",Channel name,"Fz"\nUnit,"V",Unit,"V"\n',
        lambda _r, _i, t, z, x: f"{t},{x},{t},{z}\n", units=VOLTS, encoding="utf-8-sig",
    ),
    "day clock": Table("Date;Time;Fz [N];Fx [N]\n", lambda r, _i, _t, z, x: f"{_day(r)};{z};{x}\n"),
    "iso": Table(  # dates and times of the ISO in quotes
        "Timestamp,Normal force (N),Friction force (N),Humidity\n",
        lambda r, _i, _t, z, x: f'"2026-01-15T10:{r.time // 600_000:02}:{r.time % 600_000 // 10_000:02}.'
        f'{r.time % 10_000:04}Z",{z},{x},41.2\n',
    ),
    "quoted": Table(  # commas between the columns and in the numbers, which quotes protect
        "Time [s],Fz [N],Fx [N]\n", lambda _r, _i, t, z, x: f'"{t}","{z}","{x}"\n', mark=",",
    ),
    "cells": Table(  # every cell with its unit
        "Time\tNormal force\tFriction force\n", lambda _r, _i, t, z, x: f"{t} s\t{z} N\t{x} mN\n",
        (4, 6, 3), (1, 1, MILLI),
    ),
    "settings": Table(  # a line of settings between tabs above semicolons without a header
        "0.050\t0.001\t0.700\t10.000\n", lambda r, _i, t, z, x: f"{number(abs(r.idle[0]), 3)};{t};{x};{z}\n"
    ),
    "chinese": Table("时间(s),正压力(N),摩擦力(N)\n", lambda _r, _i, t, z, x: f"{t},{z},{x}\n", encoding="gb18030"),
    "stamped": Table(  # the monitor of a serial line: each line with the time at which it came
        "10:00:00.000 -> HX711 ready\n10:00:00.000 -> Fx_N,Fz_N\n",
        lambda r, _i, _t, z, x: f"10:{r.time // 600_000:02}:{number(r.time % 600_000, 4).rjust(7, '0')} -> {x},{z}\n",
    ),
    "lvm": Table(LVM.format(x="No"), lambda _r, _i, _t, z, x: f"\t{x}\t{z}\r\n", step=20),  # the clock from Delta_X
    "lvm comma": Table(  # the clock in X_Value, decimal comma
        LVM.format(x="One").replace(".", ","), lambda _r, _i, t, z, x: f"{t}\t{x}\t{z}\r\n", mark=",",
    ),
    "thousands": Table(  # Instron Bluehill: every number quoted, commas between thousands, forces in millinewtons
        '"Time","Load","Friction force"\n"(s)","(mN)","(mN)"\n',
        lambda _r, _i, t, z, x: ",".join(f'"{float(cell):,.4f}"' for cell in (t, z, x)) + "\n",
        (4, 3, 3), (1, MILLI, MILLI),
    ),
    "data logger": Table(  # Graphtec: settings in pairs, seconds and milliseconds apart, channels by number, alarms
        "Vendor,GRAPHTEC Corporation\nModel,GL980\nSampling interval,20ms\nCH,Signal name,Input,Range\n"
        "CH1,Friction,DC,1V\nCH2,Normal,DC,1V\nData\nNumber,Date&Time,ms,CH1,CH2,Alarm\nNO.,Time,ms,N,N,A1234\n",
        lambda r, i, _t, z, x: _logged(r, i, z, x),
    ),
}  # fmt: skip


def _comma(number: str) -> str:
    return number.replace(".", ",")


BLOCK = {"normal_force": 3, "columns": {"friction_force": "Force"}}
EXPORTS: Mapping[str, tuple[str, Callable[[str, str], str], Mapping[str, Any], str]] = {
    "MTS 793": (
        "MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\n\nData Acquisition\t\t\tTime:\t10.0\tSec\t3/29/2026 1:54:32 PM\n"
        "Running Time\tAxial Displacement\tAxial Force\tLateral Force\nSec\tmm\tN\tN",
        lambda t, f: f"{t}\t1.5\t3.0\t{f}", {}, "1,4,3",
    ),
    "Vernier Logger Pro": (
        "Vernier Format 2\nblock.cmbl 11/28/2026 09:37:43 .\nRun 1\nTime\tForce\tPosition\nt\tF\tx\ns\tN\tm",
        lambda t, f: f"{t}\t{f}\t0.01", {"normal_force": 3, "columns": {"friction_force": "F"}}, "1,2",
    ),
    "Vernier Graphical Analysis": (
        '"Latest: Time (s)","Latest: Force (N)","Latest: Position (m)"', lambda t, f: f"{t},{f},0.01",
        {"normal_force": 3, "columns": {"friction_force": "Latest: Force"}}, "1,2",
    ),
    "Arduino": (
        "Vernier Format 2\nReadings taken using Arduino\nData Set\nTime\tForce\nseconds\tnewtons",
        lambda t, f: f"{t}\t{f}", BLOCK, "1,2",
    ),
    "PASCO Capstone": (
        '"Time (s) Run #1","Force (N) Run #1","Position (m) Run #1"',
        lambda t, f: f"{t},{f},0.01", BLOCK, "1,2",
    ),
    "ZwickRoell testXpert": (
        '"Norm";"DIN EN ISO 8295"\n"Probe";"PE-Folie 3"\n"Schlitten";0,1019;"kg"\n"µS";0,62;""\n\n'
        '"Prüfzeit";"Standardweg";"Standardkraft"\n"s";"mm";"N"',
        lambda t, f: f"{_comma(t)};1,5;{_comma(f)}",
        {"normal_force": 3, "columns": {"friction_force": "Standardkraft"}}, "1,3",
    ),
    "Kistler DynoWare": (
        "DynoWare\nFile name:\tfr3.dwd\nTime:\t9:37:43 AM\nMeasuring time [s]:\t4\nSampling rate [Hz]:\t500\n"
        "Delay time [s]:\t0\n\nTime\tFx\tFy\tFz\n[s]\t[N]\t[N]\t[N]",
        lambda t, f: f"{t}\t{f}\t0.004\t-3.0", {}, "1,2,4",
    ),
    "Dewesoft": (
        "File name: fr3.dxd\nStart time: 28/11/2026 09:37:43.123\nSample rate: 500 Hz\n\nEvents\n"
        "Event Type\tEvent\tTime\tComment\n1\tstoring started at\t0\t\n2\tstoring stopped at\t4\t\n\n"
        "Data1\nTime (s)\tFx (N)\tFz (N)",
        lambda t, f: f"{t}\t{f}\t3.0", {}, "1,2,3",
    ),
    "catman": (
        "catman AP 5.4\tfr3\t28.11.2026 09:37:43\nKanalzahl: 3\nZeit  1 - Standardmessrate\tReibkraft\tNormalkraft\n"
        "s\tN\tN\nWertezahl: 120\tWertezahl: 120\tWertezahl: 120\nMessrate: 10 Hz\tMessrate: 10 Hz\tMessrate: 10 Hz\n",
        lambda t, f: f"{_comma(t)}\t{_comma(f)}\t3,0", {}, "1,2,3",
    ),
    "Anton Paar RheoCompass": (
        "Project:\tSkin\nTest:\tTribo 1\nInterval and data points:\t1\t120\nInterval data:\tPoint No.\tTime\t"
        "Sliding Velocity\tNormal Force\tFriction Force\tFriction Factor\tStatus\n\t\t[s]\t[mm/s]\t[N]\t[N]\t[1]\t\n",
        lambda t, f: f"\t1\t{t}\t1.000\t3.0\t{f}\t0.1\tDy_auto", {}, "3,6,5",
    ),
}  # fmt: skip
"""The form in which programmes of test machines, amplifiers and schools export: head, row, what has to be said, and the
numbers of time, friction force and normal force."""


def export(name: str, rows: Sequence[Row]) -> Made:
    """What a programme exports: 3 N of load in each row, or stated beside it."""
    head, row, _, _ = EXPORTS[name]
    cells = [(number(each.time, 4), "3.0", number(each.friction, 6)) for each in rows]
    text = head + "\n" + "".join(row(time, force) + "\n" for time, _, force in cells)
    return _truth(text.encode(), cells, (1, 1, 1))


def _binary(rows: Sequence[Row], write: Callable[[io.BytesIO, Columns], object]) -> Made:
    """A binary file of float64: what is written is exactly what it holds."""
    t, fz, fx = (
        np.array(c) for c in zip(*((r.time / 1e4, r.normal / 1e6, r.friction / 1e6) for r in rows), strict=True)
    )
    held = io.BytesIO()
    write(held, {"t": t, "Fz": fz, "Fx": fx})
    return Made(held.getvalue(), *(tuple(Fraction(float(v)) for v in column) for column in (t, fz, fx)))


def _hdf5(held: io.BytesIO, columns: Columns) -> None:
    """HDF5 of somebody else: chunked and compressed datasets with units, a name and a picture beside them."""
    with h5py.File(held, "w") as file:
        for name, values in columns.items():
            data = file.create_dataset(f"daq/{name}", data=values, chunks=True, compression="gzip")
            data.attrs["units"] = UNITS[name]
        file["notes"] = "held by nobody"
        file["camera"] = np.zeros((4, 4), np.uint8)


def _tdms(held: io.BytesIO, columns: Columns) -> None:
    """LabVIEW TDMS: channels with their units as properties, a group of words."""
    with nptdms.TdmsWriter(held) as writer:
        channels = [nptdms.ChannelObject("test", "Time" if name == "t" else name, values, {"unit_string": UNITS[name]})
                    for name, values in columns.items()]  # fmt: skip
        writer.write_segment([nptdms.RootObject({"operator": "NN"}), *channels])


def _parquet(held: io.BytesIO, columns: Columns) -> None:
    """Parquet: a unit in a name, one in the metadata of a column, a column of words."""
    fields = [pyarrow.field("Fz", pyarrow.float64(), metadata={"unit": "N"}), ("Time [s]", pyarrow.float64()),
              ("Fx [N]", pyarrow.float64()), ("remark", pyarrow.string())]  # fmt: skip
    arrays = [columns["Fz"], columns["t"], columns["Fx"], ["NN"] * columns["t"].size]
    pyarrow.parquet.write_table(pyarrow.table(arrays, pyarrow.schema(fields)), held)


def _matlab(held: io.BytesIO, columns: Columns) -> None:
    """MATLAB 5: a struct with column vectors, units as suffix."""
    log = {f"{name}_{UNITS[name]}": values[:, None] for name, values in columns.items()}
    scipy.io.savemat(held, {"log": log, "operator": "NN"})


def _excel(held: io.BytesIO, columns: Columns) -> None:
    """A workbook: a sheet of words, a sheet with names, units and numbers."""
    book = openpyxl.Workbook()
    book.active.append(["Prüfung", "vom Januar"])
    sheet = book.create_sheet("log")
    for cells in (["T", "Fz", "Fx"], ["s", "N", "N"], *zip(*(c.tolist() for c in columns.values()), strict=True)):
        sheet.append(list(cells))
    book.save(held)


SCALES = {"units": {"friction_force": "2.5 N/V", "normal_force": "4 N/V"}}
SAID: Mapping[str, Mapping[str, Any]] = {
    "bare tab": {"units": {"time": "s", "friction_force": "N"}, "normal_force": "2.5 N"},
    "t11": {"normal_force": 10.0},
    "volts": SCALES,
    "ni pairs": SCALES,
    "settings": {
        "columns": {"time": "2", "friction_force": "3", "normal_force": "4"},
        "units": {"time": "s", "friction_force": "N", "normal_force": "N"},
    },
    "data logger": {"columns": {"friction_force": "CH1", "normal_force": "CH2"}},
    "hdf5": {"columns": {"time": "/daq/t", "normal_force": "/daq/Fz", "friction_force": "/daq/Fx"}},
}
"""What the user has to say to have a file read."""
NAMES = {"t11": "T11_10N_0.1m-s.csv", "data logger": "240305-1.csv", "bare tab": "bare_tab.csv"}
"""Of files whose name says something, or is one that readers look at; others are called as their kind."""
FORMS = {"ni pairs": "ni-channels", "stamped": "stamped-lines"} | dict.fromkeys(("lvm", "lvm comma"), "labview-lvm")
BINARY = {"hdf5": _hdf5, "tdms": _tdms, "parquet": _parquet, "matlab": _matlab, "excel": _excel}
ENDS = {"hdf5": "h5", "tdms": "tdms", "parquet": "parquet", "matlab": "mat", "excel": "xlsx"}
ALL: Mapping[str, LookAlike] = {
    "cetr": LookAlike("cetr-text", "cetr.txt", cetr),
    "cetr reordered": LookAlike("cetr-text", "cetr_reordered.txt", cetr_reordered),
    "bruker": LookAlike("bruker-csv", "bruker.csv", bruker),
    "rtec": LookAlike("rtec-csv", "rtec.csv", rtec),
    **{
        name: LookAlike(FORMS.get(name, "delimited"), NAMES.get(name, f"{name}.txt"), table, SAID.get(name, {}))
        for name, table in TABLES.items()
    },
    **{
        name: LookAlike("delimited", f"export_{i}.txt", partial(export, name), told[2])
        for i, (name, told) in enumerate(EXPORTS.items())
    },
    **{
        name: LookAlike(name, f"pair.{ENDS[name]}", partial(_binary, write=write), SAID.get(name, {}))
        for name, write in BINARY.items()
    },
}
TEXTS = tuple(name for name in ALL if name not in BINARY)
