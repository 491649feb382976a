"""Excitation from outside: harmonic motion of the drive (eq. 1 speaks of a system excited from the outside)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from identify.effects.quantities import Effect, Importance, Parameter, Situation, Terms, Wave


class Excitation(Effect):
    """The drive moves by amplitude * sin(2 pi frequency t + phase) beyond its programme."""

    name = "excitation"
    says = "harmonic motion of the drive from outside"
    source = "eq. (1), 'excited from the outside'"
    parameters = (
        Parameter(
            "excitation_amplitude", "m", -1e-2, 1e-2, 1e-6, "A_e", "amplitude of the drive's vibration", "linear", 1e-6
        ),
        Parameter(
            "excitation_frequency", "1/s", 1e-3, 1e4, 50.0, "f_e", "frequency of the drive's vibration", spread=0.01
        ),
        Parameter(
            "excitation_phase",
            "",
            -100.0,
            100.0,
            0.0,
            "φ_e",
            "phase of the vibration at time 0 [rad]",
            "linear",
            0.3,
            own=True,
        ),
    )
    null = {"excitation_amplitude": 0.0}

    def terms(self, s: Situation) -> Terms:
        """The harmonic."""
        omega = 2 * np.pi * s.p.excitation_frequency
        return Terms(waves=(Wave(s.p.excitation_amplitude, omega, s.p.excitation_phase),))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """Its largest speed against the drive's."""
        share = abs(p["excitation_amplitude"]) * 2 * np.pi * p["excitation_frequency"] / max(abs(drive_speed), 1e-300)
        return Importance("A_e ω_e/v_0", share, f"the vibration is {share:.2g} times as fast as the drive")
