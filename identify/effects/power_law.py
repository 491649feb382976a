"""Kinetic friction as a power of sliding speed: the measured law of Derler and Rotaru (eq. 7)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import casadi as ca

from identify.effects.quantities import Effect, Importance, Parameter, Situation, Terms
from identify.effects.typical import change_in_a_slip, fall, slip_speed


class PowerLaw(Effect):
    """mu_k(v) = mu_k0 (v/v_low)^-n above the lowest measured speed v_low, mu_k0 below it (eq. 7, speed).

    Eq. (7) as printed, 0.25 v^-0.37, is a finger on wet smooth glass: n = 0.37 and mu_k0 = 0.25 v_low^-0.37.
    The exponent is from the measurements; the range v_low to v_high, which eq. (7) does not state, is that of the
    defaults: set both to those of the measurements that are used.
    """

    name = "power_law"
    says = "kinetic friction falls as a power of sliding speed (measured: finger on wet smooth glass)"
    source = "eq. (7), 0.25 v^-0.37: index finger on wet smooth glass; Derler and Rotaru, Wear 301 (2013) 324"
    parameters = (
        Parameter("speed_exponent", "", -2.0, 2.0, 0.37, "n", "exponent of sliding speed", "linear", 0.1),
        Parameter("lowest_speed", "m/s", 1e-9, 1.0, 1e-3, "v_low", "lowest speed of the measurements", kind="given"),
        Parameter("highest_speed", "m/s", 1e-9, 1e3, 1.0, "v_high", "highest speed of the measurements", kind="given"),
    )
    null = {"speed_exponent": 0.0}
    role = "velocity law"

    def terms(self, s: Situation) -> Terms:
        """The change from mu_k0; level below the measured range."""
        ratio = ca.fmax(s.v / s.p.lowest_speed, 1.0)
        return Terms(kinetic=s.p.mu_k0 * ca.expm1(-s.p.speed_exponent * ca.log(ratio)))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """Its change over a slip against the fall from static to kinetic friction."""
        speed = slip_speed(p, normal_force, drive_speed)
        share = (
            abs(p["mu_k0"] * math.expm1(-p["speed_exponent"] * math.log(max(speed / p["lowest_speed"], 1.0))))
            * normal_force
            / fall(p, normal_force)
        )
        return Importance(
            "μk0 (1 − (v/v_low)^−n)/(μs − μk0)",
            share,
            change_in_a_slip(speed, share),
        )

    def refusal(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> str | None:
        """Outside the measured speeds."""
        if p["lowest_speed"] <= abs(drive_speed) <= p["highest_speed"]:
            return None
        return (
            f"power_law was measured from {p['lowest_speed']:g} to {p['highest_speed']:g} m/s "
            f"(a finger on wet smooth glass) and the drive runs at {abs(drive_speed):g} m/s; use velocity_weakening"
        )
