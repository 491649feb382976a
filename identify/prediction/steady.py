"""Steady sliding of the four-effect model and its eigenvalues, closed form (eqs. 19-24; docs/equations.md, section 6).

The coupling kept here in full: the slope of kinetic friction (z) and its level (Pi) at the drive speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class RigLike(Protocol):
    """What the calculators need of a rig, SI: m_s, k and h (zeta = h/2k)."""

    @property
    def mass(self) -> float:
        """m_s [kg]."""
        ...

    @property
    def stiffness(self) -> float:
        """k [N/m]."""
        ...

    @property
    def damping(self) -> float:
        """h of eq. (1) [N/m]."""
        ...


class FrictionLike(Protocol):
    """What the calculators need of a friction law, SI; D = 0 stands for no contact ageing."""

    @property
    def mu_s(self) -> float:
        """Static coefficient, saturated."""
        ...

    @property
    def mu_k0(self) -> float:
        """Kinetic coefficient at slow sliding."""
        ...

    @property
    def delta_mu_k(self) -> float:
        """Change of the kinetic coefficient to fast sliding."""
        ...

    @property
    def a(self) -> float:
        """Inverse speed of that change [s/m]."""
        ...

    @property
    def D(self) -> float:  # noqa: N802
        """Relaxation length [m]."""
        ...

    @property
    def t_cr(self) -> float:
        """Creep time [s]."""
        ...


QUANTITIES = (
    "mass",
    "stiffness",
    "damping",
    "mu_s",
    "mu_k0",
    "delta_mu_k",
    "a",
    "D",
    "t_cr",
    "drive_speed",
    "normal_force",
)  # what the eigenvalues are differentiated by


@dataclass(frozen=True)
class Linearised:
    """Steady sliding, SI, arrays of one shape.

    m x'' + resistance x' + k x + F_n step dgamma = 0, dgamma' = -dgamma/t_cr - x'/D, with resistance
    [N s/m] = damper plus slope of sliding friction; step = mu_s - mu_k at the drive speed; worn =
    1 - gamma in steady sliding; ageing: whether gamma moves at all (v_acr <= 1).
    """

    mass: Array
    stiffness: Array
    resistance: Array
    step: Array
    normal_force: Array
    t_cr: Array
    D: Array
    worn: Array
    ageing: NDArray[np.bool_]


def _arguments(rig: RigLike, friction: FrictionLike, drive_speed: ArrayLike, normal_force: ArrayLike) -> list[Array]:
    values = [getattr(rig, name) for name in QUANTITIES[:3]] + [getattr(friction, name) for name in QUANTITIES[3:9]]
    return [np.asarray(q, float) for q in np.broadcast_arrays(*values, np.abs(drive_speed), normal_force)]


def _linearise(q: list[Array]) -> Linearised:
    m, k, h, mu_s, mu_k0, delta, a, D, t, v, load = q
    with np.errstate(all="ignore"):
        ageing = (D > 0) & (t > 0) & (v * t <= D)
        worn = np.where(ageing, v * t / D, 1.0)
        resistance = h * np.sqrt(m / k) + load * delta * a * np.exp(-a * v) * worn
        step = mu_s - mu_k0 + delta * np.expm1(-a * v)
    return Linearised(m, k, resistance, step, load, t, D, worn, ageing)


def _polished(roots: NDArray[np.complex128], coefficients: Array) -> NDArray[np.complex128]:
    """Newton steps on the cubic: an eigenvalue solver leaves small roots with the error of the large ones."""
    c2, c1, c0 = (coefficients[..., i, None] for i in range(3))
    for _ in range(4):
        value = ((roots + c2) * roots + c1) * roots + c0
        slope = (3 * roots + 2 * c2) * roots + c1
        better = roots - value / slope
        roots = np.where(np.isfinite(better) & (np.abs(better - roots) < 1e-3 * np.abs(roots)), better, roots)
    return roots


def _roots(s: Linearised) -> NDArray[np.complex128]:
    """Dimensionless roots, shape (..., 3), unsorted; NaN last where there are two."""
    impedance = np.sqrt(s.mass * s.stiffness)
    z = s.resistance / impedance
    T = np.where(s.ageing, s.t_cr, 1.0) * np.sqrt(s.stiffness / s.mass)
    pi = s.normal_force * s.step * np.where(s.ageing, s.t_cr / s.D, 0.0) / impedance
    cubic = np.stack([z + 1 / T, 1 + z / T - pi / T, 1 / T], axis=-1)
    companion = np.zeros((*z.shape, 3, 3))
    companion[..., 0, :] = -cubic
    companion[..., 1, 0] = companion[..., 2, 1] = 1.0
    usable = np.asarray(np.isfinite(companion).all(axis=(-1, -2)))
    third = np.linalg.eigvals(np.where(usable[..., None, None], companion, 0.0)).astype(complex)
    third = np.where(usable[..., None], _polished(third, cubic), np.nan)
    # Two roots, product 1: the larger without cancellation, the smaller from the product.
    swing = np.sqrt((z / 2 - 1).astype(complex)) * np.sqrt((z / 2 + 1).astype(complex))
    large = -(z / 2 + np.where(z >= 0, 1, -1) * swing)
    oscillating = np.abs(z) < 2
    large = np.where(oscillating, -z / 2 + 1j * np.sqrt(np.maximum(1 - z * z / 4, 0)), large)
    small = np.where(oscillating, large.conj(), 1 / large)
    second = np.stack([large, small, np.full_like(large, np.nan)], axis=-1)
    return np.where(s.ageing[..., None], third, second)


def _slopes(q: list[Array], s: Linearised, roots: NDArray[np.complex128], sign: Array) -> dict[str, Any]:
    """d(root)/d(quantity), implicitly from P(root; quantities) = 0; roots [1/s] of shape (..., 3)."""
    m, k, h, _, _, delta, a, D, t, v, load = (x[..., None] for x in q)
    worn, ageing = s.worn[..., None], s.ageing[..., None]
    c, left = h * np.sqrt(m / k), np.exp(-a * v)
    slope = load * delta * a * left  # of friction, fresh contact
    by_worn = np.where(ageing, slope, 0.0)
    resistance = {
        "mass": c / (2 * m),
        "stiffness": -c / (2 * k),
        "damping": np.sqrt(m / k),
        "normal_force": delta * a * left * worn,
        "delta_mu_k": load * a * left * worn,
        "a": load * delta * left * worn * (1 - a * v),
        "drive_speed": sign[..., None] * (by_worn * t / D - a * slope * worn),
        "t_cr": by_worn * v / D,
        "D": -by_worn * v * t / D**2,
    }
    step: dict[str, Any] = {
        "mu_s": 1.0,
        "mu_k0": -1.0,
        "delta_mu_k": np.expm1(-a * v),
        "a": -delta * v * left,
        "drive_speed": -sign[..., None] * delta * a * left,
    }
    coupling = load * s.step[..., None] / D
    linear = {name: load / D * value for name, value in step.items()}
    linear["normal_force"], linear["D"] = s.step[..., None] / D, -coupling / D
    zero = np.zeros(1)
    mechanical = (m * roots + s.resistance[..., None]) * roots + k
    table: dict[str, Any] = {}
    for name in QUANTITIES:
        own: Any = resistance.get(name, zero) * roots + (roots**2 if name == "mass" else float(name == "stiffness"))
        creep = -mechanical / t**2 if name == "t_cr" else 0.0
        third = creep + (roots + 1 / t) * own - roots * linear.get(name, zero)
        rise = mechanical + (roots + 1 / t) * (2 * m * roots + s.resistance[..., None]) - coupling
        two = -own / (2 * m * roots + s.resistance[..., None])
        table[name] = np.where(ageing, -third / rise, two)
    return table


def eigenvalues(
    rig: RigLike,
    friction: FrictionLike,
    drive_speed: ArrayLike,
    normal_force: ArrayLike,
    *,
    derivatives: bool = False,
) -> Any:
    """Eigenvalues of steady sliding [1/s] (eqs. 19-24, derived form, speed dependence of friction kept).

    Args:
        rig: mass [kg], stiffness [N/m], damping h [N/m].
        friction: mu_s, mu_k0, delta_mu_k, a [s/m], D [m], t_cr [s]; D = 0 means no contact ageing.
        drive_speed: [m/s], sign irrelevant. normal_force: [N]. All of these broadcast.
        derivatives: also return {quantity: d eigenvalues / d quantity} for every quantity of the arguments.

    Returns:
        Complex array, shape (..., 3), descending real then imaginary part; the last is NaN where the contact
        is fully worn (v_acr > 1: gamma stays 0 and ageing plays no part).
    """
    sign = np.sign(np.asarray(drive_speed, float)) + (np.asarray(drive_speed) == 0)
    q = _arguments(rig, friction, drive_speed, normal_force)
    s = _linearise(q)
    with np.errstate(all="ignore"):
        roots = _roots(s)
        order = np.lexsort((-roots.imag, -roots.real), axis=-1)
        rates = np.take_along_axis(roots, order, axis=-1) * np.sqrt(s.stiffness / s.mass)[..., None]
        if not derivatives:
            return rates
        return rates, _slopes(q, s, rates, np.broadcast_to(sign, s.mass.shape))
