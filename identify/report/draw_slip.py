"""One typical slip as the fitted model reconstructs it, and its phase plane (figure 3 of the paper)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from identify.base.outcome import LogCurves, SlipDetail
from identify.base.wording import scale_for
from identify.report.style import (
    ARREST,
    FITTED,
    HALF,
    MEASURED,
    ONSET,
    QUIET,
    SLIDING,
    Columns,
    Drawing,
    extremes,
    frame,
    headroom,
    padded,
)

MOST_POINTS = 500
HEIGHT = 4.7  # of both figures [inch], so that they stand well beside each other

Array = NDArray[np.float64]


def sliding_range(slip: SlipDetail) -> tuple[int, int] | None:
    """First and last index of the fine grid at which the surfaces slide, or None where they never do."""
    sliding = np.flatnonzero(slip.sliding_speed > 0)
    return (max(int(sliding[0]) - 1, 0), min(int(sliding[-1]) + 1, len(slip.time) - 1)) if len(sliding) else None


def draw_slip(curves: LogCurves, slip: SlipDetail, position: int, accepted: bool) -> Drawing:
    """Force, sliding speed, gamma and friction coefficient of one slip of log number `position` (from 1)."""
    moving = sliding_range(slip)
    origin = float(slip.time[moving[0]]) if moving else float(slip.time[0])
    clock = scale_for(float(np.ptp(slip.time)), "s")
    time = (slip.time - origin) / clock.factor
    pace = scale_for(float(np.nanmax(slip.sliding_speed)), "m/s")
    panels: list[tuple[Array, str, str]] = [
        (slip.force, "force (N)", FITTED),
        (slip.sliding_speed / pace.factor, f"speed ({pace.unit})", SLIDING),
        (slip.coefficient, "coefficient (1)", ONSET),
    ]
    if np.isfinite(slip.gamma).any():
        panels.insert(2, (slip.gamma, "contact γ (1)", ARREST))
    figure = Figure(figsize=(HALF, HEIGHT))
    grid = figure.add_gridspec(
        len(panels), 1, height_ratios=[1.7] + [1] * (len(panels) - 1), left=0.145, right=0.985, top=0.94, bottom=0.1
    )
    measured = _measured(curves, slip, origin, clock.factor)
    for row, (values, label, colour) in enumerate(panels):
        axes = figure.add_subplot(grid[row, 0])
        if row == 0 and measured is not None:
            style = {"marker": ".", "markersize": 3.5, "linestyle": "none", "color": MEASURED}
            axes.plot(*measured, label="measured", **style)  # type: ignore[arg-type]
        axes.plot(
            time, values, color=colour, linewidth=1.3, label=None if row else "fitted" if accepted else "last iterate"
        )
        _limits(axes, time, values, moving)
        last = row == len(panels) - 1
        frame(axes, f"time from onset ({clock.unit})" * last, label, "" if row else f"slip of cycle {slip.cycle}")
        if row == 0:
            axes.legend(loc="upper right", handlelength=1.2, borderaxespad=0.1)
    return Drawing(
        name=f"log_{position}_slip",
        figure=figure,
        alt=f"Force, sliding speed, contact age and friction coefficient over time in one slip of log {position}.",
        caption="A typical slip: measured force and what the fitted model says happened. "
        "Dotted lines: onset and arrest.",
        wide=False,
        tables=_tables(curves, slip, position),
    )


def draw_phase_plane(curves: LogCurves, slip: SlipDetail, position: int) -> Drawing:
    """Elongation against its rate (drive speed minus sliding speed): figure 3 of the paper, for log `position`."""
    drive = curves.drive_speed if np.isfinite(curves.drive_speed) else 0.0
    rate = drive - slip.sliding_speed
    along = scale_for(float(np.nanmax(np.abs(slip.elongation))), "m")
    pace = scale_for(float(np.nanmax(np.abs(rate))), "m/s")
    x, y = slip.elongation / along.factor, rate / pace.factor
    figure = Figure(figsize=(HALF, HEIGHT))
    axes = figure.add_axes((0.145, 0.10, 0.84, 0.84))
    axes.axhline(drive / pace.factor, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.plot(x, y, color=SLIDING, linewidth=1.4)
    moving = sliding_range(slip)
    if moving:
        first, last = moving
        _arrows(axes, x[first : last + 1], y[first : last + 1])
        for index, marker, colour, label in ((first, "v", ONSET, "onset"), (last, "^", ARREST, "arrest")):
            axes.plot(x[index], y[index], marker=marker, markersize=7, color=colour, linestyle="none", label=label)
        axes.legend(loc="lower right", borderaxespad=0.2)
    headroom(axes, 0.06)
    axes.locator_params(nbins=6)
    frame(axes, f"spring elongation ({along.unit})", f"elongation rate ({pace.unit})", "phase plane")
    return Drawing(
        name=f"log_{position}_phase_plane",
        figure=figure,
        alt=f"Phase plane of one slip of log {position}: spring elongation against its rate, onset to arrest.",
        caption="Phase plane of the same slip. Dashed: the surfaces stick and the elongation grows at the drive speed"
        + ("." if drive else " (not constant here: the rate shown is minus the sliding speed)."),
        wide=False,
        tables={
            f"log_{position}_phase_plane": {"elongation_m": slip.elongation, "elongation_rate_m_per_s": rate},
        },
    )


def _measured(curves: LogCurves, slip: SlipDetail, origin: float, unit: float) -> tuple[Array, Array] | None:
    if not len(slip.samples):
        return None
    force = curves.friction_force[slip.samples]
    chosen = extremes(force, MOST_POINTS // 2)
    return (curves.time[slip.samples][chosen] - origin) / unit, force[chosen]


def _limits(axes: Axes, time: Array, values: Array, moving: tuple[int, int] | None) -> None:
    padded(axes, values)
    axes.set_xlim(float(time[0]), float(time[-1]))
    axes.locator_params(axis="y", nbins=3)
    axes.locator_params(axis="x", nbins=6)
    for index in moving or ():
        axes.axvline(float(time[index]), color=QUIET, linewidth=0.8, linestyle=(0, (1, 2)))


def _arrows(axes: Axes, x: Array, y: Array) -> None:
    """Two heads that show which way the loop is run through, placed by length along the drawn curve."""
    spans = np.ptp(x) or 1.0, np.ptp(y) or 1.0
    length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x) / spans[0], np.diff(y) / spans[1]))])
    for share in (0.25, 0.75):
        index = int(np.clip(np.searchsorted(length, share * length[-1]), 1, len(x) - 1))
        axes.annotate(
            "",
            xy=(float(x[index]), float(y[index])),
            xytext=(float(x[index - 1]), float(y[index - 1])),
            arrowprops={"arrowstyle": "-|>", "color": SLIDING, "linewidth": 1.2, "mutation_scale": 13},
        )


def _tables(curves: LogCurves, slip: SlipDetail, position: int) -> dict[str, Columns]:
    fine: Columns = {
        "time_s": slip.time,
        "force_N": slip.force,
        "elongation_m": slip.elongation,
        "sliding_speed_m_per_s": slip.sliding_speed,
        "gamma": slip.gamma,
        "coefficient": slip.coefficient,
    }
    measured: Columns = {
        "time_s": curves.time[slip.samples],
        "measured_N": curves.friction_force[slip.samples],
        "fitted_N": curves.fitted_force[slip.samples],
    }
    return {f"log_{position}_slip": fine, f"log_{position}_slip_measured": measured}
