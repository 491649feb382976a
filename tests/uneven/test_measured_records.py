"""Measured records: friction that differs from cycle to cycle is noticed, said, and described cycle by cycle."""

import numpy as np
import pytest

from experiments.measured_records import RECORDS, sticks_in
from experiments.measured_records import scene_of as measured_scene
from experiments.study_problem import DEMO, scene_of, simulated_case
from identify import fit
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.uneven.answer import UnevenEstimator
from identify.uneven.estimator import LAW_ERROR, maximise
from identify.uneven.slip_functions import THETA

pytestmark = pytest.mark.usefixtures("shared_machine_code")
measured = pytest.mark.skipif(not RECORDS.is_dir(), reason="the measured records are not beside this checkout")


@pytest.mark.slow  # all of them: sample `measured` of the acceptance table
@measured
def test_a_measured_record_ends_with_numbers_and_the_reason():
    result = fit(measured_scene(("k1002_v42",)), estimator=UnevenEstimator()).result
    assert result["status"] == "converged" and result["estimator"] == "uneven"
    assert "differs from cycle to cycle" in result["message"]


@measured
@pytest.mark.parametrize(
    ("name", "strength", "mass"),
    [pytest.param("k168_v42", 0.020, 0.52, marks=pytest.mark.slow), ("k1002_v42", 0.050, 0.80)],
)
def test_the_estimate_is_near_that_of_another_implementation(name, strength, mass):
    """Of a like likelihood, in another language, damping and law as given; mass as a share of the nominal 30.7 g."""
    maximum = maximise([sticks_in(name, RECORDS)])
    places = [THETA.index(q) for q in ("strength", "mass")]
    assert maximum.converged
    for row, other, more in zip(np.eye(len(THETA))[places], (strength, 0.0307 * mass), (0.0, LAW_ERROR), strict=True):
        low, high = np.exp(maximum.interval(row, more))
        assert low < other < high < 6.0 * low


def test_cycles_that_are_alike_show_no_scatter():
    case = simulated_case(DEMO, 3)
    scene = scene_of(case)
    unknowns = from_scene(scene)
    scatter = [prepare(scene, *pair, unknowns).scatter for pair in zip(scene.logs, case.records, strict=True)]
    assert max(scatter) < 0.02
