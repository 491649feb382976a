"""Contact ageing at constant sliding speed, closed form (eqs. 2-4; docs/equations.md, section 3)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def saturation(
    t: ArrayLike, gamma_0: ArrayLike, speed: ArrayLike, t_cr: ArrayLike, D: ArrayLike, *, derivatives: bool = False
) -> Any:
    """Saturation gamma(t) of the contact at constant sliding speed, clamped to [0, 1].

    gamma(t) = gamma_inf + (gamma_0 - gamma_inf) exp(-t/t_cr), gamma_inf = 1 - |speed| t_cr/D: eq. (3a)
    with speed = 0 and gamma_0 = 0, eq. (3b) with the drive speed. The path is monotone, so that the
    clamp may act on its end.

    Args:
        t: time since gamma_0 [s], not negative.
        gamma_0: saturation at t = 0, within 0 and 1.
        speed: sliding speed [m/s]; its sign does not matter.
        t_cr: creep time [s], positive.
        D: relaxation length [m], positive.
        derivatives: also return the exact derivatives.

    Returns:
        gamma, broadcast over the arguments (NaN outside their ranges); with `derivatives` a pair
        (gamma, {argument: derivative}), zero where gamma is clamped.
    """
    t, gamma_0, speed, t_cr, D = (np.asarray(q, float) for q in np.broadcast_arrays(t, gamma_0, speed, t_cr, D))
    with np.errstate(all="ignore"):
        valid = (t >= 0) & (gamma_0 >= 0) & (gamma_0 <= 1) & (t_cr > 0) & (D > 0)
        past = -np.expm1(-t / t_cr)  # 1 - exp(-t/t_cr) without loss of digits for t << t_cr
        worn = np.abs(speed) * t_cr / D
        free = gamma_0 + (1 - gamma_0 - worn) * past
        value = np.where(valid, np.clip(free, 0.0, 1.0), np.nan)
        if not derivatives:
            return value[()]
        left = np.exp(-t / t_cr)
        slope = (1 - gamma_0 - worn) * left / t_cr
        table = {
            "t": slope,
            "gamma_0": left,
            "speed": -np.sign(speed) * t_cr / D * past,
            "t_cr": -worn / t_cr * past - slope * t / t_cr,
            "D": worn / D * past,
        }
        clamped = (free < 0) | (free > 1)
        return value[()], {k: np.where(valid, np.where(clamped, 0.0, d), np.nan)[()] for k, d in table.items()}
