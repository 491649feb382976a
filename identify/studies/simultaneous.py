"""Simultaneous intervals: how far the largest of several correlated t statistics reaches.

P(max_j |T_j| <= q) = E over the chi of P(max_j |Z_j| <= q s); the normal directions are a fixed Sobol sequence, and
the chi is integrated in closed form for each of them, so that the answer is smooth in q and the same every time.
With all pairs of independent equal means this is Tukey's studentised range over sqrt(2).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import chdtr, ndtri
from scipy.stats.qmc import Sobol

from identify.base.quantiles import student, student_below

Array = NDArray[np.float64]

POWER = 14  # 2^14 directions
SEED = 20250101
LARGEST_DF = 1e6
BINS, FEW = 256, 300.0


@lru_cache(maxsize=64)
def _largest(rows: bytes, count: int) -> Array:
    """Sorted max_j |Z_j| of the directions, for a correlation matrix given as bytes."""
    R = np.frombuffer(rows).reshape(count, count)
    values, vectors = np.linalg.eigh(R)
    kept = values > 1e-9 * values[-1]
    root = vectors[:, kept] * np.sqrt(values[kept])
    u = Sobol(int(kept.sum()), scramble=True, seed=SEED).random_base2(POWER)
    z = ndtri(np.clip(u, 1e-15, 1 - 1e-15))
    return np.sort(np.max(np.abs(z @ root.T), axis=1))


@lru_cache(maxsize=64)
def _binned(rows: bytes, count: int) -> Array:
    """The means of equal shares of the sorted largest |Z|: as good as all of them under a chi of few freedoms."""
    return np.asarray(_largest(rows, count).reshape(BINS, -1).mean(axis=1))


def _correlation(covariance: Array) -> bytes:
    sd = np.sqrt(np.diag(covariance))
    R = np.round(covariance / np.outer(sd, sd), 6)  # the same designs share their directions
    return np.ascontiguousarray(0.5 * (R + R.T)).tobytes()


def below(q: float, covariance: Array, df: float) -> float:
    """P(max_j |T_j| <= q) for contrasts with this covariance (m, m) and common degrees of freedom."""
    if q <= 0.0:
        return 0.0
    if len(covariance) == 1:
        return 1.0 - 2.0 * student_below(-q, df)
    return _below(q, _correlation(covariance), len(covariance), df)


def _below(q: float, rows: bytes, count: int, df: float) -> float:
    if not df < LARGEST_DF:
        return float(np.mean(_largest(rows, count) <= q))
    largest = _binned(rows, count) if df < FEW else _largest(rows, count)
    return float(1.0 - np.mean(chdtr(df, df * (largest / q) ** 2)))


def critical(covariance: Array, df: float, level: float) -> float:
    """The q that all |T_j| stay below with probability `level`; NaN below half a degree of freedom."""
    if not df >= 0.5:
        return math.nan
    return _critical(_correlation(covariance), len(covariance), float(f"{df:.7g}"), level)


@lru_cache(maxsize=256)
def _critical(rows: bytes, count: int, df: float, level: float) -> float:
    single = float(student(0.5 + level / 2.0, df))
    if count == 1:
        return single
    bonferroni = -float(student((1.0 - level) / (2.0 * count), df))
    ends = 0.98 * single, 1.02 * bonferroni
    return float(brentq(lambda q: _below(q, rows, count, df) - level, *ends, xtol=1e-5))
