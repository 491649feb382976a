"""Clocks as loggers leave them: rounded, restarting, with gaps, of their own for each channel; times from one zero."""

from __future__ import annotations

import os
import re
from datetime import datetime
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pytest

from data_io import LogError, Record, Step, read_log, write_csv, write_hdf5
from data_io.clock import evened
from data_io.quality import assess
from data_io.text import read_date
from identify.logs.classical import table_of
from identify.logs.regime import look
from tests.data_io.test_tables_as_people_keep_them import check, drawn, written

SIBLINGS = range(int(os.environ.get("SIBLINGS", "4")))


def saw_tooth(time: np.ndarray, period: float, random: np.random.Generator) -> np.ndarray:
    """Friction force [N] of even stick-slip between 0.4 and 1.2 N with 2 mN of noise."""
    phase = (time / period) % 1.0
    rise = np.where(phase < 0.95, 0.4 + 0.8 * phase / 0.95, 0.8 + 0.4 * np.cos(np.pi * (phase - 0.95) / 0.05))
    return rise + 0.002 * random.standard_normal(time.size)


def logged(time: np.ndarray, force: np.ndarray) -> Record:
    return Record(time - time[0], np.full(time.size, 2.0), force)


def codes(record: Record) -> dict[str, str]:
    return {finding.code: finding.message for finding in assess(record).findings}


@pytest.mark.parametrize("seed", SIBLINGS)
def test_packets_are_told_with_the_rate_of_their_rows(seed: int) -> None:
    random = np.random.default_rng(seed)
    rate, period = float(random.choice([100.0, 200.0, 500.0, 1000.0])), random.uniform(0.4, 1.0)
    even = np.arange(int(12.0 * rate)) / rate
    sizes = np.full(even.size, random.integers(10, 60)) if seed % 2 else random.integers(20, 50, even.size)
    ends = np.cumsum(sizes)
    packet = np.searchsorted(ends, np.arange(even.size), side="right")
    last = np.minimum(ends[packet], even.size) - 1
    first = last - sizes[packet] + 1
    late = 0.1 * random.random(packet[-1] + 1)[packet] / rate  # the loop reads them a little later
    stamps = even[last] + late + (np.arange(even.size) - first) * 0.05 / rate
    record = logged(stamps, saw_tooth(even, period, random))
    told = codes(record)
    assert "dropouts" not in told and "pauses" not in told
    stated = float(re.search(r'--rate "([\d.]+) Hz"', told["packets"])[1])
    assert stated == pytest.approx(rate, rel=0.02)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_pause_parts_a_log_and_no_row_is_lost(seed: int) -> None:
    random = np.random.default_rng(seed)
    rate, period = float(random.choice([100.0, 200.0, 500.0])), random.uniform(0.4, 1.0)
    time = np.arange(int(12.0 * rate)) / rate
    force = saw_tooth(time, period, random)
    count = int(random.integers(1, 4))
    for place in random.choice(np.arange(1, 6), count, replace=False) * time.size // 6:
        time[place:] += random.uniform(1.0, 300.0)
    record = logged(time, force)
    told = codes(record)
    assert f"pauses {count} time(s)" in told["pauses"] and "dropouts" not in told
    rows = table_of(record, look(record, None)).rows
    assert len(rows) == count + 1
    frequencies = [row["frequency_Hz"] for row in rows if row["cycles"] > 2]
    assert frequencies == pytest.approx([1.0 / period] * len(frequencies), rel=0.02)


@pytest.mark.parametrize("seed", SIBLINGS)
def test_rows_that_a_disk_lost_are_neither(seed: int) -> None:
    """Negative control: many gaps, and the force goes on without them."""
    random = np.random.default_rng(seed)
    even = np.arange(6000) / 500.0
    lost = np.zeros(even.size, dtype=bool)
    for place in random.choice(np.arange(1, 100), 40, replace=False) * 60:
        lost[place : place + random.integers(8, 50)] = True
    force = saw_tooth(even, random.uniform(0.3, 0.5), random)
    told = codes(logged(even[~lost], force[~lost]))
    assert "dropouts" in told and "pauses" not in told and "packets" not in told


def test_bursts_of_a_logger_are_no_packets() -> None:
    """Negative control: even bursts with true stamps, between which the force went on unseen."""
    random = np.random.default_rng(0)
    time = (np.arange(60)[:, None] * 0.731 + np.arange(40) / 1000.0).ravel()
    told = codes(logged(time, saw_tooth(time, 0.5, random)))
    assert "packets" not in told and "dropouts" in told


@pytest.mark.parametrize("seed", SIBLINGS)
def test_a_counter_that_begins_anew_goes_on(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed, rows=3000)
    bits, unit, per_second = [(16, "ms", 1e3), (32, "us", 1e6), (24, "us", 1e6), (32, "ms", 1e3)][seed % 4]
    counts = np.round(time * per_second).astype(np.int64)
    counts += 2**bits - int(random.integers(1, counts[-1]))  # it begins anew somewhere within
    written(tmp_path / "log.csv", (counts % 2**bits).tolist(), force, load, unit)
    check(tmp_path / "log.csv", time, force, load)
    scaled = [f"{count / per_second:.6f}" for count in (counts % 2**bits).tolist()]
    written(tmp_path / "scaled.csv", scaled, force, load)
    check(tmp_path / "scaled.csv", time, force, load)


@pytest.mark.parametrize("length", [5.0, 60.0, 64.0])
def test_a_clock_that_restarts_with_each_block_is_no_counter(tmp_path: Path, length: float) -> None:
    """Negative control: nobody knows the pause between the blocks."""
    _, force, load, _ = drawn(0, rows=6000)
    time = np.arange(6000) / 50.0 % length
    written(tmp_path / "log.csv", [f"{t:.3f}" for t in time.tolist()], force, load)
    with pytest.raises(LogError, match=r"restarts|falls"):
        read_log(tmp_path / "log.csv")


@pytest.mark.parametrize("seed", SIBLINGS)
def test_the_newest_row_may_stand_first(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed)
    begin = random.uniform(0.0, 1e4)
    written(tmp_path / "log.csv", [f"{begin + t:.4f}" for t in time[::-1].tolist()], force[::-1], load[::-1])
    check(tmp_path / "log.csv", time, force, load)
    assert "newest_first" in {finding.code for finding in read_log(tmp_path / "log.csv").findings}


@pytest.mark.parametrize("seed", SIBLINGS)
def test_rows_that_were_never_written_are_none(tmp_path: Path, seed: int) -> None:
    time, force, load, random = drawn(seed)
    count, begin = int(random.integers(2, 400)), random.uniform(0.01, 100.0)
    stamps, none = [f"{begin + t:.4f}" for t in time.tolist()], ["0"] * count
    blank = np.zeros(count)
    unused = random.choice([0, -1])
    if seed % 2:
        args = none + stamps, np.r_[blank, force], np.r_[blank, load]
    else:  # buffers that were not filled; the forces in them may be of before
        args = stamps + [str(unused)] * count, np.r_[force, force[:count]], np.r_[load, load[:count]]
    written(tmp_path / "log.csv", *args)
    check(tmp_path / "log.csv", time, force, load)


def test_a_log_may_begin_at_rest(tmp_path: Path) -> None:
    """Negative control: one row of zeros, and stamps of whole seconds that rows share."""
    time, force, load, _ = drawn(0)
    force[0] = load[0] = 0.0
    written(tmp_path / "log.csv", time, force, load)
    check(tmp_path / "log.csv", time, force, load)
    time = np.arange(3000) / 10.0
    _, force, load, _ = drawn(1, rows=3000)
    written(tmp_path / "whole.csv", [f"{np.floor(t):.0f}" for t in time.tolist()], force, load)
    assert len(read_log(tmp_path / "whole.csv")) == 3000


@pytest.mark.parametrize("seed", SIBLINGS)
def test_six_significant_digits_are_a_rounded_clock(tmp_path: Path, seed: int) -> None:
    random = np.random.default_rng(seed)
    rate = float(random.choice([50.0, 100.0, 200.0, 1000.0]))
    time = np.arange(int(12 * rate)) / rate
    _, force, load, _ = drawn(seed, rows=time.size)
    begin = float(random.choice([3.0, 95.0, 123.4, 995.0, 1234.5]))  # at some of them the digits change within
    written(tmp_path / "log.csv", [f"{begin + t:.6g}" for t in time.tolist()], force, load)
    record = read_log(tmp_path / "log.csv")
    assert len(record) == time.size
    np.testing.assert_allclose(record.time, time, atol=0.6 / rate if begin < 900 else 6e-3)
    assert np.median(np.diff(record.time)) == pytest.approx(1.0 / rate, rel=2e-3)


def test_a_header_may_hold_line_breaks_within_quotes(tmp_path: Path) -> None:
    time, force, load, _ = drawn(2)
    rows = "".join(f"{t:.4f},{f},{n}\n" for t, f, n in zip(time.tolist(), force, load, strict=True))
    heads = (
        '"Time\n[s]","Fx\n[N]","Fz\n[N]"\n',
        '"Time","Friction\r\nforce","Normal\r\nforce"\r\ns,N,N\r\n',
        'Disc of 5" and pin\nTime [s],"Friction force\nFx [N]",Fz [N]\n',
        'Operator,"A. Smith\nroom 4"\n"Elapsed\ntime\n(s)",Fx (N),"Load\n\n(N)"\n',
    )
    for number, head in enumerate(heads):
        (tmp_path / f"{number}.csv").write_text(head + rows, newline="")
        check(tmp_path / f"{number}.csv", time, force, load)


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("delimiter", [",", "\t", ";"])
def test_utf_16_without_its_mark_is_read(tmp_path: Path, encoding: str, delimiter: str) -> None:
    time, force, load, _ = drawn(3)
    rows = "".join(f"{t:.4f},{f},{n}\n" for t, f, n in zip(time.tolist(), force, load, strict=True))
    text = ("µ-Tribometer Nº 5\nTime [s],Fx [N],Fz [N]\n" + rows).replace(",", delimiter)
    (tmp_path / "log.csv").write_bytes(text.encode(encoding))
    check(tmp_path / "log.csv", time, force, load)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ('{"t": [0, 1], "Fx": [1, 2]}', "JSON"),
        ('[\n {"t": 0, "Fx": 1},\n {"t": 1, "Fx": 2}\n]', "JSON"),
        ("[[0, 1, 2],\n [1, 1, 2]]", "JSON"),
        ('{"t": 0, "Fx": 1}\n{"t": 1, "Fx": 2}\n', "JSON"),
        ('{"columns": ["t", "Fx", "Fz"],\n "data": [[\n  0.0,\n 1.0,\n 2.0\n], [1.0,\n 1.0,\n 2.0]]}', "JSON"),
        ('<?xml version="1.0"?>\n<usi:tdm version="1.0">\n</usi:tdm>', "TDM of National Instruments"),
        ('<?xml version="1.0"?>\n<Workbook>\n<Row><Cell>1</Cell></Row></Workbook>', "XML"),
        ("<!DOCTYPE html>\n<html><table><tr><td>1</td></tr></table></html>", "web page"),
        ('# my scene\neffects = ["inertia"]\n[rig]\nmass = "1 kg"\n[[logs]]\npath = "a.csv"\n', "scene"),
    ],
)
def test_what_is_no_log_is_called_by_its_format(tmp_path: Path, text: str, name: str) -> None:
    (tmp_path / "log.txt").write_text(text)
    for options in ({}, {"columns": {"time": "1", "friction_force": "2"}}):
        with pytest.raises(LogError, match=f"the file is .*{name}"):
            read_log(tmp_path / "log.txt", **options)


@pytest.mark.parametrize("rounding", [np.round, np.floor])
@pytest.mark.parametrize("rate", [800.0, 730.0, 999.0, 333.0])
def test_a_rounded_clock_is_even_again(rounding, rate) -> None:  # type: ignore[no-untyped-def]
    true = np.arange(3000) / rate
    time, (finding,) = evened(rounding(true * 1000.0) / 1000.0)
    assert np.ptp(time - true) < 4e-4, "but for a shift of the whole clock; the stamps are off by 1e-3"
    assert finding.code == "clock_rounded" and "rounded to 0.001 s" in finding.message


@pytest.mark.parametrize(("fault", "code"), [("repeated", "repeated_time"), ("lost", "dropouts")])
def test_one_row_lost_or_repeated_is_no_rounding(tmp_path, fault, code):
    """One odd interval among eighty fits a clock of 0.6 % another rate as well; it is said, and the rate stays."""
    rows = [f"{0.0127 + 0.02 * i:.4f},{0.5 + 0.01 * (i % 7):.4f},2.0" for i in range(83)]
    rows[40:41] = [rows[40], rows[40]] if fault == "repeated" else []
    path = tmp_path / "log.csv"
    path.write_text("T [s],Fx [N],Fz [N]\n" + "\n".join(rows) + "\n")
    record = read_log(path)
    findings = {finding.code for finding in (*record.findings, *assess(record).findings)}
    assert code in findings and "clock_rounded" not in findings
    assert np.diff(record.time).min() == pytest.approx(0.02) and np.isclose(np.diff(record.time), 0.02).sum() >= 80


@pytest.mark.parametrize("start", [20.0, 5000.0, 90000.0])
@pytest.mark.parametrize("rate", [2000.0, 4096.0, 1234.5])
def test_single_precision_is_even_again(start, rate):
    true = start + np.arange(8001) / rate
    time, findings = evened(true.astype(np.float32).astype(np.float64))
    step = float(np.spacing(np.float32(start)))
    if step < 0.1 / rate:
        assert not findings, "finer than matters"
        return
    assert np.ptp(time - true) < 0.1 / rate and findings[0].code == "clock_rounded"


@pytest.mark.parametrize("tick", [1 / 64, 1 / 60, 0.015625, 0.01, 1.0])
@pytest.mark.parametrize("ticks", [0.13, 0.7, 1.28, 2.5])
@pytest.mark.parametrize("decimals", [6, 9])
def test_ticks_of_a_timer_are_even_again(tick, ticks, decimals):
    """Windows timers tick 64 times, screens 60 times a second; a row gets the tick before it."""
    true = np.arange(2000) * ticks * tick
    stamps = np.round(np.floor(true / tick + 1e-9) * tick, decimals)
    time, findings = evened(stamps)
    assert np.ptp(time - true) < 0.5 * tick and [f.code for f in findings] == ["clock_rounded"]
    assert np.diff(time).min() > 0


def test_clocks_that_jitter_have_gaps_or_are_even_stay():
    random = np.random.default_rng(1)
    even = np.arange(3000) / 100.0
    for stamps in (
        even,
        even + random.uniform(-0.004, 0.004, 3000),
        np.sort(random.choice(even, 1500, replace=False)),
        np.delete(np.floor(even * 64) / 64, slice(1000, 1200)),
        np.concatenate([even[:100], even[100:200] + 5.0]),
        np.r_[0.0, np.delete(even, 2)[:74] + 0.006, even[74:79] + 0.006],  # begins late, a row lost, another twice
    ):
        same, findings = evened(stamps)
        assert same is stamps and findings == []


CASES = Path(__file__).parents[1] / "cases"


def friction(t):
    return 0.5 + 0.1 * np.sin(3.0 * t)


def load(t):
    return 2.0 + 0.05 * t


@pytest.mark.parametrize("name", ["lvm_multi_x_rates.lvm", "lvm_start_differs.lvm"])
def test_the_peaks_of_labview_channels_of_other_rates_or_starts(name):
    """Static peaks of 0.6 at every load, by the way the files were made; row by row they are 0.507 and 0.575."""
    record = read_log(CASES / name)
    ratio = record.friction_force / record.normal_force
    peaks = ratio[: len(ratio) // 80 * 80].reshape(-1, 80).max(axis=1)  # a cycle takes 0.8 s
    assert peaks.size >= 9 and np.median(peaks) == pytest.approx(0.6, abs=2e-3)
    assert "own_clocks" in {f.code for f in record.findings}


@pytest.mark.parametrize("names", [("Time [s]", "Time [s]"), ("Time [s]", "Time [s].1"), ("Time 1 (ms)", "Time 2 (s)")])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_other_formats_of_columns_in_pairs(tmp_path, names, delimiter):
    t, u = np.arange(400) * 0.02, 1.0 + np.arange(150) * 0.05  # the load is logged from 1 to 8.45 s
    scale = 1000.0 if "ms" in names[0] else 1.0
    rows = [delimiter.join((names[0], "Ff [N]", names[1], "Fn [N]"))]
    for i in range(400):
        late = (f"{u[i]:.4f}", f"{load(u[i]):.5f}") if i < 150 else ("", "")
        rows.append(delimiter.join((f"{scale * t[i]:.4f}", f"{friction(t[i]):.5f}", *late)))
    (tmp_path / "a.csv").write_text("\n".join(rows) + "\n")
    record = read_log(tmp_path / "a.csv")
    assert record.metadata["file_time_start"] == pytest.approx(1.0), "from where both are told"
    t = record.time + 1.0
    np.testing.assert_allclose(record.friction_force, friction(t), atol=1e-4)
    np.testing.assert_allclose(record.normal_force, load(t), atol=1e-4)
    assert {"own_clocks", "rows_without_partner"} <= {f.code for f in record.findings}


def test_labview_with_one_x_column_and_starts_past_midnight(tmp_path):
    """The load starts half a second after the friction, and a day later by its date."""
    head = (
        "LabVIEW "
        "Measurement\t\nX_Columns\tOne\nTime_Pref\tRelative\n***End_of_Header***\n\nChannels\t2\nSamples\t90\t90\n"
        "Date\t2024/12/31\t2025/01/01\nTime\t23:59:59.75\t00:00:00.25\nX_Dimension\tTime\tTime\nX0\t0\t0\n"
        "Delta_X\t0.1\t0.1\n***End_of_Header***\nX_Value\tFx_N\tFz_N\tComment\n"
    )
    rows = "".join(f"{i / 10:.1f}\t{friction(i / 10):.5f}\t{load(i / 10 + 0.5):.5f}\t\n" for i in range(90))
    (tmp_path / "a.lvm").write_text(head + rows)
    record = read_log(tmp_path / "a.lvm")
    assert len(record) == 85 and record.metadata["file_time_start"] == pytest.approx(0.5)
    np.testing.assert_allclose(record.normal_force, load(record.time + 0.5), atol=1e-4)


@pytest.mark.parametrize("apart", [True, False])
def test_tables_side_by_side_are_runs(tmp_path, apart):
    with pytest.raises(LogError, match=r"runs in the log: 1 \(columns 1 to 3\), 2 \(columns 5 to 7\).*--run"):
        read_log(CASES / "side_by_side.xlsx")
    one, two = (read_log(CASES / "side_by_side.xlsx", run=run) for run in (1, 2))
    assert np.median(one.normal_force) == pytest.approx(1.0, abs=0.01)
    assert np.median(two.normal_force) == pytest.approx(3.0, abs=0.01) and two.time[1] == pytest.approx(0.005)
    book = openpyxl.Workbook()
    blank = [None] if apart else []
    book.active.append(["Zeit [s]", "Reibkraft [N]", "Normalkraft [N]", *blank] * 3)
    for i in range(30):
        row = []
        for k in range(3):
            told = i < 30 - 10 * k
            row += [i * 0.1 * (k + 1) if told else None, i % 5 + 10.0 * k if told else None, 3.0 if told else None]
            row += blank
        book.active.append(row)
    book.save(tmp_path / "a.xlsx")
    lengths = [len(read_log(tmp_path / "a.xlsx", run=run)) for run in (1, 2, 3)]
    assert lengths == [30, 20, 10]
    assert read_log(tmp_path / "a.xlsx", run=3).friction_force[4] == 24.0


def late(folder, start=5.0, n=400, steps=()):
    """A record whose clock does not begin at 0, as text, as ours and as HDF5 of somebody else."""
    t = np.arange(n) / 100.0
    record = Record(t, np.ones(n), np.arange(n) * 1e-3, steps=steps, metadata={"file_time_start": start})
    rows = "".join(f"{start + x:.2f},1,{f:.3f}\n" for x, f in zip(t, record.friction_force, strict=True))
    (folder / "text.csv").write_text("Time [s],Fz [N],Fx [N]\n" + rows)
    write_csv(record, folder / "ours.csv")
    with h5py.File(folder / "daq.h5", "w") as file:
        for name, values, unit in (("t", start + t, "s"), ("Fz", record.normal_force, "N"),
                                   ("Fx", record.friction_force, "N")):  # fmt: skip
            file.create_dataset(name, data=values).attrs["units"] = unit
    return ("text.csv", "ours.csv", "daq.h5")


@pytest.mark.parametrize("start", [0.0, 5.0, -3.0, 3.79e9])
def test_a_window_is_the_same_rows_in_every_format(tmp_path, start):
    for name in late(tmp_path, start):
        part = read_log(tmp_path / name, window=(1.0, 2.0))
        np.testing.assert_allclose(part.friction_force, np.arange(100, 201) * 1e-3, err_msg=name)
        assert part.time[0] == 0.0 and part.metadata["window_start"] == pytest.approx(1.0, abs=1e-6), name


def test_a_run_of_steps_has_one_zero(tmp_path):
    steps = (Step(1, 1, 0, 150), Step(1, 2, 150, 400))
    t = np.arange(400) / 100.0
    record = Record(t, np.ones(400), np.arange(400) * 1e-3, steps=steps, metadata={"file_time_start": 7.0})
    write_hdf5(record, tmp_path / "a.h5")
    for window, first, last in (((1.0, 2.0), 100, 200), ((2.0, 3.0), 200, 300), ((0.5, 1.0), 50, 100)):
        part = read_log(tmp_path / "a.h5", window=window)
        np.testing.assert_allclose(part.friction_force, np.arange(first, last + 1) * 1e-3)
    alone = read_log(tmp_path / "a.h5", step=2, window=(0.5, 1.0))
    np.testing.assert_allclose(alone.friction_force, np.arange(200, 251) * 1e-3)


def test_steps_whose_clocks_restart_are_cut_on_the_joined_clock(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for number in (1, 2):
            group = file.create_group(f"run_1/step_{number}")
            for name, values, unit in (("time", np.arange(100) / 10, "s"), ("normal_force", np.ones(100), "N"),
                                       ("friction_force", np.arange(100.0) + 100 * number, "N")):  # fmt: skip
                group.create_dataset(name, data=values).attrs["units"] = unit
    part = read_log(tmp_path / "a.h5", window=(9.5, 10.4))
    assert part.friction_force.tolist() == [195, 196, 197, 198, 199, 200, 201, 202, 203, 204]


@pytest.mark.parametrize(("text", "expected"), [
    ("12:21:58.029 12 May 2022", datetime(2022, 5, 12, 12, 21, 58, 29_000)),
    ("05/12/22 14:43:46", datetime(2022, 5, 12, 14, 43, 46)),
    ("14:43:46,5 2022/05/12", datetime(2022, 5, 12, 14, 43, 46, 500_000)),
    ("Thu May 12, 2022 01:02:03 PM", datetime(2022, 5, 12, 13, 2, 3)),
    ("12.05.2022 10:00:00", datetime(2022, 5, 12, 10)),
    ("23:59:59", datetime(2000, 1, 1, 23, 59, 59)),
    ("25/25/2022 10:10:10", None), ("12 May 2022", None),
])  # fmt: skip
def test_the_date_in_a_head_is_read_in_every_order(text: str, expected: datetime | None) -> None:
    assert read_date(text) == expected
