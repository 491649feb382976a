"""Stability and amplitude over two quantities, a map, and over one, as pictures for one column of a journal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from data_io.atomic import atomic_path
from identify.base.wording import scale_for
from identify.prediction.chart import Boundary, Chart
from identify.prediction.chart_bands import KnownCovariance, bands, closed_plane, region
from identify.prediction.continuation import Continuation
from identify.prediction.sources import Tested
from identify.report.map_parts import FONT, LEGENDS, REGIONS, MapView, amplitudes, falls, regions, ticks_in_powers
from identify.report.style import ARREST, ONSET, drawing_style

Array = NDArray[np.float64]

SIZE, OVER_ONE, DPI = (3.54, 4.3), (3.54, 4.6), 300  # inch: a journal column is 90 mm wide
STICKS, SLIDES = "#D55E00", "#0072B2"  # ends of stick-slip and of stable sliding
CLOSED = "#6b2c00"  # the first as the closed form has it
TESTED = "0.25"
PIXELS = 600  # of the regions, along each quantity
BAND = 0.25  # opacity
LONGEST_NAME = 26  # letters of a log that the legend has room for


@dataclass(frozen=True)
class Marks:
    """What is drawn on a map beside the answer: other operating points, (x, y) [SI] each; what is known of pair and
    rig; the tested range; whose the operating point is ("log 2 (slow.csv)")."""

    points: Sequence[tuple[float, float]] = ()
    known: KnownCovariance | None = None
    tested: Tested | None = None
    whose: str = ""


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
    legend: list[Any] = regions(axes, chart, view)
    if part == "amplitude":  # the fall covers the colours of what sticks
        legend = amplitudes(figure, axes, chart, view)
    else:
        legend += falls(axes, chart, view)
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
    _legend(figure, legend)
    return figure


def _legend(figure: Figure, handles: list[Any]) -> None:
    figure.legend(
        handles=handles, loc="outside lower center", ncols=2, fontsize=FONT - 1, handlelength=2.0, columnspacing=1.2
    )


def _boundary(
    axes: Axes, chart: Chart, boundary: Boundary, view: MapView, colour: str, words: str, known: KnownCovariance | None
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


def _closed_forms(axes: Axes, chart: Chart, view: MapView) -> list[Any]:
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


def _untested(axes: Axes, chart: Chart, view: MapView, tested: Tested | None) -> list[Any]:
    """The outline of the tested range: what lies outside is most of many a map, and stays readable."""
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
    if np.all(outside):
        return [Line2D([], [], ls="", label="extrapolated: nothing here was tested")]
    axes.contour(
        *coordinates, outside.astype(float), levels=[0.5], colors=TESTED, linewidths=0.9, linestyles="-.", zorder=3.2
    )
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
    ring = None if marks.known is None else region(chart.plane, marks.known)
    if ring is not None:
        axes.plot(*view.shown(ring).T, color="k", lw=0.9, zorder=5)
        legend.append(Line2D([], [], color="k", lw=0.9, label="its 95 % region"))
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


# ----------------------------------------------------------------------------------------------------------------------
# Over one quantity: forces, timing and what decides about stability.
# ----------------------------------------------------------------------------------------------------------------------


def draw_continuation(answer: Continuation, path: File, part: str = "stability") -> None:
    """Draw a continuation: force levels above, and growth rate and multiplier ("stability") or period below.

    Raises:
        OSError: the file cannot be written.
    """
    with drawing_style(), atomic_path(path) as temporary:
        continuation_figure(answer, part).savefig(temporary, dpi=DPI)


def continuation_figure(answer: Continuation, part: str = "stability") -> Figure:
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


def _shaded(axes: Axes, answer: Continuation, x: Array) -> list[Any]:
    """Colours by outcome, changing half way between two values that differ, or where the change was found."""
    found = np.sort([change.value for change in (*answer.ends, *answer.losses)]) * x[0] / answer.values[0]
    start, legend = x[0], []
    for i in range(x.size):
        if i + 1 < x.size and answer.outcomes[i + 1] == answer.outcomes[i]:
            continue
        stop = x[-1]
        if i + 1 < x.size:
            between = found[(found > x[i]) & (found < x[i + 1])]
            stop = between[0] if between.size == 1 else 0.5 * (x[i] + x[i + 1])
        word = str(answer.outcomes[i])
        colour, text = REGIONS[word]
        axes.axvspan(start, stop, color=colour, lw=0, zorder=0)
        legend.append((word, Patch(facecolor=colour, label=LEGENDS.get(word, text.replace("\n", " ")))))
        start = stop
    return list(dict(legend).values())


def _forces(axes: Axes, answer: Continuation, x: Array) -> list[Any]:
    unit = scale_for(float(np.nanmax(answer.sliding_force)), "N")
    rows = (
        (answer.figures["onset_force"], ONSET, "-", "force at the onset of slip"),
        (answer.figures["arrest_force"], ARREST, "-", "force at its end"),
        (answer.sliding_force, "0.25", "--", "force of steady sliding"),
    )
    for values, colour, style, _ in rows:
        axes.plot(x, values / unit.factor, color=colour, ls=style, lw=1.1)
    axes.set_ylabel(f"force [{unit.unit}]", fontsize=FONT + 0.5)
    return [Line2D([], [], color=colour, ls=style, lw=1.1, label=words) for _, colour, style, words in rows]


def _decisive(axes: Axes, answer: Continuation, x: Array) -> list[Any]:
    """Growth rate of steady sliding on the left, largest multiplier of stick-slip on the right."""
    axes.plot(x, answer.eigenvalues[:, 0].real, color=SLIDES, lw=1.1)
    axes.axhline(0.0, color=SLIDES, lw=0.6)
    axes.set_ylabel("growth rate of sliding [1/s]", fontsize=FONT + 0.5)
    right = axes.twinx()
    right.plot(x, np.abs(answer.multipliers[:, 0]), color=STICKS, lw=1.1, ls="-.")
    right.set_ylim(0.0, 1.05)
    right.set_ylabel("largest |multiplier| of stick-slip", fontsize=FONT + 0.5)
    right.tick_params(labelsize=FONT)
    right.grid(False)
    right.spines["right"].set_visible(True)
    return [
        Line2D([], [], color=SLIDES, lw=1.1, label="growth rate (left)"),
        Line2D([], [], color=STICKS, lw=1.1, ls="-.", label="multiplier (right)"),
    ]


def _timing(axes: Axes, answer: Continuation, x: Array) -> list[Any]:
    period, slip = answer.figures["period"], answer.figures["slip_duration"]
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
