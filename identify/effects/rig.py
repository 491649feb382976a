"""The rig: its inertia, its damping, and what gives in series with it."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from identify.base.wording import three_figures
from identify.effects.quantities import (
    Effect,
    Importance,
    Parameter,
    Series,
    Situation,
    State,
    Terms,
    lost_per_period,
    slip_time,
    stick_time,
)


class Inertia(Effect):
    """The mass resists acceleration (eq. 1). Off means quasi-static sliding."""

    name = "inertia"
    says = "the mass resists acceleration; no motion is simulated without it"
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
