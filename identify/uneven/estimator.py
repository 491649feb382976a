"""From sticks and slips to parameters of an uneven pair: starts from features, greatest posterior, how sure it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from identify.base.budget import now, seconds_left
from identify.base.quantiles import student
from identify.uneven.events import Sticks
from identify.uneven.likelihood import Likelihood, Nodes
from identify.uneven.slip_functions import PARAMETERS, THETA

Array = NDArray[np.float64]

WIDER = (1e-3, 0.1)  # least and greatest step to either side, between gradients, for second derivatives
SHARE = 0.2  # of a deviation: that step; far closer gradients show the steps in which an onset is followed
ROUNDS = 8  # times that the nodes are narrowed to where the strengths lie
STEPS, TRIED = 60, 10  # of a search on the same nodes, and of one from each start, of which the best goes on
SETTLED = 0.05  # deviations by which parameters move in the last round
LEAST_SD = 0.03  # of the logarithm of a strength: nodes lie no closer together, unless strengths scatter by less
WEAK = 3.0  # sd of the prior about the features: it stops what the record does not tell, and nothing else
SEARCH_SHARE = 0.7  # of the time that is left: the rest is for the covariance
DAMPING = (float(np.log(0.05)), float(np.log(3.0)))  # prior on the logarithm of the damping ratio, where none is stated
SPEED_TERM = 0.3  # sd of the prior on the damping ratio that friction in proportion to sliding speed makes
SHAPE = 0.7  # sd of that on the shape of the weakening: 0.6 of the way to exponential, or to staying and then falling
# By how much speed term and shape come out wrong on simulated tracks beyond what their likelihood knows: how a slip
# begins among spots of unlike strength is followed by its mean only (docs/validation.md, Simulated uneven records).
BIAS = np.array([0.0, 0.1, 0.5])
# Starts: mass over k pace^2, weakening rate over stiffness, speed term, strength over half the drop.
STARTS = ((0.8, 3.0, 0.0, 1.0), (0.4, 1.5, 0.0, 1.0), (0.5, 3.0, 0.4, 1.5))
LAW = len(PARAMETERS)  # entries of theta before the nuisances


@dataclass(frozen=True)
class Prior:
    """Independent normal priors on theta: mean, sd (10,)."""

    mean: Array
    sd: Array

    @property
    def precision(self) -> Array:
        """Its inverse covariance (10, 10)."""
        return np.diag(self.sd**-2.0)

    def logarithm(self, theta: Array) -> tuple[float, Array]:
        """Up to a constant, and its gradient (10,)."""
        off = (theta - self.mean) / self.sd
        return -0.5 * float(off @ off), -off / self.sd

    @staticmethod
    def of(records: Sequence[Sticks], stated: Mapping[str, tuple[float, float]]) -> Prior:
        """Weak ones about the features of records, and those of rigs and frictions at large; stated: mean and sd of
        entries of theta, by name, that the scene gives instead."""
        mean, sd = features(records), np.full(len(THETA), WEAK)
        sd[LAW:] = DAMPING[1], SPEED_TERM, SHAPE
        for name, (value, error) in stated.items():
            mean[THETA.index(name)], sd[THETA.index(name)] = value, error
        return Prior(mean, sd)


@dataclass(frozen=True)
class Maximum:
    """Where the posterior of records is greatest.

    Attributes:
        prior: on theta; theta (10,): as THETA has it; covariance (10, 10): per entry the larger of the Hessian's and
            the sandwich's; held (10,): the greatest posterior with the nuisances at the means of their priors.
        log_likelihood: without the prior; scores (c, 10); converged; in_time: whether the search ended before its time
            was up; evaluations: passes over the records; nodes: per record.
        bias (3,): standard error of the nuisances beyond their covariance.
        starts: logarithm of the posterior, up to a constant, that the first steps from every start reached.
    """

    prior: Prior
    theta: Array
    covariance: Array
    held: Array
    log_likelihood: float
    scores: Array
    converged: bool
    in_time: bool
    evaluations: int
    nodes: tuple[Nodes, ...]
    bias: Array
    starts: tuple[float, ...]

    @property
    def quantile(self) -> float:
        """Deviations to an end of a 95 % interval: Student's t, as how few cycles scatter is estimated too."""
        return float(student(0.975, max(len(self.scores) - LAW, 1)))

    def interval(self, row: Array, more: float = 0.0) -> tuple[float, float]:
        """Ends of the 95 % interval of row @ theta (10,): the hull of what is known where the nuisances are free, and
        where they are at the means of their priors, with the bias of the free ones; more: standard error from
        elsewhere."""
        known = self.covariance
        goes_with = known[:, LAW:] @ np.linalg.inv(known[LAW:, LAW:])
        free, held = known + goes_with @ np.diag(self.bias**2) @ goes_with.T, known - goes_with @ known[LAW:]
        ends: list[float] = []
        for theta, covariance in ((self.theta, free), (self.held, held)):
            own = max(float(row @ covariance @ row), 0.0)
            off = self.quantile * float(np.sqrt(own + more**2))
            ends += [float(row @ theta) - off, float(row @ theta) + off]
        return min(ends), max(ends)


class Objective:
    """Log posterior of records with parameters in common; counts its passes."""

    def __init__(self, records: Sequence[Sticks], prior: Prior, nodes: Sequence[Nodes] | None = None) -> None:
        self.records, self.prior, self.passes = tuple(records), prior, 0
        # Onset and arrest alone do not tell the nuisances from what is searched: they stay at their priors.
        followed = any(sticks.resolved for sticks in records)
        self.free = np.array([followed or name in PARAMETERS for name in THETA])
        self.place([Nodes.wide(sticks) for sticks in records] if nodes is None else nodes)

    def place(self, nodes: Sequence[Nodes]) -> None:
        """Compute on these nodes from now on."""
        self.nodes = tuple(nodes)
        self.each = [Likelihood(s, n) for s, n in zip(self.records, self.nodes, strict=True)]

    def slope(self, theta: Array) -> tuple[float, Array, Array]:
        """Value, gradient (p,), and scores (c, p)."""
        self.passes += 1
        found = [likelihood.with_scores(theta) for likelihood in self.each]
        scores = np.vstack([own for _, own in found])
        value, prior = self.prior.logarithm(theta)
        value += sum(float(cycles.log_likelihood.sum()) for cycles, _ in found)
        return value, scores.sum(axis=0) + prior, scores

    def narrow(self, theta: Array) -> None:
        """Nodes to where the strengths lie at theta."""
        self.passes += 1
        found = [likelihood(theta) for likelihood in self.each]
        # Nodes farther apart than strengths scatter hold the strength at one of them.
        least = min(LEAST_SD, float(np.exp(theta[PARAMETERS.index("strength_scatter")])))
        self.place([Nodes.about(c.log_strength, np.maximum(c.log_strength_sd, least)) for c in found])

    def climb(self, theta: Array, free: NDArray[np.bool_], until: float = np.inf, steps: int = STEPS) -> Climbed:
        """To the greatest posterior in the free entries of theta (10,), on the same nodes; until: on the clock of time
        limits [s]."""
        _, _, scores = self.slope(theta)
        if not np.isfinite(scores).all():  # slips that the law cannot be followed through
            return Climbed(theta, -np.inf, np.full(theta.size, np.inf), False, True)
        inverse = np.linalg.inv((scores.T @ scores + self.prior.precision)[np.ix_(free, free)])

        def whole(part: Array) -> Array:
            out = theta.copy()
            out[free] = part
            return out

        def fallen(part: Array) -> tuple[float, Array]:
            value, gradient, _ = self.slope(whole(part))
            return -value, -gradient[free]

        def in_time(_: Array) -> None:
            if now() >= until:
                raise StopIteration

        found = minimize(
            fallen,
            theta[free],
            jac=True,
            callback=in_time,
            method="BFGS",
            options={"gtol": 0.2, "hess_inv0": 0.5 * (inverse + inverse.T), "maxiter": steps},
        )
        if not (np.isfinite([found.fun, *found.x]).all() and np.isfinite(found.hess_inv).all()):
            return Climbed(theta, -np.inf, np.full(theta.size, np.inf), False, True)
        converged = bool(found.success or np.all(np.abs(found.jac) < 1.0))
        sd = np.sqrt(np.diag(inverse))
        return Climbed(whole(found.x), -float(found.fun), sd, converged, now() < until)


@dataclass(frozen=True)
class Climbed:
    """Where a search ended: theta (10,), the logarithm of the posterior there, standard errors of the free entries."""

    theta: Array
    value: float
    sd: Array
    converged: bool
    in_time: bool


def features(records: Sequence[Sticks]) -> Array:
    """Theta (10,) from drops, courses and levels of the records, the nuisances at the middle of their priors."""
    drop = np.concatenate([sticks.drop for sticks in records])
    strength = 0.5 * float(np.median(drop))
    middles = [0.5 * (s.line + s.arrest) for s in records]
    moves = np.concatenate([np.diff(m)[s.follows[1:]] for m, s in zip(middles, records, strict=True)])
    slid = np.concatenate([(s.end / s.rig.stiffness)[1:][s.follows[1:]] for s in records])
    wander = float(np.sqrt(np.mean(moves**2) / max(np.mean(slid), 1e-12))) if moves.size else strength
    least = 1e-3 * strength / np.sqrt(float(np.median(slid)) if slid.size else 1e-4)
    values = (
        strength,
        2.0 * max(sticks.rig.stiffness for sticks in records),
        max(0.5 * records[0].usual_rest, 1e-3),
        float(np.median([s.rig.stiffness * s.rig.load * s.rig.pace**2 for s in records])),
        max(wander, least),
        float(np.clip(np.std(np.log(drop)), 0.02, 0.6)),
        0.3 * strength,
    )
    return np.append(np.log(values), [DAMPING[0], 0.0, 0.0])


def starts(records: Sequence[Sticks]) -> list[Array]:
    """From where the greatest posterior is looked for."""
    out, stiffness = [], max(sticks.rig.stiffness for sticks in records)
    for mass, weakening, speed_term, strength in STARTS:
        theta = features(records)
        theta[THETA.index("mass")] += np.log(mass)
        theta[THETA.index("weakening_rate")] = np.log(weakening * stiffness)
        theta[THETA.index("strength")] += np.log(strength)
        theta[THETA.index("speed_term")] = speed_term if any(sticks.resolved for sticks in records) else 0.0
        out.append(theta)
    return out


def maximise(
    records: Sequence[Sticks],
    stated: Mapping[str, tuple[float, float]] | None = None,
    start: Array | None = None,
) -> Maximum:
    """Greatest posterior of records that share their parameters, from every start, or from one (10,).

    Args:
        stated: mean and sd of entries of theta that the scene states, by name.
    """
    prior = Prior.of(records, stated or {})
    until = now() + SEARCH_SHARE * seconds_left()
    tried: list[tuple[Objective, Climbed]] = []
    for theta in starts(records) if start is None else [start]:
        if tried and now() >= until:
            break
        objective = Objective(records, prior)
        tried.append((objective, _tried(objective, theta, until)))
    objective, best = max(tried, key=lambda pair: pair[1].value)
    if np.isfinite(best.value) and best.in_time:
        best = _settled(objective, best.theta, until)
    maximum = Maximum(
        prior=prior,
        theta=best.theta,
        covariance=np.full((best.theta.size, best.theta.size), np.nan),
        held=best.theta,
        log_likelihood=-np.inf,
        scores=np.empty((0, best.theta.size)),
        converged=False,
        in_time=best.in_time,
        evaluations=sum(own.passes for own, _ in tried),
        nodes=objective.nodes,
        bias=BIAS * objective.free[LAW:],
        starts=tuple(climbed.value for _, climbed in tried),
    )
    if not best.converged:
        return maximum
    covariance, scores, value = _covariance(objective, best.theta)
    if not np.isfinite(covariance).all():
        return maximum
    middle = best.theta.copy()
    middle[LAW:] = prior.mean[LAW:]
    held = objective.climb(middle, np.array([name in PARAMETERS for name in THETA]))
    return replace(maximum, covariance=covariance, held=held.theta, log_likelihood=value, scores=scores, converged=True)


def _tried(objective: Objective, theta: Array, until: float) -> Climbed:
    """The first steps from a start, on nodes that were narrowed there."""
    objective.narrow(theta)
    objective.narrow(theta)
    return objective.climb(theta, objective.free, until, TRIED)


def _settled(objective: Objective, theta: Array, until: float) -> Climbed:
    """All the way, on nodes that are narrowed in between to where strengths lie."""
    objective.narrow(theta)
    for _ in range(ROUNDS):
        found = objective.climb(theta, objective.free, until)
        if not np.isfinite(found.value) or not found.in_time:
            break
        moved, theta = float(np.max(np.abs(found.theta - theta)[objective.free] / found.sd)), found.theta
        objective.narrow(theta)
        if found.converged and moved < SETTLED:
            break
    return found


def _covariance(objective: Objective, theta: Array) -> tuple[Array, Array, float]:
    """Covariance, scores (c, p) and log likelihood. Per parameter the larger deviation counts: of the Hessian, and of
    the sandwich with neighbouring cycles' scores correlated (Newey and West 1987), for few cycles after MacKinnon and
    White (1985). What is not free keeps its prior, and what is goes with it."""
    free = objective.free
    prior = objective.prior.precision
    value, _, scores = objective.slope(theta)
    sd = 1.0 / np.sqrt(np.diag(scores.T @ scores + prior))
    steps = np.clip(SHARE * sd, *WIDER)
    above, below = (np.array([objective.slope(theta + side * step)[1] for step in np.diag(steps)]) for side in (1, -1))
    information = (below - above) / (2.0 * steps[:, None])
    information = 0.5 * (information + information.T) - prior
    if not np.isfinite(information).all():
        return np.full_like(information, np.nan), scores, value
    size, both = np.outer(sd[free], sd[free]), np.ix_(free, free)
    values, vectors = np.linalg.eigh(information[both] * size)
    # A direction in which the likelihood bends the wrong way is one of which it tells nothing.
    inverse = np.linalg.inv(vectors @ np.diag(np.maximum(values, 0.0)) @ vectors.T / size + prior[both])
    cycles = scores.shape[0]
    known = cycles / max(cycles - LAW, 1)  # scores at the maximum scatter less than those at the truth
    middle = known * _long_run((scores - scores.mean(axis=0))[:, free]) + prior[both]
    sandwich = inverse @ middle @ inverse
    scale = np.maximum(1.0, np.sqrt(np.diag(sandwich) / np.diag(inverse)))
    covariance = np.diag(objective.prior.sd**2.0)
    covariance[both] = inverse * np.outer(scale, scale)
    goes_with = np.eye(theta.size)
    goes_with[np.ix_(free, ~free)] = -inverse @ information[np.ix_(free, ~free)]
    return goes_with @ covariance @ goes_with.T, scores, value - objective.prior.logarithm(theta)[0]


def _long_run(scores: Array) -> Array:
    """Long-run covariance of scores (c, n), Bartlett weights."""
    count = scores.shape[0]
    lags = int(4.0 * (count / 100.0) ** (2.0 / 9.0))
    out = scores.T @ scores
    for lag in range(1, min(lags, count - 1) + 1):
        moved = scores[lag:].T @ scores[:-lag]
        out += (1.0 - lag / (lags + 1.0)) * (moved + moved.T)
    return out
