"""Steady sliding of the composed model: its state, its eigenvalues, and the drive speeds at which it is unstable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.base.compiled import Mapped
from identify.base.errors import SimulationError
from identify.model.model import SPEED, Model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sliding:
    """Steady sliding at the drive speed, SI.

    state (n_x,); force the load cell sees [N]; renewed: the bounded state stays at its bound; eigenvalues [1/s] of
    small disturbances, descending real part then imaginary part (one fewer when renewed).
    """

    drive_speed: float
    state: Array
    force: float
    renewed: bool
    eigenvalues: NDArray[np.complex128]

    @property
    def growth(self) -> float:
        """Growth rate of the least stable disturbance [1/s]; negative: all die out."""
        return float(np.max(self.eigenvalues.real))

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out."""
        return self.growth < 0.0


def _split(settings: Array) -> tuple[Array, Array]:
    """Parameters p (n, n_p) and inputs u (n, 4) of the model, sliding forwards at time 0, of settings (n, n_w)."""
    w = np.atleast_2d(settings)
    forwards = np.stack([w[:, -1], w[:, -2], np.ones(len(w)), np.zeros(len(w))], axis=1)
    return np.ascontiguousarray(w[:, :-2]), forwards


@lru_cache(maxsize=32)
def _linear(model: Model, renewed: bool) -> Mapped:
    """(x, p, u) -> dx/dt and, row by row, its Jacobian, of the sliding model."""
    x, p = ca.SX.sym("x", len(model.states)), ca.SX.sym("p", len(model.parameters))
    u = ca.SX.sym("u", 4)
    rate = (model.renewed if renewed else model.slip)(x, p, u)
    return Mapped(ca.Function("linear", [x, p, u], [ca.densify(rate), ca.densify(ca.vec(ca.jacobian(rate, x).T))]))


def linearised(model: Model, renewed: bool, x: Array, p: Array, u: Array) -> tuple[Array, Array]:
    """dx/dt (n, n_x) while sliding, its Jacobian (n, n_x, n_x): x (n, n_x), p (n, n_p), u (n, 4)."""
    rate, slope = _linear(model, renewed)([x, p, u])
    return rate, slope.reshape(len(x), x.shape[1], -1)


def _steady(model: Model, p: Array, u: Array, renewed: bool) -> tuple[Array, Array]:
    """(states (n, n_x), reduced Jacobians (n, r, r)) at which every rate vanishes while sliding at the drive speed."""
    x = np.tile([s.start for s in model.states], (p.shape[0], 1))
    x[:, SPEED] = u[:, 0]
    unknown = np.array([i for i in range(x.shape[1]) if i != SPEED and not (renewed and i == model.clamped)])
    # The elongation's own rate vanishes with the speed; the acceleration determines the elongation.
    rates = np.where(unknown == 0, SPEED, unknown)
    if renewed and model.clamped is not None:
        x[:, model.clamped] = model.states[model.clamped].lower or 0.0
    slope = np.empty(0)
    for _ in range(30):  # one is enough where the rates are linear in the states
        rate, slope = linearised(model, renewed, x, p, u)
        step = np.linalg.solve(slope[:, rates[:, None], unknown], rate[:, rates][..., None])[..., 0]
        x[:, unknown] -= step
        if np.all(np.abs(step) <= 1e-12 * np.abs(x[:, unknown]) + 1e-300):
            break
    kept = np.sort(np.append(unknown, SPEED))
    return x, slope[:, kept[:, None], kept]


def _slidings(model: Model, p: Array, u: Array) -> tuple[Array, NDArray[np.bool_], NDArray[np.complex128]]:
    """States (n, n_x), renewed (n,) and eigenvalues (n, n_x; NaN last where renewed) of rows p (n, n_p), u (n, 4)."""
    try:
        x, slope = _steady(model, p, u, renewed=False)
        renewed = np.zeros(x.shape[0], dtype=bool)
        if model.clamped is not None:
            renewed = x[:, model.clamped] < (model.states[model.clamped].lower or 0.0)
        values = np.full(x.shape, np.nan + 0j)
        values[~renewed] = np.linalg.eigvals(slope[~renewed])
        if np.any(renewed):
            x[renewed], slope = _steady(model, p[renewed], u[renewed], renewed=True)
            values[renewed, : slope.shape[-1]] = np.linalg.eigvals(slope)
    except np.linalg.LinAlgError as error:
        speeds = np.unique(u[:, 0])
        raise SimulationError(
            f"no steady sliding at {speeds[0]:.3g} to {speeds[-1]:.3g} m/s was found ({error}); check the parameters"
        ) from error
    return x, renewed, values


def slidings(model: Model, settings: Array) -> list[Sliding]:
    """Steady sliding at settings (n, n_w): parameters, normal force [N], drive speed [m/s], positive.

    Raises:
        SimulationError: no finite steady state.
    """
    p, u = _split(settings)
    x, renewed, values = _slidings(model, p, u)
    forces, out = np.array(model.sliding_cell(x.T, p.T, u.T)).ravel().tolist(), []
    for i in range(len(p)):
        known = values[i][np.isfinite(values[i])]
        order = np.lexsort((-known.imag, -known.real))
        out.append(Sliding(float(u[i, 0]), x[i], forces[i], bool(renewed[i]), known[order]))
    return out


def growth_rates(model: Model, settings: Array) -> Array:
    """Growth rates of the least stable disturbance of steady sliding [1/s], shape (n,), at settings (n, n_w).

    Raises:
        SimulationError: no finite steady state.
    """
    return np.asarray(np.nanmax(_slidings(model, *_split(settings))[2].real, axis=1))
