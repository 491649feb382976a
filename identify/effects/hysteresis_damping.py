"""Hysteresis damping between specimen and drive: h/omega of eq. (1), omega the natural frequency."""

from __future__ import annotations

import casadi as ca

from identify.quantities import Parameter, Situation, Stateless, Terms


class HysteresisDamping(Stateless):
    """Force c (v_0 - x') with c = h/omega_n = h sqrt(m/k), in parallel with the spring (eq. 1)."""

    name = "hysteresis_damping"
    source = "eq. (1), h/omega_n; EQUATIONS section 1 (damper between mass and drive)"
    parameters = (Parameter("damping", "N/m", 0.0, 1e8, 147.0, "h", "hysteresis damping; zeta = h/(2k)", spread=0.3),)
    null = {"damping": 0.0}

    def terms(self, s: Situation) -> Terms:
        """The damper's force on the mass, which the load cell sees as well."""
        c = s.p.damping * ca.sqrt(s.p.mass / s.p.stiffness)
        return Terms(rig_force=c * (s.drive_speed - s.direction * s.v))
