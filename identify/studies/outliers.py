"""Fits that do not belong: each against what all others say of it, the scatter estimated without it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identify.base.quantiles import student_below
from identify.studies.mixed import Mixed, PoolingError, fit_mixed

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
