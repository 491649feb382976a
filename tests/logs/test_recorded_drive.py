"""What a log tells of its drive, in a draft and in inspect: the programme of a column, or one sentence why none."""

import json
import tomllib

import numpy as np
import pytest

from data_io import Record
from identify.cli import main as cli
from identify.logs.recorded_drive import recorded_drive

STIFFNESS, DROP, RATE = 1800.0, 0.2, 500.0
PROGRAMME = ((0.0, 2e-4), (6.0, 1e-3), (9.0, 4e-3), (11.0, 1e-3), (14.0, 2e-4))


def driven(programme, duration=18.0):
    """Time [s], speed [m/s], position [m] and a sawtooth of force [N] that rises at stiffness times speed."""
    time = np.arange(int(duration * RATE)) / RATE
    starts, speeds = np.transpose(programme)
    speed = speeds[np.searchsorted(starts, time, side="right") - 1]
    position = np.concatenate([[0.0], np.cumsum(speed[:-1])]) / RATE
    way = np.concatenate([[0.0], np.cumsum(np.abs(speed[:-1]))]) / RATE
    saw = 0.3 + STIFFNESS * way % DROP
    force = np.where(speed < 0, -saw, saw) + 0.001 * np.random.default_rng(1).standard_normal(time.size)
    return time, speed, position, force


def write(path, columns):
    """A CSV of {header: values}."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.7g")
    return str(path)


def log(path, programme=PROGRAMME, header="drive_speed [mm/s]", values=None):
    time, speed, position, force = driven(programme)
    shown = 1e3 * (position if "osition" in header else speed) if values is None else values(time)
    columns = {"Time [s]": time, "Friction force [N]": force, "Normal force [N]": np.ones(time.size), header: shown}
    return write(path, columns)


def drafted(tmp_path, *arguments):
    out = tmp_path / "x.toml"
    assert cli.main(["scene", *arguments, "--out", str(out)]) == 0
    text = out.read_text()
    return tomllib.loads(text), text


def said(pairs):
    return [[start, f"{1e3 * speed:.4g} mm/s"] for start, speed in pairs]


@pytest.mark.parametrize("more", [["--columns", "drive_speed=drive_speed"], []])
def test_a_speed_column_that_steps_is_drafted_as_a_programme(tmp_path, more):
    scene, text = drafted(tmp_path, log(tmp_path / "a.csv"), *more)
    assert scene["logs"][0]["drive_speed"] == said(PROGRAMME), text
    assert float(scene["rig"]["stiffness"]["value"].split()[0]) == pytest.approx(STIFFNESS, rel=0.01), "by stick"


SPEEDS = ["Drive speed [mm/s]", "Velocity (mm/s)", "Stage speed [mm/s]", "Sliding speed [mm/s]", "V2 [mm/s]"]


@pytest.mark.parametrize("header", [*SPEEDS, "Position [mm]"])
def test_columns_are_known_by_name_and_unit(tmp_path, header):
    scene, text = drafted(tmp_path, log(tmp_path / "a.csv", header=header))
    told = scene["logs"][0]["drive_speed"]
    assert [speed for _, speed in told] == [speed for _, speed in said(PROGRAMME)], text
    assert [t for t, _ in told] == pytest.approx([t for t, _ in PROGRAMME], abs=0.01)


@pytest.mark.parametrize("header", ["Weg [mm]", "Sliding distance [mm]"])
def test_a_distance_that_is_slid_is_that_of_the_drive(header):
    """Also at one speed, where nothing else says that a column that grows evenly is the drive."""
    time, _, position, force = driven(((0.0, 1e-3),))
    name = header.removesuffix(" [mm]")
    record = Record(time, np.ones(time.size), force, channels={name: position}, channel_units={name: "m"})
    assert recorded_drive(record).speed == pytest.approx(1e-3, rel=1e-6)
    other = Record(time, np.ones(time.size), force, channels={"Probe": position}, channel_units={"Probe": "m"})
    assert recorded_drive(other).speed is None


def test_strokes_of_a_position_are_drafted_with_their_signs(tmp_path):
    strokes = ((0.0, 1e-3), (6.0, -1e-3), (12.0, 1e-3))
    scene, _ = drafted(tmp_path, log(tmp_path / "a.csv", strokes, "Position [mm]"))
    told = scene["logs"][0]["drive_speed"]
    assert [speed for _, speed in told] == ["1 mm/s", "-1 mm/s", "1 mm/s"]
    assert [t for t, _ in told] == pytest.approx([0, 6, 12], abs=0.01)
    assert float(scene["rig"]["stiffness"]["value"].split()[0]) == pytest.approx(STIFFNESS, rel=0.01)


def test_a_position_that_swings_is_no_programme():
    time = np.arange(4000) / 200.0
    record = Record(
        time,
        np.ones(time.size),
        np.full(time.size, 0.3),
        channels={"Position": 1e-3 * np.sin(time)},
        channel_units={"Position": "m"},
    )
    told = recorded_drive(record)
    assert told.programme is None and "does not move evenly" in told.trouble


def test_another_column_does_not_stand_in_for_one_that_is_no_programme():
    time = np.arange(4000) / 200.0
    channels = {"Velocity": 1e-3 * (2 + np.sin(time)), "Z": 1e-6 * time}
    record = Record(
        time,
        np.ones(time.size),
        np.full(time.size, 0.3),
        channels=channels,
        channel_units={"Velocity": "m/s", "Z": "m"},
    )
    told = recorded_drive(record)
    assert told.programme is None and "Velocity goes gradually" in told.trouble and not told.stands


def test_what_is_no_programme_is_said_beside_the_todo(tmp_path, capsys):
    swings = log(tmp_path / "a.csv", header="Drive speed [mm/s]", values=lambda t: 1 + 0.5 * np.sin(t))
    scene, text = drafted(tmp_path, swings)
    assert scene["logs"][0]["drive_speed"] == "TODO mm/s"
    assert "column Drive speed goes gradually from 0.5 to 1.5 mm/s, not in steps" in text
    assert "does not tell" not in text
    capsys.readouterr()
    assert cli.main(["inspect", swings]) == 0
    assert "column Drive speed goes gradually" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(("header", "words"), [
    ("V [V]", "column V is there and unused, because no unit of speed"),
    ("Velocity", 'column Velocity is there and unused, because no unit of speed'),
])  # fmt: skip
def test_a_column_that_may_be_something_else_is_named_and_not_used(tmp_path, header, words):
    scene, text = drafted(tmp_path, log(tmp_path / "a.csv", header=header))
    assert scene["logs"][0]["drive_speed"] == "TODO mm/s" and words in text


def test_a_column_of_any_name_is_the_drive_where_the_sticks_load_in_proportion_to_it(tmp_path):
    scene, text = drafted(tmp_path, log(tmp_path / "a.csv", header="Probe [mm/s]"))
    assert scene["logs"][0]["drive_speed"] == said(PROGRAMME) and "which is what the sticks load by" in text
    wear = log(tmp_path / "b.csv", header="Probe [mm/s]", values=lambda t: np.where(t < 9.0, 3.0, 1.0))
    (tmp_path / "x.toml").unlink()
    scene, text = drafted(tmp_path, wear)
    assert scene["logs"][0]["drive_speed"] == "TODO mm/s" and "the sticks do not load in proportion to it" in text


def test_where_the_drive_stands_is_no_sliding(tmp_path, capsys):
    assert cli.main(["inspect", log(tmp_path / "a.csv", ((0.0, 1e-3), (6.0, 0.0), (15.0, 1e-3)))]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "50.0 % while the drive stands" in words and "0.0 % sliding" in words
    assert cli.main(["inspect", log(tmp_path / "b.csv")]) == 0
    assert "stands" not in capsys.readouterr().out.split("stick-slip cycles; force")[1].split("noise")[0]


def test_inspect_says_the_programme_and_its_range(tmp_path, capsys):
    path = log(tmp_path / "a.csv")
    assert cli.main(["inspect", path]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "drive speed: 0.2 mm/s, from 6 s 1 mm/s, from 9 s 4 mm/s, from 11 s 1 mm/s, from 14 s 0.2 mm/s" in words
    assert cli.main(["inspect", path, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["logs"][0]
    assert told["drive_speed_m_per_s"] is None
    assert told["drive_speed_programme"] == [pytest.approx(pair) for pair in PROGRAMME]
    often = tuple((float(t), v) for t, v in zip(range(18), [1e-3, 2e-3] * 9, strict=True))
    assert cli.main(["inspect", log(tmp_path / "b.csv", often)]) == 0
    assert "drive speed: 1 mm/s to 2 mm/s in 18 steps" in " ".join(capsys.readouterr().out.split())


def test_a_log_that_slides_stays_in_the_draft_and_a_rejected_one_is_told(tmp_path, capsys):
    sticks = log(tmp_path / "sticks.csv", ((0.0, 1e-3),))
    time = np.arange(4000) / RATE
    noise = 0.003 * np.random.default_rng(2).standard_normal(time.size)
    level = 0.4 * (1 - np.exp(-time / 0.005)) + noise
    base = {"Time [s]": time, "Friction force [N]": level, "Normal force [N]": np.ones(time.size)}
    slides = write(tmp_path / "slides.csv", base)
    hangs = write(tmp_path / "hangs.csv", {**base, "Normal force [N]": noise})
    rests = write(tmp_path / "rests.csv", {**base, "Friction force [N]": noise})
    scene, text = drafted(tmp_path, sticks, slides, hangs, rests)
    assert [entry["path"] for entry in scene["logs"]] == ["sticks.csv", "slides.csv"]
    assert "# it slides: it tells" in text
    assert float(scene["rig"]["stiffness"]["value"].split()[0]) == pytest.approx(STIFFNESS, rel=0.01)
    out = capsys.readouterr().out
    assert "left out: hangs.csv: rejected by the quality gate: " in out and "# left out: hangs.csv" in text
    assert "left out: rests.csv: 0 stick-slip cycles, and it does not slide" in out
