"""Where a straight line says too little of how an answer follows the parameters, and its interval from draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import LEVEL, NORMAL
from identify.model.model import Model
from identify.prediction.cycle import CycleMap
from identify.prediction.drawn import Drawn, axis_points, draw, scales_of, unknown
from identify.prediction.spread import Interval

Array = NDArray[np.float64]
Answer = Callable[[CycleMap, float], Array | None]  # positive numbers (q,) of a pair at a drive speed [m/s], if any

DRAWS = 200
LEAST_DRAWS = 40  # that have an answer, for an interval
WIDE = 0.05  # half width of a logarithm from which its straightness is looked at
BENT = 0.1  # of a half width, by which an answer may leave its line at the ends of the interval


@dataclass(frozen=True)
class Uncertain:
    """An operating point and what is known of it: values [SI] of every parameter, "drive_speed" and "normal_force";
    covariance (f, f) [SI] of `names` among them."""

    model: Model
    values: Mapping[str, float]
    names: Sequence[str]
    covariance: Array

    @property
    def known(self) -> bool:
        """Whether there is something to draw from."""
        return not unknown(self.model, self.values, self.names, self.covariance)

    def drawn(self) -> Drawn:
        """Draws of the operating point."""
        return draw(self.model, self.values, self.names, self.covariance, DRAWS)

    def is_skew(self, answer: Answer, centre: Array, slopes: Array) -> bool:
        """Whether positive answers (q,), `centre` at the point itself, leave the straight lines of their logarithms
        within the 95 % of what is known: looked at where each principal axis of the covariance ends.

        Args:
            slopes: derivatives (q, f) [SI] of the answers by `names`.
        """
        drawn, steps = axis_points(self.model, self.values, self.names, self.covariance, NORMAL)
        lines = slopes * scales_of(self.model, self.values, self.names) / centre[:, None]
        half = np.sqrt(0.5 * np.sum(np.square(lines @ steps.T), axis=1))
        if np.all(half < WIDE):
            return False
        if not np.all(drawn.kept) or not np.all(np.isfinite(half)):
            return True
        for (map_, speed), step in zip(maps(self.model, drawn), steps, strict=True):
            moved = answer(map_, speed)
            if moved is None:
                return True
            if np.any(np.abs(np.log(moved / centre) - lines @ step) > BENT * np.maximum(half, WIDE)):
                return True
        return False


def maps(model: Model, drawn: Drawn) -> list[tuple[CycleMap, float]]:
    """The map and the drive speed [m/s] of every draw."""
    points = zip(drawn.p, drawn.drive_speed, drawn.normal_force, strict=True)
    return [(CycleMap(model, float(load), p), float(speed)) for p, speed, load in points]


def sampled(values: Array) -> Interval:
    """The interval between the outer quantiles of draws (n,); open where too few of them have an answer (not NaN)."""
    told = values[np.isfinite(values)]
    if told.size < LEAST_DRAWS:
        return Interval(None, None, f"only {told.size} of {values.size} draws of what is known have an answer")
    low, high = np.quantile(told, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Interval(float(low), float(high), drawn=True)
