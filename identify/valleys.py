"""Valleys beside that of an answer: where data do not tell a parameter, the way of the search may have chosen.

From a start of the data's own features a solve wanders as far as the data do not hold it, and few slips, hardly
sampled, are described as well from two valleys: of a contact that has aged after a few seconds, and of one that ages on
and on. Held about the start on its way, and released at the end of it, a solve ends in the valley that is nearest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from identify.attempt import Attempt, Clock, resolve, solve_from, usable
from identify.guess import Guess
from identify.level import LEVEL
from identify.outcome import Status
from identify.prepare import Prepared
from identify.quantiles import chi_square
from identify.search import own_starts
from identify.unknowns import Unknowns

Array = NDArray[np.float64]

STARTS = 2  # of the data's own that are held
FIRMNESS = (5.0, 8.0, 13.0, 4.0, 10.0)  # of the priors that hold them on their way: the next where one leads nowhere


@dataclass(frozen=True)
class Valley:
    """A place where a solve settles, at which the data object no more than within the joint region of the answer: theta
    (n_p,), and the motion there."""

    theta: Array
    motion: list[Guess]


def other_valleys(attempt: Attempt, unknowns: Unknowns) -> list[Valley]:
    """Return the valleys that solves end in which are held about the data's own starts; the answer's may be among them.

    They are of the very samples of the answer: a start may place the end of a log in its last stick elsewhere.
    """
    limit = attempt.solved.solution.cost + 0.5 * chi_square(LEVEL, int(np.sum(unknowns.free)))
    logs = list(attempt.prepared)
    found = []
    for theta in islice(own_starts(logs, unknowns), STARTS):
        held = _held(logs, replace(unknowns, start=theta))
        if held is None:
            continue
        there = replace(attempt, solved=replace(attempt.solved, guesses=held.solved.guesses))
        freed = resolve(there, replace(unknowns, start=held.solved.theta))
        if freed.gate.status is Status.CONVERGED and freed.solved.solution.cost < limit:
            found.append(Valley(freed.solved.theta, freed.solved.guesses))
    return found


def _held(logs: list[Prepared], unknowns: Unknowns) -> Attempt | None:
    """What describes all logs while it is held about a start (unknowns.start); None where nothing does."""
    for firmness in FIRMNESS:
        held = solve_from(logs, usable(logs), unknowns, Clock(), firmness)
        if held is not None and held.gate.status is Status.CONVERGED and len(held.logs) == len(logs):
            return held
    return None
