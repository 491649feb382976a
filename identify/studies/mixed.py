"""A mixed model of one quantity by restricted maximum likelihood, with intervals that are right for few people.

y = X beta + sum_k Z_k u_k + e, u_k ~ N(0, theta_k), e_i ~ N(0, noise_i) with the noise known from each fit.
Covariance of beta and degrees of freedom after Kenward and Roger (1997, Biometrics 53:983), which for one contrast
are Satterthwaite's; in balanced designs both are those of the exact analysis of variance. A component that comes out
as zero keeps its part in the degrees of freedom, so that a lucky draw does not make a test of two people one of many.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from identify.base.errors import IdentifyError

Array = NDArray[np.float64]

STEPS = 200
HALVINGS = 20
SETTLED = 1e-9  # of the restricted log-likelihood, that a full step still gains
GROWTH = 10.0  # times the largest variance, that one step may reach
RIDGE = 1e-10  # of the information on each variance, that keeps a step finite
LEAST_RUN = 1e-12  # of the variance of y: keeps V invertible where no noise is told


class PoolingError(IdentifyError):
    """These fits cannot be pooled; the text is one sentence."""


@dataclass(frozen=True)
class Component:
    """One source of scatter: its name and which level each fit belongs to, indicators of shape (n, q)."""

    name: str
    Z: Array


@dataclass(frozen=True)
class Contrast:
    """One contrast: value, standard error, degrees of freedom."""

    value: float
    error: float
    df: float


@dataclass(frozen=True)
class Mixed:
    """A fitted model. n fits, p fixed effects, K components.

    beta (p,); covariance (p, p): adjusted for the estimated components; plain (p, p): not adjusted; theta (K,):
    variances of the components; theta_covariance (K, K); moves (K, p, p): derivatives of `plain` by theta;
    projection (n, n): P with P X = 0; weights (p, n): beta = weights @ y; likelihood: restricted, logarithm.
    """

    components: tuple[Component, ...]
    y: Array
    X: Array
    noise: Array
    beta: Array
    covariance: Array
    plain: Array
    theta: Array
    theta_covariance: Array
    moves: Array
    projection: Array
    weights: Array
    likelihood: float

    def contrast(self, c: Array) -> Contrast:
        """The combination c (p,) of the fixed effects."""
        variance = float(c @ self.plain @ c)
        slope = np.einsum("i,kij,j->k", c, self.moves, c)
        wobble = float(slope @ self.theta_covariance @ slope)
        df = 2.0 * variance**2 / wobble if wobble > 0.0 else np.inf
        return Contrast(float(c @ self.beta), float(np.sqrt(c @ self.covariance @ c)), df)

    def variance_of(self, name: str) -> float:
        """The variance of a component by name; 0 where the model has none of that name."""
        return sum(float(t) for c, t in zip(self.components, self.theta, strict=True) if c.name == name)


@dataclass(frozen=True)
class _Point:
    """The restricted likelihood at one theta, with what its derivatives need."""

    value: float
    score: Array
    information: Array
    average: Array
    P: Array
    Phi: Array
    VX: Array


def fit_mixed(y: Array, X: Array, noise: Array, components: Sequence[Component]) -> Mixed:
    """Estimate by REML (scoring, variances kept at or above zero).

    Args:
        y (n,), X (n, p) of full rank with p < n, noise (n,): known variances, components: the scatter; the first
        must give every fit a level of its own.

    Raises:
        PoolingError: nothing left over to estimate scatter from, or no convergence.
    """
    n, p = X.shape
    if n <= p:
        raise PoolingError(
            f"{n} fits for {p} means and covariates leave nothing that shows the scatter between runs; expected more "
            "fits: add runs of every group"
        )
    y, noise = np.asarray(y, float), np.asarray(noise, float)
    residual = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
    scale = float(np.sqrt(max(residual @ residual / (n - p), 1e-300)))
    scale = max(scale, float(np.sqrt(np.mean(noise))), 1e-150)
    z, s = y / scale, noise / scale**2
    theta = _scored(z, X, s, [c.Z for c in components])
    point = _point(z, X, s, [c.Z for c in components], theta)
    return _assembled(point, y, X, noise, components, theta, scale)


def _scored(z: Array, X: Array, s: Array, Zs: list[Array]) -> Array:
    """The variances at the top of the restricted likelihood; one at its floor stays there while the slope is down.

    Steps take the average of observed and expected information (Gilmour, Thompson and Cullis 1995), which needs no
    damping where the two differ, as in small studies; where that does not climb, the expected one.
    """
    floor = np.zeros(len(Zs))
    floor[0] = LEAST_RUN
    theta = np.full(len(Zs), 0.5 / len(Zs))
    at = partial(_point, z, X, s, Zs)
    here = at(theta)
    for _ in range(STEPS):
        free = (theta > floor) | (here.score > 0.0)
        climbed = None
        for information in (here.average, here.information):
            move = _move(here.score, information, free)
            if here.score @ move < SETTLED:  # all that a full step could gain
                return theta
            climbed = climbed or _climbed(at, theta, move, floor, here.value)
        if climbed is None:
            return theta
        theta, there = climbed
        if there.value - here.value < SETTLED:
            return theta
        here = there
    raise PoolingError(f"the scatter did not settle in {STEPS} steps; check for copies of one fit among them")


def _move(score: Array, information: Array, free: NDArray[np.bool_]) -> Array:
    move = np.zeros_like(score)
    inner = information[np.ix_(free, free)]
    size = _sizes(inner)
    even = inner / np.outer(size, size) + RIDGE * np.eye(len(inner))
    with np.errstate(over="ignore"):  # what tells nothing of a component moves it as far as it may go
        move[free] = np.linalg.lstsq(even, score[free] / size, rcond=None)[0] / size
    return move


def _sizes(information: Array) -> Array:
    """What evens out the information: variances of runs and of people may lie many decades apart."""
    return np.asarray(np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny)))


def _climbed(
    at: Callable[[Array], _Point], theta: Array, move: Array, floor: Array, value: float
) -> tuple[Array, _Point] | None:
    """Of ever shorter steps that do not lower the likelihood the first that the next one does not better: a step may
    be far too long in one component and climb all the same by what it does to another."""
    ceiling = GROWTH * float(theta.max())
    best: tuple[Array, _Point] | None = None
    for halving in range(HALVINGS):
        moved = np.clip(theta + move / 2.0**halving, floor, ceiling)
        there = at(moved)
        if best is not None and there.value <= best[1].value:
            return best
        if there.value >= value:
            best = moved, there
    return best


def _point(z: Array, X: Array, s: Array, Zs: list[Array], theta: Array) -> _Point:
    V = np.diag(s + theta[0])
    for Z, t in zip(Zs[1:], theta[1:], strict=True):
        V += t * (Z @ Z.T)
    factor = cho_factor(V, lower=True)
    VX = cho_solve(factor, X)
    inner = X.T @ VX
    Phi = np.linalg.inv(inner)
    P = cho_solve(factor, np.eye(len(z))) - VX @ Phi @ VX.T
    Py = P @ z
    value = -np.sum(np.log(np.diag(factor[0]))) - 0.5 * np.linalg.slogdet(inner)[1] - 0.5 * float(z @ Py)
    PZ = [P if k == 0 else P @ Z for k, Z in enumerate(Zs)]
    score = np.empty(len(Zs))
    information = np.empty((len(Zs), len(Zs)))
    pulls = np.stack([Py if k == 0 else Z @ (Z.T @ Py) for k, Z in enumerate(Zs)])  # G P y
    average = 0.5 * pulls @ P @ pulls.T
    for k, Z in enumerate(Zs):
        trace = np.trace(P) if k == 0 else np.sum(Z * PZ[k])
        score[k] = 0.5 * (Py @ pulls[k] - trace)
        for j in range(k + 1):
            across = PZ[k] if j == 0 else Zs[j].T @ PZ[k]
            information[k, j] = information[j, k] = 0.5 * float(np.sum(across**2))
    return _Point(float(value), score, information, average, P, Phi, VX)


def _assembled(
    at: _Point, y: Array, X: Array, noise: Array, components: Sequence[Component], theta: Array, scale: float
) -> Mixed:
    """The model in the units of y, with Kenward and Roger's covariance of beta."""
    size = _sizes(at.information)
    inverted = np.linalg.pinv(at.information / np.outer(size, size), rcond=1e-12, hermitian=True)
    W: Array = np.asarray(inverted / np.outer(size, size), dtype=np.float64)
    parts = [c.Z.T @ at.VX for c in components]  # Z'V^-1 X
    fall = np.stack([part.T @ part for part in parts])  # X'V^-1 G V^-1 X
    moves = np.einsum("ij,kjl,lm->kim", at.Phi, fall, at.Phi)
    # V^-1 from P, so that Q_kj = X'V^-1 G_k V^-1 G_j V^-1 X
    inverse = at.P + at.VX @ at.Phi @ at.VX.T
    through = [c.Z @ part for c, part in zip(components, parts, strict=True)]  # G_k V^-1 X
    grown = np.zeros_like(at.Phi)
    for k in range(len(components)):
        for j in range(len(components)):
            Q = through[k].T @ inverse @ through[j]
            grown += W[k, j] * (Q - fall[k] @ at.Phi @ fall[j])
    adjusted = at.Phi + 2.0 * at.Phi @ grown @ at.Phi
    weights = at.Phi @ at.VX.T
    square = scale**2
    return Mixed(
        components=tuple(components),
        y=y,
        X=X,
        noise=noise,
        beta=weights @ y,
        covariance=square * 0.5 * (adjusted + adjusted.T),
        plain=square * at.Phi,
        theta=square * theta,
        theta_covariance=square**2 * W,
        moves=moves,
        projection=at.P / square,
        weights=weights,
        likelihood=at.value - (len(y) - X.shape[1]) * float(np.log(scale)),
    )


# ----------------------------------------------------------------------------------------------------------------------
# From labels to a design: group means, covariates, and the sources of scatter that these fits can tell apart.
# ----------------------------------------------------------------------------------------------------------------------

RUN, SUBJECT, SUBJECT_BY_GROUP = "run", "subject", "subject by group"
TOLD_APART = 1e-6  # of a component's information, that the others must leave to it


@dataclass(frozen=True)
class Setting:
    """What is known of n fits: group (n,) labels; subject (n,): whose fit it is, None where nobody says;
    factors: further labels that are adjusted for; covariates: numbers that are adjusted for, each (n,)."""

    group: tuple[str, ...]
    subject: tuple[str, ...] | None = None
    factors: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    covariates: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def rows(self, kept: Sequence[int]) -> Setting:
        """The same of some of the fits, by index."""

        def take(labels: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(labels[i] for i in kept)

        return Setting(
            take(self.group),
            None if self.subject is None else take(self.subject),
            {name: take(labels) for name, labels in self.factors.items()},
            {name: tuple(numbers[i] for i in kept) for name, numbers in self.covariates.items()},
        )


@dataclass(frozen=True)
class Design:
    """Fixed effects X (n, p), the first len(groups) columns the means of the groups where all else is average;
    columns: their names; components: sources of scatter; dropped: what cannot be told apart here, and from what."""

    groups: tuple[str, ...]
    X: Array
    columns: tuple[str, ...]
    components: tuple[Component, ...]
    dropped: Mapping[str, str]


def design(setting: Setting) -> Design:
    """The design of a setting; what the labels cannot tell apart is left out and named."""
    groups = tuple(dict.fromkeys(setting.group))
    X, columns, dropped = _fixed(setting, groups)
    kept: list[Component] = []
    for component in candidates(setting):
        reason = _confounded(component, kept, X)
        if reason:
            dropped[component.name] = reason
        else:
            kept.append(component)
    return Design(groups, X, columns, tuple(kept), dropped)


def indicators(labels: Sequence[object]) -> Array:
    """One column per level, in the order of first appearance: shape (n, levels)."""
    levels = {label: k for k, label in enumerate(dict.fromkeys(labels))}
    out = np.zeros((len(labels), len(levels)))
    out[np.arange(len(labels)), [levels[label] for label in labels]] = 1.0
    return out


def _fixed(setting: Setting, groups: tuple[str, ...]) -> tuple[Array, tuple[str, ...], dict[str, str]]:
    X, columns, dropped = indicators(setting.group), list(groups), {}
    extra: list[tuple[str, Array]] = []
    for name, numbers in setting.covariates.items():
        extra.append((name, np.asarray(numbers, float)[:, None]))
    for name, labels in setting.factors.items():
        levels = indicators(labels)
        extra.append((name, levels[:, :-1] - levels[:, -1:]))  # sums to zero: means stand for the average level
    for name, block in extra:
        centred = block - block.mean(axis=0) if name in setting.covariates else block
        joined = np.hstack([X, centred])
        if block.shape[1] == 0 or np.ptp(block) == 0.0:
            dropped[name] = "it is the same in all these fits"
        elif _rank(joined) < joined.shape[1]:
            dropped[name] = "it goes with the groups, so that its part cannot be told from theirs"
        elif joined.shape[1] >= len(setting.group):
            dropped[name] = "there are too few fits to adjust for it"
        else:
            X = joined
            columns += [name] * block.shape[1]
    return X, tuple(columns), dropped


def _rank(X: Array) -> int:
    size = np.sqrt(np.sum(X**2, axis=0))
    return int(np.linalg.matrix_rank(X / np.where(size > 0.0, size, 1.0), tol=1e-8))


def candidates(setting: Setting) -> list[Component]:
    """Every source of scatter that the labels name, whether or not these fits tell it."""
    n = len(setting.group)
    found = [Component(RUN, np.eye(n))]
    if setting.subject is not None:
        found.append(Component(SUBJECT, indicators(setting.subject)))
        crossed = list(zip(setting.subject, setting.group, strict=True))
        found.append(Component(SUBJECT_BY_GROUP, indicators(crossed)))
        for name, labels in setting.factors.items():
            found.append(Component(f"subject by {name}", indicators(list(zip(setting.subject, labels, strict=True)))))
    return found


def _confounded(component: Component, kept: Sequence[Component], X: Array) -> str:
    """Why a source of scatter cannot be told from the others, or nothing."""
    inside = _projected(component.Z, X)
    own = float(np.sum(inside**2))
    if own <= 1e-9 * component.Z.shape[0]:
        return "it goes with the means of the groups"
    others = [_projected(c.Z, X) for c in kept]
    if not others:
        return ""
    gram = np.array([[np.sum(a * b) for a in others] for b in others])
    shared = np.array([np.sum(inside * a) for a in others])
    left = own - shared @ np.linalg.lstsq(gram, shared, rcond=None)[0]
    return "" if left > TOLD_APART * own else f"it goes with {' and '.join(c.name for c in kept)}"


def _projected(Z: Array, X: Array) -> Array:
    """M Z Z' M with M the projection away from X."""
    rest = Z - X @ np.linalg.lstsq(X, Z, rcond=None)[0]
    return np.asarray(rest @ rest.T)
