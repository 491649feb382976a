"""Times that a user writes count from the first row, whatever the clock of the file shows there."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from data_io import LogError, Record, Step, read_log, write_csv, write_hdf5

CASES = Path(__file__).parents[1] / "cases"
LATE = CASES / "starts_at_5.csv"


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


def test_a_window_outside_says_where_times_count_from(tmp_path):
    for name in late(tmp_path):
        with pytest.raises(LogError, match=r"runs from 0 to 3.99 s, counted from its first row, .* shows 5 s; move"):
            read_log(tmp_path / name, window=(5.0, 7.0))
        assert len(read_log(tmp_path / name, window=(3.0, 7.0))) == 100, "the remedy: inside"


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
