"""The inspected logs as a picture: forces, phases, spikes, rests and offsets as the quality gate found them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from data_io.arrays import true_runs
from data_io.atomic import atomic_path
from data_io.signals import UNLOADED, Rest
from identify.logs.segment import SLIDING, SLIP
from identify.report.style import envelope

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from identify.cli.inspection import Inspection, StepSeen

Array = NDArray[np.float64]

STRETCHES = 1200  # of the overview: the lowest and highest of each, so that no spike is lost
CLOSE_CYCLES = 4
MOST_SHADED = 400  # phases of an overview; more of them would be one grey
COLOURS = {"accept": "tab:green", "accept with warnings": "darkorange", "reject": "tab:red"}
SHADES = ((SLIP, "C1", "slip"), (SLIDING, "C0", "sliding"))
LEGEND_ROOM = 0.28  # of the range of the force, above it


def draw(seen: Sequence[Inspection], path: Path) -> None:
    """Per log: friction and normal force over time, and a few cycles closer by."""
    figure = Figure(figsize=(11.0, 3.7 * len(seen)), layout="constrained")
    for part, item in zip(figure.subfigures(len(seen), 1, squeeze=False)[:, 0], seen, strict=True):
        grid = part.subplots(
            2, 2, sharex="col", squeeze=False, gridspec_kw={"height_ratios": (3, 1), "width_ratios": (2.2, 1)}
        )
        part.suptitle(_title(item), fontsize=9, color=COLOURS[item.judgement.verdict])
        whole = (0.0, float(item.record.time[-1]))
        _column(grid[0, 0], grid[1, 0], item, whole)
        close = _few_cycles(item)
        _column(grid[0, 1], grid[1, 1], item, close)
        grid[0, 0].set_ylabel("friction force [N]", fontsize=8)
        grid[1, 0].set_ylabel("normal [N]", fontsize=8)
        _legend(grid[0, 0])
        grid[0, 1].set_title(f"{close[0]:.4g} to {close[1]:.4g} s", fontsize=8)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=130)


def _title(item: Inspection) -> str:
    codes = dict.fromkeys(f.code.replace("_", " ") for f in item.judgement.findings if f.severity != "info")
    reason = f": {', '.join(codes)}" if codes else ""
    return f"{Path(item.path).name} · {item.judgement.verdict}{reason}".replace("$", r"\$")


def _column(friction: Axes, normal: Axes, item: Inspection, span: tuple[float, float]) -> None:
    record = item.record
    inside = slice(*np.searchsorted(record.time, [span[0], span[1] + 1e-12]).tolist())
    _line(friction, record.time[inside], record.friction_force[inside], "0.2")
    _line(normal, record.time[inside], record.normal_force[inside], "0.4")
    _phases(friction, item.steps, record.time, span)
    _marks(friction, item, span)
    _offsets(friction, item)
    _gaps(friction, item, inside)
    _unloaded(normal, item, inside)
    normal.set_xlim(*span)
    normal.set_xlabel("time [s]")
    for axes in (friction, normal):
        axes.tick_params(labelsize=8)


def _line(axes: Axes, time: Array, values: Array, colour: str) -> None:
    seen = envelope(time, values, STRETCHES)
    if seen.exact:
        axes.plot(seen.time, seen.lower, color=colour, lw=0.7, zorder=2)
    else:
        axes.fill_between(seen.time, seen.lower, seen.upper, color=colour, lw=0.5, zorder=2)


def _phases(axes: Axes, steps: Sequence[StepSeen], times: Array, span: tuple[float, float]) -> None:
    for seen in steps:
        time = times[seen.step.start : seen.step.stop]
        for phase, colour, label in SHADES:
            spans = [(float(time[a]), float(time[b - 1])) for a, b in true_runs(seen.phases.phase == phase)]
            spans = [(a, b) for a, b in spans if b >= span[0] and a <= span[1]]
            for begin, end in spans[:: max(len(spans) // MOST_SHADED, 1)]:
                # an edge, so that a slip narrower than a dot of the picture is still seen
                axes.axvspan(begin, end, facecolor=colour, edgecolor=colour, alpha=0.3, lw=0.4, label=label, zorder=0)


def _marks(axes: Axes, item: Inspection, span: tuple[float, float]) -> None:
    """Force peaks and valleys of the cycles where they are few enough to be seen, and every spike."""
    record = item.record
    for seen in item.steps:
        cycles = seen.phases.cycles
        if np.count_nonzero((cycles.onset >= span[0]) & (cycles.onset <= span[1])) <= 2 * CLOSE_CYCLES:
            signs = seen.signs[np.searchsorted(record.time[seen.step.start : seen.step.stop], cycles.onset)]
            axes.plot(cycles.onset, signs * cycles.onset_force, "v", ms=4, color="C3", label="peak")
            axes.plot(cycles.arrest, signs * cycles.arrest_force, "^", ms=4, color="C2", label="valley")
        rows = np.flatnonzero(seen.phases.spikes) + seen.step.start
        rows = rows[np.isfinite(record.friction_force[rows])]
        if rows.size:
            size = 3.5 if rows.size * (span[1] - span[0]) < 200 * record.time[-1] else 2.0
            axes.plot(record.time[rows], record.friction_force[rows], "x", ms=size, mew=0.25 * size, color="crimson",
                      label="spike", zorder=3)  # fmt: skip


def _offsets(axes: Axes, item: Inspection) -> None:
    """What the sensor shows while the drive rests, as a line over that time and beyond."""
    rests, time = item.judgement.quality.rests, item.record.time
    named: tuple[tuple[str, Rest | None], ...] = (("at rest", rests.before), ("after the stop", rests.after))
    for label, rest in named:
        if rest is not None:
            begin, end = float(time[rest.start]), float(time[rest.stop - 1])
            axes.axvspan(begin, end, color="C4", alpha=0.2, lw=0, zorder=0)
            axes.plot([begin, end], [rest.force] * 2, color="C4", lw=2, label=f"{label}: {rest.force:.3g} N", zorder=4)


def _gaps(axes: Axes, item: Inspection, inside: slice) -> None:
    time = item.record.time[inside]
    change = np.diff(time)
    if item.judgement.quality.sampling.dropouts == 0 or change.size == 0:
        return
    for row in np.flatnonzero(change > 1.5 * np.median(change))[:MOST_SHADED]:
        axes.axvspan(float(time[row]), float(time[row + 1]), color="0.85", lw=0, zorder=0, label="gap")


def _unloaded(axes: Axes, item: Inspection, inside: slice) -> None:
    time, normal = item.record.time[inside], item.record.normal_force[inside]
    for a, b in true_runs(normal < UNLOADED * item.judgement.quality.load.mean):
        axes.axvspan(float(time[a]), float(time[b - 1]), color="0.85", lw=0, zorder=0)


def _few_cycles(item: Inspection) -> tuple[float, float]:
    """A stretch of a few cycles in the middle of the log; without cycles its middle tenth."""
    onsets = np.concatenate([seen.phases.cycles.onset for seen in item.steps])
    end = float(item.record.time[-1])
    if onsets.size <= CLOSE_CYCLES:
        return (0.45 * end, 0.55 * end) if onsets.size == 0 else (0.0, end)
    first = (onsets.size - CLOSE_CYCLES) // 2
    period = float(onsets[first + 1] - onsets[first])
    return max(float(onsets[first]) - 0.5 * period, 0.0), min(
        float(onsets[first + CLOSE_CYCLES - 1]) + 0.6 * period, end
    )


def _legend(axes: Axes) -> None:
    """One entry per kind of mark, above the curve."""
    named = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + LEGEND_ROOM * (high - low))
    if named:
        axes.legend(named.values(), named.keys(), frameon=False, fontsize=8, loc="upper right", ncols=4)
