"""Contact ageing at constant sliding speed, closed form (eqs. 2-4; docs/equations.md, section 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.prediction.stability import Shaped

Array = NDArray[np.float64]

TINY = 1e-200  # a step into the complex plane


def saturation(
    t: ArrayLike, gamma_0: ArrayLike, speed: ArrayLike, t_cr: ArrayLike, D: ArrayLike, *, derivatives: bool = False
) -> Shaped:
    """Saturation gamma(t) of the contact at constant sliding speed, clamped to [0, 1].

    gamma(t) = gamma_inf + (gamma_0 - gamma_inf) exp(-t/t_cr), gamma_inf = 1 - |speed| t_cr/D: eq. (3a)
    with speed = 0 and gamma_0 = 0, eq. (3b) with the drive speed. The path is monotone, so that the
    clamp may act on its end.

    Parameters
    ----------
    t : ArrayLike
        time since gamma_0 [s], not negative.
    gamma_0 : ArrayLike
        saturation at t = 0, within 0 and 1.
    speed : ArrayLike
        sliding speed [m/s]; its sign does not matter.
    t_cr : ArrayLike
        creep time [s], positive.
    D : ArrayLike
        relaxation length [m], positive.
    derivatives : bool, optional
        also return the exact derivatives.

    Returns
    -------
    ndarray or float, or a pair with the derivatives
        gamma, broadcast over the arguments (NaN outside their ranges); with `derivatives` a pair (gamma, {argument:
        derivative}), zero where gamma is clamped.
    """
    q = dict(zip(("t", "gamma_0", "speed", "t_cr", "D"), np.broadcast_arrays(t, gamma_0, speed, t_cr, D), strict=True))
    q = {name: np.asarray(value, float) for name, value in q.items()}

    def free(t: Array, gamma_0: Array, speed: Array, t_cr: Array, D: Array) -> Array:
        renewed = np.where(q["speed"] < 0, -speed, speed) * t_cr / D
        return np.asarray(gamma_0 - (1 - gamma_0 - renewed) * np.expm1(-t / t_cr))  # keeps its digits for t << t_cr

    with np.errstate(all="ignore"):
        valid = (q["t"] >= 0) & (q["gamma_0"] >= 0) & (q["gamma_0"] <= 1) & (q["t_cr"] > 0) & (q["D"] > 0)
        path = free(**q)
        value = np.where(valid, np.clip(path, 0.0, 1.0), np.nan)[()]
        if not derivatives:
            return value
        table, clamped = {}, (path < 0) | (path > 1)
        for name in q:  # by a step into the complex plane, which loses no digits
            slope = free(**q | {name: q[name] + 1j * TINY}).imag / TINY
            table[name] = np.where(valid, np.where(clamped, 0.0, slope), np.nan)[()]
        return value, table
