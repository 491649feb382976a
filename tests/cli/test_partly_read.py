"""A fit of a log that does not fit into memory: the window of its entry is read, and nothing else changes."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from data_io import LogTooLargeError, hdf5, read_log
from identify import Scene, fit
from identify.base.outcome import Status
from identify.examples import FOLDER
from identify.logs.scene_records import with_records
from identify.scene.values import LogEntry

BEGINS = 250.0  # of the clock in the file [s]
WINDOW = (0.9, 3.6)
HELD = {"D": 37.4e-6, "t_cr": 0.5, "delta_mu_k": -0.13, "a": 300.0}


@pytest.fixture
def scene(tmp_path):
    """One log of the example pair as HDF5, whose clock does not begin at zero."""
    whole = Scene.from_toml(FOLDER / "pair.toml")
    entry = next(log for log in whole.logs if log.path.name == "1_mm_per_s.txt.gz")
    record = read_log(entry.path)
    path = tmp_path / "long.h5"
    with h5py.File(path, "w") as file:
        for name, unit in (("time", "s"), ("normal_force", "N"), ("friction_force", "N")):
            data = file.create_dataset(f"run_1/step_1/{name}", data=getattr(record, name) + BEGINS * (name == "time"))
            data.attrs["units"] = unit
    logs = (LogEntry(path, drive_speed=entry.drive_speed, window=WINDOW, exclude=((2.0, 2.05),)),)
    # One log of a few cycles tells two coefficients; the others are held, or their profiles would take the time.
    held = {n: replace(whole.parameters[n], start=None, fixed=value) for n, value in HELD.items()}
    return replace(whole, logs=logs, parameters={**whole.parameters, **held})


def tight(monkeypatch, record_bytes):
    """Memory in which the window fits and the whole log does not."""
    monkeypatch.setattr(hdf5, "free_memory", lambda: int(2 * 0.8 * record_bytes))


@pytest.mark.slow
def test_the_window_gives_the_fit_of_the_whole(scene, monkeypatch):
    of_whole = fit(scene).result
    record = read_log(scene.logs[0].path)
    tight(monkeypatch, 24 * len(record))
    with pytest.raises(LogTooLargeError):
        read_log(scene.logs[0].path)
    of_part = fit(scene).result
    assert of_whole["status"] == of_part["status"] == Status.CONVERGED.value
    (log,) = of_part["logs"]
    assert any(finding["code"] == "read_in_part" for finding in log["quality"]["findings"]) and "part_of" not in log
    for name, estimate in of_whole["parameters"].items():
        other = of_part["parameters"][name]
        assert abs(other["value"] - estimate["value"]) <= 0.05 * (estimate["standard_error"] or np.inf), name


def test_the_window_alone_is_read_and_times_of_the_entry_are_moved(scene, monkeypatch):
    drive = ((0.0, 1e-3), (0.4, 2e-3), (2.0, 1e-3))
    entry = replace(scene.logs[0], drive_speed=drive, tare=(0.85, 0.95))
    whole = read_log(entry.path)
    tight(monkeypatch, 24 * len(whole))
    moved, (record,) = with_records(replace(scene, logs=(entry,)), None)
    (later,) = moved.logs
    begin = record.metadata["file_time_start"] - BEGINS
    assert record.time[0] == 0.0 and 0.85 <= begin < 0.852
    first = np.searchsorted(whole.time, begin - 1e-9)
    np.testing.assert_array_equal(record.friction_force, whole.friction_force[first : first + len(record)])
    assert later.window == pytest.approx((0.9 - begin, 3.6 - begin))
    assert later.tare == pytest.approx((0.85 - begin, 0.95 - begin))
    assert later.exclude == (pytest.approx((2.0 - begin, 2.05 - begin)),)
    assert np.array(later.drive_speed) == pytest.approx(np.array([(0.0, 2e-3), (2.0 - begin, 1e-3)]))
