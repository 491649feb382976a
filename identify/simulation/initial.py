"""Where a simulation starts: what the scene says of its states, the others in keeping with it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from identify.base.errors import SimulationError
from identify.model.model import ELONGATION, Model

Array = NDArray[np.float64]


def initial_states(model: Model, p: Array, u: Array, given: Mapping[str, float]) -> dict[str, float]:
    """States by name at the start of a simulation, SI.

    A series element and the lags of a load cell start settled at the force that the elongation means at rest, so
    that nothing moves of itself.

    Args:
        p: parameters (n_p,). u: inputs (4,) at the start. given: states by name; "elongation" is the whole one, of
            rig and series element together.

    Raises:
        SimulationError: a sliding speed for a model without inertia, where it is no state.
    """
    if model.balance is not None and given.get("sliding_speed", 0.0) != 0.0:
        raise SimulationError(
            f"the motion is to start at {given['sliding_speed']:g} m/s, but without inertia the speed follows from the "
            "balance of forces; drop sliding_speed from [initial], or add the effect inertia"
        )
    names = [s.name for s in model.states]
    told = {name: value for name, value in given.items() if name in names}
    named = {s.name: s.start for s in model.states} | told
    if model.decays.numel_out(0) == 0:
        return named
    unloaded, loaded = (np.array(model.at_force(force, p, u)).ravel() for force in (0.0, 1.0))
    share = (named["elongation"] - unloaded[ELONGATION]) / (loaded[ELONGATION] - unloaded[ELONGATION])
    settled = unloaded + share * (loaded - unloaded)
    return dict(zip(names, settled.tolist(), strict=True)) | told
