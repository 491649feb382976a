"""How the drive moved: programmes told back from position, speed and rotation."""

from pathlib import Path

import numpy as np
import pytest

from data_io import Record, read_log
from data_io.derived_columns import stated_velocity
from data_io.drive import evened, motion_of
from identify.logs.recorded_drive import recorded_drive

RATE = 200.0


def moved(programme, noise=0.0, seed=1, **more):
    """A record whose channel X [m] follows (duration [s], speed [m/s]) pieces; the force follows the direction."""
    time = np.arange(0, sum(duration for duration, _ in programme), 1 / RATE)
    edges = np.cumsum([0.0, *(duration for duration, _ in programme)])
    speed = np.array([s for _, s in programme])[
        np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(programme) - 1)
    ]
    x = np.interp(time, edges, np.cumsum([0.0, *(d * s for d, s in programme)]))
    x = x + noise * np.random.default_rng(seed).standard_normal(time.size)
    return Record(
        time=time, normal_force=np.full(time.size, 2.0), friction_force=np.sign(speed) + 0.01 * np.sin(time),
        channels={"Z": np.full(time.size, 1e-6), "X": x, **more}, channel_units={"Z": "m", "X": "m"},
    )  # fmt: skip


PROGRAMMES = {
    "one speed": [(20, 1e-4)],
    "to and fro": [(5, 1e-3), (5, -1e-3), (5, 1e-3), (5, -1e-3)],
    "move, rest, move": [(10, 2e-3), (5, 0.0), (10, 2e-3)],
    "a step of the speed": [(10, 1e-3), (10, 3e-3)],
    "three speeds and a rest": [(8, 1e-3), (8, 2e-3), (6, 0.0), (8, 5e-3)],
    "unequal strokes": [(9, 1e-3), (3, -3e-3), (9, 1e-3)],
}


@pytest.mark.parametrize("noise", [0.0, 2e-6])
@pytest.mark.parametrize("name", PROGRAMMES)
def test_a_programme_is_told_back(name, noise):
    programme = PROGRAMMES[name]
    motion = motion_of(moved(programme, noise), "X")
    starts = np.cumsum([0.0, *(duration for duration, _ in programme[:-1])])
    assert [start for start, _ in motion.programme] == pytest.approx(starts, abs=0.05)
    assert [speed for _, speed in motion.programme] == pytest.approx([s for _, s in programme], rel=0.01, abs=1e-12)


def test_what_does_not_move_tells_nothing():
    assert motion_of(moved([(10, 0.0)]), "X") is None


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
    assert stated is not None and stated.value == 240.0 and stated.module is None
    assert stated.speeds["linear"] == pytest.approx(4e-3)  # 240 mm/min
    assert stated.speeds["rotary"] == pytest.approx(2 * np.pi * 4.0 * 3.95e-3)  # 240 rpm at 3.95 mm


TIME = np.arange(8000) / 500.0
SPEEDS = {
    "one speed": ((0.0, 1e-3),),
    "steps": ((0.0, 2e-4), (4.0, 1e-3), (8.0, 4e-3), (10.0, 1e-3), (13.0, 2e-4)),
    "slide, hold, slide": ((0.0, 1e-3), (4.0, 0.0), (4.4, 1e-3), (9.0, 0.0), (12.0, 1e-3)),
    "strokes": ((0.0, 1e-3), (4.0, -1e-3), (8.0, 1e-3), (12.0, -1e-3)),
    "a slow programme": ((0.0, 1e-6), (8.0, 3e-6)),
}


def column(programme, noise=0.0, ramp=1, seed=1):
    starts, speeds = np.transpose(programme)
    speed = speeds[np.searchsorted(starts, TIME, side="right") - 1]
    speed = np.convolve(np.pad(speed, ramp // 2, mode="edge"), np.ones(ramp) / ramp, "valid")[: TIME.size]
    return speed + noise * np.abs(speeds).max() * np.random.default_rng(seed).standard_normal(TIME.size)


def steps_of(speed):
    return recorded_drive(
        Record(TIME, np.ones(TIME.size), TIME, channels={"Speed": speed}, channel_units={"Speed": "m/s"})
    )


@pytest.mark.parametrize(("noise", "ramp"), [(0.0, 1), (0.002, 1), (0.03, 1), (0.002, 9)])
@pytest.mark.parametrize("name", SPEEDS)
def test_a_programme_is_told_back_from_speeds(name, noise, ramp):
    programme = SPEEDS[name]
    found = steps_of(column(programme, noise, ramp))
    assert found.trouble == "" and len(found.programme) == len(programme)
    assert [t for t, _ in found.programme] == pytest.approx([t for t, _ in programme], abs=0.012)
    fast = max(abs(v) for _, v in programme)
    assert [v for _, v in found.programme] == pytest.approx([v for _, v in programme], rel=5e-3, abs=0.1 * noise * fast)


def test_holds_are_exactly_zero_and_strokes_equally_fast():
    held = steps_of(column(SPEEDS["slide, hold, slide"], 0.02)).programme
    assert held[1][1] == 0.0 and held[3][1] == 0.0
    strokes = steps_of(column(SPEEDS["strokes"], 0.02)).programme
    assert len({abs(v) for _, v in strokes}) == 1
    assert evened([1.0, -1.004, 0.0, 1.2]) == [1.002, -1.002, 0.0, 1.2]


def test_spikes_gaps_and_quantisation_are_no_steps():
    speed = np.round(column(SPEEDS["steps"], 0.01), 4)
    speed[[500, 501, 6000]] = 0.5
    speed[3000:3003] = np.nan
    found = steps_of(speed)
    assert [v for _, v in found.programme] == pytest.approx([v for _, v in SPEEDS["steps"]], rel=0.01, abs=5e-6)


NONE = {
    "a sine": 1e-3 * np.sin(2 * np.pi * TIME / 5),
    "a fast sine": 1e-3 * np.sin(2 * np.pi * TIME * 20),
    "a sine in noise": 1e-3 + 2e-4 * np.sin(TIME) + 1e-4 * np.random.default_rng(2).standard_normal(TIME.size),
    "a long ramp": np.interp(TIME, [0, 5, 12, 16], [1e-3, 1e-3, 2e-3, 2e-3]),
    "speeding up": 1e-4 * TIME,
}


@pytest.mark.parametrize("name", NONE)
def test_what_changes_gradually_is_no_programme(name):
    found = steps_of(NONE[name])
    assert found.programme is None and ("evenly" in found.trouble or "more than" in found.trouble) and not found.stands
