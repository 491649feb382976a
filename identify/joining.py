"""Some logs first: those a start describes are solved, and the others join at their answer."""

from __future__ import annotations

from dataclasses import replace

from identify.attempt import Attempt, Clock, place_on, solve_from
from identify.events import TOO_BAD, misfit_of_start, with_events_mended
from identify.outcome import Status
from identify.prepare import Prepared, settled_part
from identify.unknowns import Unknowns


def from_some(prepared: list[Prepared], first: list[int], unknowns: Unknowns, clock: Clock) -> Attempt | None:
    """The answer by way of the logs on which the start (unknowns.start) is good, where it is not on all: a log near the
    end of stick-slip says little of itself until the friction is known well. None where that leads nowhere."""
    good = [i for i in first if misfit_of_start(prepared[i], unknowns) < TOO_BAD]
    if not 0 < len(good) < len(first):
        return None
    found = solve_from(prepared, good, unknowns, clock)
    if found is None or found.gate.status is not Status.CONVERGED:
        return None
    at_answer = replace(unknowns, start=found.solved.theta)
    late = [i for i in first if i not in good]
    having = [with_events_mended(log, at_answer) if i in late else log for i, log in enumerate(prepared)]
    joined = join(found, having, late, unknowns, clock)
    return joined if set(first) <= set(joined.logs) else None


def join(best: Attempt, prepared: list[Prepared], late: list[int], unknowns: Unknowns, clock: Clock) -> Attempt:
    """Solve again with the logs that took no part so far, where the answer can be placed on them."""
    at_answer = replace(unknowns, start=best.solved.theta)
    late = [i for i in late if place_on(prepared, [i], at_answer)]
    if not late:
        return best
    joined = solve_from(prepared, sorted([*best.logs, *late]), at_answer, clock)
    if joined is not None and joined.gate.status is Status.CONVERGED:
        return joined
    # One log that does not fit must not keep out the others; of a course that does not, its steady end may.
    for i in late:
        settled = settled_part(prepared[i])
        for log in (prepared[i], settled):
            if log is None or (len(late) == 1 and log is prepared[i]):
                continue
            having = [log if j == i else other for j, other in enumerate(prepared)]
            joined = solve_from(having, sorted([*best.logs, i]), replace(unknowns, start=best.solved.theta), clock)
            if joined is not None and joined.gate.status is Status.CONVERGED:
                best, prepared = joined, having
                break
    return best
