"""Rotary modules: the speed at the track, and what the head of a step states of the drive without a unit."""

from pathlib import Path

import numpy as np
import pytest

from data_io import read_log
from data_io.derived_columns import stated_velocity

CASES = Path(__file__).parents[1] / "cases"


def test_the_track_of_an_rtec_tells_the_speed():
    record = read_log(CASES / "rtec_rotary_y_is_the_radius.csv")
    turns, radius = record.channels["Rotary.Velocity"], record.channels["XYZ.Y Position"]
    np.testing.assert_allclose(record.drive_speed, 2 * np.pi * turns / 60 * np.abs(radius), rtol=1e-12)
    first = record.drive_speed[record.steps[0].start : record.steps[0].stop]
    assert np.mean(first) == pytest.approx(2 * np.pi * 2.0 * 9.33e-3, rel=5e-3)  # 120 rpm at 9.33 mm
    assert "speed_from_rotation" in {finding.code for finding in record.findings}


@pytest.mark.parametrize(
    ("head", "row", "speed"),
    [
        ("Time [s],Fx [N],Fz [N],Speed [rpm],Radius [mm]", "60,20", 2 * np.pi * 0.020),
        ("Time [s];Ff [N];Fn [N];n [1/min];Track radius [cm]", "120;3", 4 * np.pi * 0.03),
        ("t [s]\tFt [N]\tLoad [N]\tSpindle [RPM]\tWear radius [um]", "30\t5000", np.pi * 0.005),
    ],
)
def test_a_radius_and_turns_beside_each_other(tmp_path, head, row, speed):
    mark = next(mark for mark in ",;\t" if mark in head)
    rows = "".join(f"{i / 10}{mark}{i % 7}.5{mark}3.0{mark}{row}\n" for i in range(40))
    (tmp_path / "a.txt").write_text(f"{head}\n{rows}")
    np.testing.assert_allclose(read_log(tmp_path / "a.txt").drive_speed, speed, rtol=1e-12)


def test_no_speed_is_made_of_what_does_not_tell_it(tmp_path):
    rows = "".join(f"{i / 10},{i % 7}.5,3.0,60,0.01\n" for i in range(40))
    for head in ("Speed [rpm],Z [mm]", "Speed [mm/s],Radius [mm]", "Speed [rpm],Radius"):
        (tmp_path / "a.csv").write_text(f"Time [s],Fx [N],Fz [N],{head}\n{rows}")
        assert read_log(tmp_path / "a.csv").drive_speed is None
    (tmp_path / "a.csv").write_text(f"Time [s],Fx [N],Fz [N],Turns [rpm],Radius [mm]\n{rows}")
    own = read_log(tmp_path / "a.csv", columns={"drive_speed": "Radius"}, units={"drive_speed": "mm/s"})
    np.testing.assert_allclose(own.drive_speed, 1e-5, err_msg="what the user names is not overruled")


def test_the_velocity_in_the_head_of_a_cetr_step():
    record = read_log(CASES / "cetr_v1_is_the_vertical_carriage.csv")
    stated = stated_velocity(record.steps[0].parameters, record.metadata, record.units())
    assert stated is not None and stated.value == 240.0 and stated.module is None and stated.unit is None
    assert stated.speeds["linear"] == pytest.approx(4e-3)  # 240 mm/min
    assert stated.speeds["rotary"] == pytest.approx(2 * np.pi * 4.0 * 3.95e-3)  # 240 rpm at 3.95 mm
