"""Quantiles against those of scipy.stats, which takes a third of a second to import and is not imported by a fit."""

import pytest
from scipy import stats

from identify.base import quantiles


@pytest.mark.parametrize("probability", [0.001, 0.05, 0.5, 0.975, 1 - 1e-9])
def test_each_is_that_of_its_distribution(probability: float) -> None:
    assert quantiles.normal(probability) == pytest.approx(stats.norm.ppf(probability), abs=1e-12)
    freedoms = [1.0, 2.5, 9.0, 400.0]
    for found, freedom in zip(quantiles.student(probability, freedoms), freedoms, strict=True):
        assert found == pytest.approx(stats.t.ppf(probability, freedom), rel=1e-9, abs=1e-12)
        assert quantiles.chi_square(probability, freedom) == pytest.approx(stats.chi2.ppf(probability, freedom))
        assert quantiles.chi_square_exceeded(probability, freedom) == pytest.approx(
            stats.chi2.isf(probability, freedom)
        )
