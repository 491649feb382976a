"""A log of another pair is named where no answer describes all; a log that is wrong in itself is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data_io import Record
from experiments.study_problem import DEMO, NAMES, NOISE, NORMAL_FORCE, RIG
from identify import Scene
from identify.base.outcome import Status
from identify.diagnosis import diagnosis
from identify.diagnosis import disagreement as disagreeing
from identify.diagnosis.diagnosis import diagnose
from identify.diagnosis.disagreement import disagreement
from identify.diagnosis.fitted import as_it_ended
from identify.estimation.search import SearchProblem, search
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.model.model import assemble
from identify.simulation.simulate import run

LOGS = ((1e-4, 20.0, 200.0), (1e-3, 4.0, 500.0), (5e-3, 1.5, 1000.0))  # drive speed [m/s], duration [s], rate [Hz]
STRANGER = {"mu_s": 0.52, "mu_k0": 0.37, "a": 450.0, "t_cr": 0.9}


def _record(truth, log, seed):
    speed, duration, rate = log
    times = np.arange(round(duration * rate) + 1) / rate
    force = run(assemble(NAMES), truth | RIG, speed, NORMAL_FORCE, duration).sample(times)["force"]
    noise = NOISE * np.random.default_rng(seed).standard_normal(times.size)
    return Record(times, np.full(times.size, NORMAL_FORCE), force + noise)


@pytest.fixture(scope="module")
def of_one_pair():
    return [_record(DEMO, log, seed) for seed, log in enumerate(LOGS)]


@pytest.fixture(scope="module")
def with_a_stranger(of_one_pair):
    return [*of_one_pair[:2], _record(DEMO | STRANGER, LOGS[2], 2)]


def _ended(records, **third):
    """Scene, logs, search space and attempt of a search that takes the data's own start alone."""
    logs = [{"path": f"log_{i}.csv", "drive_speed": log[0]} for i, log in enumerate(LOGS, 1)][: len(records)]
    logs[-1] |= third
    scene = Scene.from_document({"effects": list(NAMES), "rig": RIG, "logs": logs})
    unknowns = from_scene(scene)
    prepared = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, records, strict=True)]
    return scene, prepared, unknowns, search(SearchProblem(prepared, unknowns, thorough=False))[0]


def _disagreement(records, **third):
    scene, prepared, unknowns, attempt = _ended(records, **third)
    assert attempt is None or attempt.gate.status is not Status.CONVERGED
    return disagreement(scene, records, as_it_ended(scene, unknowns, prepared, attempt))


def _no_fit(*_arguments, **_more):
    raise AssertionError("no fit is spent on this")


def test_a_log_of_another_pair_is_named(with_a_stranger, monkeypatch):
    scene, prepared, unknowns, attempt = _ended(with_a_stranger)
    monkeypatch.setattr(diagnosis, "GROSS", ())  # none of them explains it, and each takes a fit
    monkeypatch.setattr(diagnosis, "SLIGHT", ())
    cause = diagnose(scene, with_a_stranger, prepared, unknowns, attempt)
    assert cause is not None and cause.better is None
    assert cause.sentence.startswith("log_3.csv does not agree with the others: without it they fit within the noise")
    assert "fit it apart" in cause.sentence, "it says what to do"


def test_two_logs_that_differ_name_neither(with_a_stranger, monkeypatch):
    monkeypatch.setattr(disagreeing, "fit_model", _no_fit)
    assert _disagreement(with_a_stranger[1:]) is None


def test_logs_that_only_their_noise_tells_apart_name_none(of_one_pair, monkeypatch):
    scene, prepared, unknowns, attempt = _ended(of_one_pair)
    assert attempt.gate.status is Status.CONVERGED
    monkeypatch.setattr(disagreeing, "fit_model", _no_fit)
    assert disagreement(scene, of_one_pair, as_it_ended(scene, unknowns, prepared, attempt)) is None


def test_logs_that_agree_at_an_answer_the_search_missed_are_not_blamed(of_one_pair):
    scene, prepared, unknowns, attempt = _ended(of_one_pair)
    lost = replace(attempt, gate=replace(attempt.gate, z=np.full(attempt.gate.z.size, 100.0)))
    cause = disagreement(scene, of_one_pair, as_it_ended(scene, unknowns, prepared, lost))
    assert cause is not None and "does not agree" not in cause.sentence
    assert cause.better is not None and cause.better.gate.status is Status.CONVERGED


def test_a_log_whose_noise_is_stated_wrongly_is_not_a_stranger(of_one_pair):
    assert _disagreement(of_one_pair, noise=NOISE / 2) is None


def test_a_missed_slip_makes_no_stranger(of_one_pair):
    time, force = of_one_pair[2].time, of_one_pair[2].friction_force.copy()
    inside = (time > 0.7) & (time < 0.78)
    force[inside] = np.interp(time[inside], time[~inside], force[~inside])
    hidden = [*of_one_pair[:2], Record(time, of_one_pair[2].normal_force, force)]
    assert _disagreement(hidden) is None


@pytest.mark.parametrize(("speeds", "law"), [((1e-4, 1e-3, 5e-3), True), ((1e-4, 5.2e-3, 5e-3), False)])
def test_a_log_alone_at_its_speed_may_tell_another_law(speeds, law):
    """What friction does at a speed that no other log has, the others cannot tell."""
    logs = [{"path": f"log_{i}.csv", "drive_speed": v} for i, v in enumerate(speeds, 1)]
    scene = Scene.from_document({"effects": list(NAMES), "rig": RIG, "logs": logs})
    told = disagreeing._law(scene, [([2], 9.0)], [[0], [1], [2]])
    assert ("another law" in told) is law and bool(told) is law
    programme = ((0.0, speeds[1]), (1.0, 0.0), (2.0, speeds[2]))
    stepped = replace(scene, logs=(scene.logs[0], replace(scene.logs[1], drive_speed=programme), scene.logs[2]))
    assert disagreeing._law(stepped, [([2], 9.0)], [[0], [1], [2]]) == ""
