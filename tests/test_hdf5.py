"""HDF5: any file whose datasets are named, the project's layout made by others, and files that are neither."""

import h5py
import numpy as np
import pytest

from data_io import LogError, read_log

COLUMNS = {"time": "/daq/t", "friction_force": "/daq/Fx", "normal_force": "/daq/Fz"}


def foreign(tmp_path, **changes):
    """A file of another programme; `changes` are datasets to replace (None: leave out)."""
    path = tmp_path / "other.h5"
    data = {"t": ("ms", np.arange(9) * 10), "Fx": ("mN", np.arange(9.0)), "Fz": ("N", np.full(9, -2.0, np.float32))}
    with h5py.File(path, "w") as file:
        for name, (unit, values) in {**data, **changes}.items():
            if values is None:
                continue
            file[f"daq/{name}"] = values
            if unit:
                file[f"daq/{name}"].attrs["units"] = unit
    return path


def test_named_datasets_in_si(tmp_path):
    record = read_log(foreign(tmp_path, pos=("mm", np.arange(9))), columns={**COLUMNS, "position": "/daq/pos"})
    np.testing.assert_allclose(record.time, np.arange(9) / 100, rtol=1e-15)
    np.testing.assert_allclose(record.friction_force, np.arange(9) / 1000, rtol=1e-15)
    assert record.normal_force[0] == 2.0 and record.channels["position"][1] == 1e-3
    assert "normal_force_flipped" in {finding.code for finding in record.findings}


def test_column_vectors_and_byte_order(tmp_path):
    path = foreign(tmp_path, t=("s", np.arange(9, dtype=">f4")[:, None]), Fx=("N", np.arange(9, dtype=">i2")[None]))
    assert read_log(path, columns=COLUMNS).friction_force.tolist() == list(range(9))


def test_units_and_load_from_the_user(tmp_path):
    path = foreign(tmp_path, t=(None, np.arange(9)), Fz=(None, None))
    record = read_log(
        path, columns={k: v for k, v in COLUMNS.items() if k != "normal_force"}, units={"time": "min"}, normal_force=5
    )
    assert record.time[1] == 60.0 and record.normal_force.tolist() == [5.0] * 9


@pytest.mark.parametrize(
    ("changes", "columns", "words"),
    [
        ({"Fx": (None, None), "x1": ("N", np.arange(9.0))}, None, r"/daq/t.*--columns"),
        ({}, {**COLUMNS, "time": "/daq/clock"}, r"no dataset '/daq/clock'.*/daq/t"),
        ({}, {**COLUMNS, "time": "/daq"}, "no dataset '/daq'"),
        ({}, {"time": "/daq/t", "normal_force": "/daq/Fz"}, "no friction force column"),
        ({"t": (None, np.arange(9))}, COLUMNS, "no unit.*--units time=s"),
        ({"t": ("s", np.arange(8))}, COLUMNS, "differ in length"),
        ({"t": ("s", np.zeros((9, 2)))}, COLUMNS, "column of numbers"),
        ({"t": ("s", 3.0)}, COLUMNS, "column of numbers"),
        ({"Fx": ("N", np.array([b"a"] * 9))}, COLUMNS, "column of numbers"),
        ({"t": ("s", np.arange(9)[::-1])}, COLUMNS, "falls from"),
        ({"t": ("s", np.arange(1)), "Fx": ("N", np.ones(1)), "Fz": ("N", np.ones(1))}, COLUMNS, "1 row"),
        ({"t": ("s", np.arange(0)), "Fx": ("N", np.ones(0)), "Fz": ("N", np.ones(0))}, COLUMNS, "no rows"),
    ],
)
def test_what_is_missing_is_named(tmp_path, changes, columns, words):
    with pytest.raises(LogError, match=words):
        read_log(foreign(tmp_path, **changes), columns=columns)


def test_the_layout_written_by_others(tmp_path):
    path = tmp_path / "rig.h5"
    with h5py.File(path, "w") as file:
        for step, start in ((1, 0.0), (2, 100.0), (10, 200.0)):
            group = file.create_group(f"run_1/step_{step}")
            group.attrs.update({"speed": "1 mm/s", "cycles": 3})
            columns = {"time": start + np.arange(5), "normal_force": np.ones(5), "friction_force": np.arange(5.0)}
            units = {"time": "s", "normal_force": "N", "friction_force": "mN", "position": "mm"}
            for name, values in {**columns, "position": np.arange(5.0)}.items():
                group[name] = values
                group[name].attrs["units"] = units[name]
    record = read_log(path)
    assert [step.number for step in record.steps] == [1, 2, 10] and record.time[5] == 100.0
    assert dict(record.steps[0].parameters) == {"speed": "1 mm/s", "cycles": "3"}
    assert record.channels["position"][1] == 1e-3 and record.friction_force[1] == 1e-3
    assert read_log(path, step=10).metadata["file_time_start"] == 200.0


@pytest.mark.parametrize("size", [9, 100, 1000, 2000])
def test_a_cut_file_is_named_damaged(tmp_path, size):
    whole = foreign(tmp_path).read_bytes()
    path = tmp_path / "cut.h5"
    path.write_bytes(whole[:size])
    with pytest.raises(LogError, match="damaged"):
        read_log(path, columns=COLUMNS)
