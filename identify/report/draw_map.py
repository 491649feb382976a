"""Stability and amplitude over two quantities, a map, and over one, as pictures for one column of a journal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as File

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis as MatplotlibAxis
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from data_io.atomic import atomic_path
from identify.base.wording import number, scale_for
from identify.prediction.axes import Axis
from identify.prediction.maps import NO_ANSWER, NOT_ADMITTED, Boundary, Chart
from identify.prediction.sources import Tested
from identify.prediction.windows import Outcome
from identify.report.report_wording import OUTCOMES
from identify.report.style import ARREST, DPI, FITTED, ONSET, SLIDING, drawing_style

Array = NDArray[np.float64]

SIZE, OVER_ONE = (3.54, 4.3), (3.54, 4.6)  # inch: a journal column is 90 mm wide
STICKS, SLIDES, TESTED = FITTED, SLIDING, "0.25"  # ends of stick-slip and of stable sliding, the tested range
FONT = 7.5
LETTER, LINE = 0.01, 0.03  # half a letter over the width of a map, half a line over its height
NARROW = 30.0  # ratio of the ends of an axis up to which it has numbers between the decades
LEVELS = 6  # of contours
POWERS = 30.0  # ratio of values from which levels and colours are even in powers
COLOURS = dict(zip(OUTCOMES, "#dcebf5 #fbe3d0 #f3eca0 #e3c7d8 #c9cdd2 #ffffff #ffffff".split(), strict=True))


def draw_map(
    chart: Chart,
    path: File,
    part: str = "stability",
    others: Sequence[tuple[float, float]] = (),
    tested: Tested | None = None,
) -> None:
    """Draw a map: regions by outcome with the drop of the force, or ("amplitude") its drop and period; of one quantity
    force levels above, period and slip below, outcomes behind.

    Args:
        others: operating points (x, y) [SI] beside that of the chart; tested: the range that logs cover.

    Raises:
        OSError: the file cannot be written.
    """
    with drawing_style(), atomic_path(path) as temporary:
        figure = _over_one(chart) if chart.plane.shape[0] == 1 else map_figure(chart, part, others, tested)
        figure.savefig(temporary, dpi=DPI)


def _legend(figure: Figure, handles: Sequence[Artist]) -> None:
    figure.legend(
        handles=handles, loc="outside lower center", ncols=2, fontsize=FONT - 1, handlelength=2.0, columnspacing=1.2
    )


def _quantity_axis(axis: MatplotlibAxis, q: Axis, ends: Array) -> None:
    """Label with the unit, and scale of the axis of a quantity, between these ends as shown."""
    unit = scale_for(abs(q.value), q.unit).unit.replace("m^2", "m²")
    axis.set_label_text(f"{q.label} ({unit})" if unit else q.label, fontsize=FONT + 0.5)
    if q.logarithmic:
        _ticks_in_powers(axis, ends[1] < NARROW * ends[0])


def _ticks_in_powers(axis: MatplotlibAxis, narrow: bool) -> None:
    """Plain numbers at the decades, and between them where there are fewer than two."""
    if narrow:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda v, _: number(v, 3)))
    axis.set_minor_formatter(NullFormatter())


@dataclass(frozen=True)
class _Canvas:
    """A map on axes: its values as the axes show them, (n_x,) and (n_y,), and the SI factors (2,) of both units."""

    chart: Chart
    axes: Axes
    x: Array
    y: Array
    factors: Array

    def shown(self, places: Array) -> Array:
        """Points (n, 2) in coordinates of the plane as on the axes."""
        quantities = (self.chart.plane.x, self.chart.plane.y)
        return np.column_stack([q.value_at(c) / f for q, f, c in zip(quantities, self.factors, places.T, strict=True)])

    def region(self, boundary: Boundary) -> Path | None:
        """A region as a path; None of an empty one."""
        loops = [Path(self.shown(np.vstack([loop, loop[:1]])), closed=True) for loop, _ in boundary.loops]
        return Path.make_compound_path(*loops) if loops else None


def map_figure(chart: Chart, part: str, others: Sequence[tuple[float, float]], tested: Tested | None) -> Figure:
    """The figure of `draw_map`, one journal column wide; inside `drawing_style`."""
    quantities = (chart.plane.x, chart.plane.y)
    factors = np.array([scale_for(abs(q.value), q.unit).factor for q in quantities])
    x, y = chart.plane.x_values / factors[0], chart.plane.y_values / factors[1]
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.add_subplot(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
    axes.grid(False)
    axes.tick_params(labelsize=FONT)
    axes.spines[["top", "right"]].set_visible(True)
    axes.set(xscale="log" if quantities[0].logarithmic else "linear")
    axes.set(yscale="log" if quantities[1].logarithmic else "linear")
    _quantity_axis(axes.xaxis, quantities[0], x[[0, -1]])
    _quantity_axis(axes.yaxis, quantities[1], y[[0, -1]])
    canvas = _Canvas(chart, axes, x, y, factors)
    sticks = canvas.region(chart.sticking)
    if part == "amplitude":  # the drop of the force covers the colours of what sticks
        _drop(figure, canvas)
        legend = list[Artist]()
        title = _contours(canvas, sticks, "period", ("white", "0.25"))
    else:
        legend = _regions(canvas, sticks)
        title = _contours(canvas, sticks, "peak_to_valley", ("0.45", "white"))
    for boundary, colour, words in (
        (chart.sticking, STICKS, "end of stick-slip"),
        (chart.unstable, SLIDES, "sliding loses stability"),
    ):
        lines = [axes.plot(*canvas.shown(points).T, color=colour, lw=1.3, zorder=3) for points in boundary.lines()]
        legend += [Line2D([], [], color=colour, lw=1.3, label=words)] if lines else []
    title += "" if tested is None else f"\n{_tested(canvas, tested)}"
    axes.set_title(title.strip(), fontsize=FONT, fontweight="normal", pad=3)
    _legend(figure, legend + _points(canvas, others))
    return figure


def _regions(canvas: _Canvas, sticks: Path | None) -> list[Artist]:
    """Colours by outcome: what sticks, what slides unstably, and where both or neither is so."""
    axes, chart, unstable = canvas.axes, canvas.chart, canvas.region(canvas.chart.unstable)
    whole = Path(np.array([[canvas.x[i], canvas.y[j]] for i, j in ((0, 0), (-1, 0), (-1, -1), (0, -1), (0, 0))]))
    layers = [(whole, Outcome.NEVER_STICKS), (unstable, Outcome.UNDECIDED), (sticks, Outcome.BISTABLE)]
    layers += [(unstable, Outcome.ALWAYS_STICKS)] if sticks is not None else []
    for path, outcome in layers:
        if path is not None:
            patch = axes.add_patch(PathPatch(path, facecolor=COLOURS[outcome.value], edgecolor="none", zorder=0.5))
            if outcome is Outcome.ALWAYS_STICKS and sticks is not None:
                patch.set_clip_path(PathPatch(sticks, transform=axes.transData))
    for word in (Outcome.IRREGULAR.value, NOT_ADMITTED, NO_ANSWER):  # cells of nodes, as they have no outline
        cells = np.ma.masked_where(chart.outcomes != word, np.ones(chart.outcomes.shape))
        if cells.count():
            colour = ListedColormap([COLOURS[word]])
            axes.pcolormesh(canvas.x, canvas.y, cells, shading="nearest", cmap=colour, vmin=0, vmax=1, zorder=0.6)
    seen = [word for word in OUTCOMES if word in chart.outcomes and not _named_inside(canvas, word)]
    return [Patch(facecolor=COLOURS[word], edgecolor="0.5", lw=0.4, label=OUTCOMES[word]) for word in seen]


def _named_inside(canvas: _Canvas, word: str) -> bool:
    """Write the name of an outcome into its region, in one line or one word a line, where that has room for it."""
    colour, text = COLOURS[word], OUTCOMES[word]
    cells = np.pad((canvas.chart.outcomes == word)[1:-1, 1:-1], 1)  # a name may reach the frame, not cross it
    for wrapped in (text, text.replace(" ", "\n")):
        height, width = LINE * (wrapped.count("\n") + 1), LETTER * max(map(len, wrapped.split("\n")))
        room = distance_transform_edt(cells, sampling=1.0 / (np.array(cells.shape) * (height, width)))
        row, column = np.unravel_index(int(np.argmax(room)), room.shape)
        if room[row, column] > 1.0:
            halo = [withStroke(linewidth=2.5, foreground=colour)]
            place = {"x": canvas.x[column], "y": canvas.y[row], "ha": "center", "va": "center"}
            canvas.axes.text(s=wrapped, fontsize=FONT, path_effects=halo, zorder=2.5, **place)
            return True
    return False


def _contours(canvas: _Canvas, inside: Path | None, name: str, colours: tuple[str, str]) -> str:
    """Labelled contours of a quantity of the orbit; what they are, for above the map; colours: of lines, of halos."""
    values = canvas.chart.figures[name]
    if np.sum(np.isfinite(values)) < 4 or inside is None:
        return ""
    unit, words = {"peak_to_valley": ("N", "force, peak to valley"), "period": ("s", "period")}[name]
    scale = scale_for(float(np.nanmedian(values)), unit)
    low, high = float(np.nanmin(values)) / scale.factor, float(np.nanmax(values)) / scale.factor
    steps = (1.0, 2.0, 5.0) if high < 1e4 * low else (1.0,)
    locator = LogLocator(subs=steps, numticks=99) if 0.0 < POWERS * low < high else MaxNLocator(LEVELS)
    levels = np.asarray(locator.tick_values(low, high))
    levels = levels[(levels > low) & (levels < high)]
    if not levels.size:
        return ""
    drawn = (canvas.x, canvas.y, values / scale.factor)
    lines = canvas.axes.contour(*drawn, levels=levels, linewidths=0.6, zorder=2, colors=colours[0])
    lines.set_clip_path(PathPatch(inside, transform=canvas.axes.transData))
    for label in canvas.axes.clabel(lines, fmt=lambda v: number(v, 3), fontsize=FONT - 1.5, inline=False):
        label.set_path_effects([withStroke(linewidth=2.5, foreground=colours[1])])
        label.set_visible(bool(inside.contains_point(label.get_position())))
    return f"lines: {words} ({scale.unit})"


def _drop(figure: Figure, canvas: _Canvas) -> None:
    """The drop of the force as colours."""
    drop = canvas.chart.figures["peak_to_valley"]
    if not np.any(np.isfinite(drop)):
        return
    scale = scale_for(float(np.nanmedian(drop)), "N")
    wide = float(np.nanmax(drop)) > POWERS * float(np.nanquantile(drop, 0.05)) > 0.0
    drawn, norm = (canvas.x, canvas.y, drop / scale.factor), "log" if wide else None
    mesh = canvas.axes.pcolormesh(*drawn, shading="nearest", cmap="cividis", norm=norm, zorder=1)
    mesh.set_rasterized(True)
    bar = figure.colorbar(mesh, ax=canvas.axes, pad=0.02, aspect=30)
    bar.set_label(f"force, peak to valley ({scale.unit})", fontsize=FONT)
    bar.ax.tick_params(labelsize=FONT - 0.5, which="both")
    if wide:
        _ticks_in_powers(bar.ax.yaxis, narrow=False)


def _tested(canvas: _Canvas, tested: Tested) -> str:
    """Draw the frame of the tested range, as what lies outside is most of many a map and stays readable; what it is."""
    plane, spans = canvas.chart.plane, []
    for q, values, factor in zip((plane.x, plane.y), (plane.x_values, plane.y_values), canvas.factors, strict=True):
        low, high = tested.reach(q.name) or (values[0], values[-1])
        if high < values[0] or low > values[-1]:
            return "extrapolated: nothing here was tested"
        spans.append(np.clip([low, high], values[0], values[-1]) / factor)
    (x0, x1), (y0, y1) = spans
    frame = [x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0]
    halo = [withStroke(linewidth=2.0, foreground="white")]
    canvas.axes.plot(*frame, color=TESTED, lw=0.9, ls="-.", zorder=3.2, path_effects=halo)
    return "dash-dotted: tested inside; beyond: extrapolated"


def _points(canvas: _Canvas, points: Sequence[tuple[float, float]]) -> list[Artist]:
    """The operating point, and those of other logs that lie on the map."""
    plane = canvas.chart.plane
    spans = np.array([plane.x_values[[0, -1]], plane.y_values[[0, -1]]])
    margin = 1e-9 * np.ptp(spans, axis=1)  # for the rounding of an edge

    def inside(point: Array) -> bool:
        return bool(np.all((point >= spans[:, 0] - margin) & (point <= spans[:, 1] + margin)))

    here, legend = np.array([plane.x.value, plane.y.value]), list[Artist]()
    rest = [p for p in map(np.array, dict.fromkeys(points)) if inside(p) and not np.allclose(p, here, 1e-9)]
    own = [here] if inside(here) else []
    words = f"operating point{' (o: other logs)' * bool(rest)}" if own else "operating point: beyond this map"
    for at, shape, size, colours in ((rest, "o", 4, "wk"), (own, "*", 9, "kw")):
        shown = np.reshape(at, (-1, 2)) / canvas.factors
        legend += canvas.axes.plot(
            *shown.T, shape, ms=size, mfc=colours[0], mec=colours[1], mew=0.7, label=words, zorder=5
        )
    return legend[1:]


def _over_one(answer: Chart) -> Figure:
    figure = Figure(figsize=OVER_ONE, layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    q, figures = answer.plane.x, answer.figures
    x = answer.plane.x_values / (unit := scale_for(q.value, q.unit).factor)
    sliding = answer.sliding_force[0]
    force = scale_for(float(np.nanmax(sliding)), "N")
    for values, colour, style, words in (
        (figures["onset_force"][0], ONSET, "-", "force at the onset of slip"),
        (figures["arrest_force"][0], ARREST, "-", "force at its end"),
        (sliding, "0.25", "--", "force of steady sliding"),
    ):
        upper.plot(x, values / force.factor, color=colour, ls=style, lw=1.1, label=words)
    upper.set_ylabel(f"force ({force.unit})", fontsize=FONT + 0.5)
    if np.any(np.isfinite(period := figures["period"][0])):
        time = scale_for(float(np.nanmedian(period)), "s")
        lower.plot(x, period / time.factor, color="0.15", lw=1.1, label="period")
        slip = figures["slip_duration"][0] / time.factor
        lower.plot(x, slip, color="0.5", lw=1.1, ls="--", label="of it in slip")
        lower.set_yscale("log")
        bottom, top = lower.get_ylim()
        _ticks_in_powers(lower.yaxis, top < NARROW * bottom)
        lower.set_ylabel(f"time ({time.unit})", fontsize=FONT + 0.5)
        lower.legend(loc="best", fontsize=FONT - 1)
    upper.legend(loc="best", fontsize=FONT - 1)
    curves = len(lower.lines)
    changes = [(value / unit, STICKS, "end of stick-slip") for value, _ in answer.changes(answer.sticking)]
    changes += [(value / unit, SLIDES, "sliding loses stability") for value, _ in answer.changes(answer.unstable)]
    for axes in (upper, lower):
        axes.grid(False)
        axes.tick_params(labelsize=FONT)
        for at, colour, words in changes:
            axes.axvline(at, color=colour, lw=1.0, zorder=1, label=words)
        axes.axvline(q.value / unit, color="k", lw=0.8, ls=":", zorder=1, label="operating point")
        _shade(axes, answer.outcomes[0].tolist(), x, np.array([at for at, *_ in changes]))
        axes.set_xscale("log" if q.logarithmic else "linear")
        axes.set_xlim(x[0], x[-1])
    _quantity_axis(lower.xaxis, q, x[[0, -1]])
    entries, names = lower.get_legend_handles_labels()
    _legend(figure, list(dict(zip(names[curves:], entries[curves:], strict=True)).values()))
    return figure


def _shade(axes: Axes, outcomes: Sequence[str], x: Array, changes: Array) -> None:
    """Colours by outcome, changing half way between two values that differ, or where the change was found."""
    begin = x[0]
    for i, word in enumerate(outcomes):
        if i + 1 < len(outcomes) and outcomes[i + 1] == word:
            continue
        end = x[-1]
        if i + 1 < len(outcomes):
            between = changes[(changes > x[i]) & (changes < x[i + 1])]
            end = between[0] if between.size == 1 else 0.5 * (x[i] + x[i + 1])
        axes.axvspan(begin, end, color=COLOURS[word], lw=0, zorder=0, label=OUTCOMES[word])
        begin = end
