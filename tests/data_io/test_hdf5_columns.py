"""HDF5 files whose columns lie within one dataset: matrices by number or by name, compounds by field."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from data_io import LogError, read_log

CASES = Path(__file__).parents[1] / "cases"
TIME = np.arange(300) / 100.0
FORCE = 0.5 + 0.1 * (np.arange(300) % 40) / 40.0
LOAD = np.full(300, 2.0)
UNITS = {"time": "s", "normal_force": "N", "friction_force": "N"}


def right(record, rows=slice(None)):
    np.testing.assert_allclose(record.friction_force, FORCE[rows], rtol=1e-12)
    np.testing.assert_allclose(record.normal_force, 2.0, rtol=1e-12)
    np.testing.assert_allclose(record.time, TIME[rows] - TIME[rows][0], atol=1e-12)


def test_the_case_of_a_matrix():
    named = {"time": "/data:1", "normal_force": "/data:2", "friction_force": "/data:3"}
    record = read_log(CASES / "matrix.h5", columns=named, units=UNITS)
    assert len(record) == 800 and record.friction_force[1] == 0.3539 and record.normal_force[1] == 0.9997
    by_name = read_log(CASES / "matrix.h5", units=UNITS)
    np.testing.assert_array_equal(by_name.friction_force, record.friction_force)
    part = read_log(CASES / "matrix.h5", columns=named, units=UNITS, window=(1.0, 2.0))
    np.testing.assert_array_equal(part.friction_force, record.friction_force[100:201])


@pytest.mark.parametrize("lying", [False, True])
@pytest.mark.parametrize("kind", [{}, {"chunks": True, "compression": "gzip"}])
def test_matrices_upright_and_lying(tmp_path, lying, kind):
    matrix = np.column_stack([TIME * 1000.0, FORCE, LOAD])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("test/daq", data=matrix.T if lying else matrix, **kind)
    named = {"time": "/test/daq:1", "friction_force": "/test/daq:2", "normal_force": "/test/daq:3"}
    right(read_log(tmp_path / "a.h5", columns=named, units={**UNITS, "time": "ms"}))
    with pytest.raises(LogError, match="/test/daq:1, /test/daq:2, /test/daq:3"):
        read_log(tmp_path / "a.h5", columns={**named, "time": "/test/daq:4"}, units=UNITS)


def test_names_and_units_of_a_matrix(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_dataset("daq", data=np.column_stack([TIME, FORCE * 1e3, LOAD, TIME]))
        data.attrs["labels"] = "Zeit, Reibkraft, Normalkraft, Weg"
        data.attrs["units"] = ["s", "mN", "N", "mm"]
        file["picture"] = np.zeros((64, 64), np.uint8)
        file["spectrum"] = np.zeros((900, 700))
    record = read_log(tmp_path / "a.h5")
    right(record)
    np.testing.assert_allclose(record.channels["Weg"], TIME * 1e-3)


@pytest.mark.parametrize("named", [False, True])
def test_a_compound(tmp_path, named):
    table = np.zeros(300, dtype=[("t", "<f8"), ("Fx", "<f4"), ("Fz", "<i4"), ("note", "S4")])
    table["t"], table["Fx"], table["Fz"] = TIME, FORCE, LOAD
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run/log"] = table
    columns = {"time": "/run/log:t", "friction_force": "/run/log/Fx", "normal_force": "/run/log:Fz"} if named else None
    record = read_log(tmp_path / "a.h5", columns=columns, units=UNITS)
    np.testing.assert_allclose(record.friction_force, FORCE, rtol=1e-6)
    assert record.normal_force[0] == 2.0 and len(record) == 300
