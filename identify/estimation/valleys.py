"""Valleys beside that of an answer: where data do not tell a parameter, the way of the search may have chosen.

Few slips, hardly sampled, are described as well, or nearly, from several valleys: of a contact that has aged after a
few seconds, and of one that ages on and on; of slips that begin early and slowly, and of others that begin late. The
starts of the features are fits of one settled cycle, and all roll into the same valley. Starts thrown about the answer,
and about the first start of the data's own, do not, nor does what the levels of the data suggest before any fit: the
motions that follow from each of them say which to solve.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice, takewhile

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.base.quantiles import LEVEL, chi_square
from identify.estimation.attempt import Attempt, Clock, crept, resolve_firmly, solve_or_hold, usable
from identify.estimation.objection import Remembering
from identify.estimation.ranking import ranked
from identify.estimation.starts import own_starts, suggested_starts
from identify.estimation.strategies import Strategy, attempted
from identify.logs.unknowns import Unknowns
from identify.shooting.vibration import rhythmic

Array = NDArray[np.float64]

THROWN = 16  # starts about each place
SOLVED = 3  # of these, those that fit best before they are solved
LOWER = 0.1  # by which chi^2 must fall for a valley to be a lower one
LOOKS = 3  # how often starts are thrown about an answer, each time about a lower one
FAR = 2.0  # of the spread of a logarithm: a factor of about three; of a coefficient: half as far


def lowest_valley(attempt: Attempt, unknowns: Unknowns, seed: int, noise: Remembering) -> tuple[Attempt, list[Attempt]]:
    """Return the lowest place (the preferred one) to which starts lead that are thrown about an answer, and about a
    lower one once more; and the other valleys within its joint region: of all looks, and the answer given where it was
    left.

    Args:
        noise: of all logs: its memory widens that region.
    """
    valleys: list[Attempt] = []
    for look in range(LOOKS):
        if time_is_up():
            break
        valleys += other_valleys(attempt, unknowns, seed, noise, own=look == 0)
        here = attempt
        ended = (valley for valley in valleys if valley.gate.status is Status.CONVERGED)
        lowest = min((v for v in ended if preferred(v, here, unknowns, noise)), key=_cost, default=here)
        if lowest is here:
            break
        valleys = [here, *(valley for valley in valleys if valley is not lowest)]
        attempt = lowest
    return attempt, [valley for valley in valleys if within(attempt, valley, unknowns, noise)]


def other_valleys(
    attempt: Attempt, unknowns: Unknowns, seed: int, noise: Remembering, *, own: bool = True
) -> list[Attempt]:
    """Return the answers at which solves from thrown starts settle, the lowest first; all lie below the one given, or
    where the data object no more than within its joint region. That answer itself may be among them.

    They are of the very samples of the answer: a start may place the end of a log in its last stick elsewhere. Where
    the solver found no end to a ridge, they are no answers, but places on it all the same.

    Args:
        noise: as `lowest_valley`; own: starts are thrown about the data's own start too, and those that its levels
            suggest are tried.
    """
    thrown = takewhile(lambda _: not time_is_up(), _thrown(attempt, unknowns, seed, own))
    settled = (_settled(attempt, replace(unknowns, start=theta)) for theta in thrown)
    there = (other for other in settled if other is not None and within(attempt, other, unknowns, noise))
    return sorted(there, key=_cost)


def preferred(other: Attempt, attempt: Attempt, unknowns: Unknowns, noise: Remembering) -> bool:
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


def within(attempt: Attempt, other: Attempt, unknowns: Unknowns, noise: Remembering) -> bool:
    """Whether another answer, of the same samples, lies below one, or where the data object to it no more than within
    the joint region of that one."""
    if other.solved.problem.samples != attempt.solved.problem.samples:
        return False
    return objection(attempt, other, noise) < chi_square(LEVEL, int(np.sum(unknowns.free)))


def objection(attempt: Attempt, other: Attempt, noise: Remembering) -> float:
    """What the data object to another answer, of the same samples, as a loss in white noise; nothing where it lies
    lower."""
    loss = 2.0 * (_cost(other) - _cost(attempt))
    return 0.0 if loss <= 0.0 else noise.objection(attempt.solved.fitted, other.solved.fitted, loss)


def _thrown(attempt: Attempt, unknowns: Unknowns, seed: int, own: bool) -> Iterator[Array]:
    """The starts (n_p,) worth a solve."""
    logs, rng = list(attempt.prepared), np.random.default_rng(seed)
    far = FAR * unknowns.spread * np.where(unknowns.logarithmic, 1.0, 0.5)
    far = np.where(unknowns.free & ~rhythmic(unknowns), np.minimum(far, unknowns.prior_sd), 0.0)
    for place in (attempt.solved.theta, *islice(own_starts(logs, unknowns), int(own))):
        about = place + far * rng.standard_normal((THROWN, place.size))
        about = np.where(unknowns.free, np.clip(about, unknowns.lower, unknowns.upper), place)
        yield from (start.theta for start in ranked(logs, unknowns, about)[:SOLVED])
    if own:
        yield from (start.theta for start in ranked(logs, unknowns, suggested_starts(logs, unknowns))[:SOLVED])


def _settled(attempt: Attempt, unknowns: Unknowns) -> Attempt | None:
    """Where a solve of all logs of an answer from a start (unknowns.start) settles, with its samples, or comes to
    describe them on a ridge of which it finds no end; None where it does neither."""
    logs = list(attempt.prepared)
    found = attempted(
        Strategy.OTHER_OPTIMA, lambda: solve_or_hold(logs, usable(logs), unknowns, Clock()), attempt, attempt.logs
    )
    if found is None or len(found.logs) < len(logs):
        return None
    if crept(found) and found.solved.problem.samples == attempt.solved.problem.samples:
        return replace(found, logs=attempt.logs, prepared=attempt.prepared)
    return of_same_samples(attempt, found, unknowns) if found.gate.status is Status.CONVERGED else None


def of_same_samples(attempt: Attempt, found: Attempt, unknowns: Unknowns) -> Attempt | None:
    """Another answer of all logs of one, of the very samples of it; None where it does not settle there."""
    if found.solved.problem.samples != attempt.solved.problem.samples:
        moved = resolve_firmly(attempt, unknowns, found.solved.theta, found.solved.guesses)
        found = replace(moved, found_by=found.found_by)
    return (
        replace(found, logs=attempt.logs, prepared=attempt.prepared) if found.gate.status is Status.CONVERGED else None
    )
