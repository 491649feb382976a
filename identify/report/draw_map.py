"""A stability or amplitude map as a picture for one column of a journal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from data_io.atomic import atomic_path
from identify.axes import Axis
from identify.chart import NO_ANSWER, NOT_ADMITTED, Boundary, Chart
from identify.chart_closed import closed_plane
from identify.chart_spread import Known, bands, region
from identify.prospect import Outcome
from identify.report.quantity_text import Scale, number, scale_for
from identify.report.style import drawing_style
from identify.tested import Tested

Array = NDArray[np.float64]

SIZE, DPI = (3.54, 4.3), 300  # inch: a journal column is 90 mm wide
FONT = 7.5
STICKS, SLIDES = "#D55E00", "#0072B2"  # ends of stick-slip and of stable sliding
CLOSED = "#6b2c00"  # the first as the closed form has it
# outcome: colour, words in the picture
REGIONS = {
    Outcome.NEVER_STICKS.value: ("#dcebf5", "steady\nsliding"),
    Outcome.ALWAYS_STICKS.value: ("#fbe3d0", "stick-slip"),
    Outcome.BISTABLE.value: ("#f3eca0", "both"),
    Outcome.IRREGULAR.value: ("#e3c7d8", "irregular\nstick-slip"),
    Outcome.UNDECIDED.value: ("#c9cdd2", "oscillates\nwithout rest"),
    NOT_ADMITTED: ("#ffffff", "not possible"),
    NO_ANSWER: ("#ffffff", "no answer"),
}
LEAST_LABELLED = 0.03  # share of the map from which a region is labelled inside
HATCH = "0.72"
PIXELS = 600  # of the regions, along each quantity
LEVELS = 6
LEGENDS = {Outcome.BISTABLE.value: "both: depends on the start"}  # words of the legend, where those inside are short
BAND = 0.25  # opacity
NARROW = 30.0  # ratio of the ends of an axis up to which it has numbers between the decades
WIDE = 20.0  # ratio of drops from which their colours are even in powers


@dataclass(frozen=True)
class Marks:
    """What is drawn on a map beside the answer: other operating points, (x, y) [SI] each; what is known of pair and
    rig; the tested range."""

    points: Sequence[tuple[float, float]] = ()
    known: Known | None = None
    tested: Tested | None = None


def draw_map(chart: Chart, path: File, part: str = "stability", marks: Marks | None = None) -> None:
    """Draw a map: regions by outcome with the force drop, or ("amplitude") drop and period as contours.

    Raises:
        OSError: the file cannot be written.
    """
    with drawing_style():
        figure = map_figure(chart, part, marks)
        with atomic_path(path) as temporary:
            figure.savefig(temporary, dpi=DPI)


def map_figure(chart: Chart, part: str = "stability", marks: Marks | None = None) -> Figure:
    """The same as a figure; inside `drawing_style`."""
    marks = marks or Marks()
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.add_subplot()
    view = _View(chart.plane.x, chart.plane.y)
    legend: list[Any] = _regions(axes, chart, view)
    legend += _amplitude(figure, axes, chart, view) if part == "amplitude" else _drops(axes, chart, view)
    for boundary, colour, words in (
        (chart.sticking, STICKS, "end of stick-slip"),
        (chart.unstable, SLIDES, "sliding loses stability"),
    ):
        legend += _boundary(axes, chart, boundary, view, colour, words, marks.known)
    if marks.known is not None:
        legend.append(Patch(facecolor="0.4", alpha=BAND, label="their 95 % bands"))
    legend += _closed_forms(axes, chart, view)
    legend += _untested(axes, chart, view, marks.tested)
    legend += _points(axes, chart, view, marks)
    _axes(axes, chart, view)
    figure.legend(
        handles=legend, loc="outside lower center", ncols=2, fontsize=FONT - 1, handlelength=2.0, columnspacing=1.2
    )
    return figure


class _View:
    """Coordinates of the plane as numbers on the axes, in units of handy size."""

    def __init__(self, x: Axis, y: Axis) -> None:
        self.axes = (x, y)
        self.scales: tuple[Scale, ...] = tuple(scale_for(abs(q.value), q.unit) for q in (x, y))

    def shown(self, places: Array) -> Array:
        """Points (n, 2) in coordinates as on the axes."""
        columns = [
            q.value_at(places[:, i]) / s.factor for i, (q, s) in enumerate(zip(self.axes, self.scales, strict=True))
        ]
        return np.column_stack(columns)

    def line(self, which: int, places: Array) -> Array:
        """Coordinates of one axis (n,) as on it."""
        return np.asarray(self.axes[which].value_at(places) / self.scales[which].factor)

    def label(self, which: int) -> str:
        q, unit = self.axes[which], self.scales[which].unit.replace("m^2", "m²")
        return f"{q.label} [{unit}]" if unit else q.label


def _path(boundary: Boundary, view: _View) -> Path | None:
    """The region inside a boundary."""
    loops = [np.vstack([points, points[:1]]) for points in (view.shown(loop.points) for loop in boundary.loops)]
    if not loops:
        return None
    codes = [np.r_[Path.MOVETO, np.full(len(p) - 2, Path.LINETO), Path.CLOSEPOLY] for p in loops]
    return Path(np.vstack(loops), np.concatenate(codes))


def _regions(axes: Axes, chart: Chart, view: _View) -> list[Any]:
    """Colours by outcome: what sticks, what slides unstably, and where both or neither is so."""
    x, y = (view.line(i, places) for i, places in enumerate((chart.plane.x_places, chart.plane.y_places)))
    colour = {name: colour for name, (colour, _) in REGIONS.items()}
    frame = Path(np.array([[x[0], y[0]], [x[-1], y[0]], [x[-1], y[-1]], [x[0], y[-1]], [x[0], y[0]]]))
    sticks, unstable = _path(chart.sticking, view), _path(chart.unstable, view)
    _fill(axes, frame, colour[Outcome.NEVER_STICKS.value])
    if unstable is not None:
        _fill(axes, unstable, colour[Outcome.UNDECIDED.value])
    if sticks is not None:
        _fill(axes, sticks, colour[Outcome.BISTABLE.value])
        if unstable is not None:
            always = _fill(axes, unstable, colour[Outcome.ALWAYS_STICKS.value])
            always.set_clip_path(PathPatch(sticks, transform=axes.transData))
    for word in (Outcome.IRREGULAR.value, NOT_ADMITTED, NO_ANSWER):
        _cells(axes, chart, x, y, word, colour[word])
    return _named(axes, chart, view)


def _fill(axes: Axes, path: Path, colour: str) -> PathPatch:
    patch = PathPatch(path, facecolor=colour, edgecolor="none", zorder=0.5)
    axes.add_patch(patch)
    return patch


def _cells(axes: Axes, chart: Chart, x: Array, y: Array, word: str, colour: str) -> None:
    """Cells around the nodes with an outcome that has no outline of its own."""
    here = chart.outcomes == word
    if np.any(here):
        shown = np.ma.masked_where(~here, np.ones(here.shape))
        axes.pcolormesh(x, y, shown, shading="nearest", cmap=_plain(colour), vmin=0, vmax=1, zorder=0.6)


def _plain(colour: str) -> Any:
    from matplotlib.colors import ListedColormap

    return ListedColormap([colour])


def _named(axes: Axes, chart: Chart, view: _View) -> list[Any]:
    """Words inside large regions; patches for the legend for small ones."""
    legend: list[Any] = []
    places = chart.plane.x_places, chart.plane.y_places
    for word, (colour, text) in REGIONS.items():
        here = chart.outcomes == word
        share = float(np.mean(here))
        if (word in LEGENDS and share) or 0.0 < share < LEAST_LABELLED:
            words = LEGENDS.get(word, text.replace("\n", " "))
            legend.append(Patch(facecolor=colour, edgecolor="0.5", lw=0.4, label=words))
        if share >= LEAST_LABELLED:
            depth = distance_transform_edt(np.pad(here & ~_near_the_point(chart), 1))[1:-1, 1:-1]
            j, i = np.unravel_index(int(np.argmax(depth)), depth.shape)
            at = view.shown(np.array([[places[0][i], places[1][j]]]))[0]
            written = axes.text(
                float(at[0]), float(at[1]), text, ha="center", va="center", fontsize=FONT, color="0.1", zorder=4
            )
            written.set_linespacing(0.95)
            written.set_path_effects([withStroke(linewidth=1.5, foreground="white", alpha=0.8)])
    return legend


def _near_the_point(chart: Chart) -> NDArray[np.bool_]:
    """Nodes that a label centred there would write over the operating point from."""
    plane = chart.plane
    near = [
        np.abs(places - q.place(q.value)) < share * np.ptp(places)
        for q, places, share in ((plane.x, plane.x_places, 0.2), (plane.y, plane.y_places, 0.06))
    ]
    return np.asarray(near[1][:, None] & near[0][None, :])


def _levels(values: Array) -> Array:
    """Round levels within the values: 1, 2, 5 where they span more than a decade, else even ones."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if low > 0.0 and high > 10.0 * low:
        decades = np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
        wide = high > 1e4 * low
        steps = np.array([1.0]) if wide else np.array([1.0, 2.0, 5.0])
        levels = np.sort((10.0 ** decades[:, None] * steps).ravel())
    else:
        step = 10.0 ** np.floor(np.log10(max((high - low) / LEVELS, 1e-300)))
        step *= next(s for s in (1, 2, 5, 10) if (high - low) / (s * step) <= LEVELS)
        levels = np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step
    return levels[(levels > low) & (levels < high)]


def _continued(values: Array) -> Array:
    """Values carried on from the nearest node that has one, so that a drawing reaches the outline it is cut to."""
    nearest = distance_transform_edt(np.isnan(values), return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)])


def _contours(axes: Axes, chart: Chart, view: _View, name: str, colour: str, behind: str) -> Scale | None:
    """Labelled contours of a quantity of the orbit; the unit they are told in, None where there is nothing to draw."""
    values = chart.figures[name]
    inside = _path(chart.sticking, view)
    if np.sum(np.isfinite(values)) < 4 or inside is None:
        return None
    scale = scale_for(float(np.nanmedian(values)), {"drop": "N", "period": "s"}[name])
    levels = _levels(values / scale.factor)
    if not levels.size:
        return None
    x, y = view.line(0, chart.plane.x_places), view.line(1, chart.plane.y_places)
    lines = axes.contour(x, y, values / scale.factor, levels=levels, linewidths=0.6, zorder=2, colors=colour)
    lines.set_clip_path(PathPatch(inside, transform=axes.transData))
    labels = axes.clabel(lines, fmt=lambda v: number(v, 3), fontsize=FONT - 1.5, inline_spacing=2)
    for label in labels:
        label.set_path_effects([withStroke(linewidth=1.2, foreground=behind)])
        if not inside.contains_point(label.get_position()):
            label.remove()
    return scale


def _drops(axes: Axes, chart: Chart, view: _View) -> list[Any]:
    scale = _contours(axes, chart, view, "drop", "0.45", "white")
    return [] if scale is None else [Line2D([], [], color="0.45", lw=0.6, label=f"force drop [{scale.unit}]")]


def _amplitude(figure: Figure, axes: Axes, chart: Chart, view: _View) -> list[Any]:
    """The drop as colours, the period as lines."""
    drop = chart.figures["drop"]
    if not np.any(np.isfinite(drop)):
        return []
    scale = scale_for(float(np.nanmedian(drop)), "N")
    x, y = view.line(0, chart.plane.x_places), view.line(1, chart.plane.y_places)
    wide = float(np.nanmax(drop)) > WIDE * float(np.nanmin(drop)) > 0.0
    mesh = axes.pcolormesh(
        x, y, _continued(drop) / scale.factor, shading="gouraud", cmap="cividis", norm="log" if wide else None, zorder=1
    )
    mesh.set_rasterized(True)
    inside = _path(chart.sticking, view)
    if inside is not None:
        mesh.set_clip_path(PathPatch(inside, transform=axes.transData))
    bar = figure.colorbar(mesh, ax=axes, pad=0.02, aspect=30)
    bar.set_label(f"force drop [{scale.unit}]", fontsize=FONT)
    bar.ax.tick_params(labelsize=FONT - 0.5, which="both")
    if wide:
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: number(v, 3)))
        bar.ax.yaxis.set_minor_formatter(NullFormatter())
    period = _contours(axes, chart, view, "period", "white", "0.25")
    if period is None:
        return []
    return [Line2D([], [], color="0.7", lw=0.8, label=f"period [{period.unit}]")]


def _boundary(
    axes: Axes, chart: Chart, boundary: Boundary, view: _View, colour: str, words: str, known: Known | None
) -> list[Any]:
    lines = boundary.lines()
    for points, _ in lines:
        axes.plot(*view.shown(points).T, color=colour, lw=1.3, zorder=3)
    if not lines:
        return []
    legend: list[Any] = [Line2D([], [], color=colour, lw=1.3, label=words)]
    sides = [] if known is None else bands(chart.plane, boundary, known)
    for left, right in sides:
        ring = view.shown(np.vstack([left, right[::-1]]))
        axes.fill(*ring.T, color=colour, alpha=BAND, lw=0, zorder=2.5)
    return legend


def _closed_forms(axes: Axes, chart: Chart, view: _View) -> list[Any]:
    """Boundaries of the closed forms: dashed where they hold, dotted where a V_max is too large for them."""
    closed = closed_plane(chart.plane)
    if closed is None:
        return []
    x, y = view.line(0, closed.x), view.line(1, closed.y)
    legend = []
    slip, sliding = (np.clip(margin, -50.0, 50.0) for margin in (closed.slip, closed.sliding))
    for margin, colour, style, words in (
        (np.where(_grown(closed.valid), slip, np.nan), CLOSED, "--", "its closed form (eq. 18)"),
        (np.where(_grown(~closed.valid), slip, np.nan), CLOSED, ":", "eq. 18 where it is not valid"),
        (sliding, "k", (0, (4, 3)), "Π = Πfc (eq. 25, derived)"),
    ):
        if np.nanmin(margin, initial=0.0) < 0.0 < np.nanmax(margin, initial=0.0):
            drawn = axes.contour(
                x, y, margin, levels=[0.0], colors=[colour], linewidths=0.9, linestyles=[style], zorder=3.5
            )
            if any(np.size(path.vertices) for path in drawn.get_paths()):
                legend.append(Line2D([], [], color=colour, lw=0.9, ls=style, label=words))
    return legend


def _grown(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """A mask and its neighbours: a contour between the two belongs to both."""
    out = mask.copy()
    for axis in (0, 1):
        for shift in (1, -1):
            out |= np.roll(mask, shift, axis)
    return out


def _untested(axes: Axes, chart: Chart, view: _View, tested: Tested | None) -> list[Any]:
    """Hatching over what lies outside the tested range."""
    if tested is None:
        return []
    x, y = np.linspace(0, 1, PIXELS), np.linspace(0, 1, PIXELS)
    outside = np.zeros((PIXELS, PIXELS), dtype=bool)
    coordinates = []
    for which, (share, places) in enumerate(((x, chart.plane.x_places), (y, chart.plane.y_places))):
        q = view.axes[which]
        place = places[0] + share * (places[-1] - places[0])
        beyond = np.array([tested.extrapolated(q.name, float(v)) for v in q.value_at(place)])
        outside |= beyond[None, :] if which == 0 else beyond[:, None]
        coordinates.append(view.line(which, place))
    if not np.any(outside):
        return []
    hatched = axes.contourf(
        *coordinates, outside.astype(float), levels=[0.5, 1.5], colors="none", hatches=["//"], zorder=1.5
    )
    hatched.set_edgecolor(HATCH)
    hatched.set_linewidth(0.0)
    return [Patch(facecolor="none", edgecolor=HATCH, hatch="////", lw=0, label="extrapolated: not tested")]


def _points(axes: Axes, chart: Chart, view: _View, marks: Marks) -> list[Any]:
    x, y = view.axes
    here = view.shown(np.array([[x.place(x.value), y.place(y.value)]]))[0]
    legend: list[Any] = [Line2D([], [], ls="", marker="*", ms=8, mfc="k", mec="w", mew=0.6, label="operating point")]
    ring = None if marks.known is None else region(chart.plane, marks.known)
    if ring is not None:
        axes.plot(*view.shown(ring).T, color="k", lw=0.9, zorder=5)
        legend.append(Line2D([], [], color="k", lw=0.9, label="its 95 % region"))
    others = [p for p in dict.fromkeys(marks.points) if not np.allclose(p, (x.value, y.value), rtol=1e-9)]
    if others:
        shown = np.array(others) / [s.factor for s in view.scales]
        axes.plot(*shown.T, ls="", marker="o", ms=4, mfc="w", mec="k", mew=0.8, zorder=5)
        legend.append(Line2D([], [], ls="", marker="o", ms=4, mfc="w", mec="k", mew=0.8, label="other logs"))
    axes.plot(*here, ls="", marker="*", ms=9, mfc="k", mec="w", mew=0.6, zorder=6)
    return legend


def ticks_in_powers(axis: Any, ends: Array) -> None:
    """Plain numbers at the decades, and between them where there are fewer than two."""
    if ends[1] < NARROW * ends[0]:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda v, _: number(v, 3)))
    axis.set_minor_formatter(NullFormatter())


def _axes(axes: Axes, chart: Chart, view: _View) -> None:
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
