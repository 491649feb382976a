"""Measured against fitted force of one log, with residuals and a close-up; before a fit, the start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from data_io.notebook_figure import NotebookFigure
from identify.base.outcome import LogCurves
from identify.base.wording import speed
from identify.estimation.preview import Preview, PreviewLog
from identify.report.style import (
    ARREST,
    BEHIND,
    FITTED,
    MEASURED,
    ONSET,
    QUIET,
    RESIDUAL,
    WIDE,
    Columns,
    Drawing,
    Envelope,
    envelope,
    extremes,
    frame,
    headroom,
    padded,
    printable,
)

OVERVIEW_STRETCHES, CLOSEUP_STRETCHES = 560, 300
MOST_MARKS = 120
CYCLES_IN_CLOSEUP = 3
CUT_WORDS = {
    "window": "outside the window",
    "exclude": "left out",
    "skip_cycles": "running-in",
    "lead": "before the fit",
    "tare": "tare",
}
RAW_COLOUR = "#d9b98c"
LETTER = 0.0095  # width of a letter of a label, as share of the picture
TARE_COLOUR = "#7fb3c8"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ForceView:
    """The signals of a stretch of a log, thinned for drawing; `fitted` and `residual` are None without a fit, `raw`
    where nothing was corrected."""

    measured: Envelope
    normal: Envelope
    fitted: Envelope | None
    residual: Envelope | None
    raw: Envelope | None = None

    def columns(self) -> Columns:
        """The drawn data, for the CSV behind the figure."""
        table: dict[str, Array] = {"time_s": self.measured.time}
        signals = {"measured": self.measured, "fitted": self.fitted, "residual": self.residual, "normal": self.normal}
        signals["raw"] = self.raw
        for name, signal in signals.items():
            if signal is None:
                continue
            if signal.exact:
                table[f"{name}_N"] = signal.lower
            else:
                table[f"{name}_lowest_N"], table[f"{name}_highest_N"] = signal.lower, signal.upper
        return table


def view(curves: LogCurves, start: int, stop: int, stretches: int) -> ForceView:
    """The samples [start, stop) of a log in so many stretches."""
    time = curves.time[start:stop]

    def thin(values: Array) -> Envelope:
        return envelope(time, values[start:stop], stretches)

    fitted = bool(np.isfinite(curves.fitted_force[start:stop]).any())
    return ForceView(
        measured=thin(curves.friction_force),
        normal=thin(curves.normal_force),
        fitted=thin(curves.fitted_force) if fitted else None,
        residual=thin(curves.friction_force - curves.fitted_force) if fitted else None,
        raw=None if curves.raw_force is None else thin(curves.raw_force),
    )


def closeup_range(curves: LogCurves) -> tuple[int, int] | None:
    """Samples [start, stop) of a few cycles about the typical slip, or None where the whole log shows as much."""
    onsets = curves.cycles[:, 0]
    if len(onsets) < 2 * CYCLES_IN_CLOSEUP:
        return None
    middle = float(curves.slip.time.mean()) if curves.slip is not None else float(onsets[len(onsets) // 2])
    period = float(np.median(np.diff(onsets)))
    half = 0.5 * CYCLES_IN_CLOSEUP * period
    start, stop = np.searchsorted(curves.time, [middle - half, middle + half])
    return (int(start), int(stop)) if stop - start >= 8 else None


def draw_force(curves: LogCurves, position: int, accepted: bool) -> Drawing:
    """The figure of log number `position` (from 1); `accepted` says whether the fitted curve passed the gate."""
    whole, near = view(curves, 0, len(curves.time), OVERVIEW_STRETCHES), closeup_range(curves)
    fitted = whole.fitted is not None
    heights = [3.0, 1.15, 0.75] if fitted else [3.0, 0.75]
    height = 0.78 + 0.72 * sum(heights)
    figure = NotebookFigure(figsize=(WIDE, height))
    grid = figure.add_gridspec(
        len(heights),
        2 if near else 1,
        height_ratios=heights,
        width_ratios=[2.1, 1] if near else [1],
        left=0.062,
        right=0.98,
        top=1 - 0.32 / height,
        bottom=0.46 / height,
        hspace=0.14,
        wspace=0.115,
    )
    tables = {f"log_{position}_force": whole.columns()}
    _fill_column(
        [figure.add_subplot(grid[row, 0]) for row in range(len(heights))], whole, curves, accepted, "whole log"
    )
    if near:
        closer = view(curves, *near, CLOSEUP_STRETCHES)
        tables[f"log_{position}_force_closeup"] = closer.columns()
        axes = [figure.add_subplot(grid[row, 1]) for row in range(len(heights))]
        _fill_column(axes, closer, curves, accepted, "close-up", span=(curves.time[near[0]], curves.time[near[1] - 1]))
    what = "Measured and fitted friction force with residuals" if fitted else "Measured friction force with its cycles"
    return Drawing(
        name=f"log_{position}_force",
        figure=figure,
        alt=f"{what}, and normal force, of log {position} over time; {len(curves.cycles)} cycles are marked.",
        caption=_caption(whole, fitted, accepted, curves),
        wide=True,
        tables=tables,
    )


def _fill_column(
    axes: list[Axes],
    seen: ForceView,
    curves: LogCurves,
    accepted: bool,
    title: str,
    span: tuple[float, float] | None = None,
) -> None:
    overview = span is None
    low, high = span or (float(curves.time[0]), float(curves.time[-1]))
    force, normal = axes[0], axes[-1]
    force.locator_params(axis="y", nbins=6)
    if seen.raw is not None:
        _band(force, seen.raw, RAW_COLOUR, "as read", 0.8)
    _band(force, seen.measured, BEHIND if seen.fitted else MEASURED, "measured", 2.4 if seen.fitted else 0.9)
    if seen.fitted is not None:
        _band(force, seen.fitted, FITTED, "fitted" if accepted else "last iterate (not accepted)")
    shown = [seen.measured] if seen.raw is None else [seen.measured, seen.raw]
    padded(force, np.concatenate([end for signal in shown for end in (signal.lower, signal.upper)]))
    headroom(force, 0.16 if seen.raw is None else 0.26)
    _marks(force, curves, low, high)
    frame(force, "", "friction force (N)" if overview else "", title)
    if overview:
        force.legend(
            loc="upper right",
            ncols=4 if seen.raw is None else 3,
            handlelength=1.4,
            columnspacing=1.3,
            borderaxespad=0.1,
        )
    if seen.residual is not None:
        _residuals(axes[1], seen.residual, curves.noise, overview)
    _band(normal, seen.normal, QUIET, "normal", 0.6)
    padded(normal, np.concatenate([seen.normal.lower, seen.normal.upper]), 0.3)
    normal.locator_params(axis="y", nbins=3)
    frame(normal, "time (s)", "Fₙ (N)" if overview else "")
    _cuts(force, curves, low, high, labelled=overview)
    for panel in axes:
        panel.set_xlim(low, high)
        panel.locator_params(axis="x", nbins=8 if overview else 4)
        _shade_unused(panel, curves, low, high)


def _band(axes: Axes, signal: Envelope, colour: str, label: str, width: float = 0.9) -> None:
    """The samples as a line, or the range of each stretch as a filled band with an edge that stays visible."""
    if signal.exact:
        axes.plot(signal.time, signal.lower, color=colour, linewidth=width, label=label)
        return
    axes.fill_between(
        signal.time,
        signal.lower,
        signal.upper,
        where=np.isfinite(signal.lower).tolist(),
        color=colour,
        linewidth=width,
        label=label,
    )


def _residuals(axes: Axes, residual: Envelope, noise: float, labelled: bool) -> None:
    scaled = Envelope(residual.time, 1e3 * residual.lower, 1e3 * residual.upper, residual.per_stretch)
    _band(axes, scaled, RESIDUAL, "residual", 0.6)
    for level in (-2e3 * noise, 2e3 * noise) if np.isfinite(noise) else ():
        axes.axhline(level, color=MEASURED, linewidth=0.9, linestyle=(0, (4, 2)), zorder=3)
    values = np.concatenate([scaled.lower, scaled.upper])
    limit = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 1.0
    limit = max(limit, 3e3 * noise if np.isfinite(noise) else 0.0, 1e-9)
    axes.set_ylim(-1.1 * limit, 1.1 * limit)
    axes.locator_params(axis="y", nbins=4)
    frame(axes, "", "residual (mN)" if labelled else "")


def _marks(axes: Axes, curves: LogCurves, low: float, high: float) -> None:
    """Onsets and arrests; where there are too many for the picture, an even choice of them with every extreme."""
    for time, force, marker, colour, label in (
        (curves.cycles[:, 0], curves.cycles[:, 2], "v", ONSET, "onset"),
        (curves.cycles[:, 1], curves.cycles[:, 3], "^", ARREST, "arrest"),
    ):
        inside = np.flatnonzero((time >= low) & (time <= high) & np.isfinite(force))
        if not len(inside):
            continue
        chosen = inside[extremes(force[inside], MOST_MARKS // 2)]
        axes.plot(
            time[chosen],
            force[chosen],
            linestyle="none",
            marker=marker,
            markersize=4.2,
            markerfacecolor=colour,
            markeredgecolor="white",
            markeredgewidth=0.4,
            label=label,
        )


def _shade_unused(axes: Axes, curves: LogCurves, low: float, high: float) -> None:
    """Grey over stretches of at least 1 % of the picture that do not count in the fit."""
    if not curves.used.any():
        return
    change = np.flatnonzero(np.diff(np.concatenate([[True], curves.used, [True]]).astype(np.int8)))
    for first, last in change.reshape(-1, 2):
        start, stop = float(curves.time[first]), float(curves.time[min(last, len(curves.time) - 1)])
        if min(stop, high) - max(start, low) > 0.01 * (high - low):
            axes.axvspan(max(start, low), min(stop, high), color="#f1ede4", linewidth=0, zorder=0)


def _cuts(axes: Axes, curves: LogCurves, low: float, high: float, labelled: bool) -> None:
    """A bar along the foot of the picture over every stretch that was cut, and over the interval of a tare."""
    for kind, start, stop in curves.cuts:
        begin, end = max(start, low), min(stop, high)
        if end <= begin:
            continue
        colour, foot = (TARE_COLOUR, 0.1) if kind == "tare" else (QUIET, 0.0)
        axes.axvspan(begin, end, ymin=foot, ymax=foot + 0.03, color=colour, linewidth=0, zorder=5)
        words = CUT_WORDS.get(kind, kind)
        if labelled and end - begin > 0.02 * (high - low):
            axes.annotate(
                words,
                (0.5 * (begin + end), foot + 0.04),
                xycoords=("data", "axes fraction"),
                ha="center",
                va="bottom",
                fontsize=6.5,
                color=colour,
                rotation=0 if end - begin > LETTER * len(words) * (high - low) else 90,
            )


def _caption(whole: ForceView, fitted: bool, accepted: bool, curves: LogCurves) -> str:
    parts = []
    if curves.raw_force is not None:
        parts.append("Behind the measured force: as it was read, before it was corrected.")
    if curves.cuts:
        parts.append("Bars at the foot: what was cut, and where a zero was taken.")
    if fitted:
        parts.append("Residual = measured − fitted; dashed: ± 2 standard deviations of the noise.")
        if not accepted:
            parts.append("The fitted curve is the last iterate of a fit that was not accepted.")
    else:
        parts.append("No curve was fitted through this log; the marks are the cycles detected in the data.")
    if not whole.measured.exact:
        parts.append(
            f"Whole log: lowest and highest of every {whole.measured.per_stretch} samples, so that no peak is lost."
        )
    return " ".join(parts)


# ----------------------------------------------------------------------------------------------------------------------
# The picture of --preview: every log with its detected cycles and the force of the start trajectory, before any fit.
# ----------------------------------------------------------------------------------------------------------------------

STRETCHES = 1600
CLOSE = 3  # cycles in the close-up
MOST = 12  # logs in one picture


def draw_preview(seen: Preview) -> Figure:
    """One row per log: the whole of it, and a few cycles close up; at most 12 logs."""
    logs = seen.logs[:MOST]
    height = 0.7 + 2.1 * len(logs)
    figure = Figure(figsize=(WIDE, height))
    grid = figure.add_gridspec(
        len(logs),
        2,
        width_ratios=[1.7, 1],
        left=0.062,
        right=0.992,
        top=1 - 0.62 / height,
        bottom=0.42 / height,
        hspace=0.48,
        wspace=0.115,
    )
    for row, log in enumerate(logs):
        last = row == len(logs) - 1
        whole, near = figure.add_subplot(grid[row, 0]), figure.add_subplot(grid[row, 1])
        title = f"{printable(log.name)} · {speed(log.drive_speed)} · {log.told}"
        _panel(whole, log, 0, len(log.time))
        frame(whole, "time [s]" if last else "", "force [N]", title)
        whole.tick_params(labelbottom=True)
        _panel(near, log, *_close(log))
        frame(near, "time [s]" if last else "", "")
        near.tick_params(labelbottom=True)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper right", ncols=4, bbox_to_anchor=(0.995, 1.0))
    figure.text(0.008, 1 - 0.2 / height, f"Nothing is fitted yet. The start: {seen.source}.", fontsize=9, weight="bold")
    return figure


def _panel(axes: Axes, log: PreviewLog, start: int, stop: int) -> None:
    time = log.time[start:stop]
    thin = envelope(time, np.where(log.used, log.force, np.nan)[start:stop], STRETCHES)
    axes.fill_between(thin.time, thin.lower, thin.upper, color=MEASURED, alpha=0.35, linewidth=0)
    axes.plot(thin.time, 0.5 * (thin.lower + thin.upper), color=MEASURED, linewidth=0.8, label="measured")
    if np.isfinite(log.trajectory[start:stop]).any():
        trajectory = envelope(time, log.trajectory[start:stop], STRETCHES)
        axes.plot(
            trajectory.time,
            0.5 * (trajectory.lower + trajectory.upper),
            color=FITTED,
            linewidth=1.0,
            label="start trajectory",
        )
    padded(axes, log.force[start:stop][log.used[start:stop]], 0.15)
    for name, moments, colour in (("onset", log.onset, ONSET), ("arrest", log.arrest, ARREST)):
        inside = moments[(moments >= time[0]) & (moments <= time[-1])]
        axes.plot(inside, np.full(inside.size, axes.get_ylim()[0]), "|", color=colour, markersize=9, label=name)
    axes.set_xlim(time[0], time[-1])


def _close(log: PreviewLog) -> tuple[int, int]:
    """Samples of a few cycles in the middle, or of the whole log."""
    if log.onset.size < 2:
        return 0, len(log.time)
    middle = log.onset.size // 2
    period = float(np.median(np.diff(log.onset)))
    first, last = log.onset[middle] - 0.3 * period, log.onset[middle] + (CLOSE - 0.7) * period
    start, stop = np.searchsorted(log.time, [first, last])
    return (int(start), int(stop)) if stop - start >= 8 else (0, len(log.time))
