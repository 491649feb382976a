"""Steady sliding of the composed model: its state, its eigenvalues, and the drive speeds at which it is unstable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from identify.errors import SimulationError
from identify.model import SPEED, Model

Array = NDArray[np.float64]

NEWTON_STEPS = 30


@dataclass(frozen=True)
class Sliding:
    """Steady sliding at the drive speed, SI.

    state (n_x,); force the load cell sees [N]; worn: the bounded state stays at its bound; eigenvalues [1/s] of
    small disturbances, descending real part then imaginary part (one fewer when worn).
    """

    drive_speed: float
    state: Array
    force: float
    worn: bool
    eigenvalues: NDArray[np.complex128]

    @property
    def growth(self) -> float:
        """Growth rate of the least stable disturbance [1/s]; negative: all die out."""
        return float(np.max(self.eigenvalues.real))

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out."""
        return self.growth < 0.0


@lru_cache(maxsize=16)
def _linear(model: Model, worn: bool) -> ca.Function:
    """(x, p, u) -> dx/dt and its Jacobian, of the sliding model."""
    x, p = ca.SX.sym("x", len(model.states)), ca.SX.sym("p", len(model.parameters))
    u = ca.SX.sym("u", 3)
    rate = (model.saturated if worn else model.slip)(x, p, u)
    return ca.Function("linear", [x, p, u], [rate, ca.jacobian(rate, x)])


def _steady(model: Model, p: Array, u: Array, worn: bool) -> tuple[Array, Array]:
    """(state, reduced Jacobian) at which every rate vanishes while sliding at the drive speed."""
    x = np.array([s.start for s in model.states])
    x[SPEED] = u[0]
    unknown = np.array([i for i in range(x.size) if i != SPEED and not (worn and i == model.clamped)])
    # The elongation's own rate vanishes with the speed; the acceleration determines the elongation.
    rates = np.where(unknown == 0, SPEED, unknown)
    if worn and model.clamped is not None:
        x[model.clamped] = model.states[model.clamped].lower or 0.0
    function = _linear(model, worn)
    for _ in range(NEWTON_STEPS):
        rate, slope = (np.array(q) for q in function(x, p, u))
        step = np.linalg.solve(slope[np.ix_(rates, unknown)], rate.ravel()[rates])
        x[unknown] -= step
        if np.all(np.abs(step) <= 1e-13 * np.abs(x[unknown]) + 1e-300):
            break
    kept = np.sort(np.append(unknown, SPEED))
    return x, np.array(function(x, p, u)[1])[np.ix_(kept, kept)]


def sliding(model: Model, p: Array, drive_speed: float, normal_force: float) -> Sliding:
    """Steady sliding at drive speed [m/s] (positive) under normal force [N]; p (n_p,) in the model's order.

    Raises:
        SimulationError: no finite steady state.
    """
    u = np.array([drive_speed, normal_force, 1.0])
    worn = False
    try:
        x, slope = _steady(model, p, u, worn)
        if model.clamped is not None and x[model.clamped] < (model.states[model.clamped].lower or 0.0):
            worn = True
            x, slope = _steady(model, p, u, worn)
        values = np.linalg.eigvals(slope).astype(complex)
    except np.linalg.LinAlgError as error:
        raise SimulationError(
            f"no steady sliding at {drive_speed:.3g} m/s was found ({error}); check the parameters"
        ) from error
    order = np.lexsort((-values.imag, -values.real))
    return Sliding(drive_speed, x, float(model.load_cell(x, p, u)), worn, values[order])


def unstable_speeds(
    model: Model, p: Array, normal_force: float, lowest: float, highest: float, points: int = 120
) -> tuple[tuple[float, float], ...]:
    """Intervals of drive speed [m/s] within [lowest, highest] in which steady sliding is unstable.

    An interval narrower than the grid (logarithmic, `points`) is missed. Ends at `lowest` or `highest` are
    those of the search.
    """

    def growth(speed: float) -> float:
        return sliding(model, p, speed, normal_force).growth

    speeds = np.geomspace(lowest, highest, points)
    rates = np.array([growth(v) for v in speeds])
    ends: list[float] = [lowest] if rates[0] >= 0 else []
    for i in np.flatnonzero((rates[1:] >= 0) != (rates[:-1] >= 0)):
        ends.append(float(brentq(growth, speeds[i], speeds[i + 1], rtol=1e-10)))
    ends += [highest] if rates[-1] >= 0 else []
    return tuple(zip(ends[::2], ends[1::2], strict=True))
