"""Direct effect: friction that rises at once with sliding speed (docs/equations.md, section 7)."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from identify.effects.quantities import Effect, Importance, Parameter, Situation, Terms


class DirectEffect(Effect):
    """A ln(1 + v/v_star) on the friction coefficient: zero in stick, it slows the start of a slip."""

    name = "direct_effect"
    says = "friction rises at once with sliding speed"
    source = "Dieterich, J. Geophys. Res. 84 (1979) 2161: A ln(1 + v/v*)"
    parameters = (
        Parameter("direct_strength", "", 0.0, 1.0, 0.005, "A", "direct effect per e-fold of sliding speed"),
        Parameter(
            "direct_speed", "m/s", 1e-9, 1.0, 1e-4, "v*", "speed at which the direct effect sets in", kind="given"
        ),
    )
    null = {"direct_strength": 0.0}

    def terms(self, s: Situation) -> Terms:
        """The excess; a solver's trial step backwards stays finite."""
        return Terms(excess=s.p.direct_strength * ca.log1p(ca.fmax(s.v / s.p.direct_speed, -0.5)))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """A against the fall of friction it works against."""
        share = p["direct_strength"] / max(abs(p["mu_s"] - p["mu_k0"]), 1e-12)
        return Importance(
            "A/(μs − μk0)", share, f"the direct effect is {100 * share:.3g} % of the fall of friction per e-fold"
        )
