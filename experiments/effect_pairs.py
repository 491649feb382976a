"""Every pair of effects: whether it composes, why not, and how far its motion is from an independent integrator's."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from identify.base.errors import SceneError
from identify.effects import ALL, MAIN
from identify.effects.quantities import Effect
from identify.model.model import assemble
from tests.support import effects_case as case


@dataclass(frozen=True)
class Pair:
    """Two effects in company of the main ones: the refusal, or how far the two integrators are apart."""

    first: str
    second: str
    refused: str
    departure: case.Departure | None

    @property
    def agrees(self) -> bool:
        """Whether it was simulated and agrees."""
        return self.departure is not None and self.departure.times < case.TIMES and self.departure.force < case.FORCES


def company(*effects: Effect) -> tuple[str, ...]:
    """The effects, what they need, and the main ones without their rivals."""
    roles = {effect.role for effect in effects if effect.role}
    own = [name for effect in effects for name in (effect.name, *effect.needs)]
    main = [name for name in MAIN if case.BY_NAME[name].role not in roles]
    return tuple(dict.fromkeys([*main, *own]))


def pairs(step: int = 1) -> Iterator[Pair]:
    """Every pair of the table (every `step`-th), composed and simulated where it composes."""
    for a, b in list(combinations(ALL, 2))[::step]:
        names = company(a, b)
        try:
            assemble(names)
        except SceneError as error:
            yield Pair(a.name, b.name, str(error), None)
            continue
        yield Pair(a.name, b.name, "", case.departure(names, case.numbers(names)))


def without_inertia() -> Iterator[tuple[str, str]]:
    """Every other effect, alone with contact ageing and without inertia: its name, and the refusal ("": none)."""
    for effect in ALL:
        if effect.name == "inertia":
            continue
        names = tuple(dict.fromkeys(["contact_ageing", *effect.needs, effect.name]))
        try:
            assemble(tuple(n for n in names if n != "inertia"))
        except SceneError as error:
            yield effect.name, str(error)
        else:
            yield effect.name, ""
