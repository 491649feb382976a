"""The cycles of all logs, fitted, measured and uneven ones: how they scatter, and what they follow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from identify.base.outcome import LogCurves
from identify.base.result import StrengthCurve, UnevenCycles, UnevenResult
from identify.base.wording import number, scale_for
from identify.report.style import (
    ARREST,
    BEHIND,
    FITTED,
    ONSET,
    QUIET,
    RESIDUAL,
    SHADE,
    SLIDING,
    WIDE,
    Drawing,
    extremes,
    frame,
    headroom,
    logarithmic,
)

FEWEST = 3  # cycles that a log must show
BINS = 14
NARROWEST = 1e-3  # of the value: least width of a histogram
MEASURED = (
    *("log", "cycle", "onset_s", "arrest_s", "onset_force_N", "arrest_force_N"),
    *("strength", "drop_N", "hold_s"),
)
COLOURS = (ONSET, SLIDING, FITTED, ARREST, RESIDUAL, QUIET)

Array = NDArray[np.float64]


def draw_measured(logs: Sequence[LogCurves]) -> Drawing | None:
    """Histograms of strength, drop and hold time, strength against hold time, mean coefficient against drive speed.

    Strength: friction over normal force at the onset; hold time: from an arrest to the next onset. None where no log
    shows `FEWEST` cycles.
    """
    seen = [(number, log, _cycles(log)) for number, log in enumerate(logs, 1) if len(log.measured) >= FEWEST]
    if not seen:
        return None
    figure = Figure(figsize=(WIDE, 2.3))
    grid = figure.add_gridspec(1, 5, left=0.045, right=0.992, top=0.86, bottom=0.21, wspace=0.34)
    axes = [figure.add_subplot(grid[0, column]) for column in range(5)]
    for place, (column, unit, name) in enumerate(((0, "", "strength"), (1, "N", "drop"), (2, "s", "hold time"))):
        _histogram(axes[place], [cycles[:, column] for _, _, cycles in seen], unit, name)
    for place, (log, _, cycles) in enumerate(seen):
        colour = COLOURS[place % len(COLOURS)]
        axes[3].plot(cycles[:, 2], cycles[:, 0], ".", color=colour, markersize=4, label=f"log {log}")
    logarithmic(axes[3])
    frame(axes[3], "hold time (s)", "", "strength (1)")
    axes[3].legend(fontsize=6.5, handletextpad=0.1, borderaxespad=0.1)
    speeds = np.array([abs(log.drive_speed) for _, log, _ in seen])
    means = np.array([_mean_coefficient(log) for _, log, _ in seen])
    axes[4].plot(1e3 * speeds, means, "o", color=SLIDING, markersize=4)
    if np.all(speeds > 0.0):
        logarithmic(axes[4])
    frame(axes[4], "drive speed (mm/s)", "", "mean coefficient (1)")
    return Drawing(
        name="measured",
        figure=figure,
        alt=f"How the {sum(len(c) for _, _, c in seen)} measured cycles of {len(seen)} logs scatter, and what strength "
        "and mean follow.",
        caption="The cycles as measured, without a model. Strength: friction over normal force at the onset; hold "
        "time: from an arrest to the next onset. A strength that rises with the hold time is contact ageing; one that "
        "scatters at equal hold times is a surface that differs from place to place.",
        wide=True,
        tables={
            "measured_means": {"drive_speed_m_per_s": speeds, "mean_coefficient": means},
        },
    )


def _cycles(log: LogCurves) -> Array:
    """Strength, drop [N] and hold time [s] (NaN of the first) of every cycle, (c, 3)."""
    onset, arrest, peak, valley = log.measured.T
    load = np.interp(onset, log.time, log.normal_force)
    return np.column_stack([peak / load, peak - valley, np.append(np.nan, onset[1:] - arrest[:-1])[: onset.size]])


def measured_cycles(logs: Sequence[LogCurves]) -> dict[str, Array]:
    """The cycles of all logs as they were measured, by column: of a fit that was accepted and of one that was not."""
    rows = [
        np.column_stack(
            [np.full(len(log.measured), n), np.arange(1, len(log.measured) + 1), log.measured, _cycles(log)]
        )
        for n, log in enumerate(logs, 1)
    ]
    table = np.concatenate(rows) if rows else np.empty((0, len(MEASURED)))
    return dict(zip(MEASURED, table.T, strict=True))


def _mean_coefficient(log: LogCurves) -> float:
    """Friction over normal force, mean from the first onset to the last."""
    inside = log.used & (log.time >= log.measured[0, 0]) & (log.time <= log.measured[-1, 0])
    return float(np.nanmean(log.friction_force[inside] / log.normal_force[inside])) if inside.any() else np.nan


def _histogram(axes: Axes, values: Sequence[Array], unit: str, name: str) -> None:
    finite = [part[np.isfinite(part)] for part in values]
    together = np.concatenate(finite)
    if not together.size:  # without a load there is no strength
        frame(axes, name, "", "cycles")
        return
    scale = scale_for(float(np.median(together)), unit)
    low, high = float(together.min()), float(together.max())
    wider = max(0.0, NARROWEST * abs(high) - (high - low)) / 2  # cycles may be alike but for rounding
    axes.hist(
        [part / scale.factor for part in finite],
        bins=BINS,
        range=((low - wider) / scale.factor, (high + wider) / scale.factor),
        stacked=True,
        color=[COLOURS[place % len(COLOURS)] for place in range(len(finite))],
    )
    frame(axes, f"{name} ({scale.unit or '1'})", "", "cycles")
    axes.locator_params(axis="y", nbins=4, integer=True)
    axes.locator_params(axis="x", nbins=4)


# ----------------------------------------------------------------------------------------------------------------------
# Uneven records: onsets and the slow level along a record, and strength against rest.
# ----------------------------------------------------------------------------------------------------------------------


def draw_uneven(uneven: UnevenResult) -> Iterator[tuple[int, Drawing]]:
    """One figure per log that the estimator of uneven records took, with the number of the log (from 1)."""
    for cycles in uneven.uneven_cycles:
        yield cycles.log, _draw(cycles, uneven.strength_against_rest)


def _draw(cycles: UnevenCycles, curve: StrengthCurve | None) -> Drawing:
    names = ("cycle", "onset_s", "rest_s", "onset", "drop", "strength", "level")
    column = {name: np.array(getattr(cycles, name), dtype=np.float64) for name in names}
    figure = Figure(figsize=(WIDE, 3.0))
    grid = figure.add_gridspec(1, 2, width_ratios=(1.9, 1.0), left=0.06, right=0.992, top=0.9, bottom=0.16, wspace=0.18)
    along = figure.add_subplot(grid[0, 0])
    time = column["onset_s"]
    along.vlines(time, column["onset"] - column["drop"], column["onset"], color=BEHIND, linewidth=0.8)
    along.plot(time, column["onset"], "o", color=ONSET, markersize=3.4, label="onset")
    along.plot(time, column["onset"] - column["drop"], "o", color=ARREST, markersize=2.6, label="arrest")
    along.plot(time, column["level"], color=FITTED, linewidth=1.1, label="slow level")
    headroom(along, 0.12)
    along.legend(loc="upper left", ncols=4)
    frame(along, "time (s)", "", "friction over load")
    against = figure.add_subplot(grid[0, 1])
    if curve is not None:
        against.fill_between(curve.rest_s, curve.lower, curve.upper, color=SHADE, linewidth=0)
        against.plot(curve.rest_s, curve.strength, color=FITTED, label="usual strength, 95 % band")
        against.legend(loc="upper right")
    against.plot(column["rest_s"], column["strength"], "o", color=ONSET, markersize=3.2)
    headroom(against, 0.1)
    against.set_ylim(bottom=0.0)
    against.set_xlim(left=0.0)
    frame(against, "rest before the slip (s)", "", "strength over load")
    return Drawing(
        name=f"log_{cycles.log}_uneven",
        figure=figure,
        alt=f"Onsets, arrests and slow level of the {time.size} cycles of log {cycles.log}, and their strengths "
        "against the rest before them.",
        caption="Left: friction over the load at onsets and arrests, and the slow level that the cycles follow. Right: "
        "strength of every stick "
        "(onset above the slow level) against its rest; line and band: the usual strength, within the rests seen. A "
        "stick is long because the spot was strong, so the points rise more steeply than the line.",
        wide=True,
        tables={f"log_{cycles.log}_uneven": column},
    )


# ----------------------------------------------------------------------------------------------------------------------
# Cycle-to-cycle scatter of one log: onset force, drop, period and misfit by cycle.
# ----------------------------------------------------------------------------------------------------------------------

MOST_POINTS = 600


def draw_cycles(curves: LogCurves, position: int, accepted: bool = True) -> Drawing:
    """Scatter by cycle of log number `position` (from 1); the log has at least one cycle.

    Args:
        accepted: the cycles are those of the fitted motion, where there is one, else as they were measured.
    """
    onset, arrest, peak, valley, misfit = curves.cycles.T
    count = len(onset)
    what = "of the motion as fitted" if accepted and np.isfinite(misfit).any() else "as measured"
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
