"""Dimensionless groups, and the paper's closed forms of a cycle in SI (eqs. 8-25) beside the nonlinear model's answer.

The linearised slip (docs/equations.md, sections 1 and 4) of a contact that its stick has saturated, from the exact
breakaway (damper force included); of use where a V_max << 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from identify.effects import MAIN
from identify.prediction import amplitude, stability
from identify.prediction.stability import QUANTITIES

Array = NDArray[np.float64]
Numbers = float | Array

AGREES = 0.05  # relative difference up to which a closed form is called valid at an operating point
KNOWN = (*MAIN, "varying_normal_force")  # effects, at one operating point
CYCLE = ("drop", "period", "slip_duration", "peak_speed")


# The groups by name: unit and meaning; NaN where a rig at rest (v0 = 0) has none.
MEANING: Mapping[str, tuple[str, str]] = {
    "omega_n": ("rad/s", "natural frequency of the mass on the spring"),
    "zeta": ("", "damping ratio h/2k"),
    "w": ("", "dimensionless load F_n / (v0 sqrt(m k))"),
    "tau_cr": ("", "creep time in units of 1/omega_n"),
    "v_cr": ("m/s", "speed D/t_cr above which sliding wears off all contact ageing"),
    "v_acr": ("", "drive speed over v_cr"),
    "gamma_0": ("", "saturation of the contact in steady sliding"),
    "v_a": ("", "drive speed in units of the speed over which kinetic friction changes"),
    "alpha": ("", "effective damping ratio of the linearised slip; at -1 and below that law runs away"),
    "xi_o": ("", "equilibrium elongation of the linearised slip"),
    "xi_p": ("", "elongation at the onset of slip, damper force included"),
    "xi_p_printed": ("", "elongation at the onset of slip as printed, eq. (12)"),
    "overshoot": ("", "A = xi_p - xi_o"),
    "loading": ("", "loading parameter Phi = 2 alpha + A; stick-slip repeats above Phi_cr(alpha)"),
    "z": ("", "damping of steady sliding with the slope of friction; 2 zeta without it"),
    "Pi": ("", "friction parameter of steady sliding; unstable above Pi_fc"),
}


def _formed(q: Mapping[str, Array]) -> dict[str, Array]:
    """The groups by name, of QUANTITIES by name."""
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


@dataclass(frozen=True)
class ClosedForms:
    """The closed forms at operating points, SI, NaN where they have no answer; arrays (n,), or of shape ().

    status: "restick", "steady" (slides on), "no_slip", "runaway" (alpha <= -1) of the linearised slip. groups: by name
    (`MEANING`). numbers: "drop", "period", "slip_duration", "peak_speed" of a cycle; "critical_speed"
    [m/s], below which that slip sticks again; "Pi" and its critical value "Pi_fc" decide
    whether steady sliding is stable (below: stable); "Omega_c". renewed: the contact does not age in steady sliding.
    """

    groups: Mapping[str, Array]
    status: NDArray[np.str_]
    renewed: NDArray[np.bool_]
    numbers: Mapping[str, Array]


def beyond(effects: Sequence[str]) -> tuple[str, ...]:
    """The effects of which the closed forms know nothing."""
    return tuple(name for name in effects if name not in KNOWN)


def closed_forms(values: Mapping[str, Numbers]) -> ClosedForms:
    """The closed forms (docs/equations.md, sections 4 to 6) of named values [SI] of a model's parameters, "drive_speed"
    and "normal_force", arrays of one shape or floats; what is absent is null (no damping, ageing, weakening)."""
    known = np.broadcast_arrays(*(values.get(name, 0.0) for name in QUANTITIES))
    q = {name: np.asarray(value, float)[()] for name, value in zip(QUANTITIES, known, strict=True)}
    with np.errstate(all="ignore"):
        g = _formed(q)
        slip = amplitude.slip(g["alpha"], g["overshoot"])
        length, time = q["drive_speed"] / g["omega_n"], 1 / g["omega_n"]
        ageing = (q["D"] > 0) & (q["t_cr"] > 0)
        limit = stability.critical_loading(g["alpha"])
        fall = (q["mu_s"] - q["mu_k0"]) * q["normal_force"] / np.sqrt(q["mass"] * q["stiffness"])
        numbers = {
            "drop": slip.drop * length * q["stiffness"],
            "period": slip.period * time,
            "slip_duration": slip.duration * time,
            "peak_speed": slip.peak_speed * q["drive_speed"],
            "critical_speed": np.where(np.isnan(limit), np.nan, np.where(limit > 0, fall / limit, np.inf)),
            "Pi": g["Pi"],
            "Pi_fc": np.where(ageing, stability.critical_friction(g["z"] / 2, g["tau_cr"]), np.nan),
            "Omega_c": np.where(ageing, stability.critical_frequency(g["z"] / 2, g["tau_cr"]), np.nan),
        }
    shape = np.shape(q["drive_speed"])
    shown = [{name: np.broadcast_to(value, shape) for name, value in table.items()} for table in (g, numbers)]
    return ClosedForms(shown[0], np.asarray(slip.status), ~ageing | (g["v_acr"] > 1), shown[1])


def judged(value: float, answer: float | None, status: str, alpha: float) -> str:
    """Whether a closed form holds here: it is compared with the nonlinear model's `answer` (None: there is none)."""
    if status == "runaway":
        return f"not valid here: the linear law runs away (alpha = {alpha:.3g}, at or below -1)"
    if not np.isfinite(value) and answer is None:
        return "valid here: like the nonlinear model it has no such motion"
    if not np.isfinite(value):
        return "not valid here: it has no answer where the nonlinear model has one"
    if answer is None or not np.isfinite(answer):
        return "not valid here: the nonlinear model has no such motion"
    off = abs(value / answer - 1)
    words = f"a factor {off + 1:.0f}" if off > 3 else f"{100 * off:.1f} %" if off < 0.0995 else f"{100 * off:.0f} %"
    return f"valid here: within {words}" if off <= AGREES else f"not valid here: off by {words}"
