"""What fails elsewhere is called by its own name: files that are held open, loggers that are slow, dips in a track."""

import subprocess
import sys
import textwrap

import h5py
import numpy as np
import pytest

from data_io import LogError, Record, read_log
from data_io.quality import assess

WRITER = textwrap.dedent("""
    import os, sys, h5py, numpy as np
    file = h5py.File(sys.argv[1], "w", libver="latest")
    for name, unit in (("t", "s"), ("Fz", "N"), ("Fx", "N")):
        file[name] = np.arange(9.0) + 1
        file[name].attrs["units"] = unit
    file.flush()
    if sys.argv[2] == "swmr":
        file.swmr_mode = True
    print("ready", flush=True)
    if sys.argv[2] == "dies":
        os._exit(0)
    sys.stdin.read()
""")


@pytest.mark.parametrize("way", ["writes", "swmr", "dies"])
def test_file_that_is_open_for_writing_is_not_damaged(tmp_path, way):
    path = tmp_path / "log.h5"
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path), way], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert writer.stdout.readline() == "ready\n"
        if way == "dies":
            writer.wait(timeout=20)
        with pytest.raises(LogError, match=r"open for writing.*close it there") as refused:
            read_log(path)
        assert "damaged" not in str(refused.value) and "copy" not in str(refused.value)
    finally:
        writer.communicate(timeout=20)
    if way == "writes":  # once it is closed, it is read
        assert len(read_log(path)) == 9


def test_file_that_is_damaged_still_is(tmp_path):
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["t"] = np.arange(9.0)
    (tmp_path / "log.h5").write_bytes((tmp_path / "log.h5").read_bytes()[:700])
    with pytest.raises(LogError, match="damaged"):
        read_log(tmp_path / "log.h5")


@pytest.mark.parametrize(("stuck", "least", "most"), [(0.0, 0.0, 0.02), (0.2, 0.15, 0.22)])
def test_rows_of_a_coarse_grid_that_are_alike_by_chance_are_no_repeats(stuck, least, most):
    draw = np.random.default_rng(3)
    t = np.arange(5000) / 500.0
    force = np.round(0.5 + 0.02 * np.sin(20.0 * t) + draw.normal(0.0, 4e-3, t.size), 3)  # 7 % of neighbours are alike
    assert np.mean(np.diff(force) == 0.0) > 0.06
    for row in np.flatnonzero(draw.random(t.size - 1) < stuck):
        force[row + 1] = force[row]
    assert least <= assess(Record(t, np.full(t.size, 3.0), force)).figures["repeated_rows"][0] <= most
