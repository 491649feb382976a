"""The regions of a map by outcome: colours, and words inside them or in the legend."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from identify.prediction.chart import NO_ANSWER, NOT_ADMITTED, Chart
from identify.prediction.windows import Outcome
from identify.report.map_view import FONT, View, region_path

Array = NDArray[np.float64]

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


def regions(axes: Axes, chart: Chart, view: View) -> list[Any]:
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


def _named(axes: Axes, chart: Chart, view: View) -> list[Any]:
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
