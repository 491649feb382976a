"""Hysteresis damping at a given frequency: h/omega of eq. (1) with the frequency of an excitation."""

from __future__ import annotations

import numpy as np

from identify.quantities import Effect, Parameter, Situation, Terms


class DrivenDamping(Effect):
    """Force c (v_0 - x') with c = h/(2 pi f), f the frequency of the forced oscillation (eq. 1)."""

    name = "driven_damping"
    says = "damper beside the spring, h over a given excitation frequency"
    source = "eq. (1), h/omega with omega of the excitation; EQUATIONS E1"
    parameters = (
        Parameter("damping", "N/m", 0.0, 1e8, 147.0, "h", "hysteresis damping; c = h/omega", spread=0.3, kind="rig"),
        Parameter("damping_frequency", "1/s", 1e-6, 1e6, 13.645, "f_d", "frequency at which h acts", kind="given"),
    )
    null = {"damping": 0.0}
    role = "damping of the rig"

    def terms(self, s: Situation) -> Terms:
        """The damper, which the load cell sees as well."""
        return Terms(damping=s.p.damping / (2 * np.pi * s.p.damping_frequency))
