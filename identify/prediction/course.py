"""A way through the settings of a cycle: what moves, and how, while a branch of orbits is followed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Course:
    """Settings w (n_w,) = parameters, normal force [N], drive speed [m/s] by one rising coordinate s, of order 1.

    setting: s -> w; slope: s -> dw/ds.
    """

    setting: Callable[[float], Array]
    slope: Callable[[float], Array]

    def reversed(self) -> Course:
        """The same way the other way round: its coordinate is -s."""
        return Course(lambda s: self.setting(-s), lambda s: -self.slope(-s))


def drive_course(setting: Array) -> Course:
    """Every drive speed, the rest as in one setting; s is the logarithm of the drive speed in m/s."""

    def at(s: float) -> Array:
        return np.append(setting[:-1], np.exp(s))

    def slope(s: float) -> Array:
        return np.append(np.zeros(setting.size - 1), np.exp(s))

    return Course(at, slope)
