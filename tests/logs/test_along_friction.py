"""A column is the drive only where it moves along the friction; what the user states is doubted, never overruled."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_io import Record, read_log
from data_io.record import Step
from identify import Scene, fit
from identify.cli import main as cli
from identify.logs.judgement import judge
from identify.logs.recorded_drive import drive_position, recorded_drive, speed_of
from identify.logs.scene_records import with_records

pytestmark = pytest.mark.usefixtures("no_further_logs")

CASES = Path(__file__).resolve().parents[1] / "cases"


def drafted(path: Path, out: Path) -> tuple[dict, str]:
    assert cli.main(["scene", str(path), "--out", str(out)]) == 0
    return tomllib.loads(out.read_text()), out.read_text()


def advised(path: Path, capsys: pytest.CaptureFixture[str]) -> set[str]:
    capsys.readouterr()
    assert cli.main(["inspect", str(path), "--json"]) == 0
    (log,) = json.loads(capsys.readouterr().out)["logs"]
    return {finding["code"] for finding in log["quality"]["findings"]}


def test_the_vertical_carriage_is_not_the_drive_and_the_head_is_quoted(tmp_path, capsys) -> None:
    path = CASES / "cetr_v1_is_the_vertical_carriage.csv"
    scene, text = drafted(path, tmp_path / "x.toml")
    assert scene["logs"][0]["drive_speed"] == "TODO mm/s"
    assert "Velocity = 240 without a unit: 4 mm/s if in mm/min" in text
    assert not advised(path, capsys) & {"residual_force", "stopped"}


def test_the_true_speed_is_taken_against_that_column() -> None:
    scene = Scene.from_toml(CASES / "cetr_true_speed.toml")
    told, (record,) = with_records(scene, None)
    assert told.logs[0].drive_speed == pytest.approx(4e-3)
    assert not [f for f in record.findings if f.code == "drive_speed_disagrees"], "the head of the log agrees"
    assert fit(scene).result["logs"][0]["drive_speed_m_per_s"] == pytest.approx(4e-3)


def test_another_speed_than_that_of_the_head_is_taken_and_doubted() -> None:
    scene = Scene.from_toml(CASES / "cetr_true_speed.toml")
    scene = replace(scene, logs=(replace(scene.logs[0], drive_speed=1e-3),))
    told, (record,) = with_records(scene, None)
    assert told.logs[0].drive_speed == 1e-3
    (doubt,) = [f for f in record.findings if f.code == "drive_speed_disagrees"]
    assert doubt.severity == "warning" and "Velocity = 240" in doubt.message and "check drive_speed" in doubt.message


def test_the_radius_of_a_track_is_no_drive_and_no_rest_is_told_by_it(capsys) -> None:
    path = CASES / "rtec_rotary_y_is_the_radius.csv"
    assert not advised(path, capsys) & {"residual_force", "stopped", "perhaps_stopped"}
    record = read_log(path)
    assert drive_position(record) is None and speed_of(record) is not None
    assert speed_of(record)[0] == pytest.approx(2.0 * np.pi * 119.84 / 60.0 * 9.33e-3, rel=1e-3)


def saw(speed: np.ndarray, rate: float, stiffness: float = 1500.0) -> np.ndarray:
    """A saw-tooth force that loads at stiffness times speed."""
    way = np.concatenate([[0.0], np.cumsum(np.abs(speed[:-1]))]) / rate
    noise = 0.001 * np.random.default_rng(2).standard_normal(speed.size)
    return np.where(speed < 0, -1.0, 1.0) * (0.4 + stiffness * way % 0.2) + noise


def record_of(channels: dict[str, np.ndarray], units: dict[str, str], force: np.ndarray, head: dict) -> Record:
    time = np.arange(force.size) / 500.0
    steps = (Step(1, 1, 0, force.size, head),)
    return Record(time, np.ones(time.size), force, channels=channels, channel_units=units, steps=steps)


SPEED = np.where(np.arange(6000) < 3000, 1e-3, 2e-3)
WEAR = 1e-6 * np.arange(6000) / 500.0


@pytest.mark.parametrize(("name", "unit", "values"), [
    ("Z", "m", WEAR), ("Depth", "m", WEAR), ("LVDT", "m", 1e-5 * np.sin(np.arange(6000) / 900.0)),
    ("V3", "m/s", 0 * SPEED + 1e-5),
])  # fmt: skip
def test_wear_depth_and_other_carriages_are_no_drive(name: str, unit: str, values: np.ndarray) -> None:
    record = record_of({name: values}, {name: unit}, saw(SPEED, 500.0), {})
    told = recorded_drive(record)
    assert told.programme is None and speed_of(record) is None
    codes = {finding.code for finding in judge(record, []).findings}
    assert not codes & {"residual_force", "stopped"}


@pytest.mark.parametrize("name", ["V1", "X", "Slider"])
def test_sticks_that_load_in_proportion_tell_the_drive(name: str) -> None:
    told = recorded_drive(record_of({name: SPEED, "Z": WEAR}, {name: "m/s", "Z": "m"}, saw(SPEED, 500.0), {}))
    assert told.programme == ((0.0, 1e-3), (pytest.approx(6.0, abs=0.02), 2e-3))
    assert "which is what the sticks load by" in told.source


def test_a_known_stiffness_tells_a_drive_of_one_speed() -> None:
    one = np.full(6000, 1e-3)
    record = record_of({"V2": one}, {"V2": "m/s"}, saw(one, 500.0), {})
    assert recorded_drive(record).programme is None
    assert recorded_drive(record, 1500.0).speed == pytest.approx(1e-3)
    assert recorded_drive(record, 15_000.0).programme is None


def test_strokes_of_a_table_tell_the_drive_and_a_vertical_axis_does_not() -> None:
    way = np.where(np.arange(6000) // 750 % 2 == 0, 1.0, -1.0)
    position = np.concatenate([[0.0], np.cumsum(way[:-1])]) * 2e-3 / 500.0
    force = 0.5 * way + 0.01 * np.random.default_rng(4).standard_normal(way.size)
    record = record_of({"Z": WEAR, "X": position}, {"Z": "m", "X": "m"}, force, {})
    assert drive_position(record) == "X"
    told = recorded_drive(record)
    assert told.programme is not None and "turns as the friction does" in told.source
    np.testing.assert_allclose([abs(speed) for _, speed in told.programme], 2e-3, rtol=0.01)


@pytest.mark.parametrize(("head", "speed", "drive"), [
    ({"Velocity": "60"}, 1e-3, True),  # mm/min
    ({"Velocity": "10", "Radius": "5"}, 2.0 * np.pi * 10.0 / 60.0 * 5e-3, True),  # rpm
    ({"Velocity": "60"}, 1.3e-3, False),
])  # fmt: skip
def test_a_column_as_fast_as_the_head_says_is_the_drive(head: dict, speed: float, drive: bool) -> None:
    values = np.full(2000, speed)
    force = 0.5 + 0.01 * np.random.default_rng(1).standard_normal(values.size)
    told = recorded_drive(record_of({"V2": values}, {"V2": "m/s"}, force, head))
    assert (told.speed is not None) == drive


@pytest.mark.parametrize("walk", [False, True])
def test_noise_whose_differences_are_as_fast_as_the_head_says_is_no_drive(walk: bool) -> None:
    draw = np.random.default_rng(4)
    force = 0.5 + 0.01 * draw.standard_normal(2000)
    noise = draw.standard_normal(force.size)
    noise = np.cumsum(noise) if walk else noise
    speeds = np.abs(noise[4:] - noise[:-4]) / (4 / 500.0)  # record_of has 500 Hz
    noise *= 1e-3 / float(np.median(speeds[speeds > 0.05 * np.quantile(speeds, 0.9)]))
    told = recorded_drive(record_of({"Z": noise}, {"Z": "m"}, force, {"Velocity": "60"}))
    assert told.programme is None
    drive = noise / 10.0 + 1e-3 * np.arange(force.size) / 500.0
    told = recorded_drive(record_of({"Z": drive}, {"Z": "m"}, force, {"Velocity": "60"}))
    assert told.programme is not None and told.programme[0][1] == pytest.approx(1e-3, rel=0.05)


def umt(path: Path, velocity: float) -> Path:
    """A test as a UMT exports it: two seconds at rest with 12 mN in the sensor, then twelve sticks of 1300 N/m."""
    names = "Fx,Fz,Y,V2,T,Ff,COF\nN,N,mm,mm/sec,sec,N,\n"
    rest, time, speed = np.arange(400) / 200.0, np.arange(4000) / 200.0, 0.5
    noise = 0.002 * np.random.default_rng(1).standard_normal((2, time.size))
    steps = [
        (1, velocity, rest, 0.012 + noise[0, :400], np.zeros(400)),
        (2, 60.0 * speed, time, 0.1 + 1.3 * (speed * time % 0.8) + noise[1], np.full(4000, speed)),
    ]
    lines = ["Created by CETR UMT ver.1.136.257 12 May 2022 12:21:50", "", "Run # 1"]
    for number, stated, t, force, moved in steps:
        lines += [f"Step No. {number}", "", f"Velocity     = {stated:g}", f"Data Count   = {t.size}", "", names]
        lines += [f"{f:.6f},-1,{v * s:.6f},{v:.6f},{s:.4f},{f:.6f},{f:.6f}" for s, f, v in zip(t, force, moved)]  # noqa: B905
        lines += ["", ""]
    path.write_text("\n".join(lines))
    return path


def test_a_step_at_rest_is_left_out_and_its_force_offered_as_the_zero(tmp_path, capsys) -> None:
    path = umt(tmp_path / "a.txt", 0.0)
    scene, text = drafted(path, tmp_path / "x.toml")
    assert [entry["step"] for entry in scene["logs"]] == [2]
    assert "a.txt step 1: the drive stands" in capsys.readouterr().out
    (line,) = [line for line in text.splitlines() if line.startswith("# tare")]
    assert float(line.split('"')[1].split()[0]) == pytest.approx(12.0, abs=0.5) and "step 1" in line
    assert cli.main(["inspect", str(path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "the drive stands: the head of the log says Velocity = 0; the friction force shows 1" in said
    assert "step 2 stroke 1" in said and "step 1 stroke 1" not in said, "a rest is no column of the classical table"


def test_a_step_that_states_a_speed_does_not_stand(tmp_path) -> None:
    path = umt(tmp_path / "a.txt", 30.0)
    scene, text = drafted(path, tmp_path / "x.toml")
    assert [entry["step"] for entry in scene["logs"]] == [1, 2] and "# tare" not in text
