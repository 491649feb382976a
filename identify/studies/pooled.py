"""One quantity pooled over fits: group means, all their differences with a verdict, scatter and repeatability."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import chdtr, ndtri
from scipy.stats.qmc import Sobol

from identify.base.quantiles import LEVEL, chi_square, student, student_below
from identify.studies.mixed import RUN, SUBJECT, SUBJECT_BY_GROUP, Design, Mixed, Setting, design, fit_mixed

# ----------------------------------------------------------------------------------------------------------------------
# Simultaneous intervals: how far the largest of several correlated t statistics reaches.
#
# P(max_j |T_j| <= q) = E over the chi of P(max_j |Z_j| <= q s); the normal directions are a fixed Sobol sequence, and
# the chi is integrated in closed form for each of them, so that the answer is smooth in q and the same every time. With
# all pairs of independent equal means this is Tukey's studentised range over sqrt(2).
# ----------------------------------------------------------------------------------------------------------------------

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


DIFFERENT, NOT_TOLD_APART, NOT_TESTED = "different", "not told apart", "not tested"
LEAST_DF = 0.9  # below this an interval says nothing
MOST_GROUPS = 30  # beyond these, pairs are too many to be told apart, and to be looked at


@dataclass(frozen=True)
class Mean:
    """The mean of a group: value, standard error, degrees of freedom, 95 % interval (None: open, and why);
    fits and subjects behind it (subjects None: not told); scatter: standard deviation of its fits, None of one."""

    group: str
    value: float
    error: float
    df: float
    interval: tuple[float, float] | None
    reason: str
    fits: int
    subjects: int | None
    scatter: float | None


@dataclass(frozen=True)
class Difference:
    """First group minus second: value, standard error, degrees of freedom, simultaneous interval (None: not tested),
    probability of at least so large a difference somewhere in the family if all were equal, verdict and reason;
    shared: subjects that have both groups."""

    first: str
    second: str
    value: float
    error: float
    df: float
    interval: tuple[float, float] | None
    p: float | None
    verdict: str
    reason: str
    shared: int | None


@dataclass(frozen=True)
class VarianceParts:
    """Standard deviations, in the units of y; None where these fits do not tell.

    between_groups: of the group means, their own errors taken out; subject, subject_by_group, run: the random
    effects; fit: root mean square of the errors of the fits; repeatability: of one fit on repetition (run and fit),
    with its 95 % interval; intraclass: share of the variance within a group that is between subjects.
    """

    between_groups: float | None
    subject: float | None
    subject_by_group: float | None
    run: float
    fit: float
    repeatability: float | None
    repeatability_interval: tuple[float, float] | None
    intraclass: float | None


@dataclass(frozen=True)
class Pooled:
    """A pooled quantity. rows: indices of the fits that tell it; differences: of all pairs, none beyond MOST_GROUPS;
    level: of the simultaneous intervals."""

    rows: tuple[int, ...]
    design: Design
    mixed: Mixed
    means: tuple[Mean, ...]
    differences: tuple[Difference, ...]
    scatter: VarianceParts
    level: float


def pool(y: Array, noise: Array, setting: Setting, family: int = 1) -> Pooled:
    """Pool one quantity.

    Args:
        y (n,): its value in every fit, NaN where a fit does not tell it; noise (n,): known variances of y.
        setting: labels of all n fits.
        family: quantities that are compared together; their intervals hold at once (Bonferroni over quantities,
            exact over pairs of groups).

    Raises:
        PoolingError: too few fits tell it.
    """
    rows = np.flatnonzero(np.isfinite(y) & np.isfinite(noise) & (noise >= 0.0))
    here = setting.rows(rows.tolist())
    plan = design(here)
    mixed = fit_mixed(y[rows], plan.X, noise[rows], plan.components)
    level = 1.0 - (1.0 - LEVEL) / family
    return Pooled(
        rows=tuple(rows.tolist()),
        design=plan,
        mixed=mixed,
        means=tuple(_mean(group, k, mixed, here) for k, group in enumerate(plan.groups)),
        differences=_differences(plan, mixed, here, level),
        scatter=_scatter(plan, mixed, here),
        level=level,
    )


def _count(setting: Setting, group: str) -> tuple[int, int | None]:
    """Fits and subjects of a group."""
    fits = [i for i, g in enumerate(setting.group) if g == group]
    subjects = None if setting.subject is None else len({setting.subject[i] for i in fits})
    return len(fits), subjects


def _mean(group: str, column: int, mixed: Mixed, setting: Setting) -> Mean:
    c = np.zeros(len(mixed.beta))
    c[column] = 1.0
    found = mixed.contrast(c)
    fits, subjects = _count(setting, group)
    reason = _few(group, fits, subjects)
    if not reason and found.df < LEAST_DF:
        reason = "too few fits to tell the scatter"
    half = 0.0 if reason else float(student(0.5 + LEVEL / 2, found.df)) * found.error
    values = mixed.y[[i for i, g in enumerate(setting.group) if g == group]]
    return Mean(
        group,
        found.value,
        found.error,
        found.df,
        None if reason else (found.value - half, found.value + half),
        reason,
        fits,
        subjects,
        float(np.std(values, ddof=1)) if fits > 1 else None,
    )


def _few(group: str, fits: int, subjects: int | None) -> str:
    """Why a group says nothing beyond itself."""
    if subjects == 1:
        return f"one subject only with {group}: a person's fits, {fits} here, say nothing of others"
    return f"one fit only with {group}" if fits == 1 else ""


def _differences(plan: Design, mixed: Mixed, setting: Setting, level: float) -> tuple[Difference, ...]:
    pairs = list(combinations(range(len(plan.groups)), 2)) if len(plan.groups) <= MOST_GROUPS else []
    contrasts = np.zeros((len(pairs), len(mixed.beta)))
    for row, (i, j) in enumerate(pairs):
        contrasts[row, [i, j]] = 1.0, -1.0
    few = {group: _few(group, *_count(setting, group)) for group in plan.groups}
    reasons = [few[plan.groups[i]] or few[plan.groups[j]] for i, j in pairs]
    estimates = [mixed.contrast(c) for c in contrasts]
    reasons = [
        reason or ("too few fits to tell the scatter" if found.df < LEAST_DF else "")
        for reason, found in zip(reasons, estimates, strict=True)
    ]
    tested = contrasts[[not reason for reason in reasons]]
    covariance = tested @ mixed.covariance @ tested.T
    out = []
    for (i, j), found, reason in zip(pairs, estimates, reasons, strict=True):
        a, b = plan.groups[i], plan.groups[j]
        shared = None
        if setting.subject is not None:
            mine = [{s for s, g in zip(setting.subject, setting.group, strict=True) if g == x} for x in (a, b)]
            shared = len(mine[0] & mine[1])
        if reason:
            out.append(Difference(a, b, found.value, found.error, found.df, None, None, NOT_TESTED, reason, shared))
            continue
        half = critical(covariance, found.df, level) * found.error
        share = 1.0 - below(abs(found.value) / found.error, covariance, found.df)
        p = min(1.0, share * (1.0 - LEVEL) / (1.0 - level))
        verdict = DIFFERENT if abs(found.value) > half else NOT_TOLD_APART
        ends = (found.value - half, found.value + half)
        out.append(Difference(a, b, found.value, found.error, found.df, ends, p, verdict, "", shared))
    return tuple(out)


def _scatter(plan: Design, mixed: Mixed, setting: Setting) -> VarianceParts:
    # Whether somebody was measured again under the same conditions, so that runs are told from people.
    subjects = setting.subject or ("",) * len(setting.group)
    conditions = list(zip(subjects, setting.group, *setting.factors.values(), strict=True))
    repeated = len(set(conditions)) < len(conditions)
    names = [c.name for c in plan.components]
    noise = float(np.mean(mixed.noise))
    run = mixed.variance_of(RUN)
    subject = mixed.variance_of(SUBJECT) if SUBJECT in names else None
    crossed = mixed.variance_of(SUBJECT_BY_GROUP) if SUBJECT_BY_GROUP in names else None
    ends = _repeatability_interval(mixed, run + noise) if repeated else None
    between = (subject or 0.0) + (crossed or 0.0)
    tells = repeated and SUBJECT in names and between + run + noise > 0.0
    return VarianceParts(
        between_groups=_between(plan, mixed),
        subject=None if subject is None else float(np.sqrt(subject)),
        subject_by_group=None if crossed is None else float(np.sqrt(crossed)),
        run=float(np.sqrt(run)),
        fit=float(np.sqrt(noise)),
        repeatability=float(np.sqrt(run + noise)) if repeated else None,
        repeatability_interval=ends,
        intraclass=between / (between + run + noise) if tells else None,
    )


def _repeatability_interval(mixed: Mixed, variance: float) -> tuple[float, float] | None:
    wobble = float(mixed.theta_covariance[0, 0])
    if not (wobble > 0.0 and variance > 0.0):
        return None
    df = 2.0 * variance**2 / wobble
    if df < LEAST_DF:
        return None
    low, high = (float(np.sqrt(df * variance / chi_square(q, df))) for q in (0.5 + LEVEL / 2, 0.5 - LEVEL / 2))
    return low, high


def _between(plan: Design, mixed: Mixed) -> float | None:
    """Standard deviation of the group means with the variance of their errors taken out."""
    count = len(plan.groups)
    if count < 2:
        return None
    values, errors = mixed.beta[:count], mixed.plain[:count, :count]
    centre = np.eye(count) - 1.0 / count
    raw = float(values @ centre @ values) / (count - 1)
    return float(np.sqrt(max(raw - float(np.trace(centre @ errors)) / (count - 1), 0.0)))


def predictive(pooled: Pooled, group: str) -> tuple[float, float, float]:
    """Value, standard deviation and degrees of freedom of one more run of one more person of a group."""
    c = np.zeros(len(pooled.mixed.beta))
    c[pooled.design.groups.index(group)] = 1.0
    mixed = pooled.mixed
    spread = float(np.sum(mixed.theta))
    variance = float(c @ mixed.plain @ c) + spread
    slope = np.einsum("i,kij,j->k", c, mixed.moves, c) + 1.0
    wobble = float(slope @ mixed.theta_covariance @ slope)
    df = 2.0 * variance**2 / wobble if wobble > 0.0 else np.inf
    return float(c @ mixed.beta), float(np.sqrt(variance)), df
