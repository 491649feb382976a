"""How numbers are said in sentences: with three figures, and written out up to a million."""

from __future__ import annotations

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
