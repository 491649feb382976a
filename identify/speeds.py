"""How speeds are said: in mm/s, slow ones in mm/min as on the dial of a tribometer; nowhere in anything else."""

from __future__ import annotations

SLOW = 1e-5  # m/s, below which speeds are said per minute


def speed_scale(speed: float | None) -> tuple[str, float]:
    """The unit in which a speed [m/s] is said, and that unit in m/s."""
    if speed is not None and 0.0 < abs(speed) < SLOW:
        return "mm/min", 1e-3 / 60.0
    return "mm/s", 1e-3
