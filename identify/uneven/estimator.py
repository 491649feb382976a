"""From sticks and slips to parameters of an uneven pair: start from features, maximum likelihood, how sure it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from identify.base.budget import now, seconds_left
from identify.base.quantiles import student
from identify.uneven.events import Sticks
from identify.uneven.likelihood import Likelihood, Nodes
from identify.uneven.slip_functions import LAW, PARAMETERS

Array = NDArray[np.float64]

WIDER = (1e-3, 0.1)  # least and greatest step to either side, between gradients, for second derivatives
SHARE = 0.2  # of a deviation: that step; far closer gradients show the steps in which an onset is followed
ROUNDS = 8  # times that the nodes are narrowed to where the strengths lie
SETTLED = 0.05  # deviations by which parameters move in the last round
LEAST_SD = 0.03  # of the logarithm of a strength: nodes lie no closer together, unless strengths scatter by less
WEAK = 3.0  # sd of the prior about the start: it stops what the record does not tell, and nothing else
SEARCH_SHARE = 0.7  # of the time that is left: the rest is for the covariance


@dataclass(frozen=True)
class Maximum:
    """Where the likelihood of records is greatest.

    start (7,): from features; theta (7,): logarithms of PARAMETERS; covariance (7, 7) of it: per parameter the larger
    of the Hessian's and the sandwich's; log_likelihood; scores (c, 7); converged; evaluations: passes over the records;
    in_time: whether the search ended before its time was up; nodes: per record.
    """

    start: Array
    theta: Array
    covariance: Array
    log_likelihood: float
    scores: Array
    converged: bool
    in_time: bool
    evaluations: int
    nodes: tuple[Nodes, ...]

    @property
    def quantile(self) -> float:
        """Deviations to an end of a 95 % interval: Student's t, as how few cycles scatter is estimated too."""
        return float(student(0.975, max(len(self.scores) - self.theta.size, 1)))


class Objective:
    """Log likelihood of records with parameters in common, with a weak prior; counts its passes."""

    def __init__(
        self,
        records: Sequence[Sticks],
        start: Array,
        nodes: Sequence[Nodes] | None = None,
        law: tuple[str, ...] = LAW,
    ) -> None:
        self.records, self.start, self.law, self.passes = tuple(records), start, law, 0
        self.tightness = np.eye(start.size) / WEAK**2
        self.place([Nodes.wide(sticks) for sticks in records] if nodes is None else nodes)

    def place(self, nodes: Sequence[Nodes]) -> None:
        """Compute on these nodes from now on."""
        self.nodes = tuple(nodes)
        self.each = [Likelihood(s, n, self.law) for s, n in zip(self.records, self.nodes, strict=True)]

    def prior(self, theta: Array) -> tuple[float, Array]:
        """Logarithm of the weak prior, and its gradient (p,)."""
        off = (theta - self.start) / WEAK
        return -0.5 * float(off @ off), -off / WEAK

    def slope(self, theta: Array) -> tuple[float, Array, Array]:
        """Value, gradient (p,), and scores (c, p)."""
        self.passes += 1
        found = [likelihood.with_scores(theta) for likelihood in self.each]
        scores = np.vstack([own for _, own in found])
        value, prior = self.prior(theta)
        value += sum(float(cycles.log_likelihood.sum()) for cycles, _ in found)
        return value, scores.sum(axis=0) + prior, scores

    def narrow(self, theta: Array) -> None:
        """Nodes to where the strengths lie at theta."""
        self.passes += 1
        found = [likelihood(theta) for likelihood in self.each]
        # Nodes farther apart than strengths scatter hold the strength at one of them.
        least = min(LEAST_SD, float(np.exp(theta[PARAMETERS.index("strength_scatter")])))
        self.place([Nodes.about(c.log_strength, np.maximum(c.log_strength_sd, least)) for c in found])


def start_from_features(records: Sequence[Sticks]) -> Array:
    """Logarithms of PARAMETERS (7,) from drops, slips and levels of the records."""
    rigs = [sticks.rig for sticks in records]
    drop = np.concatenate([sticks.drop for sticks in records])
    strength = 0.5 * float(np.median(drop))
    middles = [0.5 * (s.line + s.arrest) for s in records]
    moves = np.concatenate([np.diff(m)[s.follows[1:]] for m, s in zip(middles, records, strict=True)])
    slid = np.concatenate([s.end[1:][s.follows[1:]] for s in records])
    wander = float(np.sqrt(np.mean(moves**2) / max(np.mean(slid), 1e-12))) if moves.size else strength
    scatter = float(np.std(np.log(drop)))
    return np.log(
        [
            strength,
            2.0 * max(rig.stiffness for rig in rigs),
            max(0.5 * records[0].usual_rest, 1e-3),
            float(np.median([rig.mass * rig.load for rig in rigs])),
            max(wander, 1e-3 * strength / np.sqrt(float(np.median(slid)) if slid.size else 1e-4)),
            np.clip(scatter, 0.02, 0.6),
            0.3 * strength,
        ]
    )


def maximise(records: Sequence[Sticks], start: Array | None = None, law: tuple[str, ...] = LAW) -> Maximum:
    """Greatest likelihood of records that share their parameters; law: effects by name, where it has parameters of its
    own `start` holds their logarithms after those of PARAMETERS."""
    first = start_from_features(records) if start is None else start
    objective = Objective(records, first, law=law)
    theta = first
    objective.narrow(theta)
    objective.narrow(theta)
    converged, in_time, until = False, True, now() + SEARCH_SHARE * seconds_left()
    _, _, scores = objective.slope(theta)
    unknown = np.full((theta.size, theta.size), np.nan)
    nothing = Maximum(first, first, unknown, -np.inf, scores, False, True, objective.passes, objective.nodes)
    if not np.isfinite(scores).all():  # slips that the law cannot be followed through
        return nothing
    inverse = np.linalg.inv(scores.T @ scores + objective.tightness)
    for _ in range(ROUNDS):
        found = minimize(
            lambda at: tuple(-value for value in objective.slope(at)[:2]),
            theta,
            jac=True,
            callback=lambda _: _stop_at(until),
            method="BFGS",
            options={"gtol": 0.2, "hess_inv0": 0.5 * (inverse + inverse.T), "maxiter": 60},
        )
        if not (np.isfinite(found.x).all() and np.isfinite(found.hess_inv).all()):
            return nothing
        moved = np.abs(found.x - theta) / np.sqrt(np.diag(inverse))
        theta, inverse = found.x, np.asarray(found.hess_inv)
        objective.narrow(theta)
        converged = bool(found.success or np.all(np.abs(found.jac) < 1.0))
        in_time = now() < until
        if (converged and moved.max() < SETTLED) or not in_time:
            break
    if not (converged or in_time):  # cut short: its answer is not taken
        return replace(nothing, theta=theta, in_time=False, evaluations=objective.passes)
    covariance, scores, value = _covariance(objective, theta)
    if not np.isfinite(covariance).all():
        return nothing
    return Maximum(first, theta, covariance, value, scores, converged, in_time, objective.passes, objective.nodes)


def _stop_at(until: float) -> None:
    """Have `minimize` stop once the clock of time limits has passed [s]."""
    if now() >= until:
        raise StopIteration


def _covariance(objective: Objective, theta: Array) -> tuple[Array, Array, float]:
    """Covariance, scores (c, p) and log likelihood. Per parameter the larger deviation counts: of the Hessian, and of
    the sandwich with neighbouring cycles' scores correlated (Newey and West 1987), for few cycles after MacKinnon and
    White (1985)."""
    value, _, scores = objective.slope(theta)
    sd = 1.0 / np.sqrt(np.diag(scores.T @ scores) + WEAK**-2)
    steps = np.clip(SHARE * sd, *WIDER)
    above, below = (np.array([objective.slope(theta + side * step)[1] for step in np.diag(steps)]) for side in (1, -1))
    information = (below - above) / (2.0 * steps[:, None])
    of_data = (0.5 * (information + information.T) - objective.tightness) * np.outer(sd, sd)
    if not np.isfinite(of_data).all():
        return np.full_like(of_data, np.nan), scores, value
    values, vectors = np.linalg.eigh(of_data)
    # A direction in which the likelihood bends the wrong way is one of which it tells nothing.
    of_data = vectors @ np.diag(np.maximum(values, 0.0)) @ vectors.T / np.outer(sd, sd)
    inverse = np.linalg.inv(of_data + objective.tightness)
    cycles = scores.shape[0]
    known = cycles / max(cycles - theta.size, 1)  # scores at the maximum scatter less than those at the truth
    middle = known * _long_run(scores - scores.mean(axis=0)) + objective.tightness
    sandwich = inverse @ middle @ inverse
    scale = np.maximum(1.0, np.sqrt(np.diag(sandwich) / np.diag(inverse)))
    return inverse * np.outer(scale, scale), scores, value - objective.prior(theta)[0]


def _long_run(scores: Array) -> Array:
    """Long-run covariance of scores (c, n), Bartlett weights."""
    count = scores.shape[0]
    lags = int(4.0 * (count / 100.0) ** (2.0 / 9.0))
    out = scores.T @ scores
    for lag in range(1, min(lags, count - 1) + 1):
        moved = scores[lag:].T @ scores[:-lag]
        out += (1.0 - lag / (lags + 1.0)) * (moved + moved.T)
    return out
