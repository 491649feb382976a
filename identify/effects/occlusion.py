"""Occlusion: skin under the specimen moistens in time, and friction level and ageing drift with it."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from identify.effects.quantities import Effect, Importance, Parameter, Situation, Terms


class Occlusion(Effect):
    """With the share e(t) = 1 - exp(-t/t_occ): all friction times exp(level e), contact ageing 1 + hastening e as fast.

    A drift in time, not along the track. t counts from the start of the record.
    """

    name = "occlusion"
    says = "friction level and ageing drift in time as the skin moistens"
    source = "occlusion of skin by a closed contact within tens of seconds; first-order approach"
    parameters = (
        Parameter(
            "occlusion_level",
            "",
            -3.0,
            3.0,
            0.1,
            "λ_occ",
            "logarithm of the final change of friction level",
            "linear",
            0.1,
        ),
        Parameter(
            "occlusion_hastening",
            "",
            -0.99,
            20.0,
            0.0,
            "η_occ",
            "final change of the ageing rate",
            "linear",
            0.1,
            "given",
        ),
        Parameter("occlusion_time", "s", 1e-2, 1e6, 30.0, "t_occ", "time in which the skin moistens"),
    )
    null = {"occlusion_level": 0.0, "occlusion_hastening": 0.0}

    def terms(self, s: Situation) -> Terms:
        """The level, and the ageing time gained: the integral of hastening * e."""
        share = -ca.expm1(-s.time / s.p.occlusion_time)
        gained = s.p.occlusion_hastening * (s.time - s.p.occlusion_time * share)
        return Terms(level=s.p.occlusion_level * share, clock=gained)

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """The change of level."""
        share = abs(p["occlusion_level"])
        return Importance("λ_occ", share, f"friction drifts by {100 * share:.3g} % within {p['occlusion_time']:.3g} s")
