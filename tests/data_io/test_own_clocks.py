"""Channels that bring clocks of their own are put together by time, or refused by name; nothing is dropped silently."""

from pathlib import Path

import numpy as np
import openpyxl
import pytest

from data_io import LogError, read_log

CASES = Path(__file__).parents[1] / "cases"


def friction(t):
    return 0.5 + 0.1 * np.sin(3.0 * t)


def load(t):
    return 2.0 + 0.05 * t


def codes(record):
    return {finding.code for finding in record.findings}


@pytest.mark.parametrize("name", ["lvm_multi_x_rates.lvm", "lvm_start_differs.lvm"])
def test_the_peaks_of_labview_channels_of_other_rates_or_starts(name):
    """Static peaks of 0.6 at every load, by the way the files were made; row by row they are 0.507 and 0.575."""
    record = read_log(CASES / name)
    ratio = record.friction_force / record.normal_force
    peaks = ratio[: len(ratio) // 80 * 80].reshape(-1, 80).max(axis=1)  # a cycle takes 0.8 s
    assert peaks.size >= 9 and np.median(peaks) == pytest.approx(0.6, abs=2e-3)
    assert "own_clocks" in codes(record)


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
    assert {"own_clocks", "rows_without_partner"} <= codes(record)


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


def test_a_clock_that_restarts_in_every_block_tells_no_duration():
    path = CASES / "lvm_channel_measurement_clock_restarts.lvm"
    named = {"columns": {"friction_force": "Measurement"}, "units": {"friction_force": "N"}, "normal_force": 100.0}
    with pytest.raises(LogError, match=r"restarts 29 times in 60 rows.*--rate \"100 Hz\""):
        read_log(path, **named)
    record = read_log(path, **named, rate="100 Hz")
    assert record.time[-1] == pytest.approx(0.59) and record.friction_force[0] == 12.106261


@pytest.mark.parametrize("apart", [True, False])
def test_tables_side_by_side_are_runs(tmp_path, apart):
    with pytest.raises(LogError, match=r"runs 1 \(columns 1 to 3\), 2 \(columns 5 to 7\).*--run"):
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
