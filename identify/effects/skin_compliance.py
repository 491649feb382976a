"""Skin compliance: a Kelvin-Voigt element in series with the rig, the tangential give of a finger pad."""

from __future__ import annotations

from collections.abc import Mapping

from identify.effects.quantities import Effect, Importance, Parameter, Series, Situation, State, Terms


class SkinCompliance(Effect):
    """Stiffness k_skin and damping k_skin * t_skin between rig and contact; the skin's own mass is neglected.

    The mass moves with the contact: for a specimen that rides on the rig side of the skin this holds where the skin is
    much stiffer than the rig or the slip much slower than the rig's natural period.
    State: the deformation of the skin. In stick the rig is softer by it: 1/k + 1/k_skin. Null as k_skin grows.
    """

    name = "skin_compliance"
    says = "tangential give of the skin in series with the rig"
    source = "Kelvin-Voigt element in series; docs/equations.md, section 7"
    parameters = (
        Parameter("skin_stiffness", "N/m", 1.0, 1e12, 4400.0, "k_skin", "tangential stiffness of the skin"),
        Parameter(
            "skin_retardation", "s", 1e-6, 1e3, 2e-3, "t_skin", "damping over stiffness of the skin", kind="given"
        ),
    )
    states = (State("skin_deformation", "m", 0.0),)
    null = {"skin_stiffness": float("inf")}  # a limit

    def terms(self, s: Situation) -> Terms:
        """The element; the model writes its rate."""
        return Terms(series=Series("skin_deformation", s.p.skin_stiffness, s.p.skin_stiffness * s.p.skin_retardation))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """Rig against skin."""
        ratio = p["stiffness"] / p["skin_stiffness"]
        return Importance("k/k_skin", ratio, f"the skin softens the rig by {100 * ratio / (1 + ratio):.3g} %")
