"""Cycle-to-cycle scatter of one log: onset force, drop, period and misfit by cycle."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from identify.base.outcome import LogCurves
from identify.report.envelope import extremes
from identify.report.quantity_text import number, scale_for
from identify.report.style import ARREST, FITTED, ONSET, QUIET, SHADE, SLIDING, WIDE, Drawing, frame, headroom

MOST_POINTS = 600

Array = NDArray[np.float64]


def draw_cycles(curves: LogCurves, position: int, accepted: bool = True) -> Drawing:
    """Scatter by cycle of log number `position` (from 1); the log has at least one cycle.

    Args:
        accepted: the cycles are those of the fitted motion, else as they were measured.
    """
    onset, arrest, peak, valley, misfit = curves.cycles.T
    count = len(onset)
    what = "of the motion as fitted" if accepted else "as measured"
    period = np.append(np.diff(onset), np.nan)
    panels: list[tuple[Array, str, str, str]] = [
        (peak, "N", "onset force", ONSET),
        (peak - valley, "N", "drop", ARREST),
        (period, "s", "period", SLIDING),
    ]
    if np.isfinite(misfit).any():
        panels.append((misfit, "", "misfit z", FITTED))
    figure = Figure(figsize=(WIDE, 2.0))
    grid = figure.add_gridspec(1, len(panels), left=0.045, right=0.992, top=0.86, bottom=0.215, wspace=0.24)
    for column, (values, unit, name, colour) in enumerate(panels):
        axes = figure.add_subplot(grid[0, column])
        _scatter(axes, values, unit, name, colour)
        axes.set_xlim(0, count + 1)
    return Drawing(
        name=f"log_{position}_cycles",
        figure=figure,
        alt=f"Onset force, drop, period and misfit of each of the {count} cycles of log {position}.",
        caption=f"Scatter from cycle to cycle {what}; line and band: mean ± standard deviation. "
        "A fit of one set of parameters takes all cycles as alike: "
        "scatter or a trend far above the noise says that the friction itself changed."
        + (" Misfit z: how far a cycle's residual is from pure noise, in its standard deviations." * (len(panels) > 3)),
        wide=True,
        tables={
            f"log_{position}_cycles": {
                "cycle": np.arange(1, count + 1),
                "onset_s": onset,
                "arrest_s": arrest,
                "onset_force_N": peak,
                "arrest_force_N": valley,
                "drop_N": peak - valley,
                "period_s": period,
                "misfit_z": misfit,
            }
        },
    )


def _scatter(axes: Axes, values: Array, unit: str, name: str, colour: str) -> None:
    finite = values[np.isfinite(values)]
    if not len(finite):
        axes.text(0.5, 0.5, "no complete cycle", ha="center", va="center", transform=axes.transAxes, color=QUIET)
        frame(axes, "cycle", "", name)
        return
    scale = scale_for(float(np.median(finite)), unit)
    mean, spread = float(finite.mean()) / scale.factor, float(finite.std(ddof=min(1, len(finite) - 1))) / scale.factor
    if unit:
        axes.axhspan(mean - spread, mean + spread, color=SHADE, linewidth=0)
        axes.axhline(mean, color=QUIET, linewidth=0.8)
    else:
        axes.axhline(0, color=QUIET, linewidth=0.8)
    chosen = extremes(values, MOST_POINTS // 2)
    axes.plot(
        chosen + 1, values[chosen] / scale.factor, color=colour, linestyle="none", marker="o", markersize=3.2, alpha=0.9
    )
    low, high = axes.get_ylim()
    narrowest = 0.04 * abs(mean)
    if unit and high - low < narrowest:  # scatter far below the level is shown as small, not blown up
        axes.set_ylim(mean - narrowest / 2, mean + narrowest / 2)
    headroom(axes, 0.04)
    frame(axes, "cycle", "", f"{name} ({scale.unit or '1'})")
    if unit and mean:
        note = f"SD {number(100 * spread / abs(mean), 2)} %"
        axes.set_title(note, loc="right", fontweight="normal", color=QUIET, y=1.0, pad=5)
    axes.locator_params(axis="y", nbins=4)
    axes.locator_params(axis="x", nbins=6, integer=True)
