"""How a log is followed, and which part of it an answer rests on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import FIFTH, NORMAL_FORCE, recovery_case, scene_of
from identify import Scene, fit
from identify.effects import MAIN
from identify.logs.fit_mode import ForceRecord, fit_mode_of, hidden_rhythm, steady_since
from identify.logs.parting import parted
from identify.logs.prepare import prepare, settled_part
from identify.logs.segment import SLIDING, segment
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.simulation.drive import Drive
from identify.simulation.simulate import run

CASES = Path(__file__).resolve().parents[1] / "cases"
NOISE, RATE, LOADING, HALF_PERIOD = 0.0045, 20.0, 0.00125, 0.05  # N, Hz, N/s, s: a slow drive on a soft rig


def after_a_slip(after: float, rises: float, seed: int):
    """The fit mode of a ramp to 1 N, a fall to 0.7 N within two samples, and then `after` seconds that rise by `rises`
    N/s; and since when it looks level."""
    ramp = np.arange(0.0, 1.0 / LOADING, 1.0 / RATE) * LOADING
    force = np.concatenate([ramp, [0.85], 0.7 + rises * np.arange(0.0, after, 1.0 / RATE)])
    force += NOISE * np.random.default_rng(seed).standard_normal(force.size)
    time = np.arange(force.size) / RATE
    found = segment(time, force, half_period=HALF_PERIOD, noise=NOISE)
    record = ForceRecord(time, force, np.ones(time.size), NOISE, HALF_PERIOD, Drive.of(1.67e-6))
    return fit_mode_of(record, found, found.cycles.fall, 750.0), steady_since(time, force, NOISE, HALF_PERIOD)


@pytest.mark.parametrize(("after", "rises", "slides"), [(4.0, LOADING, False), (1.5, 0.0, False), (8.0, 0.0, True)])
def test_a_level_force_slides_only_where_a_stick_would_be_seen_to_rise(after: float, rises: float, slides: bool):
    for seed in (1, 4):
        mode, level_since = after_a_slip(after, rises, seed)
        assert level_since is not None and (mode.steady_since is not None) == slides
        assert not slides or mode.steady_since == pytest.approx(1.0 / LOADING, abs=1.0)


@pytest.mark.parametrize(("first", "slides"), [(0.15, False), (0.0, False), (0.65, True)])
def test_a_fast_drive_is_through_its_first_rise_in_a_few_samples(first: float, slides: bool):
    """A sliding level of 0.65 N, 0.3 N in the holds, and a first rise from `first` in 12 ms, which swings after."""
    drive = Drive.of(((0.0, 0.02), (2.0, 0.0), (6.0, 0.02), (7.5, 0.0), (24.0, 0.02)))
    time = np.arange(0.0, 26.0, 1e-3)
    swing = 0.65 - (0.65 - first) * np.cos(time / 8e-3) * np.exp(-time / 0.04)
    force = np.where(time < 0.5, swing, np.where([drive.at(t) > 0.0 for t in time], 0.65, 0.3))
    force += NOISE * np.random.default_rng(3).standard_normal(time.size)
    found = segment(time, force, half_period=0.026, noise=NOISE)
    found = replace(found, phase=np.full_like(found.phase, SLIDING))  # too short a stick to be seen as one
    record = ForceRecord(time, force, np.ones(time.size), NOISE, 0.026, drive)
    mode = fit_mode_of(record, found, found.cycles.fall, 1470.0)
    assert mode.name == "continuous" and mode.begins_sliding == slides


@pytest.mark.parametrize("number", [73, 77])
def test_the_fit_of_a_fast_log_begins_before_its_first_slip(number: int):
    """Drives of 20 mm/s: the force peaks 15 ms after the onset, and what it rises by until then is no stick."""
    case = recovery_case("wide, five logs", number)
    scene = scene_of(case, None, [FIFTH[0]])
    onset = run(assemble(MAIN), case.truth | case.rig, FIFTH[0], NORMAL_FORCE, 0.1).onsets[0]
    log = prepare(scene, scene.logs[4], case.records[4], from_scene(scene))
    assert log.data.begin < onset < log.segmentation.cycles.onset[0]


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
WHERE = {"stiffness": FIRM["stiffness"], "drive_speed": SLOW, "half_period": float(np.pi * np.sqrt(0.3171 / 1691.0))}


def level(swing: float, frequency: float, *, rate: float = 31.0, noise: float = 5.5e-3, load: float = 0.0) -> dict:
    """A level force of 0.6 N that swings, seen for 8 s; load: amplitude of the normal force [N]."""
    time = np.arange(round(8.0 * rate)) / rate
    wave = np.sin(2 * np.pi * frequency * time)
    force = 0.6 + swing * wave + noise * np.random.default_rng(1).standard_normal(time.size)
    return {"time": time, "force": force, "load": 1.446 + load * wave}


def test_the_rhythm_is_the_frequency_and_the_range_of_the_swing():
    found = hidden_rhythm(**level(1.5 * STICKS, 8.4), **WHERE)
    assert found.frequency == pytest.approx(8.4, abs=0.1) and found.samples == pytest.approx(31.0 / 8.4, rel=0.02)
    assert found.range == pytest.approx(3.0 * STICKS, rel=0.1)
    alias = hidden_rhythm(**level(1.5 * STICKS, 8.4, rate=12.0), **WHERE)
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
    assert hidden_rhythm(**asked, **(WHERE | where)) is None, why


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
        assert "log_1.csv seems to slide, but swings by 0.0" in log.left_out
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


@pytest.mark.parametrize(("share", "rate"), [(0.05, 100.0), (0.12, 200.0), (0.17, 1000.0)])
def test_a_quiet_end_of_less_than_a_fifth_is_no_level(share: float, rate: float):
    scene, record = sliding_scene(), two_levels(share, rate)
    log = prepare(scene, scene.logs[0], record, from_scene(scene))
    assert log.left_out is not None and "settles for the last" in log.left_out and settled_part(log) is None
    stated = float(log.left_out.split(" s only, ")[1].split(" % of the record")[0])
    assert stated == pytest.approx(100.0 * share, abs=0.5)


def test_a_quiet_end_is_as_unsure_as_the_rest_is_unlike_it_and_the_message_names_the_part():
    scene = sliding_scene()
    result = fit(scene, [two_levels(0.3)]).result
    assert result["status"] == "converged"
    assert result["message"].startswith("from 14.05 to 20 s of a.csv (30 % of the record): ")
    quiet, whole = (prepare(scene, scene.logs[0], two_levels(share), from_scene(scene)).data for share in (0.3, 1.0))
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
