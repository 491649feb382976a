"""The measured course of the normal force F_n(t), in the threshold and in sliding; off: its mean."""

from __future__ import annotations

from identify.effects.quantities import Effect


class VaryingNormalForce(Effect):
    """Friction follows the measured normal force. It brings no parameter and no state."""

    name = "varying_normal_force"
    says = "friction follows the measured course of the normal force; off: its mean"
    source = "eq. (5), F_f = F_n(t) mu"
    follows_load = True
