"""Steady sliding of the composed model: the state in which nothing changes while the mass goes as fast as the drive."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from identify.model.model import ELONGATION, INPUTS, SPEED, Model

Array = NDArray[np.float64]

STEPS = 40  # of Newton's method: one is enough where the rates are linear in the states
CLOSE = 1e-9  # of the typical states: the last step


@dataclass(frozen=True)
class Steadiness:
    """A state (n_x,) that does not change, and whether the bounded state is held at its bound there."""

    state: Array
    saturated: bool


def rate_slopes(model: Model, x: Array, p: Array, u: Array) -> Array:
    """Derivatives (n_x, n_x) of the rates of a sliding mass with respect to its states, no state held."""
    return _rates(model, False, x, p, u)[1]


def steadiness(model: Model, p: Array, u: Array) -> Steadiness | None:
    """The state of steady sliding under inputs u (4,); None where there is none (something goes on changing).

    Args:
        p: (n_p,).
    """
    if model.clocked:
        return None
    free = _settled(model, p, u, saturated=False)
    if model.clamped is None or (free is not None and free[model.clamped] > (model.states[model.clamped].lower or 0.0)):
        return None if free is None else Steadiness(free, False)
    held = _settled(model, p, u, saturated=True)
    return None if held is None else Steadiness(held, True)


def decay(model: Model, at: Steadiness, p: Array, u: Array) -> float:
    """Rate [1/s] at which the slowest small deviation from steady sliding fades; negative where it grows."""
    slopes = _rates(model, at.saturated, at.state, p, u)[1]
    moving = [i for i in range(at.state.size) if not (at.saturated and i == model.clamped)]
    return float(-np.max(np.linalg.eigvals(slopes[np.ix_(moving, moving)]).real))


def _settled(model: Model, p: Array, u: Array, *, saturated: bool) -> Array | None:
    """Newton's method on the rates of all states but the elongation, which the speed of the drive answers for."""
    held = (model.clamped,) if saturated else ()
    solved = [i for i in range(len(model.states)) if i != SPEED and i not in held]
    rows = [i for i in range(len(model.states)) if i != ELONGATION and i not in held]
    level = p[model.parameter_names.index("mu_k0")] * u[1]
    x = np.array(model.at_force(level, p, u)).ravel()
    x[SPEED] = u[0]
    for i in held:
        assert i is not None
        x[i] = model.states[i].lower or 0.0
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            rates, slopes = _rates(model, saturated, x, p, u)
            if not np.all(np.isfinite(rates)) or not np.all(np.isfinite(slopes)):
                return None
            move = np.linalg.lstsq(slopes[np.ix_(rows, solved)], -rates[rows], rcond=None)[0]
            x[solved] += move
            if np.all(np.abs(move) <= CLOSE * (np.abs(x[solved]) + 1e-12)):
                left = np.abs(_rates(model, saturated, x, p, u)[0][rows])
                reach = np.max(np.abs(slopes[rows]) * (np.abs(x) + 1e-12), axis=1)
                return x if np.all(left <= 1e-6 * reach) else None
    return None


@lru_cache(maxsize=64)
def _function(model: Model, saturated: bool) -> ca.Function:
    x, p, u = ca.SX.sym("x", len(model.states)), ca.SX.sym("p", len(model.parameters)), ca.SX.sym("u", len(INPUTS))
    rates = (model.saturated if saturated else model.slip)(x, p, u)
    return ca.Function("rates", [x, p, u], [rates, ca.densify(ca.jacobian(rates, x))])


def _rates(model: Model, saturated: bool, x: Array, p: Array, u: Array) -> tuple[Array, Array]:
    """Rates (n_x,) of the states and their derivatives (n_x, n_x)."""
    rates, slopes = _function(model, saturated)(x, p, u)
    return np.array(rates).ravel(), np.array(slopes)
