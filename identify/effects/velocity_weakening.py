"""Velocity weakening of kinetic friction, exponential form (eq. 6)."""

from __future__ import annotations

import casadi as ca

from identify.quantities import Effect, Parameter, Situation, Terms


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
