"""Typical sizes of a scene: they set first steps and absolute tolerances."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from identify.model.model import ELONGATION, SPEED, Model
from identify.simulation.resting import swing

Array = NDArray[np.float64]

SHARE = 4.0  # steps on one period or wave, at least


@dataclass(frozen=True)
class Scales:
    """Typical time [s] and state sizes (n_x,) of a scene under a normal force [N].

    No step is longer than `longest` [s] or goes farther than `farthest` [m]: an error estimate sees no vibration
    and no track that it steps over.
    """

    time: float
    state: Array
    normal_force: float
    longest: float
    farthest: float


def scales(model: Model, p: Array, normal_force: float) -> Scales:
    """Natural time scale sqrt(m/k), and the states a load of one normal force gives."""
    return _scales(model, np.asarray(p, float).tobytes(), float(normal_force))


@lru_cache(maxsize=256)
def _scales(model: Model, parameters: bytes, normal_force: float) -> Scales:
    p = np.frombuffer(parameters)
    values = dict(zip(model.parameter_names, p.tolist(), strict=True))
    k, m = values["stiffness"], values["mass"]
    state = np.ones(len(model.states))
    state[ELONGATION], state[SPEED] = normal_force / k, normal_force / np.sqrt(k * m)
    farthest = float(np.min(np.array(model.finest(p)))) if model.finest.numel_out(0) else np.inf
    state.setflags(write=False)
    return Scales(float(np.sqrt(m / k)), state, normal_force, swing(model, p)[0] / SHARE, farthest / SHARE)
