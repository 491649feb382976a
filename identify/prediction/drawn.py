"""Operating points drawn from what is known of one: parameters, drive speed and load as their covariance has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from identify.model.model import Model

Array = NDArray[np.float64]

POINT = ("drive_speed", "normal_force")  # what a covariance may name beside the parameters; positive
WIDEST = 3.0  # standard deviation of a logarithm, or of a parameter in its own values, beyond which nothing is drawn


@dataclass(frozen=True)
class Drawn:
    """Draws of an operating point: p (n, n_p) in the model's order, drive_speed (n,) [m/s], normal_force (n,) [N].

    kept: which of all that were drawn these n are; the others no pair can have (kinetic friction lost, or above the
    static).
    """

    p: Array
    drive_speed: Array
    normal_force: Array
    kept: NDArray[np.bool_]

    @property
    def refused(self) -> int:
        """Draws that no pair can have."""
        return int(np.sum(~self.kept))


def unknown(model: Model, values: Mapping[str, float], names: Sequence[str], covariance: ArrayLike) -> tuple[str, ...]:
    """Which of the named quantities the covariance leaves open, so that there is nothing to draw from."""
    matrix = np.asarray(covariance, float)
    with np.errstate(all="ignore"):
        sd = np.sqrt(np.diag(matrix)) / np.array([_size(model, values, name) for name in names])
    bad = ~(sd < WIDEST) | ~np.all(np.isfinite(matrix), axis=0)
    return tuple(name for name, open_ in zip(names, bad, strict=True) if open_)


def draw(
    model: Model,
    values: Mapping[str, float],
    names: Sequence[str],
    covariance: ArrayLike,
    count: int,
    seed: int = 0,
) -> Drawn:
    """`count` draws: normal in the logarithm of what is searched by its logarithm (speed and load too), else in the
    value, with the covariance (f, f) of the values [SI] of `names`; the rest of `values` (parameters, "drive_speed",
    "normal_force") stays.

    Raises:
        ValueError: a quantity that `unknown` names.
    """
    open_ = unknown(model, values, names, covariance)
    if open_:
        raise ValueError(f"nothing can be drawn of {', '.join(open_)}: the covariance leaves it open")
    normal = _normal(count, len(names), seed)
    return _moved(model, values, names, normal @ _root(covariance, scales_of(model, values, names)).T)


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


def axis_points(
    model: Model, values: Mapping[str, float], names: Sequence[str], covariance: ArrayLike, deviations: float
) -> tuple[Drawn, Array]:
    """Points so many standard deviations to both sides along the principal axes of what is drawn, and their steps
    (n, f) from the centre, in logarithms where `scales_of` has the value."""
    root = _root(covariance, scales_of(model, values, names)).T
    root = root[np.any(np.abs(root) > 1e-9, axis=1)]
    steps = deviations * np.concatenate([root, -root])
    return _moved(model, values, names, steps), steps


def scales_of(model: Model, values: Mapping[str, float], names: Sequence[str]) -> Array:
    """Derivatives (f,) of the values by what is drawn: the value where that is its logarithm, else 1."""
    return np.array([values[name] if _logarithmic(model, values, name) else 1.0 for name in names], dtype=float)


def _moved(model: Model, values: Mapping[str, float], names: Sequence[str], steps: Array) -> Drawn:
    """The operating point after steps (n, f) of what is drawn."""
    logs = np.array([_logarithmic(model, values, name) for name in names], dtype=bool)
    centre = np.array([values[name] for name in names], dtype=float)
    count = len(steps)
    moved = np.where(logs, centre * np.exp(np.where(logs, steps, 0.0)), centre + steps)
    columns = {name: np.full(count, float(value)) for name, value in values.items()}
    columns |= {name: moved[:, i] for i, name in enumerate(names)}
    p = np.stack([columns[name] for name in model.parameter_names], axis=1)
    kept = _possible(model, columns, p)
    return Drawn(p[kept], columns["drive_speed"][kept], columns["normal_force"][kept], kept)


def _root(covariance: ArrayLike, scale: Array) -> Array:
    """A root of the covariance of what is drawn: logarithms where `scale` is their value."""
    matrix = np.asarray(covariance, float) / np.outer(scale, scale)
    variances, directions = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray(directions * np.sqrt(np.maximum(variances, 0.0)))


def _logarithmic(model: Model, values: Mapping[str, float], name: str) -> bool:
    return values[name] > 0.0 and (name in POINT or model.parameter(name).scale == "log")


def _size(model: Model, values: Mapping[str, float], name: str) -> float:
    return abs(values[name]) if _logarithmic(model, values, name) else 1.0


def _possible(model: Model, columns: Mapping[str, Array], p: Array) -> NDArray[np.bool_]:
    """Which draws a pair can have: inside the bounds of the model, friction above zero, static above kinetic."""
    low = np.array([model.parameter(name).lower for name in model.parameter_names])
    high = np.array([model.parameter(name).upper for name in model.parameter_names])
    inside = np.all((p >= low) & (p <= high), axis=1)
    lowest = columns["mu_k0"] + np.minimum(columns.get("delta_mu_k", np.zeros(p.shape[0])), 0.0)
    return np.asarray(inside & (lowest > 0.0) & (columns["mu_s"] > columns["mu_k0"]))
