"""How sure the parameters are, drawn: their correlation, the profile of each beside its parabola, and all optima."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from identify.base.result import OptimumResult, ParameterResult, ProfileResult
from identify.base.wording import DASH, decimals, scale_for
from identify.report.report_wording import plain_symbol, with_group
from identify.report.style import FITTED, HALF, MEASURED, QUIET, SHADE, WIDE, Columns, Drawing

COLOURS = "PuOr"  # diverging, told apart by colour-blind readers


def draw_correlation(names: Sequence[str], matrix: NDArray[np.float64]) -> Drawing:
    """Heat map of the matrix (p, p) with the figures in its cells; NaN cells stay empty."""
    count = len(names)
    size = max(2.6, min(HALF, 1.3 + 0.58 * count))
    figure = Figure(figsize=(HALF, size * 0.86))
    longest = max((len(name) for name in names), default=0)
    beside = 0.13 + 0.012 * max(longest - 8, 0)  # long names stand aslant, and need a wider margin
    axes = figure.add_axes((beside, beside - 0.05, 0.87 - beside, 0.98 - beside))
    image = axes.pcolormesh(
        np.ma.masked_invalid(matrix), cmap=COLOURS, vmin=-1, vmax=1, edgecolors="white", linewidth=1.5
    )
    axes.invert_yaxis()
    axes.set_title("correlation (1)", y=1.0, pad=5)
    middles = np.arange(count) + 0.5
    axes.set_xticks(middles, names, rotation=35 if longest > 8 else 0, ha="right" if longest > 8 else "center")
    axes.set_yticks(middles, names)
    axes.tick_params(length=0)
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    for (row, column), value in np.ndenumerate(matrix):
        text = decimals(float(value), 2) if np.isfinite(value) else DASH
        colour = "white" if np.isfinite(value) and abs(value) > 0.7 else MEASURED
        axes.text(column + 0.5, row + 0.5, text, ha="center", va="center", fontsize=8, color=colour)
    bar = figure.colorbar(
        image, cax=figure.add_axes((0.89, beside - 0.05, 0.022, 0.98 - beside)), ticks=[-1, -0.5, 0, 0.5, 1]
    )
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


# ----------------------------------------------------------------------------------------------------------------------
# Profiles of the parameters: what the data lose when one is held and the others follow, beside the parabola.
# ----------------------------------------------------------------------------------------------------------------------

PANELS = 3  # in a row
TICKS = 4
FEWEST = 5  # points that are a curve
TOP = 1.6  # of the limit: the height of a panel


def draw_profile(profile: ProfileResult, parameters: Mapping[str, ParameterResult]) -> Drawing | None:
    """One panel per profiled parameter; None where no profile has enough points to be a curve."""
    curves = {name: curve for name, curve in profile.parameters.items() if len(curve.values) >= FEWEST}
    if not curves:
        return None
    limit, rows = profile.limit, -(-len(curves) // PANELS)
    height = 0.5 + 1.75 * rows
    figure = Figure(figsize=(WIDE, height))
    grid = figure.add_gridspec(
        rows, PANELS, left=0.055, right=0.97, top=1 - 0.3 / height, bottom=0.45 / height, hspace=0.62, wspace=0.2
    )
    tables: dict[str, Columns] = {}
    for number, (name, curve) in enumerate(curves.items()):
        axes = figure.add_subplot(grid[number // PANELS, number % PANELS])
        entry = parameters.get(name) or ParameterResult(None)
        scale = scale_for(entry.value, entry.unit)
        x, loss = np.array(curve.values, float) / scale.factor, np.array(curve.loss, float)
        best = float(x[int(np.argmin(loss))])
        low, high = (None if end is None else end / scale.factor for end in curve.interval)
        axes.axvspan(low if low is not None else x[0], high if high is not None else x[-1], color=SHADE, linewidth=0)
        fine = np.linspace(x[0], x[-1], 101)
        away = np.log(fine / best) if curve.logarithmic else (fine - best) * scale.factor
        axes.plot(
            fine,
            (away / (curve.standard_error or np.nan)) ** 2,
            color=QUIET,
            linewidth=0.9,
            linestyle="--",
            label="from the covariance",
        )
        axes.plot(x, loss, "o-", color=FITTED, markersize=3, label="profile")
        axes.axhline(limit, color=MEASURED, linewidth=0.7)
        axes.set_ylim(0.0, TOP * limit)
        axes.xaxis.set_major_locator(MaxNLocator(TICKS))
        title = plain_symbol(with_group(name, entry.group))
        axes.set_title(f"{title} [{scale.unit}]" if scale.unit else title)
        if number % PANELS == 0:
            axes.set_ylabel("what the data lose")
        if number == 0:
            axes.legend(loc="upper center")
        tables[f"profile_{name}"] = {"value": np.array(curve.values, float), "loss": loss}
    return Drawing(
        name="profile",
        figure=figure,
        alt=f"Profile likelihood of {', '.join(curves)}: the loss over each parameter, with the 95 % limit.",
        caption=(
            "Profile likelihood: loss of the data, in units of χ², when one parameter is held and all others follow. "
            f"Shaded: the 95 % interval, where the loss stays below {limit:.2f}. Dashed: what the covariance expects."
        ),
        wide=True,
        tables=tables,
    )


def draw_optima(optima: Sequence[OptimumResult], limit: float) -> Drawing:
    """Waterfall: how far each optimum lies above the lowest one, in the order of the starts that led there.

    limit: of the likelihood ratio, below which the data do not rule an optimum out.
    """
    ordered = sorted(optima, key=lambda optimum: optimum.cost)
    starts = np.array([optimum.starts for optimum in ordered])
    rise = np.repeat([optimum.cost - ordered[0].cost for optimum in ordered], starts)
    figure = Figure(figsize=(HALF, 2.2))
    axes = figure.add_axes((0.14, 0.2, 0.83, 0.7))
    axes.plot(np.arange(1, rise.size + 1), rise, "o-", color=FITTED, markersize=4)
    axes.axhline(limit, color=MEASURED, linewidth=0.7)
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylim(bottom=-0.2)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("start, the best first")
    axes.set_ylabel("χ² above the lowest")
    return Drawing(
        name="optima",
        figure=figure,
        alt=f"Waterfall of {rise.size} starts that led to {len(ordered)} optima.",
        caption=(
            "Optima that starts about the answer led to: χ² above the lowest one. Optima below the line are not ruled "
            "out by the data and count in the intervals."
        ),
        wide=False,
        tables={"optima": {"start": np.arange(1.0, rise.size + 1.0), "chi2_above_lowest": rise}},
    )
