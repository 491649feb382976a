"""HDF5 files that could do harm: links to elsewhere, numbers in other files, lies about size, damage that hangs."""

import resource
import threading

import h5py
import numpy as np
import pytest

from data_io import LogError, Record, hdf5, read_log, write_hdf5

NAMED = {"time": "/daq/t", "friction_force": "/daq/Fx", "normal_force": "/daq/Fz"}


def good(path, libver=None):
    """The layout of ours made by others."""
    with h5py.File(path, "w", libver=libver) as file:
        group = file.create_group("run_1/step_1")
        for name, unit in (("time", "s"), ("normal_force", "N"), ("friction_force", "N")):
            group.create_dataset(name, data=np.arange(1.0, 401.0), chunks=(16,)).attrs["units"] = unit
    return path


def linked(path, link):
    with h5py.File(path, "w") as file:
        for name, unit in (("t", "s"), ("Fz", "N")):
            file[f"daq/{name}"] = np.arange(1.0, 10.0)
            file[f"daq/{name}"].attrs["units"] = unit
        file["daq/Fx"] = link
    return path


def secret(path):
    with h5py.File(path, "w") as file:
        file["Fx"] = np.arange(9.0)
        file["Fx"].attrs["units"] = "N"
    return path


def test_a_link_into_another_file_is_not_followed(tmp_path):
    other = secret(tmp_path / "secret.h5")
    path = linked(tmp_path / "log.h5", h5py.ExternalLink(str(other), "/Fx"))
    with pytest.raises(LogError, match=r"link into another file .*not followed"):
        read_log(path, columns=NAMED)
    with pytest.raises(LogError, match="not in our layout"):
        read_log(path)  # what is linked is not even listed
    with h5py.File(path, "a") as file:  # the same numbers in the file itself are taken
        del file["daq/Fx"]
        file["daq/Fx"] = np.arange(9.0)
        file["daq/Fx"].attrs["units"] = "N"
    assert read_log(path, columns=NAMED).friction_force.tolist() == list(range(9))


def test_a_group_of_our_layout_that_lies_elsewhere_is_not_there(tmp_path):
    other = good(tmp_path / "other.h5")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["run_1"] = h5py.ExternalLink(str(other), "/run_1")
    with pytest.raises(LogError, match="not in our layout"):
        read_log(tmp_path / "log.h5")


def test_links_within_the_file_are_followed_and_rings_of_them_end(tmp_path):
    path = linked(tmp_path / "log.h5", h5py.SoftLink("/elsewhere/Fx"))
    with h5py.File(path, "a") as file:
        file["elsewhere/Fx"] = np.arange(9.0)
        file["elsewhere/Fx"].attrs["units"] = "N"
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
        with pytest.raises(LogError, match="hangs"):
            read_log(hanging(tmp_path))
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
    for place in random.integers(0, len(whole), 40):
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
    assert noticed > 8


def test_a_file_that_claims_more_than_fits_is_refused_before_memory_goes(tmp_path):
    path = tmp_path / "huge.h5"
    with h5py.File(path, "w") as file:
        for name, unit in (("time", "s"), ("normal_force", "N"), ("friction_force", "N")):
            data = file.create_dataset(f"run_1/step_1/{name}", (10**12,), "f8", chunks=(1 << 16,))
            data.attrs["units"] = unit
    assert path.stat().st_size < 100_000
    with pytest.raises(LogError, match=r"promises 8e\+06 MB and holds 0 MB; was it never written"):
        read_log(path)
