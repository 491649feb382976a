"""Hysteresis damping between specimen and drive: h/omega of eq. (1), omega the natural frequency."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from identify.effects.quantities import Effect, Importance, Parameter, Situation, Terms
from identify.effects.typical import lost_per_period


class HysteresisDamping(Effect):
    """Force c (v_0 - x') with c = h/omega_n = h sqrt(m/k), in parallel with the spring (eq. 1)."""

    name = "hysteresis_damping"
    says = "damper beside the spring, h over the natural frequency"
    role = "damping of the rig"
    needs = ("inertia",)
    source = "eq. (1), h/omega_n; damper between mass and drive: docs/equations.md, section 1"
    parameters = (
        Parameter("damping", "N/m", 0.0, 1e8, 147.0, "h", "hysteresis damping; zeta = h/(2k)", spread=0.3, kind="rig"),
    )
    null = {"damping": 0.0}

    def terms(self, s: Situation) -> Terms:
        """The damper, which the load cell sees as well."""
        return Terms(damping=s.p.damping * ca.sqrt(s.p.mass / s.p.stiffness))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """The damping ratio."""
        ratio = p["damping"] / (2 * p["stiffness"])
        return Importance(
            "ζ = h/2k", ratio, f"a free swing of the rig loses {100 * lost_per_period(ratio):.3g} % per period"
        )
