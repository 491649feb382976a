"""Logs whose slips fall between two samples: the event times of a slip are found by its levels, not by its samples."""

from __future__ import annotations

import numpy as np

from data_io import Record
from experiments.run_recovery_study import Study, fit_case
from experiments.study_problem import DEMO, NOISE, NORMAL_FORCE, RIG, SPEEDS
from identify import Scene, features, passes
from identify.effects import MAIN
from identify.model import assemble
from identify.prepare import prepare
from identify.search import features_of
from identify.simulate import run
from identify.start import GOOD, fit_features
from identify.unknowns import from_scene


def test_events_settle_within_the_slip_where_samples_lie_farther_apart(monkeypatch):
    case, _, _ = Study("usual", rate=0.25).case(28)  # its slowest log at 5 Hz, slips of 35 ms
    found = fit_case(case, None, "data")
    assert found.recovered and max(abs(error) for error in found.errors.values()) < 0.05, found.message
    monkeypatch.setattr(passes, "OF_A_SLIP", np.inf)  # negative control: half a sample is three slips here,
    monkeypatch.setattr(passes, "AT_BOUND", np.inf)  # and an event that goes as far as it can has not arrived
    hasty = fit_case(case, None, "data")
    assert not hasty.recovered and "normal force is off" in hasty.message


def test_the_mean_of_many_falls_knows_how_much_a_few_samples_each_blur_it(monkeypatch):
    """A truth that does not fit the mean waveform is no start: the search would begin somewhere else."""
    (slow, _, hertz), quick = SPEEDS[0], SPEEDS[2]
    unlike = {}
    for timing in (features.TIMING, 0.0):  # negative control: without the blur
        monkeypatch.setattr(features, "TIMING", timing)
        unlike[timing] = _folded(slow, 8000.0, hertz)
    told, untold = unlike.values()
    assert told[0].cycles > 30 and told[1] < GOOD and untold[1] > 10.0 * GOOD
    before = _folded(*quick)[0]
    monkeypatch.setattr(features, "TIMING", 0.3)
    np.testing.assert_allclose(_folded(*quick)[0].sd, before.sd, rtol=0.01)  # well sampled, nothing is blurred


def _folded(speed: float, duration: float, hertz: float) -> tuple[features.Features, float]:
    """The features of one log of the test problem, and the cost per residual of the truth."""
    times = np.arange(round(duration * hertz) + 1) / hertz
    force = run(assemble(MAIN), DEMO | RIG, speed, NORMAL_FORCE, duration).sample(times)["force"]
    force += NOISE * np.random.default_rng(1).standard_normal(times.size)
    record = Record(times, np.full(times.size, NORMAL_FORCE), force)
    scene = Scene.from_document(
        {"effects": list(MAIN), "rig": dict(RIG), "logs": [{"path": "a", "drive_speed": speed}]}
    )
    unknowns = from_scene(scene)
    found, bases = features_of([prepare(scene, scene.logs[0], record, unknowns)])
    truth = unknowns.theta(np.array([(DEMO | RIG)[name] for name in unknowns.names]), bases[0])
    (start,) = fit_features(unknowns, found, bases, truth[None])
    return found[0], start.cost
