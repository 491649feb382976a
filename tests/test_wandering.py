"""Logs that tell little: the solver wanders off along what they do not tell unless that is held."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from experiments.run_design_study import design, scene_of
from identify.outcome import Status
from identify.prepare import prepare
from identify.search import search
from identify.unknowns import from_scene

ONE_SPEED = 0  # a design of that study whose one drive speed leaves four parameters open


def test_a_log_of_one_speed_is_described_within_its_noise():
    made = design(ONE_SPEED)
    scene = scene_of(made)
    unknowns = from_scene(scene)
    logs = [prepare(scene, entry, record, unknowns) for entry, record in zip(scene.logs, made.records, strict=True)]
    found, left_out = search(logs, unknowns)
    assert found is not None and not left_out
    assert found.gate.status is Status.CONVERGED and found.solved.solution.success
    # What the truth costs is chi squared: no answer is much worse, and none better than all its parameters can make it.
    samples, residual = found.solved.problem.samples, 2.0 * found.solved.solution.cost
    low, high = chi2.ppf((1e-4, 1.0 - 1e-4), samples - np.count_nonzero(unknowns.free))
    assert low < residual < high
