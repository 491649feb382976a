"""How numbers are said in sentences: with three figures, and written out up to a million."""

from __future__ import annotations

LONG = 1e3, 1e6  # sizes that three figures would be said of with a power of ten, and that are soon read without


def three_figures(value: float) -> str:
    """A number with three figures: 0.298, 1.5e-05, and 1800 where that is as short as 1.8e+03."""
    short = f"{value:.3g}"
    return f"{float(short):.0f}" if LONG[0] <= abs(float(short)) < LONG[1] else short
