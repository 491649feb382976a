"""Measured records: friction that differs from cycle to cycle is noticed, said, and described cycle by cycle."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.measured_records import RECORDS, halves, sticks_in
from experiments.measured_records import scene_of as measured_scene
from experiments.study_problem import DEMO, scene_of, simulated_case
from identify import fit
from identify.logs.prepare import prepare
from identify.logs.unknowns import from_scene
from identify.uneven.answer import why_withheld
from identify.uneven.estimator import maximise
from identify.uneven.slip_functions import PARAMETERS

pytestmark = pytest.mark.usefixtures("shared_machine_code")
measured = pytest.mark.skipif(not RECORDS.is_dir(), reason="the measured records are not beside this checkout")


@measured
def test_a_measured_record_ends_with_numbers_and_the_reason():
    result = fit(replace(measured_scene(("k1002_v42",)), time_limit=20.0)).result
    assert result["status"] == "converged" and result["estimator"] == "uneven"
    assert "differs from cycle to cycle" in result["message"]


@measured
@pytest.mark.parametrize(
    ("name", "strength", "mass"),
    [pytest.param("k168_v42", 0.020, 0.52, marks=pytest.mark.slow), ("k1002_v42", 0.050, 0.80)],
)
def test_the_estimate_is_near_that_of_another_implementation(name, strength, mass):
    """Of a like likelihood, in another language; mass as a share of the nominal 30.7 g, deviations below 0.15."""
    maximum = maximise([sticks_in(name, RECORDS)])
    sd = np.sqrt(np.diag(maximum.covariance))
    places = [PARAMETERS.index(q) for q in ("strength", "mass")]
    found = np.exp(maximum.theta[places])
    assert maximum.converged and found == pytest.approx([strength, 0.0307 * mass], rel=0.25)
    if name == "k168_v42" and sd[places[1]] >= 0.15:
        pytest.xfail("of the soft spring the mass is known to 0.155 only (docs/validation.md)")
    assert sd[places].max() < 0.15


@measured
@pytest.mark.slow
def test_halves_of_a_measured_record_agree():
    assert halves(sticks_in("k1002_v42", RECORDS))[1] > 0.05


@measured
@pytest.mark.slow
def test_a_record_that_hides_the_weakening_still_tells_the_mass():
    """Ringing of the same rig: 17 to 22.4 g."""
    sticks = sticks_in("k1002_v4300", RECORDS).part(np.arange(48))
    maximum = maximise([sticks])
    place = PARAMETERS.index("mass")
    mass, sd = np.exp(maximum.theta[place]), np.sqrt(maximum.covariance[place, place])
    assert 0.017 < mass * np.exp(-1.96 * sd) < mass * np.exp(1.96 * sd) < 0.0224
    assert "cannot be told" in why_withheld(maximum, [sticks])


def test_cycles_that_are_alike_show_no_scatter():
    case = simulated_case(DEMO, 3)
    scene = scene_of(case)
    unknowns = from_scene(scene)
    scatter = [prepare(scene, *pair, unknowns).scatter for pair in zip(scene.logs, case.records, strict=True)]
    assert max(scatter) < 0.02
