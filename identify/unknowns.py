"""What is searched: which parameters are free, in which scale, with which bounds and priors.

Search variable of a parameter: its deviation from a base value, or the logarithm of the ratio to it.
For friction parameters the base is 0 or 1, so theta is the value or its logarithm; for rig quantities
the base is each log's own value, so one theta shared by all logs is a common deviation of the rig.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.model import RIG_PARAMETERS, Model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Unknowns:
    """The search space, all arrays (n_p,) in the order of the model's parameters.

    `start` is theta at the first guess and the value of what is not free; `lower`, `upper` bound theta;
    `prior_mean`, `prior_sd` are Gaussian (sd infinite: no prior); `spread` conditions the solver.
    """

    model: Model
    free: NDArray[np.bool_]
    start: Array
    lower: Array
    upper: Array
    prior_mean: Array
    prior_sd: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names in the order of theta."""
        return self.model.parameter_names

    @property
    def spread(self) -> Array:
        """Typical uncertainty of theta before a fit."""
        return np.array([q.spread for q in self.model.parameters])

    @property
    def logarithmic(self) -> NDArray[np.bool_]:
        """Which parameters are searched by their logarithm."""
        return np.array([q.scale == "log" for q in self.model.parameters])

    def base(self, rig: Mapping[str, float]) -> Array:
        """Base values for a log with this rig (mass, stiffness, damping by name)."""
        neutral = np.where(self.logarithmic, 1.0, 0.0)
        return np.array([rig[n] if n in RIG_PARAMETERS else neutral[i] for i, n in enumerate(self.names)])

    def values(self, theta: Array, base: Array) -> Array:
        """Parameter values from theta (..., n_p) and base (..., n_p)."""
        with np.errstate(over="ignore"):
            return np.where(self.logarithmic, base * np.exp(theta), base + theta)

    def theta(self, values: Array, base: Array) -> Array:
        """Theta of parameter values (..., n_p)."""
        with np.errstate(all="ignore"):
            return np.where(self.logarithmic, np.log(values / base), values - base)
