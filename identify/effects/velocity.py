"""Friction that depends on sliding speed."""

from __future__ import annotations

import math
from collections.abc import Mapping

import casadi as ca

from identify.effects.quantities import (
    Effect,
    Importance,
    Parameter,
    Situation,
    Terms,
    change_in_a_slip,
    fall,
    slip_speed,
)


class VelocityWeakening(Effect):
    """mu_k(v) = mu_k0 + delta_mu_k (1 - exp(-a v)) (eq. 6); delta_mu_k < 0 weakens."""

    name = "velocity_weakening"
    says = "kinetic friction falls (or rises) exponentially with sliding speed"
    role = "velocity law"
    source = "eq. (6)"
    parameters = (
        Parameter(
            "delta_mu_k",
            "",
            -2.0,
            2.0,
            -0.1,
            "Δμk",
            "change of the kinetic coefficient from slow to fast sliding",
            scale="linear",
            spread=0.1,
        ),
        Parameter("a", "s/m", 1e-3, 1e7, 300.0, "a", "inverse of the speed over which kinetic friction changes"),
    )
    null = {"delta_mu_k": 0.0}

    def terms(self, s: Situation) -> Terms:
        """The weakening; the exponent is clipped so that a solver's trial step backwards stays finite."""
        return Terms(kinetic=-s.p.delta_mu_k * ca.expm1(-ca.fmax(s.p.a * s.v, -1.0)))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """Its change over a slip against the fall from static to kinetic friction."""
        speed = slip_speed(p, normal_force, drive_speed)
        share = abs(p["delta_mu_k"] * math.expm1(-p["a"] * speed)) * normal_force / fall(p, normal_force)
        return Importance("Δμk (1 − exp(−a v))/(μs − μk0)", share, change_in_a_slip(speed, share))


class LinearWeakening(Effect):
    """mu_k(v) = mu_k0 + delta_mu_k a v, the start of eq. (6); one number only, the slope: delta_mu_k a [s/m].

    It knows no floor: where it would make friction negative it has left its range.
    """

    name = "linear_weakening"
    says = "kinetic friction changes in proportion to sliding speed"
    source = "eq. (6), linear form; valid for a v << 1"
    parameters = (
        Parameter(
            "slope",
            "s/m",
            -1e6,
            1e6,
            -1.0,
            "Δμk a",
            "change of the kinetic coefficient per sliding speed",
            "linear",
            1.0,
        ),
    )
    null = {"slope": 0.0}
    role = "velocity law"

    def terms(self, s: Situation) -> Terms:
        """The change."""
        return Terms(kinetic=s.p.slope * s.v)

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """Its change over a slip against the fall from static to kinetic friction."""
        speed = slip_speed(p, normal_force, drive_speed)
        share = abs(p["slope"]) * speed * normal_force / fall(p, normal_force)
        return Importance("Δμk a v/(μs − μk0)", share, change_in_a_slip(speed, share))


class PowerLaw(Effect):
    """mu_k(v) = mu_k0 (v/v_low)^-n above the lowest measured speed v_low, mu_k0 below it (eq. 7, speed).

    Eq. (7) as printed, 0.25 v^-0.37, is a finger on wet smooth glass: n = 0.37 and mu_k0 = 0.25 v_low^-0.37.
    The exponent is from the measurements; the range v_low to v_high, which eq. (7) does not state, is that of the
    defaults: set both to those of the measurements that are used.
    """

    name = "power_law"
    says = "kinetic friction falls as a power of sliding speed (measured: finger on wet smooth glass)"
    source = "eq. (7), 0.25 v^-0.37: index finger on wet smooth glass; Derler and Rotaru, Wear 301 (2013) 324"
    parameters = (
        Parameter("speed_exponent", "", -2.0, 2.0, 0.37, "n", "exponent of sliding speed", "linear", 0.1),
        Parameter("lowest_speed", "m/s", 1e-9, 1.0, 1e-3, "v_low", "lowest speed of the measurements", kind="given"),
        Parameter("highest_speed", "m/s", 1e-9, 1e3, 1.0, "v_high", "highest speed of the measurements", kind="given"),
    )
    null = {"speed_exponent": 0.0}
    role = "velocity law"

    def terms(self, s: Situation) -> Terms:
        """The change from mu_k0; level below the measured range."""
        ratio = ca.fmax(s.v / s.p.lowest_speed, 1.0)
        return Terms(kinetic=s.p.mu_k0 * ca.expm1(-s.p.speed_exponent * ca.log(ratio)))

    def importance(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> Importance:
        """Its change over a slip against the fall from static to kinetic friction."""
        speed = slip_speed(p, normal_force, drive_speed)
        share = (
            abs(p["mu_k0"] * math.expm1(-p["speed_exponent"] * math.log(max(speed / p["lowest_speed"], 1.0))))
            * normal_force
            / fall(p, normal_force)
        )
        return Importance("μk0 (1 − (v/v_low)^−n)/(μs − μk0)", share, change_in_a_slip(speed, share))

    def refusal(self, p: Mapping[str, float], normal_force: float, drive_speed: float) -> str | None:
        """Outside the measured speeds."""
        if p["lowest_speed"] <= abs(drive_speed) <= p["highest_speed"]:
            return None
        return (
            f"power_law was measured from {p['lowest_speed']:g} to {p['highest_speed']:g} m/s "
            f"(a finger on wet smooth glass) and the drive runs at {abs(drive_speed):g} m/s; use velocity_weakening"
        )


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
        return Importance("A/(μs − μk0)", share, f"the direct effect is {100 * share:.3g} % of μs − μk0 per e-fold")
