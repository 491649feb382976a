"""The figures of a report: which there are, each drawn once; before a fit, the picture of its start."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from data_io.atomic import atomic_path, atomic_write
from data_io.notebook_figure import NotebookFigure
from identify.base import result as schema
from identify.base.errors import IdentifyError
from identify.base.quantiles import LEVEL, chi_square
from identify.base.result import CYCLE_COLUMNS, LogCurves, ParameterResult
from identify.base.table import visible
from identify.base.wording import DASH, decimals, number, quantity, scale_for
from identify.report import style
from identify.report.report_wording import plain_symbol, with_group
from identify.report.style import Columns, Drawing, extremes, padded

if TYPE_CHECKING:
    from identify.estimation.preview import Preview
    from identify.report.finished import Fit

Array = NDArray[np.float64]

STRETCHES = 480  # of a long log: the lowest and highest of each is drawn
MOST_MARKS, MOST_POINTS = 120, 600
CLOSE = 3  # cycles in a close-up
FEWEST_POINTS = 5  # of a profile that is a curve
MOST_LOGS = 12  # in the picture of a preview
PANELS = {1: 2, 2: 4}  # in a row, by the columns of a paper that they take
TOP = 1.6  # of the limit: the height of a profile
RAW_COLOUR, UNUSED_COLOUR = "#d9b98c", "#f1ede4"
# Figures of a whole fit: the method of `Fit` that draws it, what it shows, and what its reader has to know.
LAWS = {
    "friction_over_speed": (
        "plot_friction",
        "Kinetic coefficient over sliding speed, by eq. (6) with the fitted parameters.",
        "Band: 95 %. Grey: the drive speeds of the logs.",
    ),
    "strength_over_rest": (
        "plot_ageing",
        "Static coefficient over the time at rest before a slip, by eqs. (3) and (5) with the fitted parameters.",
        "Band: 95 %.",
    ),
    "intervals": (
        "plot_parameters",
        "95 % intervals of the parameters as deviations from their values.",
        "Thin: errors of rig and sensors included. Thick: of noise alone, the rig taken as exact. An arrow: the "
        "interval goes on, or is open.",
    ),
    "residual_histogram": (
        "plot_residual_histogram",
        "Residuals of all logs in standard deviations of their noise, as a density.",
        "Line: the normal distribution.",
    ),
    "logs_together": (
        "plot_logs",
        "Measured friction over normal force of all logs, above the distance that the drive has moved.",
        "As far as the shortest log goes.",
    ),
}
OF_EFFECTS = {  # of LAWS, those of an effect with these parameters
    "friction_over_speed": ("velocity_weakening", {"mu_k0", "delta_mu_k", "a"}),
    "strength_over_rest": ("contact_ageing", {"mu_s", "mu_k0", "t_cr"}),
}
DIVERGING = "PuOr"  # distinct to colour-blind readers


def pictures(fit: Fit) -> Iterator[Drawing]:
    """Every figure of the report with its SVG, drawn one after the other so that only one is held open: of LAWS only
    friction and ageing, as the others take their time and are drawn when somebody asks for them."""
    with style.drawing_style():
        for drawing in (draw() for name, draw in available(fit).items() if name not in LAWS or name in style.REPORTED):
            assert drawing.figure is not None
            yield replace(drawing, svg=style.svg_text(drawing.figure), figure=None)


def write_figures(fit: Fit, folder: Path) -> list[Path]:
    """Write every figure at the width of one and of two columns of a paper as SVG, PDF and PNG (300 dpi), and
    captions.txt, into a folder that is made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    files, captions = [], []
    with style.drawing_style():
        for name, draw in available(fit).items():
            for columns in style.WIDTHS:
                drawing = draw(columns=columns)
                assert drawing.figure is not None
                for form in style.FORMS:
                    files.append(folder / f"{name}_{columns}_column.{form}")
                    with atomic_path(files[-1]) as temporary:
                        drawing.figure.savefig(temporary, format=form, dpi=style.DPI)
            captions.append(f"{name}: {drawing.alt} {drawing.caption}".strip())
    with atomic_write(folder / "captions.txt") as handle:
        handle.write("\n\n".join(captions) + "\n")
    return [*files, folder / "captions.txt"]


def available(fit: Fit) -> dict[str, Callable[..., Drawing]]:
    """Every figure of the fit by its name, drawn by a call inside `drawing_style`; `columns=1` or `2`: as wide as so
    many columns of a paper, in place of the width it has in the report."""
    figures: dict[str, Callable[..., Drawing]] = {}
    for position, curves in enumerate(fit.logs, start=1):
        if len(curves.time) > 1:
            figures[f"log_{position}_force"] = partial(draw_force, curves, position, fit.converged)
        if len(curves.cycles):
            figures[f"log_{position}_cycles"] = partial(draw_cycles, curves, position, fit.converged)
    result = fit.typed
    uneven = schema.UnevenResult.of(result)
    for cycles in uneven.uneven_cycles:
        figures[f"log_{cycles.log}_uneven"] = partial(draw_uneven, cycles, uneven.strength_against_rest)
    figures |= {name: partial(draw_law, fit, name, of) for name, of in _laws(fit)}
    if result.profile and any(len(curve.values) >= FEWEST_POINTS for curve in result.profile.parameters.values()):
        figures["profile"] = partial(draw_profiles, result.profile, result.parameters)
    if result.optima and sum(optimum.starts for optimum in result.optima) > 1:
        limit = chi_square(LEVEL, len(result.optima[0].values))
        figures["optima"] = partial(draw_optima, result.optima, limit)
    if result.correlation is not None and len(result.correlation.names) > 1:
        names = [plain_symbol(with_group(name, result.parameters[name].group)) for name in result.correlation.names]
        matrix = np.array(result.correlation.matrix, dtype=np.float64)
        figures["correlation"] = partial(draw_correlation, names, matrix)
    return figures


def _laws(fit: Fit) -> Iterator[tuple[str, dict[str, int]]]:
    """Those of LAWS that a fit has, and of which log: the first that took part and has an operating point. A law with a
    parameter that is not determined has no band and is none of them."""
    result = fit.typed
    if not fit.converged:
        return
    if any(entry.value and any(end is not None for end in entry.ends) for entry in result.parameters.values()):
        yield "intervals", {}
    if any(np.isfinite(curves.fitted_force).any() for curves in fit.logs):
        yield "residual_histogram", {}
    if len(fit.logs) > 1 and all(np.isfinite(curves.drive_speed) for curves in fit.logs):
        yield "logs_together", {}
    known = {e.parameter or name for name, e in result.parameters.items() if e.standard_error or e.verdict == "fixed"}
    for position, log in enumerate(result.logs, 1):
        with suppress(IdentifyError):  # of a log without values, or at whose load a law was not measured
            if log.drive_speed_m_per_s and not log.reason_left_out:
                effects = fit.scene(position).effects
                laws = ((name, of) for name, (of, parameters) in OF_EFFECTS.items() if parameters <= known)
                yield from ((name, {"log": position}) for name, of in laws if of in effects)
                return


def draw_law(fit: Fit, name: str, of: Mapping[str, int], columns: int = 1) -> Drawing:
    """One of LAWS, of a log where it is one of a log."""
    method, alt, caption = LAWS[name]
    figure = Figure(figsize=(style.WIDTHS[columns], style.LAW_HEIGHT), layout="constrained")
    getattr(fit, method)(axes=figure.add_subplot(), **of)
    return Drawing(name, figure, alt, caption, wide=False)


# Measured against fitted force of one log; before a fit, against the trajectory that it starts from.


def draw_force(curves: LogCurves, position: int, accepted: bool, columns: int = 2) -> Drawing:
    """The figure of log number `position` (from 1), in one column its close-up; `accepted`: whether the fit was."""
    fitted = bool(np.isfinite(curves.fitted_force).any())
    figure = NotebookFigure(figsize=(style.WIDTHS[columns], 2.95 if fitted else 2.37), layout="constrained")
    drawn = force_panels(figure, curves, "fitted" if accepted else "last iterate", columns)
    at = f" ({quantity(curves.drive_speed, 'm/s')})" if np.isfinite(curves.drive_speed) else ""
    noise = "; dashed: ± 2 SD of the noise" if fitted and np.isfinite(curves.noise) else ""
    what = "Measured and fitted friction force with residuals" if fitted else "Measured friction force with its cycles"
    raw = "Behind the measured force: as it was read, before it was corrected."
    caption = (
        "" if fitted else "No curve was fitted through this log; the marks are the cycles detected in the data.",
        "" if curves.raw_force is None else raw,
        "The fitted curve is the last iterate of a fit that was not accepted." if fitted and not accepted else "",
    )
    return Drawing(
        name=f"log_{position}_force",
        figure=figure,
        alt=f"{what}, and normal force, of log {position}{at} over time; {len(curves.cycles)} cycles marked{noise}.",
        caption=" ".join(filter(None, caption)),
        tables={f"log_{position}_force{'_closeup' * column}": table for column, table in enumerate(drawn)},
        log=position,
    )


def force_panels(figure: Figure | SubFigure, curves: LogCurves, label: str, columns: int = 2) -> list[Columns]:
    """Force, residuals where there are any, and normal force of a log below each other, in two columns the whole and a
    few cycles close up; returns what they show. label: of the fitted force."""
    near = _close_up(curves.time, curves.cycles[:, 0])
    spans = [near] if near == slice(None) or columns == 1 else [slice(None), near]
    heights = [2.9, 1.25, 0.9] if np.isfinite(curves.fitted_force).any() else [2.9, 0.9]
    rows, ratios = len(heights), [2.1, 1][: len(spans)]
    grid = figure.subplots(rows, len(spans), squeeze=False, sharex="col", height_ratios=heights, width_ratios=ratios)
    signals = {"measured": curves.friction_force, "fitted": curves.fitted_force, "normal": curves.normal_force}
    signals["residual"] = curves.friction_force - curves.fitted_force
    if curves.raw_force is not None:
        signals["raw"] = curves.raw_force
    tables: list[Columns] = []
    for column, part in enumerate(spans):
        shown, time = {name: values[part] for name, values in signals.items()}, curves.time[part]
        title = ("whole log", "close-up")[column] if len(spans) > 1 else ""
        _force_column(list(grid[:, column]), curves, time, shown, label, title, first=not column)
        kept = np.unique(np.concatenate([extremes(shown[name], STRETCHES) for name in ("measured", "residual")]))
        drawn = {f"{n}_N": v[kept] for n, v in shown.items() if np.isfinite(v).any()}
        tables.append({"time_s": time[kept], **drawn})
    return tables


def _close_up(time: Array, onsets: Array) -> slice:
    """Samples of a few cycles in the middle; all where the whole log shows as much."""
    if len(onsets) < 2 * CLOSE:
        return slice(None)
    middle, half = onsets[len(onsets) // 2], 0.5 * CLOSE * float(np.median(np.diff(onsets)))
    start, stop = np.searchsorted(time, [middle - half, middle + half]).tolist()
    return slice(start, stop) if 8 <= stop - start < len(time) else slice(None)


def _line(axes: Axes, time: Array, values: Array, colour: str, width: float, label: str = "") -> None:
    kept = extremes(values, STRETCHES)
    axes.plot(time[kept], values[kept], color=colour, linewidth=width, label=label)


def _force_column(
    axes: Sequence[Axes],
    curves: LogCurves,
    time: Array,
    shown: Mapping[str, Array],
    label: str,
    title: str,
    first: bool,
) -> None:
    """Force, residuals where there are any, and normal force of the whole or a part of a log, below each other; the
    first such column has labels and legend."""
    force, normal, fitted = axes[0], axes[-1], len(axes) == 3
    low, high = float(time[0]), float(time[-1])
    if "raw" in shown:
        _line(force, time, shown["raw"], RAW_COLOUR, 0.8, "as read")
    colour, width = (style.BEHIND, 2.4) if fitted else (style.MEASURED, 0.9)
    _line(force, time, shown["measured"], colour, width, "measured")
    if fitted:
        _line(force, time, shown["fitted"], style.FITTED, 0.9, label)
        residual, noise = 1e3 * shown["residual"], 1e3 * curves.noise if np.isfinite(curves.noise) else 0.0
        _line(axes[1], time, residual, style.RESIDUAL, 0.6)
        for level in (-2 * noise, 2 * noise) if noise else ():
            axes[1].axhline(level, color=style.MEASURED, linewidth=0.9, linestyle=(0, (4, 2)), zorder=3)
        limit = 1.1 * max(float(np.nanmax(np.abs(residual), initial=0.0)), 3 * noise, 1e-9)
        axes[1].set_ylim(-limit, limit)
    _line(normal, time, shown["normal"], style.QUIET, 0.6)
    levels = [shown[name] for name in ("measured", "raw") if name in shown]
    padded(force, np.concatenate(levels), above=0.16 if len(levels) == 1 else 0.26)
    padded(normal, shown["normal"], 0.3)
    for column, marker, colour, event in ((0, "v", style.ONSET, "onset"), (1, "^", style.ARREST, "arrest")):
        when, force_then = curves.cycles[:, column], curves.cycles[:, column + 2]
        inside = np.flatnonzero((when >= low) & (when <= high) & np.isfinite(force_then))
        if len(inside):  # too many for the picture: an even choice with every extreme
            kept = inside[extremes(force_then[inside], MOST_MARKS // 2)]
            marks = force.plot(when[kept], force_then[kept], marker, color=colour, markersize=4.2, label=event)
            marks[0].set(markeredgecolor="white", markeredgewidth=0.4)
    force.set_title(title)
    normal.set_xlabel("time (s)")
    if first:
        for panel, text in zip(axes, ("friction force (N)", *["residual\n(mN)"] * fitted, "Fₙ (N)"), strict=True):
            panel.set_ylabel(text)
        normal.figure.align_ylabels()
        force.legend(loc="upper right", ncols=5)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], curves.used, [True]]).astype(np.int8))).reshape(-1, 2)
    for panel, bins in zip(axes, (6, 4, 3) if fitted else (6, 3), strict=True):
        panel.set_xlim(low, high)
        panel.locator_params(axis="x", nbins=8 if title == "whole log" else 5)
        panel.locator_params(axis="y", nbins=bins)
        for first, last in edges if curves.used.any() else ():  # what does not count in the fit
            begin, end = max(curves.time[first], low), min(curves.time[min(last, len(curves.time) - 1)], high)
            if end - begin > 0.01 * (high - low):
                panel.axvspan(begin, end, color=UNUSED_COLOUR, linewidth=0, zorder=0)


def draw_preview(preview: Preview) -> Figure:
    """Every log with its detected cycles and the start trajectory, as in the report; at most 12 logs."""
    logs = preview.logs[:MOST_LOGS]
    figure = Figure(figsize=(style.WIDTHS[2], 0.3 + 2.8 * len(logs)), layout="constrained")
    source = f"Nothing is fitted yet. The start: {preview.source}."
    figure.suptitle(source, fontsize=8, weight="bold", x=0.008, ha="left")
    for part, log in zip(figure.subfigures(len(logs), squeeze=False)[:, 0], logs, strict=True):
        force_panels(part, log.curves, "start trajectory")
        name, speed = visible(log.curves.name, 60), quantity(log.curves.drive_speed, "m/s")
        part.suptitle(f"{name} · {speed} · {log.text}", fontsize=7.5, x=0.008, ha="left")
    return figure


# How the cycles scatter: of one log, and of uneven records.


def draw_cycles(curves: LogCurves, position: int, accepted: bool = True, columns: int = 2) -> Drawing:
    """Onset force, drop, period and misfit by cycle of log number `position` (from 1); it has at least one cycle.

    Args:
        accepted: the cycles are those of the fitted motion, where there is one, else as they were measured.
    """
    onset, _, peak, valley, misfit = curves.cycles.T
    count, scored, period = len(onset), bool(np.isfinite(misfit).any()), np.append(np.diff(onset), np.nan)
    panels = [(peak, "N", "onset", style.ONSET), (peak - valley, "N", "drop", style.ARREST)]
    panels += [(period, "s", "period", style.SLIDING), (misfit, "", "misfit z", style.FITTED)]
    panels = [panel for panel in panels if np.isfinite(panel[0]).any()]
    rows, width = -(-len(panels) // PANELS[columns]), style.WIDTHS[columns]
    across = -(-len(panels) // rows)
    figure = Figure(figsize=(width, 1.5 * rows))
    edges = {"left": 0.36 / width, "right": 1 - 0.06 / width, "top": 1 - 0.13 / rows, "bottom": 0.24 / rows}
    figure.subplots_adjust(**edges, hspace=0.42, wspace=0.45 * across / (width - 0.4 * across))
    for place, (values, unit, name, colour) in enumerate(panels, 1):
        axes, finite = figure.add_subplot(rows, across, place), values[np.isfinite(values)]
        scale = scale_for(float(np.median(finite)), unit)
        mean, spread = finite.mean() / scale.factor, finite.std(ddof=min(1, len(finite) - 1)) / scale.factor
        kept = extremes(values, MOST_POINTS // 2)
        axes.set_xlim(0, count + 1)
        axes.axhline(mean if unit else 0.0, color=style.QUIET, linewidth=0.8)
        axes.plot(kept + 1, values[kept] / scale.factor, "o", color=colour, markersize=2.6, alpha=0.9)
        least = 0.02 * abs(mean) if unit else 0.0  # scatter far below the level is shown as small, not blown up
        reach = max(least, spread), finite.min() / scale.factor, finite.max() / scale.factor
        padded(axes, np.array([mean - reach[0], mean + reach[0], *reach[1:]]))
        if unit:
            axes.axhspan(mean - spread, mean + spread, color=style.SHADE, linewidth=0)
        axes.set_title(f"{name} ({scale.unit})" if scale.unit else name)
        if place > len(panels) - across:
            axes.set_xlabel("cycle")
        if unit and mean:
            note = f"SD {number(100 * spread / abs(mean), 2)} %"
            axes.set_title(note, loc="right", fontweight="normal", color=style.QUIET)
        axes.locator_params(axis="y", nbins=4)
        axes.locator_params(axis="x", nbins=6, integer=True)
    what = "of the motion as fitted" if accepted and scored else "as measured"
    score = " Misfit z: distance of a cycle's residual from pure noise, in its standard deviations." if scored else ""
    table = dict(zip(CYCLE_COLUMNS, curves.cycles.T, strict=True)) | {"drop_N": peak - valley, "period_s": period}
    return Drawing(
        name=f"log_{position}_cycles",
        figure=figure,
        alt=f"Onset force, drop, period and misfit of each of the {count} cycles of log {position}.",
        caption=f"Scatter from cycle to cycle {what}; line and band: mean ± SD. Scatter or a trend far above the noise "
        f"means that the friction itself changed.{score}",
        tables={f"log_{position}_cycles": {"cycle": np.arange(1, count + 1), **table}},
        log=position,
    )


def draw_uneven(cycles: schema.UnevenCycles, curve: schema.StrengthCurve | None, columns: int = 2) -> Drawing:
    """A log that the estimator of uneven records took: onsets and the slow level along the record, and strength against
    rest."""
    names = ("cycle", "onset_s", "rest_s", "onset", "drop", "strength", "level")
    column = {name: np.array(getattr(cycles, name), dtype=np.float64) for name in names}
    time, onset, lowest = column["onset_s"], column["onset"], column["onset"] - column["drop"]
    figure = Figure(figsize=(style.WIDTHS[columns], 2.2 if columns == 2 else 4.2), layout="constrained")
    along, against = figure.subplots(3 - columns, columns, width_ratios=(1.9, 1.0)[:columns])
    along.vlines(time, lowest, onset, color=style.BEHIND, linewidth=0.8)
    along.plot(time, onset, "o", color=style.ONSET, markersize=3.4, label="onset")
    along.plot(time, lowest, "o", color=style.ARREST, markersize=2.6, label="arrest")
    along.plot(time, column["level"], color=style.FITTED, linewidth=1.1, label="slow level")
    padded(along, np.append(onset, lowest), above=0.12)
    along.legend(loc="upper left", ncols=3)
    along.set(xlabel="time (s)", ylabel="friction / normal force")
    if curve is not None:
        against.fill_between(curve.rest_s, curve.lower, curve.upper, color=style.SHADE, linewidth=0)
        against.plot(curve.rest_s, curve.strength, color=style.FITTED, label="usual strength")
        against.legend(loc="lower left")
    against.plot(column["rest_s"], column["strength"], "o", color=style.ONSET, markersize=3.2)
    against.margins(y=0.12)
    against.set_ylim(bottom=0.0)
    against.set_xlim(left=0.0)
    against.set(xlabel="rest before the slip (s)", ylabel="strength / normal force")
    return Drawing(
        name=f"log_{cycles.log}_uneven",
        figure=figure,
        alt=f"Onsets, arrests and slow level of the {time.size} cycles of log {cycles.log}, and their strengths "
        "against the rest before them.",
        caption="Left: friction over the load at onsets and arrests, and the slow level that the cycles follow. Right: "
        "strength of every stick (onset above the slow level) against its rest; line: usual strength with its 95 % "
        "band. A stick is long because the spot was "
        "strong, so the points rise more steeply than the line.",
        tables={f"log_{cycles.log}_uneven": column},
        log=cycles.log,
    )


# How sure the parameters are: correlation, profiles, optima.


def correlation_cells(axes: Axes, names: Sequence[str], matrix: Array) -> QuadMesh:
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
        luminance = np.dot(np.power(image.to_rgba(np.array([value]))[0, :3], 2.2), (0.2126, 0.7152, 0.0722))
        colour = "white" if np.isfinite(value) and luminance < 0.18 else "black"
        axes.text(column + 0.5, row + 0.5, text, ha="center", va="center", fontsize=7, color=colour)
    return image


def draw_correlation(names: Sequence[str], matrix: Array, columns: int = 1) -> Drawing:
    """Heat map of the matrix (p, p) with the figures in its cells; NaN cells stay empty."""
    count = len(names)
    width = style.WIDTHS[columns]
    figure = Figure(figsize=(width, min(0.86 * width, 1.0 + 0.34 * columns * count)), layout="constrained")
    axes = figure.add_subplot()
    image = correlation_cells(axes, names, matrix)
    figure.colorbar(image, ax=axes, ticks=[-1, -0.5, 0, 0.5, 1], aspect=30).outline.set_visible(False)
    off = np.where(np.eye(count, dtype=bool) | ~np.isfinite(matrix), 0.0, matrix)
    row, column = np.unravel_index(int(np.argmax(np.abs(off))), off.shape)
    strongest = f"the strongest is {decimals(off[row, column], 2)}, between {names[int(row)]} and {names[int(column)]}."
    return Drawing(
        name="correlation",
        figure=figure,
        alt=f"Correlation matrix of the estimated parameters: {strongest}",
        caption="Near ±1 a combination of the two is known better than "
        "either; how well each is known alone, its interval gives.",
        wide=False,
        tables={"correlation": {"parameter": np.array(names), **{n: matrix[:, i] for i, n in enumerate(names)}}},
    )


def profile_curve(axes: Axes, curve: schema.ProfileCurve, entry: ParameterResult, limit: float) -> str:
    """Draw the loss of the data when one parameter is fixed and the others follow, beside the parabola of the
    covariance, the interval shaded; returns the unit of the axis."""
    scale = scale_for(entry.value, entry.unit)
    x, loss = np.array(curve.values, float) / scale.factor, np.array(curve.loss, float)
    low, high = (None if end is None else end / scale.factor for end in curve.interval)
    axes.axvspan(low if low is not None else x[0], high if high is not None else x[-1], color=style.SHADE, linewidth=0)
    fine, best = np.linspace(x[0], x[-1], 101), float(x[int(np.argmin(loss))])
    away = np.log(fine / best) if curve.logarithmic else (fine - best) * scale.factor
    parabola = (away / (curve.standard_error or np.nan)) ** 2
    axes.plot(fine, parabola, color=style.QUIET, linewidth=0.9, linestyle="--")
    axes.plot(x, loss, "o-", color=style.FITTED, markersize=2.4)
    axes.axhline(limit, color=style.MEASURED, linewidth=0.7)
    axes.set_ylim(0.0, TOP * limit)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    return f" ({scale.unit})" if scale.unit else ""


def draw_profiles(
    profile: schema.ProfileResult, parameters: Mapping[str, ParameterResult], columns: int = 2
) -> Drawing:
    """One panel per profile that has enough points to be a curve, of which there must be one."""
    curves = {name: curve for name, curve in profile.parameters.items() if len(curve.values) >= FEWEST_POINTS}
    panels = min(PANELS[columns], -(-len(curves) // -(-len(curves) // PANELS[columns])))
    rows = -(-len(curves) // panels)
    figure = Figure(figsize=(style.WIDTHS[columns], 0.3 + 1.5 * rows), layout="constrained")
    tables: dict[str, Columns] = {}
    for place, (name, curve) in enumerate(curves.items()):
        axes, entry = figure.add_subplot(rows, panels, place + 1), parameters.get(name) or ParameterResult(None)
        unit = profile_curve(axes, curve, entry, profile.limit)
        axes.set_title(f"{plain_symbol(with_group(name, entry.group))}{unit}")
        axes.xaxis.set_major_locator(MaxNLocator(columns + 1))
        if place % panels == 0:
            axes.set_ylabel("loss of the data")
        tables[f"profile_{name}"] = {"value": np.array(curve.values, float), "loss": np.array(curve.loss, float)}
    return Drawing(
        name="profile",
        figure=figure,
        alt=f"Profile likelihood of {', '.join(map(plain_symbol, curves))}: the loss over each, with the 95 % limit.",
        caption="Profile likelihood: loss of the data, in units of χ², when one parameter is fixed and all others "
        f"follow. Shaded: the 95 % interval, where the loss stays below {profile.limit:.2f}. Dashed: what the "
        "covariance expects.",
        tables=tables,
    )


def draw_optima(optima: Sequence[schema.OptimumResult], limit: float, columns: int = 1) -> Drawing:
    """Waterfall: how far each optimum lies above the lowest one, in the order of the starts that led there.

    limit: of the likelihood ratio, below which the data do not rule an optimum out.
    """
    ordered = sorted(optima, key=lambda optimum: optimum.cost)
    rise = np.repeat([o.cost - ordered[0].cost for o in ordered], [o.starts for o in ordered])
    starts = np.arange(1.0, rise.size + 1.0)
    figure = Figure(figsize=(style.WIDTHS[columns], style.LAW_HEIGHT), layout="constrained")
    axes = figure.add_subplot(xlabel="start, the best first", ylabel="χ² above the lowest")
    axes.plot(starts, rise, "o-", color=style.FITTED, markersize=4)
    axes.axhline(limit, color=style.MEASURED, linewidth=0.7)
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
        tables={"optima": {"start": starts, "chi2_above_lowest": rise}},
    )
