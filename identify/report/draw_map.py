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
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from data_io.atomic import atomic_path
from identify.base.wording import Scale, number, scale_for
from identify.prediction.axes import Axis, quantity_of
from identify.prediction.draws import Draws
from identify.prediction.maps import NO_ANSWER, NOT_ADMITTED, Boundary, Chart, LineMap
from identify.prediction.sources import Tested
from identify.prediction.windows import Outcome
from identify.report.style import ARREST, ONSET, drawing_style

Array = NDArray[np.float64]

SIZE, OVER_ONE, DPI = (3.54, 4.3), (3.54, 4.6), 300  # inch: a journal column is 90 mm wide
STICKS, SLIDES = "#D55E00", "#0072B2"  # ends of stick-slip and of stable sliding
TESTED = "0.25"
FONT = 7.5
NARROW = 30.0  # ratio of the ends of an axis up to which it has numbers between the decades
LONGEST_NAME = 26  # letters of a log that the legend has room for
LEVELS = 6  # of contours
POWERS = 30.0  # ratio of values from which levels are even in powers
WIDE = 20.0  # ratio of falls from which their colours are even in powers
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
    """What is drawn on a map beside the answer: other operating points, (x, y) [SI] each; draws of what is known of
    pair and rig; the tested range; whose the operating point is ("log 2 (slow.csv)")."""

    points: Sequence[tuple[float, float]] = ()
    draws: Draws | None = None
    tested: Tested | None = None
    whose: str = ""


class MapView:
    """Coordinates of the plane as numbers on the axes, in units of handy size."""

    def __init__(self, x: Axis, y: Axis) -> None:
        self.axes = (x, y)
        self.scales: tuple[Scale, ...] = tuple(scale_for(abs(q.value), q.unit) for q in (x, y))

    def shown(self, places: Array) -> Array:
        """Points (n, 2) in coordinates as on the axes."""
        return np.column_stack([self.line(i, places[:, i]) for i in (0, 1)])

    def line(self, which: int, places: Array) -> Array:
        """Coordinates of one axis (n,) as on it."""
        return np.asarray(self.axes[which].value_at(places) / self.scales[which].factor)

    def label(self, which: int) -> str:
        """Words and unit of an axis."""
        q, unit = self.axes[which], self.scales[which].unit.replace("m^2", "m²")
        return f"{q.label} [{unit}]" if unit else q.label


# ----------------------------------------------------------------------------------------------------------------------
# Over two quantities.
# ----------------------------------------------------------------------------------------------------------------------


def draw_map(chart: Chart, path: File, part: str = "stability", marks: Marks | None = None) -> None:
    """Draw a map: regions by outcome with the fall of the force, or ("amplitude") fall and period as contours.

    Raises:
        OSError: the file cannot be written.
    """
    with drawing_style(), atomic_path(path) as temporary:
        map_figure(chart, part, marks).savefig(temporary, dpi=DPI)


def map_figure(chart: Chart, part: str = "stability", marks: Marks | None = None) -> Figure:
    """The same as a figure; inside `drawing_style`."""
    marks = marks or Marks()
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.add_subplot()
    view = MapView(chart.plane.x, chart.plane.y)
    _axes(axes, chart, view)  # first: contours are labelled where they lie on the page
    legend: list[Any] = _regions(axes, chart, view)
    if part == "amplitude":  # the fall covers the colours of what sticks
        legend = _amplitudes(figure, axes, chart, view)
    else:
        unit = _contours(axes, chart, view, "peak_to_valley", "0.45", "white")
        legend += (
            [] if unit is None else [Line2D([], [], color="0.45", lw=0.6, label=f"force, peak to valley [{unit}]")]
        )
    for boundary, colour, words in (
        (chart.sticking, STICKS, "end of stick-slip"),
        (chart.unstable, SLIDES, "sliding loses stability"),
    ):
        lines = boundary.lines()
        for points in lines:
            axes.plot(*view.shown(points).T, color=colour, lw=1.3, zorder=3)
        legend += [Line2D([], [], color=colour, lw=1.3, label=words)] if lines else []
    legend += _untested(axes, chart, view, marks.tested)
    legend += _points(axes, chart, view, marks)
    _legend(figure, legend)
    return figure


def _legend(figure: Figure, handles: list[Any]) -> None:
    figure.legend(
        handles=handles, loc="outside lower center", ncols=2, fontsize=FONT - 1, handlelength=2.0, columnspacing=1.2
    )


def _region_path(boundary: Boundary, view: MapView) -> Path | None:
    """The region inside a boundary."""
    loops = [np.vstack([points, points[:1]]) for points in (view.shown(loop) for loop, _ in boundary.loops)]
    if not loops:
        return None
    codes = [np.r_[Path.MOVETO, np.full(len(p) - 2, Path.LINETO), Path.CLOSEPOLY] for p in loops]
    return Path(np.vstack(loops), np.concatenate(codes))


def _regions(axes: Axes, chart: Chart, view: MapView) -> list[Any]:
    """Colours by outcome: what sticks, what slides unstably, and where both or neither is so."""
    x, y = (view.line(i, places) for i, places in enumerate((chart.plane.x_places, chart.plane.y_places)))
    colour = {name: colour for name, (colour, _) in REGIONS.items()}
    frame = Path(np.array([[x[0], y[0]], [x[-1], y[0]], [x[-1], y[-1]], [x[0], y[-1]], [x[0], y[0]]]))
    sticks, unstable = _region_path(chart.sticking, view), _region_path(chart.unstable, view)
    _fill(axes, frame, colour[Outcome.NEVER_STICKS.value])
    if unstable is not None:
        _fill(axes, unstable, colour[Outcome.UNDECIDED.value])
    if sticks is not None:
        _fill(axes, sticks, colour[Outcome.BISTABLE.value])
        if unstable is not None:
            always = _fill(axes, unstable, colour[Outcome.ALWAYS_STICKS.value])
            always.set_clip_path(PathPatch(sticks, transform=axes.transData))
    for word in (Outcome.IRREGULAR.value, NOT_ADMITTED, NO_ANSWER):  # cells of nodes, as they have no outline
        here = chart.outcomes == word
        if np.any(here):
            shown = np.ma.masked_where(~here, np.ones(here.shape))
            cells = ListedColormap([colour[word]])
            axes.pcolormesh(x, y, shown, shading="nearest", cmap=cells, vmin=0, vmax=1, zorder=0.6)
    there = set(np.unique(chart.outcomes).tolist())
    return [Patch(facecolor=c, edgecolor="0.5", lw=0.4, label=text) for w, (c, text) in REGIONS.items() if w in there]


def _fill(axes: Axes, path: Path, colour: str) -> PathPatch:
    patch = PathPatch(path, facecolor=colour, edgecolor="none", zorder=0.5)
    axes.add_patch(patch)
    return patch


def _levels(values: Array) -> Array:
    """Round levels within the values: 1, 2, 5 where they span more than POWERS, else even ones."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if low > 0.0 and high > POWERS * low:
        steps = [1.0] if high > 1e4 * low else [1.0, 2.0, 5.0]
        decades = np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
        levels = (10.0 ** decades[:, None] * steps).ravel()
    else:
        step = 10.0 ** np.floor(np.log10(max((high - low) / LEVELS, 1e-300)))
        step *= next(s for s in (1, 2, 5, 10) if (high - low) / (s * step) <= LEVELS)
        levels = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    return levels[(levels > low) & (levels < high)]


def _contours(axes: Axes, chart: Chart, view: MapView, name: str, colour: str, behind: str) -> str | None:
    """Labelled contours of a quantity of the orbit; the unit they are told in, None where there is nothing to draw."""
    values, inside = chart.figures[name], _region_path(chart.sticking, view)
    if np.sum(np.isfinite(values)) < 4 or inside is None:
        return None
    scale = scale_for(float(np.nanmedian(values)), {"peak_to_valley": "N", "period": "s"}[name])
    levels = _levels(values / scale.factor)
    if not levels.size:
        return None
    x, y = view.line(0, chart.plane.x_places), view.line(1, chart.plane.y_places)
    lines = axes.contour(x, y, values / scale.factor, levels=levels, linewidths=0.6, zorder=2, colors=colour)
    lines.set_clip_path(PathPatch(inside, transform=axes.transData))
    for label in axes.clabel(lines, fmt=lambda v: number(v, 3), fontsize=FONT - 1.5, inline=False):
        label.set_path_effects([withStroke(linewidth=2.5, foreground=behind)])
        label.set_visible(bool(inside.contains_point(label.get_position())))
    return scale.unit


def _amplitudes(figure: Figure, axes: Axes, chart: Chart, view: MapView) -> list[Any]:
    """The fall of the force as colours, the period as lines."""
    fall = chart.figures["peak_to_valley"]
    if not np.any(np.isfinite(fall)):
        return []
    scale = scale_for(float(np.nanmedian(fall)), "N")
    x, y = view.line(0, chart.plane.x_places), view.line(1, chart.plane.y_places)
    wide = float(np.nanmax(fall)) > WIDE * float(np.nanquantile(fall, 0.05)) > 0.0
    mesh = axes.pcolormesh(
        x, y, fall / scale.factor, shading="nearest", cmap="cividis", norm="log" if wide else None, zorder=1
    )
    mesh.set_rasterized(True)
    bar = figure.colorbar(mesh, ax=axes, pad=0.02, aspect=30)
    bar.set_label(f"force, peak to valley [{scale.unit}]", fontsize=FONT)
    bar.ax.tick_params(labelsize=FONT - 0.5, which="both")
    if wide:
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: number(v, 3)))
        bar.ax.yaxis.set_minor_formatter(NullFormatter())
    period = _contours(axes, chart, view, "period", "white", "0.25")
    return [] if period is None else [Line2D([], [], color="0.7", lw=0.8, label=f"period [{period}]")]


def _untested(axes: Axes, chart: Chart, view: MapView, tested: Tested | None) -> list[Any]:
    """The frame of the tested range: what lies outside is most of many a map, and stays readable."""
    if tested is None:
        return []
    spans = []
    for which, (q, places) in enumerate(zip(view.axes, (chart.plane.x_places, chart.plane.y_places), strict=True)):
        ends = q.value_at(places[[0, -1]])
        low, high = tested.reach(q.name) or tuple(ends)
        if high < ends[0] or low > ends[1]:
            return [Line2D([], [], ls="", label="extrapolated: nothing here was tested")]
        spans.append(np.clip([low, high], *ends) / view.scales[which].factor)
    (x0, x1), (y0, y1) = spans
    axes.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color=TESTED, lw=0.9, ls="-.", zorder=3.2)
    return [Line2D([], [], color=TESTED, lw=0.9, ls="-.", label="tested inside; beyond: extrapolated")]


def _points(axes: Axes, chart: Chart, view: MapView, marks: Marks) -> list[Any]:
    x, y = view.axes
    here = view.shown(np.array([[x.place(x.value), y.place(y.value)]]))[0]
    spans = chart.plane.x_values[[0, -1]], chart.plane.y_values[[0, -1]]
    shows = _within((x.value, y.value), spans)
    name = marks.whose if len(marks.whose) <= LONGEST_NAME else f"{marks.whose[: LONGEST_NAME - 1]}…"
    whose = f"operating point of\n{name}" if name else "operating point"  # in one line a long name leaves the page
    beyond = ":\nbeyond this map" if name else ": beyond this map"
    label = whose if shows else whose + beyond
    legend: list[Any] = [Line2D([], [], ls="", marker="*", ms=8, mfc="k", mec="w", mew=0.6, label=label)]
    legend += _drawn(axes, chart, view, marks.draws)
    others = [
        p
        for p in dict.fromkeys(marks.points)
        if not np.allclose(p, (x.value, y.value), rtol=1e-9) and _within(p, spans)
    ]
    if others:
        shown = np.array(others) / [s.factor for s in view.scales]
        axes.plot(*shown.T, ls="", marker="o", ms=4, mfc="w", mec="k", mew=0.8, zorder=5)
        legend.append(Line2D([], [], ls="", marker="o", ms=4, mfc="w", mec="k", mew=0.8, label="other logs"))
    if shows:
        axes.plot(*here, ls="", marker="*", ms=9, mfc="k", mec="w", mew=0.6, zorder=6)
    return legend


def _drawn(axes: Axes, chart: Chart, view: MapView, draws: Draws | None) -> list[Any]:
    """The operating points that what is known of the two quantities allows for."""
    if draws is None:
        return []
    rows = draws.settings[: draws.count]
    columns = [
        quantity_of(chart.plane.site, q.name, rows) / s.factor for q, s in zip(view.axes, view.scales, strict=True)
    ]
    if all(np.ptp(column) == 0.0 for column in columns):
        return []
    axes.plot(*columns, ls="", marker=".", ms=1.5, mfc="k", mec="none", alpha=0.35, zorder=5)
    return [Line2D([], [], ls="", marker=".", ms=3, mfc="k", mec="none", label="what is known of it, in draws")]


def _within(point: tuple[float, float], spans: tuple[Array, Array]) -> bool:
    """Whether a point (x, y) lies on a map with these ends (2,) each, but for the rounding of its edge."""
    reach = [1e-9 * float(np.ptp(span)) for span in spans]
    return all(s[0] - r <= v <= s[1] + r for v, s, r in zip(point, spans, reach, strict=True))


def _axes(axes: Axes, chart: Chart, view: MapView) -> None:
    axes.grid(False)
    for which, (q, places) in enumerate(zip(view.axes, (chart.plane.x_places, chart.plane.y_places), strict=True)):
        axis = axes.xaxis if which == 0 else axes.yaxis
        (axes.set_xscale if which == 0 else axes.set_yscale)("log" if q.logarithmic else "linear")
        ends = view.line(which, places[[0, -1]])
        (axes.set_xlim if which == 0 else axes.set_ylim)(*ends)
        axis.set_label_text(view.label(which), fontsize=FONT + 0.5)
        if q.logarithmic:
            ticks_in_powers(axis, ends)
    axes.tick_params(labelsize=FONT)
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)


def ticks_in_powers(axis: Any, ends: Array) -> None:
    """Plain numbers at the decades, and between them where there are fewer than two."""
    if ends[1] < NARROW * ends[0]:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda v, _: number(v, 3)))
    axis.set_minor_formatter(NullFormatter())


# ----------------------------------------------------------------------------------------------------------------------
# Over one quantity: forces, timing and what decides about stability.
# ----------------------------------------------------------------------------------------------------------------------


def draw_line(answer: LineMap, path: File, part: str = "stability") -> None:
    """Draw it: force levels above, and growth rate and multiplier ("stability") or period below.

    Raises:
        OSError: the file cannot be written.
    """
    with drawing_style(), atomic_path(path) as temporary:
        line_figure(answer, part).savefig(temporary, dpi=DPI)


def line_figure(answer: LineMap, part: str = "stability") -> Figure:
    """The same as a figure; inside `drawing_style`."""
    figure = Figure(figsize=OVER_ONE, layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    q, scale = answer.quantity, scale_for(abs(answer.quantity.value), answer.quantity.unit)
    x = answer.values / scale.factor
    legend = _forces(upper, answer, x)
    legend += _decisive(lower, answer, x) if part == "stability" else _timing(lower, answer, x)
    for axes in (upper, lower):
        patches = _shaded(axes, answer, x)
        for changes, colour in ((answer.ends, STICKS), (answer.losses, SLIDES)):
            for change in changes:
                axes.axvline(change.value / scale.factor, color=colour, lw=1.0, zorder=1)
        axes.axvline(q.value / scale.factor, color="k", lw=0.8, ls=":", zorder=1)
        axes.set_xscale("log" if q.logarithmic else "linear")
        axes.set_xlim(x[0], x[-1])
        axes.grid(False)
        axes.tick_params(labelsize=FONT)
    lower.set_xlabel(f"{q.label} [{scale.unit}]".replace("m^2", "m²") if scale.unit else q.label, fontsize=FONT + 0.5)
    if q.logarithmic:
        ticks_in_powers(lower.xaxis, x[[0, -1]])
    legend += [
        *([Line2D([], [], color=STICKS, lw=1.0, label="end of stick-slip")] if answer.ends else []),
        *([Line2D([], [], color=SLIDES, lw=1.0, label="sliding loses stability")] if answer.losses else []),
        Line2D([], [], color="k", lw=0.8, ls=":", label="operating point"),
        *patches,
    ]
    _legend(figure, legend)
    return figure


def _shaded(axes: Axes, answer: LineMap, x: Array) -> list[Any]:
    """Colours by outcome, changing half way between two values that differ, or where the change was found."""
    found = np.sort([change.value for change in (*answer.ends, *answer.losses)]) * x[0] / answer.values[0]
    start, legend = x[0], []
    for i in range(x.size):
        if i + 1 < x.size and answer.chart.outcomes[0][i + 1] == answer.chart.outcomes[0][i]:
            continue
        stop = x[-1]
        if i + 1 < x.size:
            between = found[(found > x[i]) & (found < x[i + 1])]
            stop = between[0] if between.size == 1 else 0.5 * (x[i] + x[i + 1])
        word = str(answer.chart.outcomes[0][i])
        colour, text = REGIONS[word]
        axes.axvspan(start, stop, color=colour, lw=0, zorder=0)
        legend.append((word, Patch(facecolor=colour, label=text)))
        start = stop
    return list(dict(legend).values())


def _forces(axes: Axes, answer: LineMap, x: Array) -> list[Any]:
    unit = scale_for(float(np.nanmax(answer.sliding_force)), "N")
    rows = (
        (answer.chart.figures["onset_force"][0], ONSET, "-", "force at the onset of slip"),
        (answer.chart.figures["arrest_force"][0], ARREST, "-", "force at its end"),
        (answer.sliding_force, "0.25", "--", "force of steady sliding"),
    )
    for values, colour, style, _ in rows:
        axes.plot(x, values / unit.factor, color=colour, ls=style, lw=1.1)
    axes.set_ylabel(f"force [{unit.unit}]", fontsize=FONT + 0.5)
    return [Line2D([], [], color=colour, ls=style, lw=1.1, label=words) for _, colour, style, words in rows]


def _decisive(axes: Axes, answer: LineMap, x: Array) -> list[Any]:
    """Growth rate of steady sliding on the left, largest multiplier of stick-slip on the right."""
    axes.plot(x, answer.chart.growth[0], color=SLIDES, lw=1.1)
    axes.axhline(0.0, color=SLIDES, lw=0.6)
    axes.set_ylabel("growth rate of sliding [1/s]", fontsize=FONT + 0.5)
    right = axes.twinx()
    right.plot(x, np.abs(answer.chart.multiplier[0]), color=STICKS, lw=1.1, ls="-.")
    right.set_ylim(0.0, 1.05)
    right.set_ylabel("largest |multiplier| of stick-slip", fontsize=FONT + 0.5)
    right.tick_params(labelsize=FONT)
    right.grid(False)
    right.spines["right"].set_visible(True)
    return [
        Line2D([], [], color=SLIDES, lw=1.1, label="growth rate (left)"),
        Line2D([], [], color=STICKS, lw=1.1, ls="-.", label="multiplier (right)"),
    ]


def _timing(axes: Axes, answer: LineMap, x: Array) -> list[Any]:
    period, slip = answer.chart.figures["period"][0], answer.chart.figures["slip_duration"][0]
    if not np.any(np.isfinite(period)):
        return []
    unit = scale_for(float(np.nanmedian(period)), "s")
    axes.plot(x, period / unit.factor, color="0.15", lw=1.1)
    axes.plot(x, slip / unit.factor, color="0.5", lw=1.1, ls="--")
    axes.set_yscale("log")
    ticks_in_powers(axes.yaxis, np.array(axes.get_ylim()))
    axes.set_ylabel(f"time [{unit.unit}]", fontsize=FONT + 0.5)
    return [
        Line2D([], [], color="0.15", lw=1.1, label="period"),
        Line2D([], [], color="0.5", lw=1.1, ls="--", label="of it in slip"),
    ]
