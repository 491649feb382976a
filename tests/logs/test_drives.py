"""The drive of a log: from its own column or head, in a draft, in inspect, in a fit; and against the stated one."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_io import Record, read_log
from data_io.record import Step
from identify import Scene
from identify.base.errors import FitError
from identify.cli import main as cli
from identify.logs.recorded_drive import drive_of, drive_position, recorded_drive, speed_in, speed_of
from identify.logs.regime import Regime, look
from identify.logs.scene_records import with_drives, with_records

CASES = Path(__file__).resolve().parents[1] / "cases"
STIFFNESS, DROP, RATE = 1800.0, 0.2, 500.0
TIME = np.arange(6000) / RATE
STEPS = ((0.0, 1e-3), (4.0, 2e-3), (8.0, 1e-3))
HOLD = ((0.0, 1e-3), (4.0, 0.0), (5.0, 1e-3))
STROKES = ((0.0, 1e-3), (4.0, -1e-3), (8.0, 1e-3))
WAITS = ((0.0, 0.0), (2.0, 1e-3))


def scene_of(drive_speed=None, **more):
    rig = {"mass": 0.2, "stiffness": STIFFNESS, "damping": 100.0}
    log = {"path": "a.csv", **({} if drive_speed is None else {"drive_speed": drive_speed}), **more}
    return Scene.from_document({"effects": ["inertia", "hysteresis_damping"], "rig": rig, "logs": [log]})


def record_of(programme, column="drive_speed", unit="m/s", head=None):
    """A record that loads at stiffness times speed, whose role, or whose channel, follows a programme."""
    starts, speeds = np.transpose(programme)
    speed = speeds[np.searchsorted(starts, TIME, side="right") - 1]
    way = np.concatenate([[0.0], np.cumsum(np.abs(speed[:-1]))]) / RATE
    noise = 0.001 * np.random.default_rng(1).standard_normal(TIME.size)
    force = np.where(speed < 0, -1.0, 1.0) * (0.3 + STIFFNESS * way % DROP) + noise
    record = Record(TIME, np.ones(TIME.size), force, steps=(Step(1, 1, 0, TIME.size, head or {}),))
    if column == "drive_speed":
        return replace(record, drive_speed=speed)
    position = np.concatenate([[0.0], np.cumsum(speed[:-1])]) / RATE
    return replace(record, channels={column: position if unit == "m" else speed}, channel_units={column: unit})


def with_channel(name, unit, values):
    record = replace(record_of(STEPS), drive_speed=None)
    return replace(record, channels={name: values}, channel_units={name: unit})


COLUMNS = [("drive_speed", "m/s"), ("Stage speed", "m/s"), ("Velocity", "m/s"), ("Position", "m"), ("Weg", "m")]


@pytest.mark.parametrize(("column", "unit"), COLUMNS)
@pytest.mark.parametrize("programme", [STEPS, HOLD, STROKES])
def test_a_drive_that_the_scene_leaves_out_is_taken_from_the_column(column, unit, programme):
    scene, said = with_drives(scene_of(), [record_of(programme, column, unit)])
    assert np.array(scene.logs[0].drive_speed) == pytest.approx(np.array(programme), abs=0.01, rel=1e-6)
    assert len(said) == 1 and said[0].startswith("a.csv: the drive speed was taken from ") and "1 mm/s" in said[0]
    assert with_drives(scene, None) == (scene, []), "what is stated is not read again"
    stated, (record,) = with_records(scene, [record_of(programme, column, unit)])
    assert stated is scene and record.findings == ()


def test_one_speed_of_a_column_is_one_speed():
    assert with_drives(scene_of(), [record_of(((0.0, 1e-3),))])[0].logs[0].drive_speed == pytest.approx(1e-3)


WEAR = 1e-6 * TIME


@pytest.mark.parametrize(
    ("name", "unit", "values", "words"),
    [
        ("drive_speed", "", None, "no drive speed, and it is not stated in the log; give drive_speed"),
        ("Position", "m", np.full(TIME.size, -0.69e-3), "column Position stands still"),
        ("Z", "m", WEAR, 'column Z is not taken for the drive.*--columns "position=Z"'),
        ("V2", "m/s", 1e-3 + 0 * TIME, 'column V2 is not taken for the drive.*--columns "drive_speed=V2"'),
        ("V", "V", 1e-3 + 0 * TIME, "column V is there and unused, because no unit of speed"),
    ],
)
def test_a_column_that_is_no_drive_is_named_with_the_way_out(name, unit, values, words):
    record = replace(record_of(STEPS), drive_speed=None) if values is None else with_channel(name, unit, values)
    with pytest.raises(FitError, match=words):
        with_drives(scene_of(), [record])
    if name in ("Z", "V2", "V"):
        assert speed_of(record) is None and with_records(scene_of(1e-3), [record])[1][0].findings == ()


@pytest.mark.parametrize(
    ("name", "unit", "values", "fastest"),
    [("Velocity", "m/s", 1e-3 * (2 + np.sin(TIME)), 3e-3), ("Position", "m", 1e-3 * np.sin(TIME), 1e-3)],
)
def test_a_column_that_changes_gradually_is_a_course(name, unit, values, fastest):
    found, said = with_drives(scene_of(), [with_channel(name, unit, values)])
    assert found.logs[0].drive_speed.fastest == pytest.approx(fastest, rel=0.02)
    assert len(said) == 1 and "the course of the drive was taken from" in said[0]


def test_the_radius_of_a_track_is_no_drive():
    record = read_log(CASES / "rtec_rotary_y_is_the_radius.csv")
    assert drive_position(record) is None
    assert speed_of(record)[0] == pytest.approx(2.0 * np.pi * 119.84 / 60.0 * 9.33e-3, rel=1e-3)


def test_one_speed_goes_with_a_window_a_late_start_and_strokes_of_a_position():
    for scene, record in (
        (scene_of(1e-3, window=["0.5 s", "3.5 s"]), record_of(STEPS)),
        (scene_of(1e-3), record_of(WAITS)),
        (scene_of(1e-3), record_of(STROKES, "Position", "m")),
        (scene_of(1.015e-3), record_of(((0.0, 1e-3),))),
        (scene_of([[0, 1.005e-3], [4.1, 2e-3], [7.95, 1e-3]]), record_of(STEPS)),
    ):
        assert with_records(scene, [record])[1][0].findings == ()


@pytest.mark.parametrize("programme", [STEPS, STROKES])
def test_a_draft_has_the_programme_and_the_stiffness_by_stick(tmp_path, programme):
    record, out = record_of(programme), tmp_path / "x.toml"
    columns = np.column_stack([record.time, record.friction_force, np.ones(6000), 1e3 * record.drive_speed])
    header = "Time [s],Friction force [N],Normal force [N],drive_speed [mm/s]"
    np.savetxt(tmp_path / "a.csv", columns, "%.7g", ",", header=header, comments="")
    assert cli.main(["scene", str(tmp_path / "a.csv"), "--out", str(out)]) == 0
    scene = tomllib.loads(out.read_text())
    pairs = scene["logs"][0]["drive_speed"]
    assert pairs == [[start, f"{1e3 * speed:.4g} mm/s"] for start, speed in programme]
    assert float(scene["rig"]["stiffness"]["value"].split()[0]) == pytest.approx(STIFFNESS, rel=0.01)


@pytest.mark.parametrize(
    ("name", "speed"),
    [
        ("0.1_mm_per_s.txt.gz", "0.1 mm/s"),
        ("V07_0.5mm-s_2N.txt", "0.5 mm/s"),
        ("2 mm per min, steel.csv", "2 mm/min"),
        *((name, "") for name in ("5ms.csv", "k168_v42.csv", "steel_2mm_silicone.csv", "1mm_s_and_2mm_s.csv")),
    ],
)
def test_a_speed_in_a_file_name_is_seen_and_a_time_or_a_thickness_is_none(name, speed):
    assert speed_in(name) == speed


def test_a_drive_on_a_sine_is_judged_stroke_by_stroke_as_the_drive_turns() -> None:
    """Friction that nearly vanishes in every slip shows no strokes of its own."""
    time = np.arange(8_900) / RATE
    speed = 2e-3 * np.cos(2.0 * np.pi * 0.07 * time)
    noise = 3e-3 * np.random.default_rng(1).standard_normal(time.size)
    loaded = STIFFNESS * np.cumsum(np.abs(speed)) / RATE
    sticks = Record(time, np.ones(time.size), np.sign(speed) * (0.02 + loaded % 0.7) + noise, drive_speed=speed)
    found = look(sticks, drive_of(sticks, recorded_drive(sticks)))
    assert found.regime is Regime.STICK_SLIP and [stroke.direction for stroke in found.strokes] == [1, -1, 1]
    slides = replace(sticks, friction_force=0.4 * np.sign(speed) + noise)
    assert look(slides, drive_of(slides, recorded_drive(slides))).regime is Regime.SLIDING
