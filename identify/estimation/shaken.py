"""Other answers of the same model: starts redrawn around one, each placed on the data and solved.

Where the drive vibrates, or a finger moves, every slip begins in one of the periods. A motion holds on to those it was
placed in, so that the misfit has a valley for every way of placing it, and several of them may pass as noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.estimation.attempt import Attempt, Clock, solve_from
from identify.estimation.starts import apart, features_of
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.starts import fit_features
from identify.shooting.vibration import quieted, rhythmic

Array = NDArray[np.float64]

FEATURES, WIDE = 32, 2.0  # starts whose cycles are fitted without the vibration, and how far they are drawn, in spreads
APART = 0.15  # of that reach between two of them that are solved both
NEAR = (0.5, 0.2, 0.1, 0.05) * 2  # how far starts are drawn around the best answer: valleys lie close by and far
READ_OFF = ("mu_s",)  # the onsets show it
HOPELESS = 200.0  # cost above that of the best with which a start is not followed further
SAME, AGAIN = 1.0, 3  # answers so near in the sum of squares are one; found so often, it is the best there is


def shaken(
    attempt: Attempt,
    prepared: Sequence[Prepared],
    unknowns: Unknowns,
    seed: int = 0,
    around: Array | None = None,
) -> Attempt:
    """Return the best answer that other starts lead to; the attempt itself where none is better, or nothing vibrates.

    Args:
        attempt: an answer, or where a search ended; prepared: all logs of the fit; unknowns: its search space.
        around: theta (n_p,) to draw starts around as long as there is no answer; default where the attempt ended.
    """
    free = unknowns.free
    if not unknowns.model.vibrates or not np.all(np.isfinite(attempt.solved.theta[free])):
        return attempt
    random, best, found = np.random.default_rng(seed), attempt, [attempt.excess]
    drawn = free & ~rhythmic(unknowns) & ~np.isin(unknowns.names, READ_OFF)
    spread = np.where(drawn, unknowns.spread, 0.0)

    def centre() -> Array:
        return best.solved.theta if around is None or np.isfinite(best.excess) else around

    def starts() -> Iterator[Array]:
        yield from _by_features(attempt, prepared, unknowns, centre(), WIDE * spread, random)
        for near in NEAR:
            yield centre() + near * spread * random.standard_normal(spread.size)

    for theta in starts():
        if time_is_up():
            break
        start = replace(unknowns, start=np.clip(theta, unknowns.lower, unknowns.upper))
        hopeless = best.solved.solution.cost + HOPELESS
        tried = solve_from(list(prepared), list(attempt.logs), start, Clock(), hopeless=hopeless)
        if tried is None or tried.logs != attempt.logs:
            continue
        found.append(tried.excess)
        best = min(best, tried, key=_rank)
        if sum(abs(excess - best.excess) < SAME for excess in found) == AGAIN:
            break
    return best


def _rank(attempt: Attempt) -> tuple[bool, float]:
    return attempt.gate.status is not Status.CONVERGED, attempt.excess


def _by_features(
    attempt: Attempt,
    prepared: Sequence[Prepared],
    unknowns: Unknowns,
    theta: Array,
    reach: Array,
    random: np.random.Generator,
) -> Iterator[Array]:
    """Starts (n_p,) whose settled cycles are those of the logs, the best first; vibrations as they were found.

    Args:
        theta, reach: where draws lie (n_p,), and how far around (n_p,).
    """
    features, bases = features_of([prepared[i] for i in attempt.logs])
    if not features:
        return
    draws = theta + reach * random.standard_normal((FEATURES, theta.size))
    calm = quieted(unknowns)
    found = (np.where(calm.free, start.theta, theta) for start in fit_features(calm, features, bases, draws))
    yield from apart(found, np.where(reach > 0.0, APART * reach, np.inf))
