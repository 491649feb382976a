"""The figures of logs: measured against fitted force, one slip as the model has it, how the cycles scatter; before a
fit, its start."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from data_io.notebook_figure import NotebookFigure
from identify.base.outcome import LogCurves, SlipDetail
from identify.base.result import StrengthCurve, UnevenCycles, UnevenResult
from identify.base.wording import number, quantity, scale_for
from identify.estimation.preview import Preview, PreviewLog
from identify.report.style import (
    ARREST,
    BEHIND,
    FITTED,
    MEASURED,
    ONSET,
    QUIET,
    RESIDUAL,
    SHADE,
    SLIDING,
    WIDE,
    Columns,
    Drawing,
    extremes,
    frame,
    logarithmic,
    padded,
    printable,
)

Array = NDArray[np.float64]

STRETCHES = 480  # of a long log: the lowest and highest of each is drawn
MOST_MARKS, MOST_POINTS = 120, 600
CLOSE = 3  # cycles in a close-up
FEWEST = 3  # cycles that a log must show for a histogram
BINS = 14
NARROWEST = 1e-3  # of the value: least width of a histogram
MOST_LOGS = 12  # in the picture of a preview
LETTER = 0.0095  # width of a letter of a label, as share of the picture
RAW_COLOUR, TARE_COLOUR, UNUSED_COLOUR = "#d9b98c", "#7fb3c8", "#f1ede4"
COLOURS = (ONSET, SLIDING, FITTED, ARREST, RESIDUAL, QUIET)  # of logs
CUT_WORDS = {
    "window": "outside the window",
    "exclude": "left out",
    "skip_cycles": "running-in",
    "lead": "before the fit",
}


def _close_up(time: Array, onsets: Array, middle: float) -> tuple[int, int]:
    """Samples [start, stop) of a few cycles about a time [s]; all where the whole log shows as much."""
    if len(onsets) < 2 * CLOSE:
        return 0, len(time)
    half = 0.5 * CLOSE * float(np.median(np.diff(onsets)))
    start, stop = np.searchsorted(time, [middle - half, middle + half]).tolist()
    return (start, stop) if stop - start >= 8 else (0, len(time))


# ----------------------------------------------------------------------------------------------------------------------
# Measured against fitted force of one log.
# ----------------------------------------------------------------------------------------------------------------------


def draw_force(curves: LogCurves, position: int, accepted: bool) -> Drawing:
    """The figure of log number `position` (from 1); `accepted`: whether the fit was."""
    fitted = bool(np.isfinite(curves.fitted_force).any())
    onsets = curves.cycles[:, 0]
    middle = (
        float(curves.slip.time.mean())
        if curves.slip is not None
        else float(onsets[len(onsets) // 2])
        if len(onsets)
        else 0.0
    )
    near = _close_up(curves.time, onsets, middle)
    columns = {"whole log": (0, len(curves.time)), **({"close-up": near} if near != (0, len(curves.time)) else {})}
    heights = [3.0, 1.15, 0.75] if fitted else [3.0, 0.75]
    height = 0.78 + 0.72 * sum(heights)
    figure = NotebookFigure(figsize=(WIDE, height))
    grid = figure.add_gridspec(
        len(heights),
        len(columns),
        height_ratios=heights,
        width_ratios=[2.1, 1][: len(columns)],
        left=0.062,
        right=0.98,
        top=1 - 0.32 / height,
        bottom=0.46 / height,
        hspace=0.14,
        wspace=0.115,
    )
    signals = {
        "measured": curves.friction_force,
        "fitted": curves.fitted_force,
        "residual": curves.friction_force - curves.fitted_force,
        "normal": curves.normal_force,
    }
    if curves.raw_force is not None:
        signals["raw"] = curves.raw_force
    tables: dict[str, Columns] = {}
    for column, (title, span) in enumerate(columns.items()):
        part = slice(*span)
        shown = {name: values[part] for name, values in signals.items()}
        axes = [figure.add_subplot(grid[row, column]) for row in range(len(heights))]
        _force_column(axes, curves, curves.time[part], shown, accepted, title)
        kept = np.unique(np.concatenate([extremes(shown[name], STRETCHES) for name in ("measured", "residual")]))
        drawn = {f"{n}_N": v[kept] for n, v in shown.items() if np.isfinite(v).any()}
        tables[f"log_{position}_force{'_closeup' * (column > 0)}"] = {"time_s": curves.time[part][kept], **drawn}
    what = "Measured and fitted friction force with residuals" if fitted else "Measured friction force with its cycles"
    caption = [
        "Behind the measured force: as it was read, before it was corrected." if "raw" in signals else "",
        "Bars at the foot: what was cut, and where a zero was taken." if curves.cuts else "",
        "Residual = measured − fitted; dashed: ± 2 standard deviations of the noise."
        if fitted
        else "No curve was fitted through this log; the marks are the cycles detected in the data.",
        "The fitted curve is the last iterate of a fit that was not accepted." if fitted and not accepted else "",
        "Of a long log the lowest and highest of every stretch are drawn, so that no peak is lost."
        if len(curves.time) > 2 * STRETCHES
        else "",
    ]
    return Drawing(
        name=f"log_{position}_force",
        figure=figure,
        alt=f"{what}, and normal force, of log {position} over time; {len(curves.cycles)} cycles are marked.",
        caption=" ".join(filter(None, caption)),
        wide=True,
        tables=tables,
        log=position,
    )


def _force_column(
    axes: Sequence[Axes], curves: LogCurves, time: Array, shown: dict[str, Array], accepted: bool, title: str
) -> None:
    """Force, residuals where there are any, and normal force of a stretch of a log, below each other."""
    force, normal, whole = axes[0], axes[-1], title == "whole log"
    low, high = float(time[0]), float(time[-1])
    fitted = len(axes) == 3

    def line(panel: Axes, name: str, colour: str, label: str, width: float, scale: float = 1.0) -> None:
        kept = extremes(shown[name], STRETCHES)
        panel.plot(time[kept], scale * shown[name][kept], color=colour, linewidth=width, label=label)

    if "raw" in shown:
        line(force, "raw", RAW_COLOUR, "as read", 0.8)
    line(force, "measured", BEHIND if fitted else MEASURED, "measured", 2.4 if fitted else 0.9)
    if fitted:
        line(force, "fitted", FITTED, "fitted" if accepted else "last iterate (not accepted)", 0.9)
        line(axes[1], "residual", RESIDUAL, "residual", 0.6, 1e3)
        noise = 1e3 * curves.noise if np.isfinite(curves.noise) else 0.0
        for line_at in (-2 * noise, 2 * noise) if noise else ():
            axes[1].axhline(line_at, color=MEASURED, linewidth=0.9, linestyle=(0, (4, 2)), zorder=3)
        finite = shown["residual"][np.isfinite(shown["residual"])]
        limit = 1.1 * max(1e3 * float(np.max(np.abs(finite), initial=0.0)), 3 * noise, 1e-9)
        axes[1].set_ylim(-limit, limit)
        frame(axes[1], "", "residual (mN)" if whole else "")
    line(normal, "normal", QUIET, "normal", 0.6)
    padded(
        force,
        np.concatenate([shown[n] for n in ("measured", "raw") if n in shown]),
        above=0.26 if "raw" in shown else 0.16,
    )
    padded(normal, shown["normal"], 0.3)
    for column, marker, colour, label in ((0, "v", ONSET, "onset"), (1, "^", ARREST, "arrest")):
        when, level = curves.cycles[:, column], curves.cycles[:, column + 2]
        inside = np.flatnonzero((when >= low) & (when <= high) & np.isfinite(level))
        if len(inside):  # too many for the picture: an even choice with every extreme
            kept = inside[extremes(level[inside], MOST_MARKS // 2)]
            look = {"markersize": 4.2, "markerfacecolor": colour, "markeredgecolor": "white", "markeredgewidth": 0.4}
            force.plot(when[kept], level[kept], linestyle="none", marker=marker, label=label, **look)  # type: ignore[arg-type]
    frame(force, "", "friction force (N)" if whole else "", title)
    frame(normal, "time (s)", "Fₙ (N)" if whole else "")
    if whole:
        force.legend(loc="upper right", ncols=4, handlelength=1.4, columnspacing=1.3, borderaxespad=0.1)
    _cuts(force, curves, low, high, whole)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], curves.used, [True]]).astype(np.int8))).reshape(-1, 2)
    for panel, bins in zip(axes, (6, 4, 3) if fitted else (6, 3), strict=True):
        panel.set_xlim(low, high)
        panel.locator_params(axis="x", nbins=8 if whole else 4)
        panel.locator_params(axis="y", nbins=bins)
        for first, last in edges if curves.used.any() else ():  # stretches that do not count in the fit
            start, stop = max(curves.time[first], low), min(curves.time[min(last, len(curves.time) - 1)], high)
            if stop - start > 0.01 * (high - low):
                panel.axvspan(start, stop, color=UNUSED_COLOUR, linewidth=0, zorder=0)


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


# ----------------------------------------------------------------------------------------------------------------------
# One typical slip as the fitted model has it, and its phase plane (figure 3 of the paper).
# ----------------------------------------------------------------------------------------------------------------------


def draw_slip(curves: LogCurves, slip: SlipDetail, position: int, accepted: bool) -> Drawing:
    """Force, sliding speed, gamma and friction coefficient of one slip of log number `position` (from 1) over time,
    and its elongation against the rate of that."""
    sliding = np.flatnonzero(slip.sliding_speed > 0)
    moving = [max(int(sliding[0]) - 1, 0), min(int(sliding[-1]) + 1, len(slip.time) - 1)] if len(sliding) else []
    origin = float(slip.time[moving[0] if moving else 0])
    clock, pace = scale_for(float(np.ptp(slip.time)), "s"), scale_for(float(np.nanmax(slip.sliding_speed)), "m/s")
    time = (slip.time - origin) / clock.factor
    panels: list[tuple[Array, str, str]] = [
        (slip.force, "force (N)", FITTED),
        (slip.sliding_speed / pace.factor, f"speed ({pace.unit})", SLIDING),
        (slip.gamma, "contact γ (1)", ARREST),
        (slip.coefficient, "coefficient (1)", ONSET),
    ]
    panels = [panel for panel in panels if np.isfinite(panel[0]).any()]
    figure = Figure(figsize=(WIDE, 4.7))
    ratios = [1.7] + [1] * (len(panels) - 1)
    grid = figure.add_gridspec(len(panels), 1, height_ratios=ratios, left=0.07, right=0.49, top=0.94, bottom=0.1)
    for row, (values, label, colour) in enumerate(panels):
        axes = figure.add_subplot(grid[row, 0])
        if row == 0 and len(slip.samples):
            kept = slip.samples[extremes(curves.friction_force[slip.samples], MOST_POINTS // 2)]
            measured = (curves.time[kept] - origin) / clock.factor, curves.friction_force[kept]
            axes.plot(*measured, ".", markersize=3.5, color=MEASURED, label="measured")
        axes.plot(time, values, color=colour, linewidth=1.3, label="fitted" if accepted else "last iterate")
        padded(axes, values)
        axes.set_xlim(float(time[0]), float(time[-1]))
        axes.locator_params(axis="y", nbins=3)
        for index in moving:
            axes.axvline(float(time[index]), color=QUIET, linewidth=0.8, linestyle=(0, (1, 2)))
        last = row == len(panels) - 1
        frame(axes, f"time from onset ({clock.unit})" * last, label, "" if row else f"slip of cycle {slip.cycle}")
        if row == 0:
            axes.legend(loc="upper right", handlelength=1.2, borderaxespad=0.1)
    drive = curves.drive_speed if np.isfinite(curves.drive_speed) else 0.0
    _phase_plane(figure.add_axes((0.57, 0.1, 0.42, 0.84)), slip, drive, moving)
    return Drawing(
        name=f"log_{position}_slip",
        figure=figure,
        alt=f"Force, sliding speed, contact age and friction coefficient over time in one slip of log {position}, and "
        "its phase plane: spring elongation against its rate.",
        caption="A typical slip: measured force and what the fitted model gives. Dotted lines: onset and arrest. Phase "
        "plane, dashed: the surfaces stick and the elongation grows at the drive speed"
        + ("." if drive else " (not constant here: the rate shown is minus the sliding speed)."),
        wide=True,
        tables={
            f"log_{position}_slip": {
                "time_s": slip.time,
                "force_N": slip.force,
                "elongation_m": slip.elongation,
                "elongation_rate_m_per_s": drive - slip.sliding_speed,
                "sliding_speed_m_per_s": slip.sliding_speed,
                "gamma": slip.gamma,
                "coefficient": slip.coefficient,
            },
            f"log_{position}_slip_measured": {
                "time_s": curves.time[slip.samples],
                "measured_N": curves.friction_force[slip.samples],
                "fitted_N": curves.fitted_force[slip.samples],
            },
        },
        log=position,
    )


def _phase_plane(axes: Axes, slip: SlipDetail, drive: float, moving: Sequence[int]) -> None:
    rate = drive - slip.sliding_speed
    along = scale_for(float(np.nanmax(np.abs(slip.elongation))), "m")
    pace = scale_for(float(np.nanmax(np.abs(rate))), "m/s")
    x, y = slip.elongation / along.factor, rate / pace.factor
    axes.axhline(drive / pace.factor, color=QUIET, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.plot(x, y, color=SLIDING, linewidth=1.4)
    for index, marker, colour, label in zip(moving, "v^", (ONSET, ARREST), ("onset", "arrest"), strict=False):
        axes.plot(x[index], y[index], marker=marker, markersize=7, color=colour, linestyle="none", label=label)
    if moving:  # which way the loop is run through
        middle = int(np.argmin(rate))
        arrow = {"arrowstyle": "-|>", "color": SLIDING, "linewidth": 1.2, "mutation_scale": 13}
        axes.annotate("", xy=(x[middle + 1], y[middle + 1]), xytext=(x[middle], y[middle]), arrowprops=arrow)
        axes.legend(loc="lower right", borderaxespad=0.2)
    padded(axes, y)
    frame(axes, f"spring elongation ({along.unit})", f"elongation rate ({pace.unit})", "phase plane")


# ----------------------------------------------------------------------------------------------------------------------
# How the cycles scatter: of one log, of the measured cycles of all, and of uneven records.
# ----------------------------------------------------------------------------------------------------------------------


def draw_cycles(curves: LogCurves, position: int, accepted: bool = True) -> Drawing:
    """Onset force, drop, period and misfit by cycle of log number `position` (from 1); it has at least one cycle.

    Args:
        accepted: the cycles are those of the fitted motion, where there is one, else as they were measured.
    """
    onset, arrest, peak, valley, misfit = curves.cycles.T
    count, scored = len(onset), bool(np.isfinite(misfit).any())
    period = np.append(np.diff(onset), np.nan)
    panels = [(peak, "N", "onset force", ONSET), (peak - valley, "N", "drop", ARREST), (period, "s", "period", SLIDING)]
    panels += [(misfit, "", "misfit z", FITTED)] if scored else []
    figure = Figure(figsize=(WIDE, 2.0))
    grid = figure.add_gridspec(1, len(panels), left=0.045, right=0.992, top=0.86, bottom=0.215, wspace=0.24)
    for column, (values, unit, name, colour) in enumerate(panels):
        axes = figure.add_subplot(grid[0, column])
        _by_cycle(axes, values, unit, name, colour)
        axes.set_xlim(0, count + 1)
    what = "of the motion as fitted" if accepted and scored else "as measured"
    return Drawing(
        name=f"log_{position}_cycles",
        figure=figure,
        alt=f"Onset force, drop, period and misfit of each of the {count} cycles of log {position}.",
        caption=f"Scatter from cycle to cycle {what}; line and band: mean ± standard deviation. "
        "A fit of one set of parameters takes all cycles as alike: "
        "scatter or a trend far above the noise means that the friction itself changed."
        + " Misfit z: how far a cycle's residual is from pure noise, in its standard deviations."
        * scored,
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
        log=position,
    )


def _by_cycle(axes: Axes, values: Array, unit: str, name: str, colour: str) -> None:
    finite = values[np.isfinite(values)]
    if not len(finite):
        axes.text(0.5, 0.5, "no complete cycle", ha="center", va="center", transform=axes.transAxes, color=QUIET)
        frame(axes, "cycle", "", name)
        return
    scale = scale_for(float(np.median(finite)), unit)
    mean, spread = float(finite.mean()) / scale.factor, float(finite.std(ddof=min(1, len(finite) - 1))) / scale.factor
    if unit:
        axes.axhspan(mean - spread, mean + spread, color=SHADE, linewidth=0)
    axes.axhline(mean if unit else 0.0, color=QUIET, linewidth=0.8)
    kept = extremes(values, MOST_POINTS // 2)
    axes.plot(kept + 1, values[kept] / scale.factor, "o", color=colour, markersize=3.2, alpha=0.9)
    low, high = axes.get_ylim()
    if unit and high - low < 0.04 * abs(mean):  # scatter far below the level is shown as small, not blown up
        axes.set_ylim(mean - 0.02 * abs(mean), mean + 0.02 * abs(mean))
    frame(axes, "cycle", "", f"{name} ({scale.unit or '1'})")
    if unit and mean:
        note = f"SD {number(100 * spread / abs(mean), 2)} %"
        axes.set_title(note, loc="right", fontweight="normal", color=QUIET, y=1.0, pad=5)
    axes.locator_params(axis="y", nbins=4)
    axes.locator_params(axis="x", nbins=6, integer=True)


def measured_cycles(logs: Sequence[LogCurves]) -> dict[str, Array]:
    """The cycles of all logs as they were measured, by column. Strength: friction over normal force at the onset; hold
    time: from an arrest to the next onset (NaN of the first)."""
    columns = ("log", "cycle", "onset_s", "arrest_s", "onset_force_N", "arrest_force_N", "strength", "drop_N", "hold_s")
    rows = [np.empty((0, len(columns)))]
    for position, log in enumerate(logs, 1):
        onset, arrest, peak, valley = log.measured.T
        load = np.interp(onset, log.time, log.normal_force) if onset.size else onset
        hold = np.append(np.nan, onset[1:] - arrest[:-1])[: onset.size]
        cycle = np.arange(1, onset.size + 1)
        of_log = np.full(onset.size, position)
        rows.append(np.column_stack([of_log, cycle, onset, arrest, peak, valley, peak / load, peak - valley, hold]))
    return dict(zip(columns, np.concatenate(rows).T, strict=True))


def draw_measured(logs: Sequence[LogCurves]) -> Drawing | None:
    """Histograms of strength, drop and hold time, strength against hold time, mean coefficient against drive speed;
    None where no log shows `FEWEST` cycles."""
    shown = {position: log for position, log in enumerate(logs, 1) if len(log.measured) >= FEWEST}
    if not shown:
        return None
    table = measured_cycles(logs)
    figure = Figure(figsize=(WIDE, 2.3))
    grid = figure.add_gridspec(1, 5, left=0.045, right=0.992, top=0.86, bottom=0.21, wspace=0.34)
    axes = [figure.add_subplot(grid[0, column]) for column in range(5)]
    colours = dict(zip(shown, (COLOURS * len(shown))[: len(shown)], strict=True))
    for place, (name, unit, words) in enumerate(
        (("strength", "", "strength"), ("drop_N", "N", "drop"), ("hold_s", "s", "hold time"))
    ):
        values = [table[name][(table["log"] == position) & np.isfinite(table[name])] for position in shown]
        _histogram(axes[place], values, list(colours.values()), unit, words)
    means = []
    for position, log in shown.items():
        mine = table["log"] == position
        label = f"log {position}"
        axes[3].plot(
            table["hold_s"][mine], table["strength"][mine], ".", color=colours[position], markersize=4, label=label
        )
        inside = log.used & (log.time >= log.measured[0, 0]) & (log.time <= log.measured[-1, 0])
        means.append(np.nanmean((log.friction_force / log.normal_force)[inside]) if inside.any() else np.nan)
    logarithmic(axes[3])
    frame(axes[3], "hold time (s)", "", "strength (1)")
    axes[3].legend(fontsize=6.5, handletextpad=0.1, borderaxespad=0.1)
    speeds = np.array([abs(log.drive_speed) for log in shown.values()])
    axes[4].plot(1e3 * speeds, means, "o", color=SLIDING, markersize=4)
    if np.all(speeds > 0.0):
        logarithmic(axes[4])
    frame(axes[4], "drive speed (mm/s)", "", "mean coefficient (1)")
    count = sum(len(log.measured) for log in shown.values())
    return Drawing(
        name="measured",
        figure=figure,
        alt=f"How the {count} measured cycles of {len(shown)} logs scatter, and what strength and mean follow.",
        caption="The cycles as measured, without a model. Strength: friction over normal force at the onset; hold "
        "time: from an arrest to the next onset. A strength that rises with the hold time is contact ageing; one that "
        "scatters at equal hold times is a surface that differs from place to place.",
        wide=True,
        tables={"measured_means": {"drive_speed_m_per_s": speeds, "mean_coefficient": np.array(means)}},
    )


def _histogram(axes: Axes, values: Sequence[Array], colours: Sequence[str], unit: str, name: str) -> None:
    together = np.concatenate(values)
    if not together.size:  # without a load there is no strength
        frame(axes, name, "", "cycles")
        return
    scale = scale_for(float(np.median(together)), unit)
    low, high = float(together.min()), float(together.max())
    wider = max(0.0, NARROWEST * abs(high) - (high - low)) / 2  # cycles may be alike but for rounding
    span = ((low - wider) / scale.factor, (high + wider) / scale.factor)
    axes.hist([v / scale.factor for v in values], bins=BINS, range=span, stacked=True, color=list(colours))
    frame(axes, f"{name} ({scale.unit or '1'})", "", "cycles")
    axes.locator_params(axis="y", nbins=4, integer=True)
    axes.locator_params(axis="x", nbins=4)


def draw_uneven(uneven: UnevenResult) -> Iterator[Drawing]:
    """One figure per log that the estimator of uneven records took: onsets and the slow level along the record,
    and strength against rest."""
    for cycles in uneven.uneven_cycles:
        yield _uneven(cycles, uneven.strength_against_rest)


def _uneven(cycles: UnevenCycles, curve: StrengthCurve | None) -> Drawing:
    names = ("cycle", "onset_s", "rest_s", "onset", "drop", "strength", "level")
    column = {name: np.array(getattr(cycles, name), dtype=np.float64) for name in names}
    time = column["onset_s"]
    figure = Figure(figsize=(WIDE, 3.0))
    grid = figure.add_gridspec(1, 2, width_ratios=(1.9, 1.0), left=0.06, right=0.992, top=0.9, bottom=0.16, wspace=0.18)
    along, against = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    lowest = column["onset"] - column["drop"]
    along.vlines(time, lowest, column["onset"], color=BEHIND, linewidth=0.8)
    along.plot(time, column["onset"], "o", color=ONSET, markersize=3.4, label="onset")
    along.plot(time, lowest, "o", color=ARREST, markersize=2.6, label="arrest")
    along.plot(time, column["level"], color=FITTED, linewidth=1.1, label="slow level")
    padded(along, np.append(column["onset"], lowest), above=0.12)
    along.legend(loc="upper left", ncols=4)
    frame(along, "time (s)", "", "friction over load")
    if curve is not None:
        against.fill_between(curve.rest_s, curve.lower, curve.upper, color=SHADE, linewidth=0)
        against.plot(curve.rest_s, curve.strength, color=FITTED, label="usual strength, 95 % band")
        against.legend(loc="upper right")
    against.plot(column["rest_s"], column["strength"], "o", color=ONSET, markersize=3.2)
    against.margins(y=0.12)
    against.set_ylim(bottom=0.0)
    against.set_xlim(left=0.0)
    frame(against, "rest before the slip (s)", "", "strength over load")
    return Drawing(
        name=f"log_{cycles.log}_uneven",
        figure=figure,
        alt=f"Onsets, arrests and slow level of the {time.size} cycles of log {cycles.log}, and their strengths "
        "against the rest before them.",
        caption="Left: friction over the load at onsets and arrests, and the slow level that the cycles follow. Right: "
        "strength of every stick (onset above the slow level) against its rest; line and band: the usual strength, "
        "within the rests seen. A stick is long because the spot was strong, so the points rise more steeply than the "
        "line.",
        wide=True,
        tables={f"log_{cycles.log}_uneven": column},
        log=cycles.log,
    )


# ----------------------------------------------------------------------------------------------------------------------
# The picture of --preview: every log with its detected cycles and the force of the start trajectory, before any fit.
# ----------------------------------------------------------------------------------------------------------------------


def draw_preview(seen: Preview) -> Figure:
    """One row per log: the whole of it, and a few cycles close up; at most 12 logs."""
    logs = seen.logs[:MOST_LOGS]
    figure = Figure(figsize=(WIDE, 0.7 + 2.1 * len(logs)), layout="constrained")
    figure.suptitle(f"Nothing is fitted yet. The start: {seen.source}.", fontsize=9, weight="bold", x=0.008, ha="left")
    grid = figure.subplots(len(logs), 2, squeeze=False, width_ratios=[1.7, 1])
    for (whole, near), log in zip(grid, logs, strict=True):
        _preview_panel(whole, log, 0, len(log.time))
        middle = float(log.onset[log.onset.size // 2]) if log.onset.size else 0.0
        _preview_panel(near, log, *_close_up(log.time, log.onset, middle))
        whole.set_title(f"{printable(log.name)} · {quantity(log.drive_speed, 'm/s')} · {log.told}")
        whole.set_ylabel("force (N)")
    for axes in grid[-1]:
        axes.set_xlabel("time (s)")
    grid[0, 0].legend(loc="upper right", ncols=4)
    return figure


def _preview_panel(axes: Axes, log: PreviewLog, start: int, stop: int) -> None:
    time, measured = log.time[start:stop], np.where(log.used, log.force, np.nan)[start:stop]
    for values, colour, label in (
        (measured, BEHIND, "measured"),
        (log.trajectory[start:stop], FITTED, "start trajectory"),
    ):
        kept = extremes(values, STRETCHES)
        axes.plot(time[kept], values[kept], color=colour, linewidth=0.9, label=label)
    padded(axes, measured, 0.15)
    for name, moments, colour in (("onset", log.onset, ONSET), ("arrest", log.arrest, ARREST)):
        inside = moments[(moments >= time[0]) & (moments <= time[-1])]
        axes.plot(inside, np.full(inside.size, axes.get_ylim()[0]), "|", color=colour, markersize=9, label=name)
    axes.set_xlim(time[0], time[-1])
