"""One slip in closed form: linearised kinetic friction, a renewed contact (eqs. 10-18; docs/equations.md, section 4).

Dimensionless elongation xi(tau), tau = omega_n t, from the onset of slip:
xi'' + 2 alpha xi' + (xi - xi_o) = 0, xi(0) - xi_o = A (the overshoot), xi'(0) = 1 (mass at rest).
All of it needs a V_max << 1; the answer for a scene comes from the nonlinear model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.linear import one_plus_two_products
from identify.base.roots import rising_root
from identify.prediction.stability import Shaped

Array = NDArray[np.float64]
Long = NDArray[np.longdouble]
Floats = TypeVar("Floats", Array, Long)
TURN = 8 * np.arctan(np.longdouble(1))  # 2 pi
SERIES = np.array([(-1.0) ** (k + 1) * 2 * k / (2 * k + 1) for k in range(1, 26)])  # of (tau - s/Q) s^3/w_d^2


@dataclass(frozen=True)
class Slip:
    """A whole slip until the mass sticks again; shapes as broadcast, dimensionless, NaN where it never does.

    status: "restick", "steady" (slides on), "no_slip" (would be pushed backwards) or "runaway" (alpha <= -1);
    duration tau_end; elongation xi_end - xi_o there; drop xi_p - xi_end, which is also the duration of the next stick;
    period; peak_speed = max V/v_0.
    """

    status: NDArray[np.str_]
    duration: Array
    elongation: Array
    drop: Array
    period: Array
    peak_speed: Array


def _pair(alpha: ArrayLike, overshoot: ArrayLike) -> tuple[Array, Array]:
    first, second = np.broadcast_arrays(np.asarray(alpha, float), np.asarray(overshoot, float))
    return np.atleast_1d(first), np.atleast_1d(second)


def _shaped(
    values: Array | NDArray[np.str_] | Long, *like: ArrayLike, where: NDArray[np.bool_] | None = None
) -> Shaped:
    """Values in the shape of the arguments, those of chosen places NaN elsewhere; a scalar where these are."""
    if where is not None:
        values, chosen = np.full(where.shape, np.nan), values
        values[where] = chosen
    return values.reshape(np.broadcast_shapes(*(np.shape(q) for q in like)))[()]


def slip_maximum(alpha: ArrayLike, overshoot: ArrayLike, *, derivatives: bool = False) -> Shaped:
    """Dimensionless time of the elongation maximum and the amplitude xi_max - xi_o (eqs. 13-16).

    Parameters
    ----------
    alpha : ArrayLike
        effective damping ratio zeta + dmu_k va w/2, any sign.
    overshoot : ArrayLike
        A = xi_p - xi_o.
    derivatives : bool, optional
        also return the exact derivatives.

    Returns
    -------
    ndarray or float, or a pair with the derivatives
        (time, amplitude), broadcast; NaN where there is no maximum. With `derivatives` a pair ((time, amplitude),
        {"alpha": (d time, d amplitude), "overshoot": (...)}).
    """
    a, A = _pair(alpha, overshoot)
    with np.errstate(all="ignore"):
        square, root = (1 - a) * (1 + a), np.sqrt(np.abs(1 - a)) * np.sqrt(np.abs(1 + a))
        s, energy = a + A, one_plus_two_products(a, A)
        # Aperiodic: the distance s - kap to the eigenvector of no maximum, formed without its cancellation.
        distance = np.where((s > 0) & (energy > 0), energy / (s + root), np.nan)
        ratio = 2 * root / distance
        aperiodic = np.where(ratio > 0, np.log1p(ratio) / ratio, 1.0) / distance
        tau = np.where(np.abs(a) < 1, np.arctan2(root, s) / np.where(root > 0, root, 1.0), aperiodic)
        energy = np.where(np.abs(a) < 1, s * s + square, energy)
        half = np.exp(-0.5 * a * tau)  # twice the half: the product neither over- nor underflows early
        amplitude = np.sqrt(energy) * half * half
        values = (_shaped(tau, alpha, overshoot), _shaped(amplitude, alpha, overshoot))
        if not derivatives:
            return values
        y = square / (s * s)
        curvature = np.where(
            (s > 0) & (np.abs(y) < 0.1),
            np.polynomial.polynomial.polyval(np.where(np.abs(y) < 0.1, y, 0.0), SERIES) / s**3,
            (tau - s / energy) / square,
        )
        table = {
            "alpha": (a * curvature - 1 / energy, -amplitude * curvature),
            "overshoot": (np.where(np.isnan(tau), np.nan, -1 / energy), amplitude * ((s + a) / energy)),
        }
    return values, {
        name: (_shaped(first, alpha, overshoot), _shaped(second, alpha, overshoot))
        for name, (first, second) in table.items()
    }


def _status(alpha: Array, overshoot: Array) -> tuple[NDArray[np.str_], Array]:
    """(status, e0): e0 is the angle 2 pi - w_d tau of the velocity maximum that must reach the drive speed."""
    w, phi = np.sqrt((1 - alpha) * (1 + alpha)), 2 * alpha + overshoot
    first = np.arctan2(w * phi, 1 - alpha * phi)
    gap = _velocity_gap(first, alpha / w, (alpha + overshoot) / w)[0]
    reaches = ((alpha > -1) & (alpha <= 0)) | ((alpha > 0) & (alpha < 1) & (gap <= 0))
    known = np.isfinite(alpha) & np.isfinite(overshoot)
    status = np.select(
        [~known, phi < 0, alpha <= -1, reaches], ["undefined", "no_slip", "runaway", "restick"], "steady"
    )
    return status, first


def _velocity_gap(eps: Floats, b: Floats, q: Floats) -> tuple[Floats, Floats]:
    """exp(alpha tau) (1 - xi') and its slope at the angle eps = 2 pi - w_d tau; zero where the mass sticks."""
    growth, sine, cosine = np.expm1(b * (eps.dtype.type(TURN) - eps)), np.sin(eps / 2), np.cos(eps / 2)
    whole = 2 * sine * cosine
    return 2 * sine * sine - q * whole + growth, whole - q * (1 - 2 * sine * sine) - b * (1 + growth)


def _ends(alpha: Array, overshoot: Array, first: Array) -> tuple[Long, Long, Long]:
    """(eps, tau_end, xi''(tau_end)) of slips that do stick again, in the longest floats there are."""
    w = np.sqrt((1 - alpha) * (1 + alpha))
    rough = rising_root(_velocity_gap, first, first + np.pi, (alpha / w, (alpha + overshoot) / w))
    # Near the fold the root is ill conditioned: one last step with the longest floats there are.
    a, A, near = (q.astype(np.longdouble) for q in (alpha, overshoot, rough))
    w = np.sqrt((1 - a) * (1 + a))
    gap, slope = _velocity_gap(near, a / w, (a + A) / w)
    step = np.where(np.abs(gap) < 1e-6 * np.abs(slope), gap / slope, 0.0)
    eps = np.clip(near - step, first, first + TURN / 2)
    tau, phi = (TURN - eps) / w, 2 * a + A
    # Not negative: at the fold itself rounding may leave a trace below zero.
    stop = np.maximum(np.exp(-a * tau) * (-phi * np.cos(eps) + (1 - a * phi) * np.sin(eps) / w), 0.0)
    return np.asarray(eps, np.longdouble), tau, stop


def slip(alpha: ArrayLike, overshoot: ArrayLike) -> Slip:
    """The whole slip, until the mass sticks again, of a saturated stick (eqs. 13-18).

    Parameters
    ----------
    alpha, overshoot
        as for `slip_maximum`. Broadcasts.

    Returns
    -------
    Slip
    """
    a, A = _pair(alpha, overshoot)
    with np.errstate(all="ignore"):
        status, first = _status(a, A)
        again = status == "restick"
        a, A = a[again], A[again]
        w, phi = np.sqrt((1 - a) * (1 + a)), 2 * a + A
        _, tau_end, end_rate = _ends(a, A, first[again])
        duration, stop = tau_end.astype(float), end_rate.astype(float)
        peak_time = np.arctan2(w * phi, a * phi - 1) / w
        speed = 1 + np.hypot(a + A, w) * np.exp(-a * peak_time)
        columns = (duration, -(2 * a + stop), phi + stop, duration + phi + stop, speed)
        return Slip(_shaped(status, alpha, overshoot), *(_shaped(c, alpha, overshoot, where=again) for c in columns))


def slip_end(alpha: ArrayLike, overshoot: ArrayLike, *, derivatives: bool = False) -> Shaped:
    """Dimensionless time and elongation xi - xi_o at which the mass sticks again, xi' = 1 (eqs. 13, 18).

    Parameters
    ----------
    alpha, overshoot, derivatives
        as for `slip_maximum`.

    Returns
    -------
    ndarray or float, or a pair with the derivatives
        (time, elongation), broadcast; NaN where the mass never sticks again. With `derivatives` a pair ((time,
        elongation), {"alpha": (...), "overshoot": (...)}); they grow without bound at the fold.
    """
    whole = slip(alpha, overshoot)
    values = whole.duration, whole.elongation
    if not derivatives:
        return values
    a, A = _pair(alpha, overshoot)
    with np.errstate(all="ignore"):
        status, first = _status(a, A)
        again = status == "restick"
        eps, tau, stop = _ends(a[again], A[again], first[again])
        # Implicit differentiation (docs/equations.md, section 4); growth exp(-alpha tau), which overflows for alpha
        # near -1 long before the times do, is divided out where it can be.
        a, A = a[again].astype(np.longdouble), A[again].astype(np.longdouble)
        w, decay, phi = np.sqrt((1 - a) * (1 + a)), np.exp(-a * tau), 2 * a + A
        C, S = np.cos(eps), -np.sin(eps) / w
        C_a, S_a = a * tau * S, a * (S - tau * C) / ((1 - a) * (1 + a))  # by alpha
        rise = -phi * C + (a * phi - 1) * S  # xi'(tau; alpha, A) = 1 differentiated, over exp(-alpha tau)
        tau_a = (tau * np.exp(a * tau) - (C_a - S - (a + A) * S_a)) / rise
        tau_A = np.where(a == 0, -2 / (1 + A * A), S / rise)
        end_a = tau_a + tau * (2 * a + stop) + decay * (A * C_a + A * S + (1 + a * A) * S_a)
        end_A = np.where(a == 0, -1.0, tau_A + decay * (C + a * S))
    slopes = {"alpha": (tau_a, end_a), "overshoot": (tau_A, end_A)}
    return values, {
        name: tuple(_shaped(by, alpha, overshoot, where=again) for by in pair) for name, pair in slopes.items()
    }
