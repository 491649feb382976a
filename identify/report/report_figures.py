"""All figures of a fit: which there are, each drawn once, as SVG; and those of how sure the parameters are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from identify.base.quantiles import LEVEL, chi_square
from identify.base.result import OptimumResult, ParameterResult, ProfileResult, UnevenResult
from identify.base.wording import DASH, decimals, scale_for
from identify.report.figures import draw_cycles, draw_force, draw_measured, draw_slip, draw_uneven
from identify.report.report_wording import plain_symbol, with_group
from identify.report.style import FITTED, HALF, MEASURED, QUIET, SHADE, WIDE, Columns, Drawing, drawing_style, svg_text

if TYPE_CHECKING:
    from identify.report.finished import Fit

DIVERGING = "PuOr"  # told apart by colour-blind readers
PANELS = 3  # profiles in a row
FEWEST = 5  # points that are a curve
TOP = 1.6  # of the limit: the height of a profile


def pictures(fit: Fit) -> Iterator[Drawing]:
    """Every figure of the fit with its SVG, drawn one after the other so that only one is held open."""
    with drawing_style():
        for drawing in _drawings(fit):
            yield replace(drawing, svg=svg_text(drawing.figure), figure=Figure())


def _drawings(fit: Fit) -> Iterator[Drawing]:
    for position, curves in enumerate(fit.logs, start=1):
        if len(curves.time) > 1:
            yield draw_force(curves, position, fit.converged)
        if curves.slip is not None and len(curves.slip.time) > 1:
            yield draw_slip(curves, curves.slip, position, fit.converged)
        if len(curves.cycles):
            yield draw_cycles(curves, position, fit.converged)
    result = fit.typed
    yield from draw_uneven(UnevenResult.of(result))
    if not fit.converged and (measured := draw_measured(fit.logs)) is not None:
        yield measured
    if result.profile and (drawn := draw_profile(result.profile, result.parameters)) is not None:
        yield drawn
    if result.optima and sum(optimum.starts for optimum in result.optima) > 1:
        yield draw_optima(result.optima, chi_square(LEVEL, len(result.optima[0].values)))
    if result.correlation is not None and len(result.correlation.names) > 1:
        names = [with_group(name, result.parameters[name].group) for name in result.correlation.names]
        yield draw_correlation(list(map(plain_symbol, names)), np.array(result.correlation.matrix, dtype=np.float64))


def correlation_cells(axes: Axes, names: Sequence[str], matrix: NDArray[np.float64]) -> QuadMesh:
    """Heat map of a correlation matrix (p, p) on axes, with the figures in its cells; NaN cells stay empty."""
    aslant, middles = max(map(len, names), default=0) > 8, np.arange(len(names)) + 0.5
    shown = np.ma.masked_invalid(matrix)
    image = axes.pcolormesh(shown, cmap=DIVERGING, vmin=-1, vmax=1, edgecolors="white", linewidth=1.5)
    axes.invert_yaxis()
    axes.set_xticks(middles, names, rotation=35 if aslant else 0, ha="right" if aslant else "center")
    axes.set_yticks(middles, names)
    axes.tick_params(length=0)
    axes.grid(False)
    axes.spines[:].set_visible(False)
    for (row, column), value in np.ndenumerate(matrix):
        text = decimals(float(value), 2) if np.isfinite(value) else DASH
        colour = "white" if np.isfinite(value) and abs(value) > 0.7 else MEASURED
        axes.text(column + 0.5, row + 0.5, text, ha="center", va="center", fontsize=8, color=colour)
    return image


def draw_correlation(names: Sequence[str], matrix: NDArray[np.float64]) -> Drawing:
    """Heat map of the matrix (p, p) with the figures in its cells; NaN cells stay empty."""
    count = len(names)
    figure = Figure(figsize=(HALF, 0.86 * max(2.6, min(HALF, 1.3 + 0.58 * count))), layout="constrained")
    axes = figure.add_subplot()
    axes.set_title("correlation (1)")
    image = correlation_cells(axes, names, matrix)
    figure.colorbar(image, ax=axes, ticks=[-1, -0.5, 0, 0.5, 1], aspect=30).outline.set_visible(False)
    off = np.where(np.eye(count, dtype=bool) | ~np.isfinite(matrix), 0.0, matrix)
    strongest = "no correlation is known."
    if off.any():
        row, column = np.unravel_index(int(np.argmax(np.abs(off))), off.shape)
        strongest = f"the strongest is {off[row, column]:.2f}, between {names[int(row)]} and {names[int(column)]}."
    return Drawing(
        name="correlation",
        figure=figure,
        alt=f"Correlation matrix of the estimated parameters: {strongest}",
        caption=f"Correlation of the estimates; {strongest} Near ±1 a combination of the two is known better than "
        "either; how well each is known alone, its interval gives.",
        wide=False,
        tables={"correlation": {"parameter": np.array(names), **{n: matrix[:, i] for i, n in enumerate(names)}}},
    )


def draw_profile(profile: ProfileResult, parameters: Mapping[str, ParameterResult]) -> Drawing | None:
    """One panel per profiled parameter: the loss of the data when it is fixed and the others follow, beside the
    parabola of the covariance; None where no profile has enough points to be a curve."""
    curves = {name: curve for name, curve in profile.parameters.items() if len(curve.values) >= FEWEST}
    if not curves:
        return None
    limit, rows = profile.limit, -(-len(curves) // PANELS)
    figure = Figure(figsize=(WIDE, 0.5 + 1.75 * rows), layout="constrained")
    tables: dict[str, Columns] = {}
    for place, (name, curve) in enumerate(curves.items()):
        axes = figure.add_subplot(rows, PANELS, place + 1)
        entry = parameters.get(name) or ParameterResult(None)
        scale = scale_for(entry.value, entry.unit)
        values, loss = np.array(curve.values, float), np.array(curve.loss, float)
        x = values / scale.factor
        low, high = (None if end is None else end / scale.factor for end in curve.interval)
        axes.axvspan(low if low is not None else x[0], high if high is not None else x[-1], color=SHADE, linewidth=0)
        fine, best = np.linspace(x[0], x[-1], 101), float(x[int(np.argmin(loss))])
        away = np.log(fine / best) if curve.logarithmic else (fine - best) * scale.factor
        parabola = (away / (curve.standard_error or np.nan)) ** 2
        axes.plot(fine, parabola, color=QUIET, linewidth=0.9, linestyle="--", label="from the covariance")
        axes.plot(x, loss, "o-", color=FITTED, markersize=3, label="profile")
        axes.axhline(limit, color=MEASURED, linewidth=0.7)
        axes.set_ylim(0.0, TOP * limit)
        axes.xaxis.set_major_locator(MaxNLocator(4))
        title = plain_symbol(with_group(name, entry.group))
        axes.set_title(f"{title} ({scale.unit})" if scale.unit else title)
        if place % PANELS == 0:
            axes.set_ylabel("loss of the data")
        if place == 0:
            axes.legend(loc="upper center")
        tables[f"profile_{name}"] = {"value": values, "loss": loss}
    return Drawing(
        name="profile",
        figure=figure,
        alt=f"Profile likelihood of {', '.join(curves)}: the loss over each parameter, with the 95 % limit.",
        caption="Profile likelihood: loss of the data, in units of χ², when one parameter is fixed and all others "
        f"follow. Shaded: the 95 % interval, where the loss stays below {limit:.2f}. Dashed: what the covariance "
        "expects.",
        wide=True,
        tables=tables,
    )


def draw_optima(optima: Sequence[OptimumResult], limit: float) -> Drawing:
    """Waterfall: how far each optimum lies above the lowest one, in the order of the starts that led there.

    limit: of the likelihood ratio, below which the data do not rule an optimum out.
    """
    ordered = sorted(optima, key=lambda optimum: optimum.cost)
    rise = np.repeat([o.cost - ordered[0].cost for o in ordered], [o.starts for o in ordered])
    figure = Figure(figsize=(HALF, 2.2), layout="constrained")
    axes = figure.add_subplot(xlabel="start, the best first", ylabel="χ² above the lowest")
    axes.plot(np.arange(1, rise.size + 1), rise, "o-", color=FITTED, markersize=4)
    axes.axhline(limit, color=MEASURED, linewidth=0.7)
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylim(bottom=-0.2)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return Drawing(
        name="optima",
        figure=figure,
        alt=f"Waterfall of {rise.size} starts that led to {len(ordered)} optima.",
        caption="Optima that starts about the answer led to: χ² above the lowest one. Optima below the line are not "
        "ruled out by the data and count in the intervals.",
        wide=False,
        tables={"optima": {"start": np.arange(1.0, rise.size + 1.0), "chi2_above_lowest": rise}},
    )
