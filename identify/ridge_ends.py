"""Other valleys: where data do not tell a parameter, motion that was placed for one value may not suit another.

A profile walks with the course of the motion as it stands (which phases follow each other, in the way to sliding above
all). A motion placed anew where the data hardly object may take another course, and describe them better. So may one
of the other sign of delta_mu_k: few slips are nearly as well described by friction that falls with the sliding speed as
by friction that rises, and no walk leads across. And where slips are hardly sampled, a contact that weakens at rest
(mu_s below mu_k0, ageing that never ends) with friction that falls far more can pass as noise beside the right answer.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from identify.attempt import Attempt, Clock, place_on, solve_placed, usable
from identify.model import SPEED
from identify.outcome import Status
from identify.uncertainty import LEVEL
from identify.unknowns import Unknowns

Array = NDArray[np.float64]

CLEAR = float(chi2.ppf(LEVEL, 1))
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
    best: Attempt | None = None
    for end in {int(np.argmin(likely[:, widest])), int(np.argmax(likely[:, widest]))}:
        theta = attempt.solved.theta.copy()
        theta[free] += likely[end]
        there = replace(unknowns, start=theta)
        logs = list(attempt.prepared)
        placed = place_on(logs, usable(logs), there)
        if len(placed) < len(logs) or [g.course for *_, g in placed] == [g.course for g in attempt.solved.guesses]:
            continue
        tried = solve_placed(logs, placed, there, Clock())
        if tried.gate.status is not Status.CONVERGED:
            continue
        limit = attempt.solved.solution.cost - CLEAR / 2 if best is None else best.solved.solution.cost
        if tried.solved.solution.cost < limit:
            best = replace(tried, logs=attempt.logs)
    return best


def other_sign(attempt: Attempt, unknowns: Unknowns) -> Attempt | None:
    """Return the better answer whose friction changes with the sliding speed the other way; None if there is none."""
    start = _mirrored(attempt, unknowns)
    logs = list(attempt.prepared)
    placed = [] if start is None else place_on(logs, usable(logs), start)
    if start is None or len(placed) < len(logs):
        return None
    tried = solve_placed(logs, placed, start, Clock())
    better = tried.solved.solution.cost < attempt.solved.solution.cost - CLEAR / 2
    return replace(tried, logs=attempt.logs) if better and tried.gate.status is Status.CONVERGED else None


def strengthened(attempt: Attempt, unknowns: Unknowns) -> Attempt | None:
    """Return the better answer whose contact strengthens at rest, where that of the answer weakens; None if there is
    none."""
    best: Attempt | None = None
    for start in _stronger(attempt, unknowns):
        logs = list(attempt.prepared)
        placed = place_on(logs, usable(logs), start)
        if len(placed) < len(logs):
            continue
        tried = solve_placed(logs, placed, start, Clock())
        limit = attempt.solved.solution.cost - CLEAR / 2 if best is None else best.solved.solution.cost
        if tried.gate.status is Status.CONVERGED and tried.solved.solution.cost < limit:
            best = replace(tried, logs=attempt.logs)
    return best


def _mirrored(attempt: Attempt, unknowns: Unknowns) -> Unknowns | None:
    """A start with the friction coefficient that the fastest slip of the answer has, and with it about its motion, but
    with a change of the other sign that is over at once; None where not all of this is searched."""
    places, (fastest, level) = _searched(unknowns), _at_the_fastest(attempt, unknowns)
    if places is None or not fastest > 0.0:
        return None
    mu_s, mu_k0, delta_mu_k, a = places
    theta = attempt.solved.theta.copy()
    change = -float(np.copysign(SHARE * abs(theta[mu_s] - level), theta[delta_mu_k]))
    theta[[mu_k0, delta_mu_k, a]] = level - change, change, np.log(FULL / fastest)
    return replace(unknowns, start=np.clip(theta, unknowns.lower, unknowns.upper))


def _stronger(attempt: Attempt, unknowns: Unknowns) -> Iterator[Unknowns]:
    """Starts with the same friction coefficient of the fastest slip, and the larger one of the answer's as that of a
    contact that has rested; none where the answer has mu_s above mu_k0, or not all of this is searched."""
    places, (fastest, level) = _searched(unknowns), _at_the_fastest(attempt, unknowns)
    ageing = [unknowns.names.index(name) for name in ("D", "t_cr") if name in unknowns.names]
    sticks = np.concatenate([[np.inf], *(g.onset[1:] - g.arrest[: g.onset.size - 1] for g in attempt.solved.guesses)])
    shortest = float(np.min(sticks))
    if places is None or len(ageing) < 2 or not fastest > 0.0 or not 0.0 < shortest < np.inf:
        return
    answer, (mu_s, mu_k0, delta_mu_k, a), (D, t_cr) = attempt.solved.theta, places, ageing
    if answer[mu_s] >= answer[mu_k0]:
        return
    for share, turns in STRONGER:
        theta = answer.copy()
        change = -share * float(answer[mu_k0] - level)
        theta[[mu_s, mu_k0]] = answer[mu_k0], level - change
        theta[[delta_mu_k, a]] = change, np.log(turns / fastest)
        theta[[D, t_cr]] = unknowns.start[D], np.log(AGED * shortest)
        yield replace(unknowns, start=np.clip(theta, unknowns.lower, unknowns.upper))


def _searched(unknowns: Unknowns) -> list[int] | None:
    """The places of the friction coefficients in theta, where all of them are searched and common to all logs."""
    names = unknowns.names
    asked = [names.index(name) for name in ("mu_s", "mu_k0", "delta_mu_k", "a") if name in names]
    whole = len(asked) == 4 and np.all(unknowns.free[asked]) and not np.any(unknowns.own[asked])
    return asked if whole else None


def _at_the_fastest(attempt: Attempt, unknowns: Unknowns) -> tuple[float, float]:
    """The highest sliding speed [m/s] of an answer, and its friction coefficient there; (0, 0) where nothing slides."""
    places, theta = _searched(unknowns), attempt.solved.theta
    fastest = max((float(np.nanmax(g.slip[..., SPEED], initial=0.0)) for g in attempt.solved.guesses), default=0.0)
    if places is None or not fastest > 0.0:
        return 0.0, 0.0
    _, mu_k0, delta_mu_k, a = places
    return fastest, float(theta[mu_k0] - theta[delta_mu_k] * np.expm1(-fastest * np.exp(theta[a])))
