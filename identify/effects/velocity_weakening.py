"""Velocity weakening of kinetic friction, exponential form (eq. 6)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import casadi as ca

from identify.effects.quantities import Effect, Importance, Parameter, Situation, Terms
from identify.effects.typical import change_in_a_slip, fall, slip_speed


class VelocityWeakening(Effect):
    """mu_k(v) = mu_k0 + delta_mu_k (1 - exp(-a v)) (eq. 6); delta_mu_k < 0 weakens."""

    name = "velocity_weakening"
    says = "kinetic friction falls (or rises) exponentially with sliding speed"
    role = "velocity law"
    source = "eq. (6)"
    parameters = (
        Parameter(
            "delta_mu_k",
            "",
            -2.0,
            2.0,
            -0.1,
            "Δμk",
            "change of the kinetic coefficient from slow to fast sliding",
            scale="linear",
            spread=0.1,
        ),
        Parameter("a", "s/m", 1e-3, 1e7, 300.0, "a", "inverse of the speed over which kinetic friction changes"),
    )
    null = {"delta_mu_k": 0.0}

    def terms(self, s: Situation) -> Terms:
        """The weakening; the exponent is clipped so that a solver's trial step backwards stays finite."""
        return Terms(kinetic=-s.p.delta_mu_k * ca.expm1(-ca.fmax(s.p.a * s.v, -1.0)))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """Its change over a slip against the fall from static to kinetic friction."""
        speed = slip_speed(p, normal_force, drive_speed)
        share = abs(p["delta_mu_k"] * math.expm1(-p["a"] * speed)) * normal_force / fall(p, normal_force)
        return Importance(
            "Δμk (1 − exp(−a v))/(μs − μk0)",
            share,
            change_in_a_slip(speed, share),
        )
