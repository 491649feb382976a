"""How well the parameters are known: information, covariance, intervals and verdicts.

First, a covariance that holds what a curved likelihood allows: widened until every likely point lies within it.

Where the likelihood is no paraboloid, the covariance of its curvature at the answer leaves out points that the data
find as likely. Profiles walk to such points; the covariance is widened until it holds each, where that takes least of
the variances, and no further.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from identify.base.linear import solve_equilibrated
from identify.base.quantiles import NORMAL
from identify.logs.unknowns import Unknowns
from identify.shooting.layout import kept_parameters
from identify.shooting.shooting import Problem

Array = NDArray[np.float64]

ENOUGH = 1.5  # times the limit that a point's squared distance may have
ROUNDS = 200
ROUNDING = 1e-9
FARTHEST = 20.0  # a logarithm that is farther off than that is open
MIXTURES = np.logspace(-8.0, 4.0, 49)  # of the way across a ridge and the way to a point, by the largest eigenvalue


def widened(covariance: Array, away: Array, limits: Array) -> Array:
    """The covariance (f, f) widened until no squared distance exceeds ENOUGH times its limit.

    Args:
        away: (m, f) likely points, from the answer; limits: (m,) squared distances at which they should lie.
    """
    out = np.array(covariance, float)
    if away.size == 0 or not np.all(np.isfinite(out)):
        return out
    for _ in range(ROUNDS):
        try:
            distances = np.sum(away * np.linalg.solve(out, away.T).T, axis=1)
        except np.linalg.LinAlgError:
            return out
        far = int(np.argmax(distances / limits))
        enough = ENOUGH * limits[far]
        if not distances[far] > enough * (1.0 + ROUNDING):
            return out
        out = out + _least_widening(out, away[far], enough)
    return out


def _least_widening(covariance: Array, away: Array, limit: float) -> Array:
    """The rank-one matrix (f, f) that brings a point (f,) to a squared distance `limit` and widens the variances least.

    A bent ridge leaves the covariance across its narrow directions: to widen it there takes little of any standard
    error, to widen it towards the point itself takes much of all. Of r = (R + mu I)^-1 x, x the point in standard
    errors and R the correlation, mu -> infinity is the latter, a small mu the former, and the r for which the relative
    growths of the variances, k |r|^2, add up to least is one of these (Lagrange's condition).
    """
    sd = np.maximum(np.sqrt(np.diag(covariance)), np.abs(away) / np.sqrt(limit))  # what each needs by itself
    x = away / sd
    sizes, axes = np.linalg.eigh(covariance / np.outer(sd, sd))
    x = axes.T @ x
    excess = float(np.sum(x**2 / sizes)) - limit
    ways = x / (sizes + MIXTURES[:, None] * sizes[-1])  # (mu, f)
    reach, length = ways @ (x / sizes), np.sum(ways**2 / sizes, axis=1)
    room = reach**2 - excess * length  # above nought where some multiple of r brings the point near enough
    factor = excess / np.where(room > 0.0, room, np.nan)
    best = int(np.nanargmin(factor * np.sum(ways**2, axis=1)))
    widest = axes @ ways[best] * sd
    return np.asarray(factor[best] * np.outer(widest, widest))


# ----------------------------------------------------------------------------------------------------------------------
# How well the parameters are known: information, covariance, intervals, verdicts, what rig errors do.
#
# The information matrix of all search variables (rig included) is the Schur complement of the KKT matrix at the
# solution: everything else (states, event times, multipliers) is eliminated. From it follow the covariance of what was
# free, and how it shifts with what was taken as exact.
# ----------------------------------------------------------------------------------------------------------------------

SPEED_STEP = 1e-5  # relative, of the drive speed
IDENTIFIED, WEAK = 0.20, 3.0  # interval ends within 20 % of the value; within a factor 3


@dataclass(frozen=True)
class Information:
    """Information matrix (n_p, n_p) of theta, priors included, and of the data alone; `by_drive_speed` (n_p,) is
    how the gradient with respect to theta changes per relative error of all drive speeds together; `joint`
    (n_p + o, n_p + o) that of theta and of the o parameters that single logs or groups have for themselves; `gradient`
    (n_p,) of the cost with respect to theta, the motion following: at an answer only what was held has any."""

    unknowns: Unknowns
    total: Array
    data: Array
    by_drive_speed: Array
    joint: Array
    gradient: Array

    @property
    def free(self) -> NDArray[np.int64]:
        """Indices of the free parameters."""
        return np.flatnonzero(self.unknowns.free)

    def covariance(self) -> Array:
        """Covariance (f, f) of the free theta; directions the data do not hold have infinite variance."""
        return inverse(self.total[np.ix_(self.free, self.free)])

    def joint_covariance(self) -> Array:
        """Covariance (f + o, f + o) of the free theta and of what single logs or groups have for themselves."""
        n_p = len(self.unknowns.names)
        kept = np.concatenate([self.free, np.arange(n_p, self.joint.shape[0])])
        return inverse(self.joint[np.ix_(kept, kept)])

    def shift(self, column: int) -> Array:
        """How far the free theta (f,) move per unit of a theta that was held."""
        return self._response(self.total[self.free, column])

    def drive_speed_shift(self) -> Array:
        """How far the free theta (f,) move per relative error of all drive speeds together."""
        return self._response(self.by_drive_speed[self.free])

    def _response(self, change: Array) -> Array:
        """The answer of the free theta to a change of their gradient, to first order."""
        block = self.total[np.ix_(self.free, self.free)]
        return np.asarray(-np.linalg.lstsq(block, change, rcond=1e-13)[0])


def information(problem: Problem, z: Array) -> Information:
    """The information matrix at a solution of a problem in which every parameter is an unknown.

    Args:
        z: scaled unknowns (n,).

    Raises:
        ValueError: a problem that leaves parameters out.
    """
    layout = problem.layout
    n_p = len(layout.unknowns.names)
    if layout.free.size != n_p:
        raise ValueError("the information matrix wants a problem with every parameter among its unknowns")
    point = problem.evaluate(z, derivatives=True)
    assert point.hessian is not None and point.jacobian is not None
    upper = point.hessian
    hessian = (upper + sp.triu(upper, 1).T).tocsc()
    jacobian = point.jacobian.tocsc()
    kept = kept_parameters(layout)
    rest = np.setdiff1d(np.arange(layout.size), kept)
    kkt = sp.bmat([[hessian[rest][:, rest], jacobian[:, rest].T], [jacobian[:, rest], None]], format="csc")
    right = sp.vstack([hessian[rest][:, kept], jacobian[:, kept]]).toarray()
    disturbed = problem.driven(1.0 + SPEED_STEP).evaluate(z, derivatives=True)
    assert disturbed.gradient is not None and point.gradient is not None
    change = (disturbed.gradient - point.gradient) / SPEED_STEP
    below = np.concatenate([change[rest], (disturbed.rows - point.rows) / SPEED_STEP])
    left = np.concatenate([point.gradient[rest], point.rows])
    solved = solve_equilibrated(kkt, np.column_stack([right, below, left]))
    schur = hessian[kept][:, kept].toarray() - right.T @ solved[:, : kept.size]
    scale = layout.scale[kept]
    joint = 0.5 * (schur + schur.T) / np.outer(scale, scale)
    by_speed = (change[kept] - right.T @ solved[:, kept.size]) / scale
    gradient = (point.gradient[kept] - right.T @ solved[:, kept.size + 1]) / scale
    total, shared = joint[:n_p, :n_p], by_speed[:n_p]
    if kept.size > n_p:  # what logs have for themselves follows
        across, own = joint[:n_p, n_p:], joint[n_p:, n_p:]
        answer = np.linalg.lstsq(own, np.column_stack([across.T, by_speed[n_p:]]), rcond=1e-13)[0]
        total, shared = total - across @ answer[:, :n_p], shared - across @ answer[:, n_p]
    data = total - layout.unknowns.prior_precision
    return Information(layout.unknowns, total, data, shared, joint, gradient[:n_p])


def inverse(matrix: Array) -> Array:
    """Inverse (n, n) of a positive semidefinite matrix; what it does not hold gets a huge variance, not a small one."""
    diagonal = np.diag(matrix)
    # A parameter without any information: a variance large enough to say so and small enough to compute with.
    scale = 1.0 / np.sqrt(np.maximum(diagonal, max(1e-24 * float(np.max(diagonal)), 1e-24)))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    floor = 1e-13 * max(float(values[-1]), 1.0)  # the largest is 1 and more, but of a matrix that holds nothing
    scaled = vectors @ np.diag(1.0 / np.maximum(values, floor)) @ vectors.T
    return np.asarray(scaled * np.outer(scale, scale))


@dataclass(frozen=True)
class Estimate:
    """One parameter of a finished fit, SI; numbers are None where there is none to give."""

    name: str
    unit: str
    value: float | None
    standard_error: float | None
    lower: float | None
    upper: float | None
    verdict: str
    reason: str


@dataclass(frozen=True)
class Interval:
    """An interval of theta from a profile; None: open."""

    lower: float | None
    upper: float | None


def estimates(
    unknowns: Unknowns,
    theta: Array,
    base: Array,
    covariance: Array,
    *,
    at_bound: Mapping[str, str],
    hints: Mapping[str, str],
    profiles: Mapping[str, Interval],
) -> list[Estimate]:
    """Values, standard errors, 95 % intervals and verdicts of every parameter.

    Args:
        theta: (n_p,); base (n_p,) of the rig the values are given for; covariance (f, f) of the free ones.
        at_bound: sentence per parameter that sits at a bound.
        hints: per parameter, what test would tell it, used where it is not identified.
        profiles: intervals of theta by name, where profiles were run; else from the covariance, from which all
            standard errors are: times their correlations they have to be one.
    """
    values = unknowns.values(theta, base)
    sd = dict(zip(np.flatnonzero(unknowns.free).tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True))
    size_of = sizes(unknowns, values)
    quantile = NORMAL
    out = []
    source = unknowns.source.tolist()
    for i, declared in enumerate(unknowns.model.parameters):
        value, name, unit = float(values[i]), declared.name, declared.unit
        if source[i] != i:
            to, share = source[i], quantile * sd[source[i]]
            followed = profiles.get(unknowns.names[to], Interval(theta[to] - share, theta[to] + share))
            out.append(_tied(unknowns, i, value, base, followed, sd[to], float(size_of[i])))
            continue
        if i not in sd:
            out.append(Estimate(name, unit, value, None, None, None, "fixed", "not estimated"))
            continue
        if name in at_bound:
            out.append(Estimate(name, unit, value, None, None, None, "at bound", at_bound[name]))
            continue
        interval = profiles.get(name, Interval(theta[i] - quantile * sd[i], theta[i] + quantile * sd[i]))
        interval, walled = _within_walls(unknowns, i, interval)
        low, high = (parameter_value(unknowns, i, end, base[i]) for end in (interval.lower, interval.upper))
        verdict = verdict_of(value, low, high, float(size_of[i]), declared.scale == "log")
        prior = _prior_share(unknowns, i, sd[i])
        if verdict == "not identifiable":
            reason = hints.get(name, "these data hold too little on it")
            ends = (_open(low, declared.lower, above=True), _open(high, declared.upper, above=False))
            out.append(Estimate(name, unit, value, None, *ends, verdict, reason))
            continue
        reason = prior = "; ".join(filter(None, (prior, walled)))
        if verdict != "identified":
            reason = "; ".join(filter(None, (hints.get(name, "more cycles would tell"), prior)))
        assert low is not None and high is not None
        error = sd[i] * (value if declared.scale == "log" else 1.0)
        out.append(Estimate(name, unit, value, float(error), low, high, verdict, reason))
    return out


def sizes(unknowns: Unknowns, values: Array) -> Array:
    """What the error of each parameter is judged by (n_p,): its value, and the step of friction for its weakening."""
    mu_s, mu_k0 = (float(values[unknowns.names.index(name)]) for name in ("mu_s", "mu_k0"))
    weakening = np.array([name == "delta_mu_k" for name in unknowns.names])
    return np.where(weakening, abs(mu_s - mu_k0), np.abs(values))


def _tied(
    unknowns: Unknowns, i: int, value: float, base: Array, followed: Interval, sd: float, size: float
) -> Estimate:
    """The estimate of a parameter that follows another one: as sure as that one, whose interval of theta and standard
    deviation are given."""
    declared, to = unknowns.model.parameters[i], int(unknowns.source[i])
    logarithmic, reason = declared.scale == "log", f"tied to {unknowns.names[to]}"
    interval, _ = _within_walls(unknowns, to, followed)
    low, high = (parameter_value(unknowns, i, end, base[i]) for end in (interval.lower, interval.upper))
    verdict = verdict_of(value, low, high, size, logarithmic)
    if verdict == "not identifiable" or low is None or high is None:
        return Estimate(declared.name, declared.unit, value, None, None, None, "not identifiable", reason)
    error = sd * (value if logarithmic else 1.0)
    return Estimate(declared.name, declared.unit, value, float(error), low, high, verdict, reason)


def _within_walls(unknowns: Unknowns, i: int, interval: Interval) -> tuple[Interval, str]:
    """The interval without what the scene's own bounds exclude, and a sentence where they do."""
    lower, upper, said = interval.lower, interval.upper, []
    if unknowns.walls[0, i] and (lower is None or lower <= unknowns.lower[i]):
        lower, said = float(unknowns.lower[i]), ["lower"]
    if unknowns.walls[1, i] and (upper is None or upper >= unknowns.upper[i]):
        upper, said = float(unknowns.upper[i]), [*said, "upper"]
    words = f"its interval ends at the {' and '.join(said)} bound of the scene" if said else ""
    return Interval(lower, upper), words


def parameter_value(unknowns: Unknowns, i: int, theta: float | None, base: float) -> float | None:
    """The parameter value at a theta; None for an open end."""
    if theta is None:
        return None
    if not unknowns.logarithmic[i]:
        return float(base + theta)
    return float(base * math.exp(theta)) if theta < 700 else None


def verdict_of(value: float, low: float | None, high: float | None, size: float, logarithmic: bool) -> str:
    """ "identified", "weak" or "not identifiable" by the ends of a 95 % interval (None: open) and the size that the
    error of the value is judged by."""
    if low is None or high is None:
        return "not identifiable"
    widest = max(value - low, high - value)
    if widest <= IDENTIFIED * size:
        return "identified"
    within = high <= WEAK * value and low >= value / WEAK if logarithmic else widest <= (1 - 1 / WEAK) * size
    return "weak" if within else "not identifiable"


def _open(end: float | None, bound: float, *, above: bool) -> float | None:
    """An interval end that says no more than the admissible box is open."""
    if end is None or not math.isfinite(end):
        return None
    return end if (end > bound if above else end < bound) else None


def _prior_share(unknowns: Unknowns, i: int, sd: float) -> str:
    prior = float(unknowns.prior_deviation[i])
    if not math.isfinite(prior):
        return ""
    return f"its prior (or tolerance) carries {min(100.0, 100 * sd**2 / prior**2):.0f} % of the information"
