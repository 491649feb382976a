"""Does an answer hang on an event that can go no farther?

A rest, or a contact that re-ages in mid-slide, can shrink to nothing from pass to pass, since at the answer it does not
happen: the motion may then be held where the data do not want it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.estimation.agreement import imbalance
from identify.estimation.allowed import influence_at
from identify.logs.log_data import Guess
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
