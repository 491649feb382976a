"""Inertia of the moving specimen: m_s x'' of eq. (1)."""

from __future__ import annotations

from identify.quantities import Effect, Parameter, Situation, Terms


class Inertia(Effect):
    """The mass resists acceleration (eq. 1). Off means quasi-static sliding."""

    name = "inertia"
    says = "the mass resists acceleration; off: force balance"
    source = "eq. (1), m_s x''"
    parameters = (
        Parameter(
            "mass", "kg", 1e-6, 1e4, 0.2, "m", "moving mass of the specimen and its holder", spread=0.05, kind="rig"
        ),
    )
    null = {"mass": 0.0}

    def terms(self, s: Situation) -> Terms:
        """The mass."""
        return Terms(inertia=s.p.mass)
