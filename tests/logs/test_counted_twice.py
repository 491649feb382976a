"""No sample counts twice: a log listed twice is refused, and parts of one log that do not overlap are not."""

import shutil
import zipfile
from functools import cache

import numpy as np
import pytest

from data_io import Record, read_log, write_csv, write_hdf5
from identify.base.errors import FitError
from identify.effects import MAIN
from identify.logs.scene_records import SAME_NOISE, noise_agreement, with_records
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import run
from tests.logs.test_segment import drawn_pair

RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0, "drive_speed": 1e-3}
EFFECTS = ["inertia", "hysteresis_damping"]
SAMPLES = 1001


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A log of one second, copies of it in every manner, and one of another test."""
    path, time = tmp_path_factory.mktemp("logs"), 0.001 * np.arange(SAMPLES)
    for name, seed in (("slow.csv", 1), ("other.csv", 2)):
        force = 0.5 + np.random.default_rng(seed).normal(0.0, 0.01, time.size)
        write_csv(Record(time=time, normal_force=np.ones_like(time), friction_force=force), path / name)
    shutil.copy(path / "slow.csv", path / "copy.csv")
    write_hdf5(read_log(path / "slow.csv", window=(0.2, 0.5)), path / "cut.h5")
    with zipfile.ZipFile(path / "logs.zip", "w") as archive:
        archive.write(path / "slow.csv", "first.csv")
    return path


def read(folder, *logs):
    scene = Scene.from_document({"effects": EFFECTS, "rig": RIG, "logs": list(logs)}, folder)
    return with_records(scene, None)


@pytest.mark.parametrize(("other", "samples"), [
    ({"path": "copy.csv", "labels": {"material": "steel"}, "drive_speed": 2e-3, "flip_sign": True}, SAMPLES),
    ({"path": "logs.zip/first.csv"}, SAMPLES),
    ({"path": "slow.csv", "window": [0.5, 2.0]}, 501),
    ({"path": "cut.h5"}, 301),
])  # fmt: skip
def test_samples_of_two_logs_are_refused(folder, other, samples):
    name = other["path"].rpartition("/")[2]
    with pytest.raises(FitError, match=rf"log 2 \(slow.csv\) and log 3 \({name}\) hold the same {samples} samples"):
        read(folder, {"path": "other.csv"}, {"path": "slow.csv"}, other)


@pytest.mark.parametrize(("one", "other"), [
    ({"path": "slow.csv"}, {"path": "other.csv"}),
    ({"path": "slow.csv", "window": [0.0, 0.5]}, {"path": "copy.csv", "window": [0.5, 1.0]}),
    ({"path": "slow.csv", "exclude": [[0.4, 0.6]]}, {"path": "slow.csv", "window": [0.4, 0.6]}),
    ({"path": "slow.csv", "window": [0.6, 1.0]}, {"path": "cut.h5"}),
])  # fmt: skip
def test_parts_that_do_not_overlap_are_let_pass(folder, one, other):
    assert len(read(folder, one, other)[1]) == 2


@cache
def _pair(seed):
    """A simulated log of a pair drawn by lot, and a repeat of the same test: (n,) time [s] and forces [N]."""
    random = np.random.default_rng(seed)
    pair, speed = drawn_pair(random), float(np.exp(random.uniform(np.log(2e-4), np.log(3e-3))))
    time = np.arange(4000) / random.choice([500.0, 1000.0])
    force = run(assemble(MAIN), pair, speed, 1.0, float(time[-1])).sample(time)["force"]
    noise = random.choice([1e-3, 5e-3, 1e-2])
    return time, *(force + noise * random.standard_normal(time.size) for _ in range(2))


COPIES = {
    "rounded": lambda t, f: (t, np.round(f, 3)),
    "shifted": lambda t, f: (t + 100.0, f),
    "in millinewtons": lambda t, f: (t, 1e-3 * np.round(1e3 * f, 1)),
    "thinned to half": lambda t, f: (t[1::2], f[1::2]),
    "resampled by lines": lambda t, f: (grid := np.arange(0.3 * t[1], t[-1], 1.19 * t[1]), np.interp(grid, t, f)),
}


@pytest.mark.parametrize("kind", COPIES)
def test_a_measurement_that_was_exported_again_has_the_same_noise(kind):
    for seed in range(4):
        time, force, _ = _pair(seed)
        agree, _ = noise_agreement(time, force, *COPIES[kind](time, force))
        assert agree > 1.2 * SAME_NOISE, (kind, seed)


def test_a_repeat_of_a_test_has_not():
    agreement = [noise_agreement(time, one, time, other)[0] for time, one, other in map(_pair, range(15))]
    assert max(agreement) < 0.5 * SAME_NOISE


def test_an_exported_copy_is_refused_by_name_with_the_shift_of_its_clock(folder):
    log = read_log(folder / "slow.csv")
    rows = np.column_stack([log.time + 100.0, log.normal_force, log.friction_force])
    np.savetxt(folder / "again.csv", rows, "%.4f", ",", header="Time [s],Fz [N],Fx [N]", comments="")
    with pytest.raises(FitError, match=r"log 1 \(slow.csv\) and log 2 \(again.csv\) are one measurement.*100 s apart"):
        read(folder, {"path": "slow.csv"}, {"path": "again.csv"})
