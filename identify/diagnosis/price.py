"""What an effect costs, counted: states, operations of one evaluation of the motion, parameters."""

from __future__ import annotations

from collections.abc import Sequence

from identify.base.errors import SceneError
from identify.model.model import Model, assemble


def price(effect: str, effects: Sequence[str]) -> str:
    """In words, what an effect costs in a model with (or without) it; "" where the comparison does not compose."""
    others = tuple(e for e in effects if e != effect)
    try:
        with_it, without = assemble((*others, effect)), assemble(others)
    except SceneError:
        return ""
    states = len(with_it.states) - len(without.states)
    operations = _operations(with_it) - _operations(without)
    parameters = sum(q.kind != "given" for q in with_it.parameters) - sum(q.kind != "given" for q in without.parameters)
    share = 100.0 * operations / _operations(without)
    return f"{states} states, {operations} operations ({share:+.0f} %), {parameters} parameters"


def _operations(model: Model) -> int:
    return int(model.slip.n_instructions())
