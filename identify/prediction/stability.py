"""Does the mass stick again, and does steady sliding lose stability: closed forms (eqs. 17-25).

Derived in docs/equations.md, sections 5 and 6. `critical_loading` belongs to the linearised slip (a V_max << 1).
`critical_friction`, `critical_frequency` and `eigenvalues` are local, about steady sliding; the last keeps the slope
of kinetic friction.
"""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from identify.base.roots import rising_root

Array = NDArray[np.float64]

Shaped: TypeAlias = Any  # a float, or an array in the shape of the arguments; with `derivatives` a pair, see there
RIG = ("mass", "stiffness", "damping")
FRICTION = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
QUANTITIES = (*RIG, *FRICTION, "drive_speed", "normal_force")  # what the calculators take
TINY = 1e-200  # a step into the complex plane


def _linearise(q: dict[str, Array]) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Resistance, step and ageing of m x'' + resistance x' + k x + F step dgamma = 0, dgamma' = -dgamma/t_cr - x'/D."""
    v, left = q["drive_speed"], np.exp(-q["a"] * q["drive_speed"])
    with np.errstate(all="ignore"):
        ageing = (q["D"].real > 0) & (q["t_cr"].real > 0) & ((v * q["t_cr"]).real <= q["D"].real)
        renewed = np.where(ageing, v * q["t_cr"] / q["D"], 1.0)
        damper = q["damping"] * np.sqrt(q["mass"] / q["stiffness"])
        resistance = damper + q["normal_force"] * q["delta_mu_k"] * q["a"] * left * renewed
        step = q["mu_s"] - q["mu_k0"] + q["delta_mu_k"] * np.expm1(-q["a"] * v)
    return resistance, step, ageing


def _characteristic(q: dict[str, Array]) -> list[Array]:
    """Coefficients of the characteristic polynomial [kg, ...] of a rate [1/s], from the power 3 down; without ageing
    one of its roots is zero."""
    resistance, step, ageing = _linearise(q)
    m, k, fresh = q["mass"], q["stiffness"], np.where(ageing, 1.0 / q["t_cr"], 0.0)
    coupling = np.where(ageing, q["normal_force"] * step / q["D"], 0.0)
    return [m, resistance + m * fresh, k + resistance * fresh - coupling, k * fresh]


def _roots(q: dict[str, Array]) -> NDArray[np.complex128]:
    """Roots [1/s], shape (..., 3), unsorted; NaN for the third where there are two."""
    natural, (c3, *lower) = np.sqrt(q["stiffness"] / q["mass"]), _characteristic(q)
    cubic = np.stack([c / (c3 * natural ** (i + 1)) for i, c in enumerate(lower)], axis=-1)  # of the dimensionless rate
    companion = np.zeros((*c3.shape, 3, 3))
    companion[..., 0, :] = -cubic
    companion[..., 1, 0] = companion[..., 2, 1] = 1.0
    usable = np.asarray(np.isfinite(companion).all(axis=(-1, -2)))[..., None]
    roots = np.linalg.eigvals(np.where(usable[..., None], companion, 0.0)).astype(complex)
    c2, c1, c0 = (cubic[..., i, None] for i in range(3))
    for _ in range(4):  # Newton steps: an eigenvalue solver leaves small roots with the error of the large ones
        value, slope = ((roots + c2) * roots + c1) * roots + c0, (3 * roots + 2 * c2) * roots + c1
        better = roots - value / slope
        roots = np.where(np.isfinite(better) & (np.abs(better - roots) < 1e-3 * np.abs(roots)), better, roots)
    none = np.arange(3) == np.argmin(np.abs(roots), axis=-1)[..., None]  # renewed: the root at zero is that of no state
    return np.where(usable & ((cubic[..., 2:] != 0.0) | ~none), roots * natural[..., None], np.nan)


def _slopes(q: dict[str, Array], roots: NDArray[np.complex128], sign: Array) -> dict[str, NDArray[np.complex128]]:
    """d(root)/d(quantity) = -P_q/P_x of P(x; q) = 0, P_q by steps into the complex plane, which lose no digits; roots
    [1/s] of shape (..., 3)."""
    c3, c2, c1, _ = (c[..., None] for c in _characteristic(q))
    by_root = (3 * c3 * roots + 2 * c2) * roots + c1
    table = {}
    for name in QUANTITIES:
        moved = {n: np.asarray(value, complex) for n, value in q.items()}
        moved[name] = moved[name] + 1j * TINY
        c3, c2, c1, c0 = (c.imag[..., None] / TINY for c in _characteristic(moved))
        table[name] = -(((c3 * roots + c2) * roots + c1) * roots + c0) / by_root
    table["drive_speed"] = table["drive_speed"] * sign[..., None]
    return table


def eigenvalues(
    rig: object,
    friction: object,
    drive_speed: ArrayLike,
    normal_force: ArrayLike,
    *,
    derivatives: bool = False,
) -> Shaped:
    """Eigenvalues of steady sliding [1/s] (eqs. 19-24, derived form, speed dependence of friction kept).

    Parameters
    ----------
    rig : object
        mass [kg], stiffness [N/m], damping h [N/m].
    friction : object
        mu_s, mu_k0, delta_mu_k, a [s/m], D [m], t_cr [s]; D = 0 means no contact ageing.
    drive_speed : ArrayLike
        [m/s], sign irrelevant.
    normal_force : ArrayLike
        [N]. All of these broadcast.
    derivatives : bool, optional
        also return {quantity: d eigenvalues / d quantity} for every quantity of the arguments.

    Returns
    -------
    ndarray or float, or a pair with the derivatives
        Complex array, shape (..., 3), descending real then imaginary part; the last is NaN where the contact is
        fully renewed (v_acr > 1: gamma stays 0 and ageing plays no part).
    """
    sign = np.sign(np.asarray(drive_speed, float)) + (np.asarray(drive_speed) == 0)
    known = [getattr(rig, name) for name in RIG] + [getattr(friction, name) for name in FRICTION]
    shaped = np.broadcast_arrays(*known, np.abs(drive_speed), normal_force)
    q = {name: np.asarray(value, float) for name, value in zip(QUANTITIES, shaped, strict=True)}
    with np.errstate(all="ignore"):
        roots = _roots(q)
        order = np.lexsort((-roots.imag, -roots.real), axis=-1)
        rates = np.take_along_axis(roots, order, axis=-1)
        if not derivatives:
            return rates
        return rates, _slopes(q, rates, np.broadcast_to(sign, q["mass"].shape))


Form = Literal["derived", "printed"]
DAMPERS = {"derived": 2.0, "printed": 1.0}  # z over zeta


def _tangent(alpha: Array, n: Array) -> tuple[Array, Array]:
    """(psi, ln Phi_cr), psi = w_d tau of the slip that just reaches the drive speed; 0 < alpha < 1."""
    w = np.sqrt((1 - alpha) * (1 + alpha))
    b = alpha / w

    def equation(eps: Array, b: Array, n: Array) -> tuple[Array, Array]:
        left = -b * (2 * np.pi * n - eps)
        value = 2 * np.sin(eps / 2) ** 2 - b * np.sin(eps) + np.expm1(left)
        return value, np.sin(eps) - b * np.cos(eps) + b * np.exp(left)

    eps = rising_root(equation, 0.5 * np.sqrt(np.minimum(b, 0.3)), np.full_like(b, np.pi), (b, n))
    psi = 2 * np.pi * n - eps
    log = b * psi + np.log(np.sin(eps) / w)
    # Below, the leading term is exact to the last digit, and squares would underflow.
    tiny = alpha < 1e-18
    return np.where(tiny, 2 * np.pi * n, psi), np.where(tiny, 0.5 * (np.log(4 * np.pi * n) + np.log(alpha)), log)


def log_critical_loading(alpha: ArrayLike, n: ArrayLike = 1, *, derivatives: bool = False) -> Shaped:
    """Natural logarithm of `critical_loading`: finite also where that overflows.

    Parameters
    ----------
    alpha, n, derivatives
        as for `critical_loading`.

    Returns
    -------
    ndarray or float, or a pair with the derivatives
        ln Phi_cr: -infinity for -1 < alpha <= 0, infinity for alpha >= 1, NaN for alpha <= -1. With `derivatives` a
        pair (value, {"alpha": derivative}), NaN where the value is not finite.
    """
    a, order = (np.atleast_1d(q) for q in np.broadcast_arrays(np.asarray(alpha, float), np.asarray(n)))
    if np.any((order < 1) | (order != np.floor(order))):
        raise ValueError(f"n counts velocity maxima and was {order}; give whole numbers from 1 on")
    value = np.select([a >= 1, a > 0, a > -1], [np.inf, 0.0, -np.inf], np.nan)
    slope = np.full(a.shape, np.nan)
    between = (a > 0) & (a < 1)
    inner = a[between]
    with np.errstate(all="ignore"):
        psi, log = _tangent(inner, order[between].astype(float))
        value[between] = log
        w, inverse = np.sqrt((1 - inner) * (1 + inner)), np.exp(-log)
        slope[between] = (psi / w + inner) / w**2 + (inverse - 2 * inner) / w * (psi * inverse / w + 1) / w
    shape = np.broadcast_shapes(np.shape(alpha), np.shape(n))
    result = value.reshape(shape)[()]
    return (result, {"alpha": slope.reshape(shape)[()]}) if derivatives else result


def critical_loading(alpha: ArrayLike, n: ArrayLike = 1, *, derivatives: bool = False) -> Shaped:
    """Phi_cr(alpha): with Phi = 2 alpha + A below it the mass never sticks again (eqs. 17-18, derived).

    Parameters
    ----------
    alpha : ArrayLike
        effective damping ratio of the slip.
    n : ArrayLike, optional
        which velocity maximum touches the drive speed; 1 is the physical one for alpha > 0.
    derivatives : bool, optional
        also return the exact derivative with respect to alpha.

    Returns
    -------
    ndarray or float, or a pair with the derivatives
        Phi_cr, dimensionless, broadcast: 0 for -1 < alpha <= 0, infinity for alpha >= 1 and on overflow, NaN for
        alpha <= -1. With `derivatives` a pair (Phi_cr, {"alpha": derivative}): 0 for -1 < alpha < 0, NaN at 0
        (vertical).

    Raises
    ------
    ValueError
        n is not a whole number from 1 on.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        if not derivatives:
            return np.exp(log_critical_loading(alpha, n))[()]
        log, table = log_critical_loading(alpha, n, derivatives=True)
        value = np.exp(log)
        a = np.broadcast_to(np.asarray(alpha, float), np.shape(value))
        slope = np.where((a > -1) & (a < 0), 0.0, value * table["alpha"])
        return value[()], {"alpha": slope[()]}


def critical_friction(
    zeta: ArrayLike, tau_cr: ArrayLike, form: Form = "derived", *, derivatives: bool = False
) -> Shaped:
    """Critical friction parameter Pi_fc (eqs. 21-25): steady sliding is stable below it.

    Derived: z (1 + T^2/(1 + z T)) with z = 2 zeta, T = tau_cr. Printed eq. (25) has z = zeta in its
    determinant and is up to a factor 2 too low (docs/printed_errors.md, E23 and E25).

    Parameters
    ----------
    zeta : ArrayLike
        damping ratio h/2k; where sliding friction depends on speed, half of z of docs/equations.md, section 6.
    tau_cr : ArrayLike
        dimensionless creep time omega_n t_cr, positive.
    form : Form, optional
        "derived", or "printed" for the paper's own.
    derivatives : bool, optional
        also return {"zeta": ..., "tau_cr": ...}.

    Returns
    -------
    ndarray or float, or a pair with the derivatives
        Pi_fc, broadcast. It decides only where z + 1/T > 0; for a more negative z steady sliding is unstable
        whatever the friction, and the number is the formula's mere continuation: use `eigenvalues` there.

    Raises
    ------
    ValueError
        an unknown form.
    """
    if form not in DAMPERS:
        raise ValueError(f"form was {form!r}; expected 'derived' or 'printed'")
    zeta, T = (np.asarray(q, float) for q in np.broadcast_arrays(zeta, tau_cr))
    z = DAMPERS[form] * zeta
    with np.errstate(all="ignore"):
        share = T / (1 + z * T)
        value = (z * (1 + T * share))[()]
        if not derivatives:
            return value
        by_zeta = DAMPERS[form] * (1 + share * share)
        by_time = z * share * (2 + z * T) / (1 + z * T)
    return value, {"zeta": by_zeta[()], "tau_cr": by_time[()]}


def critical_frequency(zeta: ArrayLike, tau_cr: ArrayLike, *, derivatives: bool = False) -> Shaped:
    """Omega_c = 1/sqrt(1 + 2 zeta tau_cr): frequency at the boundary over omega_n (eqs. 23-25).

    Parameters
    ----------
    zeta, tau_cr, derivatives
        as for `critical_friction`.

    Returns
    -------
    ndarray or float, or a pair with the derivatives
        Omega_c, broadcast; NaN where 1 + 2 zeta tau_cr <= 0 (no such boundary). With `derivatives` a pair.
    """
    zeta, T = (np.asarray(q, float) for q in np.broadcast_arrays(zeta, tau_cr))
    with np.errstate(all="ignore"):
        base = np.where(1 + 2 * zeta * T > 0, 1 + 2 * zeta * T, np.nan)
        value = (1 / np.sqrt(base))[()]
        if not derivatives:
            return value
        half = value / base
        return value, {"zeta": (-T * half)[()], "tau_cr": (-zeta * half)[()]}
