"""Linear algebra to be trusted: sums with their rounding errors (Dekker, Knuth), factors of optimality conditions."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import lu_solve
from scipy.linalg.lapack import dgetrf
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]
SPLITTER = 2.0**27 + 1.0


def one_plus_two_products(a: Array, b: Array) -> Array:
    """1 + 2 a b + b^2, to the last digits also where the terms nearly cancel (plain where squares overflow)."""

    def halves(x: Array) -> tuple[Array, Array]:
        high = SPLITTER * x - (SPLITTER * x - x)
        return high, x - high

    total, lost = np.ones_like(a * b), np.zeros_like(a * b)
    for left, right in ((b, b), (2.0 * a, b)):
        term, (l_high, l_low), (r_high, r_low) = left * right, halves(left), halves(right)
        lost = lost + (((l_high * r_high - term) + l_high * r_low + l_low * r_high) + l_low * r_low)  # of the product
        before, total = total, total + term
        kept = total - before
        lost = lost + ((before - (total - kept)) + (term - kept))  # of the sum
    value = total + lost
    return np.where(np.isfinite(value), value, 1.0 + b * (2.0 * a + b))


# The matrix of the optimality conditions, factored so that its answers can be trusted.
#
# A plain sparse LU of such a matrix is wrong by orders of magnitude; symmetric Ruiz equilibration mends that. What all
# samples depend on, the parameters, fills its factors; they are bordered: eliminated last, by a small dense matrix.

SWEEPS = 10
CROWDED = 20.0  # times the entries of the median column: a column that is bordered
MOST = 60  # columns that are bordered
TRUSTED = 1e-10  # backward error: where the matrix without the bordered columns is nearly singular, no answer is right


class Factors:
    """A symmetric indefinite sparse matrix (n, n), equilibrated and factored once, solved many times."""

    def __init__(self, matrix: sp.csc_matrix) -> None:
        scaled = matrix.tocsc(copy=True)
        size, scale = np.abs(scaled.data), np.ones(scaled.shape[0])
        lengths = np.diff(scaled.indptr)
        held = np.flatnonzero(lengths)  # columns without entries stay as they are
        begins = scaled.indptr[held]
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite makes answers that are not
            for _ in range(SWEEPS if held.size else 0):
                # Rows are as large as columns: it is symmetric.
                largest = np.maximum.reduceat(size * scale[scaled.indices], begins) * scale[held]
                scale[held] /= np.sqrt(np.where(largest > 0, largest, 1.0))
            scaled.data *= scale[scaled.indices] * np.repeat(scale, lengths)
        self._scale, self._scaled = scale, scaled
        self._factors = _Bordered.of(scaled) or splu(scaled)

    def solve(self, right: Array) -> Array:
        """x of matrix x = right, (n,) or (n, k), with one step of refinement; not finite where the matrix is
        singular."""
        scale = self._scale if right.ndim == 1 else self._scale[:, None]
        b = scale * right
        with np.errstate(over="ignore", invalid="ignore"):
            x = self._refined(b)
            if isinstance(self._factors, _Bordered) and self._error(x, b) > TRUSTED:
                with suppress(RuntimeError):  # SuperLU's only word for a pivot of zero
                    self._factors = splu(self._scaled)
                    x = self._refined(b)
            return np.asarray(scale * x)

    def _refined(self, b: Array) -> Array:
        x = self._factors.solve(b)
        return np.asarray(x + self._factors.solve(b - self._scaled @ x))

    def _error(self, x: Array, b: Array) -> float:
        """The backward error: the smallest change of matrix and right side, relative, for which x is the answer."""
        left = np.max(np.abs(b - self._scaled @ x), axis=0, initial=0.0)
        size = np.max(np.abs(self._scaled.data), initial=0.0) * np.max(np.abs(x), axis=0, initial=0.0)
        size = size + np.max(np.abs(b), axis=0, initial=0.0)
        return float(np.max(np.divide(left, size, out=np.zeros_like(left), where=size != 0.0), initial=0.0))


class _Bordered:
    """[[A, B], [B^T, C]] with a sparse A and few columns in B, by the Schur complement C - B^T A^-1 B."""

    def __init__(self, matrix: sp.csc_matrix, crowded: NDArray[np.bool_]) -> None:
        self._inner, self._outer = np.flatnonzero(~crowded), np.flatnonzero(crowded)
        rows = matrix.tocsr()
        inside, outside = rows[self._inner], rows[self._outer]
        self._border = inside[:, self._outer].toarray()
        self._factors = splu(inside[:, self._inner].tocsc())
        self._reached = self._factors.solve(self._border)
        schur = outside[:, self._outer].toarray() - self._border.T @ self._reached
        # Unlike lu_factor it does not print that a matrix is singular: the answers say so.
        self._schur = dgetrf(schur)[:2]

    @classmethod
    def of(cls, matrix: sp.csc_matrix) -> _Bordered | None:
        """The factors; None where no column stands out or the matrix without those that do is singular."""
        entries = np.diff(matrix.indptr)
        crowded = entries > CROWDED * np.median(entries)
        if not 0 < np.count_nonzero(crowded) <= MOST:
            return None
        try:
            bordered = cls(matrix, crowded)
        except (RuntimeError, ValueError):  # a singular inner matrix
            return None
        return bordered if np.all(np.isfinite(bordered._reached)) else None

    def solve(self, right: Array) -> Array:
        """x (n,) or (n, k) of a right side."""
        out = np.empty_like(right)
        alone = self._factors.solve(right[self._inner])
        out[self._outer] = lu_solve(self._schur, right[self._outer] - self._border.T @ alone, check_finite=False)
        out[self._inner] = alone - self._reached @ out[self._outer]
        return out


def keep_freed_memory() -> None:
    """Let the process keep up to 64 MB that it has freed.

    glibc hands arrays of some megabytes back to the system and then takes a page fault for every 4 KB of the next one:
    an eighth of the time of a fit of a million samples. It stops that for blocks as large as one that it has seen come
    and go (M_MMAP_THRESHOLD in mallopt(3)), up to 32 MiB, so one comes and goes here. Others take no notice.
    """
    np.empty(4_000_000)


def optimality_matrix(hessian_upper: sp.csc_matrix, jacobian: sp.csc_matrix) -> sp.csc_matrix:
    """[[H, J^T], [J, 0]] from the upper triangle of H (n, n) and J (m, n)."""
    hessian = hessian_upper + sp.triu(hessian_upper, 1).T
    return sp.bmat([[hessian, jacobian.T], [jacobian, None]], format="csc")


def solve_equilibrated(matrix: sp.csc_matrix, right: Array) -> Array:
    """Solve one symmetric indefinite system (n, n) for right sides (n, k); not finite where it is singular."""
    try:
        return Factors(matrix).solve(right)
    except RuntimeError:  # SuperLU's only word for a pivot of zero
        return np.full(right.shape, np.nan)
