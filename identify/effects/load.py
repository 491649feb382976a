"""Friction that depends on the normal force, and a normal force that varies."""

from __future__ import annotations

import math
from collections.abc import Mapping

import casadi as ca

from identify.effects.quantities import Effect, Importance, Parameter, Situation, Terms


class LoadDependence(Effect):
    """All friction times (F_n/F_ref)^-n (eq. 7, normal force: n = 0.4): the coefficients hold at F_ref.

    The exponent is from the measurements; the range F_low to F_high, which eq. (7) does not state, is that of the
    defaults: set both to those of the measurements that are used.
    """

    name = "load_dependence"
    says = "the friction coefficient falls with normal force (measured: finger on wet smooth glass)"
    source = "eq. (7), 0.7 F_n^-0.4: index finger on wet smooth glass; Derler and Rotaru, Wear 301 (2013) 324"
    parameters = (
        Parameter("load_exponent", "", -2.0, 2.0, 0.4, "n_F", "exponent of normal force", "linear", 0.1),
        Parameter(
            "reference_force", "N", 1e-3, 1e4, 1.0, "F_ref", "normal force at which the coefficients hold", kind="given"
        ),
        Parameter(
            "lowest_force", "N", 1e-6, 1e4, 0.1, "F_low", "lowest normal force of the measurements", kind="given"
        ),
        Parameter(
            "highest_force", "N", 1e-6, 1e5, 50.0, "F_high", "highest normal force of the measurements", kind="given"
        ),
    )
    null = {"load_exponent": 0.0}
    role = "load law"

    def terms(self, s: Situation) -> Terms:
        """Logarithm of the factor."""
        return Terms(level=-s.p.load_exponent * ca.log(s.normal_force / s.p.reference_force))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """Change of all friction between the reference and this load."""
        change = math.expm1(-p["load_exponent"] * math.log(normal_force / p["reference_force"]))
        side = "below" if change < 0 else "above"
        return Importance(
            "(F_n/F_ref)^−n − 1",
            abs(change),
            f"friction is {100 * abs(change):.3g} % {side} that at {p['reference_force']:.3g} N",
        )

    def refusal(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> str | None:
        """Outside the measured loads."""
        if p["lowest_force"] <= normal_force <= p["highest_force"]:
            return None
        return (
            f"load_dependence was measured from {p['lowest_force']:g} to {p['highest_force']:g} N "
            f"(a finger on wet smooth glass) and the normal force is {normal_force:g} N; drop it"
        )


class PressureDependence(Effect):
    """All friction times (p/p_ref)^-n with p = F_n/A_c and A_c = A_1 (F_n/F_A)^e (eq. 7, pressure: n = 0.526).

    e = 0 is a constant area; e = 0.2395, A_1 = 2.262 cm^2 at F_A = 1 N is what makes the two forms of eq. (7) agree.
    The range p_low to p_high, which eq. (7) does not state, is the pressure of the default load range under that area
    law: set both to those of the measurements that are used.
    """

    name = "pressure_dependence"
    says = "the friction coefficient falls with contact pressure (measured: finger on wet smooth glass)"
    source = "eq. (7), 57.9 p^-0.526; Derler and Rotaru, Wear 301 (2013) 324; area law: docs/equations.md, section 2"
    parameters = (
        Parameter("pressure_exponent", "", -2.0, 2.0, 0.526, "n_p", "exponent of contact pressure", "linear", 0.1),
        Parameter(
            "reference_pressure",
            "Pa",
            1.0,
            1e9,
            4421.7,
            "p_ref",
            "pressure at which the coefficients hold",
            kind="given",
        ),
        Parameter("contact_area", "m^2", 1e-9, 1.0, 2.262e-4, "A_1", "apparent contact area under F_A", kind="given"),
        Parameter("area_force", "N", 1e-6, 1e5, 1.0, "F_A", "normal force under which the area is A_1", kind="given"),
        Parameter(
            "area_exponent",
            "",
            -1.0,
            2.0,
            0.2395,
            "e",
            "exponent of the area with normal force",
            "linear",
            0.1,
            "given",
        ),
        Parameter(
            "lowest_pressure", "Pa", 1e-3, 1e9, 760.0, "p_low", "lowest pressure of the measurements", kind="given"
        ),
        Parameter(
            "highest_pressure", "Pa", 1e-3, 1e9, 8.7e4, "p_high", "highest pressure of the measurements", kind="given"
        ),
    )
    null = {"pressure_exponent": 0.0}
    role = "load law"

    def terms(self, s: Situation) -> Terms:
        """Logarithm of the factor."""
        area = s.p.contact_area * (s.normal_force / s.p.area_force) ** s.p.area_exponent
        return Terms(level=-s.p.pressure_exponent * ca.log(s.normal_force / area / s.p.reference_pressure))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """Change of all friction between the reference and this pressure."""
        pressure = _pressure(p, normal_force)
        change = math.expm1(-p["pressure_exponent"] * math.log(pressure / p["reference_pressure"]))
        side = "below" if change < 0 else "above"
        return Importance(
            "(p/p_ref)^−n − 1",
            abs(change),
            f"friction is {100 * abs(change):.3g} % {side} that at {p['reference_pressure']:.3g} Pa",
        )

    def refusal(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> str | None:
        """Outside the measured pressures."""
        pressure = _pressure(p, normal_force)
        if p["lowest_pressure"] <= pressure <= p["highest_pressure"]:
            return None
        return (
            f"pressure_dependence was measured from {p['lowest_pressure']:g} to {p['highest_pressure']:g} Pa "
            f"(a finger on wet smooth glass) and the contact pressure is {pressure:.3g} Pa; drop it"
        )


def _pressure(p: Mapping[str, float], normal_force: float) -> float:
    """Mean contact pressure [Pa]."""
    return normal_force / (p["contact_area"] * (normal_force / p["area_force"]) ** p["area_exponent"])


class VaryingNormalForce(Effect):
    """Friction follows the measured normal force. It brings no parameter and no state."""

    name = "varying_normal_force"
    says = "friction follows the measured normal force; off: its mean"
    source = "eq. (5), F_f = F_n(t) mu"
    follows_load = True
