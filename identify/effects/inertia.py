"""Inertia of the moving specimen: m_s x'' of eq. (1)."""

from __future__ import annotations

from collections.abc import Mapping

from identify.base.wording import three_figures
from identify.effects.quantities import Effect, Importance, Parameter, Situation, Terms
from identify.effects.typical import slip_time, stick_time


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

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """How long its slips last against its sticks."""
        slip = slip_time(p, normal_force, drive_speed)
        share = slip / (slip + stick_time(p, normal_force, drive_speed))
        return Importance(
            "T_slip/T",
            share,
            f"half a natural period ({1e3 * slip:.3g} ms), about a slip, is {three_figures(100 * share)} % of a cycle",
        )
