"""A scene with other effects than it lists."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from identify.scene.scene import Scene


def scene_with(scene: Scene, effects: Sequence[str], starts: Mapping[str, float]) -> Scene:
    """The scene with these effects, its parameters started where something is known of them.

    What the scene itself says of a parameter stands.

    Raises:
        SceneError: effects that do not go together.
    """
    made = scene.with_effects(tuple(effects))
    parameters = dict(made.parameters)
    for name, value in starts.items():
        spec = parameters.get(name)
        if spec is None or spec.states_value:
            continue
        if spec.fixed is not None:
            parameters[name] = replace(spec, fixed=value)
        else:
            parameters[name] = replace(spec, start=float(np.clip(value, spec.lower, spec.upper)))
    return replace(made, parameters=parameters)
