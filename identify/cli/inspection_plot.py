"""The inspected logs as a picture: forces over time with their phases, whole and a few cycles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from data_io.arrays import true_runs
from data_io.atomic import atomic_path
from identify.logs.segment import SLIDING, SLIP
from identify.report.style import extremes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from identify.cli.inspection import Inspection

Array = NDArray[np.float64]

STRETCHES = 1200  # of the overview: the lowest and highest of each, so that no spike is lost
CLOSE_CYCLES = 4
MOST_SHADED = 400  # phases of an overview; more of them would be one grey
COLOURS = {"accept": "tab:green", "accept with warnings": "darkorange", "reject": "tab:red"}
SHADES = ((SLIP, "C1", "slip"), (SLIDING, "C0", "sliding"))


def draw(seen: Sequence[Inspection], path: Path) -> None:
    """Per log: friction and normal force over time, and a few cycles closer by."""
    figure = Figure(figsize=(11.0, 3.7 * len(seen)), layout="constrained")
    for part, item in zip(figure.subfigures(len(seen), 1, squeeze=False)[:, 0], seen, strict=True):
        ratios = {"height_ratios": (3, 1), "width_ratios": (2.2, 1)}
        grid = part.subplots(2, 2, sharex="col", squeeze=False, gridspec_kw=ratios)
        codes = dict.fromkeys(f.code.replace("_", " ") for f in item.judgement.findings if f.severity != "info")
        title = f"{Path(item.path).name} · {item.judgement.verdict}{': ' if codes else ''}{', '.join(codes)}"
        part.suptitle(title.replace("$", r"\$"), fontsize=9, color=COLOURS[item.judgement.verdict])
        close = _few_cycles(item)
        for column, span in enumerate(((0.0, float(item.record.time[-1])), close)):
            _column(grid[0, column], grid[1, column], item, span)
        grid[0, 0].set_ylabel("friction force [N]", fontsize=8)
        grid[1, 0].set_ylabel("normal [N]", fontsize=8)
        named = dict(zip(*reversed(grid[0, 0].get_legend_handles_labels()), strict=True))  # one entry of a kind
        if named:
            grid[0, 0].legend(named.values(), named.keys(), fontsize=8, loc="upper right", ncols=4)
        grid[0, 1].set_title(f"{close[0]:.4g} to {close[1]:.4g} s", fontsize=8)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=130)


def _column(friction: Axes, normal: Axes, item: Inspection, span: tuple[float, float]) -> None:
    """Both forces within a span [s], the phases behind them, and every spike."""
    record = item.record
    inside = slice(*np.searchsorted(record.time, [span[0], span[1] + 1e-12]).tolist())
    for axes, values in ((friction, record.friction_force), (normal, record.normal_force)):
        kept = extremes(values[inside], STRETCHES)
        axes.plot(record.time[inside][kept], values[inside][kept], color="0.2", lw=0.7, zorder=2)
        axes.tick_params(labelsize=8)
    for step in item.steps:
        time = record.time[step.step.start : step.step.stop]
        for phase, colour, label in SHADES:
            spans = [(float(time[a]), float(time[b - 1])) for a, b in true_runs(step.phases.phase == phase)]
            spans = [(a, b) for a, b in spans if b >= span[0] and a <= span[1]]
            for begin, end in spans[:: max(len(spans) // MOST_SHADED, 1)]:
                # An edge, so that a slip narrower than a dot of the picture is still seen.
                friction.axvspan(begin, end, facecolor=colour, edgecolor=colour, alpha=0.3, lw=0.4, label=label)
        rows = np.flatnonzero(step.phases.spikes) + step.step.start
        if rows.size:
            friction.plot(record.time[rows], record.friction_force[rows], "x", ms=3, color="crimson", label="spike")
    normal.set_xlim(*span)
    normal.set_xlabel("time [s]")


def _few_cycles(item: Inspection) -> tuple[float, float]:
    """A stretch of a few cycles in the middle of the log; without cycles its middle tenth."""
    onsets = np.concatenate([seen.phases.cycles.onset for seen in item.steps])
    end = float(item.record.time[-1])
    if onsets.size <= CLOSE_CYCLES:
        return (0.45 * end, 0.55 * end) if onsets.size == 0 else (0.0, end)
    first = (onsets.size - CLOSE_CYCLES) // 2
    period = float(onsets[first + 1] - onsets[first])
    begin, last = float(onsets[first]), float(onsets[first + CLOSE_CYCLES - 1])
    return max(begin - 0.5 * period, 0.0), min(last + 0.6 * period, end)
