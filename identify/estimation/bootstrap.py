"""Cycle-block bootstrap: the fit repeated with the residuals of whole cycles weighted anew.

Residuals of one cycle keep together, so whatever they have in common (colour, a law that differs a little from cycle to
cycle) stays in the intervals; no formula of the noise is asked. Weights are the six of Webb, made for few blocks: the
residuals of every cycle change sign and size, and the cycle stays in the fit. What a cycle alone decides (its load, its
own start) leaves no residual to be weighted: that part is drawn from the size of the residuals, as are the priors.
Every replicate is solved again, warm from the answer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.progress import Progress, to_nobody
from identify.base.quantiles import LEVEL, NORMAL, student
from identify.estimation.influence import Influence
from identify.shooting.shooting import Problem
from identify.shooting.solve import Settled, Warm

Array = NDArray[np.float64]

WEIGHTS = np.array([-np.sqrt(1.5), -1.0, -np.sqrt(0.5), np.sqrt(0.5), 1.0, np.sqrt(1.5)])
FEWEST = 40  # replicates from which on an interval is given
FEWEST_FREEDOM = 2.0
LEAPS = (1, 3, 8)  # in which a replicate is reached


@dataclass(frozen=True)
class Bootstrap:
    """Replicates (r, f) of the parameters, those that settled of all that were asked (`settled`), and intervals (f, 2):
    NaN with too few. `freedom` (f,) is the number of independent pieces of residuals behind each spread."""

    replicates: Array
    settled: NDArray[np.bool_]
    interval: Array
    freedom: Array


def bootstrap(
    problem: Problem,
    z: Array,
    known: Influence,
    count: int,
    *,
    seed: int = 0,
    refine: bool = True,
    progress: Progress = to_nobody,
) -> Bootstrap:
    """Replicates of the answer z (n,) of a problem, and intervals from them.

    Args:
        known: the influence of the data at z; count: of replicates.
        refine: False leaves the replicates linear in the residuals, which takes no time.
    """
    random = np.random.default_rng(seed)
    groups = known.moves.shape[0]
    weights = random.choice(WEIGHTS, size=(count, groups))
    drawn = _drawn(known, count, random)
    answer = (z * problem.layout.scale)[known.kept]
    moved = weights @ known.moves + drawn
    settled = np.ones(count, bool)
    if refine:
        solver = _Replicates(problem, z, known)
        for number in range(count):
            progress("bootstrap", None)
            found = solver.solve(weights[number], drawn[number])
            settled[number] = found is not None
            if found is not None:
                moved[number] = found - answer
        moved = moved[settled]
    freedom = _freedom(known)
    interval = np.full((answer.size, 2), np.nan)
    if moved.shape[0] >= FEWEST:
        tails = np.array([0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
        ends = np.quantile(moved, tails, axis=0, method="weibull").T
        wider = student(tails[1], freedom) / NORMAL
        interval = answer[:, None] + wider[:, None] * ends
    return Bootstrap(answer + moved, settled, interval, freedom)


def _noise(known: Influence) -> float:
    """Variance of the residuals in terms of what white noise of the stated level would leave."""
    precision = np.linalg.pinv(known.covariance)
    seen = float(np.einsum("gf,fh,gh->", known.moves, precision, known.moves))
    expected = float(np.einsum("fh,ghf->", precision, known.white - known.absorbed))
    return seen / expected if expected > 0.0 else 1.0


def _drawn(known: Influence, count: int, random: np.random.Generator) -> Array:
    """What the fit takes out of the residuals, and the errors of the priors: drawn (count, f)."""
    covariance = max(_noise(known), 1e-3) * known.absorbed.sum(axis=0) + known.prior
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(random.standard_normal((count, root.shape[1])) @ root.T)


def _freedom(known: Influence) -> Array:
    """Independent pieces behind the spread of each parameter (f,): a cycle that carries it all counts alone."""
    left = np.maximum(np.einsum("gff->gf", known.white - known.absorbed), 0.0)
    resampled = left.sum(axis=0)
    pieces = resampled**2 / np.maximum((left**2).sum(axis=0), 1e-300)
    share = resampled / np.maximum(np.diag(known.covariance), 1e-300)
    return np.asarray(np.maximum(pieces / np.maximum(share, 1e-6) ** 2, FEWEST_FREEDOM))


class _Replicates:
    """The problem around its answer, with the fitted curve plus weighted residuals as data."""

    def __init__(self, problem: Problem, z: Array, known: Influence) -> None:
        self.known, self.z, layout = known, z, problem.layout
        x = z * layout.scale
        self.moments = []
        for family, moments in zip(layout.families, problem.moments, strict=True):
            slots = family.slot_values(x)
            _, curve = family.block.evaluate(slots, family.constants, derivatives=False)
            self.moments.append(moments.around(curve))
        self.problem = problem
        self.warm = Warm(problem, z, known.kept, np.sqrt(np.maximum(np.diag(known.covariance), 1e-300)))
        point = problem.evaluate(z, derivatives=True)
        assert point.hessian is not None
        upper = point.hessian
        full = upper + upper.T
        full.setdiag(upper.diagonal())
        inverse = np.linalg.pinv(known.covariance)
        direction = known.columns @ inverse / layout.scale[:, None]  # of all unknowns, per move of the parameters
        self.push = np.asarray(full @ direction)

    def solve(self, weights: Array, drawn: Array) -> Array | None:
        """The parameters (f,) for one set of weights (g,) and one draw (f,) of what leaves no residuals.

        Where one leap does not settle, the residuals grow in steps from none, which is the answer itself.
        """
        for leaps in LEAPS:
            z, multipliers = self.z, np.zeros_like(self.warm.multipliers)
            for share in np.arange(1, leaps + 1) / leaps:
                found = self._settled(share * weights, share * drawn, z, multipliers)
                if found is None:
                    break
                z, multipliers = found.z, found.multipliers
            else:
                return (z * self.problem.layout.scale)[self.known.kept]
        return None

    def _settled(self, weights: Array, drawn: Array, z: Array, multipliers: Array) -> Settled | None:
        made = self.problem.with_moments(
            [
                replace(m, pull=m.pull * weights[g][:, None, None], square=m.square * weights[g] ** 2)
                for m, g in zip(self.moments, self.known.groups, strict=True)
            ]
        )
        layout = self.problem.layout
        # The priors pull as hard as they did at the answer; their own errors are in the draw.
        prior = layout.prior_pull(layout.off_prior(self.z * layout.scale))
        push = -self.push @ drawn - prior * layout.scale
        return self.warm.settle(z, problem=made, multipliers=multipliers, push=push)
