"""Dimensionless groups of a rig and a friction law at a drive speed and normal force (docs/equations.md, section 1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

RIG = ("mass", "stiffness", "damping")
FRICTION = ("mu_s", "mu_k0", "delta_mu_k", "a", "D", "t_cr")
QUANTITIES = (*RIG, *FRICTION, "drive_speed", "normal_force")  # what the calculators take

Numbers = float | NDArray[np.float64]


@dataclass(frozen=True)
class Groups:
    """The groups; units and meanings stand in MEANING. NaN where a rig at rest (v0 = 0) has none.

    Floats, arrays where the arguments were arrays.
    """

    omega_n: Annotated[Numbers, "rad/s", "natural frequency of the mass on the spring"]
    zeta: Annotated[Numbers, "", "damping ratio h/2k"]
    w: Annotated[Numbers, "", "dimensionless load F_n / (v0 sqrt(m k))"]
    tau_cr: Annotated[Numbers, "", "creep time in units of 1/omega_n"]
    v_cr: Annotated[Numbers, "m/s", "speed D/t_cr above which sliding wears off all contact ageing"]
    v_acr: Annotated[Numbers, "", "drive speed over v_cr"]
    gamma_0: Annotated[Numbers, "", "saturation of the contact in steady sliding"]
    v_a: Annotated[Numbers, "", "drive speed in units of the speed over which kinetic friction changes"]
    alpha: Annotated[Numbers, "", "effective damping ratio of the linearised slip; at -1 and below that law runs away"]
    xi_o: Annotated[Numbers, "", "equilibrium elongation of the linearised slip"]
    xi_p: Annotated[Numbers, "", "elongation at the onset of slip, damper force included"]
    xi_p_printed: Annotated[Numbers, "", "elongation at the onset of slip as printed, eq. (12)"]
    overshoot: Annotated[Numbers, "", "A = xi_p - xi_o"]
    loading: Annotated[Numbers, "", "loading parameter Phi = 2 alpha + A; stick-slip repeats above Phi_cr(alpha)"]
    z: Annotated[Numbers, "", "damping of steady sliding with the slope of friction; 2 zeta without it"]
    Pi: Annotated[Numbers, "", "friction parameter of steady sliding; unstable above Pi_fc"]


MEANING: Mapping[str, tuple[str, str]] = {
    name: hint.__metadata__ for name, hint in get_type_hints(Groups, include_extras=True).items()
}


def settings(rig: object, friction: object, drive_speed: ArrayLike, normal_force: ArrayLike) -> dict[str, Any]:
    """The arguments of the calculators by name (QUANTITIES), arrays of one shape or floats; speeds without sign.

    Args:
        rig: anything with mass [kg], stiffness [N/m] and damping h [N/m].
        friction: anything with mu_s, mu_k0, delta_mu_k, a [s/m], D [m], t_cr [s]; D = 0 means no contact ageing.
    """
    values = [getattr(rig, name) for name in RIG] + [getattr(friction, name) for name in FRICTION]
    shaped = np.broadcast_arrays(*values, np.abs(drive_speed), normal_force)
    return {name: np.asarray(q, float)[()] for name, q in zip(QUANTITIES, shaped, strict=True)}


def formed(q: Mapping[str, Any]) -> dict[str, Any]:
    """The groups of `settings` by name."""
    v, impedance = q["drive_speed"], np.sqrt(q["mass"] * q["stiffness"])
    ageing = (q["D"] > 0) & (q["t_cr"] > 0)
    omega, zeta = np.sqrt(q["stiffness"] / q["mass"]), q["damping"] / (2 * q["stiffness"])
    force = q["normal_force"] / impedance  # w v0: the groups below hardly know the drive speed
    w, v_a = force / v, q["a"] * v
    v_acr = np.where(ageing, v * q["t_cr"] / q["D"], np.inf)
    gamma_0 = np.where(v_acr < 1, 1 - v_acr, 0.0)
    slope = q["delta_mu_k"] * q["a"] * force
    step = q["mu_s"] - q["mu_k0"]
    alpha, loading = zeta + slope / 2, step * w
    weakened = step + q["delta_mu_k"] * np.expm1(-v_a)
    return {
        "omega_n": omega,
        "zeta": zeta,
        "w": w,
        "tau_cr": omega * q["t_cr"],
        "v_cr": np.where(ageing, q["D"] / q["t_cr"], 0.0),
        "v_acr": v_acr,
        "gamma_0": gamma_0,
        "v_a": v_a,
        "alpha": alpha,
        "xi_o": (q["mu_k0"] + q["delta_mu_k"] * v_a) * w,
        "xi_p": q["mu_s"] * w - 2 * zeta,
        "xi_p_printed": q["mu_s"] * w,
        "overshoot": loading - 2 * alpha,
        "loading": loading,
        "z": 2 * zeta + slope * np.exp(-v_a) * (1 - gamma_0),
        "Pi": np.where(ageing, force * weakened * q["t_cr"] / q["D"], np.nan),
    }


def groups(rig: object, friction: object, drive_speed: ArrayLike, normal_force: ArrayLike) -> Groups:
    """The dimensionless groups of operating points.

    Args:
        rig, friction: as for `settings`. drive_speed: [m/s], sign irrelevant. normal_force: [N]. All broadcast.
    """
    with np.errstate(all="ignore"):
        found = formed(settings(rig, friction, drive_speed, normal_force))
        return Groups(**{name: float(value) if np.ndim(value) == 0 else value for name, value in found.items()})
