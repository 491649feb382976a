"""HDF5: named datasets, the project's layout by others, columns of matrices, and files that could do harm."""

import resource
import threading
from pathlib import Path

import h5py
import numpy as np
import pytest

from data_io import LogError, Record, hdf5, read_log, write_hdf5
from data_io.record import BLOCK

COLUMNS = {"time": "/daq/t", "friction_force": "/daq/Fx", "normal_force": "/daq/Fz"}


def stored(path, columns, mode="w", libver=None, userblock=0, **kind):
    """A file of another programme, of columns (unit, values) by path; those without values are left out."""
    with h5py.File(path, mode, libver=libver, userblock_size=userblock) as file:
        for name, (unit, values) in columns.items():
            if values is not None:
                data = file.create_dataset(name, data=values, **kind)
                data.attrs.update({"units": unit} if unit else {})
    return path


def foreign(tmp_path, **changes):
    """Its datasets in /daq; `changes` are some to replace."""
    data = {"t": ("ms", np.arange(9) * 10), "Fx": ("mN", np.arange(9.0)), "Fz": ("N", np.full(9, -2.0, np.float32))}
    return stored(tmp_path / "other.h5", {f"daq/{name}": column for name, column in {**data, **changes}.items()})


def test_named_datasets_in_si(tmp_path):
    record = read_log(foreign(tmp_path, pos=("mm", np.arange(9))), columns={**COLUMNS, "position": "/daq/pos"})
    np.testing.assert_allclose(record.time, np.arange(9) / 100, rtol=1e-15)
    np.testing.assert_allclose(record.friction_force, np.arange(9) / 1000, rtol=1e-15)
    assert record.normal_force[0] == 2.0 and record.channels["position"][1] == 1e-3
    assert "normal_force_flipped" in {finding.code for finding in record.findings}


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


N = 4 * BLOCK + 1000  # columns are looked at block by block


def plain(path, time=None, force=None, units=("s", "N", "N"), userblock=0, **kind):
    """The layout of ours without chunks."""
    columns = (
        np.arange(N) / 1000.0 if time is None else time,
        np.ones(N),
        np.arange(N) % 7.0 if force is None else force,
    )
    names = [f"run_1/step_1/{name}" for name in ("time", "normal_force", "friction_force")]
    return stored(path, dict(zip(names, zip(units, columns, strict=True), strict=True)), userblock=userblock, **kind)


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


@pytest.mark.parametrize("row", [BLOCK, N - 1])
def test_what_is_wrong_anywhere_in_a_long_plain_dataset_is_seen(tmp_path, row):
    time, force = np.arange(N) / 1000.0, np.arange(N) % 7.0
    time[row] = time[row - 1] - 1.0
    with pytest.raises(LogError, match="falls from"):
        read_log(plain(tmp_path / "a.h5", time=time))
    for number in (np.nan, np.inf, -1e300, 2e9):
        force[row] = number
        record = read_log(plain(tmp_path / "b.h5", force=force))
        assert np.isnan(record.friction_force[row]) and "missing_rows" in {f.code for f in record.findings}


CASES = Path(__file__).parents[1] / "cases"
TIME = np.arange(300) / 100.0
FORCE = 0.5 + 0.1 * (np.arange(300) % 40) / 40.0
LOAD = np.full(300, 2.0)
UNITS = {"time": "s", "normal_force": "N", "friction_force": "N"}


def right(record, rows=slice(None)):
    np.testing.assert_allclose(record.friction_force, FORCE[rows], rtol=1e-12)
    np.testing.assert_allclose(record.normal_force, 2.0, rtol=1e-12)
    np.testing.assert_allclose(record.time, TIME[rows] - TIME[rows][0], atol=1e-12)


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


NAMED = {"time": "/daq/t", "friction_force": "/daq/Fx", "normal_force": "/daq/Fz"}


def good(path, libver=None):
    """The layout of ours made by others."""
    columns = {f"run_1/step_1/{name}": (unit, np.arange(1.0, 401.0)) for name, unit in UNITS.items()}
    return stored(path, columns, libver=libver, chunks=(16,))


def linked(path, link):
    stored(path, {"daq/t": ("s", np.arange(1.0, 10.0)), "daq/Fz": ("N", np.arange(1.0, 10.0))})
    with h5py.File(path, "a") as file:
        file["daq/Fx"] = link
    return path


def secret(path):
    return stored(path, {"Fx": ("N", np.arange(9.0))})


def test_a_link_into_another_file_is_not_followed(tmp_path):
    other = secret(tmp_path / "secret.h5")
    path = linked(tmp_path / "log.h5", h5py.ExternalLink(str(other), "/Fx"))
    with pytest.raises(LogError, match=r"link into another file .*not followed"):
        read_log(path, columns=NAMED)
    with pytest.raises(LogError, match="not in our layout"):
        read_log(path)  # what is linked is not even listed
    with h5py.File(path, "a") as file:  # the same numbers in the file itself are taken
        del file["daq/Fx"]
    stored(path, {"daq/Fx": ("N", np.arange(9.0))}, "a")
    assert read_log(path, columns=NAMED).friction_force.tolist() == list(range(9))


def test_links_within_the_file_are_followed_and_rings_of_them_end(tmp_path):
    path = linked(tmp_path / "log.h5", h5py.SoftLink("/elsewhere/Fx"))
    stored(path, {"elsewhere/Fx": ("N", np.arange(9.0))}, "a")
    with h5py.File(path, "a") as file:
        file["daq/ring"] = h5py.SoftLink("/daq/ring")
    assert read_log(path, columns=NAMED).friction_force.tolist() == list(range(9))
    with pytest.raises(LogError, match="no dataset '/daq/ring'"):
        read_log(path, columns={**NAMED, "friction_force": "/daq/ring"})


@pytest.mark.parametrize("kind", ["virtual", "external storage"])
def test_numbers_that_lie_in_other_files_are_not_fetched(tmp_path, kind):
    other = secret(tmp_path / "secret.h5")
    path = linked(tmp_path / "log.h5", np.arange(9.0))
    with h5py.File(path, "a") as file:
        del file["daq/Fx"]
        if kind == "virtual":
            layout = h5py.VirtualLayout((9,), dtype="f8")
            layout[:] = h5py.VirtualSource(str(other), "Fx", (9,))
            file.create_virtual_dataset("daq/Fx", layout)
        else:
            (tmp_path / "raw.bin").write_bytes(np.arange(9.0).tobytes())
            file.create_dataset("daq/Fx", (9,), "f8", external=[(str(tmp_path / "raw.bin"), 0, 72)])
        file["daq/Fx"].attrs["units"] = "N"
    with pytest.raises(LogError, match="lie in other files"):
        read_log(path, columns=NAMED)


def hanging(tmp_path):
    """One byte of damage: an object of size 0 in the heap of texts sends the HDF5 library round for ever."""
    path = good(tmp_path / "log.h5", libver="earliest")
    data = bytearray(path.read_bytes())
    heap = data.index(b"GCOL") + 16
    second = heap + 24
    assert data[second + 8 : second + 16] == (1).to_bytes(8, "little")
    data[second + 8] = 0
    path.write_bytes(data)
    return path


def computed():
    """Seconds of computing by this process and those it started: what a busy machine does not stretch."""
    return sum(
        used.ru_utime + used.ru_stime
        for used in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def test_a_damaged_file_that_hangs_is_refused_in_time(tmp_path):
    path = hanging(tmp_path)
    began = computed()
    with pytest.raises(LogError, match=r"damaged .the library hangs on it"):
        read_log(path)
    assert computed() - began < 2.0
    assert len(read_log(good(tmp_path / "sound.h5", libver="earliest"))) == 400


def test_beside_other_threads_the_look_is_taken_by_a_new_interpreter(tmp_path, monkeypatch):
    monkeypatch.setattr(hdf5, "_forked", None)  # must not be asked
    done = threading.Event()
    thread = threading.Thread(target=done.wait)
    thread.start()
    try:
        assert len(read_log(good(tmp_path / "sound.h5", libver="earliest"))) == 400
    finally:
        done.set()
        thread.join()


def test_every_single_bit_of_an_archive_that_flips_is_noticed_or_harmless(tmp_path):
    """Checksums of structure and of numbers: a flipped bit is an error, or what is read is what was written."""
    random = np.random.default_rng(7)
    record = Record(np.arange(300) / 10, np.ones(300), random.standard_normal(300), 1e-3, {"Z": np.ones(300)})
    write_hdf5(record, tmp_path / "log.h5")
    whole = (tmp_path / "log.h5").read_bytes()
    noticed = 0
    for place in random.integers(0, len(whole), 20):
        data = bytearray(whole)
        data[place] ^= 1 << int(random.integers(0, 8))
        (tmp_path / "bad.h5").write_bytes(data)
        try:
            back = read_log(tmp_path / "bad.h5")
        except LogError:
            noticed += 1
            continue
        np.testing.assert_array_equal(back.friction_force, record.friction_force)
        np.testing.assert_array_equal(back.time, record.time)
        np.testing.assert_array_equal(back.normal_force, record.normal_force)
    assert noticed > 4


def test_a_file_that_claims_more_than_fits_is_refused_before_memory_goes(tmp_path):
    path = tmp_path / "huge.h5"
    with h5py.File(path, "w") as file:
        for name, unit in (("time", "s"), ("normal_force", "N"), ("friction_force", "N")):
            data = file.create_dataset(f"run_1/step_1/{name}", (10**12,), "f8", chunks=(1 << 16,))
            data.attrs["units"] = unit
    assert path.stat().st_size < 100_000
    with pytest.raises(LogError, match=r"promises 8e\+06 MB and holds 0 MB; was it never written"):
        read_log(path)
