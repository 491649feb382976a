"""Factors of the optimality conditions: right where a plain LU is not, and silent where there are none."""

import warnings

import numpy as np
import pytest
import scipy.sparse as sp

from identify.base.linear import Factors, _Bordered, solve_equilibrated


def _bordered(random, size, crowded):
    """A band matrix and a few full columns, its rows scaled over many orders of magnitude; symmetric."""
    dense = np.zeros((size + crowded, size + crowded))
    band = random.standard_normal(size)
    dense[:size, :size] = np.diag(4.0 + band**2) + np.diag(band[1:], 1) + np.diag(band[1:], -1)
    dense[size:, :] = random.standard_normal((crowded, size + crowded))
    dense[:, size:] = dense[size:, :].T
    corner = random.standard_normal((crowded, crowded))
    dense[size:, size:] = corner + corner.T
    scale = 10.0 ** random.uniform(-6, 6, size + crowded)
    return scale[:, None] * dense * scale


@pytest.mark.parametrize("right_sides", [None, 3])
def test_bordered_factors_solve_badly_scaled_systems(right_sides):
    random = np.random.default_rng(1)
    matrix = _bordered(random, 300, 4)
    assert _Bordered.of(sp.csc_matrix(matrix)) is not None, "its full columns stand out"
    x = random.standard_normal(304 if right_sides is None else (304, right_sides))
    scale = np.sqrt(np.abs(np.diag(matrix)))  # unknowns as large as their rows allow
    x = (x.T / scale).T
    found = Factors(sp.csc_matrix(matrix)).solve(matrix @ x)
    np.testing.assert_allclose((found.T * scale).T, (x.T * scale).T, rtol=1e-6, atol=1e-8)


def test_factors_whose_inner_matrix_is_nearly_singular_are_not_trusted():
    """Of a slide-hold-slide record: standard errors came out a million times as large, and profiles found no way."""
    random, size = np.random.default_rng(2), 300
    dense = _bordered(random, size, 4)
    dense /= np.sqrt(np.outer(np.abs(np.diag(dense)), np.abs(np.diag(dense))))
    dense[0, 1] = dense[1, 0] = 0.0
    dense[0, 0] = 1e-14  # what this row says it says through the border
    assert np.linalg.cond(dense) < 1e6, "as a whole it is no hard case"
    matrix, x = sp.csc_matrix(dense), random.standard_normal(size + 4)
    alone, right = _Bordered.of(matrix), dense @ x
    lost = alone.solve(right)
    lost += alone.solve(right - dense @ lost)
    assert np.max(np.abs(lost - x)) > 1e-6, "by its border it is lost"
    np.testing.assert_allclose(Factors(matrix).solve(right), x, atol=1e-9)


def test_a_singular_border_is_told_by_the_answer_alone():
    size = 64  # a power of four: nothing is rounded
    matrix = np.eye(size + 1)
    matrix[size, :size] = matrix[:size, size] = 1.0
    matrix[size, size] = size
    made = _Bordered.of(sp.csc_matrix(matrix))
    assert made is not None and float(made._schur[0][0, 0]) == 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = Factors(sp.csc_matrix(matrix)).solve(np.ones(size + 1))
    assert not np.all(np.isfinite(found))


def test_an_exactly_singular_matrix_has_no_solution_and_no_error():
    """A log of which the model tells nothing: SuperLU raises there, and the fit ended as a defect."""
    matrix = np.diag([1.0, 0.0, 2.0])
    found = solve_equilibrated(sp.csc_matrix(matrix), np.ones((3, 2)))
    assert found.shape == (3, 2) and not np.any(np.isfinite(found))
    with pytest.raises(RuntimeError):
        Factors(sp.csc_matrix(matrix))
