"""Does an answer hang on an event that can go no farther?

A rest, or a contact that re-ages in mid-slide, can shrink to nothing from pass to pass, since at the answer it does not
happen: the motion may then be held where the data do not want it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.base.budget import time_is_up
from identify.base.outcome import Status
from identify.estimation.agreement import imbalance, influence_at
from identify.estimation.attempt import BETTER, Attempt, solve_moved
from identify.estimation.sequence import followed_anew, resequenced
from identify.logs.log_data import Guess
from identify.logs.prepare import Prepared
from identify.logs.unknowns import Unknowns
from identify.shooting.passes import Solved, goes_as_far_as_it_can

Array = NDArray[np.float64]

HELD = 4.0  # squared distance from which on an answer hangs on what is no data: two standard errors


@dataclass(frozen=True)
class Held:
    """An answer that is held back: by how much, squared, in units of its covariance; the move (f,) of the free
    parameters that the data ask for; which logs (l,) have an event that goes as far as it can."""

    squared: float
    move: Array
    ends: tuple[bool, ...]


def held_back(solved: Solved) -> Held | None:
    """What holds an answer back by more than two standard errors; None where nothing does."""
    problem, solution = solved.problem, solved.solution
    ends = [bool(goes_as_far_as_it_can(problem, solution.x, place.events).any()) for place in problem.layout.places]
    if not any(ends):
        return None
    try:
        squared, move = imbalance(problem, solution.z, influence_at(solved))
    except np.linalg.LinAlgError:  # directions that no log tells: their verdicts say so
        return None
    free = int(np.count_nonzero(problem.layout.unknowns.free))
    return None if squared < HELD else Held(squared, move[:free], tuple(ends))


def hanging(solved: Solved, names: Sequence[str]) -> str | None:
    """A sentence where a phase that can get no shorter holds the answer back by more than two standard errors.

    Args:
        names: of the logs.
    """
    held = held_back(solved)
    if held is None:
        return None
    (begin, end), name = min(
        (
            (_shortest(guess), name)
            for guess, name, there in zip(solved.guesses, names, held.ends, strict=True)
            if there
        ),
        key=lambda found: found[0][1] - found[0][0],
    )
    return (
        f"{name}: at this answer what happens from {begin:.5g} s lasts {end - begin:.2g} s only, if it happens at all, "
        f"and holds the answer back by {np.sqrt(held.squared):.1f} standard errors; leave this log out or end it "
        "there, or give start values"
    )


def _shortest(guess: Guess) -> tuple[float, float]:
    """Begin and end [s] of the shortest phase of a motion after its first onset."""
    if guess.times.size < 2:
        return float(guess.times[0]), float(guess.times[0])
    first = int(np.argmin(np.diff(guess.times)))
    return float(guess.times[first]), float(guess.times[first + 1])


# ----------------------------------------------------------------------------------------------------------------------
# An answer that an event holds which can go no farther: let it go, and follow the motion where the data pull.
#
# A rest, or a contact that re-ages, happens or does not; at the parameters where it just happens its length is zero,
# and no solve that keeps the sequence of modes gets past them. Followed anew at the answer itself, or a step beyond,
# along the pull of the data, the motion is another one, and the solve goes on from there.
# ----------------------------------------------------------------------------------------------------------------------

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
