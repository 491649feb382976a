"""No sample counts twice: a log listed twice is refused, and parts of one log that do not overlap are not."""

import shutil
import zipfile

import numpy as np
import pytest

from data_io import Record, read_log, write_csv, write_hdf5
from identify.base.errors import FitError
from identify.logs.scene_records import with_records
from identify.scene import Scene

RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0, "drive_speed": 1e-3}
EFFECTS = ["inertia", "hysteresis_damping"]
SAMPLES = 1001


@pytest.fixture
def folder(tmp_path):
    """A log of one second, copies of it in every manner, and one of another test."""
    time = 0.001 * np.arange(SAMPLES)
    for name, seed in (("slow.csv", 1), ("other.csv", 2)):
        force = 0.5 + np.random.default_rng(seed).normal(0.0, 0.01, time.size)
        write_csv(Record(time=time, normal_force=np.ones_like(time), friction_force=force), tmp_path / name)
    shutil.copy(tmp_path / "slow.csv", tmp_path / "copy.csv")
    write_hdf5(read_log(tmp_path / "slow.csv"), tmp_path / "slow.h5")
    write_hdf5(read_log(tmp_path / "slow.csv", window=(0.2, 0.5)), tmp_path / "cut.h5")
    with zipfile.ZipFile(tmp_path / "logs.zip", "w") as archive:
        archive.write(tmp_path / "slow.csv", "first.csv")
    return tmp_path


def read(folder, *logs):
    scene = Scene.from_document({"effects": EFFECTS, "rig": RIG, "logs": list(logs)}, folder)
    return with_records(scene, None)


@pytest.mark.parametrize(
    ("other", "samples"),
    [
        ({"path": "slow.csv"}, SAMPLES),
        ({"path": "copy.csv"}, SAMPLES),
        ({"path": "slow.h5"}, SAMPLES),
        ({"path": "logs.zip/first.csv"}, SAMPLES),
        ({"path": "slow.csv", "labels": {"material": "steel"}, "drive_speed": 2e-3, "flip_sign": True}, SAMPLES),
        ({"path": "slow.csv", "window": [0.5, 2.0]}, 501),
        ({"path": "cut.h5"}, 301),
    ],
)
def test_samples_of_two_logs_are_refused(folder, other, samples):
    with pytest.raises(FitError) as refused:
        read(folder, {"path": "other.csv"}, {"path": "slow.csv"}, other)
    name = other["path"].rpartition("/")[2]
    assert f"log 2 (slow.csv) and log 3 ({name}) hold the same {samples} samples" in str(refused.value)
    assert "remove one of the two logs" in str(refused.value)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"path": "slow.csv"}, {"path": "other.csv"}),
        ({"path": "slow.csv", "window": [0.0, 0.4]}, {"path": "slow.csv", "window": [0.6, 1.0]}),
        ({"path": "slow.csv", "window": [0.0, 0.5]}, {"path": "copy.csv", "window": [0.5, 1.0]}),
        ({"path": "slow.csv", "exclude": [[0.4, 0.6]]}, {"path": "slow.csv", "window": [0.4, 0.6]}),
        ({"path": "slow.csv", "window": [0.6, 1.0]}, {"path": "cut.h5"}),
    ],
)
def test_parts_that_do_not_overlap_are_let_pass(folder, one, other):
    assert len(read(folder, one, other)[1]) == 2


def test_records_that_are_given_are_looked_at_as_well(folder):
    scene = Scene.from_document({"effects": EFFECTS, "rig": RIG, "logs": [{"path": "a"}, {"path": "b"}]}, folder)
    record = read_log(folder / "slow.csv")
    with pytest.raises(FitError, match=r"log 1 \(a\) and log 2 \(b\)"):
        with_records(scene, [record, record])
    assert len(with_records(scene, [record, read_log(folder / "other.csv")])[1]) == 2
