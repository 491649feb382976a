"""Sizes and scales are checked where a value enters: a record, a scene, --at."""

import os

import numpy as np
import pytest

from data_io import LogError, Record, read_log
from identify.base.errors import SceneError
from identify.cli.points import at_values
from identify.effects import MAIN
from identify.scene import Scene

RIG = {"mass": 0.2, "stiffness": 1470.0, "damping": 147.0, "normal_force": "1 N", "drive_speed": "1 mm/s"}


@pytest.mark.parametrize("factor", [1e300, 1e-300, 1e30, 1e-30, 1e10, 1e-10])
def test_a_clock_of_a_wrong_unit_is_no_record(factor):
    time, force = 1e-3 * np.arange(3001), np.ones(3001)
    with pytest.raises(LogError, match="check the unit of the time"):
        Record(factor * time, force, force)


@pytest.mark.parametrize("text", ["drive_speed=1e30", "drive_speed=1e-30", "normal_force=1e-200", "normal_force=1e20"])
def test_an_operating_point_has_the_size_of_one(text):
    with pytest.raises(SceneError, match="which no rig has"):
        at_values([text], Scene.from_document({"effects": list(MAIN), "rig": RIG}))


@pytest.mark.parametrize("speed", [0.1, "100 mm/s"])
def test_a_bare_speed_of_a_fast_rig_is_si(speed):
    assert Scene.from_document(
        {"effects": list(MAIN), "rig": {**RIG, "drive_speed": speed}}
    ).rig.drive_speed == pytest.approx(0.1)
    with pytest.raises(SceneError, match="which no rig has"):
        Scene.from_document({"effects": list(MAIN), "rig": {**RIG, "drive_speed": "1e9 m/s"}})


def test_a_pipe_is_no_log(tmp_path):
    os.mkfifo(tmp_path / "log.csv")
    with pytest.raises(LogError, match="this is a pipe"):
        read_log(tmp_path / "log.csv")
