"""Contact ageing: the real contact area saturates at rest and is renewed by sliding (eqs. 2-5)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import casadi as ca

from identify.base.wording import three_figures
from identify.effects.quantities import Effect, Expression, Importance, Parameter, Situation, State, Terms
from identify.effects.typical import fall, stick_time


class ContactAgeing(Effect):
    """State gamma: gamma' = (1 - gamma)/t_cr - |x'|/D, held within 0 and 1 (eq. 2, drive frame)."""

    name = "contact_ageing"
    says = "the contact strengthens while it rests and is renewed by sliding"
    source = "eqs. (2)-(5)"
    parameters = (
        Parameter("D", "m", 1e-8, 1e-1, 40e-6, "D", "relaxation length: sliding that renews the contact"),
        Parameter("t_cr", "s", 1e-5, 1e5, 0.5, "t_cr", "creep time: rest that saturates the contact"),
    )
    states = (State("gamma", "", start=0.0, lower=0.0, upper=1.0),)
    null = {"D": 0.0, "t_cr": 0.0}  # a limit: plain static and kinetic friction, D/t_cr vanishing too

    def terms(self, s: Situation) -> Terms:
        """Strengthening gamma and its rate."""
        gamma = s.x.gamma
        return Terms(strengthening=gamma, rates={"gamma": s.pace * (1 - gamma) / s.p.t_cr - s.v / s.p.D})

    def at_rest(self, s: Situation, aged: Expression) -> Mapping[str, Expression]:
        """Eq. (3a) from any start: 1 - (1 - gamma) exp(-t/t_cr)."""
        return {"gamma": s.x.gamma - (1 - s.x.gamma) * ca.expm1(-aged / s.p.t_cr)}

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """Relaxation length against the travel of the spring in a slip, and creep time against the stick."""
        travel = fall(p, normal_force) / p["stiffness"]
        rest = stick_time(p, normal_force, drive_speed)
        regained = -math.expm1(-rest / p["t_cr"])
        return Importance(
            "D k/((μs − μk0) F_n)",
            p["D"] / travel,
            f"sliding by {1e6 * p['D']:.3g} µm renews the contact, {p['D'] / travel:.2g} of the spring's travel; "
            f"a stick of about {three_figures(rest)} s regains {three_figures(100 * regained)} % of the strength",
        )
