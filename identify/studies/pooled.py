"""One quantity pooled over fits: means of people and groups, all differences with a verdict, scatter.

The fits of one person in one group are averaged first, so that thirty logs of one person count as one person. The
person means go through a two-way analysis of variance: groups, with people as blocks where the same people were
measured in several groups. Differences carry Tukey's simultaneous intervals (Tukey 1949, Kramer 1956), those of two
groups of different people Welch's; the mean of a group the t interval of its person means.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.special import stdtr
from scipy.stats import studentized_range

from identify.base.errors import IdentifyError
from identify.base.quantiles import LEVEL, chi_square, student

Array = NDArray[np.float64]
T = TypeVar("T")

DIFFERENT, NOT_DISTINGUISHED, NOT_TESTED = "different", "not distinguished", "not tested"
MOST_GROUPS = 30  # beyond these, pairs are too many to be compared
RELATIVE_RANK = 1e-8  # of the largest singular value: columns of a design below it are combinations of the others
ROUNDING = 1e-12  # of the largest value: scatter below it is rounding
MOST_ERRORS, LEAST_P = 40.0, 1e-12  # ends of the table of probabilities: difference in standard errors, probability


class PoolingError(IdentifyError):
    """These fits cannot be pooled; the text is one sentence."""


@dataclass(frozen=True)
class Setting:
    """What is known of n fits: group (n,) labels; subject (n,): whose fit it is, None where unknown."""

    group: tuple[str, ...]
    subject: tuple[str, ...] | None = None

    def rows(self, kept: Sequence[int]) -> Setting:
        """The same of some of the fits, by index."""
        return Setting(
            tuple(self.group[i] for i in kept),
            None if self.subject is None else tuple(self.subject[i] for i in kept),
        )


@dataclass(frozen=True)
class Mean:
    """The mean of a group: value, standard error, degrees of freedom, 95 % interval (None: open, and why);
    fits and subjects behind it (subjects None: unknown); scatter: standard deviation of its fits, None of one."""

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
    reason; shared: subjects that have both groups; groups, family: how many groups and quantities are compared."""

    first: str
    second: str
    value: float
    error: float
    df: float
    interval: tuple[float, float] | None
    reason: str
    shared: int | None
    groups: int
    family: int

    @property
    def verdict(self) -> str:
        """Whether the interval leaves out zero."""
        if self.interval is None:
            return NOT_TESTED
        return DIFFERENT if self.interval[0] > 0.0 or self.interval[1] < 0.0 else NOT_DISTINGUISHED

    @property
    def p(self) -> float | None:
        """The probability of at least so large a difference somewhere in the family if all were equal."""
        if self.interval is None:
            return None
        t = abs(self.value) / self.error
        if self.groups == 2:
            return min(1.0, self.family * 2.0 * float(stdtr(self.df, -t)))
        return min(1.0, self.family * float(np.exp(_log_exceeded(self.groups, self.df)(min(t, MOST_ERRORS)))))


@dataclass(frozen=True)
class VarianceParts:
    """Standard deviations, in the units of y; None where these fits do not show them.

    subject: between people of one group; run: between runs of one person; fit: root mean square of the errors of the
    fits; repeatability: of one fit on repetition (run and fit), with its 95 % interval; intraclass: share of the
    variance within a group that is between people.
    """

    subject: float | None
    fit: float
    run: float | None = None
    repeatability: float | None = None
    repeatability_interval: tuple[float, float] | None = None
    intraclass: float | None = None


@dataclass(frozen=True)
class Pooled:
    """A pooled quantity of the n fits that have it.

    rows (n,): their indices among all fits; y (n,): their values; differences: of all pairs, none beyond MOST_GROUPS.
    """

    rows: tuple[int, ...]
    y: Array
    groups: tuple[str, ...]
    means: tuple[Mean, ...]
    differences: tuple[Difference, ...]
    scatter: VarianceParts

    def mean_of(self, group: str) -> Mean:
        """The mean of one of the groups."""
        return self.means[self.groups.index(group)]


def pool(y: Array, noise: Array, setting: Setting, family: int = 1) -> Pooled:
    """Pool one quantity.

    Parameters
    ----------
    y : (n,) array
        Its value in every fit, NaN where a fit does not have it.
    noise : (n,) array
        Variance of the error of each fit.
    setting : Setting
        Labels of all n fits.
    family : int
        Quantities that are compared together; their intervals hold at once (Bonferroni over quantities, Tukey over
        pairs of groups).

    Raises
    ------
    PoolingError
        Nothing shows the scatter between people.
    """
    rows = np.flatnonzero(np.isfinite(y) & np.isfinite(noise) & (noise >= 0.0))
    kept = setting.rows(rows.tolist())
    known = kept.subject is not None
    values, groups = np.asarray(y, float)[rows], tuple(dict.fromkeys(kept.group))
    people = kept.subject or tuple(map(str, range(len(rows))))
    cells, at = _numbered(list(zip(kept.group, people, strict=True)))  # person means, and that of each fit
    group_at, person_at = np.array([groups.index(group) for group, _ in cells]), _numbered([p for _, p in cells])[1]
    if not len(cells) or np.bincount(group_at).max() < 2:
        who, lacking = ("fits of two people", "people") if known else ("two fits", "runs")
        raise PoolingError(
            f"no group has {who}, so that nothing shows the scatter between {lacking}; add {lacking} to each group"
        )
    X, in_groups = _indicators(group_at), np.bincount(person_at)
    if 2 * np.count_nonzero(in_groups > 1) > len(in_groups):  # people as blocks where most are in several groups
        people_X = _indicators(person_at)
        X = np.hstack([X, people_X[:, 1:] - people_X[:, :1]])
    person = _averages(values, at)
    means = tuple(
        _mean(group, person[group_at == k], values[group_at[at] == k], known) for k, group in enumerate(groups)
    )
    between = _rest(person, group_at) / (len(cells) - len(groups))
    squares, run_df = _rest(values, at), len(values) - len(cells)
    run, per_person = squares / run_df if run_df else 0.0, float(np.mean(1.0 / np.bincount(at)))
    subject, error = max(between - run * per_person, 0.0), float(np.mean(noise[rows]))
    scatter = VarianceParts(math.sqrt(subject) if known else None, math.sqrt(error))
    if run_df:
        low, high = (math.sqrt(squares / chi_square(q, run_df)) for q in (0.5 + LEVEL / 2, 0.5 - LEVEL / 2))
        share = subject / (subject + run) if known and subject + run > 0.0 else None
        alone = math.sqrt(max(run - error, 0.0))
        scatter = VarianceParts(scatter.subject, scatter.fit, alone, math.sqrt(run), (low, high), share)
    return Pooled(
        rows=tuple(rows.tolist()),
        y=values,
        groups=groups,
        means=means,
        differences=_differences(means, person, X, cells, family),
        scatter=scatter,
    )


def _numbered(labels: Sequence[T]) -> tuple[list[T], NDArray[np.int64]]:
    """The different labels in the order of first appearance, and the number of each one's."""
    codes, different = pd.factorize(pd.Series(list(labels), dtype=object))
    return list(different), codes.astype(np.int64)


def _averages(values: Array, numbers: NDArray[np.int64]) -> Array:
    """The mean of the values of each number."""
    return np.asarray(np.bincount(numbers, values) / np.bincount(numbers), dtype=np.float64)


def _rest(values: Array, numbers: NDArray[np.int64]) -> float:
    """The sum of squares about the means of each number."""
    return float(np.sum((values - _averages(values, numbers)[numbers]) ** 2))


def _indicators(numbers: NDArray[np.int64]) -> Array:
    """One column per number: shape (n, levels)."""
    return np.asarray(numbers[:, None] == np.arange(numbers.max() + 1)[None, :], dtype=np.float64)


def _mean(group: str, people: Array, fits: Array, known: bool) -> Mean:
    """The mean of a group from its person means, with the t interval."""
    n, value = len(people), float(np.mean(people))
    scatter = float(np.std(fits, ddof=1)) if len(fits) > 1 else None
    subjects = n if known else None
    if n < 2:
        reason = f"one subject only with {group}: {len(fits)} fits of one person do not show how people differ"
        reason = reason if known else f"one fit only with {group}"
        return Mean(group, value, math.nan, 0.0, None, reason, len(fits), subjects, scatter)
    error = float(np.std(people, ddof=1)) / math.sqrt(n)
    half = float(student(0.5 + LEVEL / 2, n - 1)) * error
    return Mean(group, value, error, n - 1.0, (value - half, value + half), "", len(fits), subjects, scatter)


@lru_cache(maxsize=256)
def _log_exceeded(groups: int, df: float) -> PchipInterpolator:
    """The logarithm of the probability that some pair of so many equal means differs by more than so many standard
    errors, interpolated: scipy takes 30 ms for one value."""
    t = np.linspace(0.0, math.sqrt(MOST_ERRORS), 24) ** 2
    p = studentized_range.sf(math.sqrt(2.0) * t, groups, df)
    return PchipInterpolator(t, np.log(np.clip(p, LEAST_P, 1.0)))


@lru_cache(maxsize=256)
def _critical(groups: int, df: float, level: float) -> float:
    """What all pairs of so many equal means stay below, in standard errors of a difference."""
    if groups == 2:
        return float(student(0.5 + 0.5 * level, df))
    return float(studentized_range.ppf(level, groups, df) / math.sqrt(2.0))


def _differences(
    means: Sequence[Mean], level: Array, X: Array, cells: Sequence[tuple[str, str]], family: int
) -> tuple[Difference, ...]:
    """All pairs; simultaneous over the groups of two people and more and over `family` quantities. Two groups of
    different people are compared as Welch does (1947), each with its own scatter."""
    if len(means) > MOST_GROUPS:
        return ()
    df = float(len(level) - np.linalg.matrix_rank(X))
    beta = np.linalg.lstsq(X, level, rcond=RELATIVE_RANK)[0]
    rest = level - X @ beta
    variance = max(float(rest @ rest) / max(df, 1.0), (ROUNDING * float(np.max(np.abs(level)))) ** 2)
    inverse = np.linalg.pinv(X.T @ X, rcond=RELATIVE_RANK, hermitian=True)
    estimable = inverse @ (X.T @ X)
    tested = sum(not m.reason for m in means)
    whose = {m.group: {person for group, person in cells if group == m.group} for m in means}
    out = []
    for (i, a), (j, b) in combinations(enumerate(means), 2):
        c = np.zeros(X.shape[1])
        c[i], c[j] = 1.0, -1.0
        value, error = float(c @ beta), math.sqrt(variance * float(c @ inverse @ c))
        reason = a.reason or b.reason or ("too few fits to show the scatter" if df < 1.0 else "")
        if not reason and np.max(np.abs(c @ estimable - c)) > RELATIVE_RANK:
            reason = "no people join these two groups"
        if not reason and X.shape[1] == 2 and math.hypot(a.error, b.error) > ROUNDING * abs(value):
            error = math.hypot(a.error, b.error)
            df = error**4 / (a.error**4 / a.df + b.error**4 / b.df)
        half = math.nan if reason else _critical(tested, df, 1.0 - (1.0 - LEVEL) / family) * error
        ends = None if reason else (value - half, value + half)
        shared = None if a.subjects is None else len(whose[a.group] & whose[b.group])
        out.append(Difference(a.group, b.group, value, error, df, ends, reason, shared, tested, family))
    return tuple(out)
