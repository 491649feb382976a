"""The paper's equations exactly as printed, errors included: what the derived forms are put beside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def maximum(alpha: Array, overshoot: Array) -> tuple[Array, Array]:
    """Eqs. (15), (16): time and amplitude with the principal arctangent; NaN where its square root has no value."""
    with np.errstate(all="ignore"):
        root = np.sqrt(1 - alpha**2)
        time = np.arctan(1 / (alpha / root + root * overshoot * (1 + alpha**2 / (1 - alpha**2)))) / root
        return time, elongation(alpha, overshoot, time)


def elongation(alpha: Array, overshoot: Array, tau: Array) -> Array:
    """Eq. (13), over xi_o."""
    root = np.sqrt(1 - alpha**2)
    C, S = np.cos(tau * root), np.sin(tau * root) / root
    return np.exp(-alpha * tau) * (overshoot * C + S + alpha * overshoot * S)


def velocity(alpha: Array, overshoot: Array, tau: Array) -> Array:
    """Eq. (14)."""
    root = np.sqrt(1 - alpha**2)
    return np.exp(-alpha * tau) * (np.cos(tau * root) - (alpha + overshoot) * np.sin(tau * root) / root)


def acceleration_zero(alpha: Array, loading: Array, n: int) -> Array:
    """Eq. (17): time of zero acceleration, n pi outside of the arctangent (inside it means nothing)."""
    with np.errstate(all="ignore"):
        root = np.sqrt(1 - alpha**2)
        return (np.arctan(root * loading / (2 * alpha**2 + loading * alpha - 1)) + n * np.pi) / root


def slip_10(step: float, weight: float, tau_cr: float, count: int = 400) -> tuple[Array, Array]:
    """Eqs. (8)-(10) with the printed M = 1 + step w/tau_cr, undamped, drive frame, from the onset of slip: distance and
    velocity, in units of v0/omega_n and v0, until the velocity is zero."""
    rate = 1 + step * weight / tau_cr
    return undamped(step * weight, rate, count)


def undamped(overshoot: float, rate: float = 1.0, count: int = 400) -> tuple[Array, Array]:
    """Undamped slip x'' + x = overshoot + rate tau from rest: distance and velocity until it rests again."""
    tau = np.linspace(0.0, 2 * np.pi - 2 * np.arctan2(overshoot, rate), count)
    distance = overshoot * (1 - np.cos(tau)) + rate * (tau - np.sin(tau))
    return distance, overshoot * np.sin(tau) + rate * (1 - np.cos(tau))


def loading_as_printed(alpha: Array, n: int, highest: float = 1e6) -> Array:
    """Phi(alpha) at which the velocity of (14) at the time of (17), both as printed, is that of the drive: the nearest
    reading of (18), which itself has no solution. NaN without one."""
    loading = np.geomspace(1e-4, highest, 4000)
    out = np.full(alpha.shape, np.nan)
    for i, a in enumerate(alpha.tolist()):
        time = acceleration_zero(np.full(loading.shape, a), loading, n)
        gap = np.where(time > 0, velocity(np.full(loading.shape, a), loading, time) - 1, np.nan)
        turns = np.flatnonzero((gap[:-1] < 0) & (gap[1:] >= 0) | (gap[:-1] > 0) & (gap[1:] <= 0))
        turns = turns[np.abs(gap[turns + 1] - gap[turns]) < 1.0]  # a jump of the arctangent is no root
        if turns.size:
            out[i] = loading[turns[0]]
    return out
