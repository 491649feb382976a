"""Tables as people keep them and loggers write them: each is read as the plain file is, or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import openpyxl
import pytest

from data_io import LogError, read_log
from data_io.quality import assess

SIBLINGS = range(int(os.environ.get("SIBLINGS", "4")))
Column = Iterable[object]


def drawn(seed: int, rows: int = 600) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.random.Generator]:
    """Time [s] at a rate drawn by lot, friction and normal force [N], as many digits as a file holds."""
    random = np.random.default_rng(seed)
    time = np.arange(rows) / random.choice([100.0, 200.0, 500.0])
    force = random.uniform(0.3, 1.5) + 0.1 * random.random() * np.sin(7.0 * time) + 0.01 * random.standard_normal(rows)
    return time, np.round(force, 4), np.round(2.0 + 0.002 * random.standard_normal(rows), 4), random


def written(
    path: Path, stamps: Iterable[object], force: Iterable[object], load: Iterable[object], unit: str = "s"
) -> None:
    """A text of three columns; times are written with four decimals."""
    times = (f"{stamp:.4f}" if isinstance(stamp, float) else stamp for stamp in stamps)
    rows = "".join(f"{t},{f},{n}\n" for t, f, n in zip(times, force, load, strict=True))
    path.write_text(f"Time [{unit}],Fx [N],Fz [N]\n{rows}")


def check(path: Path, time: np.ndarray, force: np.ndarray, load: np.ndarray, atol: float = 1e-9) -> None:
    """The log holds these numbers."""
    record = read_log(path)
    np.testing.assert_allclose(record.time, time - time[0], atol=2e-6)
    np.testing.assert_allclose(record.friction_force, force, atol=atol)
    np.testing.assert_allclose(record.normal_force, load, atol=atol)


UNITS = {"N": 1.0, "mN": 1e3, "cN": 1e2, "kN": 1e-3}


def in_units(force: np.ndarray, random: np.random.Generator) -> list[tuple[str, str]]:
    """Each number in a unit drawn by lot, as a meter that changes its range writes it."""
    units = random.choice(list(UNITS), force.size) if random.random() < 0.5 else np.where(force < 1.0, "mN", "N")
    return [(f"{f * UNITS[unit]:.10g}", str(unit)) for f, unit in zip(force.tolist(), units, strict=True)]


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_column_of_units_tells_the_unit_of_each_row(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed, rows=3000)
    delimiter = random.choice([",", ";", "\t"])
    name = random.choice(["Unit", "Fx unit", "Einheit", "[]"])
    both = seed % 2
    heads = ["Time [s]", "Fx", name, *(("Fz", "Unit") if both else ("Fz [N]",))]
    lines = [delimiter.join(heads)]
    loads = in_units(load, random) if both else [(str(n),) for n in load.tolist()]
    forces = in_units(force, random)
    for t, f, n in zip(time.tolist(), forces, loads, strict=True):
        lines.append(delimiter.join((f"{t:.4f}", *f, *n)))
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    check(tmp_path / "log.csv", time, force, load)
    if len({unit for _, unit in forces}) > 1:
        with pytest.raises(LogError, match="leave the unit out"):
            read_log(tmp_path / "log.csv", units={"friction_force": "N"})


@pytest.mark.parametrize("seed", SIBLINGS)
def test_statistics_below_the_rows_are_no_rows(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed, rows=int(np.random.default_rng(seed).integers(100, 4000)))
    delimiter = random.choice([",", ";", "\t"])
    words = random.choice(["Mean", "Mittelwert", "Std. dev.", "Max", "σ", "average", "N", "Min:"], 3, replace=False)
    numbered = seed % 3 == 0
    rows = [f"{t:.4f},{f},{n}" for t, f, n in zip(time, force, load, strict=True)]
    lines = [("No,Time [s]," if numbered else "Time [s],") + "Fx [N],Fz [N]"]
    lines += [f"{i},{row}" for i, row in enumerate(rows, 1)] if numbered else rows
    lines += random.choice(["", "Statistics"], 1).tolist() if seed % 2 else []
    for word in words.tolist():
        values = [f"{random.uniform(0.0, 3.0):.4f}" for _ in range(3 if numbered else 2)]
        lines.append(",".join((word, *values)))
    text = "\n".join(line.replace(",", delimiter) for line in lines) + ("\n" if seed % 4 else "")
    (tmp_path / "log.csv").write_text(text)
    check(tmp_path / "log.csv", time, force, load)
    record = read_log(tmp_path / "log.csv")
    assert "footer" in record.metadata or any(f.code == "statistics_below" for f in record.findings)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_channel_with_blanks_between_its_values_is_paired_by_time(tmp_path: Path, seed: int) -> None:
    """The load in every so many-th row, or both forces by turns: between its samples it is a straight line."""
    time, force, load, random = drawn(seed, rows=2000)
    every, first = int(random.integers(2, 60)), int(random.integers(0, 2))
    turns = seed % 4 == 0
    every = 2 if turns else every
    loaded = np.arange(time.size) % every == first
    rubbed = ~loaded if turns else np.ones(time.size, dtype=bool)
    blank = random.choice(["", "NaN", "-"])
    lines = ["Time [s],Fx [N],Fz [N]"]
    for i, t in enumerate(time.tolist()):
        lines.append(f"{t:.4f},{force[i] if rubbed[i] else blank},{load[i] if loaded[i] else blank}")
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    known = time[loaded]
    rows = rubbed & (time >= known[0]) & (time <= known[-1])
    check(tmp_path / "log.csv", time[rows], force[rows], np.interp(time[rows], known, load[loaded]))


def test_a_slow_channel_that_stops_for_a_while_is_no_load(tmp_path: Path) -> None:
    time, force, load, _ = drawn(0, rows=2000)
    there = (np.arange(time.size) % 10 == 0) & ((time < time[700]) | (time > time[1300]))
    written(tmp_path / "log.csv", time, force, np.where(there, load.astype(str), ""))
    with pytest.raises(LogError, match="normal force has no number in rows"):
        read_log(tmp_path / "log.csv")


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_mark_for_no_value_is_none(tmp_path: Path, seed: int) -> None:
    time, *forces, random = drawn(seed, 1000)
    column, mark = seed % 2, random.choice([99.99, 999.9, 999.99, 9999.0, -9999.0, 99999.0, 32767.0, 65535.0])
    rows = np.unique(random.integers(20, 980, random.integers(1, 9))[:, None] + np.arange(random.integers(2, 20)))
    marked = [force.copy() for force in forces]
    marked[column][rows] = mark
    written(tmp_path / "log.csv", time, *marked)
    there = np.setdiff1d(np.arange(time.size), rows)
    record = read_log(tmp_path / "log.csv")
    check(tmp_path / "log.csv", time[there], *(force[there] for force in forces))
    assert any(f.code == "no_value_mark" and f"{rows.size} row(s)" in f.message for f in record.findings)
    assert all("disk" not in finding.message for finding in assess(record).findings)


def test_a_force_that_reaches_nine_hundred_and_ninety_nine_is_no_mark(tmp_path: Path) -> None:
    """Negative control: round and repeated, but not far from all others."""
    time, force, load, _ = drawn(0)
    force = np.clip(2000.0 * force, None, 999.0)
    written(tmp_path / "log.csv", time, force, load)
    check(tmp_path / "log.csv", time, force, load)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_an_offset_of_the_clock_may_change_within_a_log(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed)
    here, begin = int(random.integers(-11, 12)), 86400.0 * random.integers(0, 300) + random.uniform(0.0, 86400.0)
    offsets = np.where(time > time[random.integers(1, 599)], here + random.choice([-1, 1]), here).tolist()
    stamps = [
        f"{datetime(2023, 1, 1) + timedelta(seconds=begin + t + 3600.0 * offset):%Y-%m-%dT%H:%M:%S.%f}{offset:+03d}:00"
        for t, offset in zip(time.tolist(), offsets, strict=True)
    ]
    written(tmp_path / "log.csv", stamps, force, load)
    check(tmp_path / "log.csv", time, force, load)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_minutes_and_seconds_go_on_over_the_hour(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed)
    begin = 3600.0 - random.uniform(0.0, 5.0) if seed % 2 else np.round(random.uniform(0.0, 3590.0), 3)
    begin, width = np.round(begin, 3), random.choice([1, 2])
    stamps = [f"{int((begin + t) // 60) % 60:0{width}d}:{(begin + t) % 60:06.3f}" for t in time.tolist()]
    written(tmp_path / "log.csv", stamps, force, load)
    check(tmp_path / "log.csv", time, force, load)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_hours_and_minutes_are_told_by_the_name_of_their_column(tmp_path: Path, seed: int) -> None:
    _, force, load, random = drawn(seed, rows=90)
    begin, width, unit = random.integers(0, 1440), random.choice([1, 2]), random.choice(["h:mm", "hh:mm", "H:MM"])
    stamps = [f"{minute // 60 % 24:0{width}d}:{minute % 60:02d}" for minute in (begin + np.arange(90)).tolist()]
    written(tmp_path / "log.csv", stamps, force, load, unit)
    check(tmp_path / "log.csv", 60.0 * np.arange(90), force, load)
    written(tmp_path / "log.csv", [f"{i // 60}:{i % 60:02d}" for i in range(90)], force, load, "")
    check(tmp_path / "log.csv", np.arange(90), force, load)
    assert "unit_by_context" in {finding.code for finding in read_log(tmp_path / "log.csv").findings}


@pytest.mark.parametrize("seed", SIBLINGS)
def test_marks_between_thousands_are_no_delimiters(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed)
    mark, digits = random.choice(["\u202f", "\u00a0", "\u2009", "'", "\u2019"]), int(random.integers(1, 4))
    delimiter, point = (";", ",") if random.random() < 0.7 else ("\t", ".")
    rows = ""
    for row in zip(1e3 * time + 10.0 ** random.integers(3, 6), 1e3 * force, 1e3 * load, strict=True):
        rows += delimiter.join(f"{value:,.{digits}f}".replace(",", mark).replace(".", point) for value in row) + "\n"
    head = delimiter.join(("Time [ms]", "Fx [mN]", "Fz [mN]"))
    (tmp_path / "log.csv").write_text(f"{head}\n{rows}", encoding="utf-8")
    check(tmp_path / "log.csv", time, force, load, 1e-3)


FORMS = ("%d-%b-%Y %H:%M:%S.%f", "%d %B %Y %T.%f", "%b %d %Y %T.%f", "%b %d, %Y %I:%M:%S.%f %p", "%Y%m%dT%H%M%S.%f")


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_date_may_name_its_month_or_have_no_marks(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed)
    begin = datetime(2024, 2, 29, 23, 59, 58) + timedelta(seconds=int(random.integers(0, 10**8)))
    stamps = ((begin + timedelta(seconds=t)).strftime(FORMS[seed % len(FORMS)]) for t in time.tolist())
    written(tmp_path / "log.csv", (f'"{stamp}"' for stamp in stamps), force, load)
    check(tmp_path / "log.csv", time, force, load)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_header_may_say_what_one_count_is(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed)
    count, unit = random.choice([0.01, 0.1, 0.5, 2.0, 5.0, 10.0, 20.0]), random.choice(["s", "ms", "us"])
    one, word = count * {"s": 1.0, "ms": 1e-3, "us": 1e-6}[unit], f"{count:g} {unit}"
    written(tmp_path / "log.csv", (f"{t / one:.9g}" for t in time.tolist()), force, load, unit=word)
    for said in ({}, {"time": f"{1e3 * one:.9g} ms"}, {"time": f"{word}/{word}"}):
        np.testing.assert_allclose(read_log(tmp_path / "log.csv", units=said).time, time, atol=1e-8 * time[-1])


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_cell_shown_in_percent_holds_a_hundredth_of_it(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed, rows=200)
    shown = random.choice(["0%", "0.0%", "0.00%"] if seed % 2 else ["General", "0", "0.00"])
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Time [s]", random.choice(["COF [%]", "COF (%)", "Friction coefficient [%]"]), "Fz [N]"])
    for t, f, n in zip(time.tolist(), force.tolist(), load.tolist(), strict=True):
        sheet.append([t, (1.0 if seed % 2 else 100.0) * f / n, n])
        sheet.cell(sheet.max_row, 2).number_format = shown
    book.save(tmp_path / "log.xlsx")
    check(tmp_path / "log.xlsx", time, force, load)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_rows_may_have_names_that_the_header_leaves_out(tmp_path: Path, seed: int) -> None:
    """As R's write.table leaves them."""
    time, force, load, random = drawn(seed)
    mark, quote = random.choice(["\t", " ", ","]), random.choice(['"', ""])
    names = mark.join(f"{quote}{name}{quote}" for name in ("Time_s", "Fx_N", "Fz_N"))
    rows = (mark.join((f"{quote}{i}{quote}", *map(repr, row))) for i, row in enumerate(zip(
        time.tolist(), force.tolist(), load.tolist(), strict=True), 1))  # fmt: skip
    (tmp_path / "log.txt").write_text("\n".join([names, *rows]) + "\n")
    check(tmp_path / "log.txt", time, force, load)
