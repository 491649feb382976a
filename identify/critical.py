"""Rig quantities at which steady sliding loses stability, closed forms for a V << 1 (EQUATIONS section 6).

G = (mu_s - mu_k0) F_n t_cr / D [N s/m] is the weakening that ageing brings; the limit is
G = c (1 + k t_cr^2 / (m + c t_cr)) with the damping constant c [N s/m] held fixed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike


def _arrays(*values: ArrayLike) -> tuple[Any, ...]:
    return tuple(np.asarray(v, float) for v in np.broadcast_arrays(*values))


def critical_stiffness(mass: ArrayLike, viscous: ArrayLike, weakening: ArrayLike, t_cr: ArrayLike) -> Any:
    """k_c [N/m]: steady sliding is stable above it; NaN where it is stable at every stiffness.

    Args:
        mass: m_s [kg]. viscous: c [N s/m]. weakening: G [N s/m]. t_cr: creep time [s]. Broadcast.
    """
    m, c, G, t = _arrays(mass, viscous, weakening, t_cr)
    with np.errstate(all="ignore"):
        return np.where(c < G, (G - c) / c * (m + c * t) / t**2, np.nan)[()]


def critical_damping(mass: ArrayLike, stiffness: ArrayLike, weakening: ArrayLike, t_cr: ArrayLike) -> Any:
    """c_c [N s/m]: steady sliding is stable above it (zeta_c = c_c / (2 sqrt(m k))).

    Args:
        mass: m_s [kg]. stiffness: k [N/m]. weakening: G [N s/m]. t_cr: creep time [s]. Broadcast.
    """
    m, k, G, t = _arrays(mass, stiffness, weakening, t_cr)
    with np.errstate(all="ignore"):
        r = G * t - m - k * t**2
        root = np.sqrt(r * r + 4 * t * G * m)
        return np.where(r > 0, (r + root) / (2 * t), 2 * G * m / (root - r))[()]


def critical_mass(stiffness: ArrayLike, viscous: ArrayLike, weakening: ArrayLike, t_cr: ArrayLike) -> Any:
    """m_c [kg]: steady sliding is stable below it; NaN where no mass makes the difference.

    Args:
        stiffness: k [N/m]. viscous: c [N s/m]. weakening: G [N s/m]. t_cr: creep time [s]. Broadcast.
    """
    k, c, G, t = _arrays(stiffness, viscous, weakening, t_cr)
    with np.errstate(all="ignore"):
        mass = c * t * (c + k * t - G) / (G - c)
        return np.where((c < G) & (mass > 0), mass, np.nan)[()]
