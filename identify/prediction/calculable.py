"""Which models repeat themselves: only they have a cycle, a steady sliding and a critical speed to be asked for."""

from __future__ import annotations

from collections.abc import Callable

from identify.base.errors import SimulationError
from identify.effects import ALL
from identify.model.model import Model, assemble


def check_calculable(model: Model) -> None:
    """Refuse a model of which no cycle is like the one before.

    Raises:
        SimulationError: the effects that are to blame, and what to do.
    """
    if model.balance is not None:
        raise SimulationError(
            "the effect inertia is off: stability and amplitude of stick-slip are those of a moving mass; "
            "add inertia to effects and give the mass under [rig]"
        )
    for what, why in (
        (lambda m: m.clocked, "changes with time as such, so that no cycle is like the one before"),
        (lambda m: m.jumps, "deals every stick its own friction, so that no cycle is like the one before"),
    ):
        if what(model):
            names = _to_blame(model, what)
            effects, it = f"effect {names[0]}" if len(names) == 1 else f"effects {' and '.join(names)}", names[0]
            raise SimulationError(
                f"the {effects} {why}; leave {it if len(names) == 1 else 'them'} out for stability and amplitude "
                f"({' '.join(f'--without {name}' for name in names)}), or look at a simulation"
            )


def _to_blame(model: Model, what: Callable[[Model], bool]) -> list[str]:
    """The effects that bring it by themselves; all of them where it takes several."""
    own = [e for e in ALL if e.name in model.effects and e.name != "inertia"]
    alone = [e.name for e in own if what(assemble(tuple(dict.fromkeys(("inertia", *e.needs, e.name)))))]
    return alone or list(model.effects)
