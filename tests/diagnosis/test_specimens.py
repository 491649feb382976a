"""Friction that differs from log to log is a random effect: by closed form of the one-way layout, and of specimens."""

import numpy as np
import pytest

from identify.diagnosis.score_test import Column, Score, ScoreTable
from identify.diagnosis.specimens import log_effects


def one_way(means, error):
    """The score table of logs whose means each have an error, about a common mean that is projected out."""
    count = len(means)
    information = (np.eye(count) - 1.0 / count) / error**2
    steps = (means - np.mean(means)) / error**2 / np.diag(information)
    column = Column("load_gain", None, 1.0, "single")
    of_mean = np.full(1, -1.0 / count)
    scores = [Score(column, i, (step / error) ** 2, step, error, step * of_mean) for i, step in enumerate(steps)]
    return ScoreTable(tuple(scores), information)


def test_the_scatter_is_that_of_restricted_likelihood():
    """Of a balanced one-way layout: the mean square between logs less that within (Searle et al. 1992, section 4.4)."""
    means, error = np.array([0.03, -0.05, 0.01, 0.06, -0.02]), 0.01
    found = log_effects(one_way(means, error), np.zeros(5), 1e-4, 1.0, estimated=True)
    variance = np.var(means, ddof=1) - error**2
    assert found.sd == pytest.approx(np.sqrt(variance), rel=1e-2)
    off = means - np.mean(means)
    np.testing.assert_allclose(found.step, off * variance / (variance + error**2), rtol=1e-2)
    # The mean of all has the error of the mean of specimens, of which the error within the logs is known already.
    assert found.added[0, 0] == pytest.approx(variance / 5, rel=1e-2)


def test_a_scatter_is_no_less_than_what_is_usual():
    found = log_effects(one_way(np.array([1e-3, -1e-3, 0.0]), 0.01), np.zeros(3), 0.02, 1.0, estimated=True)
    assert found.sd == pytest.approx(0.02)
