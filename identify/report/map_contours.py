"""Drop and period of the jumps on a map: labelled contours, and colours."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from identify.prediction.chart import Chart
from identify.report.map_view import FONT, View, region_path
from identify.report.quantity_text import Scale, number, scale_for

Array = NDArray[np.float64]

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


def _contours(axes: Axes, chart: Chart, view: View, name: str, colour: str, behind: str) -> Scale | None:
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
    ends = [*starts[1:], len(points)]
    kept = [np.arange(first, end) for first, end in zip(starts, ends, strict=True) if end - first > SCRAP]
    rows = np.concatenate(kept) if kept else np.empty(0, dtype=int)
    return Path(points[rows].reshape(-1, 2), codes[rows])


def falls(axes: Axes, chart: Chart, view: View) -> list[Any]:
    """Contours of the fall of the force; what they add to the legend."""
    scale = _contours(axes, chart, view, "peak_to_valley", "0.45", "white")
    return (
        [] if scale is None else [Line2D([], [], color="0.45", lw=0.6, label=f"force, peak to valley [{scale.unit}]")]
    )


def amplitudes(figure: Figure, axes: Axes, chart: Chart, view: View) -> list[Any]:
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
