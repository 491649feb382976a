"""Typical numbers of a slip and of a stick, from the numbers of a scene alone: undamped, for orders of magnitude."""

from __future__ import annotations

import math
from collections.abc import Mapping

from identify.base.wording import three_figures

TINY = 1e-300


def fall(p: Mapping[str, float], normal_force: float) -> float:
    """Fall of the friction force from static to kinetic [N], positive."""
    return max(abs(p["mu_s"] - p["mu_k0"]) * normal_force, TINY)


def stick_time(p: Mapping[str, float], normal_force: float, drive_speed: float) -> float:
    """How long the drive takes to load the spring by a drop of twice the fall [s]."""
    return 2 * fall(p, normal_force) / (p["stiffness"] * max(abs(drive_speed), TINY))


def slip_time(p: Mapping[str, float], normal_force: float, drive_speed: float) -> float:
    """Half a natural period [s]; a rig without mass has none, its time is that of a stick."""
    mass = p.get("mass", 0.0)
    return math.pi * math.sqrt(mass / p["stiffness"]) if mass else stick_time(p, normal_force, drive_speed)


def slip_speed(p: Mapping[str, float], normal_force: float, drive_speed: float) -> float:
    """Highest speed of a slip [m/s]; a rig without mass slides at the speed of the drive."""
    mass = p.get("mass", 0.0)
    swing = fall(p, normal_force) / math.sqrt(mass * p["stiffness"]) if mass else 0.0
    return abs(drive_speed) + swing


def lost_per_period(damping_ratio: float) -> float:
    """Share of its amplitude that a free swing loses in one period."""
    if damping_ratio >= 1.0:
        return 1.0
    return -math.expm1(-2 * math.pi * damping_ratio / math.sqrt(1 - damping_ratio**2))


def change_in_a_slip(speed: float, share: float) -> str:
    """How much kinetic friction changes up to the highest speed of a slip [m/s], as a share of the fall, in words."""
    return (
        f"up to about {three_figures(1e3 * speed)} mm/s in a slip kinetic friction changes by "
        f"{three_figures(100 * share)} % of the fall"
    )
