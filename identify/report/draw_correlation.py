"""Correlation of the estimated parameters as a heat map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from identify.report.quantity_text import DASH, decimals
from identify.report.style import HALF, MEASURED, Drawing
from identify.report.table_csv import Columns

COLOURS = "PuOr"  # diverging, told apart by colour-blind readers


def draw_correlation(names: Sequence[str], matrix: NDArray[np.float64]) -> Drawing:
    """Heat map of the matrix (p, p) with the figures in its cells; NaN cells stay empty."""
    count = len(names)
    size = max(2.6, min(HALF, 1.3 + 0.58 * count))
    figure = Figure(figsize=(HALF, size * 0.86))
    axes = figure.add_axes((0.13, 0.08, 0.74, 0.85))
    image = axes.pcolormesh(
        np.ma.masked_invalid(matrix), cmap=COLOURS, vmin=-1, vmax=1, edgecolors="white", linewidth=1.5
    )
    axes.invert_yaxis()
    axes.set_title("correlation (1)", y=1.0, pad=5)
    middles = np.arange(count) + 0.5
    axes.set_xticks(middles, names)
    axes.set_yticks(middles, names)
    axes.tick_params(length=0)
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    for (row, column), value in np.ndenumerate(matrix):
        text = decimals(float(value), 2) if np.isfinite(value) else DASH
        colour = "white" if np.isfinite(value) and abs(value) > 0.7 else MEASURED
        axes.text(column + 0.5, row + 0.5, text, ha="center", va="center", fontsize=8, color=colour)
    bar = figure.colorbar(image, cax=figure.add_axes((0.89, 0.08, 0.022, 0.85)), ticks=[-1, -0.5, 0, 0.5, 1])
    bar.outline.set_visible(False)
    table: Columns = {"parameter": np.array(names), **{name: matrix[:, i] for i, name in enumerate(names)}}
    return Drawing(
        name="correlation",
        figure=figure,
        alt="Correlation matrix of the estimated parameters: " + _strongest(names, matrix),
        caption=f"Correlation of the estimates; {_strongest(names, matrix)} Near ±1 a combination of the two is known "
        "better than either; how well each is known alone, its interval says.",
        wide=False,
        tables={"correlation": table},
    )


def _strongest(names: Sequence[str], matrix: NDArray[np.float64]) -> str:
    off = np.where(np.eye(len(names), dtype=bool) | ~np.isfinite(matrix), 0.0, matrix)
    if not off.size or not off.any():
        return "no correlation is known."
    row, column = np.unravel_index(int(np.argmax(np.abs(off))), off.shape)
    return f"the strongest is {off[row, column]:.2f}, between {names[int(row)]} and {names[int(column)]}."
