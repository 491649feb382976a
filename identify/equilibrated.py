"""The matrix of the optimality conditions, factored so that its answers can be trusted.

A plain sparse LU of such a matrix is wrong by orders of magnitude; symmetric Ruiz equilibration mends that.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]

SWEEPS = 10


class Factors:
    """A symmetric indefinite sparse matrix (n, n), equilibrated and factored once, solved many times."""

    def __init__(self, matrix: sp.csc_matrix) -> None:
        scale = np.ones(matrix.shape[0])
        scaled = matrix.tocsc(copy=True)
        columns = np.repeat(np.arange(scaled.shape[1]), np.diff(scaled.indptr))
        for _ in range(SWEEPS):
            largest = np.zeros(scaled.shape[0])
            np.maximum.at(largest, scaled.indices, np.abs(scaled.data))
            factor = 1.0 / np.sqrt(np.where(largest > 0, largest, 1.0))
            scale *= factor
            scaled.data *= factor[scaled.indices] * factor[columns]
        self._scale, self._scaled, self._factors = scale, scaled, splu(scaled)

    def solve(self, right: Array) -> Array:
        """x of matrix x = right, (n,) or (n, k), with one step of refinement."""
        scale = self._scale if right.ndim == 1 else self._scale[:, None]
        b = scale * right
        x = self._factors.solve(b)
        x += self._factors.solve(b - self._scaled @ x)
        return np.asarray(scale * x)


def optimality_matrix(hessian_upper: sp.csc_matrix, jacobian: sp.csc_matrix) -> sp.csc_matrix:
    """[[H, J^T], [J, 0]] from the upper triangle of H (n, n) and J (m, n)."""
    hessian = hessian_upper + sp.triu(hessian_upper, 1).T
    return sp.bmat([[hessian, jacobian.T], [jacobian, None]], format="csc")


def solve_equilibrated(matrix: sp.csc_matrix, right: Array) -> Array:
    """Solve one symmetric indefinite system (n, n) for right sides (n, k)."""
    return Factors(matrix).solve(right)
