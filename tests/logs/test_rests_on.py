"""A level of a sliver of a record is no answer; one of a part says which, and is as unsure as the record is uneven."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from identify import Scene, fit
from identify.logs import prepare as preparing
from identify.logs.parting import parted
from identify.logs.prepare import prepare, settled_part
from identify.logs.unknowns import from_scene

CASES = Path(__file__).resolve().parents[1] / "cases"
RIG = {"mass": 0.3, "stiffness": 5000.0, "damping": 250.0}
EFFECTS = ["inertia", "hysteresis_damping", "contact_ageing", "velocity_weakening"]


def scene_of(**more: object) -> Scene:
    log = {"path": "a.csv", "drive_speed": 0.01, **more}
    return Scene.from_document({"effects": EFFECTS, "rig": RIG, "logs": [log]}, Path())


def two_levels(share: float, rate: float = 200.0, seconds: float = 20.0) -> Record:
    """A wandering level of 3.9 N that for the last share of the record is a quiet one of 3.4 N."""
    random = np.random.default_rng(5)
    time = np.arange(int(seconds * rate)) / rate
    level = 3.9 + 0.1 * np.sin(2.0 * np.pi * time / 3.7) + 0.05 * np.sin(2.0 * np.pi * time / 1.3)
    force = np.where(time > (1.0 - share) * seconds, 3.4, level) + 0.01 * random.standard_normal(time.size)
    return Record(time, np.full(time.size, 10.0), force)


def test_the_level_of_the_last_tenth_is_refused_with_its_share() -> None:
    result = fit(Scene.from_toml(CASES / "level_of_the_last_tenth.toml")).result
    assert result["status"] == "no_cycles"
    assert "the last 0.142 s only, 10 % of the record" in result["message"]
    (row,) = result["logs"][0]["classical"]["rows"]
    assert row["sliding_mean_coefficient"] == pytest.approx(0.386, abs=0.002)


@pytest.mark.parametrize(("share", "rate"), [(0.05, 100.0), (0.12, 200.0), (0.17, 1000.0)])
def test_a_quiet_end_of_less_than_a_fifth_is_no_level(share: float, rate: float) -> None:
    scene, record = scene_of(), two_levels(share, rate)
    made = prepare(scene, scene.logs[0], record, from_scene(scene))
    assert made.left_out is not None and "settles for the last" in made.left_out
    told = float(made.left_out.split(" s only, ")[1].split(" % of the record")[0])
    assert told == pytest.approx(100.0 * share, abs=0.5)
    assert settled_part(made) is None


def test_the_interval_of_a_quiet_end_holds_the_level_of_the_rest_and_the_message_names_the_part() -> None:
    result = fit(scene_of(), [two_levels(0.3)]).result
    assert result["status"] == "converged"
    assert result["message"].startswith("from 14.05 to 20 s of a.csv (30 % of the record): sliding throughout: ")
    level, error = (float(word) for word in result["message"].split("coefficient, ")[1].split(" at ")[0].split(" ± "))
    assert abs(level - 0.39) < error < 0.2


def test_without_the_scatter_of_the_record_the_interval_misses_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preparing, "SETTLED_ENOUGH", 0.0)
    message = fit(scene_of(), [two_levels(0.3)]).result["message"]
    level, error = (float(word) for word in message.split("coefficient, ")[1].split(" at ")[0].split(" ± "))
    assert abs(level - 0.39) > 5.0 * error


def test_a_record_that_slides_throughout_counts_whole() -> None:
    message = fit(scene_of(), [two_levels(1.0)]).result["message"]
    assert message.startswith("from all of a.csv: sliding throughout: ") and "0.34 ±" in message


def test_the_share_of_a_stroke_is_of_the_stroke_and_not_of_what_is_left_of_the_record() -> None:
    """Three equal strokes that slide: none is told a third, or half, of the record."""
    time = np.arange(6000) / 200.0
    forth = (time // 10.0) % 2 == 0
    force = np.where(forth, 3.4, -3.4) + 0.01 * np.random.default_rng(1).standard_normal(time.size)
    scene, record = scene_of(), Record(time, np.full(time.size, 10.0), force)
    entry = replace(scene.logs[0], drive_speed=((0.0, 1e-3), (10.0, -1e-3), (20.0, 1e-3)))
    strokes, records = parted(replace(scene, logs=(entry,)), [record])
    assert len(strokes.logs) == 3
    for log, own in zip(strokes.logs, records, strict=True):
        assert prepare(strokes, log, own, from_scene(strokes)).rests_on == ""
