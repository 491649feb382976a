"""What stays the same during one phase of motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Situated:
    """Parameters p (n_p,), drive speed [m/s], direction of sliding (+1 or -1), normal force at the start of the phase
    [N] and its slope [N/s], time at its start [s]."""

    p: Array
    drive_speed: float
    direction: float
    normal_force: float
    force_slope: float
    time: float = 0.0

    @property
    def numbers(self) -> tuple[float, float, float, float, float]:
        """What the step functions read behind the parameters."""
        return (self.drive_speed, self.direction, self.normal_force, self.force_slope, self.time)

    @property
    def inputs(self) -> Array:
        """The same as an array, shape (5,)."""
        return np.array(self.numbers)

    @property
    def constants(self) -> Array:
        """p and the inputs, shape (n_p + 5,)."""
        return np.append(self.p, self.numbers)

    def at(self, t: float | Array, direction: float = 1.0) -> Array:
        """u of the model (4,) or (4, n) at times t [s] within the phase."""
        t = np.asarray(t, float)
        ones = np.ones_like(t)
        force = self.normal_force + self.force_slope * t
        return np.stack([self.drive_speed * ones, force, direction * ones, self.time + t])
