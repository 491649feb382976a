"""A covariance widened to hold the likely points of a curved likelihood."""

import numpy as np
import pytest

from experiments.run_recovery_study import CLOSE, FAR, Study, fit_case
from identify.examination import worth_a_walk
from identify.uncertainty.widened import ENOUGH, widened

LIMIT = 3.84


def _distances(covariance, away):
    return np.einsum("mi,ij,mj->m", away, np.linalg.inv(covariance), away)


def test_points_within_reach_change_nothing():
    covariance = np.diag([1.0, 4.0])
    np.testing.assert_array_equal(
        widened(covariance, np.array([[1.0, 1.0], [-0.5, 3.0]]), np.full(2, LIMIT)), covariance
    )


def test_one_point_comes_to_lie_at_the_limit_and_only_its_direction_is_widened():
    covariance, far = np.diag([1.0, 4.0]), np.array([[10.0, 0.0]])
    wider = widened(covariance, far, np.array([LIMIT]))
    assert _distances(wider, far)[0] == pytest.approx(LIMIT)
    np.testing.assert_allclose(wider, np.diag([100.0 / LIMIT, 4.0]))


def test_a_banana_is_held_and_nothing_becomes_surer():
    # The points of 2 (y - x^2)^2 / s^2 + x^2 = limit: far outside the paraboloid at the origin.
    s, x = 0.01, np.linspace(-1.9, 1.9, 41)
    away = np.stack([x, x**2], axis=1)
    covariance = np.diag([1.0, s**2])
    assert np.max(_distances(covariance, away)) > 1e4
    wider = widened(covariance, away, np.full(len(away), LIMIT))
    assert np.max(_distances(wider, away)) <= ENOUGH * LIMIT * (1 + 1e-9)
    assert np.min(np.linalg.eigvalsh(wider - covariance)) >= -1e-12


def test_a_bent_ridge_of_ten_percent_is_followed(monkeypatch):
    # Standard error of a 11 %, truth 2.6 of them away: the others follow it on a bent path.
    case, start, _ = Study("usual").case(126)
    assert fit_case(case, start, "data").distance < CLOSE
    monkeypatch.setattr(worth_a_walk, "CURVED", np.inf)
    assert fit_case(case, start, "data").distance > FAR
