"""Intervals of derived quantities from the covariance of the parameters, open where a line says nothing.

A quantity follows the parameters in a straight line only as far as they are known to move it. The covariance is
therefore taken apart into independent directions, each in units of the parameters' own sizes. A direction in which
the parameters may move by half their size or more is unresolved; a quantity that it moves noticeably has an open
interval, and the reason names the parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.base.quantiles import NORMAL
from identify.model.model import Model
from identify.prediction.outlook_words import listed

Array = NDArray[np.float64]

UNRESOLVED = 0.5  # standard deviation of a direction, in sizes of its parameters
NOTICED = 0.02  # share of a quantity that an unresolved direction may move without opening its interval
DEPENDS = 1e-9  # share of a quantity per size of a parameter of unknown variance
WIDEST = float(np.log(10.0))  # half width of the logarithm: beyond a factor ten either way a line says nothing
NAMED = 0.3  # part in a direction, of the largest, from which a parameter is named

UNKNOWN_SLOPE = "how it follows the parameters could not be determined here"
TOO_WIDE = "the data leave it open by more than a factor of ten"


@dataclass(frozen=True)
class Interval:
    """Ends of a 95 % interval, both None where it is open, and then the reason; drawn: whether they are quantiles of
    draws, else of a straight line."""

    low: float | None
    high: float | None
    reason: str = ""
    drawn: bool = False


class Spread:
    """What a covariance (f, f) of the parameters `names` (SI, not of logarithms) does to quantities.

    Args:
        p: every parameter of the model (n_p,). Variances may be huge, infinite or NaN: not identifiable.
        point: values [SI] of what the covariance names beside the parameters: "drive_speed", "normal_force".
    """

    def __init__(
        self,
        model: Model,
        p: Array,
        names: Sequence[str],
        covariance: Array,
        point: Mapping[str, float] | None = None,
    ) -> None:
        self.names = tuple(names)
        self._size = np.array([_size(model, p, name, point or {}) for name in self.names])
        known = np.all(np.isfinite(covariance), axis=0) & (np.diag(covariance) >= 0.0)
        if not np.all(known):  # what is only correlated with the unknown stays
            known = np.isfinite(np.diag(covariance)) & (np.diag(covariance) >= 0.0)
            inner = covariance[np.ix_(known, known)]
            known[np.flatnonzero(known)[~np.all(np.isfinite(inner), axis=0)]] = False
        self._known = known
        scaled = (covariance / np.outer(self._size, self._size))[np.ix_(known, known)]
        variances, self._directions = np.linalg.eigh(0.5 * (scaled + scaled.T))
        self._sd = np.sqrt(np.maximum(variances, 0.0))

    def deviation(self, value: float, slopes: Array) -> float | None:
        """Standard deviation of a quantity over |value|, to first order; None where it is open."""
        width, reason = self._width(slopes, abs(value))
        return None if reason or not np.isfinite(width) else width / NORMAL

    def positive(self, value: float, slopes: Array) -> Interval:
        """Interval of a positive quantity with derivatives `slopes` (f,), by its logarithm."""
        width, reason = self._width(slopes, value)
        if not reason and not width < WIDEST:
            reason = TOO_WIDE
        return (
            Interval(None, None, reason)
            if reason
            else Interval(float(value * np.exp(-width)), float(value * np.exp(width)))
        )

    def signed(self, value: float, slopes: Array, size: float) -> Interval:
        """Interval of a quantity of either sign, of typical `size`, with derivatives `slopes` (f,)."""
        width, reason = self._width(slopes, max(abs(value), size))
        half = width * max(abs(value), size)
        return Interval(None, None, reason) if reason else Interval(value - half, value + half)

    def _width(self, slopes: Array, size: float) -> tuple[float, str]:
        """Half width over `size`, and why there is none."""
        with np.errstate(all="ignore"):
            shares = slopes * self._size / size
        if not np.all(np.isfinite(shares)):
            return np.nan, UNKNOWN_SLOPE
        parts = (shares[self._known] @ self._directions) * self._sd
        guilty = self._directions[:, (self._sd > UNRESOLVED) & (np.abs(parts) > NOTICED)]
        named = np.zeros(len(self.names), dtype=bool)
        if guilty.size:
            strength = np.max(np.abs(guilty), axis=1)
            named[np.flatnonzero(self._known)[strength > NAMED * np.max(strength)]] = True
        named |= ~self._known & (np.abs(shares) > DEPENDS)
        if np.any(named):
            which = [name for name, said in zip(self.names, named, strict=True) if said]
            return np.nan, f"these data do not tell {listed(which)}, on which it depends"
        return NORMAL * float(np.linalg.norm(parts)), ""


def _size(model: Model, p: Array, name: str, point: Mapping[str, float]) -> float:
    """Typical size of a quantity, in which its moves are measured."""
    if name in point:
        return abs(point[name])
    declared, value = model.parameter(name), abs(float(p[model.parameter_names.index(name)]))
    size = max(value, declared.spread if declared.scale == "linear" else 0.0)
    return size if size > 0.0 else abs(declared.default)
