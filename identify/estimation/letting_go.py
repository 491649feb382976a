"""An answer that an event holds which can go no farther: let it go, and follow the motion where the data pull.

A rest, or a contact that re-ages, happens or does not; at the parameters where it just happens its length is zero, and
no solve that keeps the sequence of modes gets past them. Followed anew at the answer itself, or a step beyond, along
the pull of the data, the motion is another one, and the solve goes on from there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.estimation.attempt import BETTER, Attempt, solve_moved
from identify.estimation.hanging import Held, held_back
from identify.estimation.sequence import followed_anew, resequenced
from identify.logs.log_data import Guess
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns

Array = NDArray[np.float64]

AGAIN = 8  # how often an answer is let go: one event after the other may vanish
FARTHER = (1.0, 2.0, 4.0)  # times the pull, until the motion that follows is another one


def let_go(attempt: Attempt, unknowns: Unknowns) -> Attempt | None:
    """The answer beyond the events that hold this one; None where nothing holds it, or nothing better is met there."""
    best: Attempt | None = None
    for _ in range(AGAIN):
        if time_is_up():
            break
        beyond = _beyond(best or attempt, unknowns)
        if beyond is None:
            break
        best = beyond
    return best


def _beyond(attempt: Attempt, unknowns: Unknowns) -> Attempt | None:
    """The answer of the first other motion on the way that the data pull; None where it fits no better."""
    held = held_back(attempt.solved)
    if held is None:
        return None
    for cut, guesses, there in _other_motions(attempt, unknowns, held):
        other = solve_moved(attempt, cut, guesses, there)
        if other.gate.status is Status.CONVERGED and other.excess < attempt.excess - BETTER:
            return other
    return None


def _other_motions(
    attempt: Attempt, unknowns: Unknowns, held: Held
) -> Iterator[tuple[list[Prepared], list[Guess], Unknowns]]:
    """Logs and motions, followed at the answer as it is and, the first that is another sequence, where the data pull
    it; with the start that each was followed at."""
    logs, guesses = attempt.prepared, attempt.solved.guesses
    there = replace(unknowns, start=attempt.solved.theta)
    anew = followed_anew(logs, logs, guesses, there)
    if anew is not None:
        yield *anew, there
    for theta in _pulled(attempt.solved.theta, np.flatnonzero(unknowns.free), held.move):
        there = replace(unknowns, start=theta)
        anew = resequenced(logs, logs, guesses, there)
        if anew is not None:
            yield *anew, there
            return


def _pulled(theta: Array, free: NDArray[np.int64], move: Array) -> Iterator[Array]:
    """Parameters (n_p,) farther and farther along a move (f,) of the free ones."""
    for times in FARTHER:
        moved = theta.copy()
        moved[free] += times * move
        yield moved
