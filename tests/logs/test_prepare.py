"""What the estimator is handed: the course of the normal force, the window, sign, tare, and refusals by name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from data_io import Record
from data_io.quality import Thresholds
from experiments.study_problem import DEMO, RIG
from identify.base.errors import FitError, SceneError
from identify.effects import MAIN
from identify.logs.log_data import level
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.scene import Scene
from identify.simulation.simulate import run

NOISE = 5e-3
QUIET = 0.4  # [s] before the drive starts


def _scene(effects: tuple[str, ...] = MAIN, **log: object) -> Scene:
    rig = dict(RIG) | {"drive_speed": 1e-3}
    return Scene.from_document({"effects": list(effects), "rig": rig, "logs": [{"path": "a.csv", **log}]}, Path())


def _record(quiet: float = 0.0, sign: float = 1.0, offset: float = 0.0, seed: int = 0) -> Record:
    times = np.arange(4000) / 1000.0
    drive = ((0.0, 0.0), (quiet, 1e-3)) if quiet else 1e-3
    force = run(assemble(MAIN), DEMO | RIG, drive, 1.0, 4.0).sample(times)["force"]
    noise = NOISE * np.random.default_rng(seed).standard_normal(times.size)
    return Record(times, np.ones(times.size), sign * (force + noise) + offset)


def _prepared(record: Record, **log: object):
    scene = _scene(**log)
    return prepare(scene, scene.logs[0], record, from_scene(scene))


def test_a_record_that_starts_before_the_drive_is_cut_where_the_loading_starts():
    cut = _prepared(_record(quiet=QUIET)).data.begin
    assert QUIET - 0.01 < cut < QUIET + 0.1
    assert _prepared(_record()).data.begin == 0.0


def test_the_sign_of_the_stroke_is_turned_and_remembered():
    plain, turned = _prepared(_record()), _prepared(_record(sign=-1.0))
    assert (plain.sign, turned.sign) == (1, -1)
    assert np.array_equal(plain.force, turned.force)
    assert _prepared(_record(), flip_sign=True).sign == -1


def test_a_spring_that_pulls_the_other_way_in_a_hold_turns_no_log_over():
    drive = ((0.0, 3e-3), (0.12, 0.0), (1.12, 3e-3), (1.27, 0.0))  # it stops in the sticks after slips
    light = {"mu_s": 0.41, "mu_k0": 0.23, "delta_mu_k": -0.1, "a": 700.0, "D": 50e-6, "t_cr": 0.3}
    times = np.arange(4000) / 1000.0
    force = run(assemble(MAIN), light | RIG, drive, 1.0, 4.0).sample(times)["force"]
    assert np.median(force) < -0.02 and np.median(force[:120]) > 0.1
    log = _prepared(Record(times, np.ones(times.size), force), drive_speed=[list(step) for step in drive])
    assert log.sign == 1 and log.slip_times.size == 2


def test_slips_between_holds_are_found_whatever_the_holds_are():
    """Rests of ten seconds between rises of a tenth say nothing of what a rise is; here no slip was found."""
    drive = ((0.0, 3e-3), (0.379, 0.0), (1.379, 3e-3), (1.663, 0.0), (4.663, 3e-3), (4.947, 0.0), (14.947, 3e-3))
    soft = {"mu_s": 0.627, "mu_k0": 0.4185, "delta_mu_k": -0.0973, "a": 150.0, "D": 21.6e-6, "t_cr": 0.573}
    soft |= {"mass": 0.155, "stiffness": 1056.0, "damping": 136.0}
    times = np.arange(7600) / 500.0
    motion = run(assemble(MAIN), soft, drive, 1.0, times[-1])
    noise = 3e-3 * np.random.default_rng(0).standard_normal(times.size)
    record = Record(times, np.ones(times.size), motion.sample(times)["force"] + noise)
    found = _prepared(record, drive_speed=[list(step) for step in drive]).segmentation.cycles
    slips = [np.any((motion.onsets < fall) & (fall < motion.onsets + 0.06)) for fall in found.fall]
    assert found.count >= 6 and all(slips)
    assert np.all(found.arrest - found.fall < 0.06), "a slip in which the drive stops ends there, not where it restarts"


def test_skipped_cycles_and_windows_leave_samples_and_falls_out():
    everything, later = _prepared(_record()), _prepared(_record(), skip_cycles=2)
    assert later.slip_times.size == everything.slip_times.size - 2
    assert everything.segmentation.cycles.arrest[1] < later.data.begin < everything.segmentation.cycles.onset[2]
    half = _prepared(_record(), window=[0.0, 2.0])
    assert not half.used[2500:].any()
    holed = _prepared(_record(), exclude=[[0.1, 0.12]])
    assert not holed.used[105:115].any() and holed.used[200:300].any()


def test_what_cannot_be_fitted_is_refused_by_name():
    scene = _scene()
    stepped = replace(scene, rig=replace(scene.rig, drive_speed=((0.0, 1e-3), (1.0, -1e-3))))
    with pytest.raises(FitError, match="a drive that turns"):
        prepare(stepped, stepped.logs[0], _record(), from_scene(stepped))
    with pytest.raises(FitError, match="tare interval"):
        _prepared(_record(), tare=[10.0, 11.0])


def _loaded(course: np.ndarray, effects: tuple[str, ...] = MAIN, **log: object):
    record = _record()
    noisy = course + 1e-3 * np.random.default_rng(2).standard_normal(course.size)
    scene = _scene(effects, **log)
    return prepare(scene, scene.logs[0], Record(record.time, noisy, record.friction_force), from_scene(scene))


def test_a_varying_load_counts_where_the_effect_is_on_and_its_mean_where_it_is_off():
    times = np.arange(4000) / 1000.0
    course = 1.0 + 0.05 * np.sin(2 * np.pi * times / 4.0) + 0.1 * (times - 2.0) / 2.0
    on = _loaded(course, (*MAIN, "varying_normal_force"))
    assert on.data.normal_force.at(times) == pytest.approx(course, abs=2e-3) and on.hidden_swing == 0.0
    off = _loaded(course)
    assert len(off.data.normal_force.values) == 1
    assert off.data.mean_normal_force == pytest.approx(np.mean(course), abs=5 * 1e-3 / np.sqrt(course.size))
    # half the range of the course over its mean, from a fine grid
    assert off.hidden_swing == pytest.approx(np.ptp(course) / 2 / np.mean(course), rel=0.03)
    cut = _loaded(course, window=[0.0, 1.0])
    assert cut.data.mean_normal_force == pytest.approx(np.mean(course[:1001]), abs=2e-3)
    assert _loaded(np.ones(4000)).hidden_swing == 0.0, "noise is no variation"


def test_the_mean_of_noise_alone_is_as_certain_as_noise_lets_it_be():
    errors = []
    for seed in range(200):
        noise = 1e-2 * np.random.default_rng(seed).standard_normal(400)
        made = level(np.arange(400) / 100.0, 2.0 + noise)
        errors.append((made.force.values[0] - 2.0) / made.sd)
    assert 0.85 < np.std(errors) < 1.15


def test_laws_outside_their_measured_range_are_refused_with_the_measured_load():
    with pytest.raises(SceneError, match=r"load_dependence was measured from 0.1 to 50 N .* is 98 N"):
        _loaded(np.full(4000, 98.0), (*MAIN, "load_dependence"))
    assert _loaded(np.full(4000, 20.0), (*MAIN, "load_dependence")).left_out is None


def test_a_rejected_log_is_left_out_with_its_reason_and_a_threshold_lets_it_in():
    record = _record()
    rippling = 1.0 + 0.4 * np.sqrt(2) * np.sin(2 * np.pi * 5 * record.time)
    rippling += 1e-3 * np.random.default_rng(1).standard_normal(rippling.size)
    bad = Record(record.time, rippling, record.friction_force)
    log = _prepared(bad)
    assert log.judgement.verdict == "reject"
    assert log.left_out is not None and "quality gate: the normal force ripples by 40 %" in log.left_out
    scene = replace(_scene(), thresholds=Thresholds({"load_ripple_reject": 0.5}))
    assert prepare(scene, scene.logs[0], bad, from_scene(scene)).left_out is None
    unloaded = _prepared(Record(record.time, np.zeros(record.time.size), record.friction_force))
    assert "a.csv is rejected by the quality gate: the normal force is zero or pulls" in unloaded.left_out
