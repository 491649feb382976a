"""How numbers are said in sentences: with three figures, and written out up to a million."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

LONG = 1e3, 1e6  # sizes that three figures would be said of with a power of ten, and that are soon read without


def three_figures(value: float) -> str:
    """A number with three figures: 0.298, 1.5e-05, and 1800 where that is as short as 1.8e+03."""
    short = f"{value:.3g}"
    return f"{float(short):.0f}" if LONG[0] <= abs(float(short)) < LONG[1] else short


def told_apart(value: float, other: float) -> tuple[str, str]:
    """Two numbers with three figures, or with as many as it takes to tell them apart (eight at most)."""
    if three_figures(value) != three_figures(other):
        return three_figures(value), three_figures(other)
    pairs = ((f"{value:.{n}g}", f"{other:.{n}g}") for n in range(4, 9))
    return next((pair for pair in pairs if pair[0] != pair[1]), (three_figures(value), three_figures(other)))


# ----------------------------------------------------------------------------------------------------------------------
# Text for a terminal of 80 columns.
# ----------------------------------------------------------------------------------------------------------------------

WIDTH = 79
START_VALUES = "give start values nearer to the pair under [parameters], such as mu_s = { start = 0.6 }"


def columns(rows: Sequence[Sequence[str]], indent: str = "  ") -> str:
    """Rows of cells as aligned text, two blanks apart, one where that does not fit; the first row is the heading."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    gap = "  " if len(indent) + sum(widths) + 2 * (len(widths) - 1) <= WIDTH else " "
    lines = (indent + gap.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)
    return "\n".join(line.rstrip() for line in lines)


def wrapped(text: str, indent: str = "", hang: str = "  ") -> str:
    """Text broken at 79 columns; lines after the first hang further in."""
    return textwrap.fill(text, WIDTH, initial_indent=indent, subsequent_indent=indent + hang)


# ----------------------------------------------------------------------------------------------------------------------
# How speeds are said: in mm/s, slow ones in mm/min as on the dial of a tribometer; nowhere in anything else.
# ----------------------------------------------------------------------------------------------------------------------

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
