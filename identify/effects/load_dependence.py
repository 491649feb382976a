"""Friction coefficient falling with normal force: the measured law of Derler and Rotaru (eq. 7)."""

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
