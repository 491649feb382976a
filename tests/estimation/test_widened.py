"""A covariance widened to hold the likely points of a curved likelihood."""

import numpy as np
import pytest

from experiments.study_problem import Case, recovery_case, scene_of
from identify import fit
from identify.base.quantiles import NORMAL
from identify.estimation import certainty as room
from identify.estimation.covariance import ENOUGH, widened
from identify.identification import find

pytestmark = pytest.mark.usefixtures("no_further_logs")

LIMIT = 3.84
CLOSE, FAR = 22.5, 40.0  # of a joint distance of six


def _distances(covariance, away):
    return np.einsum("mi,ij,mj->m", away, np.linalg.inv(covariance), away)


def test_points_within_reach_change_nothing():
    covariance = np.diag([1.0, 4.0])
    np.testing.assert_array_equal(
        widened(covariance, np.array([[1.0, 1.0], [-0.5, 3.0]]), np.full(2, LIMIT)), covariance
    )


def test_one_point_comes_to_lie_where_it_may_and_only_its_direction_is_widened():
    covariance, far = np.diag([1.0, 4.0]), np.array([[10.0, 0.0]])
    wider = widened(covariance, far, np.array([LIMIT]))
    assert _distances(wider, far)[0] == pytest.approx(ENOUGH * LIMIT)
    np.testing.assert_allclose(wider, np.diag([100.0 / (ENOUGH * LIMIT), 4.0]))


def test_a_banana_is_held_and_nothing_becomes_surer():
    # The points of 2 (y - x^2)^2 / s^2 + x^2 = limit: far outside the paraboloid at the origin.
    s, x = 0.01, np.linspace(-1.9, 1.9, 41)
    away = np.stack([x, x**2], axis=1)
    covariance = np.diag([1.0, s**2])
    assert np.max(_distances(covariance, away)) > 1e4
    wider = widened(covariance, away, np.full(len(away), LIMIT))
    assert np.max(_distances(wider, away)) <= ENOUGH * LIMIT * (1 + 1e-9)
    assert np.min(np.linalg.eigvalsh(wider - covariance)) >= -1e-12


def test_a_bent_ridge_leaves_the_standard_errors_along_it_as_they_are():
    """Two parameters of which one combination is known fifty times better, on a path that bends: draws of it scatter as
    the curvature says. Control: widened towards the points themselves, both would be far too uncertain."""
    axes, s = np.array([[1.0, 1.0], [1.0, -1.0]]) / np.sqrt(2.0), 0.02
    along = np.random.default_rng(1).standard_normal(4000)
    across = 0.1 * along**2 + s * np.random.default_rng(2).standard_normal(along.size)
    drawn = np.stack([along, across], axis=1) @ axes
    covariance = axes.T @ np.diag([1.0, s**2]) @ axes
    away = drawn[np.abs(along) < 2.2][:300]
    limits = np.maximum(along[np.abs(along) < 2.2][:300] ** 2, LIMIT)
    assert np.max(_distances(covariance, away)) > 50 * LIMIT
    wider = widened(covariance, away, limits)
    assert np.max(_distances(wider, away) / limits) <= ENOUGH * (1 + 1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(wider)), np.std(drawn, axis=0), rtol=0.08)
    far = int(np.argmax(_distances(covariance, away) / limits))
    enough, q = ENOUGH * limits[far], _distances(covariance, away)[far]
    towards = covariance + (1.0 / enough - 1.0 / q) * np.outer(away[far], away[far])
    assert np.all(np.sqrt(np.diag(towards)) > 1.15 * np.std(drawn, axis=0))


def joint_distance(case: Case) -> float:
    """(theta - truth)' C^-1 (theta - truth) of all that a fit searches."""
    _, found = find(scene_of(case), case.records)
    unknowns, theta = found.unknowns, found.attempt.solved.theta
    truth = np.array([(case.truth | case.rig)[name] for name in unknowns.names])
    off = (theta - unknowns.theta(truth, unknowns.base(case.rig)))[unknowns.free]
    return float(off @ np.linalg.solve(found.covariance, off))


@pytest.mark.slow
def test_a_bent_ridge_of_ten_percent_is_followed(monkeypatch):
    # Standard error of a 11 %, truth 2.6 of them away: the others follow it on a bent path.
    case = recovery_case("usual", 126)
    assert joint_distance(case) < CLOSE
    monkeypatch.setattr(room, "widened", lambda covariance, *_: covariance)
    assert joint_distance(case) > FAR


@pytest.mark.slow
def test_standard_errors_times_correlations_of_a_result_are_its_covariance(monkeypatch):
    # a follows a bent ridge: by the curvature at the answer alone the truth is far away.
    case = recovery_case("wide", 53)
    told = fit(scene_of(case), case.records).result
    names = told["correlation"]["names"]
    stated = [told["parameters"][n]["standard_error"] for n in names]
    assert told["correlation"]["standard_errors"] == pytest.approx(stated)
    off = np.array([told["parameters"][name]["value"] - case.truth[name] for name in names])

    def distance(told, errors):
        return off @ np.linalg.solve(np.array(told["correlation"]["matrix"]) * np.outer(errors, errors), off)

    errors = np.array(told["correlation"]["standard_errors"])
    assert distance(told, errors) < CLOSE
    ends = np.array([told["parameters"][name]["interval"] for name in names])
    assert np.all(errors <= ENOUGH * (ends[:, 1] - ends[:, 0]) / (2.0 * NORMAL))  # profiles say the same
    monkeypatch.setattr(room, "widened", lambda covariance, *_: covariance)
    curved = fit(scene_of(case), case.records).result
    assert distance(curved, np.array(curved["correlation"]["standard_errors"])) > 2.0 * distance(told, errors)
