"""Exact derivatives of a whole slip by alpha and overshoot (EQUATIONS section 4), by implicit differentiation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Pair = tuple[Array, Array]  # by alpha, by overshoot


def end_slopes(a: Array, A: Array, eps: Array, tau: Array, stop: Array) -> tuple[Pair, Pair]:
    """Derivatives of (tau_end, xi_end - xi_o) at the angle eps = 2 pi - w_d tau_end; stop is xi''(tau_end)."""
    # Implicit differentiation of xi'(tau; alpha, A) = 1 at C, S = cos, sin(w_d tau)/w_d.
    square, decay = (1 - a) * (1 + a), np.exp(-a * tau)
    C, S = np.cos(eps), -np.sin(eps) / np.sqrt(square)
    C_a, S_a = a * tau * S, a * (S - tau * C) / square
    speed_a = -tau + decay * (C_a - S - (a + A) * S_a)
    tau_a = -speed_a / stop
    tau_A = np.where(a == 0, -2 / (1 + A * A), decay * S / stop)
    end_a = tau_a - tau * -(2 * a + stop) + decay * (A * C_a + A * S + (1 + a * A) * S_a)
    end_A = np.where(a == 0, -1.0, tau_A + decay * (C + a * S))
    return (tau_a, tau_A), (end_a, end_A)


def peak_slopes(a: Array, A: Array, tau: Array, speed: Array) -> tuple[Pair, Pair]:
    """Derivatives of the time tau of the peak sliding speed and of that speed over the drive speed."""
    square = (1 - a) * (1 + a)
    w, decay = np.sqrt(square), np.exp(-a * tau)
    C, S = np.cos(w * tau), np.sin(w * tau) / w
    C_a, S_a = a * tau * S, a * (S - tau * C) / square
    rate = 1 - speed  # xi' there; xi'' is zero
    rate_a, rate_A = -tau * rate + decay * (C_a - S - (a + A) * S_a), -decay * S
    level_a = tau * 2 * a * rate + decay * (A * C_a + A * S + (1 + a * A) * S_a)  # xi - xi_o = -2 a xi' there
    level_A = decay * (C + a * S)
    # xi'' = -2 a xi' - (xi - xi_o) is zero there, and falls at the rate xi''' = -xi'.
    tau_a = (-2 * rate - 2 * a * rate_a - level_a) / rate
    tau_A = (-2 * a * rate_A - level_A) / rate
    return (tau_a, tau_A), (-rate_a, -rate_A)
