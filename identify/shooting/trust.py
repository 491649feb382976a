"""How far one pass of a solve is trusted: parameters and events go no farther from where the samples were assigned.

From a start that is off a solve takes steps along what it sees there, and may be lost after the first: a slip begins
from an unstable equilibrium, and what a parameter does to it holds for a small part of its range. Held to such a part,
each pass is an easy solve, and the next begins where it ended.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from identify.logs.log_data import Guess
from identify.shooting.layout import kept_parameters
from identify.shooting.shooting import Problem

Array = NDArray[np.float64]

FIRST = 0.5  # of the spread of a parameter
OF_A_SLIP = 1 / 3  # of its duration: for the events about it
WIDER, NARROWER = 1.5, 0.25  # times that, after a pass that was easy and one that was lost
EASY = 8  # iterations
LOST = 3  # passes that may be lost
EDGE = 0.99  # of the way to where trust ends: what goes as far is held back


@dataclass(frozen=True)
class Trust:
    """How far parameters may go, in their spreads, and how many passes were lost so far."""

    reach: float = FIRST
    lost: int = 0

    def after(self, easy: bool) -> Trust:
        """What is trusted after a pass that succeeded."""
        return replace(self, reach=self.reach * WIDER) if easy else self

    def less(self) -> Trust | None:
        """What is trusted after a pass that was lost; None where enough were."""
        return None if self.lost == LOST else Trust(self.reach * NARROWER, self.lost + 1)

    def bounds(self, problem: Problem, guesses: Sequence[Guess]) -> tuple[Array, Array]:
        """Lower and upper bounds of the unknowns (n,), in physical units."""
        layout = problem.layout
        room = np.full(layout.size, np.inf)
        kept = kept_parameters(layout)
        room[kept] = self.reach * layout.scale[kept]
        for place, guess in zip(layout.places, guesses, strict=True):
            slip = float(np.median(guess.arrest - guess.onset)) if guess.cycles else np.inf
            room[place.events] = OF_A_SLIP * slip
        return np.maximum(layout.lower, layout.start - room), np.minimum(layout.upper, layout.start + room)

    def held_to(self, problem: Problem, guesses: Sequence[Guess]) -> Problem:
        """The problem within what is trusted."""
        lower, upper = self.bounds(problem, guesses)
        out = copy.copy(problem)
        out.layout = replace(problem.layout, lower=lower, upper=upper)
        return out


def held_back(problem: Problem, x: Array) -> bool:
    """Whether some parameter or event went as far as the problem lets it, from its start, in a point x (n,)."""
    layout = problem.layout
    moved = x - layout.start
    asked = np.union1d(kept_parameters(layout), layout.events)
    room = np.where(moved > 0.0, layout.upper - layout.start, layout.start - layout.lower)[asked]
    return bool(np.any(np.abs(moved[asked]) > EDGE * room))
