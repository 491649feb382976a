"""How a map is seen: its coordinates as numbers on axes, in units of handy size, and the look all its parts share."""

from __future__ import annotations

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
from scipy.ndimage import distance_transform_edt

from identify.base.wording import Scale, number, scale_for
from identify.prediction.chart import NO_ANSWER, NOT_ADMITTED, Boundary, Chart
from identify.prediction.map_axes import Axis
from identify.prediction.windows import Outcome

Array = NDArray[np.float64]

FONT = 7.5
NARROW = 30.0  # ratio of the ends of an axis up to which it has numbers between the decades


class MapView:
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
        """Words and unit of an axis."""
        q, unit = self.axes[which], self.scales[which].unit.replace("m^2", "m²")
        return f"{q.label} [{unit}]" if unit else q.label


def region_path(boundary: Boundary, view: MapView) -> Path | None:
    """The region inside a boundary."""
    loops = [np.vstack([points, points[:1]]) for points in (view.shown(loop.points) for loop in boundary.loops)]
    if not loops:
        return None
    codes = [np.r_[Path.MOVETO, np.full(len(p) - 2, Path.LINETO), Path.CLOSEPOLY] for p in loops]
    return Path(np.vstack(loops), np.concatenate(codes))


def ticks_in_powers(axis: Any, ends: Array) -> None:
    """Plain numbers at the decades, and between them where there are fewer than two."""
    if ends[1] < NARROW * ends[0]:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda v, _: number(v, 3)))
    axis.set_minor_formatter(NullFormatter())


# ----------------------------------------------------------------------------------------------------------------------
# The regions of a map by outcome: colours, and words inside them or in the legend.
# ----------------------------------------------------------------------------------------------------------------------

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
LEGENDS = {Outcome.BISTABLE.value: "both: depends on the start"}  # words of the legend, where those inside are short
LEAST_LABELLED = 0.03  # share of the map from which a region is labelled inside


def regions(axes: Axes, chart: Chart, view: MapView) -> list[Any]:
    """Colours by outcome: what sticks, what slides unstably, and where both or neither is so."""
    x, y = (view.line(i, places) for i, places in enumerate((chart.plane.x_places, chart.plane.y_places)))
    colour = {name: colour for name, (colour, _) in REGIONS.items()}
    frame = Path(np.array([[x[0], y[0]], [x[-1], y[0]], [x[-1], y[-1]], [x[0], y[-1]], [x[0], y[0]]]))
    sticks, unstable = region_path(chart.sticking, view), region_path(chart.unstable, view)
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
        axes.pcolormesh(x, y, shown, shading="nearest", cmap=ListedColormap([colour]), vmin=0, vmax=1, zorder=0.6)


def _named(axes: Axes, chart: Chart, view: MapView) -> list[Any]:
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


# ----------------------------------------------------------------------------------------------------------------------
# Drop and period of the jumps on a map: labelled contours, and colours.
# ----------------------------------------------------------------------------------------------------------------------

LEVELS = 6
POWERS = 30.0  # ratio of values from which levels are even in powers
ROOM = np.array([0.12, 0.07])  # shares of the axes about a label that no other one may stand in
SCRAP = 5  # points of a contour that is no more than a scrap
WIDE = 20.0  # ratio of falls from which their colours are even in powers


def _levels(values: Array) -> Array:
    """Round levels within the values: 1, 2, 5 where they span more than POWERS, else even ones."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if low > 0.0 and high > POWERS * low:
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


def _contours(axes: Axes, chart: Chart, view: MapView, name: str, colour: str, behind: str) -> Scale | None:
    """Labelled contours of a quantity of the orbit; the unit they are told in, None where there is nothing to draw."""
    values = chart.figures[name]
    inside = region_path(chart.sticking, view)
    if np.sum(np.isfinite(values)) < 4 or inside is None:
        return None
    scale = scale_for(float(np.nanmedian(values)), {"peak_to_valley": "N", "period": "s"}[name])
    levels = _levels(values / scale.factor)
    if not levels.size:
        return None
    x, y = view.line(0, chart.plane.x_places), view.line(1, chart.plane.y_places)
    lines = axes.contour(x, y, values / scale.factor, levels=levels, linewidths=0.6, zorder=2, colors=colour)
    lines.set_paths([_without_scraps(path) for path in lines.get_paths()])
    lines.set_clip_path(PathPatch(inside, transform=axes.transData))
    labels = axes.clabel(lines, fmt=lambda v: number(v, 3), fontsize=FONT - 1.5, inline=False)
    words = [text.get_position() for text in axes.texts if text not in labels]
    taken = [_on_page(axes, position) for position in words]
    for label in labels:
        here = _on_page(axes, label.get_position())
        apart = all(np.hypot(*((here - other) / ROOM)) > 1.0 for other in taken)
        if apart and inside.contains_point(label.get_position()):
            taken.append(here)
            label.set_path_effects([withStroke(linewidth=2.5, foreground=behind)])
        else:
            label.remove()
    return scale


def _on_page(axes: Axes, position: tuple[float, float]) -> Array:
    """A place (2,) in shares of the axes."""
    return np.asarray(axes.transAxes.inverted().transform(axes.transData.transform(position)))


def _without_scraps(path: Path) -> Path:
    """A contour without its pieces within a few cells, as in the last row of nodes before stick-slip ends."""
    points = np.asarray(path.vertices)
    codes = np.full(len(points), Path.LINETO) if path.codes is None else np.asarray(path.codes)
    starts = np.flatnonzero(codes == Path.MOVETO)
    kept = [rows for rows in np.split(np.arange(len(points)), starts[1:]) if rows.size > SCRAP]
    rows = np.concatenate(kept) if kept else np.empty(0, dtype=int)
    return Path(points[rows].reshape(-1, 2), codes[rows])


def falls(axes: Axes, chart: Chart, view: MapView) -> list[Any]:
    """Contours of the fall of the force; what they add to the legend."""
    scale = _contours(axes, chart, view, "peak_to_valley", "0.45", "white")
    return (
        [] if scale is None else [Line2D([], [], color="0.45", lw=0.6, label=f"force, peak to valley [{scale.unit}]")]
    )


def amplitudes(figure: Figure, axes: Axes, chart: Chart, view: MapView) -> list[Any]:
    """The fall of the force as colours, the period as lines."""
    fall = chart.figures["peak_to_valley"]
    if not np.any(np.isfinite(fall)):
        return []
    scale = scale_for(float(np.nanmedian(fall)), "N")
    x, y = view.line(0, chart.plane.x_places), view.line(1, chart.plane.y_places)
    wide = float(np.nanmax(fall)) > WIDE * float(np.nanquantile(fall, 0.05)) > 0.0
    mesh = axes.pcolormesh(
        x, y, _continued(fall) / scale.factor, shading="gouraud", cmap="cividis", norm="log" if wide else None, zorder=1
    )
    mesh.set_rasterized(True)
    inside = region_path(chart.sticking, view)
    if inside is not None:
        mesh.set_clip_path(PathPatch(inside, transform=axes.transData))
    bar = figure.colorbar(mesh, ax=axes, pad=0.02, aspect=30)
    bar.set_label(f"force, peak to valley [{scale.unit}]", fontsize=FONT)
    bar.ax.tick_params(labelsize=FONT - 0.5, which="both")
    if wide:
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: number(v, 3)))
        bar.ax.yaxis.set_minor_formatter(NullFormatter())
    period = _contours(axes, chart, view, "period", "white", "0.25")
    if period is None:
        return []
    return [Line2D([], [], color="0.7", lw=0.8, label=f"period [{period.unit}]")]
