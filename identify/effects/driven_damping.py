"""Hysteresis damping at a given frequency: h/omega of eq. (1) with the frequency of an excitation."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from identify.effects.quantities import Effect, Importance, Parameter, Situation, Terms
from identify.effects.typical import lost_per_period, slip_time


class DrivenDamping(Effect):
    """Force c (v_0 - x') with c = h/(2 pi f), f the frequency of the forced oscillation (eq. 1)."""

    name = "driven_damping"
    says = "damper beside the spring, h over a given excitation frequency"
    source = "eq. (1), h/omega with omega of the excitation; docs/equations.md, section 1"
    parameters = (
        Parameter("damping", "N/m", 0.0, 1e8, 147.0, "h", "hysteresis damping; c = h/omega", spread=0.3, kind="rig"),
        Parameter("damping_frequency", "1/s", 1e-6, 1e6, 13.645, "f_d", "frequency at which h acts", kind="given"),
    )
    null = {"damping": 0.0}
    role = "damping of the rig"

    def terms(self, s: Situation) -> Terms:
        """The damper, which the load cell sees as well."""
        return Terms(damping=s.p.damping / (2 * np.pi * s.p.damping_frequency))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """The damping ratio at the natural frequency; of a rig without mass, damper against spring in a slip."""
        damper = p["damping"] / (2 * np.pi * p["damping_frequency"])
        ratio = damper * np.pi / (2 * p["stiffness"] * slip_time(p, normal_force, drive_speed))
        return Importance(
            "ζ = c/2√(m k)", ratio, f"a free swing of the rig loses {100 * lost_per_period(ratio):.3g} % per period"
        )
