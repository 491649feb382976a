"""What an effect costs, counted: states, parameters and instructions of the model.

Counted on the composition of the main effects without rivals of the effect, once with it and once without.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from identify.effects.quantities import Effect
from identify.model.model import assemble
from tests.support import effects_case as case

COUNTED = ("slip", "rest", "grip", "load_cell")


@dataclass(frozen=True)
class Cost:
    """Counts of one composition: states and parameters of the model, instructions by function of COUNTED."""

    states: int
    parameters: int
    instructions: tuple[int, ...]


def pair(effect: Effect) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The composition without the effect, and with it."""
    less = case.without(effect)
    return less, (*less, effect.name)


@lru_cache(maxsize=64)
def cost(names: tuple[str, ...]) -> Cost:
    """The counts of one composition."""
    model = assemble(names)
    instructions = tuple(int(getattr(model, name).n_instructions()) for name in COUNTED)
    return Cost(len(model.states), len(model.parameters), instructions)
