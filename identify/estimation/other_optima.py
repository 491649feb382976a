"""Other answers of the same model: starts redrawn around one, each placed on the data and solved.

Where the drive vibrates, or a finger moves, every slip begins in one of the periods. A motion holds on to those it was
placed in, so that the misfit has an optimum for every way of placing it, and several of them may pass as noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice, takewhile, zip_longest

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.base.quantiles import LEVEL, chi_square
from identify.estimation.attempt import (
    Attempt,
    solve_again_with_priors,
    solve_from,
    solve_or_continue,
    stalled,
    usable,
)
from identify.estimation.residual_autocorrelation import NoiseAutocorrelation
from identify.estimation.starts import (
    apart,
    distinguishable,
    features_of,
    held_starts,
    own_starts,
    ranked,
    suggested_starts,
)
from identify.estimation.strategies import Strategy, run_strategy
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.logs.vibration import quieted, rhythmic
from identify.shooting.starts import fit_features

Array = NDArray[np.float64]

FEATURES, WIDE = 32, 2.0  # starts whose cycles are fitted without the vibration, and how far they are drawn, in spreads
APART = 0.15  # of that reach between two of them that are solved both
NEAR = (0.5, 0.2, 0.1, 0.05) * 2  # how far starts are drawn around the best answer: optima lie close by and far
READ_OFF = ("mu_s",)  # the onsets show it
COST_CUTOFF = 200.0  # cost above that of the best with which a start is not followed further
SAME, AGAIN = 1.0, 3  # answers so near in the sum of squares are one; found so often, it is the best there is


def multistart_around(
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
        cost_cutoff = best.solved.solution.cost + COST_CUTOFF
        tried = solve_from(list(prepared), list(attempt.log_numbers), start, cost_cutoff=cost_cutoff)
        if tried is None or tried.log_numbers != attempt.log_numbers:
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
    features, bases = features_of([prepared[i] for i in attempt.log_numbers])
    if not features:
        return
    draws = theta + reach * random.standard_normal((FEATURES, theta.size))
    calm = quieted(unknowns)
    found = (np.where(calm.free, start.theta, theta) for start in fit_features(calm, features, bases, draws))
    yield from apart(found, np.where(reach > 0.0, APART * reach, np.inf))


# ----------------------------------------------------------------------------------------------------------------------
# Optima beside that of an answer: where data do not tell a parameter, the way of the search may have chosen.
#
# Few slips, hardly sampled, are described as well, or nearly, from several optima: of a contact that has aged after a
# few seconds, and of one that ages on and on; of slips that begin early and slowly, and of others that begin late. The
# starts of the features are fits of one settled cycle, and all roll into the same optimum. Starts thrown about the
# answer, and about the first start of the data's own, do not, nor does what the levels of the data suggest before any
# fit: the motions that follow from each of them say which to solve.
# ----------------------------------------------------------------------------------------------------------------------

THROWN = 16  # starts about each place
SOLVED = 3  # of each kind, those that fit best before they are solved
HELD = 6  # of those with a parameter held: each on another side of the answer
ALIKE = chi_square(LEVEL, 1)  # what the data object to an answer at most that a single parameter could as well have
LOWER = 0.1  # by which chi^2 must fall for an optimum to be a lower one
LOOKS = 3  # how often starts are thrown about an answer, each time about a lower one
FAR = 2.0  # of the spread of a logarithm: a factor of about three; of a coefficient: half as far


def lowest_optimum(
    attempt: Attempt, unknowns: Unknowns, seed: int, noise: NoiseAutocorrelation
) -> tuple[Attempt, list[Attempt]]:
    """Return the lowest place (the preferred one) to which starts lead that are thrown about an answer, and about a
    lower one once more; and the other optima within its joint region: of all looks, and the answer given where it was
    left.

    Args:
        noise: of all logs: its memory widens that region.
    """
    optima: list[Attempt] = []
    for look in range(LOOKS):
        if time_is_up():
            break
        optima += optima_about(attempt, unknowns, seed, noise, own=look == 0)
        here = attempt
        ended = (optimum for optimum in optima if optimum.gate.status is Status.CONVERGED)
        lowest = min((v for v in ended if preferred(v, here, unknowns, noise)), key=_cost, default=here)
        if lowest is here:
            break
        optima = [here, *(optimum for optimum in optima if optimum is not lowest)]
        attempt = lowest
        if objection(lowest, here, noise) < ALIKE:  # the same place, a little farther down
            break
    return attempt, [optimum for optimum in optima if within(attempt, optimum, unknowns, noise)]


def optima_about(
    attempt: Attempt, unknowns: Unknowns, seed: int, noise: NoiseAutocorrelation, *, own: bool = True
) -> list[Attempt]:
    """Return the answers at which solves from thrown starts settle, the lowest first; all lie below the one given, or
    where the data object no more than within its joint region. That answer itself may be among them.

    They are of the very samples of the answer: a start may place the end of a log in its last stick elsewhere. Where
    the solver found no end to a ridge, they are no answers, but places on it all the same. Where the lowest of all is
    met again and again, within what the data tell apart, no more are solved.

    Args:
        noise: as `lowest_optimum`; own: starts are thrown about the data's own start too, and those that its levels
            suggest are tried.
    """
    there: list[Attempt] = []
    for theta in takewhile(lambda _: not time_is_up(), _thrown(attempt, unknowns, seed, own)):
        other = _settled(attempt, replace(unknowns, start=theta))
        if other is not None and within(attempt, other, unknowns, noise):
            there.append(other)
            lowest = min(there, key=_cost)
            if sum(objection(lowest, each, noise) < ALIKE for each in there) == AGAIN:
                break
    return sorted(there, key=_cost)


def preferred(other: Attempt, attempt: Attempt, unknowns: Unknowns, noise: NoiseAutocorrelation) -> bool:
    """Whether another answer takes the place of one: it is lower; but of two that the data do not tell apart it is the
    one whose contact strengthens at rest."""
    one, two = (weakens(unknowns, tried.solved.theta) for tried in (attempt, other))
    if one and not two:
        return within(attempt, other, unknowns, noise)
    lower = _cost(other) < _cost(attempt) - 0.5 * LOWER
    return lower and (one or not two or not within(other, attempt, unknowns, noise))


def weakens(unknowns: Unknowns, theta: Array) -> bool:
    """Whether contacts weaken while they rest (n_p,): mu_k0 above mu_s, which no scene admits as a start."""
    static, kinetic = (unknowns.names.index(name) for name in ("mu_s", "mu_k0"))
    return bool(theta[static] < theta[kinetic])


def _cost(attempt: Attempt) -> float:
    return attempt.solved.solution.cost


def within(attempt: Attempt, other: Attempt, unknowns: Unknowns, noise: NoiseAutocorrelation) -> bool:
    """Whether another answer, of the same samples, lies below one, or where the data object to it no more than within
    the joint region of that one."""
    if other.solved.problem.samples != attempt.solved.problem.samples:
        return False
    return objection(attempt, other, noise) < chi_square(LEVEL, int(np.sum(unknowns.free)))


def objection(attempt: Attempt, other: Attempt, noise: NoiseAutocorrelation) -> float:
    """What the data object to another answer, of the same samples, as a loss in white noise; nothing where it lies
    lower."""
    loss = 2.0 * (_cost(other) - _cost(attempt))
    return 0.0 if loss <= 0.0 else noise.objection(attempt.solved.fitted, other.solved.fitted, loss)


def _thrown(attempt: Attempt, unknowns: Unknowns, seed: int, own: bool) -> Iterator[Array]:
    """The starts (n_p,) worth a solve, by turns: with one parameter held in turn beside the answer, thrown about it and
    about the data's own start, from the levels."""
    logs, rng = list(attempt.fitted_logs), np.random.default_rng(seed)
    far = FAR * unknowns.spread * np.where(unknowns.logarithmic, 1.0, 0.5)
    far = np.where(unknowns.free & ~rhythmic(unknowns), np.minimum(far, unknowns.prior_deviation), 0.0)
    kinds = []
    for place in (attempt.solved.theta, *islice(own_starts(logs, unknowns), int(own))):
        about = place + far * rng.standard_normal((THROWN, place.size))
        kinds.append(np.where(unknowns.free, np.clip(about, unknowns.lower, unknowns.upper), place))
    if own:
        kinds.append(suggested_starts(logs, unknowns))
    apart_by = chi_square(LEVEL, int(np.sum(unknowns.free)))
    held = distinguishable(ranked(logs, unknowns, held_starts(logs, unknowns, attempt.solved.theta)), apart_by)
    best = [list(islice(held, HELD)), *(ranked(logs, unknowns, starts)[:SOLVED] for starts in kinds)]
    yield from (start.theta for turn in zip_longest(*best) for start in turn if start is not None)


def _settled(attempt: Attempt, unknowns: Unknowns) -> Attempt | None:
    """Where a solve of all logs of an answer from a start (unknowns.start) settles, with its samples, or comes to
    describe them on a ridge of which it finds no end; None where it does neither."""
    logs = list(attempt.fitted_logs)
    found = run_strategy(
        Strategy.OTHER_OPTIMA,
        lambda: solve_or_continue(logs, usable(logs), unknowns, _cost(attempt) + COST_CUTOFF),
        attempt,
        attempt.log_numbers,
    )
    if found is None or len(found.log_numbers) < len(logs):
        return None
    if stalled(found) and found.solved.problem.samples == attempt.solved.problem.samples:
        return replace(found, log_numbers=attempt.log_numbers, fitted_logs=attempt.fitted_logs)
    return of_same_samples(attempt, found, unknowns) if found.gate.status is Status.CONVERGED else None


def of_same_samples(attempt: Attempt, found: Attempt, unknowns: Unknowns) -> Attempt | None:
    """Another answer of all logs of one, of the very samples of it; None where it does not settle there."""
    if found.solved.problem.samples != attempt.solved.problem.samples:
        moved = solve_again_with_priors(attempt, unknowns, found.solved.theta, found.solved.trajectories)
        found = replace(moved, found_by=found.found_by)
    return (
        replace(found, log_numbers=attempt.log_numbers, fitted_logs=attempt.fitted_logs)
        if found.gate.status is Status.CONVERGED
        else None
    )
