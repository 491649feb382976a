"""Strength that differs from stick to stick: its scatter against closed forms, and recovered from another simulator."""

from __future__ import annotations

from dataclasses import replace

import pytest

from experiments.case_variants import with_scatter
from experiments.study_problem import DEMO as TRUTH
from experiments.study_problem import RIG, Case, scene_of
from identify import fit

pytestmark = pytest.mark.usefixtures("no_predictions")

SPEEDS = ((1e-4, 20.0, 500.0), (1e-3, 2.0, 1000.0), (5e-3, 0.8, 2000.0))
SCATTER = 0.01


@pytest.fixture(scope="module")
def logs():
    case = Case(TRUTH, RIG, (), (), False)
    scene = scene_of(case)
    return replace(scene, logs=scene.logs[1:]), with_scatter(case, SPEEDS, SCATTER, seed=4)


def test_six_parameters_and_the_scatter_are_recovered(logs):
    result = fit(*logs).result
    assert result["status"] == "converged"
    assert "strength (mu_s - mu_k0) differs from stick to stick by" in result["message"]
    assert SCATTER / 1.5 < result["gate"]["strength_scatter"] < SCATTER * 1.5
    for name, true in TRUTH.items():
        told = result["parameters"][name]
        assert told["verdict"] == "identified"
        assert abs(told["value"] - true) < 3.0 * told["standard_error"]
