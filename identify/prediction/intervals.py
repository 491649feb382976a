"""What a covariance says of answers: draws of operating points, intervals by straight lines, intervals from draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from identify.base.quantiles import LEVEL, NORMAL
from identify.model.model import Model
from identify.prediction.cycle import CycleMap
from identify.prediction.map_axes import admissible
from identify.prediction.wording import listed

# ----------------------------------------------------------------------------------------------------------------------
# Operating points drawn from what is known of one: parameters, drive speed and load as their covariance has them; and
# where a straight line says too little of how an answer follows them, its interval from draws.
# ----------------------------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

Answer = Callable[[CycleMap, float], Array | None]  # positive numbers (q,) of a pair at a drive speed [m/s], if any

DRAWS = 200
LEAST_DRAWS = 40  # that have an answer, for an interval
WIDE = 0.05  # half width of a logarithm from which its straightness is looked at
BENT = 0.1  # of a half width, by which an answer may leave its line at the ends of the interval
POINT = ("drive_speed", "normal_force")  # what a covariance may name beside the parameters; positive
WIDEST = 3.0  # standard deviation of a logarithm, or of a parameter in its own values, beyond which nothing is drawn


@dataclass(frozen=True)
class OperatingPoint:
    """Where a prediction is taken: every parameter of the model by name [SI], drive speed [m/s] (sign irrelevant, not
    zero), normal force [N] (positive), covariance (f, f) of the fitted parameters in their own SI units (not of
    logarithms; variances of what is not identifiable may be huge or infinite), None without one."""

    values: Mapping[str, float]
    drive_speed: float
    normal_force: float
    covariance: ArrayLike | None = None


@dataclass(frozen=True)
class Drawn:
    """Draws of an operating point: settings (n, n_w), parameters in the model's order, normal force [N], drive speed
    [m/s].

    kept: which of all that were drawn these n are; the others no pair can have (kinetic friction lost, or above the
    static).
    """

    settings: Array
    kept: NDArray[np.bool_]

    @property
    def refused(self) -> int:
        """Draws that no pair can have."""
        return int(np.sum(~self.kept))


def _normal(count: int, dimensions: int, seed: int) -> Array:
    """Standard normal points (count, dimensions) of a shifted additive recurrence with the generalised golden ratio
    (Roberts 2018): quantiles settle on far fewer of them than of independent ones."""
    ratio = 1.5
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1))
    steps = ratio ** -np.arange(1.0, dimensions + 1.0)
    shift = np.random.default_rng(seed).uniform(size=dimensions)
    uniform = (shift + np.arange(1.0, count + 1.0)[:, None] * steps) % 1.0
    return np.asarray(ndtri(np.clip(uniform, 1e-12, 1.0 - 1e-12)))


@dataclass(frozen=True)
class Uncertain:
    """An operating point and what is known of it: values [SI] of every parameter, "drive_speed" and "normal_force";
    covariance (f, f) [SI] of `names` among them.

    What is searched by its logarithm (speed and load too) is drawn in it, the rest in its value.
    """

    model: Model
    values: Mapping[str, float]
    names: Sequence[str]
    covariance: ArrayLike

    @property
    def unknown(self) -> tuple[str, ...]:
        """Which quantities the covariance leaves open, so that there is nothing to draw from."""
        matrix = np.asarray(self.covariance, float)
        with np.errstate(all="ignore"):
            sd = np.sqrt(np.diag(matrix)) / self._scales
        bad = ~(sd < WIDEST) | ~np.all(np.isfinite(matrix), axis=0)
        return tuple(name for name, open_ in zip(self.names, bad, strict=True) if open_)

    def draw(self, count: int = DRAWS, seed: int = 0) -> Drawn:
        """`count` draws: normal, with the covariance of what is drawn; what has no name in it stays.

        Raises:
            ValueError: a quantity is unknown.
        """
        if self.unknown:
            raise ValueError(f"nothing can be drawn of {', '.join(self.unknown)}: the covariance leaves it open")
        return self._moved(_normal(count, len(self.names), seed) @ self._root.T)

    def is_skew(self, answer: Answer, centre: Array, slopes: Array) -> bool:
        """Whether positive answers (q,), `centre` at the point itself, leave the straight lines of their logarithms
        within the 95 % of what is known: looked at where each principal axis of the covariance ends.

        Args:
            slopes: derivatives (q, f) [SI] of the answers by `names`.
        """
        axes = self._root.T
        axes = axes[np.any(np.abs(axes) > 1e-9, axis=1)]
        steps = NORMAL * np.concatenate([axes, -axes])
        drawn, lines = self._moved(steps), slopes * self._scales / centre[:, None]
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

    @cached_property
    def _centre(self) -> Array:
        return np.array([self.values[name] for name in self.names], dtype=float)

    @cached_property
    def _logs(self) -> NDArray[np.bool_]:
        """Whether each quantity (f,) is drawn in its logarithm."""
        by_log = [name in POINT or self.model.parameter(name).scale == "log" for name in self.names]
        return (self._centre > 0.0) & np.array(by_log, dtype=bool)

    @cached_property
    def _scales(self) -> Array:
        """Derivatives (f,) of the values by what is drawn: the value where that is its logarithm, else 1."""
        return np.where(self._logs, self._centre, 1.0)

    @cached_property
    def _root(self) -> Array:
        """A root (f, f) of the covariance of what is drawn."""
        matrix = np.asarray(self.covariance, float) / np.outer(self._scales, self._scales)
        variances, directions = np.linalg.eigh(0.5 * (matrix + matrix.T))
        return np.asarray(directions * np.sqrt(np.maximum(variances, 0.0)))

    def _moved(self, steps: Array) -> Drawn:
        """The operating point after steps (n, f) of what is drawn."""
        moved = np.where(self._logs, self._centre * np.exp(np.where(self._logs, steps, 0.0)), self._centre + steps)
        columns = {name: np.full(len(steps), float(value)) for name, value in self.values.items()}
        columns |= dict(zip(self.names, moved.T, strict=True))
        order = (*self.model.parameter_names, "normal_force", "drive_speed")
        settings = np.stack([columns[name] for name in order], axis=1)
        kept = admissible(self.model, settings)
        return Drawn(settings[kept], kept)


def maps(model: Model, drawn: Drawn) -> list[tuple[CycleMap, float]]:
    """The map and the drive speed [m/s] of every draw."""
    return [(CycleMap.of(model, w), float(w[-1])) for w in drawn.settings]


def sampled(values: Array) -> AnswerInterval:
    """The interval between the outer quantiles of draws (n,); open where too few of them have an answer (not NaN)."""
    told = values[np.isfinite(values)]
    if told.size < LEAST_DRAWS:
        return AnswerInterval(None, None, f"only {told.size} of {values.size} draws of what is known have an answer")
    low, high = np.quantile(told, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return AnswerInterval(float(low), float(high), drawn=True)


# ----------------------------------------------------------------------------------------------------------------------
# Intervals of derived quantities from the covariance of the parameters, open where a line says nothing.
#
# A quantity follows the parameters in a straight line only as far as they are known to move it. The covariance is
# therefore taken apart into independent directions, each in units of the parameters' own sizes. A direction in which
# the parameters may move by half their size or more is unresolved; a quantity that it moves noticeably has an open
# interval, and the reason names the parameters.
# ----------------------------------------------------------------------------------------------------------------------

UNRESOLVED = 0.5  # standard deviation of a direction, in sizes of its parameters
NOTICED = 0.02  # share of a quantity that an unresolved direction may move without opening its interval
DEPENDS = 1e-9  # share of a quantity per size of a parameter of unknown variance
SPREAD_WIDEST = float(np.log(10.0))  # half width of the logarithm: beyond a factor ten either way a line says nothing
NAMED = 0.3  # part in a direction, of the largest, from which a parameter is named

UNKNOWN_SLOPE = "how it follows the parameters could not be determined here"
TOO_WIDE = "the data leave it open by more than a factor of ten"


@dataclass(frozen=True)
class AnswerInterval:
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
        self._size = np.array([_spread_size(model, p, name, point or {}) for name in self.names])
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

    def positive(self, value: float, slopes: Array) -> AnswerInterval:
        """Interval of a positive quantity with derivatives `slopes` (f,), by its logarithm."""
        width, reason = self._width(slopes, value)
        if not reason and not width < SPREAD_WIDEST:
            reason = TOO_WIDE
        return (
            AnswerInterval(None, None, reason)
            if reason
            else AnswerInterval(float(value * np.exp(-width)), float(value * np.exp(width)))
        )

    def signed(self, value: float, slopes: Array, size: float) -> AnswerInterval:
        """Interval of a quantity of either sign, of typical `size`, with derivatives `slopes` (f,)."""
        width, reason = self._width(slopes, max(abs(value), size))
        half = width * max(abs(value), size)
        return AnswerInterval(None, None, reason) if reason else AnswerInterval(value - half, value + half)

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


def _spread_size(model: Model, p: Array, name: str, point: Mapping[str, float]) -> float:
    """Typical size of a quantity, in which its moves are measured."""
    if name in point:
        return abs(point[name])
    declared, value = model.parameter(name), abs(float(p[model.parameter_names.index(name)]))
    size = max(value, declared.spread if declared.scale == "linear" else 0.0)
    return size if size > 0.0 else abs(declared.default)
