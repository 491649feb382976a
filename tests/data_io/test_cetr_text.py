"""CETR text: logs made here in its layout, with numbers of our own, are read as they were meant."""

import numpy as np
import pytest

from data_io import LogError, read_log

GRAM_FORCE = 9.80665e-3

PREAMBLE = """Created by CETR Data Viewer ver.2.19.106 05/12/22 14:43:46
Created by CETR UMT ver.1.136.257 12 May 2022 12:21:50
Total number of runs - 1
Total number of steps = 2
Indenter tip ID = 0
C:\\rig\\pair.tst
"""

ORDER = ("Fx", "Fz", "Z", "Y", "X", "V1", "T", "Ff", "COF")
UNITS = {"Fx": "g", "Fz": "g", "Z": "mm", "Y": "mm", "X": "mm", "V1": "mm/sec", "T": "sec", "Ff": "g", "COF": ""}


def step_text(number, n, *, started="12:21:58.029 12 May 2022", count=None, order=ORDER, load=-200.0, short=False):
    """One step: T restarts, first interval odd, Fx rises by 1 g per row."""
    time = np.r_[0.0, 0.0127 + 0.02 * np.arange(n - 1)] if n else np.array([])
    force = 10.0 * number + np.arange(n)
    columns = {"Fx": force, "Fz": np.full(n, load), "T": time, "Ff": force, "COF": np.abs(force / load)}
    rows = [",".join(f"{columns.get(name, np.zeros(n))[i]:.6f}" for name in order) for i in range(n)]
    units = [UNITS[name] for name in order]
    return "\n".join([
        f"Step No. {number}", "", "Step Type Code: 0", "Velocity     = 240", f"Set Force    = {load:g}",
        f"Data Count   = {n if count is None else count}", *([f"Started at: {started}"] if started else []), "",
        ",".join(order), ",".join(units[:-1] if short else units), "", *rows, "", "", "",
    ])  # fmt: skip


def run_text(number, *steps):
    return "\n".join(
        [f"Run # {number}", "Script file C:\\rig\\pair.cts", f"Run date {number} May 2022 12:21:50", *steps]
    )


def log(tmp_path, *parts, end="\r\n", name="log.txt"):
    path = tmp_path / name
    path.write_bytes("\n".join([PREAMBLE, *parts]).replace("\n", end).encode("cp1252"))
    return path


def codes(record):
    return {finding.code for finding in record.findings}


@pytest.mark.parametrize("end", ["\r\n", "\n", "\r"])
@pytest.mark.parametrize("short", [False, True])
def test_one_step_in_si(tmp_path, end, short):
    record = read_log(log(tmp_path, run_text(1, step_text(1, 50, short=short)), end=end))
    assert record.metadata["format"] == "cetr-text" and record.metadata["Script file"] == "C:\\rig\\pair.cts"
    np.testing.assert_allclose(record.time, np.r_[0.0, 0.0127 + 0.02 * np.arange(49)], atol=1e-12)
    np.testing.assert_allclose(record.friction_force, (10 + np.arange(50)) * GRAM_FORCE, rtol=1e-14)
    np.testing.assert_allclose(record.normal_force, 200 * GRAM_FORCE, rtol=1e-14)
    assert "normal_force_flipped" in codes(record) and record.drive_speed is None
    assert (
        record.channel_units["V1"] == "m/s" and record.channel_units["Z"] == "m" and record.channel_units["COF"] == ""
    )
    assert record.steps[0].parameters["Velocity"] == "240" and record.steps[0].parameters["Set Force"] == "-200"


def test_steps_are_joined_by_their_starting_times(tmp_path):
    path = log(tmp_path, run_text(1, step_text(1, 50), step_text(2, 30, started="12:22:08.529 12 May 2022")))
    record = read_log(path)
    assert [(s.number, s.start, s.stop) for s in record.steps] == [(1, 0, 50), (2, 50, 80)]
    assert record.time[50] == pytest.approx(10.5, abs=1e-9) and "step_gap_unknown" not in codes(record)
    second = read_log(path, step=2)
    np.testing.assert_allclose(second.friction_force, record.friction_force[50:], rtol=0)
    assert second.time[0] == 0 and second.steps[0].number == 2


def test_steps_meet_across_midnight_and_a_missing_start_is_said(tmp_path):
    late, early = "23:59:59.000 12 May 2022", "00:00:02.000 13 May 2022"
    record = read_log(log(tmp_path, run_text(1, step_text(1, 20, started=late), step_text(2, 20, started=early))))
    assert record.time[20] == pytest.approx(3.0, abs=1e-9)
    record = read_log(log(tmp_path, run_text(1, step_text(1, 20, started=None), step_text(2, 20, started=None))))
    assert record.time[20] == pytest.approx(record.time[19] + 0.02) and "step_gap_unknown" in codes(record)


def test_several_runs_must_be_chosen(tmp_path):
    path = log(tmp_path, run_text(1, step_text(1, 20)), run_text(2, step_text(1, 30), step_text(2, 10)))
    with pytest.raises(LogError, match=r"runs in the log: 1, 2.*--run"):
        read_log(path)
    assert len(read_log(path, run=1)) == 20
    second = read_log(path, run=2)
    assert len(second) == 40 and second.metadata["Run date"] == "2 May 2022 12:21:50"
    assert len(read_log(path, step=2)) == 10  # only one run has it
    with pytest.raises(LogError, match="step 7 was asked for"):
        read_log(path, run=1, step=7)
