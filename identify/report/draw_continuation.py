"""Stick-slip and steady sliding over one quantity as a picture: forces, timing and what decides about stability."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from data_io.atomic import atomic_path
from identify.prediction.continuation import Continuation
from identify.report.draw_map import DPI, SLIDES, STICKS
from identify.report.map_parts import FONT, LEGENDS, REGIONS, ticks_in_powers
from identify.report.quantity_text import scale_for
from identify.report.style import ARREST, ONSET, drawing_style

Array = NDArray[np.float64]

SIZE = (3.54, 4.6)  # inch


def draw_continuation(answer: Continuation, path: Path, part: str = "stability") -> None:
    """Draw a continuation: force levels above, and growth rate and multiplier ("stability") or period below.

    Raises:
        OSError: the file cannot be written.
    """
    with drawing_style():
        figure = continuation_figure(answer, part)
        with atomic_path(path) as temporary:
            figure.savefig(temporary, dpi=DPI)


def continuation_figure(answer: Continuation, part: str = "stability") -> Figure:
    """The same as a figure; inside `drawing_style`."""
    figure = Figure(figsize=SIZE, layout="constrained")
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
    figure.legend(
        handles=legend, loc="outside lower center", ncols=2, fontsize=FONT - 1, handlelength=2.0, columnspacing=1.2
    )
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
