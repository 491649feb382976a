"""The cycles of all logs as they were measured, whatever a fit says: how they scatter, and what they follow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from identify.base.outcome import LogCurves
from identify.report.quantity_text import scale_for
from identify.report.style import ARREST, FITTED, ONSET, QUIET, RESIDUAL, SLIDING, WIDE, Drawing, frame

FEWEST = 3  # cycles that a log must show
BINS = 14
COLOURS = (ONSET, SLIDING, FITTED, ARREST, RESIDUAL, QUIET)

Array = NDArray[np.float64]


def draw_measured(logs: Sequence[LogCurves]) -> Drawing | None:
    """Histograms of strength, drop and hold time, strength against hold time, mean coefficient against drive speed.

    Strength: friction over normal force at the onset; hold time: from an arrest to the next onset. None where no log
    shows `FEWEST` cycles.
    """
    seen = [(number, log, _cycles(log)) for number, log in enumerate(logs, 1) if len(log.cycles) >= FEWEST]
    if not seen:
        return None
    figure = Figure(figsize=(WIDE, 2.3))
    grid = figure.add_gridspec(1, 5, left=0.045, right=0.992, top=0.86, bottom=0.21, wspace=0.34)
    axes = [figure.add_subplot(grid[0, column]) for column in range(5)]
    for place, (column, unit, name) in enumerate(((0, "", "strength"), (1, "N", "drop"), (2, "s", "hold time"))):
        _histogram(axes[place], [cycles[:, column] for _, _, cycles in seen], unit, name)
    for place, (number, _, cycles) in enumerate(seen):
        colour = COLOURS[place % len(COLOURS)]
        axes[3].plot(cycles[:, 2], cycles[:, 0], ".", color=colour, markersize=4, label=f"log {number}")
    _logarithmic(axes[3])
    frame(axes[3], "hold time (s)", "", "strength (1)")
    axes[3].legend(fontsize=6.5, handletextpad=0.1, borderaxespad=0.1)
    speeds = np.array([abs(log.drive_speed) for _, log, _ in seen])
    means = np.array([_mean_coefficient(log) for _, log, _ in seen])
    axes[4].plot(1e3 * speeds, means, "o", color=SLIDING, markersize=4)
    if np.all(speeds > 0.0):
        _logarithmic(axes[4])
    frame(axes[4], "drive speed (mm/s)", "", "mean coefficient (1)")
    together = np.concatenate([np.column_stack([np.full(len(c), n), c]) for n, _, c in seen])
    return Drawing(
        name="measured",
        figure=figure,
        alt=f"How the {len(together)} measured cycles of {len(seen)} logs scatter, and what strength and mean follow.",
        caption="The cycles as measured, without a model. Strength: friction over normal force at the onset; hold "
        "time: from an arrest to the next onset. A strength that rises with the hold time is contact ageing; one that "
        "scatters at equal hold times is a surface that differs from place to place.",
        wide=True,
        tables={
            "measured_cycles": dict(zip(("log", "strength", "drop_N", "hold_s"), together.T, strict=True)),
            "measured_means": {"drive_speed_m_per_s": speeds, "mean_coefficient": means},
        },
    )


def _cycles(log: LogCurves) -> Array:
    """Strength, drop [N] and hold time [s] (NaN of the first) of every cycle, (c, 3)."""
    onset, arrest, peak, valley, _ = log.cycles.T
    load = np.interp(onset, log.time, log.normal_force)
    return np.column_stack([peak / load, peak - valley, np.append(np.nan, onset[1:] - arrest[:-1])])


def _mean_coefficient(log: LogCurves) -> float:
    """Friction over normal force, mean from the first onset to the last."""
    inside = log.used & (log.time >= log.cycles[0, 0]) & (log.time <= log.cycles[-1, 0])
    return float(np.nanmean(log.friction_force[inside] / log.normal_force[inside])) if inside.any() else np.nan


def _logarithmic(axes: Axes) -> None:
    """A logarithmic x axis with plain numbers: the style of the report takes no formulas."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(numticks=5))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def _histogram(axes: Axes, values: Sequence[Array], unit: str, name: str) -> None:
    finite = [part[np.isfinite(part)] for part in values]
    scale = scale_for(float(np.median(np.concatenate(finite))), unit)
    axes.hist(
        [part / scale.factor for part in finite],
        bins=BINS,
        stacked=True,
        color=[COLOURS[place % len(COLOURS)] for place in range(len(finite))],
    )
    frame(axes, f"{name} ({scale.unit or '1'})", "", "cycles")
    axes.locator_params(axis="y", nbins=4, integer=True)
    axes.locator_params(axis="x", nbins=4)
