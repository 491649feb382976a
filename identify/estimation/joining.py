"""Some logs first: those a start describes are solved, and the others join at their answer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.estimation.attempt import Attempt, Clock, place_on, solve_from
from identify.estimation.events import TOO_BAD, misfit_of_start, with_events_mended
from identify.logs.prepare import Prepared, settled_part
from identify.logs.unknowns import Unknowns

BETTER = 0.1  # of the misfit of the worst log: a start that is so much better on a log is good there


def from_some(
    prepared: list[Prepared], first: list[int], able: list[int], unknowns: Unknowns, clock: Clock
) -> Attempt | None:
    """The answer by way of those of some logs on which the start (unknowns.start) is good, where it is not on all: a
    log near the end of stick-slip says little of itself until the friction is known well. None where that leads to no
    answer that describes all logs that are able: few logs are described by many answers."""
    misfits = {i: misfit_of_start(prepared[i], unknowns) for i in first}
    worst = max((misfit for misfit in misfits.values() if np.isfinite(misfit)), default=0.0)
    good = [i for i in first if misfits[i] < max(TOO_BAD, BETTER * worst)]
    if not 0 < len(good) < len(first):
        return None
    found = solve_from(prepared, good, unknowns, clock)
    if found is None or found.gate.status is not Status.CONVERGED:
        return None
    for late in (first, able):
        found = join(found, prepared, [i for i in late if i not in found.logs], unknowns, clock)
        if not set(late) <= set(found.logs):
            return None
    return found


def join(best: Attempt, prepared: list[Prepared], late: list[int], unknowns: Unknowns, clock: Clock) -> Attempt:
    """Solve again with the logs that took no part so far, their slips mended at the answer, where it can be placed on
    them."""
    at_answer = replace(unknowns, start=best.solved.theta)
    seen = {i: prepared[i] for i in late if prepared[i].manner.faint}
    forms = {i: _placeable(prepared[i], at_answer) for i in late}
    prepared = [forms.get(i) or log for i, log in enumerate(prepared)]
    late = [i for i in late if forms[i] is not None]
    if not late:
        return best
    joined = solve_from(prepared, sorted([*best.logs, *late]), at_answer, clock)
    if joined is not None and joined.gate.status is Status.CONVERGED:
        return joined
    # One log that does not fit must not keep out the others, nor one that is taken up too early.
    found = _one_by_one(best, prepared, late, seen, unknowns, clock)
    if len(late) == 1 or set(late) <= set(found.logs) or time_is_up():
        return found
    other = _one_by_one(best, prepared, late[::-1], seen, unknowns, clock)
    return other if len(other.logs) > len(found.logs) else found


def _one_by_one(
    best: Attempt,
    prepared: list[Prepared],
    late: list[int],
    seen: dict[int, Prepared],
    unknowns: Unknowns,
    clock: Clock,
) -> Attempt:
    """The answer that the late logs join in this order, as far as they do: as they are, the faint ones also as they
    were seen, and of a course that does not fit its steady end."""
    for i in late:
        if time_is_up():
            break
        at_best = replace(unknowns, start=best.solved.theta)
        for log in _forms(prepared[i], seen.get(i), at_best, tried=len(late) == 1):
            having = [log if j == i else other for j, other in enumerate(prepared)]
            joined = solve_from(having, sorted([*best.logs, i]), at_best, clock)
            if joined is not None and joined.gate.status is Status.CONVERGED:
                best, prepared = joined, having
                break
    return best


def _forms(log: Prepared, seen: Prepared | None, unknowns: Unknowns, *, tried: bool) -> Iterator[Prepared]:
    """The forms of a log in the order in which they deserve a try, each made when it is asked for: mending takes time.

    Args:
        seen: a faint log as it was seen. tried: the log as it is has been.
    """
    if not tried:
        yield log
    if seen is not None:
        yield with_events_mended(seen, unknowns)
    settled = settled_part(log)
    if settled is not None:
        yield settled


def _placeable(log: Prepared, unknowns: Unknowns) -> Prepared | None:
    """A log with its slips mended, else its steady end: of slips that the noise hides the data tell the level; else
    followed, whatever was seen of its slips: a swing that dies out near the end of stick-slip looks like some. None
    where it can be placed as none of these."""
    made = (_mended(log, unknowns), settled_part(log), log.as_course if log.manner.name == "cycles" else None)
    forms = (form for form in made if form is not None)
    return next((form for form in forms if place_on([form], [0], unknowns)), None)


def _mended(log: Prepared, unknowns: Unknowns) -> Prepared:
    """A log with its slips mended; one whose slips the noise hides is followed, whatever was seen of them."""
    return log.as_course if log.manner.faint else with_events_mended(log, unknowns)
