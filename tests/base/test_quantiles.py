"""Quantiles against the distributions as mpmath integrates them."""

import sys
from subprocess import run

import mpmath as mp
import pytest

from identify.base import quantiles


def below_normal(z: float) -> mp.mpf:
    return mp.ncdf(z)


def below_student(t: float, freedom: float) -> mp.mpf:
    x = mp.mpf(freedom) / (freedom + mp.mpf(t) ** 2)
    tail = mp.betainc(mp.mpf(freedom) / 2, mp.mpf("0.5"), 0, x, regularized=True) / 2
    return 1 - tail if t > 0 else tail


def above_chi_square(x: float, freedom: float) -> mp.mpf:
    return mp.gammainc(mp.mpf(freedom) / 2, mp.mpf(x) / 2, regularized=True)


@pytest.mark.parametrize("probability", [0.001, 0.05, 0.5, 0.95, 0.975, 1 - 1e-9])
def test_a_normal_deviate_stays_below_its_quantile_that_often(probability: float) -> None:
    assert float(below_normal(quantiles.normal(probability))) == pytest.approx(probability, rel=1e-12)


@pytest.mark.parametrize("probability", [0.025, 0.6, 0.975, 0.9999])
def test_students_t_does_for_every_number_of_freedoms(probability: float) -> None:
    freedoms = [1.0, 2.5, 9.0, 400.0]
    for found, freedom in zip(quantiles.student(probability, freedoms), freedoms, strict=True):
        assert float(below_student(found, freedom)) == pytest.approx(probability, rel=1e-9)
        assert abs(found) > abs(quantiles.normal(probability))  # the tails are heavier
        assert quantiles.student_below(found, freedom) == pytest.approx(probability, rel=1e-12)


@pytest.mark.parametrize("freedom", [1.0, 6.0, 33.0, 30_000.0])
def test_chi_square_does_far_out_in_its_tail_as_well(freedom: float) -> None:
    for probability in (0.5, 0.95, 0.9998):
        found = quantiles.chi_square(probability, freedom)
        assert float(1 - above_chi_square(found, freedom)) == pytest.approx(probability, rel=1e-10)
    for probability in (0.05, 1e-6, 1e-12):
        found = quantiles.chi_square_exceeded(probability, freedom)
        assert float(above_chi_square(found, freedom)) == pytest.approx(probability, rel=1e-8)


def test_beta_does() -> None:
    found = quantiles.beta(0.025, 3.0, 18.0)
    assert float(mp.betainc(3, 18, 0, found, regularized=True)) == pytest.approx(0.025, rel=1e-10)


def test_a_fit_does_not_import_what_a_steady_load_has_no_use_for() -> None:
    """These are a fifth of the import."""
    unused = "scipy.stats", "scipy.signal", "scipy.optimize", "scipy.integrate", "jinja2", "h5py"
    seen = f"import sys, identify.identification; print([m for m in {unused} if m in sys.modules])"
    done = run([sys.executable, "-c", seen], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
