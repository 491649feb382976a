"""The score test says to first order what fits with the quantity free say, and nothing where all is right."""

from types import SimpleNamespace

import numpy as np
import pytest

from experiments.study_problem import DEMO, RIG
from identify.diagnosis.quantities import _lagged, held_quantities
from identify.diagnosis.score_test import score_table
from tests.support.two_logs import records, scene, searched


def scores(stated, logs=None):
    attempt, unknowns = searched(stated, logs)
    table = score_table(attempt.solved, held_quantities(attempt, unknowns))
    return table, {(s.column.name, s.log): s for s in table.scores}


@pytest.mark.slow  # in the quick suite a speed and a gain, below
@pytest.mark.parametrize("name", ["mass", "stiffness"])
def test_a_score_is_the_fall_of_chi_squared_of_a_fit_with_the_quantity_free(name):
    """Truth from outside: the likelihood ratio, and the estimate, of a fit that searches the quantity."""
    factor = {"mass": 1.005, "stiffness": 1.002}[name]
    wrong = RIG | {name: factor * RIG[name]}
    held, told = searched(scene(wrong))[0], scores(scene(wrong))[1][name, None]
    free, unknowns = searched(scene(wrong, **{name: {"start": wrong[name]}}))
    theta = free.solved.theta[unknowns.names.index(name)]
    assert told.score == pytest.approx(2.0 * (held.solved.solution.cost - free.solved.solution.cost), rel=0.05)
    assert told.step == pytest.approx(theta, rel=0.1)


def test_the_speed_of_one_log_is_found_with_its_log_to_first_order():
    speeds = scores(scene(times=(1.0, 1.005)))[1]
    speed = speeds["drive_speed", 1]
    assert speed.step == pytest.approx(-np.log(1.005), abs=3.0 * speed.error) and speed.score > 16.0
    assert speeds["drive_speed", 0].score < speed.score and speeds["mass", None].score < speed.score


def test_a_gain_of_the_force_and_a_factor_on_all_speeds_are_one_class():
    """A gain of the force is one of stiffness, mass and damping together; a factor on all speeds is, by a change of the
    unit of length, the same: with the parameters of friction free no data tell the two apart."""
    table, told = scores(scene(RIG | {"stiffness": 1.01 * RIG["stiffness"]}))
    speed, gain = told["drive_speed", None], told["force_gain", None]
    of = [{(one.column.name, one.log) for one in some} for some in table.classes(0.0)]
    assert any({("drive_speed", None), ("force_gain", None)} <= some for some in of)
    assert speed.step == pytest.approx(gain.step, rel=1e-2)
    assert speed.score == pytest.approx(gain.score, rel=1e-2)


def test_where_all_is_as_stated_scores_are_those_of_noise():
    far = [s.score for logs in (None, records(6)) for s in scores(scene(), logs)[0].scores]
    assert max(far) < 16.0
    assert 0.2 < np.mean(far) < 2.5, "squared distances of one degree of freedom each"


def test_a_prior_is_scored_by_how_far_the_data_would_move_its_mean():
    stated = scene(t_cr={"prior": {"mean": 1.1 * DEMO["t_cr"], "sd": 0.01 * DEMO["t_cr"]}})
    told = scores(stated)[1]["t_cr", None]
    free, unknowns = searched(scene())
    theta = free.solved.theta[unknowns.names.index("t_cr")]
    assert np.log(1.1 * DEMO["t_cr"]) + told.step == pytest.approx(theta, abs=0.3 * told.error)


def test_a_lag_is_exact_for_what_is_linear_between_samples():
    log, time, lag = SimpleNamespace(interval=1e-3), np.arange(500) * 1e-3, 7e-3
    np.testing.assert_allclose(_lagged(log, 2.0 * time, lag), 2.0 * (time - lag), atol=1e-12)
    kinked = np.maximum(time - 0.2, 0.0)
    np.testing.assert_allclose(_lagged(log, kinked, lag), kinked - lag * -np.expm1(-kinked / lag), atol=1e-12)
    assert _lagged(log, kinked, 0.0) is kinked
