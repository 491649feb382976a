"""HDF5: any file whose datasets are named, the project's layout made by others, and files that are neither."""

import h5py
import numpy as np
import pytest

from data_io import LogError, read_log
from data_io.record import BLOCK

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
        ({"t": ("s", [0, 1, 2, 3, 4, 3, 5, 6, 7])}, COLUMNS, "falls from"),
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


N = 4 * BLOCK + 1000  # columns are looked at block by block


def plain(path, time=None, force=None, units=("s", "N", "N"), userblock=0, **kind):
    """The layout of ours without chunks."""
    columns = (
        np.arange(N) / 1000.0 if time is None else time,
        np.ones(N),
        np.arange(N) % 7.0 if force is None else force,
    )
    with h5py.File(path, "w", userblock_size=userblock) as file:
        for name, values, unit in zip(("time", "normal_force", "friction_force"), columns, units, strict=True):
            file.create_dataset(f"run_1/step_1/{name}", data=values, **kind).attrs["units"] = unit
    return path


@pytest.mark.parametrize("userblock", [0, 512])
@pytest.mark.parametrize("kind", [{}, {"chunks": (5000,), "compression": "gzip"}, {"dtype": ">f8"}])
def test_numbers_in_one_piece_in_chunks_or_turned_round_are_the_same(tmp_path, userblock, kind):
    force = np.random.default_rng(1).standard_normal(N)
    told = []
    record = read_log(plain(tmp_path / "log.h5", force=force, userblock=userblock, **kind), progress=told.append)
    assert record.friction_force.tobytes() == force.tobytes() and record.time[-1] == (N - 1) / 1000.0
    assert told == sorted(told) and told[-1] == 1.0
    part = read_log(tmp_path / "log.h5", window=(131.0, 131.5))
    np.testing.assert_array_equal(part.friction_force, force[131_000:131_501])


@pytest.mark.parametrize("row", [5, BLOCK - 1, BLOCK, N - 1])
def test_what_is_wrong_anywhere_in_a_long_plain_dataset_is_seen(tmp_path, row):
    time, force = np.arange(N) / 1000.0, np.arange(N) % 7.0
    time[row] = time[row - 1] - 1.0
    with pytest.raises(LogError, match="falls from"):
        read_log(plain(tmp_path / "a.h5", time=time))
    for number in (np.nan, np.inf, -1e300, 2e9):
        force[row] = number
        record = read_log(plain(tmp_path / "b.h5", force=force))
        assert np.isnan(record.friction_force[row]) and "missing_rows" in {f.code for f in record.findings}
