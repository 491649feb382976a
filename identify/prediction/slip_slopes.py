"""Exact derivatives of a whole slip by alpha and overshoot (docs/equations.md, section 4), by implicit differentiation.

Growth exp(-alpha tau) is divided out where it can be: for alpha near -1 it overflows long before the times do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]
Pair = tuple[Array, Array]  # by alpha, by overshoot


def _by_alpha(a: Array, tau: Array, C: Array, S: Array) -> Pair:
    """Derivatives by alpha of C, S = cos, sin(w_d tau)/w_d."""
    return a * tau * S, a * (S - tau * C) / ((1 - a) * (1 + a))


def end_slopes(a: Array, A: Array, eps: Array, tau: Array, stop: Array) -> tuple[Pair, Pair]:
    """Derivatives of (tau_end, xi_end - xi_o) at the angle eps = 2 pi - w_d tau_end; stop is xi''(tau_end)."""
    w, decay, phi = np.sqrt((1 - a) * (1 + a)), np.exp(-a * tau), 2 * a + A
    C, S = np.cos(eps), -np.sin(eps) / w
    C_a, S_a = _by_alpha(a, tau, C, S)
    # xi'(tau; alpha, A) = 1 differentiated, over exp(-alpha tau).
    rise = -phi * C + (a * phi - 1) * S
    tau_a = (tau * np.exp(a * tau) - (C_a - S - (a + A) * S_a)) / rise
    tau_A = np.where(a == 0, -2 / (1 + A * A), S / rise)
    end_a = tau_a + tau * (2 * a + stop) + decay * (A * C_a + A * S + (1 + a * A) * S_a)
    end_A = np.where(a == 0, -1.0, tau_A + decay * (C + a * S))
    return (tau_a, tau_A), (end_a, end_A)


def peak_slopes(a: Array, A: Array, tau: Array, speed: Array) -> tuple[Pair, Pair]:
    """Derivatives of the time tau of the peak sliding speed and of that speed over the drive speed."""
    w, decay = np.sqrt((1 - a) * (1 + a)), np.exp(-a * tau)
    phi, swing = 2 * a + A, np.hypot(a + A, w)  # xi' is -swing decay there
    C, S = (a * phi - 1) / swing, phi / swing
    C_a, S_a = _by_alpha(a, tau, C, S)
    by_a, level = C_a - S - (a + A) * S_a, A * C_a + A * S + (1 + a * A) * S_a
    tau_a, tau_A = (2 * a * by_a + level) / swing - 2, -1 / swing**2
    return (tau_a, tau_A), (-tau * (speed - 1) - decay * by_a, decay * S)
