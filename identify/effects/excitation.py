"""Motion of the drive beyond its programme: from outside, or of a live finger."""

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


# amplitude default [m], frequency default, lowest and highest [Hz]
RHYTHMS = {
    "breathing": (20e-6, 0.25, 0.05, 1.0),
    "pulse": (5e-6, 1.0, 0.5, 3.0),
    "tremor": (2e-6, 10.0, 4.0, 20.0),
}


def _of(rhythm: str) -> tuple[Parameter, ...]:
    amplitude, frequency, lowest, highest = RHYTHMS[rhythm]
    return (
        Parameter(
            f"{rhythm}_amplitude", "m", -1e-2, 1e-2, amplitude, f"A_{rhythm}", f"amplitude of {rhythm}", "linear", 1e-6
        ),
        Parameter(
            f"{rhythm}_frequency",
            "1/s",
            lowest,
            highest,
            frequency,
            f"f_{rhythm}",
            f"frequency of {rhythm}",
            "log",
            0.01,
        ),
        Parameter(
            f"{rhythm}_phase",
            "",
            -100.0,
            100.0,
            0.0,
            f"φ_{rhythm}",
            f"phase of {rhythm} at time 0 [rad]",
            "linear",
            0.3,
            own=True,
        ),
    )


class FingerMotion(Effect):
    """Each rhythm moves the drive by amplitude * sin(2 pi frequency t + phase); the drift by a constant speed."""

    name = "finger_motion"
    says = "a live finger moves: breathing, pulse, tremor and slow drift"
    source = "breathing near 0.25 Hz, pulse near 1 Hz, physiological tremor 8-12 Hz"
    parameters = (
        *(parameter for rhythm in RHYTHMS for parameter in _of(rhythm)),
        Parameter(
            "finger_drift",
            "m/s",
            -1e-2,
            1e-2,
            0.0,
            "v_drift",
            "slow drift of the finger along the drive",
            "linear",
            1e-6,
            "given",
        ),
    )
    null = {"breathing_amplitude": 0.0, "pulse_amplitude": 0.0, "tremor_amplitude": 0.0, "finger_drift": 0.0}

    def terms(self, s: Situation) -> Terms:
        """The harmonics and the drift."""
        p = vars(s.p)
        waves = tuple(Wave(p[f"{r}_amplitude"], 2 * np.pi * p[f"{r}_frequency"], p[f"{r}_phase"]) for r in RHYTHMS)
        return Terms(waves=waves, drift=s.p.finger_drift)

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """The largest force a rhythm makes in stick, against the fall of friction."""
        amplitude = max(abs(p[f"{r}_amplitude"]) for r in RHYTHMS)
        fall = max(abs(p["mu_s"] - p["mu_k0"]) * normal_force, 1e-300)
        share = p["stiffness"] * amplitude / fall
        return Importance(
            "k A/((μs − μk0) F_n)", share, f"the finger moves the force by {100 * share:.3g} % of the drop"
        )
