"""How pooled quantities hang together: covariance of their means, and of a further person's values about them.

Between two quantities each source of scatter has a covariance. They are found as REML finds the variances: the cross
products y_j' P_j G P_k y_k are set equal to what is expected of them, one small linear system per pair.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import student_below
from identify.studies.mixed import Mixed, PoolingError, Setting, candidates, fit_mixed
from identify.studies.pooled import Pooled

# ----------------------------------------------------------------------------------------------------------------------
# Fits that do not belong: each against what all others say of it, the scatter estimated without it.
# ----------------------------------------------------------------------------------------------------------------------

SUSPECT = 2.5  # studentised residual from which on the scatter is estimated again without the fit
LEVEL = 0.05  # chance of a false alarm anywhere in one quantity
MOST = 40  # fits that are looked at again


@dataclass(frozen=True)
class Outlier:
    """Fit by its place among the rows, how far it is off in standard deviations, and the chance of that in one of
    the n fits."""

    row: int
    z: float
    p: float


def outliers(mixed: Mixed, family: int = 1) -> tuple[Outlier, ...]:
    """The fits whose value is further from what the others predict than chance allows (5 % over all fits, divided by
    `family` quantities), the furthest first.

    The prediction uses the other fits of the same person, so that an odd run is told from an odd person.
    """
    P = mixed.projection
    pull = P @ mixed.y
    own = np.diag(P)
    able = own > 1e-9 * np.max(own)
    z = np.where(able, pull / np.sqrt(np.where(able, own, 1.0)), 0.0)
    order = [i for i in np.argsort(-np.abs(z)) if abs(z[i]) > SUSPECT][:MOST]
    found = [outlier for i in order if (outlier := _again(mixed, int(i))) is not None]
    return tuple(sorted((o for o in found if o.p * family < LEVEL), key=lambda o: o.p))


def _again(mixed: Mixed, row: int) -> Outlier | None:
    """The residual of one fit with the scatter of the others."""
    n, p = mixed.X.shape
    rest = np.arange(n) != row
    if n - 1 <= p or np.linalg.matrix_rank(mixed.X[rest]) < p:
        return None
    parts = [type(c)(c.name, c.Z[rest]) for c in mixed.components]
    try:
        fitted = fit_mixed(mixed.y[rest], mixed.X[rest], mixed.noise[rest], parts)
    except PoolingError:
        return None
    V = np.diag(mixed.noise) + sum(t * c.Z @ c.Z.T for c, t in zip(mixed.components, fitted.theta, strict=True))
    inverse = np.linalg.inv(V)
    VX = inverse @ mixed.X
    P = inverse - VX @ np.linalg.solve(mixed.X.T @ VX, VX.T)
    z = float((P @ mixed.y)[row] / np.sqrt(P[row, row]))
    chance = 2.0 * student_below(-abs(z), n - 1 - p)
    return Outlier(row, z, min(1.0, n * chance))


Array = NDArray[np.float64]


@dataclass(frozen=True)
class Joint:
    """Of m quantities in one group: mean (m,), covariance of the means (m, m), covariance of one more run of one
    more person (m, m), degrees of freedom of each mean (m,)."""

    mean: Array
    covariance: Array
    scatter: Array
    df: Array


class Together:
    """Quantities pooled over the same n fits.

    Args:
        pooled: one per quantity; setting: of all n fits; noise (n, m, m): covariance of each fit's own errors.
    """

    def __init__(self, pooled: Sequence[Pooled], setting: Setting, noise: Array) -> None:
        self._pooled, self._noise = tuple(pooled), np.nan_to_num(noise)
        self._levels = {c.name: c.Z for c in candidates(setting)}
        m = len(self._pooled)
        between = {name: np.zeros((m, m)) for name in self._levels}
        for j in range(m):
            for k in range(j + 1):
                for name, value in self._crossed(j, k).items():
                    between[name][j, k] = between[name][k, j] = value
        self._between = {name: _possible(matrix) for name, matrix in between.items()}

    def group(self, group: str) -> Joint:
        """The quantities of one group; every one of them must have it (ValueError otherwise)."""
        places = [p.design.groups.index(group) for p in self._pooled]
        means = [p.means[place] for p, place in zip(self._pooled, places, strict=True)]
        m = len(means)
        covariance = np.zeros((m, m))
        for j in range(m):
            for k in range(j + 1):
                a = self._pooled[j].mixed.weights[places[j]]
                b = self._pooled[k].mixed.weights[places[k]]
                covariance[j, k] = covariance[k, j] = a @ self._covariance(j, k) @ b
        # each quantity's own analysis knows its error best: small samples are allowed for there
        errors = np.array([mean.error for mean in means])
        size = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
        return Joint(
            mean=np.array([mean.value for mean in means]),
            covariance=covariance / np.outer(size, size) * np.outer(errors, errors),
            scatter=np.asarray(sum(self._between.values())),
            df=np.array([mean.df for mean in means]),
        )

    def _sources(self, j: int, k: int) -> list[str]:
        mine, theirs = ({c.name for c in self._pooled[i].design.components} for i in (j, k))
        return [name for name in self._levels if name in mine and name in theirs]

    def _pair(self, name: str, j: int, k: int) -> Array:
        """Which fits of quantity j share a level with which of k: (n_j, n_k)."""
        Z = self._levels[name]
        return np.asarray(Z[list(self._pooled[j].rows)] @ Z[list(self._pooled[k].rows)].T)

    def _own(self, j: int, k: int) -> Array:
        """Covariance of the fits' own errors between quantities j and k: (n_j, n_k)."""
        rows, columns = (np.array(self._pooled[i].rows) for i in (j, k))
        return np.where(rows[:, None] == columns[None, :], self._noise[rows, j, k][:, None], 0.0)

    def _crossed(self, j: int, k: int) -> dict[str, float]:
        """Covariance of two quantities in each source of scatter."""
        first, second = self._pooled[j].mixed, self._pooled[k].mixed
        if j == k:
            return {c.name: float(t) for c, t in zip(first.components, first.theta, strict=True)}
        names = self._sources(j, k)
        shared = {name: self._pair(name, j, k) for name in names}
        through = {name: first.projection @ G @ second.projection for name, G in shared.items()}
        own = self._own(j, k)
        expected = np.array([[np.sum(through[c] * shared[d]) for d in names] for c in names])
        found = np.array([first.y @ through[c] @ second.y - np.sum(through[c] * own) for c in names])
        return dict(zip(names, np.linalg.lstsq(expected, found, rcond=1e-10)[0].tolist(), strict=True))

    def _covariance(self, j: int, k: int) -> Array:
        V = self._own(j, k)
        for name in self._sources(j, k):
            V = V + self._between[name][j, k] * self._pair(name, j, k)
        return V


def _possible(matrix: Array) -> Array:
    """The nearest covariance with these variances: correlations clipped, no negative eigenvalue."""
    sd = np.sqrt(np.diag(matrix))
    size = np.where(sd > 0.0, sd, 1.0)
    R = np.clip(matrix / np.outer(size, size), -1.0, 1.0)
    np.fill_diagonal(R, 1.0)
    values, vectors = np.linalg.eigh(R)
    R = (vectors * np.maximum(values, 0.0)) @ vectors.T
    ones = np.sqrt(np.diag(R))
    return np.asarray(R / np.outer(ones, ones) * np.outer(sd, sd))
