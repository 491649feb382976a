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

from identify.attempt import FIRST, SLOWLY, Attempt, Clock, released, solve_from, usable
from identify.guess import Guess
from identify.level import LEVEL
from identify.outcome import Status
from identify.quantiles import chi_square
from identify.search import own_starts
from identify.unknowns import Unknowns

Array = NDArray[np.float64]

STARTS = 2  # of the data's own that are held


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
        settled = _settled(attempt, replace(unknowns, start=theta))
        if settled is not None and settled.solved.solution.cost < limit:
            found.append(Valley(settled.solved.theta, settled.solved.guesses))
    return found


def _settled(attempt: Attempt, unknowns: Unknowns) -> Attempt | None:
    """Where a solve of the samples of an answer ends that was held about a start (unknowns.start), and released so
    slowly that each step is a small one; None where it is lost on its way."""
    logs = list(attempt.prepared)
    for first in range(FIRST):
        held = solve_from(logs, usable(logs), unknowns, Clock(), SLOWLY[first])
        if held is None or held.gate.status is not Status.CONVERGED or len(held.logs) < len(logs):
            continue
        on_the_way = released(replace(attempt, solved=held.solved), unknowns, SLOWLY[first + 1 :])
        for firmness, here in on_the_way:
            if here.gate.status is not Status.CONVERGED:
                break
            if firmness == SLOWLY[-1]:
                return here
    return None
