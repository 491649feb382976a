"""The drawings of the page: means of parameters by group, curves over drive speed, a small picture of every fit."""

from __future__ import annotations

import io
import math
import warnings

import h5py
import matplotlib
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from identify.base.table import visible
from identify.base.wording import quantity, scale_for
from identify.report.report_figures import inline_svg
from identify.report.report_wording import plain_symbol
from identify.report.style import STYLE, extremes, logarithmic, printable
from identify.studies.compare import Comparison, PooledQuantity
from identify.studies.fits import FitEntry
from identify.studies.operating_points import Answers

# Okabe and Ito's colours, black and yellow left out; after six groups they begin again with a dashed line.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#B8860B", "#3f4750")
DASHES = ("-", "--", ":")
NAME = 24  # characters of a group in a drawing
FAR = 2.5  # times what means and fits span: an interval is drawn no further
TALLEST = 2.0  # times the highest curve: a band is drawn no higher
CYCLES, STRETCHES, MOST_SAMPLES = 3, 75, 200_000  # of a thumbnail


def _svg(figure: Figure, name: str, label: str) -> Markup:
    """The figure as an element of a page, with a description for those who cannot see it."""
    out = io.StringIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return Markup('<div class="drawing" role="img" aria-label="{}">{}</div>').format(
        visible(label, 300), Markup(inline_svg(out.getvalue(), name))
    )


def _colour(place: int) -> str:
    return COLOURS[place % len(COLOURS)]


def forest(comparison: Comparison, entry: PooledQuantity) -> Markup:
    """One parameter: for each group the mean with its 95 % interval, and every fit as a faint mark."""
    q, pooled = entry.quantity, entry.pooled
    assert pooled is not None
    groups = [group for group in comparison.groups if group in pooled.groups]
    fits = np.array([q.shown(float(v)) for v in pooled.y])
    unit = scale_for(float(np.median(fits)), q.unit)
    fits = fits / unit.factor
    of = np.array([comparison.taken.setting.group[i] for i in pooled.rows])
    means = np.array([q.shown(pooled.mean_of(group).value) for group in groups]) / unit.factor
    span = FAR * max(float(np.ptp(np.append(fits, means))), 0.1 * float(np.max(np.abs(means))))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(5.0, 0.9 + 0.34 * len(groups)), layout="constrained")
        axes = figure.add_subplot()
        for place, (group, value) in enumerate(zip(groups, means, strict=True)):
            mean, colour, y = pooled.mean_of(group), _colour(comparison.groups.index(group)), -place
            own = fits[of == group]
            axes.plot(own, np.full(len(own), y - 0.3), "|", color=colour, alpha=0.55, markersize=5)
            if mean.interval is not None:
                ends = [min(max(q.shown(v) / unit.factor, value - span), value + span) for v in mean.interval]
                axes.plot(ends, [y, y], color=colour, linewidth=2.4)
            axes.plot([value], [y], "o", color=colour, markerfacecolor=colour if mean.interval else "white")
        axes.set_yticks([-k for k in range(len(groups))], [printable(visible(g, NAME)) for g in groups])
        axes.set_ylim(-len(groups) + 0.4, 0.5)
        axes.set_xlabel(f"{plain_symbol(q.name)}{f' [{unit.unit}]' if unit.unit else ''}")
        label = f"{q.name} by {comparison.question.by}: means with 95 % intervals, every fit as a small mark"
        return _svg(figure, f"forest-{comparison.quantities.index(entry)}", label)


def curves(answers: Answers, which: str) -> Markup:
    """Curves of all groups over drive speed, "friction" or "amplitude", with the bands of their means and a thin line
    where 95 % of people and runs lie; upright lines: the common drive speeds."""
    pairs = [(k, a.group, a.friction if which == "friction" else a.amplitude) for k, a in enumerate(answers.groups)]
    drawn = [(k, group, c) for k, group, c in pairs if c is not None and np.any(np.isfinite(c.value))]
    if not drawn or answers.ground is None:
        return Markup("")
    title = "friction coefficient of steady sliding" if which == "friction" else "force from peak to valley [N]"
    most = TALLEST * max(float(np.nanmax(np.abs(c.value))) for _, _, c in drawn)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(5.0, 3.2), layout="constrained")
        axes = figure.add_subplot(xlabel="drive speed [mm/s]", ylabel=title)
        logarithmic(axes)
        for k, group, c in drawn:
            colour, v = _colour(k), 1e3 * c.speed
            axes.fill_between(v, c.low, c.high, color=colour, alpha=0.18, linewidth=0)
            for edge in (c.people_low, c.people_high):
                axes.plot(v, edge, ":", color=colour, linewidth=0.7)
            dashes = DASHES[k // len(COLOURS) % len(DASHES)]
            axes.plot(v, c.value, dashes, color=colour, linewidth=2, label=printable(visible(group, NAME)))
        for speed in answers.ground.speeds:
            axes.axvline(1e3 * speed, color="#a9b3bc", linewidth=0.8, linestyle=(0, (2, 3)))
        low, high = axes.get_ylim()
        axes.set_ylim(max(min(low, 0.0), -0.25 * most), min(high, most))
        axes.legend(fontsize=7, frameon=False, ncols=math.ceil(len(drawn) / 4))
        return _svg(figure, which, f"{title} against drive speed for every group, with 95 % bands")


class Thumbnails:
    """Draws fits in small: about three cycles of one log, the measured force grey, the fitted one over it."""

    def __init__(self) -> None:
        self._figure = Figure(figsize=(1.9, 0.78))
        self._axes = self._figure.add_axes((0.0, 0.02, 1.0, 0.96))
        self._axes.set_axis_off()

    def draw(self, entry: FitEntry, name: str) -> tuple[Markup, str]:
        """The picture of a fit and what it shows of which log; empty where there are no curves."""
        path = entry.folder / "result.h5"
        try:
            if not path.is_file():
                return Markup(""), ""
            with h5py.File(path, "r") as file:
                logs = sorted(file["curves"].values(), key=lambda log: abs(log.attrs.get("drive_speed_m_per_s", 0.0)))
                log = logs[len(logs) // 2]
                time = np.asarray(log["time"][:MOST_SAMPLES], float)
                first, last = _window(log, time)
                time = time[first:last]
                measured, fitted = (np.asarray(log[n][first:last], float) for n in ("friction_force", "fitted_force"))
                speed = abs(float(log.attrs.get("drive_speed_m_per_s", math.nan)))
        except (OSError, KeyError, ValueError, TypeError, RuntimeError, IndexError):  # a damaged file spoils its own
            return Markup(""), ""
        kept = extremes(measured, STRETCHES)
        for line in self._axes.lines[:]:
            line.remove()
        self._axes.plot(time[kept], measured[kept], color="#a3aeb8", linewidth=1.3)
        self._axes.plot(time[kept], fitted[kept], color="#D55E00", linewidth=0.8)
        self._axes.relim()
        self._axes.autoscale_view()
        words = f"{quantity(speed, 'm/s', 3)}, {quantity(float(np.ptp(time)), 's', 2)}"
        return _svg(self._figure, name, f"measured and fitted force, {words}"), words


def _window(log: h5py.Group, time: np.ndarray) -> tuple[int, int]:
    """Indices of about CYCLES cycles in the middle, from the onsets that the fit stored; else the middle third."""
    onsets = np.asarray(log["cycles/onset"][:], float) if "cycles/onset" in log else np.zeros(0)
    onsets = np.sort(onsets[np.isfinite(onsets)])
    begin, end = time[0] + np.ptp(time) / 3, time[0] + 2 * np.ptp(time) / 3
    if len(onsets) > 1:
        middle = max((len(onsets) - CYCLES) // 2, 0)
        half = 0.5 * float(np.median(np.diff(onsets)))
        begin, end = onsets[middle] - half, onsets[min(middle + CYCLES - 1, len(onsets) - 1)] + half
    first, last = (int(i) for i in np.searchsorted(time, [begin, end]))
    return (first, last) if last - first >= 2 else (0, len(time))
