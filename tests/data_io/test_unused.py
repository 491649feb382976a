"""The user's window and exclude come before every check: what is left unused may hold whatever it likes."""

from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pytest

from data_io import LogError, read_log
from identify.logs.prepare import prepare
from identify.logs.scene_records import parted, read_entry
from identify.logs.unknowns import from_scene
from identify.scene import Scene

CASES = Path(__file__).parents[1] / "cases"
NAN_BLOCK = CASES / "nan_block.csv"


def rows(text, n=400, start=0.0):
    """So many rows at 100 Hz, each as `text(row, time)` has it."""
    return [text(i, start + i / 100.0) for i in range(n)]


def words(folder):
    """A logger that writes a word in place of the force from 1 s to 2 s."""
    lines = rows(lambda i, t: f"{t:.2f};{'OVERLOAD' if 100 <= i < 200 else f'{0.5 + 1e-3 * i:.4f}'};3.0")
    (folder / "log.csv").write_text("Time [s];Fx [N];Fz [N]\n" + "\n".join(lines) + "\n")
    return folder / "log.csv"


def hdf5(folder):
    t = np.arange(400) / 100.0
    force = np.where((t >= 1.0) & (t < 2.0), np.nan, 0.5 + 0.1 * t)
    with h5py.File(folder / "log.h5", "w") as file:
        for name, values, unit in (("t", 7.0 + t, "s"), ("Fz", 0 * t + 3, "N"), ("Fx", force, "N")):
            file.create_dataset(name, data=values).attrs["units"] = unit
    return folder / "log.h5"


def clock_falls(folder):
    """A logger that was started again after 2 s, into the same file."""
    lines = rows(lambda i, t: f"{t if i < 200 else t - 2.0:.2f},{0.5 + 1e-3 * i:.4f},3.0")
    (folder / "log.csv").write_text("Time [s],Fx [N],Fz [N]\n" + "\n".join(lines) + "\n")
    return folder / "log.csv"


def clock_fails(folder):
    """A sheet whose time cells are empty from 1 s to 2 s."""
    book = openpyxl.Workbook()
    for cells in (
        ["T [s]", "Fx [N]", "Fz [N]"],
        *rows(lambda i, t: [t if not 100 <= i < 200 else None, 0.5 + 1e-3 * i, 3.0]),
    ):
        book.active.append(cells)
    book.save(folder / "log.xlsx")
    return folder / "log.xlsx"


@pytest.mark.parametrize("make", [words, hdf5, clock_fails])
def test_window_that_avoids_the_trouble_is_read_and_one_that_does_not_is_refused(tmp_path, make):
    path = make(tmp_path)
    for window, n, first in (((0.0, 0.955), 96, 0.0), ((2.495, 3.505), 101, 2.5)):
        record = read_log(path, window=window)
        assert (len(record), record.time[0]) == (n, 0.0)
        slope = 0.1
        np.testing.assert_allclose(record.friction_force, 0.5 + slope * (first + record.time), atol=1e-9)
    for window in (None, (0.5, 1.5), (0.0, 3.5)):
        with pytest.raises(LogError, match="at most 5"):
            read_log(path, window=window)


def test_clock_that_falls_is_cut_on_either_side(tmp_path):
    path = clock_falls(tmp_path)
    with pytest.raises(LogError, match=r"falls from 1\.99 s to 0 s"):
        read_log(path)
    with pytest.raises(LogError, match="falls"):
        read_log(path, window=(0.5, 2.5))
    before = read_log(path, window=(0.5, 1.5))
    np.testing.assert_allclose(before.friction_force, 0.55 + 0.1 * before.time, atol=1e-9)


@pytest.mark.parametrize("make", [words, hdf5])
def test_excluded_stretch_without_numbers_leaves_the_rest_where_it_was(tmp_path, make):
    record = read_log(make(tmp_path), exclude=[(0.9, 2.1)])
    inside = (record.time >= 0.9) & (record.time <= 2.1)
    t = record.time[~inside]
    assert t.size == 400 - 121 and record.time[-1] == pytest.approx(3.99)
    np.testing.assert_allclose(record.friction_force[~inside], 0.5 + 0.1 * t, atol=1e-9)
    assert inside.any(), "it is still seen that there was something"


@pytest.mark.parametrize("name", ["nan_window.toml", "nan_exclude.toml"])
def test_scene_that_cuts_the_block_out_is_prepared(name):
    scene = Scene.from_toml(CASES / name)
    record = read_entry(scene, 0)
    scene, records = parted(scene, [record])
    prepared = [prepare(scene, e, r, from_scene(scene)) for e, r in zip(scene.logs, records, strict=True)]
    assert all(log.left_out is None for log in prepared)
    assert not any(f.code == "dropouts" for log in prepared for f in log.judgement.findings)
    assert sum(len(log.segmentation.cycles.onset) for log in prepared) >= 3
    untouched = Scene.from_document({**dict(scene.as_document()), "logs": [{"path": str(NAN_BLOCK)}]}, CASES)
    with pytest.raises(LogError, match="has no number"):
        read_entry(untouched, 0)
