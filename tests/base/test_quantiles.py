"""Quantiles against those of scipy.stats, which takes a third of a second to import and is not imported by a fit."""

import sys
from subprocess import run

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


def test_a_fit_does_not_import_what_a_steady_load_has_no_use_for() -> None:
    """These are a fifth of the import."""
    unused = "scipy.stats", "scipy.signal", "scipy.optimize", "scipy.integrate", "jinja2", "h5py"
    seen = f"import sys, identify.identification; print([m for m in {unused} if m in sys.modules])"
    done = run([sys.executable, "-c", seen], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
