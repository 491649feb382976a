"""The models a choice of effects compares: parts of one general model, in which an absent effect is held at its null
values, so that the functions are built once and the sums compare exactly."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from data_io import Record
from identify.diagnosis.fitted import Fitted
from identify.diagnosis.nested import fit_model
from identify.effects import ALL
from identify.effects.quantities import Effect
from identify.logs.unknowns import from_scene
from identify.scene import Scene
from identify.scene.variant import scene_with

ALWAYS = ("inertia",)
# Effects whose null values are numbers: held there, they are absent.
HELD = ("velocity_weakening", "direct_effect", "load_dependence", "occlusion", "excitation", "finger_motion")
BY_NAME = {effect.name: effect for effect in ALL}


@dataclass(frozen=True)
class ComparedModels:
    """The models a selection compares: a scene of effects to be chosen, its records, the effects that may be chosen,
    and where their parameters start (SI)."""

    scene: Scene
    records: tuple[Record, ...]
    asked: tuple[str, ...]
    starts: dict[str, float]

    def of(self, effects: Iterable[str]) -> Scene:
        """The scene of a subset of effects: the others that can be are held at their null values."""
        present = {*ALWAYS, *effects}
        roles = {BY_NAME[name].role for name in present} - {""}
        held = [n for n in HELD if n in self.asked and n not in present and BY_NAME[n].role not in roles]
        made = scene_with(self.scene, [e.name for e in ALL if e.name in present or e.name in held], self.starts)
        shared = {q.name for name in present for q in BY_NAME[name].parameters}
        parameters = dict(made.parameters)
        for effect in (BY_NAME[name] for name in held):
            for q in effect.parameters:
                if q.name in parameters and q.name not in shared:
                    parameters[q.name] = replace(
                        parameters[q.name], start=None, prior_mean=None, prior_sd=None, fixed=_absent(effect, q.name)
                    )
        return replace(made, parameters=parameters)

    def searched(self, kept: Sequence[str]) -> int:
        """How many parameters the model of these effects searches."""
        return int(np.count_nonzero(from_scene(self.of(kept)).free))

    def simulated(self, kept: Sequence[str]) -> Fitted:
        """The model of these effects, fitted from the data alone."""
        return fit_model(self.of(kept), self.records, thorough=False)


def _absent(effect: Effect, name: str) -> float:
    """A value of a parameter of an effect that is held absent."""
    declared = next(q for q in effect.parameters if q.name == name)
    return effect.null.get(name, declared.default)
