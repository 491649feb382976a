"""Logs whose slips fall between two samples: the event times of a slip are found by its levels, not by its samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments.judgement import judged
from experiments.run_fit_speed import TRUTH, simulated
from experiments.study_problem import RIG, SPEEDS, recovery_case, scene_of
from identify import Scene, fit
from identify.base.outcome import Status
from identify.effects import MAIN
from identify.estimation import attempt
from identify.estimation.starts import features_of, own_starts
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.shooting import features, passes
from identify.shooting.starts import GOOD, fit_features
from tests.support.taken_logs import taken


@pytest.mark.slow
def test_events_settle_within_the_slip_where_samples_lie_farther_apart(monkeypatch):
    case = recovery_case("usual", 28, rate=0.25)  # its slowest log at 5 Hz, slips of 35 ms
    found = judged(fit(scene_of(case), case.records).result, case.truth)
    assert found["right"], found["message"]
    monkeypatch.setattr(passes, "SAMPLE_OF_A_SLIP", np.inf)  # negative control: half a sample is three slips here,
    monkeypatch.setattr(passes, "AT_BOUND", np.inf)  # and an event that goes as far as it can has not arrived
    logs, unknowns = taken(case.records, SPEEDS, case.truth, case.rig)  # even from the truth
    hasty = attempt.solve_from(logs, attempt.usable(logs), unknowns)
    assert hasty is not None and "normal force is off" in hasty.gate.message


@pytest.mark.slow
def test_samples_that_change_sides_to_and_fro_end_the_passes():
    """Pair 75 at 5 Hz: in every fourth pass the events are where they were. All forty were made: six minutes for
    what takes twenty seconds."""
    case = recovery_case("usual", 75, rate=0.25)
    scene = scene_of(case)
    unknowns = from_scene(scene)
    logs = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, case.records, strict=True)]
    start = replace(unknowns, start=next(own_starts(logs, unknowns)))
    tried = attempt.solve_from(logs, attempt.usable(logs), start)
    assert tried.gate.status is Status.SOLVER_FAILED and "event" in tried.gate.message
    assert tried.solved.passes < 15


def test_the_mean_of_many_falls_knows_how_much_a_few_samples_each_blur_it(monkeypatch):
    """A truth that does not fit the mean waveform is no start: the search would begin somewhere else."""
    blurred, at_once = features.TIMING, 0.0  # negative control: without the blur
    slow, quick = {}, {}
    for timing in (blurred, at_once):
        monkeypatch.setattr(features, "TIMING", timing)
        slow[timing], quick[timing] = _folded(0, 10.0), _folded(2, 1.0)
    assert slow[blurred][1] < GOOD and slow[at_once][1] > 10.0 * GOOD
    np.testing.assert_allclose(
        quick[blurred][0].sd, quick[at_once][0].sd, rtol=0.01
    )  # well sampled, nothing is blurred


def _folded(log: int, length: float) -> tuple[features.Features, float]:
    """The features of one log of the test problem, so many times as long, and the cost per residual of the truth."""
    (record,) = simulated([log], 1.0, length)
    entry = {"path": "a", "drive_speed": SPEEDS[log][0]}
    scene = Scene.from_document({"effects": list(MAIN), "rig": dict(RIG), "logs": [entry]})
    unknowns = from_scene(scene)
    prepared = prepare(scene, scene.logs[0], record, unknowns)
    assert prepared.falls.size > 30 or length == 1.0
    found, bases = features_of([prepared])
    truth = unknowns.theta(np.array([TRUTH[name] for name in unknowns.names]), bases[0])
    (start,) = fit_features(unknowns, found, bases, truth[None])
    return found[0], start.cost
