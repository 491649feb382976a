"""The picture of --preview: every log with its detected cycles and the force of the start guess, before any fit."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from identify.estimation.preview import Preview, PreviewLog
from identify.report.envelope import envelope
from identify.report.quantity_text import speed
from identify.report.style import ARREST, FITTED, MEASURED, ONSET, WIDE, frame, padded, printable

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
    if np.isfinite(log.guess[start:stop]).any():
        guess = envelope(time, log.guess[start:stop], STRETCHES)
        axes.plot(guess.time, 0.5 * (guess.lower + guess.upper), color=FITTED, linewidth=1.0, label="start guess")
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
