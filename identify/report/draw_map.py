"""Stability and amplitude over two quantities, a map, and over one, as pictures for one column of a journal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from data_io.atomic import atomic_path
from identify.base.wording import Scale, number, scale_for
from identify.prediction.axes import Axis
from identify.prediction.maps import NO_ANSWER, NOT_ADMITTED, Boundary, Chart, LineMap
from identify.prediction.sources import Tested
from identify.prediction.windows import Outcome
from identify.report.style import ARREST, ONSET, drawing_style

Array = NDArray[np.float64]

SIZE, OVER_ONE, DPI = (3.54, 4.3), (3.54, 4.6), 300  # inch: a journal column is 90 mm wide
STICKS, SLIDES, TESTED = "#D55E00", "#0072B2", "0.25"  # ends of stick-slip and of stable sliding, the tested range
FONT = 7.5
NARROW = 30.0  # ratio of the ends of an axis up to which it has numbers between the decades
LONGEST_NAME = 26  # letters of a log that the legend has room for
LEVELS = 6  # of contours
POWERS = 30.0  # ratio of values from which levels and colours are even in powers
# outcome: colour, words in the legend
REGIONS = {
    Outcome.NEVER_STICKS.value: ("#dcebf5", "steady sliding"),
    Outcome.ALWAYS_STICKS.value: ("#fbe3d0", "stick-slip"),
    Outcome.BISTABLE.value: ("#f3eca0", "both: depends on the start"),
    Outcome.IRREGULAR.value: ("#e3c7d8", "irregular stick-slip"),
    Outcome.UNDECIDED.value: ("#c9cdd2", "oscillates without rest"),
    NOT_ADMITTED: ("#ffffff", "not possible"),
    NO_ANSWER: ("#ffffff", "no answer"),
}


@dataclass(frozen=True)
class Marks:
    """What is drawn on a map beside the answer: other operating points, (x, y) [SI] each; the tested range; whose the
    operating point is ("log 2 (slow.csv)")."""

    points: Sequence[tuple[float, float]] = ()
    tested: Tested | None = None
    whose: str = ""


def draw_map(chart: Chart, path: File, part: str = "stability", marks: Marks | None = None) -> None:
    """Draw a map: regions by outcome with the fall of the force, or ("amplitude") fall and period as contours.

    Raises:
        OSError: the file cannot be written.
    """
    with drawing_style(), atomic_path(path) as temporary:
        map_figure(chart, part, marks).savefig(temporary, dpi=DPI)


def draw_line(answer: LineMap, path: File, part: str = "stability") -> None:
    """Draw it: force levels above, and growth rate and multiplier ("stability") or period below.

    Raises:
        OSError: the file cannot be written.
    """
    with drawing_style(), atomic_path(path) as temporary:
        line_figure(answer, part).savefig(temporary, dpi=DPI)


def _line(label: str, **look: Any) -> Line2D:
    return Line2D([], [], label=label, **look)


def _legend(figure: Figure, handles: Sequence[Any]) -> None:
    look = {"fontsize": FONT - 1, "handlelength": 2.0, "columnspacing": 1.2}
    figure.legend(handles=list(handles), loc="outside lower center", ncols=2, **look)


def _label(q: Axis, scale: Scale) -> str:
    unit = scale.unit.replace("m^2", "m²")
    return f"{q.label} [{unit}]" if unit else q.label


def _ticks_in_powers(axis: Any, ends: Sequence[float] | Array) -> None:
    """Plain numbers at the decades, and between them where there are fewer than two."""
    if ends[1] < NARROW * ends[0]:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda v, _: number(v, 3)))
    axis.set_minor_formatter(NullFormatter())


# ----------------------------------------------------------------------------------------------------------------------
# Over two quantities.
# ----------------------------------------------------------------------------------------------------------------------


def map_figure(chart: Chart, part: str = "stability", marks: Marks | None = None) -> Figure:
    """The same as a figure; inside `drawing_style`."""
    marks, plane = marks or Marks(), chart.plane
    quantities = (plane.x, plane.y)
    scales = [scale_for(abs(q.value), q.unit) for q in quantities]
    x, y = plane.x_values / scales[0].factor, plane.y_values / scales[1].factor
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.add_subplot(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
    axes.grid(False)
    axes.tick_params(labelsize=FONT)
    axes.spines[["top", "right"]].set_visible(True)
    axes.set_xscale("log" if plane.x.logarithmic else "linear")
    axes.set_yscale("log" if plane.y.logarithmic else "linear")
    for axis, q, scale, ends in zip((axes.xaxis, axes.yaxis), quantities, scales, (x, y), strict=True):
        axis.set_label_text(_label(q, scale), fontsize=FONT + 0.5)
        if q.logarithmic:
            _ticks_in_powers(axis, ends[[0, -1]])

    def shown(places: Array) -> Array:
        """Points (n, 2) in coordinates of the plane as on the axes."""
        columns = zip(quantities, scales, places.T, strict=True)
        return np.column_stack([q.value_at(column) / scale.factor for q, scale, column in columns])

    def region(boundary: Boundary) -> Path | None:
        loops = [shown(np.vstack([loop, loop[:1]])) for loop, _ in boundary.loops]
        codes = [np.r_[Path.MOVETO, np.full(len(p) - 2, Path.LINETO), Path.CLOSEPOLY] for p in loops]
        return Path(np.vstack(loops), np.concatenate(codes)) if loops else None

    sticks = region(chart.sticking)
    if part == "amplitude":  # the fall of the force covers the colours of what sticks
        legend = _amplitudes(figure, axes, chart, x, y)
        legend += _contours(axes, chart, x, y, sticks, "period", "white", "0.25")
    else:
        legend = _regions(axes, chart, x, y, sticks, region(chart.unstable))
        legend += _contours(axes, chart, x, y, sticks, "peak_to_valley", "0.45", "white")
    for boundary, colour, words in (
        (chart.sticking, STICKS, "end of stick-slip"),
        (chart.unstable, SLIDES, "sliding loses stability"),
    ):
        lines = boundary.lines()
        for points in lines:
            axes.plot(*shown(points).T, color=colour, lw=1.3, zorder=3)
        legend += [_line(words, color=colour, lw=1.3)] if lines else []
    factors = np.array([scale.factor for scale in scales])
    if marks.tested is not None:
        legend.append(_tested(axes, chart, marks.tested, factors))
    _legend(figure, legend + _points(axes, chart, marks, factors))
    return figure


def _regions(axes: Axes, chart: Chart, x: Array, y: Array, sticks: Path | None, unstable: Path | None) -> list[Any]:
    """Colours by outcome: what sticks, what slides unstably, and where both or neither is so."""
    corners = np.array([[x[0], y[0]], [x[-1], y[0]], [x[-1], y[-1]], [x[0], y[-1]], [x[0], y[0]]])
    layers = [(Path(corners), Outcome.NEVER_STICKS), (unstable, Outcome.UNDECIDED), (sticks, Outcome.BISTABLE)]
    layers += [(unstable, Outcome.ALWAYS_STICKS)] if sticks is not None else []
    for path, outcome in layers:
        if path is not None:
            patch = axes.add_patch(PathPatch(path, facecolor=REGIONS[outcome.value][0], edgecolor="none", zorder=0.5))
            if outcome is Outcome.ALWAYS_STICKS and sticks is not None:
                patch.set_clip_path(PathPatch(sticks, transform=axes.transData))
    for word in (Outcome.IRREGULAR.value, NOT_ADMITTED, NO_ANSWER):  # cells of nodes, as they have no outline
        here = chart.outcomes == word
        if np.any(here):
            cells = ListedColormap([REGIONS[word][0]])
            shown = np.ma.masked_where(~here, np.ones(here.shape))
            axes.pcolormesh(x, y, shown, shading="nearest", cmap=cells, vmin=0, vmax=1, zorder=0.6)
    there = set(np.unique(chart.outcomes).tolist())
    return [Patch(facecolor=c, edgecolor="0.5", lw=0.4, label=text) for w, (c, text) in REGIONS.items() if w in there]


def _contours(
    axes: Axes, chart: Chart, x: Array, y: Array, inside: Path | None, name: str, colour: str, behind: str
) -> list[Any]:
    """Labelled contours of a quantity of the orbit, and its entry in the legend."""
    values = chart.figures[name]
    if np.sum(np.isfinite(values)) < 4 or inside is None:
        return []
    unit, words = {"peak_to_valley": ("N", "force, peak to valley"), "period": ("s", "period")}[name]
    scale = scale_for(float(np.nanmedian(values)), unit)
    low, high = float(np.nanmin(values)) / scale.factor, float(np.nanmax(values)) / scale.factor
    steps = (1.0, 2.0, 5.0) if high < 1e4 * low else (1.0,)
    locator = LogLocator(subs=steps, numticks=99) if 0.0 < POWERS * low < high else MaxNLocator(LEVELS)
    levels = np.asarray(locator.tick_values(low, high))
    levels = levels[(levels > low) & (levels < high)]
    if not levels.size:
        return []
    lines = axes.contour(x, y, values / scale.factor, levels=levels, linewidths=0.6, zorder=2, colors=colour)
    lines.set_clip_path(PathPatch(inside, transform=axes.transData))
    for label in axes.clabel(lines, fmt=lambda v: number(v, 3), fontsize=FONT - 1.5, inline=False):
        label.set_path_effects([withStroke(linewidth=2.5, foreground=behind)])
        label.set_visible(bool(inside.contains_point(label.get_position())))
    return [_line(f"{words} [{scale.unit}]", color="0.7" if colour == "white" else colour, lw=0.8)]


def _amplitudes(figure: Figure, axes: Axes, chart: Chart, x: Array, y: Array) -> list[Any]:
    """The fall of the force as colours."""
    fall = chart.figures["peak_to_valley"]
    if not np.any(np.isfinite(fall)):
        return []
    scale = scale_for(float(np.nanmedian(fall)), "N")
    wide = float(np.nanmax(fall)) > POWERS * float(np.nanquantile(fall, 0.05)) > 0.0
    norm = "log" if wide else None
    mesh = axes.pcolormesh(x, y, fall / scale.factor, shading="nearest", cmap="cividis", norm=norm, zorder=1)
    mesh.set_rasterized(True)
    bar = figure.colorbar(mesh, ax=axes, pad=0.02, aspect=30)
    bar.set_label(f"force, peak to valley [{scale.unit}]", fontsize=FONT)
    bar.ax.tick_params(labelsize=FONT - 0.5, which="both")
    if wide:
        _ticks_in_powers(bar.ax.yaxis, (1.0, np.inf))
    return []


def _tested(axes: Axes, chart: Chart, tested: Tested, factors: Array) -> Line2D:
    """The frame of the tested range: what lies outside is most of many a map, and stays readable."""
    spans = []
    for q, values, factor in zip(
        (chart.plane.x, chart.plane.y), (chart.plane.x_values, chart.plane.y_values), factors, strict=True
    ):
        low, high = tested.reach(q.name) or (values[0], values[-1])
        if high < values[0] or low > values[-1]:
            return _line("extrapolated: nothing here was tested", ls="")
        spans.append(np.clip([low, high], values[0], values[-1]) / factor)
    (x0, x1), (y0, y1) = spans
    axes.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color=TESTED, lw=0.9, ls="-.", zorder=3.2)
    return _line("tested inside; beyond: extrapolated", color=TESTED, lw=0.9, ls="-.")


def _points(axes: Axes, chart: Chart, marks: Marks, factors: Array) -> list[Any]:
    """The operating point, and those of other logs that lie on the map."""
    spans = np.array([chart.plane.x_values[[0, -1]], chart.plane.y_values[[0, -1]]])
    margin = 1e-9 * np.ptp(spans, axis=1)  # for the rounding of an edge

    def inside(point: Array) -> bool:
        return bool(np.all((point >= spans[:, 0] - margin) & (point <= spans[:, 1] + margin)))

    here = np.array([chart.plane.x.value, chart.plane.y.value])
    name = marks.whose if len(marks.whose) <= LONGEST_NAME else f"{marks.whose[: LONGEST_NAME - 1]}…"
    label = f"operating point of\n{name}" if name else "operating point"  # in one line a long name leaves the page
    if not inside(here):
        label += ":\nbeyond this map" if name else ": beyond this map"
    star: dict[str, Any] = {"marker": "*", "ls": "", "mfc": "k", "mec": "w", "mew": 0.7}
    circle = star | {"marker": "o", "mfc": "w", "mec": "k"}
    legend = [_line(label, ms=8, **star)]
    points = [np.array(p) for p in dict.fromkeys(marks.points)]
    others = [p / factors for p in points if inside(p) and not np.allclose(p, here, rtol=1e-9)]
    if others:
        axes.plot(*np.array(others).T, ms=4, zorder=5, **circle)
        legend.append(_line("other logs", ms=4, **circle))
    if inside(here):
        axes.plot(*(here / factors), ms=9, zorder=6, **star)
    return legend


# ----------------------------------------------------------------------------------------------------------------------
# Over one quantity: forces, timing and what decides about stability.
# ----------------------------------------------------------------------------------------------------------------------


def line_figure(answer: LineMap, part: str = "stability") -> Figure:
    """The same as a figure; inside `drawing_style`."""
    figure = Figure(figsize=OVER_ONE, layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    q, scale = answer.quantity, scale_for(abs(answer.quantity.value), answer.quantity.unit)
    x, figures = answer.values / scale.factor, answer.chart.figures
    force = scale_for(float(np.nanmax(answer.sliding_force)), "N")
    for values, colour, style, words in (
        (figures["onset_force"][0], ONSET, "-", "force at the onset of slip"),
        (figures["arrest_force"][0], ARREST, "-", "force at its end"),
        (answer.sliding_force, "0.25", "--", "force of steady sliding"),
    ):
        upper.plot(x, values / force.factor, color=colour, ls=style, lw=1.1, label=words)
    upper.set_ylabel(f"force [{force.unit}]", fontsize=FONT + 0.5)
    drawn = [upper, lower]
    if part == "stability":
        lower.plot(x, answer.chart.growth[0], color=SLIDES, lw=1.1, label="growth rate (left)")
        lower.axhline(0.0, color=SLIDES, lw=0.6)
        lower.set_ylabel("growth rate of sliding [1/s]", fontsize=FONT + 0.5)
        right = lower.twinx()
        right.plot(x, np.abs(answer.chart.multiplier[0]), color=STICKS, lw=1.1, ls="-.", label="multiplier (right)")
        right.set_ylim(0.0, 1.05)
        right.set_ylabel("largest |multiplier| of stick-slip", fontsize=FONT + 0.5)
        right.spines["right"].set_visible(True)
        drawn.append(right)
    elif np.any(np.isfinite(period := figures["period"][0])):
        time = scale_for(float(np.nanmedian(period)), "s")
        lower.plot(x, period / time.factor, color="0.15", lw=1.1, label="period")
        slip = figures["slip_duration"][0]
        lower.plot(x, slip / time.factor, color="0.5", lw=1.1, ls="--", label="of it in slip")
        lower.set_yscale("log")
        _ticks_in_powers(lower.yaxis, lower.get_ylim())
        lower.set_ylabel(f"time [{time.unit}]", fontsize=FONT + 0.5)
    for axes in drawn:
        axes.grid(False)
        axes.tick_params(labelsize=FONT)
    for axes in (upper, lower):
        changes = [(c, STICKS, "end of stick-slip") for c in answer.ends]
        changes += [(c, SLIDES, "sliding loses stability") for c in answer.losses]
        for change, colour, words in changes:
            axes.axvline(change.value / scale.factor, color=colour, lw=1.0, zorder=1, label=words)
        axes.axvline(q.value / scale.factor, color="k", lw=0.8, ls=":", zorder=1, label="operating point")
        _shade(axes, answer, x, scale.factor)
        axes.set_xscale("log" if q.logarithmic else "linear")
        axes.set_xlim(x[0], x[-1])
    lower.set_xlabel(_label(q, scale), fontsize=FONT + 0.5)
    if q.logarithmic:
        _ticks_in_powers(lower.xaxis, x[[0, -1]])
    entries = {label: handle for axes in drawn for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    _legend(figure, list(entries.values()))
    return figure


def _shade(axes: Axes, answer: LineMap, x: Array, factor: float) -> None:
    """Colours by outcome, changing half way between two values that differ, or where the change was found."""
    found = np.array([change.value for change in (*answer.ends, *answer.losses)]) / factor
    words = answer.chart.outcomes[0]
    starts = [0, *(np.flatnonzero(words[1:] != words[:-1]) + 1).tolist()]
    edges = [x[0]]
    for i in starts[1:]:
        between = found[(found > x[i - 1]) & (found < x[i])]
        edges.append(between[0] if between.size == 1 else 0.5 * (x[i - 1] + x[i]))
    for i, begin, end in zip(starts, edges, [*edges[1:], x[-1]], strict=True):
        colour, text = REGIONS[str(words[i])]
        axes.axvspan(begin, end, color=colour, lw=0, zorder=0, label=text)
