"""How speeds are said: in mm/s, slow ones in mm/min as on the dial of a tribometer; nowhere in anything else."""

from __future__ import annotations

from collections.abc import Sequence

SLOW = 1e-5  # m/s, below which speeds are said per minute
LISTED = 8  # steps of a programme that are said one by one


def speed_scale(speed: float | None) -> tuple[str, float]:
    """The unit in which a speed [m/s] is said, and that unit in m/s."""
    if speed is not None and 0.0 < abs(speed) < SLOW:
        return "mm/min", 1e-3 / 60.0
    return "mm/s", 1e-3


def speed_text(speed: float, figures: int = 4) -> str:
    """A speed [m/s] as it stands on the dial: "0.1 mm/min", "5 mm/s"."""
    unit, size = speed_scale(speed)
    return f"{speed / size:.{figures}g} {unit}"


def programme_text(programme: Sequence[tuple[float, float]]) -> str:
    """A programme of (start [s], speed [m/s]) in words, the range of its speeds where it has many steps."""
    if len(programme) <= LISTED:
        first, *later = programme
        return ", ".join([speed_text(first[1]), *(f"from {start:.6g} s {speed_text(speed)}" for start, speed in later)])
    speeds = [speed for _, speed in programme]
    return f"{speed_text(min(speeds))} to {speed_text(max(speeds))} in {len(programme)} steps"
