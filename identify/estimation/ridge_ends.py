"""Other valleys: where data do not tell a parameter, motion that was placed for one value may not suit another.

A profile walks with the course of the motion as it stands (which phases follow each other, in the way to sliding above
all). A motion placed anew where the data hardly object may take another course, and describe them better. So may one
of the other sign of delta_mu_k: few slips are nearly as well described by friction that falls with the sliding speed as
by friction that rises, and no walk leads across. And where slips are hardly sampled, a contact that weakens at rest
(mu_s below mu_k0, ageing that never ends) with friction that falls far more can pass as noise beside the right answer.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.base.quantiles import LEVEL, chi_square
from identify.estimation.attempt import SLOWLY, Attempt, Clock, place_on, released, solve_placed, usable
from identify.estimation.other_optima import of_same_samples, preferred, weakens
from identify.estimation.residual_autocorrelation import Remembering
from identify.logs.unknowns import Unknowns
from identify.model.model import SPEED

# ----------------------------------------------------------------------------------------------------------------------
# An answer that slid along what the data do not tell, to where the model admits no more, is taken back inside.
#
# A bound that the scene gives is the user's word, and an answer at it is told. The model's own bounds only keep numbers
# in range: an answer at one of them, which the data like no better than one inside, says nothing but that they do not
# tell.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

AT_BOUND = 1e-6  # of the spread: a parameter that close to its bound sits on it


def at_own_bounds(unknowns: Unknowns, theta: Array) -> NDArray[np.bool_]:
    """Which parameters (n_p,) sit at a bound of the model that is none of the scene."""
    near = AT_BOUND * unknowns.spread
    low = (np.abs(theta - unknowns.lower) < near) & ~unknowns.walls[0]
    high = (np.abs(theta - unknowns.upper) < near) & ~unknowns.walls[1]
    return np.asarray(unknowns.free & (low | high))


def taken_inside(attempt: Attempt, unknowns: Unknowns, noise: Remembering) -> Attempt | None:
    """Return the answer inside the model's bounds that the data like nearly as well, held as loosely as it can be; None
    where the answer is inside already, or the data want it where it is.

    Args:
        noise: of all logs: with a memory it objects less.
    """
    theta = attempt.solved.theta
    outside = at_own_bounds(unknowns, theta)
    if not np.any(outside):
        return None
    limit = chi_square(LEVEL, int(np.sum(unknowns.free)))
    about = replace(unknowns, start=np.where(outside, unknowns.start, theta))
    best: Attempt | None = None
    for _, tried in released(attempt, about, SLOWLY):
        if tried.gate.status is not Status.CONVERGED or np.any(at_own_bounds(unknowns, tried.solved.theta)):
            break
        loss = 2.0 * (tried.solved.solution.cost - attempt.solved.solution.cost)
        best = tried if noise.objection(attempt.solved.fitted, tried.solved.fitted, loss) < limit else best
    return best


CLEAR = chi_square(LEVEL, 1)
"""By which chi^2 must fall for another course to count."""
FULL = 10.0  # times the highest sliding speed: a of a start whose friction changes at once
SHARE = 1 / 3  # of the drop of friction that is this change
STRONGER = ((1 / 3, 2.0), (0.6, 10.0), (1 / 3, 10.0), (0.6, 2.0))  # such shares, and a times the highest sliding speed
AGED = 0.2  # of the shortest stick: t_cr of a start whose contact strengthens at rest


def better_course(attempt: Attempt, unknowns: Unknowns, likely: Array) -> Attempt | None:
    """Return the better answer to which a motion placed anew at one of the ends of the ridge leads; None if none does.

    likely: (m, f) points that the data hardly object to, from the answer.
    """
    free = np.flatnonzero(unknowns.free)
    if likely.size == 0:
        return None
    widest = int(np.argmax(np.ptp(likely, axis=0) / unknowns.spread[free]))
    starts = []
    for end in {int(np.argmin(likely[:, widest])), int(np.argmax(likely[:, widest]))}:
        theta = attempt.solved.theta.copy()
        theta[free] += likely[end]
        starts.append(replace(unknowns, start=theta))
    return _better(attempt, starts, other_course=True)


def other_sign(attempt: Attempt, unknowns: Unknowns) -> Attempt | None:
    """Return the better answer whose friction changes with the sliding speed the other way; None if there is none."""
    return _better(attempt, _mirrored(attempt, unknowns))


def strengthened(attempt: Attempt, unknowns: Unknowns, noise: Remembering) -> Attempt | None:
    """Return the best answer whose contact strengthens at rest, where that of the answer weakens and the data do not
    tell it from that; None if there is none."""
    answers = (of_same_samples(attempt, other, unknowns) for other in _answers(attempt, _stronger(attempt, unknowns)))
    stronger = (other for other in answers if other is not None and not weakens(unknowns, other.solved.theta))
    known = (other for other in stronger if preferred(other, attempt, unknowns, noise))
    return min(known, key=lambda other: other.solved.solution.cost, default=None)


def _better(attempt: Attempt, starts: Iterable[Unknowns], *, other_course: bool = False) -> Attempt | None:
    """The best accepted answer from any of these starts, if it is clearly better than this one."""
    limit = attempt.solved.solution.cost - CLEAR / 2
    others = _answers(attempt, starts, other_course=other_course)
    clear = (other for other in others if other.solved.solution.cost < limit)
    return min(clear, key=lambda other: other.solved.solution.cost, default=None)


def _answers(attempt: Attempt, starts: Iterable[Unknowns], *, other_course: bool = False) -> Iterator[Attempt]:
    """The accepted answers from these starts; only from starts whose motion takes another course, if that is asked
    for."""
    logs = list(attempt.prepared)
    for start in starts:
        if time_is_up():
            break
        placed = place_on(logs, usable(logs), start)
        same = other_course and [g.course for *_, g in placed] == [g.course for g in attempt.solved.guesses]
        if len(placed) < len(logs) or same:
            continue
        tried = solve_placed(logs, placed, start, Clock())
        if tried.gate.status is Status.CONVERGED:
            yield replace(tried, logs=attempt.logs)


def _mirrored(attempt: Attempt, unknowns: Unknowns) -> Iterator[Unknowns]:
    """A start with the friction coefficient that the fastest slip of the answer has, and with it about its motion, but
    with a change of the other sign that is over at once; none where not all of this is searched."""
    told = _at_the_fastest(attempt, unknowns)
    if told is None:
        return
    (mu_s, mu_k0, delta_mu_k, a), fastest, level = told
    theta = attempt.solved.theta.copy()
    change = -float(np.copysign(SHARE * abs(theta[mu_s] - level), theta[delta_mu_k]))
    theta[[mu_k0, delta_mu_k, a]] = level - change, change, np.log(FULL / fastest)
    yield replace(unknowns, start=np.clip(theta, unknowns.lower, unknowns.upper))


def _stronger(attempt: Attempt, unknowns: Unknowns) -> Iterator[Unknowns]:
    """Starts with the same friction coefficient of the fastest slip, and the larger one of the answer's as that of a
    contact that has rested; none where the answer has mu_s above mu_k0, or not all of this is searched."""
    told, names = _at_the_fastest(attempt, unknowns), unknowns.names
    if told is None or "D" not in names or "t_cr" not in names or not unknowns.free[names.index("t_cr")]:
        return
    (mu_s, mu_k0, delta_mu_k, a), fastest, level = told
    answer = attempt.solved.theta
    sticks = np.concatenate([g.sticks for g in attempt.solved.guesses])
    if not weakens(unknowns, answer) or sticks.size == 0 or not np.min(sticks) > 0.0:
        return
    for share, turns in STRONGER:
        theta = answer.copy()
        change = -share * float(answer[mu_k0] - level)
        theta[[mu_s, mu_k0]] = answer[mu_k0], level - change
        theta[[delta_mu_k, a]] = change, np.log(turns / fastest)
        theta[names.index("D")] = unknowns.start[names.index("D")]
        theta[names.index("t_cr")] = np.log(AGED * float(np.min(sticks)))
        yield replace(unknowns, start=np.clip(theta, unknowns.lower, unknowns.upper))


def _at_the_fastest(attempt: Attempt, unknowns: Unknowns) -> tuple[list[int], float, float] | None:
    """The places of the friction coefficients in theta, the highest sliding speed [m/s] of an answer, and its friction
    coefficient there; None where not all of them are searched and common to all logs, or nothing slides."""
    names, theta = unknowns.names, attempt.solved.theta
    places = [names.index(name) for name in ("mu_s", "mu_k0", "delta_mu_k", "a") if name in names]
    if len(places) < 4 or not np.all(unknowns.free[places]) or np.any(unknowns.own[places]):
        return None
    fastest = max((float(np.nanmax(g.slip[..., SPEED], initial=0.0)) for g in attempt.solved.guesses), default=0.0)
    if not fastest > 0.0:
        return None
    _, mu_k0, delta_mu_k, a = places
    return places, fastest, float(theta[mu_k0] - theta[delta_mu_k] * np.expm1(-fastest * np.exp(theta[a])))
