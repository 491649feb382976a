"""Parametric bootstrap: the fit repeated on logs drawn from its answer.

A replicate is the fitted curve with new noise of the variance and autocorrelation of the residuals, and priors about
means that are drawn as wide as they are; it is solved again from the answer (Efron and Tibshirani, An Introduction to
the Bootstrap, 1993, section 6.5). Intervals are percentiles of the replicates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.progress import Progress, to_nobody
from identify.base.quantiles import LEVEL
from identify.estimation.attempt import Attempt
from identify.estimation.profile import MOVED, converged
from identify.estimation.residual_autocorrelation import ArModel
from identify.logs.unknowns import Unknowns
from identify.shooting.passes import solve_in_passes
from identify.shooting.shooting import Problem

Array = NDArray[np.float64]

FEWEST = 40  # replicates from which on an interval is given
SETTLING = 1000  # samples after which an autoregression has forgotten where it began


@dataclass(frozen=True)
class Bootstrap:
    """Replicates (r, f) of the free theta, which of those that were asked for settled, and intervals (f, 2): NaN with
    too few."""

    replicates: Array
    settled: NDArray[np.bool_]
    interval: Array


def bootstrap(
    attempt: Attempt,
    unknowns: Unknowns,
    noise: Sequence[ArModel],
    sizes: Array,
    count: int,
    *,
    seed: int = 0,
    progress: Progress = to_nobody,
) -> Bootstrap:
    """Replicates of an answer, and intervals from them.

    Args:
        noise: of each log; sizes: (f,) standard errors of the free theta; count: of replicates.
    """
    solved, random = attempt.solved, np.random.default_rng(seed)
    layout, free = solved.problem.layout, unknowns.free
    levels = np.broadcast_to(attempt.gate.levels, len(noise)).tolist()
    weak = replace(unknowns, start=solved.theta).with_weak_priors()
    thetas, settled = list[Array](), np.zeros(count, bool)
    for number in range(count):
        progress("bootstrap", None)
        logs = []
        for log, curve, model, level in zip(solved.problem.logs, solved.fitted, noise, levels, strict=True):
            drawn = np.sqrt(level) * log.noise * _drawn(model, log.time.size, random)
            logs.append(replace(log, force=np.where(np.isfinite(curve), curve + drawn, log.force)))
        off = np.where(np.isfinite(layout.prior_sd), layout.prior_sd, 0.0) * random.standard_normal(layout.size)
        problem = Problem(logs, replace(layout, prior_mean=layout.prior_mean + off), pattern=solved.problem.pattern)
        again = converged(solved, problem, sizes, MOVED)
        if again is None:  # its events left their samples
            again = solve_in_passes(logs, solved.trajectories, weak)
        settled[number] = again.solution.success
        if settled[number]:
            thetas.append(again.theta[free])
    replicates, interval = np.array(thetas).reshape(-1, sizes.size), np.full((sizes.size, 2), np.nan)
    if len(replicates) >= FEWEST:
        tails = [0.5 - LEVEL / 2, 0.5 + LEVEL / 2]
        interval = np.quantile(replicates, tails, axis=0, method="weibull").T
    return Bootstrap(replicates, settled, interval)


def _drawn(model: ArModel, count: int, random: np.random.Generator) -> Array:
    """Noise (n,) of variance 1 with this autoregression."""
    if model.white:
        return random.standard_normal(count)
    from scipy.signal import lfilter  # which takes a third of a second to load

    new = np.sqrt(model.innovation) * random.standard_normal(count + SETTLING)
    return np.asarray(lfilter([1.0], np.concatenate([[1.0], -model.regression]), new)[SETTLING:])
