"""From sticks and slips to parameters of an uneven pair: starts from features, greatest posterior, its covariance; and
what several records of one slider have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import chdtrc

from identify.base.budget import now, seconds_left
from identify.base.quantiles import NORMAL, student
from identify.uneven.events import Sticks
from identify.uneven.likelihood import Likelihood, Nodes
from identify.uneven.slip_functions import PARAMETERS, THETA

Array = NDArray[np.float64]

ROUNDS, STEPS, SCREENING = 8, 60, 10  # narrowings of the nodes; steps between them, and of a start that is screened
WEAK = 3.0  # sd of the prior about the features: it stops what the record does not show, and nothing else
DAMPING = (float(np.log(0.05)), float(np.log(3.0)))  # prior on the logarithm of the damping ratio, where none is stated
# By how much speed term and shape come out wrong on simulated tracks beyond what their likelihood knows: how a slip
# begins among spots of unlike strength is followed by its mean only (docs/validation.md, Simulated uneven records).
BIAS = np.array([0.0, 0.1, 0.5])
# Starts: mass over k pace^2, weakening rate over stiffness, speed term, strength over half the drop.
STARTS = ((0.8, 3.0, 0.0, 1.0), (0.4, 1.5, 0.0, 1.0), (0.5, 3.0, 0.4, 1.5))
# Of the logarithm of the mass: by how much one slider's differs from record to record beyond what each record knows
# of it, as no law of weakening is quite true (docs/validation.md, Measured records).
LAW_ERROR = 0.25
APART = 0.01  # probability of the difference, below which records do not share their parameters
LAW = len(PARAMETERS)  # entries of theta before the nuisances
MASS = np.eye(len(THETA))[THETA.index("mass")]


@dataclass(frozen=True)
class Prior:
    """Independent normal priors on theta: mean, sd (10,)."""

    mean: Array
    sd: Array

    def logarithm(self, theta: Array) -> tuple[float, Array]:
        """Up to a constant, and its gradient (10,)."""
        off = (theta - self.mean) / self.sd
        return -0.5 * float(off @ off), -off / self.sd

    @staticmethod
    def of(records: Sequence[Sticks], stated: Mapping[str, tuple[float, float]]) -> Prior:
        """Weak ones about the features of records, and those of rigs and frictions at large; stated: mean and sd of
        entries of theta, by name, that the scene gives instead."""
        # Of the damping ratio that friction in proportion to speed makes, and of the shape of the weakening: 0.6 of
        # the way to exponential, or to staying and then falling.
        mean, sd = features(records), np.array([WEAK] * LAW + [DAMPING[1], 0.3, 0.7])
        for name, (value, error) in stated.items():
            mean[THETA.index(name)], sd[THETA.index(name)] = value, error
        return Prior(mean, sd)


@dataclass(frozen=True)
class Maximum:
    """Where the posterior of records is greatest.

    Attributes:
        prior: on theta; theta (10,): as THETA has it; covariance (10, 10): per entry the larger of the Hessian's and
            the sandwich's; fixed (10,): the greatest posterior with the nuisances at the means of their priors.
        log_likelihood: without the prior; cycles: how many; converged; in_time: whether the search ended before its
            time was up; nodes: per record.
        starts: logarithm of the posterior, up to a constant, that the first steps from every start reached.
    """

    prior: Prior
    theta: Array
    covariance: Array
    fixed: Array
    log_likelihood: float
    cycles: int
    converged: bool
    in_time: bool
    nodes: tuple[Nodes, ...]
    starts: tuple[float, ...]

    @property
    def quantile(self) -> float:
        """Deviations to an end of a 95 % interval: Student's t, as how few cycles scatter is estimated too."""
        return float(student(0.975, max(self.cycles - LAW, 1)))

    def interval(self, row: Array, more: float = 0.0) -> tuple[float, float]:
        """Ends of the 95 % interval of row @ theta (10,): the hull of what is known where the nuisances are free, and
        where they are at the means of their priors, with the bias of the free ones; more: standard error from
        elsewhere."""
        known = self.covariance
        regression = known[:, LAW:] @ np.linalg.inv(known[LAW:, LAW:])
        free = known + regression @ np.diag(BIAS**2) @ regression.T
        ends: list[float] = []
        for theta, covariance in ((self.theta, free), (self.fixed, known - regression @ known[LAW:])):
            off = self.quantile * float(np.sqrt(max(float(row @ covariance @ row), 0.0) + more**2))
            ends += [float(row @ theta) - off, float(row @ theta) + off]
        return min(ends), max(ends)


@dataclass(frozen=True)
class Ascent:
    """Where a search ended: theta (10,), the logarithm of the posterior there, standard errors of the free entries."""

    theta: Array
    value: float = -np.inf
    sd: Array = field(default_factory=lambda: np.array([np.inf]))
    converged: bool = False
    in_time: bool = True


class Objective:
    """Log posterior of records with parameters in common."""

    def __init__(self, records: Sequence[Sticks], prior: Prior, nodes: Sequence[Nodes] | None = None) -> None:
        self.records, self.prior = tuple(records), prior
        self._place([Nodes.wide(sticks) for sticks in records] if nodes is None else nodes)

    def _place(self, nodes: Sequence[Nodes]) -> None:
        self.nodes = tuple(nodes)
        self.likelihoods = [Likelihood(s, n) for s, n in zip(self.records, self.nodes, strict=True)]

    def slope(self, theta: Array) -> tuple[float, Array, Array]:
        """Value, gradient (p,), and scores (c, p)."""
        each = [likelihood.with_scores(theta) for likelihood in self.likelihoods]
        scores = np.vstack([own for _, own in each])
        value, prior = self.prior.logarithm(theta)
        value += sum(float(cycles.log_likelihood.sum()) for cycles, _ in each)
        return value, scores.sum(axis=0) + prior, scores

    def narrow(self, theta: Array) -> None:
        """Nodes to where the strengths lie at theta."""
        cycles = [likelihood(theta) for likelihood in self.likelihoods]
        # Of nodes farther apart than strengths scatter a single one would count.
        least = min(0.03, float(np.exp(theta[PARAMETERS.index("strength_scatter")])))
        self._place([Nodes.about(c.log_strength, np.maximum(c.log_strength_sd, least)) for c in cycles])

    def climb(self, theta: Array, free: NDArray[np.bool_], until: float = np.inf, steps: int = STEPS) -> Ascent:
        """To the greatest posterior in the free entries of theta (10,), on the same nodes; until: on the clock of time
        limits [s]."""
        _, _, scores = self.slope(theta)
        if not np.isfinite(scores).all():  # slips that the law cannot be followed through
            return Ascent(theta)
        inverse = np.linalg.inv((scores.T @ scores + np.diag(self.prior.sd**-2.0))[np.ix_(free, free)])

        def whole(part: Array) -> Array:
            out = theta.copy()
            out[free] = part
            return out

        def cost(part: Array) -> tuple[float, Array]:
            value, gradient, _ = self.slope(whole(part))
            return -value, -gradient[free]

        def in_time(_: Array) -> None:
            if now() >= until:
                raise StopIteration

        optimum = scipy.optimize.minimize(
            cost,
            theta[free],
            jac=True,
            callback=in_time,
            method="BFGS",
            options={"gtol": 0.2, "hess_inv0": 0.5 * (inverse + inverse.T), "maxiter": steps},
        )
        if not (np.isfinite([optimum.fun, *optimum.x]).all() and np.isfinite(optimum.hess_inv).all()):
            return Ascent(theta)
        converged = bool(optimum.success or np.all(np.abs(optimum.jac) < 1.0))
        return Ascent(whole(optimum.x), -float(optimum.fun), np.sqrt(np.diag(inverse)), converged, now() < until)


def features(records: Sequence[Sticks]) -> Array:
    """Theta (10,) from drops, slopes and levels of the records, the nuisances at the middle of their priors."""
    drop = np.concatenate([sticks.drop for sticks in records])
    strength = 0.5 * float(np.median(drop))
    moves = np.concatenate([np.diff(0.5 * (s.line + s.arrest))[s.follows[1:]] for s in records])
    slid = np.concatenate([(s.drop / s.rig.stiffness)[1:][s.follows[1:]] for s in records])
    wander = float(np.sqrt(np.mean(moves**2) / max(np.mean(slid), 1e-12))) if moves.size else strength
    values = (
        strength,
        2.0 * max(sticks.rig.stiffness for sticks in records),
        max(0.5 * records[0].usual_rest, 1e-3),
        float(np.median([s.rig.stiffness * s.rig.load * s.rig.pace**2 for s in records])),
        max(wander, 1e-3 * strength / np.sqrt(float(np.median(slid)) if slid.size else 1e-4)),
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
        theta[THETA.index("speed_term")] = speed_term
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
    until, everything = now() + 0.7 * seconds_left(), np.ones(len(THETA), bool)  # the rest: covariance
    screened: list[tuple[Objective, Ascent]] = []
    for theta in starts(records) if start is None else [start]:
        if screened and now() >= until:
            break
        objective = Objective(records, prior)
        objective.narrow(theta)
        objective.narrow(theta)
        screened.append((objective, objective.climb(theta, everything, until, SCREENING)))
    objective, best = max(screened, key=lambda pair: pair[1].value)
    moved = np.inf  # deviations
    for _ in range(ROUNDS):
        if not np.isfinite(best.value) or not best.in_time:
            break
        theta = best.theta
        objective.narrow(theta)
        if best.converged and moved < 0.05:
            break
        best = objective.climb(theta, everything, until)
        moved = float(np.max(np.abs(best.theta - theta) / best.sd))
    covariance, value, fixed = np.full((best.theta.size, best.theta.size), np.nan), -np.inf, best.theta
    if best.converged:
        covariance, value = _covariance(objective, best.theta)
    if converged := bool(np.isfinite(covariance).all()):
        middle = np.append(best.theta[:LAW], prior.mean[LAW:])
        fixed = objective.climb(middle, np.arange(len(THETA)) < LAW).theta
    return Maximum(
        prior=prior,
        theta=best.theta,
        covariance=covariance,
        fixed=fixed,
        log_likelihood=value if converged else -np.inf,
        cycles=sum(sticks.count for sticks in records),
        converged=converged,
        in_time=best.in_time,
        nodes=objective.nodes,
        starts=tuple(optimum.value for _, optimum in screened),
    )


def _covariance(objective: Objective, theta: Array) -> tuple[Array, float]:
    """Covariance and log likelihood. Per parameter the larger deviation counts: of the Hessian, and of the sandwich
    with neighbouring cycles' scores correlated (Newey and West 1987), for few cycles after MacKinnon and White
    (1985)."""
    prior = np.diag(objective.prior.sd**-2.0)
    value, _, scores = objective.slope(theta)
    sd = 1.0 / np.sqrt(np.diag(scores.T @ scores + prior))
    steps = np.clip(0.2 * sd, 1e-3, 0.1)  # far closer gradients show the steps in which an onset is followed
    above, below = (np.array([objective.slope(theta + side * step)[1] for step in np.diag(steps)]) for side in (1, -1))
    information = (below - above) / (2.0 * steps[:, None])
    information = 0.5 * (information + information.T) - prior
    if not np.isfinite(information).all():
        return np.full_like(information, np.nan), value
    size = np.outer(sd, sd)
    values, vectors = np.linalg.eigh(information * size)
    # A direction in which the likelihood bends the wrong way is one of which it says nothing.
    inverse = np.linalg.inv(vectors @ np.diag(np.maximum(values, 0.0)) @ vectors.T / size + prior)
    cycles = scores.shape[0]
    centred = scores - scores.mean(axis=0)
    long_run, lags = centred.T @ centred, int(4.0 * (cycles / 100.0) ** (2.0 / 9.0))
    for lag in range(1, min(lags, cycles - 1) + 1):
        moved = centred[lag:].T @ centred[:-lag]
        long_run += (1.0 - lag / (lags + 1.0)) * (moved + moved.T)
    sandwich = inverse @ (cycles / max(cycles - LAW, 1) * long_run + prior) @ inverse
    scale = np.maximum(1.0, np.sqrt(np.diag(sandwich) / np.diag(inverse)))
    return inverse * np.outer(scale, scale), value - objective.prior.logarithm(theta)[0]


# Several records of one slider.


@dataclass(frozen=True)
class Mass:
    """The mass of a slider [kg] with its 95 % interval; and where records were compared, every record's (value, lower,
    upper), and chi-squared of their difference with its degrees of freedom and its probability."""

    value: float
    lower: float
    upper: float
    each: tuple[tuple[float, float, float], ...] = ()
    scatter: tuple[float, int, float] | None = None


def mass_of(maximum: Maximum, stiffness_error: float) -> Mass:
    """The mass of one record, or of several that share all parameters; it goes with the stiffness, whose relative
    standard error is given."""
    low, high = maximum.interval(MASS, float(np.hypot(LAW_ERROR, stiffness_error)))
    return Mass(*np.exp([MASS @ maximum.theta, low, high]).tolist())


def pooled_mass(records: Sequence[Sticks], maxima: Sequence[Maximum]) -> Mass:
    """One mass of records that were maximised each by itself, weighted by their errors: those of the law are each
    record's own, that of the stiffness is common to all."""
    common = records[0].rig.error
    own = [mass_of(maximum, 0.0) for maximum in maxima]
    middle = np.log([np.sqrt(mass.lower * mass.upper) for mass in own])
    sd = np.array([np.log(mass.upper / mass.lower) / (2.0 * m.quantile) for mass, m in zip(own, maxima, strict=True)])
    mean = float(np.average(middle, weights=sd**-2.0))
    statistic = float(np.sum(((middle - mean) / sd) ** 2))
    off = NORMAL * float(np.hypot(np.sum(sd**-2.0) ** -0.5, common))
    each = tuple((mass.value, mass.lower, mass.upper) for mass in (mass_of(m, common) for m in maxima))
    value, low, high = np.exp([mean, mean - off, mean + off]).tolist()
    scatter = statistic, len(own) - 1, float(chdtrc(len(own) - 1, statistic))
    return Mass(value, low, high, each, scatter)


def agreement(joint: Maximum, each: Sequence[Maximum]) -> float:
    """Probability that records differ by as much, if they share their parameters: by the ratio of likelihoods.

    Args:
        joint: maximum of all records together; each: of every one by itself.
    """
    ratio = 2.0 * (sum(maximum.log_likelihood for maximum in each) - joint.log_likelihood)
    return float(chdtrc(joint.theta.size * (len(each) - 1), max(ratio, 0.0)))
