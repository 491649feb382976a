"""Velocity weakening of kinetic friction, the linear form of eq. (6)."""

from __future__ import annotations

from collections.abc import Mapping

from identify.effects.quantities import Effect, Importance, Parameter, Situation, Terms
from identify.effects.typical import change_in_a_slip, fall, slip_speed


class LinearWeakening(Effect):
    """mu_k(v) = mu_k0 + delta_mu_k a v, the start of eq. (6); one number only, the slope: delta_mu_k a [s/m].

    It knows no floor: where it would make friction negative it has left its range.
    """

    name = "linear_weakening"
    says = "kinetic friction changes in proportion to sliding speed"
    source = "eq. (6), linear form; valid for a v << 1"
    parameters = (
        Parameter(
            "slope",
            "s/m",
            -1e6,
            1e6,
            -1.0,
            "Δμk a",
            "change of the kinetic coefficient per sliding speed",
            "linear",
            1.0,
        ),
    )
    null = {"slope": 0.0}
    role = "velocity law"

    def terms(self, s: Situation) -> Terms:
        """The change."""
        return Terms(kinetic=s.p.slope * s.v)

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """Its change over a slip against the fall from static to kinetic friction."""
        speed = slip_speed(p, normal_force, drive_speed)
        share = abs(p["slope"]) * speed * normal_force / fall(p, normal_force)
        return Importance(
            "Δμk a v/(μs − μk0)",
            share,
            change_in_a_slip(speed, share),
        )
