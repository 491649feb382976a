"""How a log is followed, and which part of it an answer rests on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from identify import Scene, fit
from identify.effects import MAIN
from identify.logs.prepare import prepare
from identify.logs.regime import Known, hidden_rhythm
from identify.logs.scene_records import parted
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.simulation.simulate import run

CASES = Path(__file__).resolve().parents[1] / "cases"


def test_six_cycles_of_one_friction_in_noise_are_alike():
    pair = {"mu_s": 0.698, "mu_k0": 0.547, "delta_mu_k": -0.07, "a": 108.0, "D": 52e-6, "t_cr": 0.1225}
    rig, speed, times = {"mass": 0.2376, "stiffness": 1249.2, "damping": 144.4}, 0.101e-3, np.arange(450) / 100.0
    force = run(assemble(MAIN), pair | rig, speed, 0.376, 4.5).sample(times)["force"]
    logs = [{"path": "log.csv", "drive_speed": speed}]
    scene = Scene.from_document({"effects": [*MAIN], "rig": rig, "logs": logs})
    made = []
    for seed in range(40):
        noisy = force + 1.85e-3 * np.random.default_rng(seed).standard_normal(times.size)  # a twentieth of the drop
        record = Record(times, np.full(times.size, 0.376), noisy)
        made.append(prepare(scene, scene.logs[0], record, from_scene(scene)))
    assert np.median([log.segmentation.count for log in made]) == 6
    assert sum(log.unlike for log in made) <= 2


# Stick-slip of which a few samples see a cycle is not taken for steady sliding at its mean force.

FIRM = {"mass": 0.3171, "stiffness": 1691.0, "damping": 84.35}
SLOW = 3.524e-4
STICKS = SLOW * FIRM["stiffness"] / (2 * np.pi * 8.4)  # [N] of a sine that loads as fast as a stick once a period
WHERE = Known(FIRM["stiffness"], SLOW, float(np.pi * np.sqrt(0.3171 / 1691.0)))


def level(swing: float, frequency: float, *, rate: float = 31.0, noise: float = 5.5e-3, load: float = 0.0) -> dict:
    """A level force of 0.6 N that swings, seen for 8 s; load: amplitude of the normal force [N]."""
    time = np.arange(round(8.0 * rate)) / rate
    wave = np.sin(2 * np.pi * frequency * time)
    force = 0.6 + swing * wave + noise * np.random.default_rng(1).standard_normal(time.size)
    return {"time": time, "force": force, "load": 1.446 + load * wave}


def test_the_rhythm_is_the_frequency_and_the_range_of_the_swing():
    found = hidden_rhythm(**level(1.5 * STICKS, 8.4), known=WHERE)
    assert found.frequency == pytest.approx(8.4, abs=0.1) and found.samples == pytest.approx(31.0 / 8.4, rel=0.02)
    assert found.range == pytest.approx(3.0 * STICKS, rel=0.1)
    alias = hidden_rhythm(**level(1.5 * STICKS, 8.4, rate=12.0), known=WHERE)
    assert alias.frequency == pytest.approx(12.0 - 8.4, abs=0.1)


@pytest.mark.parametrize(
    ("why", "asked", "where"),
    [
        ("it loads too slowly to stick", level(0.3 * STICKS, 8.4, noise=1e-4), {}),
        ("no stick loads so fast", level(6.0 * STICKS, 8.4), {}),
        ("noise hides it, and moves the level more", level(STICKS, 8.4, noise=2.0 * STICKS), {}),
        ("the mass cannot follow", level(1.5 * STICKS, 50.0, rate=1000.0), {}),
        ("the normal force does it", level(1.5 * STICKS, 8.4, load=2.0 * STICKS), {}),
        ("noise alone", level(0.0, 8.4), {}),
        ("the rig is not known", level(1.5 * STICKS, 8.4), {"stiffness": 0.0}),
        ("the rig has no mass", level(1.5 * STICKS, 8.4), {"half_period": 0.0}),
    ],
)
def test_what_is_no_stick_slip_is_none(why: str, asked: dict, where: dict):
    assert hidden_rhythm(**asked, known=replace(WHERE, **where)) is None, why


@pytest.mark.parametrize("vibrates", [False, True])
def test_slips_of_two_samples_do_not_slide_and_their_log_says_how_to_sample_it(vibrates: bool):
    pair = {"mu_s": 0.5642, "mu_k0": 0.4130, "delta_mu_k": -0.0562, "a": 120.1, "D": 10.14e-6, "t_cr": 2.079}
    time = np.arange(272) / 30.9
    force = run(assemble(MAIN), pair | FIRM, SLOW, 1.446, 8.8).sample(time)["force"]
    record = Record(time, np.full(272, 1.446), force + 5.5e-3 * np.random.default_rng(1).standard_normal(272))
    document = {"effects": [*MAIN, *(["excitation"] if vibrates else [])], "rig": FIRM, "parameters": {}}
    document["logs"] = [{"path": "log_1.csv", "drive_speed": SLOW}]
    if vibrates:  # nothing is made of it then
        known = {"excitation_amplitude": {"fixed": "1 µm"}, "excitation_frequency": {"fixed": "8.4 Hz"}}
        document["parameters"] = known
    scene = Scene.from_document(document, Path())
    log = prepare(scene, scene.logs[0], record, from_scene(scene))
    assert (log.fit_mode.rhythm is None) == vibrates
    if not vibrates:
        assert "log_1.csv seems to slide, but oscillates by 0.0" in log.left_out
        assert "sample it at 2.1e+02 Hz or more" in log.left_out


# A level of a sliver of a record is no answer; one of a part says which, and is as unsure as the record is uneven.


def sliding_scene(**more: object) -> Scene:
    rig = {"mass": 0.3, "stiffness": 5000.0, "damping": 250.0}
    log = {"path": "a.csv", "drive_speed": 0.01, **more}
    return Scene.from_document({"effects": list(MAIN), "rig": rig, "logs": [log]}, Path())


def two_levels(share: float, rate: float = 200.0) -> Record:
    """A wandering level of 3.9 N that for the last share of 20 s is a quiet one of 3.4 N."""
    time = np.arange(int(20.0 * rate)) / rate
    wander = 3.9 + 0.1 * np.sin(2.0 * np.pi * time / 3.7) + 0.05 * np.sin(2.0 * np.pi * time / 1.3)
    force = np.where(time > (1.0 - share) * 20.0, 3.4, wander)
    force = force + 0.01 * np.random.default_rng(5).standard_normal(time.size)
    return Record(time, np.full(time.size, 10.0), force)


def test_the_level_of_the_last_tenth_is_refused_with_its_share():
    result = fit(Scene.from_toml(CASES / "level_of_the_last_tenth.toml")).result
    assert result["status"] == "no_cycles"
    assert "the last 0.142 s only, 10 % of the record" in result["message"]
    (row,) = result["logs"][0]["classical"]["rows"]
    assert row["sliding_mean_coefficient"] == pytest.approx(0.386, abs=0.002)


def test_a_quiet_end_is_as_unsure_as_the_rest_is_unlike_it_and_names_its_part():
    scene = sliding_scene()
    logs = [prepare(scene, scene.logs[0], two_levels(share), from_scene(scene)) for share in (0.3, 1.0)]
    assert logs[0].rests_on == "14.05 to 20 s of a.csv (30 % of the record)"
    quiet, whole = (log.data for log in logs)
    # 0.39 of the 70 % that wander against 0.34: the load counts as unsure by that share
    assert quiet.normal_force_sd == pytest.approx(0.7 * (0.39 / 0.34 - 1.0) * 10.0, rel=0.05)
    assert whole.normal_force_sd < 0.01


def test_the_share_of_a_stroke_is_of_the_stroke_and_not_of_what_is_left_of_the_record():
    time = np.arange(6000) / 200.0
    forth = (time // 10.0) % 2 == 0
    force = np.where(forth, 3.4, -3.4) + 0.01 * np.random.default_rng(1).standard_normal(time.size)
    scene, record = sliding_scene(), Record(time, np.full(time.size, 10.0), force)
    entry = replace(scene.logs[0], drive_speed=((0.0, 1e-3), (10.0, -1e-3), (20.0, 1e-3)))
    strokes, records = parted(replace(scene, logs=(entry,)), [record])
    assert len(strokes.logs) == 3
    for log, own in zip(strokes.logs, records, strict=True):
        assert prepare(strokes, log, own, from_scene(strokes)).rests_on == ""
